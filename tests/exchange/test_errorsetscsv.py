"""Files of sets of observations: what is read, and what is refused with file and line."""

from __future__ import annotations

import pytest

from anaplot.errors import InputError
from anaplot.exchange.errorsetscsv import SetRow, read_error_sets


def test_rows_are_read_with_their_lines(tmp_path) -> None:
    path = tmp_path / "sets.csv"
    path.write_text("set,photo,point,axis,share\nA,101,7,x,1\n\nA,102,7,x,-1\nB,,7,Z,\n")
    rows = read_error_sets(path)
    assert rows[0] == SetRow("A", "101", "7", "x", None, 1.0, f"{path} line 2")
    assert [row.where for row in rows[1:]] == [f"{path} line 4", f"{path} line 5"]
    assert rows[2][1:6] == (None, "7", "Z", None, None)


def test_a_prior_of_a_point_has_a_word_of_its_own(tmp_path) -> None:
    path = tmp_path / "sets.csv"
    path.write_text("set,point,axis,use\nA,7,Z,prior\nA,7,,prior\nB,7,Z,\n")
    assert [(row.axis, row.prior) for row in read_error_sets(path)] == [
        ("Z", True),
        (None, True),
        ("Z", False),
    ]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("set,photo,point,axis,use\nA,101,7,X,prior\n", "line 2.*use: a prior has a point, and"),
        ("set,point,axis,use\nA,7,x,prior\n", "line 2.*axis: x is none of a prior"),
        ("set,point,axis,use\nA,7,X,control\n", "line 2.*use"),
        ("set,photo\n", "no rows"),
        ("set,photo\nA,\n", "line 2: neither a photo nor a point nor a condition"),
        ("photo\n101\n", "set"),
        ("set,photo,axis\nA,101,w\n", "line 2.*axis"),
        ("set,photo,share\nA,101,1\nA,102,\n", "line 3.*set A: in some rows only"),
        ("set,photo,size\nA,101,1\n", "size"),
    ],
)
def test_a_wrong_row_is_named(tmp_path, text, what) -> None:
    path = tmp_path / "sets.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"sets\.csv.*{what}"):
        read_error_sets(path)
