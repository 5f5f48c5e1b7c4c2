"""Which ray of a point is wrong: accused as often rightly as is said."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import NamedTuple

import numpy as np
import pytest
from bundleblocks import aerial
from denseblock import dense, dense_inverse

from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.errors.wrongray import explained, suspect_rays_of
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.block import TestSettings


class Adjusted(NamedTuple):
    """A strip of three photos, and (n, n) what its residuals are of its errors."""

    block: AdjustedBlock
    residual: np.ndarray
    observed: np.ndarray

    @classmethod
    def of(cls, kind) -> Adjusted:
        scene = aerial(1, 3, per_base=1, control_sigma=0.05, test=TestSettings(kind=kind))
        problem = make_problem(scene.block)
        block = adjust_bundle(problem, scene.start(problem))
        design, free = dense(block)
        residual = np.eye(len(design)) - design @ dense_inverse(design, free) @ design.T
        return cls(block, residual, np.any(design != 0.0, axis=1))

    def with_errors(self, e: np.ndarray) -> AdjustedBlock:
        """Return the block whose rows err by e [sigma]."""
        v = self.residual @ e
        return replace(self.block, v=v[: self.block.v.size].reshape(-1, 2), vtpv=float(e @ v))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_a_ray_is_accused_as_often_rightly_as_is_said(kind) -> None:
    adjusted = Adjusted.of(kind)
    problem = adjusted.block.problem
    rng = np.random.default_rng(78)
    rays = np.bincount(problem.point)
    point = int(np.argmax(rays))
    mine = np.nonzero(problem.point == point)[0]
    runs, claimed, right = 1500, [], []
    for _ in range(runs):
        wrong = int(rng.choice(mine))
        e = rng.normal(size=len(adjusted.residual)) * adjusted.observed
        e[2 * wrong : 2 * wrong + 2] += 20.0 * rng.normal(size=2)
        name = problem.points[point]
        found = suspect_rays_of(adjusted.with_errors(e), (name,))[name]
        claimed.append(found[0].probability)
        right.append(found[0].photo == problem.photos[problem.photo[wrong]])
    said = np.array(claimed)
    doubtful = said < 0.99
    assert doubtful.sum() > 50
    for some in (doubtful, ~doubtful):
        # right as often as is said: 3.3 deviations, and what rounding makes of certainty
        room = 3.3 * sqrt(np.sum(said[some] * (1.0 - said[some]))) + 1.0
        assert abs(np.sum(np.array(right)[some] - said[some])) < room


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_one_wrong_ray_explains_what_shows_and_chance_or_two_wrong_ones_do_not(kind) -> None:
    adjusted = Adjusted.of(kind)
    problem = adjusted.block.problem
    m = len(problem.photo)
    rng = np.random.default_rng(79)
    point = int(np.argmax(np.bincount(problem.point)))
    mine = np.nonzero(problem.point == point)[0]
    assert len(mine) == 3

    def said(wrong: int) -> float:
        """What is said where so many rays are wrong by 30 to 60 standard deviations."""
        e = rng.normal(size=len(adjusted.residual)) * adjusted.observed
        for ray in rng.choice(mine, wrong, replace=False):
            angle = rng.uniform(0.0, 2.0 * np.pi)
            size = rng.uniform(30.0, 60.0)
            e[2 * ray : 2 * ray + 2] += size * np.array([np.cos(angle), np.sin(angle)])
        return explained(adjusted.with_errors(e), problem.points[point])

    runs = 400
    # a Bayes factor has the mean 1 where nothing is wrong, so that it exceeds 99 * 9 * m / 3 in one
    # of more than 5 000 runs at most (Markov)
    assert m > 17
    assert sum(said(0) > 0.99 for _ in range(runs)) <= 1
    # the others do not agree by chance once in a thousand: 3 or more of 400 once in a hundred
    assert sum(said(1) == 0.0 for _ in range(runs)) <= 2
    # of three residuals of the point one ray takes two; what is left shows unless it is below 4.3,
    # the root of the F of 1 and 12 degrees of freedom, of 30 and more: in one direction of ten
    assert sum(said(2) > 0.99 for _ in range(runs)) < 0.1 * runs


def test_what_is_explained_is_summed_over_all_rays_of_the_point() -> None:
    adjusted = Adjusted.of("baarda")
    problem, residual = adjusted.block.problem, adjusted.residual
    m = len(problem.photo)
    control = {known.point for known in problem.block.control}
    twice = np.nonzero(np.bincount(problem.point) == 2)[0].tolist()
    point = next(p for p in twice if problem.points[p] not in control)
    mine = np.nonzero(problem.point == point)[0]
    e = np.zeros(len(residual))
    e[2 * mine[0] + 1] = 8.0
    wrong = adjusted.with_errors(e)
    factors = []
    for ray in mine:
        # two rays are checked in one direction: the eigenvector of the only eigenvalue
        values, axes = np.linalg.eigh(residual[2 * ray : 2 * ray + 2, 2 * ray : 2 * ray + 2])
        q, z = values[1], axes[:, 1] @ wrong.v[ray]
        g = 400.0 * q
        factors.append(float(np.exp(z * z / q * g / (1.0 + g) / 2.0) / np.sqrt(1.0 + g)))
    said = explained(wrong, problem.points[point])
    assert said == pytest.approx(sum(factors) / (sum(factors) + 9.0 * m))
    # which of them it is is another question
    assert max(factors) / sum(factors) == pytest.approx(0.5, abs=0.01)
    assert said > 0.85


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_several_points_are_weighed_as_each_by_itself(kind) -> None:
    scene = aerial(2, 4, per_base=1, noise_um=5.0, control_sigma=0.05, test=TestSettings(kind=kind))
    block = adjust_block(scene.block)
    names = block.problem.points[::-1]
    assert len(set(np.bincount(block.problem.point))) > 2
    found = suspect_rays_of(block, names)
    assert tuple(found) == names
    for name in names:
        one = suspect_rays_of(block, (name,))[name]
        assert [ray[:2] for ray in found[name]] == [ray[:2] for ray in one]
        weights = [ray.probability for ray in found[name]]
        assert weights == pytest.approx([ray.probability for ray in one], rel=1e-12)
        assert sum(weights) == pytest.approx(1.0)
