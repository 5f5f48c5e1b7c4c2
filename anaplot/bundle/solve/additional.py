"""Additional parameters: corrections of the image by self-calibration (Gruen 1978, section B).

The sets of Ebner and Gruen are linear: the systematic image error at a measured point is the sum
of the parameters times basis functions of the measured coordinates. They are orthogonal on their
grids, and to what an exterior orientation does there. The physical set is the lens through which
the rays pass: not linear, for its terms follow the principal point.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from anaplot.aliases import Array, SetName
from anaplot.bundle.solve.parameterpriors import ParameterPrior, checked_priors
from anaplot.bundle.solve.polynomialterms import EBNER, GRUEN, GRUEN50, polynomial_basis
from anaplot.bundle.solve.weightrange import check_weighted
from anaplot.errors import InputError
from anaplot.photogrammetry.lens import LENS_PARAMETERS, through_lens
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "AdditionalParameters",
    "ParameterSet",
    "Scope",
    "additional_parameters",
    "automatic_sets",
    "ebner",
    "gruen",
    "gruen50",
    "lens_units",
    "physical",
]

Scope = Literal["block", "strip", "camera", "photo"]

_SCOPES: tuple[Scope, ...] = ("block", "strip", "camera", "photo")


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """A set of additional parameters, or some of it.

    Attributes
    ----------
    name
        "ebner", "gruen", "gruen50" or "physical".
    names
        Names of the parameters.
    basis
        Function of x, y (n,) [mm], the reach b [mm] and the camera constant (n,) [mm] that
        returns (n, 2, k): what all k parameters of the whole set do, to first order.
    lens
        Whether the parameters are those of a lens: `basis` then only tells their size.
    chosen
        Which columns of `basis` belong to the names; None: all of them.
    """

    name: SetName
    names: tuple[str, ...]
    basis: Callable[[Array, Array, float, Array], Array]
    lens: bool = False
    chosen: tuple[int, ...] | None = None

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of `basis` that belong to the names."""
        return tuple(range(len(self.names))) if self.chosen is None else self.chosen

    def terms(self, x: Array, y: Array, b: float, c: Array) -> Array:
        """Return (n, 2, len(names)): what the parameters do, see `basis`."""
        return self.basis(x, y, b, c)[:, :, list(self.columns)]

    def only(self, names: Iterable[str]) -> ParameterSet:
        """Return the set with these of its parameters alone, in its own order.

        Raises
        ------
        InputError
            No such parameter, or none at all.
        """
        wanted = set()
        for name in names:
            if name not in self.names:
                near = hint(name, self.names, listing=False)
                near = near or f"; {self.name} has {_span(self.names)}"
                raise InputError(
                    f"additional parameters {self.name}: no parameter {quoted(name)}{near}"
                )
            wanted.add(name)
        if not wanted:
            raise InputError(f"additional parameters {self.name}: none is left")
        return self._kept(wanted)

    def _kept(self, wanted: Container[str]) -> ParameterSet:
        kept = [k for k, name in enumerate(self.names) if name in wanted]
        return replace(
            self,
            names=tuple(self.names[k] for k in kept),
            chosen=tuple(self.columns[k] for k in kept),
        )

    def parted(self, names: Container[str]) -> tuple[ParameterSet, ParameterSet]:
        """Return the set without some of its parameters, and these; either may be empty."""
        return self._kept([n for n in self.names if n not in names]), self._kept(names)

    def without(self, names: Iterable[str]) -> ParameterSet:
        """Return the set without some of its parameters.

        Raises
        ------
        InputError
            No such parameter, or none is left.
        """
        away = self.only(names).names
        return self.only(name for name in self.names if name not in away)


def _span(names: tuple[str, ...]) -> str:
    if len(names) <= 12:
        return ", ".join(names)
    return f"{', '.join(names[:8])} ... {names[-1]}"


