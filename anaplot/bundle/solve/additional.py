"""Additional parameters: corrections of the image by self-calibration (Gruen 1978, section B).

The sets of Ebner and Gruen are linear: the systematic image error at a measured point is the sum
of the parameters times basis functions of the measured coordinates. They are orthogonal on their
grids, and to what an exterior orientation does there. The physical set is the lens through which
the rays pass: not linear, for its terms follow the principal point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.photogrammetry.lens import LENS_PARAMETERS, through_lens

__all__ = [
    "AdditionalParameters",
    "ParameterSet",
    "Scope",
    "additional_parameters",
    "ebner",
    "gruen",
    "lens_units",
    "physical",
]

Column = list[Array | float]
Scope = Literal["block", "strip", "camera", "photo"]
SetName = Literal["ebner", "gruen", "physical"]

_SCOPES: tuple[Scope, ...] = ("block", "strip", "camera", "photo")


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """A set of additional parameters.

    Attributes
    ----------
    name
        "ebner", "gruen" or "physical".
    names
        Names of the parameters.
    basis
        Function of x, y (n,) [mm], the reach b [mm] and the camera constant (n,) [mm] that
        returns (n, 2, len(names)): what the parameters do, to first order.
    lens
        Whether the parameters are those of a lens: `basis` then only tells their size.
    """

    name: SetName
    names: tuple[str, ...]
    basis: Callable[[Array, Array, float, Array], Array]
    lens: bool = False


@dataclass(frozen=True, slots=True)
class AdditionalParameters:
    """Which additional parameters a bundle carries.

    Attributes
    ----------
    set
        The basis functions.
    scope
        One set for the block, or one for each strip, camera or photo.
    sigma_um
        A-priori standard deviation of every parameter, expressed as its largest effect in the
        image [um]; None when the parameters are free.
    """

    set: ParameterSet
    scope: Scope = "block"
    sigma_um: float | None = None


def _columns(x: Array, dx: Column, dy: Column) -> Array:
    out = np.empty((len(x), 2, len(dx)))
    for k, (first, second) in enumerate(zip(dx, dy, strict=True)):
        out[:, 0, k] = first
        out[:, 1, k] = second
    return out


def _ebner_basis(x: Array, y: Array, b: float, c: Array) -> Array:
    """Twelve parameters, orthogonal on the 3 x 3 grid {-b, 0, b}^2 (Ebner 1976); unit: mm."""
    x, y = x / b, y / b
    k, m = x * x - 2.0 / 3.0, y * y - 2.0 / 3.0
    dx: Column = [x, y, -2.0 * k, x * y, m, 0.0, x * m, 0.0, y * k, 0.0, k * m, 0.0]
    dy: Column = [-y, x, x * y, -2.0 * m, 0.0, k, 0.0, y * k, 0.0, x * m, 0.0, k * m]
    return _columns(x, dx, dy)


def _gruen_basis(x: Array, y: Array, b: float, c: Array) -> Array:
    """44 parameters, orthogonal on the 5 x 5 grid {-b, -b/2, 0, b/2, b}^2 (1978, eq. 7).

    The paper prints y q in the terms of a43 and b43; orthogonality asks for y k q.
    """
    x, y = x / b, y / b
    k, m = x * x - 0.5, y * y - 0.5
    p, q = x * x - 17.0 / 20.0, y * y - 17.0 / 20.0
    r = x * x * (x * x - 31.0 / 28.0) + 9.0 / 70.0
    s = y * y * (y * y - 31.0 / 28.0) + 9.0 / 70.0
    both: list[tuple[Array | float, Array | float]] = [
        (x, -y),
        (y, x),
        (x * y, -10.0 / 7.0 * m),
        (m, 0.0),
        (0.0, k),
        (-10.0 / 7.0 * k, x * y),
    ]
    rows = [
        [x * p, y * k, x * m, y * q],
        [r, x * y * p, k * m, x * y * q, s],
        [y * r, x * m * p, y * k * q, x * s],
        [m * r, x * y * p * q, k * s],
        [y * q * r, x * p * s],
        [r * s],
    ]
    for row in rows:
        both += [(term, 0.0) for term in row]
        both += [(0.0, term) for term in row]
    return _columns(x, [first for first, _ in both], [second for _, second in both])


def _gruen_names() -> tuple[str, ...]:
    rows = (("14", "23", "32", "41"), ("15", "24", "33", "42", "51"), ("25", "34", "43", "52"))
    rows += (("35", "44", "53"), ("45", "54"), ("55",))  # type: ignore[assignment]
    names = ["a12", "a21", "a22", "a31", "b13", "b22"]
    for row in rows:
        names += [f"a{k}" for k in row] + [f"b{k}" for k in row]
    return tuple(names)


def lens_units(b: float, c: float) -> Array:
    """Return (10,) the `LENS_PARAMETERS` whose effect in the image is 1 mm at the reach.

    Parameters
    ----------
    b, c
        Reach and camera constant [mm]. c, x0 and y0 are 1 mm themselves.
    """
    r = b / c
    effects = c * np.array([r**3, r**5, r**7, r**2, r**2, r, r])
    return np.concatenate((np.ones(3), 1.0 / effects))


def _physical_basis(x: Array, y: Array, b: float, c: Array) -> Array:
    """Return what the lens function makes of small parameters, to first order."""
    nominal = np.zeros((len(x), len(LENS_PARAMETERS)))
    nominal[:, 0] = c
    seen = through_lens(np.column_stack((x, y)) / c[:, None], nominal)
    return seen.by_parameter * lens_units(b, float(np.mean(c)))


ebner = ParameterSet("ebner", tuple(f"b{k}" for k in range(1, 13)), _ebner_basis)
"""Ebner's twelve parameters; each is its effect in mm where the term in x/b and y/b is 1."""

gruen = ParameterSet("gruen", _gruen_names(), _gruen_basis)
"""Gruen's 44 parameters; unit as in `ebner`."""

physical = ParameterSet("physical", LENS_PARAMETERS, _physical_basis, lens=True)
"""The lens (conventions, Pixels): corrections of the camera's own values.

c, x0, y0 in mm; the others as their effect [mm] at the reach b, on an axis of the image:
`lens_units` times that is Brown's coefficient. A positive c makes the camera constant longer and
stretches the image: what is adjusted is the camera's c plus this. x0 and y0 are where the principal
point lies in the image's axes, and all distortion is about it. k1, k2, k3 > 0 push points outwards.
"""

_SETS: dict[str, ParameterSet] = {"ebner": ebner, "gruen": gruen, "physical": physical}


def additional_parameters(text: str, sigma_um: float | None = None) -> AdditionalParameters:
    """Return the parameters that "set" or "set:scope" names.

    Raises
    ------
    InputError
        No such set or scope, or a standard deviation that is not positive.
    """
    name, _, scope = text.partition(":")
    chosen = _SETS.get(name)
    if chosen is None:
        raise InputError(
            f"additional parameters {text!r}: no set {name!r}; there are {', '.join(_SETS)}"
        )
    found = next((s for s in _SCOPES if s == (scope or "block")), None)
    if found is None:
        raise InputError(
            f"additional parameters {text!r}: no scope {scope!r}; there are {', '.join(_SCOPES)}"
        )
    if sigma_um is not None and not 0.0 < sigma_um < float("inf"):
        raise InputError(f"additional parameters: the sigma {sigma_um:g} um must be positive")
    return AdditionalParameters(chosen, found, sigma_um)
