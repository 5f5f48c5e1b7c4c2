"""Model values of sqrt(q_vv) for a stereo model, as modified data snooping takes them.

Gruen 1980 takes them from regular blocks; for one stereo model the regular counterpart is the ideal
model of the same points: vertical photos, equal bases, flat ground.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import NotComputableError
from anaplot.orientation.idealmodel import ideal_model
from anaplot.orientation.residuals import residual_system
from anaplot.orientation.results import ModelSolution

__all__ = ["ideal_roots"]


def ideal_roots(solution: ModelSolution, keys: Sequence[tuple[str, str]] | None = None) -> Array:
    """Return what sqrt(q_vv) of every row would be in the ideal model with the same points.

    Parameters
    ----------
    solution
        The model; its tilts, heights and the change of its base are left out.
    keys
        n rows (point, axis) that the model has; None: those of its table.

    Returns
    -------
    ndarray
        (n,) in a-priori sigmas of the row; all NaN when the points do not determine the ideal
        model.
    """
    rows = list(solution.tested.keys) if keys is None else list(keys)
    rays = np.array([point[1:] for point in solution.points]) - solution.centre
    c = float(np.median(np.abs(rays[:, 2])))
    base = solution.base[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        # a strip flown towards -x is the same seen from the other side
        places = np.copysign(c, -base) * rays[:, :2] / rays[:, 2:]
    names = [point.point for point in solution.points]
    try:
        ideal = ideal_model(
            dict(zip(names, map(tuple, places.tolist()), strict=True)),
            tuple(point for point, axis in rows if axis == "x"),
            abs(base),
            c,
            solution.tie_variance,
            off=frozenset((name, "y") for name in names).difference(rows),
        )
    except NotComputableError:
        return np.full(len(rows), np.nan)
    redundancy: dict[tuple[str, str], float] = dict(
        zip(
            ideal.tested.keys,
            np.maximum(residual_system(ideal).r, 0.0).tolist(),
            strict=True,
        )
    )
    return np.sqrt([redundancy[key] for key in rows])
