"""S' N^-1 S of sparse right-hand sides S, by the elimination of S alone.

Eliminating the points leaves Y = L_v^-1 S_v of them (the roots of their own blocks) and the sides
R = S_u - Z Y of photos and shared parameters, both sparse; with L L' the photos' matrix,

    S' N^-1 S = Y'Y + (L^-1 R)'(L^-1 R).

What conditions and priors that tie unknowns together change is of low rank: G M^-1 G' goes off the
inverse.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, vstack

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.factor import Factor
from anaplot.bundle.solve.normal import NormalEquations

__all__ = ["inner_products"]


def inner_products(normal: NormalEquations, factor: Factor, sides: csr_array) -> Array:
    """Return (k, k) S' N^-1 S, with conditions and priors.

    Parameters
    ----------
    normal, factor
        Normal equations, and their factor.
    sides
        (n d + 3 p + g, k) S: photos, points, shared parameters.
    """
    first = len(normal.problem.photos) * normal.z.shape[1]
    last = first + 3 * len(normal.problem.points)
    of_points = csr_array(sides[first:last])
    points = np.unique(np.flatnonzero(np.diff(of_points.indptr)) // 3)
    mine = (3 * points[:, None] + np.arange(3)).ravel()
    y = _blocks(normal.inverse_root[points], np.arange(len(points)), len(points)) @ of_points[mine]
    left = [sides[:first] - _seen(normal, points) @ y]
    if len(normal.corner):
        beside = csr_array(normal.t[points].reshape(len(mine), len(normal.corner)))
        left.append(sides[last:] - beside.T @ y)
    out: Array = (y.T @ y).toarray()
    out += factor.inner_products(csr_array(vstack(left)))
    for change in normal.changes(factor):
        gain = np.concatenate([part.reshape(-1, len(change.inner)) for part in change.gain])
        gained = sides.T @ gain
        out -= gained @ change.inner @ gained.T
    return 0.5 * (out + out.T)


def _seen(normal: NormalEquations, points: Index) -> csr_array:
    """Return (n d, 3 p) Z of some points, photo by photo."""
    problem = normal.problem
    place = np.full(len(problem.points), -1)
    place[points] = np.arange(len(points))
    rays = np.flatnonzero(place[problem.point] >= 0)
    return _blocks(
        normal.z[rays], place[problem.point[rays]], len(points),
        problem.photo[rays], len(problem.photos),
    )  # fmt: skip


def _blocks(
    values: Array, column: Index, columns: int, row: Index | None = None, rows: int | None = None
) -> csr_array:
    """Return the sparse matrix of blocks (m, i, j) at their rows and columns of blocks.

    Without rows, those of the columns; blocks at the same place add up.
    """
    row, rows = (column, columns) if row is None or rows is None else (row, rows)
    _, high, wide = values.shape
    at = np.broadcast_arrays(
        high * row[:, None, None] + np.arange(high)[:, None],
        wide * column[:, None, None] + np.arange(wide),
    )
    return csr_array(
        (values.ravel(), (at[0].ravel(), at[1].ravel())), shape=(high * rows, wide * columns)
    )
