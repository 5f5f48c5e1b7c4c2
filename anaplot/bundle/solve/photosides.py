"""Right-hand sides that photos alone have, solved for as far as some rays see what changes."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.factor import Factor
from anaplot.bundle.solve.normal import NormalEquations

__all__ = ["solve_photos"]

_PORTION = 300_000_000  # bytes of the largest array while points are solved for


def solve_photos(
    normal: NormalEquations, factor: Factor, photos: Array, rays: Index
) -> tuple[Array, Array]:
    """Solve the full normal equations for k right-hand sides that the photos alone have.

    The points are solved for as far as the rays see them: there may be many more.

    Parameters
    ----------
    normal, factor
        The equations, and the factor of their matrix.
    photos
        (n, d, k).
    rays
        (m,) indices of rays.

    Returns
    -------
    ndarray, ndarray
        (n, d, k) changes of the photos, and (m, 2, k) what all changes do to the rays.
    """
    problem, k = normal.problem, photos.shape[2]
    shared = np.zeros((len(normal.corner), k))
    if normal.changes(factor):
        # what is added to these equations is a change of every unknown
        points = np.zeros((len(problem.points), 3, k))
        x, points, s = normal.solve(factor, photos, points, shared)
        return x, normal.seen(x, points, s, rays)
    x, s = factor.solve(photos, shared)
    wanted, place = np.unique(problem.point[rays], return_inverse=True)
    near = np.flatnonzero(np.isin(problem.point, wanted))
    at, of = np.searchsorted(wanted, problem.point[near]), problem.photo[near]
    z = normal.z[near].transpose(0, 2, 1)
    y = np.zeros((len(wanted), 3, k))
    step = max(1, _PORTION // (8 * max(z.size, 1)))
    for first in range(0, k, step):
        mine = slice(first, first + step)
        np.subtract.at(y[:, :, mine], at, np.matmul(z, x[of, :, mine]))
    if len(s):
        y -= np.matmul(normal.t[wanted], s)
    of_points = normal.inverse_root[wanted].transpose(0, 2, 1) @ y
    return x, normal.seen_with(x, of_points[place], s, rays)
