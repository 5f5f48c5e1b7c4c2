"""How additional parameters are correlated with each other and with orientations."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.parameternames import parameter_names
from anaplot.photogrammetry.rotation import rotation_angles, rotation_axes

__all__ = [
    "ORIENTATION_PAIRS",
    "parameter_correlations",
    "parameter_matrix",
    "photo_correlations",
]

_LEVEL = 1e-9  # of the determinant: omega and kappa are one at phi = 90 degrees
_ORIENTATION = ("X", "Y", "Z", "omega", "phi", "kappa")

ORIENTATION_PAIRS = tuple(combinations(_ORIENTATION, 2))
"""The 15 pairs of a photo's orientation whose correlations `photo_correlations` returns."""


def photo_correlations(adjusted: AdjustedBlock) -> Array:
    """Return (photos, 15) the correlations of each photo's orientation, `ORIENTATION_PAIRS`.

    NaN of what the datum holds, and of angles where phi is 90 degrees.
    """
    pairs = np.array(list(combinations(range(6), 2)))
    out = np.full((len(adjusted.problem.photos), len(pairs)), np.nan)
    for k, rotation in enumerate(adjusted.state.rotations):
        omega, phi, _ = rotation_angles(rotation)
        axes = rotation_axes(omega, phi)
        jacobian = np.eye(6)
        turned = abs(float(np.linalg.det(axes))) > _LEVEL
        if turned:
            jacobian[3:, 3:] = np.linalg.inv(axes)
        q = jacobian @ adjusted.cofactors.photos[k, :6, :6] @ jacobian.T
        rho = _correlation(q)
        good = np.diag(q) > 0.0
        good[3:] &= turned
        first, second = pairs.T
        out[k] = np.where(good[first] & good[second], rho[first, second], np.nan)
    return out


def parameter_matrix(adjusted: AdjustedBlock) -> tuple[tuple[tuple[str, str], ...], Array] | None:
    """Return (owner, name) of the additional parameters that photos share, and their correlations.

    None where there are no such parameters.
    """
    problem = adjusted.problem
    if problem.additional is None or problem.photo_invariant:
        return None
    names = parameter_names(problem)
    free = [k for k, one in enumerate(names) if not one.held]
    rho = _correlation(adjusted.cofactors.shared[np.ix_(free, free)])
    return tuple((names[k].owner, names[k].unknown) for k in free), rho


def parameter_correlations(
    adjusted: AdjustedBlock, limit: float = 0.9
) -> list[tuple[str, str, float]]:
    """Return pairs of unknowns correlated beyond a limit, one an additional parameter."""
    problem = adjusted.problem
    if problem.additional is None:
        return []
    own = problem.photo_invariant
    labels = problem.additional.set.names
    orientation = ("X", "Y", "Z", "d1", "d2", "d3")
    found: list[tuple[str, str, float]] = []
    if own:
        names = [*orientation, *labels]
        for k, photo in enumerate(problem.photos):
            rho = _correlation(adjusted.cofactors.photos[k])
            for i, j in np.argwhere(np.tril(np.abs(rho) > limit, -1)).tolist():
                if i >= 6:
                    found.append(
                        (f"{names[i]} of {photo}", f"{names[j]} of {photo}", float(rho[i, j]))
                    )
        return found
    shared = [f"{one.unknown} of {one.owner}" for one in parameter_names(problem)]
    rho = _correlation(adjusted.cofactors.shared)
    for i, j in np.argwhere(np.tril(np.abs(rho) > limit, -1)).tolist():
        found.append((shared[i], shared[j], float(rho[i, j])))
    # what the datum holds is correlated with nothing
    size = _sizes(np.einsum("nii->ni", adjusted.cofactors.photos))
    cross = adjusted.cofactors.photos_shared / size[:, :, None]
    cross = np.clip(cross / _sizes(np.diag(adjusted.cofactors.shared)), -1.0, 1.0)
    for k, index, j in np.argwhere(np.abs(cross) > limit).tolist():
        found.append(
            (
                shared[j],
                f"{orientation[index]} of {problem.photos[k]}",
                float(cross[k, index, j]),
            )
        )
    return found


def _correlation(q: Array) -> Array:
    size = _sizes(np.diag(q))
    out: Array = np.clip(q / size[:, None] / size, -1.0, 1.0)
    return out


def _sizes(variances: Array) -> Array:
    """Return standard deviations; infinite where there is no variance."""
    return np.sqrt(np.where(variances > 0.0, variances, np.inf))
