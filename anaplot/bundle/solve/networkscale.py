"""How well distances determine the scale of a free network."""

from __future__ import annotations

from math import sqrt

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["scale_deviation"]


def scale_deviation(block: AdjustedBlock) -> float | None:
    """Return the standard deviation of the relative scale of all points; None without one.

    Of the enlargement about their middle that fits changes of the points best: the distances' own
    errors are in it, and what images let the points between them be off by.
    """
    change, problem = block.cofactors.change, block.problem
    if change is None or not change.gives_scale or block.sigma is None:
        return None
    away = block.state.points - block.state.points.mean(axis=0)
    gradient = (away / float(np.vdot(away, away)))[:, :, None]
    held, moves = change.of_functions(gradient)
    photos = np.zeros((len(problem.photos), problem.per_photo, 1))
    shared = np.zeros((problem.in_border, 1))
    moved = block.cofactors.normal.solve(block.cofactors.factor, photos, held, shared)[1]
    variance = float(np.vdot(held, moved)) + float((moves**2 * change.variance).sum())
    return block.sigma * sqrt(max(variance, 0.0))