@dataclass(frozen=True, slots=True)
class AdditionalParameters:
    """Which additional parameters a bundle carries.

    Attributes
    ----------
    set
        Which ones are unknown.
    scope
        One set for the block, or one for each strip, camera or photo.
    sigma_um
        A-priori standard deviation of every parameter without a prior of its own, expressed as its
        largest effect in the image [um]; None when they are free.
    priors
        What is known of some beforehand.
    held
        Parameters that are held at the value of their priors (sigma 0), beside `set`; None: none.
    reference_mm
        The length b of the terms in x/b, y/b [mm]: the values of another block are those of this
        one only with the same b. None: half the longer side of a camera's format, without one the
        largest coordinate measured in the block.
    still
        (group, parameter) of those in `set` that are held in some groups only, at the value of
        their priors, else at 0.
    """

    set: ParameterSet
    scope: Scope = "block"
    sigma_um: float | None = None
    priors: tuple[ParameterPrior, ...] = ()
    held: ParameterSet | None = None
    reference_mm: float | None = None
    still: frozenset[tuple[str, str]] = frozenset()


def _ebner_basis(x: Array, y: Array, b: float, c: Array) -> Array:
    """Twelve parameters, orthogonal on the 3 x 3 grid {-b, 0, b}^2 (Ebner 1976); unit: mm."""
    return polynomial_basis(EBNER, x / b, y / b)


def _gruen_basis(x: Array, y: Array, b: float, c: Array) -> Array:
    """44 parameters, orthogonal on the 5 x 5 grid {-b, -b/2, 0, b/2, b}^2 (1978, eq. 7)."""
    return polynomial_basis(GRUEN, x / b, y / b)


def _gruen50_basis(x: Array, y: Array, b: float, c: Array) -> Array:
    """Gruen's 44 parameters and the six that the exterior orientation has taken from the 50."""
    return polynomial_basis(GRUEN50, x / b, y / b)


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


ebner = ParameterSet("ebner", tuple(term.name for term in EBNER), _ebner_basis)
"""Ebner's twelve parameters; each is its effect in mm where the term in x/b and y/b is 1."""

gruen = ParameterSet("gruen", tuple(term.name for term in GRUEN), _gruen_basis)
"""Gruen's 44 parameters; unit as in `ebner`."""

gruen50 = ParameterSet("gruen50", tuple(term.name for term in GRUEN50), _gruen50_basis)
"""All 50 of the 5 x 5 grid: the 44 and what they leave to the exterior orientation.

The coefficients that eq. (7) has no name for are a11, b11 (the principal point), b21 (x, y: the
camera constant), b12 (-y, x), a13 (k, x y) and b31 (x y, m), orthogonal to each other and to the
44. Over flat ground they are what a vertical photo's own orientation does to the image. b12 is so
everywhere: kappa turns the image about its origin, whatever is seen, and "one of the two linear
terms which lead to image torsions has to be rejected a-priori".
"""

physical = ParameterSet("physical", LENS_PARAMETERS, _physical_basis, lens=True)
"""The lens (conventions, Pixels): corrections of the camera's own values.

c, x0, y0 in mm; the others as their effect [mm] at the reach b, on an axis of the image:
`lens_units` times that is Brown's coefficient. A positive c makes the camera constant longer and
stretches the image: what is adjusted is the camera's c plus this. x0 and y0 are where the principal
point lies in the image's axes, and all distortion is about it. k1, k2, k3 > 0 push points outwards.
"""

_SETS: dict[str, ParameterSet] = {one.name: one for one in (ebner, gruen, gruen50, physical)}


