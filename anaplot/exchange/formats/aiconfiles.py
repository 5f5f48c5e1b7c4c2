"""Files of AICON: .phc, .eor, .obc, .ior and .scale, lengths in mm.

    .phc     image point x y sx sy vx vy method active internal
    .eor     image X Y Z omega phi kappa [rad]
    .obc     point X Y Z sX sY sZ
    .ior     [camera] Ck xh yh A1 A2 A3 B1 B2 C1 C2 R0, in one row or a value a line, named or not
    .scale   from to distance sigma

With x, y from the principal point the distortion is balanced at R0,

    dx = x (A1 (r^2 - R0^2) + A2 (r^4 - R0^4) + A3 (r^6 - R0^6)) + B1 (r^2 + 2 x^2) + 2 B2 x y
         + C1 x + C2 y
    dy = y (A1 (r^2 - R0^2) + ...) + B2 (r^2 + 2 y^2) + 2 B1 x y

and subtracted from what was measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, pi, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.door import Note
from anaplot.exchange.formats.gathered import MAX_TABLE_BYTES, fields_of, ground_number, number
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.photogrammetry.camera import RadialPolynomial
from anaplot.photogrammetry.refinement import Refinement
from anaplot.textfiles.wording import place, plain, quoted

__all__ = [
    "Bar",
    "ImageRow",
    "Interior",
    "ObjectRow",
    "read_bars",
    "read_interior",
    "read_objects",
    "read_poses",
    "read_rays",
]

_INTERIOR = ("ck", "xh", "yh", "a1", "a2", "a3", "b1", "b2", "c1", "c2", "r0")
_SIGMAS = 6  # columns of a .phc with sx, sy
_ACTIVE = 9  # place of the active flag
XYZ = tuple[float, float, float]


class ImageRow(NamedTuple):
    """A ray: image coordinates [mm], standard deviation [um] or None, whether it is active."""

    line: SourceLine
    photo: str
    point: str
    x: float
    y: float
    sigma_um: float | None
    active: bool


class ObjectRow(NamedTuple):
    """A point and its standard deviations [m], None where none are stated."""

    point: str
    xyz: XYZ
    sigma: tuple[float | None, float | None, float | None]


class Bar(NamedTuple):
    """A scale bar: its ends, length and standard deviation [m]."""

    first: str
    second: str
    length: float
    sigma: float


class Interior(NamedTuple):
    """A camera: c > 0, principal point and R0 [mm], and its coefficients."""

    c: float
    principal: tuple[float, float]
    a: XYZ
    b: tuple[float, float]
    affinity: tuple[float, float]
    r0: float

    def refinement(self) -> Refinement:
        """Return what takes measured coordinates to ideal ones, but for C1 and C2."""
        a1, a2, a3 = self.a
        square = self.r0 * self.r0
        k0 = -(a1 * square + a2 * square**2 + a3 * square**3)
        return Refinement(self.principal, RadialPolynomial((k0, a1, a2, a3)), self.b)

    def ideal(self, xy: Array, sign: float = 1.0) -> Array:
        """Return (n, 2) ideal coordinates of (n, 2) measured ones [mm]; sign -1 adds dx, dy."""
        away = np.asarray(xy, dtype=np.float64).reshape(-1, 2) - self.principal
        distortion = away - self.refinement().refine(xy)
        distortion[:, 0] += away @ np.array(self.affinity)
        out: Array = away - sign * distortion
        return out


def read_rays(path: Path, notes: list[Note]) -> list[ImageRow]:
    """Read a .phc; raises InputError."""
    rows = []
    for line, fields in _full_rows(path):
        if len(fields) < 4:
            raise line.fail(f"{len(fields)} fields, where image, point, x and y are expected")
        x, y = (number(line, text, "x and y") for text in fields[2:4])
        sigma = None
        if len(fields) >= _SIGMAS:
            sx, sy = (_thousandfold(line, text) for text in fields[4:6])
            if sx < 0.0 or sy < 0.0:
                raise line.fail("a standard deviation below 0")
            sigma = sx if sx == sy else sqrt((sx * sx + sy * sy) / 2.0)
        active = len(fields) <= _ACTIVE or number(line, fields[_ACTIVE], "the active flag") > 0.0
        names = line.name_of(fields[0], "image"), line.name_of(fields[1], "point")
        rows.append(ImageRow(line, *names, x, y, sigma or None, active))
    if not rows:
        raise InputError(f"{place(path)}: no image point")
    stated = sorted(row.sigma_um for row in rows if row.sigma_um is not None)
    if stated:
        text = f"sx and sy are in mm: {stated[len(stated) // 2]:g} um in the middle"
        notes.append(Note("assumed", None, text))
    return rows


def read_poses(path: Path, notes: list[Note]) -> dict[str, tuple[XYZ, XYZ]]:
    """Return positions [m] and omega, phi, kappa [rad] of a .eor; raises InputError."""
    out: dict[str, tuple[XYZ, XYZ]] = {}
    more = 0
    for line, fields in _rows(path):
        if len(fields) < 7:
            what = "image, X, Y, Z, omega, phi and kappa are expected"
            raise line.fail(f"{len(fields)} fields, where {what}")
        name = line.name_of(fields[0], "image")
        if name in out:
            raise line.fail(f"image {quoted(name)} twice")
        angles = [number(line, text, "an angle") for text in fields[4:7]]
        if max(map(abs, angles)) > 2.0 * pi + 1e-6:
            raise line.fail("an angle beyond 2 pi: they must be in radians")
        out[name] = _metres(line, fields[1:4]), (angles[0], angles[1], angles[2])
        more += len(fields) > 7
    if more:
        notes.append(Note("dropped", more, "rows of the .eor have further columns: these"))
    return out


def read_objects(path: Path) -> list[ObjectRow]:
    """Read a .obc; raises InputError."""
    rows: dict[str, ObjectRow] = {}
    for line, fields in _rows(path):
        if len(fields) < 4:
            raise line.fail(f"{len(fields)} fields, where point, X, Y and Z are expected")
        name = line.name_of(fields[0], "point")
        if name in rows:
            raise line.fail(f"point {quoted(name)} twice")
        sigma: tuple[float | None, float | None, float | None] = (None, None, None)
        if len(fields) >= 7:
            sigma = _metres(line, fields[4:7])
            if any(value is not None and value < 0.0 for value in sigma):
                raise line.fail("a standard deviation below 0")
        rows[name] = ObjectRow(name, _metres(line, fields[1:4]), sigma)
    return list(rows.values())


def read_bars(path: Path) -> list[Bar]:
    """Read a .scale; raises InputError."""
    bars: list[Bar] = []
    seen: set[frozenset[str]] = set()
    for line, fields in _rows(path):
        if len(fields) < 4:
            what = "two points, their distance and its standard deviation are expected"
            raise line.fail(f"{len(fields)} fields, where {what}")
        first, second = (line.name_of(text, "point") for text in fields[:2])
        length, sigma = (number(line, text, "a length", "um") for text in fields[2:4])
        if first == second or not length > 0.0 or sigma < 0.0:
            raise line.fail("no distance between two points, or no standard deviation")
        if frozenset((first, second)) in seen:
            raise line.fail(f"the distance from {quoted(first)} to {quoted(second)} twice")
        seen.add(frozenset((first, second)))
        bars.append(Bar(first, second, length, sigma))
    return bars


def read_interior(path: Path) -> Interior:
    """Read a .ior; raises InputError."""
    named: dict[str, float] = {}
    values: list[float] = []
    last: SourceLine | None = None
    for line, fields in _rows(path):
        last = line
        word = fields[0].rstrip(":=").lower()
        if word in _INTERIOR:
            if word in named:
                raise line.fail(f"{plain(fields[0], 20)} twice")
            named[word] = number(line, fields[-1], fields[0])
        else:
            values += [number(line, text, "a value of the camera") for text in fields]
    if last is None:
        raise InputError(f"{place(path)}: is empty")
    if named and values:
        raise last.fail("values with and without a name")
    if values:
        if len(values) == len(_INTERIOR) + 1:
            values = values[1:]  # the camera's number
        if len(values) != len(_INTERIOR):
            raise last.fail(f"{len(values)} values of one camera, where {len(_INTERIOR)} are known")
        named = dict(zip(_INTERIOR, values, strict=True))
    if not named.get("ck"):
        raise last.fail("no Ck, the camera constant")
    v = [named.get(word, 0.0) for word in _INTERIOR]
    c = abs(v[0])
    if hypot(v[1], v[2]) > c:
        raise last.fail("the principal point lies further off than Ck")
    return Interior(c, (v[1], v[2]), (v[3], v[4], v[5]), (v[6], v[7]), (v[8], v[9]), v[10])


def _full_rows(path: Path) -> Iterator[tuple[SourceLine, list[str]]]:
    """Yield rows of a table: one with fewer fields than those before it was cut off."""
    most = 0
    for line, fields in _rows(path):
        if len(fields) < most:
            raise line.fail(f"{len(fields)} fields, where the rows before it have {most}")
        most = len(fields)
        yield line, fields


def _rows(path: Path) -> Iterator[tuple[SourceLine, list[str]]]:
    for line in source_lines(path, MAX_TABLE_BYTES):
        fields = fields_of(line, "#%;*")
        if fields:
            yield line, fields


def _metres(line: SourceLine, texts: list[str]) -> XYZ:
    x, y, z = (ground_number(line, text, "a coordinate", "um") for text in texts)  # a thousandth
    return x, y, z


def _thousandfold(line: SourceLine, text: str) -> float:
    value = number(line, text, "sx and sy")
    return 1000.0 * value if set(text.lower()) & set("de") else float(f"{text}e3")
