"""Plate to image where the certificate states the fiducials' coordinates.

The coordinates of the certificate are free of error, the measured plate coordinates are adjusted
as A v + B g + u = 0 (Kratky and El-Hakim 1983, eq. 2), linearised anew at the adjusted
observations until nothing changes. Before that the plate is turned, mirrored and scaled so that
it lies as the image does: residuals are along the image's axes and in its millimetres, and the
observations stay uncorrelated with unit weight.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from anaplot.adjustment.leastsquares import RankDefectError, adjust_combined
from anaplot.aliases import Array, Bools
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.generalform import IDENTITY, general_form
from anaplot.photogrammetry.innercofactors import InnerCofactors
from anaplot.photogrammetry.innerfit import (
    STEPS,
    FittedPlate,
    InnerFit,
    in_brackets,
    no_end,
    rows3,
    rows4,
)
from anaplot.photogrammetry.platetransformation import PlateTransformation, TransformationName

__all__ = ["fit_fiducials"]


_SPREAD_LIMIT = 50.0
"""Condition of the design at the certificate's fiducials, coordinates scaled to about 1.

Its columns are not scaled to unit length: a product x y that is all but zero at every fiducial
determines nothing, however regular its pattern. Eight fiducials give about 2, four in the corners
the same (the projective transformation about 5).
"""
_LINE = 0.02  # second to first singular value below which fiducials lie on a line or fold

_UNKNOWNS: dict[str, tuple[str, ...]] = {
    "helmert": ("shift in x", "shift in y", "scale", "rotation"),
    "affine": ("shift in x", "x in x", "y in x", "shift in y", "x in y", "y in y"),
    "bilinear": (
        "shift in x", "x in x", "y in x", "x y in x",
        "shift in y", "x in y", "y in y", "x y in y",
    ),
    "projective": (
        "shift in x", "x in x", "y in x", "shift in y", "x in y", "y in y",
        "vanishing along x", "vanishing along y",
    ),
}  # fmt: skip

# columns of the general form a0..a3 of x, a0..a3 of y, c1, c2 that each kind uses
_TERMS: dict[str, tuple[int, ...]] = {
    "affine": (0, 1, 2, 4, 5, 6),
    "bilinear": (0, 1, 2, 3, 4, 5, 6, 7),
    "projective": (0, 1, 2, 4, 5, 6, 8, 9),
}


def fit_fiducials(
    wanted: tuple[TransformationName, ...],
    names: tuple[str, ...],
    plate: Array,
    image: Array,
    keep: Bools | None = None,
) -> InnerFit:
    """Fit the first of the wanted transformations that the fiducials determine.

    Parameters
    ----------
    wanted
        Names, the one to try first first; a remark tells why one was passed over.
    names, plate, image
        Measured fiducials, their (n, 2) plate coordinates and calibrated coordinates [mm].
    keep
        (2 n,) which rows x, y of every fiducial take part; all of them when left out.

    Raises
    ------
    NotComputableError
        None of them is determined (what is not is named), or the adjustment does not converge.
    """
    remarks: list[str] = []
    for k, kind in enumerate(wanted):
        try:
            fit = fit_coordinates(kind, names, plate, image, keep)
        except UndeterminedError as error:
            if k == len(wanted) - 1:
                raise NotComputableError(str(error)) from None
            remarks.append(f"{error}: {wanted[k + 1]} instead")
        else:
            return fit._replace(remarks=tuple(remarks))
    raise AssertionError("no candidate")


class UndeterminedError(Exception):
    """The fiducials at hand do not determine a transformation; another one may be."""


def fit_coordinates(
    kind: TransformationName,
    names: tuple[str, ...],
    plate: Array,
    image: Array,
    keep: Bools | None = None,
) -> InnerFit:
    rows = np.ones(2 * len(names), dtype=np.bool_) if keep is None else keep
    basis = _basis(kind)
    centre = image.mean(axis=0)
    reach = float(np.sqrt(np.mean((image - centre) ** 2)))
    if not reach > 0.0:
        raise NotComputableError(f"the fiducials{in_brackets(names)} have the same place")
    target = (image - centre) / reach
    _check_spread(kind, names, target, basis, rows)
    frame = _laid_like(plate, target, names)
    g = basis.T @ IDENTITY / np.diag(basis.T @ basis)
    observed = (plate @ frame[:, 1:].T + frame[:, 0]).ravel()
    v = np.zeros_like(observed)
    cofactors = np.ones(len(observed))
    iteration = 0
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        while True:
            iteration += 1
            at = (observed + v).reshape(-1, 2)
            value, by_place, by_terms = general_form(basis @ g, at)
            A = _blocks(by_place)[rows]
            B = by_terms.reshape(len(observed), -1)[rows] @ basis
            u = (value - target).ravel()[rows] - A @ v
            if not np.isfinite(u).all():
                raise _not_converged(kind, names, plate, target)
            try:
                solved = adjust_combined(A, B, u, cofactors, unknowns=_UNKNOWNS[kind])
            except RankDefectError as error:
                raise _not_converged(kind, names, plate, target) from error
            g = g + solved.g
            moved = np.abs(solved.g).max() + np.abs(solved.v - v).max()
            v = solved.v
            if moved < 1e-13:
                break
            if iteration == STEPS:
                if moved < 1e-9:
                    break
                raise _not_converged(kind, names, plate, target)
    terms = basis @ g
    a = terms[:8].reshape(2, 4) * reach
    a[:, 0] += centre
    a[:, 1:3] += centre[:, None] * terms[8:]
    return InnerFit(
        PlateTransformation(kind, rows3(frame), rows4(a), (float(terms[8]), float(terms[9]))),
        FittedPlate.of(solved, cofactors, len(v), reach),
        iteration,
        (),
        exchanged=next(iter(_exchanges(names, plate, target)), None),
        cofactors=InnerCofactors(frame, terms, basis @ solved.conditions.q_xx @ basis.T),
    )


def _basis(kind: str) -> Array:
    """(10, u): the coefficients of the general form as multiples of the kind's unknowns."""
    if kind == "helmert":
        out = np.zeros((10, 4))
        out[0, 0] = out[4, 1] = 1.0
        out[1, 2] = out[6, 2] = 1.0
        out[2, 3], out[5, 3] = -1.0, 1.0
        return out
    return np.eye(10)[:, list(_TERMS[kind])]


