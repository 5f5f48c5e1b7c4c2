"""Cofactors between unknowns anywhere in a block, without an inverse of its size.

Functions J of the unknowns name few of them each. With N = L L' of the equations whose points are
eliminated, J N^-1 J' = (L^-1 J')'(L^-1 J') takes the elimination of J' alone, and there only the
fronts above the photos that a function names or that see its points: no solution is formed. In a
datum of its own, which every function moves with, it takes one solution for every row of J, and
what is held at a time is bounded.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.innerproducts import inner_products
from anaplot.bundle.solve.reliability import DatumChange

__all__ = ["coordinate_cofactors", "function_cofactors", "own_parameter_cofactors"]

_BYTES = 300_000_000  # of the largest array while a portion is solved


def _portions(block: AdjustedBlock, count: int) -> list[range]:
    # the largest array of a solution has a value per ray, unknown of its photo, and side
    step = max(1, _BYTES // (8 * len(block.problem.photo) * block.problem.per_photo))
    return [range(k, min(k + step, count)) for k in range(0, count, step)]


def function_cofactors(
    block: AdjustedBlock, functions: csr_array, datum: DatumChange | None = None
) -> Array:
    """Return (k, k) cofactors of k linear functions of the unknowns, each with each.

    Parameters
    ----------
    block
        The adjusted block.
    functions
        (k, n d + 3 p + g) derivatives by the unknowns of photos, of points, and shared parameters.
    datum
        From the datum that the equations were solved in to the one meant; None: that of the
        solution, which is the reported one with datum "control".

    Notes
    -----
    Coordinates free of error have zeros. In another datum x' = S x, with S = I - G (D'G)^-1 D':
    J S N^-1 S'J', and what the held combinations D vary by themselves.
    """
    problem, cofactors = block.problem, block.cofactors
    n, d, p = len(problem.photos), problem.per_photo, len(problem.points)
    free = np.ones(functions.shape[1])
    free[n * d : n * d + 3 * p] = ~problem.fixed.reshape(-1)
    weighted = csr_array(functions.multiply(free))
    if datum is None:
        return inner_products(cofactors.normal, cofactors.factor, csr_array(weighted.T))
    count = functions.shape[0]
    out = np.zeros((count, count))
    moves = np.zeros((count, len(datum.variance)))
    for mine in _portions(block, count):
        part = slice(mine.start, mine.stop)
        whole = weighted[part].toarray().T
        photos, points, shared = np.split(whole, (n * d, n * d + 3 * p))
        photos, points = photos.reshape(n, d, -1), points.reshape(p, 3, -1)
        photos, points, moves[part] = datum.of_gradients(photos, points)
        x, y, s = cofactors.normal.solve(cofactors.factor, photos, points, shared)
        x, y = datum.of_changes(x, y)
        k = len(mine)
        out[:, part] = weighted @ np.concatenate((x.reshape(-1, k), y.reshape(-1, k), s))
    out += (moves * datum.variance) @ moves.T
    return 0.5 * (out + out.T)


def coordinate_cofactors(block: AdjustedBlock, coordinates: Sequence[tuple[int, int]]) -> Array:
    """Return (k, k) cofactors [m^2] of k adjusted coordinates (point, axis), each with each.

    In the datum that the equations were solved in; that is the reported one with datum "control".
    Where distances give a free network its scale, in the reported one, too. Coordinates free of
    error have zeros.
    """
    change = block.cofactors.change
    scaled = change if change is not None and change.gives_scale else None
    at = np.array(coordinates, dtype=np.intp).reshape(-1, 2)
    first = len(block.problem.photos) * block.problem.per_photo
    return function_cofactors(block, _picking(block, first + 3 * at[:, 0] + at[:, 1]), scaled)


def own_parameter_cofactors(block: AdjustedBlock) -> Array:
    """Return the cofactors [mm^2] of all photo-invariant additional parameters, photo by photo."""
    n, d = len(block.problem.photos), block.problem.per_photo
    columns = np.arange(n * d).reshape(n, d)[:, 6:].reshape(-1)
    return function_cofactors(block, _picking(block, columns))


def _picking(block: AdjustedBlock, columns: Index) -> csr_array:
    """Return the functions that are unknowns themselves."""
    problem = block.problem
    count = len(problem.photos) * problem.per_photo + 3 * len(problem.points) + problem.in_border
    k = len(columns)
    return csr_array((np.ones(k), (np.arange(k), columns)), shape=(k, count))
