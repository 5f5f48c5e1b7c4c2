"""A file of movements: read strictly."""

from __future__ import annotations

import re

import pytest

from anaplot.errors import InputError
from anaplot.exchange.givenmovementcsv import read_given_movement


def test_movements_of_two_epochs_and_of_more(tmp_path) -> None:
    path = tmp_path / "moves.csv"
    path.write_text("point,dX,dY,dZ\np1,0,-0.5,1e-3\n", encoding="utf-8")
    [row] = read_given_movement(path)
    assert row[:4] == ("p1", None, None, (0.0, -0.5, 0.001))
    path.write_text("to,from,point,dZ,dY,dX\n3,2,p1,3,2,1\n2,1,p1,0,0,0\n", encoding="utf-8")
    first, second = read_given_movement(path)
    assert first[:4] == ("p1", 2, 3, (1.0, 2.0, 3.0))
    assert second.where.endswith("moves.csv line 3")


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("point,dX,dY,dZ\n", "no rows"),
        ("point,dX,dY\np1,0,0\n", "no column 'dZ'"),
        ("point,dX,dY,dZ\np1,0,,0\n", "line 2: dY: is empty"),
        ("point,from,to,dX,dY,dZ\np1,1,,0,0,0\n", "line 2: from and to go together"),
        ("point,from,to,dX,dY,dZ\np1,2,2,0,0,0\n", "line 2: to: 2 is no later epoch than 2"),
        ("point,from,to,dX,dY,dZ\np1,1.5,2,0,0,0\n", "there is no 1.5"),
        ("point,from,to,dX,dY,dZ\np1,0,2,0,0,0\n", "line 2: from: must lie between"),
        ("point,dX,dY,dZ\np1,0,0,0\np1,0,0,1\n", "(lines 2 and 3)"),
        ("point,from,to,dX,dY,dZ\np1,1,2,0,0,0\np1,1,2,0,0,1\n", "twice in from 1 in to 2"),
        ("point,dX,dY,dZ\np1,1e155,0,0\n", "line 2: dX: must lie between"),
        ("point,dX,dY,dZ\np1,0,1e-400,0\n", "line 2: dY: is too small a number: '1e-400'"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, rows, said) -> None:
    path = tmp_path / "moves.csv"
    path.write_text(rows, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(said)):
        read_given_movement(path)
