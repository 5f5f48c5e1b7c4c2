"""Blocks of fourteen kinds from nothing: the minimum is that of the truth, and little is tried."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from startkinds import KINDS, looking_in, measured, with_mismatches

from anaplot.bundle.adjust import adjust_problem
from anaplot.bundle.solve.gaussnewton import NoConvergenceError, find_minimum
from anaplot.bundle.solve.linearised import objective
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start import subblock, vertical
from anaplot.bundle.start.approximate import approximate_ways, doubtful, state_of
from anaplot.bundle.start.resection import resect
from anaplot.bundle.start.vertical import vertical_subblock
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_matrix


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_minimum_is_that_of_the_truth(kind: str) -> None:
    rng = np.random.default_rng(3)
    scene = measured(KINDS[kind](rng, 1), rng)
    problem = make_problem(scene.block)
    start = scene.start(problem)
    true = find_minimum(problem, start, make_structure(problem, start.centres))
    assert adjust_problem(problem).vtpv == pytest.approx(true.convergence.last, rel=1e-9)


def ring(photos: int = 8) -> Problem:
    """Photos all around an object that they see whole."""
    rng = np.random.default_rng(2)
    around, points = 2.0 * np.pi * np.arange(photos) / photos, rng.uniform(-3.0, 3.0, (50, 3))
    return make_problem(
        measured(looking_in(rng, around, np.full(photos, 0.35), 12.0, points), rng).block
    )


def test_a_photo_is_resected_once_where_the_first_seed_is_a_good_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counted: list[int] = []

    def count(*given: object) -> object:
        counted.append(1)
        return resect(*given)

    monkeypatch.setattr(subblock, "resect", count)
    problem = ring()
    state = approximate_ways(problem)[5].find(None)
    assert state is not None
    assert not doubtful(problem, state)
    # two are the seed
    assert len(counted) == len(problem.photos) - 2


# laid level, photos of few rays miss by far; three photos are seen not to be level before
@pytest.mark.parametrize("kind", ["few rays", "three photos"])
def test_photos_that_are_not_plainly_level_are_tried_as_such_last(kind: str) -> None:
    rng = np.random.default_rng(2)
    problem = make_problem(measured(KINDS[kind](rng, 1), rng).block)
    assert vertical_subblock(problem) is not None
    ways = approximate_ways(problem)
    assert ways[3].find(None) is None
    last = ways[-1].find(None)
    assert last is not None
    assert doubtful(problem, last)
    assert ways[-1].find(None) is None


def test_photos_that_few_rays_check_are_not_taken_for_level() -> None:
    rng = np.random.default_rng(266)
    problem = make_problem(measured(KINDS["few rays"](rng, 1), rng).block)
    level = vertical_subblock(problem)
    assert level is not None
    # their unknowns make up for it: half of their rays miss by little
    assert np.median(level.residuals(problem)) < 0.02 * problem.c[0]
    ways = approximate_ways(problem)
    assert ways[3].find(None) is None
    last = ways[-1].find(None)
    assert last is not None
    assert doubtful(problem, last)


@pytest.mark.slow
def test_level_photos_of_points_with_two_rays_are_begun_level() -> None:
    rng = np.random.default_rng(2)
    made = with_mismatches(measured(KINDS["drone"](rng, 1), rng), rng, 0.005)
    control = {row.point for row in made.block.control}
    seen = Counter[str]()
    rows = []
    for k in rng.permutation(len(made.block.image_points)).tolist():
        row = made.block.image_points[k]
        seen[row.point] += 1
        if seen[row.point] <= 2 or row.point in control:
            rows.append(row)
    problem = make_problem(replace(made.block, image_points=tuple(rows)))
    level = vertical_subblock(problem)
    assert level is not None
    assert doubtful(problem, state_of(problem, level))
    start = approximate_ways(problem)[3].find(None)
    # what misses is relief: pairs need not be asked
    assert start is not None
    assert not doubtful(problem, start)


@pytest.mark.parametrize("kind", ["strip", "three photos", "few rays"])
def test_level_photos_are_the_same_by_full_and_by_sparse_equations(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    rng = np.random.default_rng(2)
    problem = make_problem(measured(KINDS[kind](rng, 1), rng).block)
    full = vertical_subblock(problem)
    monkeypatch.setattr(vertical, "_DENSE", 0)
    sparse = vertical_subblock(problem)
    assert full is not None
    assert sparse is not None
    for one, other in zip(
        (full.centres, full.rotations, full.points),
        (sparse.centres, sparse.rotations, sparse.points),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-8 * np.abs(other).max())


def test_a_start_is_given_up_after_as_many_steps_as_asked_for() -> None:
    problem = ring()
    rng = np.random.default_rng(5)
    state = approximate_ways(problem)[5].find(None)
    assert state is not None
    state.centres[:] += rng.normal(0.0, 6.0, state.centres.shape)
    structure = make_structure(problem, state.centres)
    with pytest.raises(NoConvergenceError, match=r"in [0-4] steps") as caught:
        find_minimum(problem, state, structure, tries=4)
    assert objective(problem, caught.value.state)[0] <= objective(problem, state)[0]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("n", [61, 300])
def test_a_photo_of_many_points_of_which_a_third_is_wrong(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation, centre = rotation_matrix(*rng.uniform(-2.0, 2.0, 3)), rng.normal(size=3) * 50.0
    rays = np.column_stack((rng.uniform(-70.0, 70.0, (n, 2)), np.full(n, -100.0)))
    points = centre + (rng.uniform(5.0, 9.0, n)[:, None] * rays) @ rotation.T
    xy = project(
        np.tile(centre, (n, 1)), np.tile(rotation, (n, 1, 1)), np.full(n, 100.0), points
    ).xy
    xy[: n // 3] += rng.uniform(20.0, 60.0, (n // 3, 2))
    found = resect(xy, 100.0, points)
    assert found is not None
    np.testing.assert_allclose(found.centre, centre, atol=1e-2)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-4)
    assert (found.residual[: n // 3] > 20.0).all()
    assert (found.residual[n // 3 :] < 1e-2).all()
