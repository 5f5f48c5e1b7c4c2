"""Whole columns at once: the same as row by row, whatever stands in them."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange.imagepointscsv import format_image_points
from anaplot.photogrammetry.block import ImagePoint, image_points
from anaplot.textfiles import csvtable
from anaplot.textfiles.csvtable import csv_text, read_csv
from anaplot.textfiles.kinds import NUMBER, SIGMA, Text, WrongValueError

FIELDS = st.one_of(
    st.none(),
    st.integers(),
    st.floats(),
    st.text("ab ,\"\n\r'~\x0b\u00e4", max_size=4),
    st.sampled_from([np.float64(0.1), True]),
)


@given(st.integers(1, 4).flatmap(lambda n: st.lists(st.tuples(*[FIELDS] * n), max_size=9)))
def test_text_is_what_the_csv_writer_writes(rows: list[tuple[object, ...]]) -> None:
    header = [f"c{k}" for k in range(len(rows[0]))] if rows else ["only"]
    written = io.StringIO()
    writer = csv.writer(written, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([repr(float(v)) if isinstance(v, float) else v for v in row])
    assert csv_text(header, iter(rows)) == written.getvalue()


@pytest.mark.slow
def test_many_rows_are_one_after_another() -> None:
    rows = [(f"p{k}", k / 7.0) for k in range(40_000)]
    text = csv_text(("point", "x"), rows)
    read = list(csv.reader(io.StringIO(text)))
    assert [(name, float(x)) for name, x in read[1:]] == rows


KINDS = {"a": Text(), "b": NUMBER, "c": Text()}
PLAIN = st.text("xyz\u00e4-", max_size=3)
ROWS = st.lists(st.tuples(PLAIN, st.floats(-1e6, 1e6), PLAIN), min_size=1, max_size=6)


def read(folder: str, text: str) -> list[tuple[object, ...]]:
    path = Path(folder) / "table.csv"
    path.write_text(text, encoding="utf-8")
    table = read_csv(path, KINDS)
    return list(zip(*(table[name] for name in KINDS), strict=True))


@given(ROWS, st.data())
def test_blanks_and_quotes_around_fields_change_nothing(
    rows: list[tuple[str, float, str]], data: st.DataObject
) -> None:
    around = st.sampled_from(["{}", " {}", "{}\t", '"{}"', "\u2003{} "])
    plain = [[a, repr(b), c] for a, b, c in rows]
    dressed = [[data.draw(around).format(field) for field in row] for row in plain]
    with TemporaryDirectory() as folder:
        clean, other = (
            read(folder, "\n".join(["a,b,c", *map(",".join, fields)]))
            for fields in (plain, dressed)
        )
    assert clean == rows
    assert other == rows


LINES = st.lists(
    st.sampled_from(["p,1.5,q", "", "  ", '"r, s",-2,t', "\u00e4,3e0, u"]), max_size=12
)


@given(LINES, st.integers(1, 40), st.integers(1, 40), st.booleans(), st.integers(0, 12))
def test_where_a_file_is_cut_into_blocks_changes_nothing(
    lines: list[str], size: int, at_once: int, ended: bool, fault: int
) -> None:
    text = "\n".join(["a,b,c", *lines]) + "\n" * ended
    wrong = "\n".join(["a,b,c", *lines[:fault], "p,one,q", *lines[fault:]])
    line = min(fault, len(lines)) + 2
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        whole = read(folder, text)
        patch.setattr(csvtable, "_BLOCK", size)
        patch.setattr(csvtable, "_READ", at_once)
        assert read(folder, text) == whole
        with pytest.raises(InputError, match=rf"line {line}: b: must be a finite number"):
            read(folder, wrong)
        table = read_csv(Path(folder) / "table.csv", {**KINDS, "b": Text()})
        there = [k for k, one in enumerate(wrong.split("\n"), 1) if one.strip()]
        assert [table.line(row) for row in range(len(table))] == there[1:]


@pytest.mark.parametrize("width", [2, 4, 5])
def test_rows_of_another_length_are_found_among_others(width: int, tmp_path: Path) -> None:
    # lines of two and of four fields have as many together as two of three
    lines = ["p,1.0,q"] * 4
    lines[1], lines[2] = ",".join(["1"] * width), ",".join(["1"] * (6 - width or 1))
    with pytest.raises(InputError, match=rf"line 3: {width} fields, the header has 3"):
        read(str(tmp_path), "\n".join(["a,b,c", *lines]))


@given(st.lists(st.sampled_from(["1", "-2.5", "1e308", "-1e308", "nan", "inf", "1_0", "", "0"])))
def test_a_column_of_numbers_is_taken_as_each_of_them(texts: list[str]) -> None:
    for kind in (NUMBER, SIGMA):
        found = []
        for taken in (
            lambda column, kind=kind: list(kind.numbers(column)),
            lambda column, kind=kind: [kind.of_text(text) for text in column],
        ):
            try:
                found.append(taken(texts))
            except WrongValueError as error:
                found.append(str(error))
        assert found[0] == found[1]


def test_image_points_of_columns_are_those_made_one_by_one() -> None:
    columns = (
        *(["1", "2"], ["a", "b"], [1.0, math.pi], [2.0, -0.0]),
        *([None, 3.0], [None, "1/2"], ["xy", "off"], [None, "torn"], [None, (1.0, 2.0)]),
    )
    made = image_points(*columns)
    assert made == tuple(ImagePoint(*row) for row in zip(*columns, strict=True))
    assert made[1].measured == (1.0, 2.0)
    assert repr(made[0]) == repr(ImagePoint("1", "a", 1.0, 2.0))
    assert hash(made[0]) == hash(ImagePoint("1", "a", 1.0, 2.0))
    assert image_points(*[[]] * 9) == ()
    with pytest.raises(ValueError, match="different lengths"):
        image_points(*columns[:-1], [None])


GOOD = ImagePoint("1", "a", 1.0, 2.0)


@pytest.mark.parametrize(
    ("row", "why"),
    [
        (ImagePoint("1", "a", 3.0, 4.0), "stands twice"),
        (ImagePoint(" 1", "b", 3.0, 4.0), "its photo name"),
        (ImagePoint("1", "", 3.0, 4.0), "its point name is empty"),
        (ImagePoint("1", "b", math.nan, 4.0), "its coordinates are not finite"),
        (ImagePoint("1", "b", 3.0, 4.0, 0.0), "its sigma_um"),
        (ImagePoint("1", "b", 3.0, 4.0, model="2/3"), "does not contain its photo"),
        (ImagePoint("1", "b", 3.0, 4.0, use="z"), "its use"),  # type: ignore[arg-type]
        (ImagePoint("1", "b", 3.0, 4.0, reason=" x"), "its reason"),
    ],
)
def test_one_bad_row_among_many_is_named(row: ImagePoint, why: str) -> None:
    many = [ImagePoint("2", f"p{k}", 0.5, 0.25) for k in range(30)]
    with pytest.raises(InputError, match=why) as caught:
        format_image_points([GOOD, *many, row, *many[:1]])
    assert f"photo '{row.photo}'" in str(caught.value)
