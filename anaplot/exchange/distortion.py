"""The table [distortion] of a camera file: what a certificate prints of its lens, to and from text.

    [distortion]
    sign = "distortion"                 # or "correction": what all numbers of this table are
    radial = [0.0, 1.2e-8, 0.0, 0.0]    # K0 K1 K2 K3: dr = K0 r + K1 r^3 + K2 r^5 + K3 r^7 [mm]
    table = [[20.0, 1.5], [40.0, 2.2]]  # instead: radius [mm], dr [um]
    angles = [[7.5, 1.5], [15.0, 2.2]]  # instead: angle from the axis, dr [um]
    unit = "deg"                        # of angles; or "gon"
    decentring = [0.0, 0.0]             # P1 P2 [1/mm]

A distortion is subtracted from the measured radius, a correction added to it. Certificates print
either; with angles it has to be said, elsewhere a distortion is meant. An angle a is that of the
ray in the object: it is measured at the radius c tan a + dr. Where a certificate lists several
half-diagonals, they follow each other,

    angles = [[7.5, 1.0, 2.0, 1.5, 1.5], ...]

and their mean counts.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from anaplot.photogrammetry.camera import CameraCalibration, RadialPolynomial, RadialTable
from anaplot.textfiles.kinds import (
    Fields,
    Kind,
    ListOf,
    Made,
    Numbers,
    Word,
    WrongValueError,
)
from anaplot.textfiles.tomltable import TomlTable
from anaplot.textfiles.tomltext import toml_numbers

__all__ = ["distortion_lines", "read_distortion"]

_MAX_TABLE = 1000
_HALF_DIAGONALS = 8
_UNITS = {"deg": math.pi / 180.0, "gon": math.pi / 200.0}
_FURTHEST = 1e6  # mm or um: further than any, and with sums that are numbers
_STEEPEST = math.radians(85.0)  # no lens with a plane image sees further from its axis
_FORMS = ("radial", "table", "angles")


def read_distortion(table: TomlTable, c: float) -> dict[str, Any]:
    """Return the keyword arguments `radial` and `decentring` of a calibration.

    Parameters
    ----------
    table
        The table [distortion], or an empty one.
    c
        Camera constant [mm].

    Raises
    ------
    InputError
        What is wrong, with file, line and key.
    """
    stated: Fields = {"sign": _SIGN, "unit": Word(*_UNITS)}
    found = table.take({}, stated, also=(*_FORMS, "decentring"))
    forms = [form for form in _FORMS if form in table]
    if len(forms) > 1:
        raise table.fail(f"{forms[1]} beside {forms[0]}: only one of them", forms[1])
    if "angles" in table:
        for key, asked in _WITH_ANGLES.items():
            if key not in found:
                raise table.fail(f"angles without {key}: {asked}", "angles")
    elif "unit" in found:
        raise table.fail("unit without angles", "unit")
    sign = -1.0 if found.get("sign") == "correction" else 1.0
    reach = _UNITS[found["unit"]] if "angles" in table else 1.0
    kinds: Fields = {
        "radial": Made(Numbers(4), lambda k: RadialPolynomial(_signed(sign, k))),
        "table": Made(_ROWS, partial(_radial_table, sign)),
        "angles": Made(_ROWS, lambda rows: _radial_table(sign, _radii(sign, rows, reach, c))),
    }
    return {
        "radial": table.get(forms[0], kinds[forms[0]]) if forms else None,
        "decentring": table.optional("decentring", _decentring(sign), (0.0, 0.0)),
    }


def distortion_lines(calibration: CameraCalibration) -> list[str]:
    """Return the lines of a table [distortion], all numbers distortions, angles as radii."""
    lines = ["[distortion]", f"decentring = {toml_numbers(*calibration.decentring)}"]
    radial = calibration.radial
    if isinstance(radial, RadialPolynomial):
        lines.append(f"radial = {toml_numbers(*radial.k)}")
    if isinstance(radial, RadialTable):
        read = radial.diagonals_um or tuple((dr,) for dr in radial.dr_um)
        pairs = zip(radial.radius, read, strict=True)
        lines += ["table = [", *(f"    {toml_numbers(r, *um)}," for r, um in pairs), "]"]
    return lines


def _signed(sign: float, numbers: tuple[float, ...]) -> Any:
    # a correction of 0 is a distortion of 0, and no -0
    return tuple(sign * number if number else 0.0 for number in numbers)


def _decentring(sign: float) -> Made[tuple[float, float]]:
    return Made(Numbers(2), partial(_signed, sign))


def _radii(
    sign: float, rows: tuple[tuple[float, ...], ...], unit: float, c: float
) -> tuple[tuple[float, ...], ...]:
    """Return the rows with measured radii [mm] in place of angles."""
    out = []
    for index, (angle, *um) in enumerate(rows):
        if not 0.0 <= angle * unit <= _STEEPEST:
            raise WrongValueError(f"angle {angle:g}: must lie between 0 and 85 deg", index)
        dr = sign * 1e-3 * math.fsum(part / len(um) for part in um)
        out.append((c * math.tan(angle * unit) + dr, *um))
    return tuple(out)


def _radial_table(sign: float, rows: tuple[tuple[float, ...], ...]) -> RadialTable:
    if not rows:
        raise WrongValueError("is empty")
    if len(rows) > _MAX_TABLE:
        raise WrongValueError(f"more than {_MAX_TABLE} radii")
    last = -math.inf
    for index, (radius, *um) in enumerate(rows):
        if radius < 0.0 or radius <= last:
            raise WrongValueError(f"radius {radius:g}: radii must grow from 0 on", index)
        if radius > _FURTHEST or any(abs(dr) > _FURTHEST for dr in um):
            raise WrongValueError(f"more than {_FURTHEST:g} mm, or um of distortion", index)
        if radius == 0.0 and any(um):
            raise WrongValueError("the distortion at radius 0 must be 0", index)
        last = radius
    radii = tuple(radius for radius, *_ in rows)
    return RadialTable.of_diagonals(radii, tuple(_signed(sign, row[1:]) for row in rows))


class _Row(Kind[tuple[float, ...]]):
    """A radius or angle and the distortion there, of each half-diagonal that was measured."""

    def of(self, value: Any) -> tuple[float, ...]:
        """Return the numbers."""
        count = len(value) if isinstance(value, list) else 0
        if count > _HALF_DIAGONALS + 1:
            raise WrongValueError(f"more than {_HALF_DIAGONALS} half-diagonals")
        return Numbers(max(count, 2)).of(value)


_SIGN = Word("distortion", "correction")
_ROWS = ListOf(_Row(), "pairs [mm, um]")
_WITH_ANGLES = {
    "sign": 'sign = "distortion" or "correction" says what the certificate prints',
    "unit": 'unit = "deg" or "gon" says in what they are',
}
