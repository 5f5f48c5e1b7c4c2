"""Which ray of a bad point is the wrong one."""

from __future__ import annotations

from math import log, sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import f_test
from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS, NONE_PRIOR
from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.tested import sigma0_known
from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.imagepoints import columns_of

__all__ = ["SuspectRay", "explained", "suspect_rays"]

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


def suspect_rays(block: AdjustedBlock, point: str) -> tuple[SuspectRay, ...]:
    """Weigh the rays of a point against each other, the most probable first.

    An error of a ray is normal in x and in y, 20 standard deviations wide (conventions, Odds); with
    the eigenvalues q of its 2 x 2 cofactors of residuals and z the residuals along the axes,
    log BF = sum (-log(1 + g) / 2 + z^2 / q g / (1 + g) / 2), g = 400 q, where sigma is known;
    where it is estimated from f redundancies, sum (-log(1 + g) / 2) - f / 2 log(1 - sum (z^2 / q
    g / (1 + g)) / f).

    Raises
    ------
    ValueError
        The point is not in the block.
    """
    problem = block.problem
    weighed = _weigh(block, point)
    logs = np.array(weighed.logs)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    models = columns_of(problem.block.image_points).model
    found = [
        SuspectRay(
            problem.photos[problem.photo[ray]],
            models.at(problem.source[ray]),
            statistic,
            weight,
        )
        for ray, statistic, weight in zip(
            weighed.rays, weighed.statistics, weights.tolist(), strict=True
        )
    ]
    found.sort(key=lambda ray: -ray.probability)
    return tuple(found)


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
    weighed = _weigh(block, point)
    worst = int(np.argmax(weighed.logs))
    if not _agree(block, weighed, weighed.statistics[worst] or 0.0, weighed.ranks[worst]):
        return 0.0
    # the other rays of the point share what speaks against chance
    none = log(NONE_PRIOR / (1.0 - NONE_PRIOR) * len(block.problem.photo))
    return float(1.0 / (1.0 + np.exp(min(none - float(np.logaddexp.reduce(weighed.logs)), 700.0))))


def _agree(block: AdjustedBlock, weighed: _Weighed, square: float, rank: int) -> bool:
    """Whether the other rays of a point agree without one that explains so much of its squares."""
    squares, values = _squares(weighed.q, weighed.v.ravel())
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
    """The rays of a point.

    Attributes
    ----------
    rays
        Which of the block's they are.
    statistics, ranks
        v' Q_vv^-1 v / sigma^2 of each, None when nothing checks it, and how many independent
        residuals it has.
    logs
        Logarithms of their Bayes factors against no error.
    q, v
        (2k, 2k) cofactors of the residuals of all of them, and (k, 2) the residuals by sigma.
    sigma, estimated
        The sigma that was used, and whether it is an estimated one.
    """

    rays: list[int]
    statistics: list[float | None]
    ranks: list[int]
    logs: list[float]
    q: Array
    v: Array
    sigma: float
    estimated: bool


def _weigh(block: AdjustedBlock, point: str) -> _Weighed:
    problem = block.problem
    rays, q = block.cofactors.point_rays(block.point_number(point))
    sigma = block.sigma if block.sigma is not None and block.sigma > 0.0 else 1.0
    f = block.redundancy
    estimated = not sigma0_known(problem.test.kind) and bool(block.sigma)
    v, each = block.v[rays] / sigma, np.arange(len(rays))
    squares, values = _squares(q.reshape(len(rays), 2, -1, 2)[each, :, each], v)
    g = ERROR_PRIOR_SIGMAS**2 * values
    shares = (squares * g / (1.0 + g)).sum(axis=1)
    if estimated:
        # the sum of squares that an error here would leave; more than all cannot be explained
        shares = -f * np.log1p(-np.minimum(shares / f, 1.0 - _ALL))
    ranks = (values > 0.0).sum(axis=1).tolist()
    sizes = squares.sum(axis=1).tolist()
    return _Weighed(
        rays.tolist(),
        [size if rank else None for size, rank in zip(sizes, ranks, strict=True)],
        ranks,
        (0.5 * (shares - np.log1p(g).sum(axis=1))).tolist(),
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
