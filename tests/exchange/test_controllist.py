"""Lists of control points as others write them."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange.controlcsv import GroundPoints, format_control, parse_control
from anaplot.exchange.controllist import read_control_list
from anaplot.photogrammetry.block import ControlPoint, PointPrior


def listed(tmp_path: Path, text: str) -> GroundPoints:
    file = tmp_path / "points.txt"
    file.write_text(text)
    return read_control_list(file)


def read(tmp_path: Path, text: str) -> tuple[ControlPoint, ...]:
    found = listed(tmp_path, text)
    assert not found.priors
    return found.control


SEVEN = ControlPoint("7", (1000.5, 2000.0, 310.25), (0.1, 0.1, 0.1))


@pytest.mark.parametrize(
    "text",
    [
        "name,E,N,H,sigma\n7,1000.5,2000,310.25,0.1\n",
        "# a survey\n\nH;n;E [m];Point;SIGMA(m)\n310.25;2000;1000.5;7;0.1\n",
        "id\teasting\tnorthing\theight\tsx\tsy\tsz\n7\t1000.5\t2000\t310.25\t.1\t.1\t.1\n",
        "Nr   X  Y   Z  sXY  sZ\n 7  1000.5  2000.0  310.25  0.1   0.1\n",
        "Pt No.,North (m),East (m),Ellipsoidal Height,Std. dev. X,sigma-Y,SD_Z_m,Description\n"
        "7,2000,1000.5,310.25,.1,.1,.1,white cross\n",
        "Punkt;Rechtswert;Hochwert;Höhe in m;accuracy;Code\n7;1000.5;2000;310.25;0.1;\n",
        '\ufeffpoint,X,Y,Z,s,use\n"7",1000.5,2000,310.25,0.1,control\n',
    ],
)
def test_any_order_and_any_usual_header(tmp_path: Path, text: str) -> None:
    assert read(tmp_path, text) == (SEVEN,)


@pytest.mark.parametrize("mark", [";", "\t", "  "])
def test_numbers_may_have_a_decimal_comma_where_commas_do_not_separate(
    tmp_path: Path, mark: str
) -> None:
    text = "name E N H sigma use\n7 1000,5 2000 310,25 ,1 control\n8,5 1 2 3 0 off\n"
    found = listed(tmp_path, text.replace(" ", mark))
    assert found.control[0] == SEVEN
    assert found.control[1].point == "8,5"  # a name is no number
    assert found.commas == 3


def test_what_is_not_known_is_blank(tmp_path: Path) -> None:
    found = read(tmp_path, "name;E;N;H;sZ;use\n1;5;6;;;check\n2;;;7;0;\n3;1;2;3;0.5;off\n")
    assert found == (
        ControlPoint("1", (5.0, 6.0, None), use="check"),
        ControlPoint("2", (None, None, 7.0), (None, None, 0.0)),
        ControlPoint("3", (1.0, 2.0, 3.0), (None, None, 0.5), use="off"),
    )
    assert read(tmp_path, "name,E,N\n1,5,6\n")[0].xyz == (5.0, 6.0, None)


def test_priors_stand_beside_control(tmp_path: Path) -> None:
    found = listed(tmp_path, "name,E,N,H,s,use\n1,5,6,7,3.2,prior\n1,5,6,7,,check\n2,1,2,3,,off\n")
    assert found.priors == (PointPrior("1", (5.0, 6.0, 7.0), (3.2, 3.2, 3.2)),)
    assert [(one.point, one.use) for one in found.control] == [("1", "check"), ("2", "off")]


def test_any_number_of_rows_that_are_off_stand_beside_the_others(tmp_path: Path) -> None:
    text = (
        "point,X,Y,Z,sX,sY,sZ,use\n1,5,6,7,1,1,1,off\n1,5,6,7,,,,control\n1,5,6,7,2,2,2,prior\n"
        "1,5,6,7,3,3,3,off\n1,5,6,8,3,3,3,off\n"
    )
    path = tmp_path / "control.csv"
    path.write_text(text)
    found = parse_control(path)
    assert [row.use for row in found.control] == ["off", "control", "off", "off"]
    assert [row.sigma for row in found.priors] == [(2.0, 2.0, 2.0)]
    assert listed(tmp_path, text) == found
    # what is written reads back as the same, control first
    path.write_text(format_control(found.control, found.priors))
    assert parse_control(path) == found
    for again in ("control", "check", "prior"):
        path.write_text(text + f"1,5,6,7,1,1,1,{again}\n")
        with pytest.raises(InputError, match="point '1' twice"):
            parse_control(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "names no column point or name or id"),
        ("name,E,N\n", "no control point"),
        ("name,E,H\n1,2,3\n", "line 1: the header names no column y or n or north"),
        ("name,E,N,colour\n1,2,3,red\n", "line 1: unknown column 'colour'"),
        ("name,E,N,X\n1,2,3,4\n", "line 1: column X twice"),
        ("name,E,N\n1,2\n", "line 2: 2 fields, the header has 3"),
        ("name;E;N\n1;2,5,1;3\n", "line 2: X: must be a finite number, not '2,5,1'"),
        ("name E N\n1 2,5x 3\n", "line 2: X: must be a finite number, not '2,5x'"),
        ("name,E,N\n\n1,2,nan\n", "line 3: Y: "),
        ("name,E,N,s\n1,2,3,-1\n", "line 2: s: "),
        ("name,E,N,use\n1,2,3,maybe\n", "line 2: use: "),
        ("name,E,N\n1,2,3\n1,3,4\n", "line 3: point '1' twice (first in line 2)"),
        ("name,E,N,s,use\n1,2,3,1,prior\n1,3,4,1,prior\n", "line 3: point '1' twice"),
        ("name,E,N,use\n1,2,3,prior\n", "line 2: sX: is blank, but a prior needs a positive"),
        ("name,E,N,s,use\n1,2,3,0,prior\n", "line 2: sX: is 0, but a prior needs a positive"),
        ('name,E,N\n"1,2,3\n', "line 2: not a row"),
        ("name,E,N\n\x1b[2J,2,3\n", "line 2: point: the name"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.binary(max_size=200))
def test_any_bytes_are_points_or_an_input_error(tmp_path_factory, data: bytes) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path_factory.getbasetemp() / "any.txt"
    file.write_bytes(b"name,E,N\n" + data)
    try:
        found = read_control_list(file)
    except InputError:
        return
    for points in found:
        assert len({point.point for point in points}) == len(points)