def additional_parameters(
    text: str,
    sigma_um: float | None = None,
    priors: Iterable[ParameterPrior] = (),
    reference_mm: float | None = None,
) -> AdditionalParameters:
    """Return the parameters that "set", "set:scope", "set:names" or "set:names:scope" says.

    Parameters
    ----------
    text
        A set; a scope (block, strip, camera, photo); names with commas between, these alone, or
        each with a minus before it, all but these: "ebner:b1,b2", "gruen:-a43:camera".
    sigma_um, priors, reference_mm
        See `AdditionalParameters`.

    Raises
    ------
    InputError
        No such set, scope or parameter, a standard deviation that is not positive, the prior of a
        parameter that does not take part, or a reference length beyond any image.
    """
    name, *parts = text.split(":")
    about = f"additional parameters {quoted(text)}"
    if name == "auto":
        raise InputError(f"{about}: chosen by `adjust` alone, without --errors; name a set")
    chosen = _SETS.get(name)
    if chosen is None:
        near = hint(name, _SETS, listing=False)
        raise InputError(f"{about}: no set {quoted(name)}{near}; there are {', '.join(_SETS)}")
    scope: Scope | None = None
    selected: str | None = None
    for part in parts:
        found = next((one for one in _SCOPES if one == part), None)
        if found is not None and scope is None:
            scope = found
        elif found is None and selected is None:
            selected = part
        else:
            what = "scope" if found is not None else "choice of parameters"
            raise InputError(f"{about}: a second {what}")
    if sigma_um is not None and not 0.0 < sigma_um < float("inf"):
        raise InputError(f"additional parameters: the sigma {sigma_um:g} um must be positive")
    if sigma_um is not None:
        check_weighted("additional parameters", sigma_um)
    if reference_mm is not None and not 1e-3 <= reference_mm <= 1e6:
        raise InputError(
            f"additional parameters: the reference length {reference_mm:g} mm must be 0.001 to 1e6"
        )
    if selected is not None:
        chosen = _selected(chosen, selected, about)
    known = checked_priors(priors)
    stray = next((one.parameter for one in known if one.parameter not in chosen.names), None)
    if stray is not None:
        near = hint(stray, chosen.names, listing=False)
        raise InputError(f"{about}: a prior of {quoted(stray)}, which takes no part{near}")
    held = {one.parameter for one in known if one.sigma == 0.0}
    free, fixed = chosen.parted(held) if held else (chosen, None)
    return AdditionalParameters(free, scope or "block", sigma_um, known, fixed, reference_mm)


def automatic_sets(text: str) -> tuple[AdditionalParameters, ...] | None:
    """Return what "auto", "auto:set", "auto:scope" or "auto:set:scope" tries; None: not automatic.

    Raises
    ------
    InputError
        Something else after "auto", or one set for every photo.
    """
    name, *parts = text.split(":")
    if name != "auto":
        return None
    about = f"additional parameters {quoted(text)}"
    sets: tuple[str, ...] = ("physical", "ebner", "gruen")
    scopes = _SCOPES[:-1]
    scope, named = "block", False
    for part in parts:
        if part in _SETS and not named:
            sets, named = (part,), True
        elif part in scopes and part == parts[-1]:
            scope = part
        else:
            known = (*_SETS, *scopes)
            raise InputError(
                f"{about}: after auto a set and a scope, no {quoted(part)}"
                f"{hint(part, known, listing=False)}; there are {', '.join(known)}"
            )
    return tuple(additional_parameters(f"{one}:{scope}") for one in sets)


def _selected(whole: ParameterSet, text: str, about: str) -> ParameterSet:
    """Return the parameters "b1,b2" of a set, or those that "-b1,-b2" leaves."""
    parts = [part.strip() for part in text.split(",")]
    names = [part.removeprefix("-").strip() for part in parts]
    stray = next((one for one in names if one not in whole.names), None)
    if stray is not None and len(names) == 1 and not parts[0].startswith("-"):
        raise InputError(
            f"{about}: no scope or parameter {quoted(stray)}"
            f"{hint(stray, (*_SCOPES, *whole.names), listing=False)}; scopes are "
            f"{', '.join(_SCOPES)}, parameters {_span(whole.names)}"
        )
    away = [part.startswith("-") for part in parts]
    if any(away) and not all(away):
        raise InputError(f"{about}: either the parameters to take, or those to leave, each with -")
    return whole.without(names) if any(away) else whole.only(names)
