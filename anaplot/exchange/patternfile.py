"""A point pattern as a file: CSV with label,x,y and perhaps tie, or TOML.

format = 1
[[point]]
label = "1"
x = 0.0        # mm in the left photo
y = 100.0
tie = true     # shared with the preceding model; false when left out
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from anaplot.errors import InputError
from anaplot.photogrammetry.block import PatternPoint
from anaplot.textfiles.csvtable import csv_text, read_csv
from anaplot.textfiles.kinds import FLAG, NAME, Fields, Number
from anaplot.textfiles.tomltable import read_toml
from anaplot.textfiles.tomltext import toml_number, toml_text
from anaplot.textfiles.wording import place, quoted

__all__ = [
    "MAX_PATTERN_POINTS",
    "PATTERN_FORMAT",
    "PatternFile",
    "format_pattern",
    "is_pattern_file",
    "read_pattern",
]

MAX_PATTERN_POINTS = 200
PATTERN_FORMAT = 1

_SUFFIXES = (".csv", ".toml")
_MAX_BYTES = 1_000_000
_IN_PHOTO = Number(-1000.0, 1000.0)  # mm; no photo is larger
_POINT: Fields = {"label": NAME, "x": _IN_PHOTO, "y": _IN_PHOTO}


@dataclass(frozen=True, slots=True)
class PatternFile:
    """A pattern as its file has it.

    Attributes
    ----------
    path
        The file.
    points
        In file order.
    """

    path: Path
    points: tuple[PatternPoint, ...]
    _line: Callable[[int], int | None] = field(repr=False, compare=False)

    @property
    def places(self) -> tuple[tuple[str, float, float], ...]:
        """(label, x, y) of every point [mm in the left photo]."""
        return tuple((point.label, point.x, point.y) for point in self.points)

    @property
    def ties(self) -> tuple[str, ...]:
        """Labels of the ties."""
        return tuple(point.label for point in self.points if point.tie)

    def fault(self, label: str | None, message: str) -> InputError:
        """Return the error about a point, or about the file."""
        row = next((k for k, point in enumerate(self.points) if point.label == label), None)
        line = None if row is None else self._line(row)
        return InputError(f"{place(self.path, line)}: {message}")


def is_pattern_file(pattern: str | os.PathLike[str]) -> bool:
    """Return whether what is said to be a pattern is a file, and no name."""
    return Path(pattern).suffix.lower() in _SUFFIXES


def read_pattern(path: Path) -> PatternFile:
    """Read the points of a pattern.

    Parameters
    ----------
    path
        The file. CSV: columns label,x,y [mm in the left photo], tie (yes, no or blank) if any.
        With the suffix .toml: tables [[point]] with the same keys, tie true or false.

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
    return PatternFile(
        path,
        tuple(PatternPoint(p["label"], p["x"], p["y"], bool(p.get("tie"))) for p in rows),
        line,
    )


def format_pattern(points: Iterable[PatternPoint], suffix: str) -> str:
    """Return points as the text of a pattern file; numbers are read back exactly.

    Parameters
    ----------
    points
        The points.
    suffix
        Of the file: ".csv" or ".toml".
    """
    if suffix.lower() != ".toml":
        rows = ((p.label, p.x, p.y, "yes" if p.tie else "no") for p in points)
        return csv_text((*_POINT, "tie"), rows)
    lines = [f"format = {PATTERN_FORMAT}"]
    for point in points:
        lines += [
            "",
            "[[point]]",
            f"label = {toml_text(point.label)}",
            f"x = {toml_number(point.x)}",
            f"y = {toml_number(point.y)}",
            f"tie = {'true' if point.tie else 'false'}",
        ]
    return "\n".join(lines) + "\n"