def _blocks(small: Array) -> Array:
    """(2 n, 2 n) matrix with n blocks (2, 2) along its diagonal."""
    n = len(small)
    out = np.zeros((n, 2, n, 2))
    out[np.arange(n), :, np.arange(n), :] = small
    return out.reshape(2 * n, 2 * n)


def _check_spread(
    kind: TransformationName,
    names: tuple[str, ...],
    target: Array,
    basis: Array,
    rows: Bools,
) -> None:
    _, _, by_terms = general_form(IDENTITY, target)
    design = by_terms.reshape(2 * len(target), -1)[rows] @ basis
    _, found, right = np.linalg.svd(design, full_matrices=True)
    unknowns = _UNKNOWNS[kind]
    singular = np.zeros(len(unknowns))
    singular[: len(found)] = found
    weak = right[singular * _SPREAD_LIMIT <= singular[0]]
    if not len(weak):
        return
    share = np.abs(weak).max(axis=0)
    wrong = [name for name, part in zip(unknowns, share.tolist(), strict=True) if part > 0.3]
    raise UndeterminedError(
        f"fiducials {', '.join(names)} do not determine the {kind} transformation "
        f"(undetermined: {', '.join(wrong)})"
    )


def _laid_like(plate: Array, target: Array, names: tuple[str, ...]) -> Array:
    """(2, 3) similarity that lays the plate as the certificate lies, its sense from the data.

    The best rotation and the best mirrored rotation differ by the sign of the determinant of the
    cross-products of both point sets.
    """
    middle = plate.mean(axis=0)
    away = plate - middle
    size = float((away**2).sum())
    if not size > 1e-6:  # mm^2: a micrometre apart
        raise NotComputableError(
            f"the fiducials{in_brackets(names)} are measured at the same place"
        )
    left, singular, right = np.linalg.svd(target.T @ away)
    if not singular[1] > _LINE * singular[0]:
        pairs = _exchanges(names, plate, target)
        wrong = (
            f"with {_either(pairs)} exchanged they would: measured in the wrong order?"
            if pairs
            else "do they lie on one line, or were they measured in the wrong order?"
        )
        raise NotComputableError(
            f"the measured fiducials {', '.join(names)} do not say how the plate lies; {wrong}"
        )
    turn = left @ right * (singular.sum() / size)
    return np.column_stack((target.mean(axis=0) - turn @ middle, turn))


def _not_converged(
    kind: TransformationName, names: tuple[str, ...], plate: Array, target: Array
) -> NotComputableError:
    pairs = _exchanges(names, plate, target)
    if not pairs:
        return NotComputableError(no_end(kind, names))
    return NotComputableError(
        f"fiducials {', '.join(names)} do not fit: {_either(pairs)} seem to be exchanged, the "
        "other way round they fit; measure them again"
    )


def _either(pairs: list[tuple[str, str]]) -> str:
    return ", or ".join(f"{first} and {second}" for first, second in pairs)


def _exchanges(names: tuple[str, ...], plate: Array, target: Array) -> list[tuple[str, str]]:
    """Return the pairs whose exchange makes a hopeless fit a good one, the best first.

    Hopeless: misfits above 2 percent of the fiducials' reach; good: a tenth of that or less.
    Of four fiducials in a square two pairs do it: both are returned.
    """

    def misfit(place: Array) -> float:
        away = place - place.mean(axis=0)
        fitted = float(np.linalg.svd(target.T @ away)[1].sum()) ** 2 / float((away**2).sum())
        return float(np.sqrt(max(1.0 - fitted / float((target**2).sum()), 0.0)))

    before = misfit(plate)
    if before < 0.02 or len(names) > 16:
        return []
    found = []
    for i, j in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[i], order[j] = j, i
        after = misfit(plate[order])
        if after < before / 10.0:
            found.append((after, (names[i], names[j])))
    found.sort()
    return [pair for _, pair in found]
