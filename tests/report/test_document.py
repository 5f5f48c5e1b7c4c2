"""Documents: what is declared once is the same as text, JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.report import output as output_module
from anaplot.report.ascsv import csv_text
from anaplot.report.asjson import json_text
from anaplot.report.astext import MOST_ROWS, page_text, table_lines
from anaplot.report.columns import cell
from anaplot.report.document import (
    BLANK,
    Column,
    Document,
    Figure,
    Later,
    Line,
    Listed,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    table,
    whole,
)
from anaplot.report.output import Output

COLUMNS = (
    name("point", "POINT", 5),
    number("v", "v [mm]", 2, 9, unit="m", scale=1e3),
    whole("rays", "RAYS", 6),
    *for_programs("effect", unit="m", parts=("X", "Y")),
    name("flagged", form=lambda flagged: "<< LOOK" if flagged else "", look=bool),
    name("", "seen", gap=1, head=""),
)


def made(n: int, *, flagged: tuple[int, ...] = ()) -> Table:
    rows = ((f"p{k}", k / 7, k, (0.5, float(k)), k in flagged, "twice") for k in range(n))
    return table("points", COLUMNS, rows)


@pytest.mark.parametrize("form", [None, str, lambda text: f"<{text}>"])
def test_no_cell_controls_the_terminal_however_it_is_written(form) -> None:
    outside = "7\x1b[2J\n\u202e\x9b"
    columns = (
        name("point", "POINT", 5, form=form),
        Column("kind", "KIND", 9, form=str if form is None else form),
    )
    found = table("points", columns, [("9", "a"), (outside, outside)])
    lines = table_lines(found)
    assert len(lines) == 3
    assert all(line.isprintable() for line in lines)
    assert lines[2].count("7\\x1b[2J\\x0a\\u202e\\x9b") == 2
    assert found.records()[1]["point"] == outside  # programs get it as it is


def test_one_declaration_is_three_renderings() -> None:
    rows = (("7", 0.0123, 3, None, True, "a"), ("a\x1b8", None, 2, (1.5, -2.0), False, ""))
    found = table("points", COLUMNS, rows)
    assert table_lines(found) == [
        "  POINT    v [mm]  RAYS",
        "  7         12.30     3  << LOOK a",
        "  a\\x1b8        -     2",
    ]
    assert json.loads(json_text({"points": found})) == {
        "points": [
            {"point": "7", "v": 0.0123, "rays": 3, "effect": None, "flagged": True},
            {"point": "a\x1b8", "v": None, "rays": 2, "effect": [1.5, -2.0], "flagged": False},
        ]
    }
    assert list(csv.reader(io.StringIO(csv_text(found)))) == [
        ["point", "v", "rays", "effect_X", "effect_Y", "flagged"],
        ["7", "0.0123", "3", "", "", "1"],
        ["a\x1b8", "", "2", "1.5", "-2.0", "0"],
    ]


def test_a_long_line_goes_on_in_further_lines() -> None:
    names = named([f"station {k}" for k in range(12)], 10, "and {} more")
    page = (say("WITHOUT RAYS {:.10}: {}", "north-face-01", names).folded(2),)
    assert page_text(page).splitlines() == [
        "WITHOUT RAYS nort...-01: station 0, station 1, station 2, station 3, station 4,",
        "  station 5, station 6, station 7, station 8, station 9, and 2 more",
    ]
    assert "station 11" in page_text(page, everything=True)
    words = say("{}: {}", "name", "word " * 20).folded()
    assert [len(line) for line in page_text((words,)).splitlines()] == [80, 24]
    assert page_text((say("").folded(),)) == ""
    page = (say("{}: in {}", " ".join(["word"] * 18), named(["101", "102"])).folded(4),)
    assert page_text(page).splitlines() == [("word " * 16).strip(), "    word word: in 101, 102"]


def test_rows_of_a_group_stand_under_its_line() -> None:
    columns = (*for_programs("case"), name("method", "method"), whole("n", "n", 4))
    rows = (("6\x1b", "a", 1), ("6\x1b", "b", 2), ("10", "a", 3))
    found = table("figures", columns, rows, group="case")
    lines = ["  method   n", "6\\x1b", "  a        1", "  b        2", "10", "  a        3"]
    assert table_lines(found) == lines
    assert found.records()[0] == {"case": "6\x1b", "method": "a", "n": 1}
    first = page_text((replace(found, most=2, more=""),))
    assert first.splitlines() == lines[:4]


def test_a_table_that_nobody_looks_at_is_not_made() -> None:
    asked: list[int] = []

    def rows() -> list[tuple[str, float]]:
        asked.append(1)
        return [("7", 0.5), ("8", 1.5)]

    later = table("points", (name("point"), number("v", "v", 1, 6)), rows)
    document = Document({"count": 2}, (say("TWO"),), (later,))
    assert json_text(document.answer) == '{\n "count": 2\n}'
    assert not asked
    assert later.records() == [{"point": "7", "v": 0.5}, {"point": "8", "v": 1.5}]
    assert csv_text(later).splitlines() == ["point,v", "7,0.5", "8,1.5"]
    assert len(asked) == 1
    wrong = Table("t", for_programs("a", "b"), lambda: ([1],))
    with pytest.raises(ValueError, match="table t"):
        len(wrong)


def test_what_marks_a_row_may_stand_in_several_columns() -> None:
    columns = (name("point"), *(Column(key, look=bool) for key in ("flagged", "rejected")))
    rows = [("1", False, None), ("2", True, False), ("3", False, True), ("4", None, False)]
    found = table("control", columns, rows)
    assert found.marked() == [1, 2]


def test_arrays_are_columns() -> None:
    values = np.array([1.5, np.nan, -0.004])
    columns = (whole("k", "K", 3), number("v", "v", 2, 6), Column("yes", "", None), Column("xy"))
    pairs = np.array([[1.0, 2.0], [np.nan, 4.0], [5.0, 6.0]])
    by_arrays = Table("t", columns, (np.arange(3), values, values > 1, pairs))
    assert table_lines(by_arrays) == ["  K     v", "  0  1.50", "  1     -", "  2  0.00"]
    assert by_arrays.records()[1] == {"k": 1, "v": None, "yes": False, "xy": [None, 4.0]}
    assert json.loads(json_text({"t": by_arrays})) == {"t": by_arrays.records()}


@given(
    st.lists(st.floats(allow_nan=True, allow_infinity=False) | st.none(), max_size=8),
    st.integers(0, 5),
    st.integers(6, 14),
)
def test_cells_are_those_of_single_numbers(values, decimals: int, width: int) -> None:
    column = Table("t", (number("v", "", decimals, width),), (values,))
    alone = [None if v is None or math.isnan(v) else v for v in values]
    assert table_lines(column)[1:] == [cell(v, decimals, width) for v in alone]


finite = st.floats(allow_nan=False, allow_infinity=False)
short = st.text(max_size=4)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | finite | short,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(short, inner, max_size=3),
    max_leaves=12,
)


@given(st.dictionaries(short, json_values, max_size=4))
def test_json_is_laid_out_as_the_library_does(answer) -> None:
    assert json_text(answer) == json.dumps(answer, indent=1, allow_nan=False)


vectors = st.none() | st.lists(finite, max_size=3)


@given(st.lists(st.tuples(short, st.integers(), vectors), max_size=5))
def test_a_table_in_json_is_a_list_of_its_rows(rows) -> None:
    keys = ("name", "k%", "v")
    answer = {"t": table("t", for_programs(*keys), rows)}
    answer["inner"] = {"again": answer["t"]}
    plain = Document(answer, ()).to_dict()
    assert json_text(answer) == json.dumps(plain, indent=1, allow_nan=False)
    assert plain["inner"]["again"] == [dict(zip(keys, row, strict=True)) for row in rows]


def test_nothing_infinite_stands_in_json() -> None:
    with pytest.raises(ValueError, match="infinity"):
        json_text({"v": math.inf})
    with pytest.raises(ValueError, match="infinity"):
        json_text({"v": np.array([1.0, -np.inf])})


def test_a_long_table_shows_what_needs_a_look() -> None:
    short, long = made(MOST_ROWS), made(MOST_ROWS + 1, flagged=(3, 40))
    assert len(page_text((short,)).splitlines()) == MOST_ROWS + 1
    lines = page_text((long,)).splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["p3", "p40"]
    assert lines[3:] == [
        f"  ... {MOST_ROWS - 1} of {MOST_ROWS + 1} rows are not shown; --all prints them"
    ]
    assert len(page_text((long,), everything=True).splitlines()) == MOST_ROWS + 2
    nothing = page_text((made(500),)).splitlines()
    assert nothing[1:] == ["  ... 500 rows are not shown; --all prints them"]
    many = page_text((made(500, flagged=tuple(range(300))),)).splitlines()
    assert len(many) == MOST_ROWS + 2


def test_lines_hold_values_and_lists() -> None:
    points = named([f"p{k}" for k in range(5)], 2)
    other = say("{} {}", "p", "x")
    page = (
        say("BLOCK {}", "a\x1bb").of("heading"),
        BLANK,
        say("sigma0 {:.2f|um|none}, {rank} of {}: {}", 1.234, 5, points, rank=3),
        say("sigma0 {:.2f|um|none}, w {:.1f}", None, None) + say(" (or {})", other),
        Listed(tuple(say("  {}", k) for k in range(4)), 3),
        Figure("bars", (1, 3), lambda sizes: ["#" * size for size in sizes]),
    )
    assert page_text(page).splitlines() == [
        "BLOCK a\\x1bb", "", "sigma0 1.23 um, 3 of 5: p0, p1 and 3 more",
        "sigma0 none, w - (or p x)", "  0", "  1", "  2", "    and 1 more", "#", "###",
    ]  # fmt: skip
    whole_page = page_text(page, everything=True)
    assert "p0, p1, p2, p3, p4" in whole_page
    assert "more" not in whole_page


def test_lines_are_made_where_they_are_shown() -> None:
    asked: list[int] = []

    def lines(some: Sequence[int]) -> list[Line]:
        asked.extend(some)
        return [say("line {}", k) for k in some]

    page = (Listed(Later(1000, lines), 2),)
    assert page_text(page).split("\n") == ["line 0", "line 1", "    and 998 more"]
    assert asked == [0, 1]
    assert page_text(page, everything=True).count("line") == 1000
    assert Later(1000, lines)[-1] == say("line {}", 999)
    assert [*Later(3, lines)] == [say("line {}", k) for k in range(3)]
    with pytest.raises(IndexError):
        Later(3, lines)[3]


def test_columns_and_values_belong_together() -> None:
    with pytest.raises(ValueError, match="table t"):
        Table("t", for_programs("a", "b"), ([1], [1, 2]))
    with pytest.raises(ValueError, match="table t"):
        Table("t", for_programs("a", "b"), ([1],))


def document() -> Document:
    return Document({"count": 2, "points": made(2)}, (say("TWO"), made(2)), (made(2),))


def test_output_goes_where_it_is_asked_to(tmp_path: Path) -> None:
    stream = io.StringIO()
    folder, file = tmp_path / "new" / "tables", tmp_path / "main.csv"
    output = Output(csv=file, to=folder, stream=stream)
    for _ in range(2):  # an earlier output may be replaced
        output.check()
        output.show(document())
    assert stream.getvalue().count("TWO") == 2
    assert file.read_bytes() == (folder / "points.csv").read_bytes() == csv_text(made(2)).encode()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary == {"count": 2, "tables": ["points"]}
    assert sorted(path.name for path in folder.iterdir()) == ["points.csv", "summary.json"]
    printed = io.StringIO()
    Output(as_json=True, stream=printed).show(document())
    assert json.loads(printed.getvalue()) == document().to_dict()


def test_no_folder_with_anything_else_is_written_into(tmp_path: Path) -> None:
    (tmp_path / "image_points.csv").write_text("measured\n")
    with pytest.raises(InputError, match="neither new nor empty"):
        Output(to=tmp_path).check()
    with pytest.raises(InputError, match="it is no folder"):
        Output(to=tmp_path / "image_points.csv").check()
    with pytest.raises(InputError, match="cannot be written"):
        Output(to=tmp_path / "image_points.csv" / "inner").check()
    (tmp_path / "empty").mkdir()
    Output(to=tmp_path / "empty").check()


def test_tables_of_an_earlier_output_do_not_stay_beside_those_of_another(tmp_path: Path) -> None:
    # `off.csv` of one block stood beside the results of the next
    Output(to=tmp_path).write(document())
    (tmp_path / "notes.csv").write_text("mine")
    other = Document({"count": 1}, (), (replace(made(2), key="photos"),))
    Output(to=tmp_path).write(other)
    names = ["notes.csv", "photos.csv", "summary.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    # a summary says nothing of files elsewhere
    (tmp_path / "inner").mkdir()
    told = {"tables": ["../notes", "photos", 7, None]}
    (tmp_path / "inner" / "summary.json").write_text(json.dumps(told))
    Output(to=tmp_path / "inner").write(document())
    assert (tmp_path / "notes.csv").read_text() == "mine"


def test_what_cannot_be_written_whole_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # on a full disk the tables stayed, and the same command refused its own folder
    folder = tmp_path / "tables"
    tables = (made(2), replace(made(2), key="photos"))

    def full(table: Table) -> str:
        if table.key == "photos":
            raise InputError("no space left on device")
        return csv_text(table)

    monkeypatch.setattr(output_module, "csv_text", full)
    with pytest.raises(InputError, match="no space"):
        Output(to=folder).write(Document({}, (), tables))
    assert not folder.exists()
