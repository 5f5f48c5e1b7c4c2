"""Which ray of a bad point is the wrong one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS
from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.tested import sigma0_known
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["SuspectRay", "suspect_rays"]

_ALL = 1e-12  # share of the sum of squares that is rounding


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
    rays, q = block.cofactors.point_rays(problem.points.index(point))
    sigma = block.sigma if block.sigma is not None and block.sigma > 0.0 else 1.0
    f = block.redundancy
    estimated = not sigma0_known(problem.test.kind) and bool(block.sigma)
    statistics: list[float | None] = []
    logs = []
    for k, ray in enumerate(rays.tolist()):
        values, axes = np.linalg.eigh(q[2 * k : 2 * k + 2, 2 * k : 2 * k + 2])
        z = axes.T @ block.v[ray] / sigma
        good = values > TESTABLE
        if not good.any():
            statistics.append(None)
            logs.append(0.0)
            continue
        g = ERROR_PRIOR_SIGMAS**2 * values[good]
        size = z[good] ** 2 / values[good]
        statistics.append(float(size.sum()))
        explained = float((size * g / (1.0 + g)).sum())
        if estimated:
            # the sum of squares that an error here would leave; more than all cannot be explained
            explained = -f * float(np.log1p(-min(explained / f, 1.0 - _ALL)))
        logs.append(0.5 * (explained - float(np.log1p(g).sum())))
    weights = np.exp(np.array(logs) - max(logs))
    weights /= weights.sum()
    found = [
        SuspectRay(
            problem.photos[problem.photo[ray]],
            problem.block.image_points[problem.source[ray]].model,
            statistic,
            weight,
        )
        for ray, statistic, weight in zip(rays.tolist(), statistics, weights.tolist(), strict=True)
    ]
    found.sort(key=lambda ray: -ray.probability)
    return tuple(found)
