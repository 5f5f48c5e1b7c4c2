"""Cofactors between unknowns anywhere in a block: one right-hand side for each of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = [
    "Sides",
    "coordinate_cofactors",
    "empty_sides",
    "own_parameter_cofactors",
    "side_products",
]

Sides = tuple[Array, Array, Array]
"""k right-hand sides: photos (n, d, k), points (p, 3, k) and shared parameters (g, k)."""

_BYTES = 300_000_000  # of the largest array while a portion is solved


def side_products(block: AdjustedBlock, count: int, sides: Callable[[range], Sides]) -> Array:
    """Return (k, k) S' N^-1 S of right-hand sides S, solved in portions.

    Parameters
    ----------
    block
        The adjusted block; in the datum of its solution.
    count
        Number of sides k.
    sides
        Called with a range of them.
    """
    cofactors = block.cofactors
    normal = cofactors.normal
    # the largest array of a solution has a value per ray, unknown of its photo, and side
    step = max(1, _BYTES // (8 * len(block.problem.photo) * block.problem.per_photo))
    out = np.zeros((count, count))
    portions = [range(k, min(k + step, count)) for k in range(0, count, step)]
    for mine in portions:
        own = sides(mine)
        solved = normal.solve(cofactors.factor, *own)
        for other in portions:
            if other.start < mine.start:
                continue
            left = own if other is mine else sides(other)
            product = np.zeros((len(other), len(mine)))
            for a, b in zip(left, solved, strict=True):
                product += a.reshape(-1, len(other)).T @ b.reshape(-1, len(mine))
            out[other.start : other.stop, mine.start : mine.stop] = product
            out[mine.start : mine.stop, other.start : other.stop] = product.T
    return 0.5 * (out + out.T)


def empty_sides(block: AdjustedBlock, count: int) -> Sides:
    """Return right-hand sides of zeros, to be filled."""
    problem = block.problem
    return (
        np.zeros((len(problem.photos), problem.per_photo, count)),
        np.zeros((len(problem.points), 3, count)),
        np.zeros((problem.in_border, count)),
    )


def coordinate_cofactors(block: AdjustedBlock, coordinates: Sequence[tuple[int, int]]) -> Array:
    """Return (k, k) cofactors [m^2] of k adjusted coordinates (point, axis), each with each.

    In the datum that the equations were solved in; that is the reported one with datum "control".
    Where distances give a free network its scale, in the reported one, too. Coordinates free of
    error have zeros.
    """
    change = block.cofactors.change
    scaled = change if change is not None and change.gives_scale else None

    def sides(mine: range) -> Sides:
        photos, points, shared = empty_sides(block, len(mine))
        for column, k in enumerate(mine):
            point, axis = coordinates[k]
            points[point, axis, column] = 0.0 if block.problem.fixed[point, axis] else 1.0
        return photos, points if scaled is None else scaled.of_functions(points)[0], shared

    found = side_products(block, len(coordinates), sides)
    if scaled is not None:
        at = np.array(coordinates, dtype=np.intp).reshape(-1, 2)
        moves = scaled.null_points[at[:, 0], at[:, 1]] @ np.linalg.inv(scaled.defect)
        found += (moves * scaled.variance) @ moves.T
    return found


def own_parameter_cofactors(block: AdjustedBlock) -> Array:
    """Return the cofactors [mm^2] of all photo-invariant additional parameters, photo by photo."""
    q = block.problem.per_photo - 6

    def sides(mine: range) -> Sides:
        photos, points, shared = empty_sides(block, len(mine))
        for column, k in enumerate(mine):
            photo, index = divmod(k, q)
            photos[photo, 6 + index, column] = 1.0
        return photos, points, shared

    return side_products(block, len(block.problem.photos) * q, sides)
