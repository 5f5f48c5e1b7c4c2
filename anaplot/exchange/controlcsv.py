"""control.csv: ground control and check points."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, cast

from anaplot.photogrammetry.block import ControlPoint
from anaplot.textfiles.csvtable import CsvTable
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import hint, quoted

__all__ = ["format_control", "parse_control"]

_USES = ("control", "check", "off")


def parse_control(path: Path) -> tuple[ControlPoint, ...]:
    """Read a control.csv.

    Parameters
    ----------
    path
        The file, with columns point,X,Y,Z and perhaps sX,sY,sZ,use; metres.

    Returns
    -------
    tuple[ControlPoint, ...]
        The rows in file order. A blank coordinate is not known (None), a blank standard
        deviation the block's default (None), 0 is free of error.

    Raises
    ------
    InputError
        The first row that is wrong, with file, line and column.
    """
    points: list[ControlPoint] = []
    lines: dict[str, int] = {}
    with CsvTable(path, ("point", "X", "Y", "Z"), ("sX", "sY", "sZ", "use")) as table:
        column = table.columns

        def number(line: int, row: list[str], name: str) -> float | None:
            if name not in column or not row[column[name]]:
                return None
            return table.number(line, name, row[column[name]])

        def sigma(line: int, row: list[str], name: str) -> float | None:
            value = number(line, row, name)
            if value is None:
                return None
            if value < 0.0:
                raise table.fail(line, f"{name} = {value:g} must not be negative")
            return abs(value)

        for line, row in table:
            point = row[column["point"]]
            if not point:
                raise table.fail(line, "point is empty")
            fault = name_fault(point)
            if fault is not None:
                raise table.fail(line, f"point: the name {quoted(point)} {fault}")
            first = lines.setdefault(point, line)
            if first != line:
                raise table.fail(line, f"point {quoted(point)} twice (lines {first} and {line})")
            use = row[column["use"]] if "use" in column else "control"
            if use not in _USES:
                nearest = hint(use, _USES, listing=False)
                raise table.fail(
                    line, f"use = {quoted(use)} must be control, check or off{nearest}"
                )
            points.append(
                ControlPoint(
                    point=point,
                    xyz=(number(line, row, "X"), number(line, row, "Y"), number(line, row, "Z")),
                    sigma=(sigma(line, row, "sX"), sigma(line, row, "sY"), sigma(line, row, "sZ")),
                    use=cast(Literal["control", "check", "off"], use),
                )
            )
    return tuple(points)


def format_control(control: Iterable[ControlPoint]) -> str:
    """Return control points as the text of a control.csv, shortest digits that read back."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(("point", "X", "Y", "Z", "sX", "sY", "sZ", "use"))
    for point in control:
        numbers = ("" if value is None else repr(value) for value in (*point.xyz, *point.sigma))
        writer.writerow((point.point, *numbers, point.use))
    return file.getvalue()
