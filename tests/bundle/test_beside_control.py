"""Blocks whose robust solution has drawn control along, and lies elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import Scene
from startkinds import Layout, looking_at, measured

from anaplot.bundle.solve.gaussnewton import NoConvergenceError
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start import bestminimum
from anaplot.bundle.start.approximate import Way, approximate_ways
from anaplot.bundle.start.robust import RobustState, robust_state
from anaplot.photogrammetry.block import Camera

_LEVEL = 3  # of the ways: photos taken for vertical ones


def wall(seed: int) -> Scene:
    """Three rows of photos of a wall, with 3 % of the rays at another point of their photo."""
    rng = np.random.default_rng(seed)
    x, z = (g.ravel() for g in np.meshgrid(np.arange(5) * 3.0, np.arange(3) * 4.0 + 1.7))
    n, p = len(x), 300
    centres = np.column_stack((x, -12.0 + rng.normal(0.0, 0.4, n), z))
    aims = np.column_stack((x + rng.normal(0.0, 1.5, n), np.zeros(n), z + rng.normal(0.0, 1.0, n)))
    depth = rng.choice([0.0, 0.6, -0.4], p) + rng.normal(0.0, 0.05, p)
    points = np.column_stack(
        (rng.uniform(-6.0, x.max() + 6.0, p), depth, rng.uniform(0.0, 14.0, p))
    )
    camera = Camera("px", 4.0, pixels=(4000, 4000))
    scene = measured(
        Layout(
            centres,
            looking_at(centres, aims),
            points,
            cameras=(camera,),
            half=0.49,
            share=0.5,
            control=(6, 0.005),
        ),
        rng,
    )
    rows = list(scene.block.image_points)
    for k in np.flatnonzero(rng.random(len(rows)) < 0.03).tolist():
        others = [row for row in rows if row.photo == rows[k].photo]
        other = others[int(rng.integers(len(others)))]
        rows[k] = replace(rows[k], x=other.x, y=other.y)
    return replace(scene, block=replace(scene.block, image_points=tuple(rows)))


def begun(problem: Problem) -> tuple[BlockState, RobustState]:
    """Return the photos as vertical ones, and the robust solution from there."""
    start = approximate_ways(problem)[_LEVEL].find(None)
    assert start is not None
    return start, robust_state(problem, make_structure(problem, start.centres), start)


def off_by(scene: Scene, problem: Problem, state: BlockState) -> float:
    """Return by how much the worst projection centre is off [m]."""
    true = np.array([scene.centres[name] for name in problem.photos]) - state.origin
    return float(np.linalg.norm(state.centres - true, axis=1).max())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4])
def test_a_block_beside_its_control_is_laid_onto_it_from_its_robust_solution(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = wall(seed)
    problem = make_problem(scene.block)
    start, solution = begun(problem)
    assert solution.beside
    assert solution.orients(problem)
    assert off_by(scene, problem, solution.state) > 10.0
    monkeypatch.setattr(bestminimum, "approximate_ways", lambda _: [Way(lambda _: start)])
    # gross errors tear every minimum: the search for them begins where the best solution is
    with pytest.raises(NoConvergenceError) as failure:
        bestminimum.best_minimum(problem, None, problem)
    assert off_by(scene, problem, failure.value.state) < 0.1


def test_where_photos_are_oriented_control_tells_more_than_a_few_rays() -> None:
    problem = make_problem(wall(0).block)
    _, beside = begun(problem)
    grounded = beside._replace(rays_off=beside.rays_off + 4, beside=False)
    assert grounded.better_than(beside, problem)
    assert not beside.better_than(grounded, problem)
    # but not where photos lie wrongly
    astray = grounded._replace(most_off=0.5)
    assert beside.better_than(astray, problem)
    assert not astray.better_than(beside, problem)
    fewer = grounded._replace(rays_off=beside.rays_off)
    assert fewer.better_than(grounded, problem)
    assert not fewer.better_than(fewer, problem)
