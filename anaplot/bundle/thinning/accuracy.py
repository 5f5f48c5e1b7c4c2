"""What thinning does to standard deviations: both adjustments in one datum, for one sigma0."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import anchor, datum_change
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.thinning.thinning import Thinning

__all__ = ["Deviations", "deviations"]


class Deviations(NamedTuple):
    """Standard deviations for the a-priori sigma0, before and after.

    Attributes
    ----------
    positions, angles
        (2, n) of the photos [m, rad]: the root mean square of three.
    points
        (2, k) of the points that are left [m], likewise; free of error: zero.
    """

    positions: Array
    angles: Array
    points: Array


def deviations(thinning: Thinning) -> Deviations:
    """Return standard deviations of a block with all its points and of the thinned one.

    Where the datum is none of control, that of the block with all points is laid through what is
    left: inner constraints over the points that both have, or what the thinned block holds.

    Parameters
    ----------
    thinning
        The thinned block and what it was.
    """
    before, after = thinning.before, thinning.block
    number = {name: k for k, name in enumerate(before.problem.points)}
    common = np.array([number[name] for name in after.problem.points], dtype=np.intp)
    each = [_rooted(_in_same_datum(before, after, common), common)]
    each.append(_rooted(after.cofactors, np.arange(len(common))))
    return Deviations(*(np.stack(pair) for pair in zip(*each, strict=True)))


def _in_same_datum(before: AdjustedBlock, after: AdjustedBlock, common: Index) -> Cofactors:
    problem = before.problem
    if problem.defect == 0 or before is after:
        return before.cofactors
    change = datum_change(problem, before.state, anchor(after.problem, after.state))
    apart = np.ones(len(problem.points), dtype=bool)
    apart[common] = False
    held = np.where(apart[:, None, None], 0.0, change.held_points)
    normal, factor = before.cofactors.normal, before.cofactors.factor
    return compute_cofactors(normal, factor, replace(change, held_points=held))


def _rooted(cofactors: Cofactors, points: Index) -> tuple[Array, Array, Array]:
    photos = np.einsum("nii->ni", cofactors.photos)
    of_points = np.einsum("nii->ni", cofactors.points)[points]
    parts = photos[:, :3], photos[:, 3:6], of_points
    x, angles, y = (np.sqrt(np.maximum(part, 0.0).mean(axis=1)) for part in parts)
    return x, angles, y
