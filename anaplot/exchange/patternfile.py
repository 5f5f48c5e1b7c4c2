"""A point pattern as a CSV file: label,x,y and perhaps tie."""

from __future__ import annotations

from pathlib import Path

from anaplot.exchange.csvtable import CsvTable
from anaplot.exchange.names import name_fault
from anaplot.exchange.wording import quoted

__all__ = ["MAX_PATTERN_POINTS", "read_pattern"]

MAX_PATTERN_POINTS = 200


def read_pattern(path: Path) -> tuple[tuple[tuple[str, float, float], ...], tuple[str, ...]]:
    """Read the points of a pattern.

    Parameters
    ----------
    path
        The file: columns label,x,y [mm in the left photo], tie (yes, no or blank) if any.

    Returns
    -------
    tuple
        (label, x, y) of every point in file order, and the labels of the ties.

    Raises
    ------
    InputError
        The first thing that is wrong, with file and line.
    """
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
                if abs(value) > 1000.0:
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
