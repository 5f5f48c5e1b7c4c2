"""image_points.csv written again over a person's file."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange import imagepointscsv
from anaplot.exchange.blockfolder import (
    PointsFound,
    image_points_digest,
    read_block,
    write_image_points,
)
from anaplot.exchange.imagepointscsv import reformat_image_points
from anaplot.exchange.keptrows import Columns, rewritten
from anaplot.exchange.rejectedrows import rejecting_reason
from anaplot.photogrammetry.block import ImagePoint
from anaplot.photogrammetry.imagepoint import unchanged_ends
from anaplot.textfiles.csvlines import CsvLine, CsvLines, cell_value, cells_of, with_value

TOML = """format = 1
name = "b"
[[camera]]
id = "k"
c = 100.0
"""
FILE = (
    "\ufeffpoint,photo,x,y,sigma_um\r\n"
    "p,1,1.50,-2.0,\r\n"
    "\r\n"
    '"q, r",1, 3.0 ,4e0,5\n'
    "p,2,0.25,00.5,\r\n"
    "s,2,7,8,"
)


def folder_with(tmp_path: Path, text: str) -> Path:
    (tmp_path / "block.toml").write_text(TOML)
    (tmp_path / "image_points.csv").write_bytes(text.encode())
    return tmp_path


def test_only_what_changes_is_written(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILE)
    block = read_block(folder)
    write_image_points(folder, block.image_points, block)
    assert (folder / "image_points.csv").read_bytes() == FILE.encode()
    first, second, third, last = block.image_points
    rows = [
        second,
        ImagePoint("1", "new", 1.0, 2.0, use="off", reason="so, and so"),
        first,
        ImagePoint("2", "p", 0.25, 9.0),
        last,
    ]
    assert third.y == 0.5
    write_image_points(folder, rows, block)
    assert (folder / "image_points.csv").read_bytes().decode() == (
        "\ufeffpoint,photo,x,y,sigma_um,reason,use\r\n"
        '"q, r",1, 3.0 ,4e0,5,,\n'
        'new,1,1.0,2.0,,"so, and so",off\r\n'
        "p,1,1.50,-2.0,,,\r\n"
        "p,2,0.25,9.0,,,\r\n"
        "s,2,7,8,,,"
    ).replace('"q, r",1', '\r\n"q, r",1')
    assert read_block(folder).image_points == tuple(rows)
    write_image_points(folder, block.image_points, block)
    # rows that were gone are written anew
    assert (folder / "image_points.csv").read_bytes() == FILE.replace("00.5", "0.5").encode()


def test_a_file_that_cannot_be_read_is_not_written_over(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILE)
    block = read_block(folder)
    (folder / "image_points.csv").write_text("photo,point,x,y\n1,p,one,2\n")
    with pytest.raises(InputError, match="line 2: x"):
        write_image_points(folder, block.image_points, block)
    assert (folder / "image_points.csv").read_text() == "photo,point,x,y\n1,p,one,2\n"


# of every row of the file: it stays, is another object that says the same, moves, or goes
DONE = st.lists(st.sampled_from(["same", "equal", "moved", "gone"]), min_size=4, max_size=4)
FRESH = st.lists(st.integers(0, 4), max_size=2)


@given(DONE, FRESH, st.sampled_from(["\n", "\r\n", "\r"]), st.booleans())
def test_rows_that_are_known_are_not_read_again_and_written_the_same(
    tmp_path_factory: pytest.TempPathFactory,
    done: list[str],
    fresh: list[int],
    end: str,
    ended: bool,
) -> None:
    text = FILE.replace("\r\n", end) + (end if ended else "")
    folder = folder_with(tmp_path_factory.mktemp("b"), text)
    block = read_block(folder)
    made: dict[str, Callable[[ImagePoint], list[ImagePoint]]] = {
        "same": lambda row: [row],
        "equal": lambda row: [replace(row)],
        "moved": lambda row: [replace(row, x=row.x + 1.0)],
        "gone": lambda row: [],
    }
    rows = [
        row for what, old in zip(done, block.image_points, strict=True) for row in made[what](old)
    ]
    for k, at in enumerate(fresh):
        rows.insert(min(at, len(rows)), ImagePoint("1", f"n{k}", 1.0, 2.0, use="x"))
    path = folder / "image_points.csv"
    raw = path.read_bytes()
    known = reformat_image_points(path, raw, rows, block, block.image_points)
    assert known == reformat_image_points(path, raw, rows, block)
    if rows:  # without any there is no photo
        path.write_bytes(known.encode())
        assert read_block(folder).image_points == tuple(rows)


def test_a_file_that_changed_meanwhile_is_read_again(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILE)
    block = read_block(folder)
    found = PointsFound(block.image_points, image_points_digest(folder))
    (folder / "image_points.csv").write_text("photo,point,y,x\n1,p,-2,1.50\n")
    write_image_points(folder, [block.image_points[0]], block, found)
    assert (folder / "image_points.csv").read_text() == "photo,point,y,x\n1,p,-2,1.50\n"


def test_a_row_that_stands_among_those_that_stay_is_refused(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILE)
    block = read_block(folder)
    found = PointsFound(block.image_points, image_points_digest(folder))
    again = replace(block.image_points[0], x=7.0)
    with pytest.raises(InputError, match="point 'p' of photo '1' cannot be written: stands twice"):
        write_image_points(folder, [*block.image_points, again], block, found)
    assert (folder / "image_points.csv").read_bytes() == FILE.encode()


def test_ends_that_do_not_change_are_those_that_say_the_same_in_the_file() -> None:
    old = [ImagePoint("1", str(k), 0.5, 1.5, measured=(2.0, 3.0)) for k in range(1300)]
    assert unchanged_ends(old, [replace(row) for row in old], measured=True) == (1300, 0)
    assert unchanged_ends(old, [replace(row, measured=None) for row in old]) == (1300, 0)
    new = [*old[:700], replace(old[700], measured=(2.0, 3.5)), *old[701:]]
    assert unchanged_ends(old, new, measured=True) == (700, 599)
    assert unchanged_ends(old, [*old, old[0]], measured=True) == (1300, 0)
    assert unchanged_ends(old, old[3:], measured=True) == (0, 1297)
    assert unchanged_ends(old, [], measured=True) == unchanged_ends([], old) == (0, 0)


CELLS = st.text(st.sampled_from('ab", \t'), max_size=5)
FIELDS = st.lists(st.tuples(CELLS, st.booleans(), st.sampled_from(["", " ", "  "])), min_size=2)


@given(FIELDS, CELLS)
def test_fields_are_cut_as_they_are_read(fields: list[tuple[str, bool, str]], value: str) -> None:
    said = [
        text.strip() if quoted else text.replace('"', "").replace(",", "").strip()
        for text, quoted, _ in fields
    ]
    line = ",".join(
        blank + ('"' + text.replace('"', '""') + '"' if quoted else text)
        for text, (_, quoted, blank) in zip(said, fields, strict=True)
    )
    cells = cells_of(line)
    assert ",".join(cells) == line
    assert list(map(cell_value, cells)) == said
    read = next(csv.reader([line], strict=True, skipinitialspace=True))
    assert [text.strip() for text in read] == said
    there = with_value(cells[0], value.strip())
    assert cell_value(there) == value.strip()
    assert cells_of(",".join((there, *cells[1:]))) == [there, *cells[1:]]


@given(
    st.text(st.sampled_from("a,\n\r \x0b\x0c\x1c\u2028"), max_size=30),
    st.sampled_from(["", "\ufeff"]),
)
def test_lines_make_the_same_text(text: str, mark: str) -> None:
    lines = CsvLines.of(f"{mark}photo,point{text}")
    assert lines.with_rows(lines.header.text, lines.rows) == f"{mark}photo,point{text}"
    texts = re.split(r"\r\n|\r|\n", text)[1:]
    said = [line for line in texts if line and not line.isspace()]
    assert [CsvLine.of(raw).text for raw in lines.rows] == said


BLANKS = st.text(" \t\u00a0\u3000", max_size=2)
SPACES = st.text(" ", max_size=2)
SAID = st.one_of(
    st.builds("{}{}{}".format, BLANKS, st.sampled_from(["", "ok", "so and so"]), BLANKS),
    st.builds('{}"{}{}{}"'.format, SPACES, BLANKS, st.sampled_from(["a, b", 'x ""y""']), BLANKS),
)


@pytest.mark.slow
@given(SAID, SAID, st.booleans())
def test_whatever_is_written_over_blanks_is_read_back_and_goes_back(
    tmp_path_factory: pytest.TempPathFactory, cell: str, other: str, last: bool
) -> None:
    row = "1,{name},1,2,{said}\n" if last else "1,{said},{name},1,2\n"
    header = "photo,point,x,y,reason\n" if last else "photo,reason,point,x,y\n"
    text = header + row.format(name="p", said=cell) + row.format(name="q", said=other)
    folder = folder_with(tmp_path_factory.mktemp("b"), text)
    block = read_block(folder)
    first, second = block.image_points
    off = replace(first, use="off", reason=rejecting_reason("search", "xy", first.reason))
    write_image_points(folder, [off, second], block)
    assert read_block(folder).image_points == (off, second)
    write_image_points(folder, block.image_points, block)
    assert (folder / "image_points.csv").read_bytes() == text.encode()


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("photo,point,x,y,reason,use", "1,p,{},2,,"),
        ("use,photo,point,x,y", ",1,p,{},2"),
        ("use,photo,point,x,y,reason", ",1,p,{},2,so"),
        ("reason,use,photo,point,x,y", ",,1,p,{},2"),
    ],
)
def test_blank_columns_of_a_persons_own_stay(tmp_path: Path, header: str, row: str) -> None:
    folder = folder_with(tmp_path, f"{header}\n{row.format(1)}\n")
    block = read_block(folder)
    write_image_points(folder, [replace(block.image_points[0], x=1.5)], block)
    assert (folder / "image_points.csv").read_text() == f"{header}\n{row.format(1.5)}\n"


def test_rows_and_lines_are_of_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "photo,point,x,y\n1,p,1,2\n1,q,3,4\n"
    folder = folder_with(tmp_path, text)
    block = read_block(folder)
    read = imagepointscsv.parse_image_points

    def meanwhile(path: Path, *of: object) -> object:
        path.write_text("photo,point,x,y\n1,q,3,4\n1,p,1,2\n")
        return read(path, *of)  # type: ignore[arg-type]

    monkeypatch.setattr(imagepointscsv, "parse_image_points", meanwhile)
    rows = (replace(block.image_points[0], use="off"), block.image_points[1])
    write_image_points(folder, rows, block)
    monkeypatch.undo()
    assert read_block(folder).image_points == rows


NAMES = ("photo", "point", "x", "y", "sigma_um", "model", "use", "reason")
ORDERS = (
    NAMES,
    NAMES[::-1],
    ("point", "reason", "y", "use", "x", "model", "photo", "sigma_um"),
    (*NAMES[:6], "reason", "use"),
)
USES = st.sampled_from(["xy", "xy", "x", "off"])
REASONS = st.sampled_from(["", "", "so", "so, too"])
ROWS = st.lists(st.tuples(USES, REASONS), min_size=1, max_size=3)


@given(
    ROWS,
    ROWS,
    st.sampled_from(ORDERS),
    st.sets(st.sampled_from(["use", "reason", "model", "sigma_um"])),
    st.booleans(),
)
def test_back_and_forth_is_the_same_file(
    before: list[tuple[str, str]],
    after: list[tuple[str, str]],
    order: tuple[str, ...],
    missing: set[str],
    spelled: bool,
) -> None:
    count = min(len(before), len(after)) + 1
    # how rows that count whole are spelled is seen from those that are not touched
    before.insert(count - 1, ("xy", ""))
    after.insert(count - 1, ("xy", ""))
    whole = all(use == "xy" for use, _ in before[:count])
    blank = not any(reason for _, reason in before[:count])
    names = [
        name
        for name in order
        if name not in missing or (name == "use" and not whole) or (name == "reason" and not blank)
    ]
    # these it takes for columns that it has added itself
    if names[-2:] == ["reason", "use"] or names[0] in ("use", "reason"):
        others = [name for name in names if name not in ("use", "reason")]
        names = [others[0], "use", "reason", *others[1:]]

    def rows(said: list[tuple[str, str]]) -> Columns:
        each = [("1", str(k), 0.5, 1.5, None, None, u, r or None) for k, (u, r) in enumerate(said)]
        return dict(zip(NAMES, map(list, zip(*each[:count], strict=True)), strict=True))

    old, new = rows(before), rows(after)
    said = []
    for k, (use, reason) in enumerate(before[:count]):
        word = "" if use == "xy" and not spelled else use
        why = f'"{reason}"' if reason else ""
        said.append(dict(zip(NAMES, ("1", str(k), "0.5", "1.5", "", "", word, why), strict=True)))
    text = "\r\n".join([",".join(names), *(",".join(row[n] for n in names) for row in said)])
    there = rewritten(text, old, new)
    lines = CsvLines.of(there)
    header = cells_of(lines.header.text)
    for raw, wanted in zip(lines.rows, after, strict=False):
        read = dict(zip(header, map(cell_value, cells_of(CsvLine.of(raw).text)), strict=True))
        assert (read.get("use") or "xy", read.get("reason", "")) == wanted
    assert len(lines.rows) == count
    assert rewritten(there, new, old).replace('"', "") == text.replace('"', "")
