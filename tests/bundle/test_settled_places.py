"""A photo and its points adjusted from many places side by side, while all other photos stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import Scene, aerial

from anaplot.bundle.solve.gaussnewton import Minimum, find_minimum
from anaplot.bundle.solve.linearised import objective
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start.photoplaces import points_from, seen_by, with_points_of
from anaplot.bundle.start.settledplaces import Places, settled_places
from anaplot.bundle.start.subblock import SubBlock, unit_rays
from anaplot.photogrammetry.rotation import rotation_matrix

PHOTO = 2


def adjusted(scene: Scene) -> tuple[Problem, Minimum]:
    problem = make_problem(scene.block)
    start = scene.start(problem)
    return problem, find_minimum(problem, start, make_structure(problem, start.centres))


def around(problem: Problem, found: Minimum, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places of a photo not far from where it is."""
    rng = np.random.default_rng(1)
    state = found.state
    away = 0.1 * float(np.linalg.norm(state.points.mean(axis=0) - state.centres[PHOTO]))
    centres = state.centres[PHOTO] + rng.uniform(-away, away, (count, 3))
    turned = [rotation_matrix(*rng.uniform(-0.1, 0.1, 3)) for _ in range(count)]
    return centres, np.array(turned) @ state.rotations[PHOTO]


@pytest.mark.parametrize("control_sigma", [0.0, 0.05])
def test_a_photo_returns_to_where_it_was(control_sigma: float) -> None:
    """All rays and the control of its points are in what it minimises, as in the block."""
    scene = aerial(2, 3, relief=30.0, control_sigma=control_sigma, noise_um=5.0, seed=4)
    problem, found = adjusted(scene)
    names = np.unique(problem.point[problem.photo == PHOTO])
    assert problem.fixed[names].any() == (control_sigma == 0.0)
    at = around(problem, found, 5)
    start = Places(*at, points_from(problem, found.state, unit_rays(problem), PHOTO, at))
    settled, more = settled_places(problem, found.state, PHOTO, start, names)
    state = found.state
    # a step that brings less than a thousandth of v'Pv is the last
    assert np.all(np.abs(more) < 1e-3 * found.convergence.last)
    assert np.all(np.diff(more) >= 0.0)
    assert np.abs(settled.centres - state.centres[PHOTO]).max() < 0.5
    assert np.abs(settled.rotations - state.rotations[PHOTO]).max() < 1e-3
    fixed = problem.fixed[names]
    assert np.array_equal(settled.points[:, fixed], np.tile(state.points[names][fixed], (5, 1)))


def test_what_is_more_is_that_of_the_block() -> None:
    """Also where coordinates are rejected: v'Pv of what does not touch the photo stays."""
    problem, found = adjusted(aerial(2, 3, relief=30.0, noise_um=5.0, seed=5))
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    rejected[np.flatnonzero(problem.photo == PHOTO)[:2]] = (True, False), (True, True)
    problem = replace(problem, rejected=rejected)
    state, rng = found.state, np.random.default_rng(2)
    names = np.unique(problem.point[problem.photo == PHOTO])
    centres = state.centres[PHOTO] + rng.normal(0.0, 200.0, (4, 3))
    rotations = np.tile(state.rotations[PHOTO], (4, 1, 1))
    points = np.tile(state.points[names], (4, 1, 1))
    start = Places(centres, rotations, points)
    settled, more = settled_places(problem, state, PHOTO, start, names)
    before = objective(problem, state)[0]
    for centre, rotation, there, by in zip(*settled, more.tolist(), strict=True):
        moved = replace(
            state,
            centres=state.centres.copy(),
            rotations=state.rotations.copy(),
            points=state.points.copy(),
        )
        moved.centres[PHOTO], moved.rotations[PHOTO] = centre, rotation
        moved.points[names] = there
        assert objective(problem, moved)[0] - before == pytest.approx(by, rel=1e-9, abs=1e-6)


def test_points_from_many_places_are_those_from_each() -> None:
    """Side by side the scale of what rays miss is common, so that rays without noise agree."""
    problem, found = adjusted(aerial(2, 3, relief=30.0, noise_um=0.0, seed=6))
    state, rays = found.state, unit_rays(problem)
    names = np.unique(problem.point[problem.photo == PHOTO])
    here = state.centres[[PHOTO, PHOTO]], state.rotations[[PHOTO, PHOTO]]
    both = points_from(problem, state, rays, PHOTO, here)
    block = SubBlock(state.centres, state.rotations, state.points)
    seen = seen_by(problem, np.array([PHOTO]))
    alone = with_points_of(problem, state, block, rays, seen).points[names]
    assert np.allclose(both, alone, rtol=0.0, atol=1e-6)
