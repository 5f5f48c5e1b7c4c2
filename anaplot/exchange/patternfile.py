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

from anaplot.errors import InputError
from anaplot.textfiles.csvtable import read_csv
from anaplot.textfiles.kinds import FLAG, NAME, Fields, Number
from anaplot.textfiles.tomltable import read_toml
from anaplot.textfiles.wording import quoted

__all__ = ["MAX_PATTERN_POINTS", "PATTERN_FORMAT", "read_pattern"]

MAX_PATTERN_POINTS = 200
PATTERN_FORMAT = 1

_MAX_BYTES = 1_000_000
_IN_PHOTO = Number(-1000.0, 1000.0)  # mm; no photo is larger
_POINT: Fields = {"label": NAME, "x": _IN_PHOTO, "y": _IN_PHOTO}

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
    if path.suffix.lower() == ".toml":
        root = read_toml(path, _MAX_BYTES)
        root.version(PATTERN_FORMAT)
        root.take({}, also=("format", "point"))
        tables = list(root.tables("point"))
        rows = [table.take(_POINT, {"tie": FLAG}) for table in tables]

        def line(row: int) -> int | None:
            return tables[row].line("label")

        def fail(row: int | None, message: str) -> InputError:
            return root.fail(message) if row is None else tables[row].fail(message, "label")
    else:
        columns = read_csv(path, _POINT, {"tie": FLAG})
        rows = [
            {"label": label, "x": x, "y": y, "tie": tie}
            for label, x, y, tie in zip(*(columns[name] for name in (*_POINT, "tie")), strict=True)
        ]
        line = columns.line

        def fail(row: int | None, message: str) -> InputError:
            return columns.fail(row, "label" if row is not None else None, message)

    if not rows:
        raise fail(None, "no points")
    if len(rows) > MAX_PATTERN_POINTS:
        raise fail(MAX_PATTERN_POINTS, f"more than {MAX_PATTERN_POINTS} points")
    first: dict[str, int] = {}
    for row, point in enumerate(rows):
        other = first.setdefault(point["label"], row)
        if other != row:
            label = quoted(point["label"])
            raise fail(row, f"label {label} stands in line {line(other)} already")
    points = tuple((point["label"], point["x"], point["y"]) for point in rows)
    return points, tuple(point["label"] for point in rows if point.get("tie"))
