"""Which ray of a point is wrong: accused as often rightly as is said."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from bundleblocks import aerial
from denseblock import dense, dense_inverse

from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.errors.wrongray import suspect_rays
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.block import TestSettings


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_a_ray_is_accused_as_often_rightly_as_is_said(kind) -> None:
    scene = aerial(1, 3, per_base=1, control_sigma=0.05, test=TestSettings(kind=kind))
    problem = make_problem(scene.block)
    block = adjust_bundle(problem, scene.start(problem))
    design, free = dense(block)
    observed = np.any(design != 0.0, axis=1)
    residual = np.eye(len(design)) - design @ dense_inverse(design, free) @ design.T
    m = len(problem.photo)
    rng = np.random.default_rng(78)
    rays = np.bincount(problem.point)
    point = int(np.argmax(rays))
    mine = np.nonzero(problem.point == point)[0]
    runs, claimed, right = 1500, [], []
    for _ in range(runs):
        wrong = int(rng.choice(mine))
        e = rng.normal(size=len(design)) * observed
        e[2 * wrong : 2 * wrong + 2] += 20.0 * rng.normal(size=2)
        vtpv = float(e @ residual @ e)
        found = suspect_rays(
            replace(
                block,
                v=(residual @ e)[: 2 * m].reshape(m, 2),
                vtpv=vtpv,
            ),
            problem.points[point],
        )
        claimed.append(found[0].probability)
        right.append(found[0].photo == problem.photos[problem.photo[wrong]])
    said = np.array(claimed)
    doubtful = said < 0.99
    assert doubtful.sum() > 50
    for some in (doubtful, ~doubtful):
        # right as often as is said: 3.3 deviations, and what rounding makes of certainty
        room = 3.3 * sqrt(np.sum(said[some] * (1.0 - said[some]))) + 1.0
        assert abs(np.sum(np.array(right)[some] - said[some])) < room
