"""distances.csv and conditions.csv: what is read, and what is refused with file and line."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.blockpack import pack_block, unpack_block
from anaplot.exchange.conditionscsv import parse_conditions, parse_distances
from anaplot.photogrammetry.objectconditions import ObjectCondition

DISTANCES = "from,to,distance,sigma,use\n1,2,12.5,0.01,\n 2 ,b 3,7,0,check\n3,1,4.25,-0,off\n"
CONDITIONS = "sigma,kind,points,value\n0.02,line,1 2  3,\n0,plane,1 2 3 4,\n1e-4,angle,1 2 3,1.5\n"


def written(folder: Path, text: str, name: str = "conditions.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_rows_are_read_in_file_order_with_their_lines(make_block) -> None:
    folder = make_block()
    written(folder, DISTANCES, "distances.csv")
    written(folder, CONDITIONS)
    block = read_block(folder)
    assert block.conditions == (
        ObjectCondition("distance", ("1", "2"), 12.5, 0.01, "control", "distances.csv:2"),
        ObjectCondition("distance", ("2", "b 3"), 7.0, 0.0, "check", "distances.csv:3"),
        ObjectCondition("distance", ("3", "1"), 4.25, 0.0, "off", "distances.csv:4"),
        ObjectCondition("line", ("1", "2", "3"), None, 0.02, "control", "conditions.csv:2"),
        ObjectCondition("plane", ("1", "2", "3", "4"), None, 0.0, "control", "conditions.csv:3"),
        ObjectCondition("angle", ("1", "2", "3"), 1.5, 1e-4, "control", "conditions.csv:4"),
    )
    assert math.copysign(1.0, block.conditions[2].sigma) == 1.0


def test_a_pack_carries_them(make_block, tmp_path) -> None:
    folder = make_block()
    written(folder, CONDITIONS)
    pack_block(folder, tmp_path / "pack.zip")
    unpack_block(tmp_path / "pack.zip", tmp_path / "again")
    assert read_block(tmp_path / "again").conditions == read_block(folder).conditions


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("kind,points,value,sigma\nplane,1 2 3,,0.1\n", r"line 2: 3 points lie on a plane"),
        ("kind,points,value,sigma\n\nline,1 2 2,,0.1\n", r"line 3: point 2 twice"),
        ("kind,points,value,sigma\ncircle,1 2 3,,0.1\n", r"line 2.*kind"),
        ("kind,points,value,sigma\nangle,1 2 3,90,0.1\n", r"line 2: an angle of 90 rad"),
        ("kind,points,value,sigma\nline,1 2 3,,\n", r"line 2.*sigma"),
        ("kind,points,value,sigma\nline,1 2 3,,-0.1\n", r"line 2.*sigma"),
        ("kind,points,value,sigma\nline,1 2 3,,nan\n", r"line 2.*sigma"),
        ("kind,points,value,sigma\nline,1 2 3,,1e-200\n", r"line 2: sigma: 1e-200 is too small"),
        ("kind,points,value\nline,1 2 3,\n", r"sigma"),
        ("kind,points,value,sigma,use\nline,1 2 3,,0.1,prior\n", r"line 2.*use"),
        ("kind,points,value,sigma,colour\nline,1 2 3,,0.1,red\n", r"colour"),
    ],
)
def test_a_wrong_row_is_named_by_file_and_line(tmp_path, text, what) -> None:
    with pytest.raises(InputError, match=rf"conditions\.csv.*{what}"):
        parse_conditions(written(tmp_path, text))


@pytest.mark.parametrize(
    ("row", "what"),
    [
        ("1,1,5,0.1", "point 1 twice"),
        ("1,2,0,0.1", "a distance of 0"),
        ("1,2,-3,0.1", "a distance of -3"),
        ("1,2,5,x", "sigma"),
        ("1,2,5,1e-200", "sigma: 1e-200 is too small for a standard deviation"),
        ("1,2,5,1e300", "sigma: 1e.300 is too large"),
        ("1,2,1e300,0.01", "distance: must lie between"),
        ("1,,5,0.1", "to"),
    ],
)
def test_a_wrong_distance_is_named(tmp_path, row, what) -> None:
    path = written(tmp_path, f"from,to,distance,sigma\n{row}\n", "distances.csv")
    with pytest.raises(InputError, match=rf"distances\.csv line 2.*{what}"):
        parse_distances(path)


@given(st.text(alphabet="linepagq uao,0123456789.-\n\x00é", max_size=60))
def test_any_text_is_read_or_refused(tmp_path_factory, text) -> None:
    path = written(tmp_path_factory.mktemp("any"), f"kind,points,value,sigma\n{text}")
    try:
        rows = parse_conditions(path)
    except InputError as error:
        refused = str(error)
        rows = ()
    else:
        refused = "conditions.csv"
    assert "conditions.csv" in refused
    assert all(row.sigma >= 0.0 and len(row.points) >= 3 for row in rows)
