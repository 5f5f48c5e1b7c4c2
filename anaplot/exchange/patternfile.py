"""A point pattern as a file: CSV with label,x,y and perhaps tie, or TOML.

format = 1
[[point]]
label = "1"
x = 0.0        # mm in the left photo
y = 100.0
tie = true     # shared with the preceding model; false when left out
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.textfiles.csvtable import CsvTable
from anaplot.textfiles.inputfile import read_text
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.tomlfile import TomlFile
from anaplot.textfiles.wording import describe_type, quoted

__all__ = ["MAX_PATTERN_POINTS", "PATTERN_FORMAT", "read_pattern"]

MAX_PATTERN_POINTS = 200
PATTERN_FORMAT = 1

_MAX_BYTES = 1_000_000
_FARTHEST = 1000.0  # mm; no photo is larger

Points = tuple[tuple[str, float, float], ...]


class _Row(NamedTuple):
    """A point as a file of either kind states it.

    `line` tells where its label stands (looked for in a TOML file, hence only when asked), `fail`
    makes the error about one of its keys, or about all of it.
    """

    label: str
    x: float
    y: float
    tie: bool
    line: Callable[[], int | None]
    fail: Callable[[str | None, str], InputError]


def read_pattern(path: Path) -> tuple[Points, tuple[str, ...]]:
    """Read the points of a pattern.

    Parameters
    ----------
    path
        The file. CSV: columns label,x,y [mm in the left photo], tie (yes, no or blank) if any.
        With the suffix .toml: tables [[point]] with the same keys, tie true or false.

    Returns
    -------
    tuple
        (label, x, y) of every point in file order, and the labels of the ties.

    Raises
    ------
    InputError
        The first thing that is wrong, with file and line.
    """
    rows = _toml_rows(path) if path.suffix.lower() == ".toml" else _csv_rows(path)
    found: dict[str, _Row] = {}
    with closing(rows):
        for row in rows:
            label = row.label
            if label in found:
                line = found[label].line()
                raise row.fail("label", f"label {quoted(label)} stands in line {line} already")
            if len(found) == MAX_PATTERN_POINTS:
                raise row.fail(None, f"more than {MAX_PATTERN_POINTS} points")
            for axis, value in (("x", row.x), ("y", row.y)):
                if abs(value) > _FARTHEST:
                    raise row.fail(axis, f"{axis} = {value:g} mm lies outside any photo")
            found[label] = row
    points = tuple((row.label, row.x, row.y) for row in found.values())
    return points, tuple(label for label, row in found.items() if row.tie)


def _toml_rows(path: Path) -> Generator[_Row, None, None]:
    root = TomlFile(path, read_text(path, _MAX_BYTES)).root
    root.version(PATTERN_FORMAT)
    root.only("format", "point")
    table = None
    for table in root.tables("point"):
        table.only("label", "x", "y", "tie")
        label, x, y = table.name("label"), table.number("x"), table.number("y")
        tie = table.raw("tie") if "tie" in table else False
        if not isinstance(tie, bool):
            raise table.fail("tie", f"tie must be true or false, not {describe_type(tie)}")
        yield _Row(label, x, y, tie, partial(table.line, "label"), table.fail)
    if table is None:
        raise root.fail(None, "no points: a pattern needs [[point]]")


def _csv_rows(path: Path) -> Generator[_Row, None, None]:
    with CsvTable(path, ("label", "x", "y"), ("tie",)) as table:
        column = table.columns
        line = None
        for line, row in table:
            label = row[column["label"]]
            fault = name_fault(label)
            if fault is not None:
                raise table.fail(line, f"label {quoted(label)} {fault}")
            x, y = (table.number(line, axis, row[column[axis]]) for axis in ("x", "y"))
            tie = row[column["tie"]] if "tie" in column else ""
            if tie not in ("yes", "no", ""):
                raise table.fail(line, f"tie = {quoted(tie)} must be yes, no or blank")
            here, fail = partial(_csv_line, line), partial(_csv_fault, table, line)
            yield _Row(label, x, y, tie == "yes", here, fail)
        if line is None:
            raise table.fail(None, "no points")


def _csv_line(line: int) -> int:
    return line


def _csv_fault(table: CsvTable, line: int, _: str | None, message: str) -> InputError:
    return table.fail(line, message)
