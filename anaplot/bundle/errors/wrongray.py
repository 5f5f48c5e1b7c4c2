"""Which ray of a bad point is the wrong one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import log, sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import f_test
from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS, NONE_PRIOR
from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.tested import sigma0_known
from anaplot.aliases import Array, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.imagepoints import columns_of

__all__ = ["SuspectRay", "explained", "suspect_rays_of"]

_ALL = 1e-12  # share of the sum of squares that is rounding
_CHANCE = 1e-3  # below, it was not by chance that the other rays do not agree


class SuspectRay(NamedTuple):
    """A ray of a point and how probable it is that this one is wrong.

    Attributes
    ----------
    photo, model
        The ray.
    statistic
        v' Q_vv^-1 v / sigma^2 of x and y together: Baarda's test of a group; None when nothing
        checks the ray.
    probability
        That this ray holds the error, given that one ray of the point does.
    """

    photo: str
    model: str | None
    statistic: float | None
    probability: float


def suspect_rays_of(
    block: AdjustedBlock, points: Iterable[str]
) -> dict[str, tuple[SuspectRay, ...]]:
    """Weigh the rays of each of several points against each other, the most probable first.

    An error of a ray is normal in x and in y, 20 standard deviations wide (conventions, Odds); with
    the eigenvalues q of its 2 x 2 cofactors of residuals and z the residuals along the axes,
    log BF = sum (-log(1 + g) / 2 + z^2 / q g / (1 + g) / 2), g = 400 q, where sigma is known;
    where it is estimated from f redundancies, sum (-log(1 + g) / 2) - f / 2 log(1 - sum (z^2 / q
    g / (1 + g)) / f).

    Raises
    ------
    ValueError
        A point is not in the block.
    """
    problem = block.problem
    names = {block.point_number(point): point for point in points}
    models = columns_of(problem.block.image_points).model
    out: dict[str, tuple[SuspectRay, ...]] = dict.fromkeys(names.values(), ())
    for weighed in _weigh(block, tuple(names)):
        weights = np.exp(weighed.logs - weighed.logs.max(axis=1, keepdims=True))
        weights /= weights.sum(axis=1, keepdims=True)
        for k, point in enumerate(weighed.points.tolist()):
            rays = weighed.rays[k]
            found = [
                SuspectRay(
                    problem.photos[photo], models.at(row), size if rank else None, probability
                )
                for photo, row, size, rank, probability in zip(
                    problem.photo[rays].tolist(),
                    problem.source[rays].tolist(),
                    weighed.statistics[k].tolist(),
                    weighed.ranks[k].tolist(),
                    weights[k].tolist(),
                    strict=True,
                )
            ]
            found.sort(key=lambda ray: -ray.probability)
            out[names[point]] = tuple(found)
    return out


def explained(block: AdjustedBlock, point: str) -> float:
    """Return how probable it is that an error of one ray of a point, whichever, is what shows.

    Against none at all, with the prior of conventions (Odds) shared by all rays of the block. 0
    where the others do not agree without the most probable one either: by the sum of squares that
    is left of the point's, chi-square where sigma is known, else against that of all other
    observations, F. Then more than one is wrong, as where another detail was taken for the point in
    a model.

    Raises
    ------
    ValueError
        The point is not in the block.
    """
    weighed = next(_weigh(block, (block.point_number(point),)))
    logs = weighed.logs[0]
    worst = int(np.argmax(logs))
    square, rank = float(weighed.statistics[0, worst]), int(weighed.ranks[0, worst])
    if not _agree(block, weighed, square, rank):
        return 0.0
    # the other rays of the point share what speaks against chance
    none = log(NONE_PRIOR / (1.0 - NONE_PRIOR) * len(block.problem.photo))
    return float(1.0 / (1.0 + np.exp(min(none - float(np.logaddexp.reduce(logs)), 700.0))))


def _agree(block: AdjustedBlock, weighed: _Weighed, square: float, rank: int) -> bool:
    """Whether the other rays of a point agree without one that explains so much of its squares."""
    squares, values = _squares(weighed.q[0], weighed.v[0].ravel())
    every, known = float(squares.sum()), int((values > 0.0).sum())
    free = known - rank
    if free < 1:
        return True
    left = max(every - square, 0.0)
    if not weighed.estimated:
        return not f_test(left, free, alpha=_CHANCE).rejected
    elsewhere = block.redundancy - known
    rest = block.vtpv / weighed.sigma**2 - every
    if elsewhere < 1 or rest <= 0.0:
        return True  # nothing else says how large sigma is
    sigma = sqrt(rest / elsewhere)
    return not f_test(left, free, alpha=_CHANCE, sigma=sigma, redundancy=elsewhere).rejected


class _Weighed(NamedTuple):
    """The rays of p points that have k each.

    Attributes
    ----------
    points, rays
        (p,) and (p, k): which of the block's they are.
    statistics, ranks
        (p, k) v' Q_vv^-1 v / sigma^2 of each, and how many independent residuals it has: 0 where
        nothing checks it.
    logs
        (p, k) logarithms of their Bayes factors against no error.
    q, v
        (p, 2k, 2k) cofactors of the residuals of all of a point, and (p, k, 2) the residuals by
        sigma.
    sigma, estimated
        The sigma that was used, and whether it is an estimated one.
    """

    points: Index
    rays: Index
    statistics: Array
    ranks: Index
    logs: Array
    q: Array
    v: Array
    sigma: float
    estimated: bool


def _weigh(block: AdjustedBlock, points: Sequence[int]) -> Iterator[_Weighed]:
    """Yield the rays of some points, those with as many together."""
    sigma = block.sigma if block.sigma is not None and block.sigma > 0.0 else 1.0
    f = block.redundancy
    estimated = not sigma0_known(block.problem.test.kind) and bool(block.sigma)
    for some, rays, q in block.cofactors.several_rays(points):
        p, k = rays.shape
        v, each = block.v[rays] / sigma, np.arange(k)
        own = q.reshape(p, k, 2, k, 2)[:, each, :, each].swapaxes(0, 1)
        squares, values = _squares(own, v)
        g = ERROR_PRIOR_SIGMAS**2 * values
        shares = (squares * g / (1.0 + g)).sum(axis=2)
        if estimated:
            # the squares that an error here would leave; more than all cannot be explained
            shares = -f * np.log1p(-np.minimum(shares / f, 1.0 - _ALL))
        yield _Weighed(
            some,
            rays,
            squares.sum(axis=2),
            (values > 0.0).sum(axis=2),
            0.5 * (shares - np.log1p(g).sum(axis=2)),
            q,
            v,
            sigma,
            estimated,
        )


def _squares(q: Array, v: Array) -> tuple[Array, Array]:
    """Return z^2 / q of residuals v (..., n) along the axes of cofactors q (..., n, n), and q.

    Both are 0 along axes that cannot be tested.
    """
    values, axes = np.linalg.eigh(q)
    good = values > TESTABLE
    z = np.matmul(v[..., None, :], axes)[..., 0, :]
    return np.where(good, z**2 / np.where(good, values, 1.0), 0.0), np.where(good, values, 0.0)
