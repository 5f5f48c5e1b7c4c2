"""A point pattern as a file: CSV with label,x,y and perhaps tie, or TOML.

format = 1
[[point]]
label = "1"
x = 0.0        # mm in the left photo
y = 100.0
tie = true     # shared with the preceding model; false when left out
"""

from __future__ import annotations

from pathlib import Path

from anaplot.exchange.csvtable import CsvTable
from anaplot.exchange.inputfile import read_text
from anaplot.exchange.names import name_fault
from anaplot.exchange.tomlfile import TomlFile
from anaplot.exchange.wording import describe_type, quoted

__all__ = ["MAX_PATTERN_POINTS", "PATTERN_FORMAT", "read_pattern"]

MAX_PATTERN_POINTS = 200
PATTERN_FORMAT = 1

_MAX_BYTES = 1_000_000
_FARTHEST = 1000.0  # mm; no photo is larger

Points = tuple[tuple[str, float, float], ...]


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
    return _from_toml(path) if path.suffix.lower() == ".toml" else _from_csv(path)


def _from_toml(path: Path) -> tuple[Points, tuple[str, ...]]:
    root = TomlFile(path, read_text(path, _MAX_BYTES)).root
    root.version(PATTERN_FORMAT)
    root.only("format", "point")
    points: dict[str, tuple[str, float, float]] = {}
    lines: dict[str, int | None] = {}
    ties: list[str] = []
    for table in root.tables("point"):
        table.only("label", "x", "y", "tie")
        label = table.name("label")
        if label in points:
            raise table.fail(
                "label", f"label {quoted(label)} stands in line {lines[label]} already"
            )
        if len(points) == MAX_PATTERN_POINTS:
            raise table.fail(None, f"more than {MAX_PATTERN_POINTS} points")
        x, y = table.number("x"), table.number("y")
        for axis, value in (("x", x), ("y", y)):
            if abs(value) > _FARTHEST:
                raise table.fail(axis, f"{axis} = {value:g} mm lies outside any photo")
        points[label], lines[label] = (label, x, y), table.line("label")
        tie = table.raw("tie") if "tie" in table else False
        if not isinstance(tie, bool):
            raise table.fail("tie", f"tie must be true or false, not {describe_type(tie)}")
        if tie:
            ties.append(label)
    if not points:
        raise root.fail(None, "no points: a pattern needs [[point]]")
    return tuple(points.values()), tuple(ties)


def _from_csv(path: Path) -> tuple[Points, tuple[str, ...]]:
    points: list[tuple[str, float, float]] = []
    ties: list[str] = []
    lines: dict[str, int] = {}
    with CsvTable(path, ("label", "x", "y"), ("tie",)) as table:
        column = table.columns
        for line, row in table:
            label = row[column["label"]]
            fault = name_fault(label)
            if fault is not None:
                raise table.fail(line, f"label {quoted(label)} {fault}")
            if label in lines:
                raise table.fail(
                    line, f"label {quoted(label)} stands in line {lines[label]} already"
                )
            if len(points) == MAX_PATTERN_POINTS:
                raise table.fail(line, f"more than {MAX_PATTERN_POINTS} points")
            lines[label] = line
            x, y = (table.number(line, axis, row[column[axis]]) for axis in ("x", "y"))
            for axis, value in (("x", x), ("y", y)):
                if abs(value) > _FARTHEST:
                    raise table.fail(line, f"{axis} = {value:g} mm lies outside any photo")
            points.append((label, x, y))
            tie = row[column["tie"]] if "tie" in column else ""
            if tie not in ("yes", "no", ""):
                raise table.fail(line, f"tie = {quoted(tie)} must be yes, no or blank")
            if tie == "yes":
                ties.append(label)
        if not points:
            raise table.fail(None, "no points")
    return tuple(points), tuple(ties)
