"""Control and check points in a file of their own, beside the image points of another program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from anaplot.errors import InputError
from anaplot.exchange.controlcsv import GroundPoints
from anaplot.exchange.controllist import read_control_list
from anaplot.exchange.formats.door import Note
from anaplot.exchange.formats.namedcolumns import commas_told, open_columns
from anaplot.exchange.formats.sourcelines import source_lines, value_of
from anaplot.photogrammetry.block import ControlPoint, ControlUse
from anaplot.textfiles.kinds import METRES, SIGMA_OR_FREE, WrongValueError
from anaplot.textfiles.wording import quoted

__all__ = ["read_ground"]

_BARE: Final = {
    4: ("point", "X", "Y", "Z"),
    5: ("point", "X", "Y", "Z", "sigma"),
    7: ("point", "X", "Y", "Z", "sX", "sY", "sZ"),
}
_COLUMNS: Final[Mapping[str, tuple[str, ...]]] = dict.fromkeys((*_BARE[7], "sigma"), ())


def read_ground(files: Mapping[str, Path]) -> tuple[GroundPoints, tuple[Note, ...]]:
    """Return the points of the files `control` and `check`, each where it is given.

    Parameters
    ----------
    files
        Paths by what is in them. With a header a file is what `read_control_list` reads; without
        one: point X Y Z, and after them sigma or sX sY sZ.

    Raises
    ------
    InputError
        A file cannot be read, or names a point that the other one names.
    """
    control: list[ControlPoint] = []
    notes: list[Note] = []
    priors = GroundPoints().priors
    uses: tuple[tuple[str, ControlUse], ...] = (("control", "control"), ("check", "check"))
    for key, use in uses:
        path = files.get(key)
        if path is None:
            continue
        ground, said = _read(path)
        notes += said
        known = {point.point for point in control}
        for point in ground.control:
            if point.point in known:
                raise InputError(f"--with {key}: point {quoted(point.point)} is control already")
            stated = point.use if use == "control" or point.use == "off" else use
            control.append(replace(point, use=stated))
        priors += ground.priors
    return GroundPoints(tuple(control), priors), tuple(notes)


def _read(path: Path) -> tuple[GroundPoints, tuple[Note, ...]]:
    if not _is_bare(path):
        ground = read_control_list(path)
        return ground, commas_told(ground.commas)
    table = open_columns(path, _COLUMNS, ("point", "X", "Y"), _BARE, None)
    points: dict[str, ControlPoint] = {}
    for line, fields in table.rows:
        row = dict(zip(table.titles, fields, strict=True))
        name = line.name_of(row.pop("point"), "point")
        if name in points:
            raise line.fail(f"point {quoted(name)} twice")
        value = {axis: table.number(line, text, axis) for axis, text in row.items() if text}
        if any(number < 0.0 for axis, number in value.items() if axis.startswith("s")):
            raise line.fail("a standard deviation must not be negative")
        for axis, number in value.items():
            try:
                (SIGMA_OR_FREE if axis.startswith("s") else METRES).of(number)
            except WrongValueError as error:
                raise line.fail(f"{axis} {error}") from None
        every = value.get("sigma")
        points[name] = ControlPoint(
            name,
            (value.get("X"), value.get("Y"), value.get("Z")),
            (value.get("sX", every), value.get("sY", every), value.get("sZ", every)),
        )
    return GroundPoints(tuple(points.values())), table.notes()


def _is_bare(path: Path) -> bool:
    """Whether a list's first row has numbers, and so is no header."""
    for line in source_lines(path):
        text = line.text[:10_000]
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        for mark in ",;":
            text = text.replace(mark, " ")
        return any(value_of(word) is not None for word in text.split()[1:])
    return False
