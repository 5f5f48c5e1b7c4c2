"""A list of control points as others write it: named columns in any order and any usual header."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, cast

from anaplot.errors import InputError
from anaplot.exchange.controlcsv import USES, GroundPoints, prior_fault
from anaplot.photogrammetry.block import ControlPoint, ControlUse, PointPrior
from anaplot.textfiles.decimalcomma import with_point
from anaplot.textfiles.inputfile import read_text
from anaplot.textfiles.kinds import METRES, NAME, SIGMA_OR_FREE, Blank, Kind, Word, WrongValueError
from anaplot.textfiles.wording import place, quoted, reason

__all__ = ["read_control_list"]

_MAX_BYTES = 64_000_000
_SPREADS: Final = ("s", "sigma", "sd", "std", "stddev", "accuracy")
_HEADERS: Final = {
    "point": (
        *("point", "name", "id", "nr", "no", "number", "pt", "ptno", "ptid", "ptname"),
        *("pointid", "pointno", "pointnr", "pointnumber", "pointname", "station", "gcp", "label"),
        *("punkt", "punktnr", "punktnummer"),
    ),
    "X": ("x", "e", "east", "easting", "rechts", "rechtswert"),
    "Y": ("y", "n", "north", "northing", "hoch", "hochwert"),
    "Z": (
        *("z", "h", "height", "elevation", "elev", "alt", "altitude", "höhe", "hoehe"),
        *("ellipsoidalheight", "orthometricheight"),
    ),
    "s": _SPREADS,
    "use": ("use",),
}
_ASIDE: Final = frozenset(("description", "desc", "remark", "remarks", "comment", "code", "note"))
"""Columns that are there for people; they are not read."""


def _columns_by_header() -> dict[str, str]:
    """Return the name of a column by what its header may say, letters and digits only."""
    found = {alias: name for name, aliases in _HEADERS.items() for alias in aliases}
    for axis in ("X", "Y", "Z"):
        for of in _HEADERS[axis]:
            found |= {f"{spread}{of}": f"s{axis}" for spread in _SPREADS}
    for of in ("xy", "en", "plan", "horizontal"):
        found |= {f"{spread}{of}": "sXY" for spread in _SPREADS}
    found |= {f"{spread}vertical": "sZ" for spread in _SPREADS}
    return found | dict.fromkeys(_ASIDE, "")


_COLUMN: Final = _columns_by_header()
_UNIT: Final = re.compile(r"[\[(].*|_m$|\bin m$")
_SIGMA = Blank(SIGMA_OR_FREE)
_KINDS: Final[dict[str, Kind[Any]]] = {
    "point": NAME,
    **dict.fromkeys(("X", "Y", "Z"), Blank(METRES)),
    **dict.fromkeys(("sX", "sY", "sZ", "sXY", "s"), _SIGMA),
    "use": Blank(Word(*USES)),
}


def read_control_list(path: Path) -> GroundPoints:
    """Read a list of control points.

    Parameters
    ----------
    path
        Text with a header; fields are separated by commas, semicolons, tabs or blanks. Columns:
        the name (point, name, id, ...), E or X, N or Y, H or Z, and perhaps standard deviations
        (sigma for all, or sX, sY, sZ) and use; in any order, in small or capital letters, with a
        unit in brackets or none; metres. Where commas do not separate, numbers may have a decimal
        one. A description is not read. Lines that begin with # are comments.

    Returns
    -------
    GroundPoints
        The rows in file order; a point may have a prior beside its control, and any rows that are
        off.

    Raises
    ------
    InputError
        A header without the names, or a row that is wrong, with file, line and column.
    """
    lines = _lines(path, read_text(path, _MAX_BYTES))
    number, separator, header = next(lines, (1, None, []))
    columns = _columns(path, number, header)
    commas = 0
    rows: list[ControlPoint | PointPrior] = []
    found: dict[tuple[str, bool], int] = {}
    for number, _, fields in lines:
        if separator != ",":
            commas += _with_points(columns, fields)
        point = _point(path, number, columns, fields)
        rows.append(point)
        prior = isinstance(point, PointPrior)
        if isinstance(point, ControlPoint) and point.use == "off":
            continue
        first = found.setdefault((point.point, prior), number)
        if first != number:
            raise InputError(
                f"{place(path, number)}: point {quoted(point.point)} twice (first in line {first})"
            )
    if not rows:
        raise InputError(f"{place(path)}: no control point")
    return GroundPoints(
        tuple(row for row in rows if isinstance(row, ControlPoint)),
        tuple(row for row in rows if isinstance(row, PointPrior)),
        commas,
    )


def _with_points(columns: list[str], fields: list[str]) -> int:
    """Write numbers with a decimal point where they have a comma, and return how many had one."""
    count = 0
    for k, (name, field) in enumerate(zip(columns, fields, strict=False)):
        pointed = with_point(field) if name and _KINDS[name].numeric else None
        if pointed is not None:
            fields[k] = pointed
            count += 1
    return count


def _lines(path: Path, text: str) -> Iterator[tuple[int, str | None, list[str]]]:
    """Yield the number of each line, what separates its fields (None: blanks), and these."""
    separator: str | None = None
    first = True
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if first:
            first = False
            separator = next((mark for mark in ";\t," if mark in line), None)
        try:
            fields = (
                line.split()
                if separator is None
                else next(csv.reader([line], delimiter=separator, strict=True))
            )
        except csv.Error as error:
            raise InputError(f"{place(path, number)}: not a row: {reason(error)}") from None
        yield number, separator, [field.strip() for field in fields]


def _columns(path: Path, number: int, header: list[str]) -> list[str]:
    """Return the name of each column; raises InputError where one is unknown or missing."""
    columns = []
    for title in header:
        name = _column(title)
        if name is None:
            usual = "point, X, Y, Z (or name, E, N, H), sigma or sX, sY, sZ, use"
            raise InputError(
                f"{place(path, number)}: unknown column {quoted(title)} (known: {usual})"
            )
        if name and name in columns:
            raise InputError(f"{place(path, number)}: column {name} twice ({quoted(title)})")
        columns.append(name)
    for needed in ("point", "X", "Y"):
        if needed not in columns:
            usual = " or ".join(_HEADERS[needed][:3])
            raise InputError(f"{place(path, number)}: the header names no column {usual}")
    return columns


def _column(title: str) -> str | None:
    """Return the column that a header names, "" for one that is not read, None for none known."""
    words = _UNIT.sub("", title.strip().lower())
    return _COLUMN.get("".join(sign for sign in words if sign.isalnum()))


def _point(
    path: Path, number: int, columns: list[str], fields: list[str]
) -> ControlPoint | PointPrior:
    if len(fields) != len(columns):
        raise InputError(
            f"{place(path, number)}: {len(fields)} fields, the header has {len(columns)}"
        )
    row: dict[str, Any] = {}
    for name, field in zip(columns, fields, strict=True):
        if not name:
            continue
        try:
            row[name] = _KINDS[name].of_text(field)
        except WrongValueError as error:
            raise InputError(f"{place(path, number)}: {name}: {error}") from None
    every = row.get("s")
    plan = row.get("sXY", every)
    xyz = row["X"], row["Y"], row.get("Z")
    sigma = row.get("sX", plan), row.get("sY", plan), row.get("sZ", every)
    use = row.get("use") or "control"
    if use != "prior":
        return ControlPoint(row["point"], xyz, sigma, cast(ControlUse, use))
    fault = prior_fault(xyz, sigma)
    if fault is not None:
        raise InputError(f"{place(path, number)}: {fault[0]}: {fault[1]}")
    return PointPrior(row["point"], xyz, sigma)
