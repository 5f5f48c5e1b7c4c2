"""How additional parameters are correlated with each other and with orientations."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.parameternames import parameter_names

__all__ = ["parameter_correlations"]


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
