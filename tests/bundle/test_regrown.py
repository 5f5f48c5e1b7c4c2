"""Parts of weakly tied strips that a far ray has torn off grow again where they belong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grossblocks import mismatched, planned, weak
from scipy.spatial.transform import Rotation

from anaplot.bundle.adjust import adjust_problem
from anaplot.bundle.errors.misfits import adjust_without_misfits
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.start.regrown import regrown
from anaplot.photogrammetry.rotation import rotation_matrix


def test_a_turned_half_of_a_strip_comes_back() -> None:
    problem, state = weak()
    away = np.array([name in ("101", "102", "103") for name in problem.photos])
    turn, middle = rotation_matrix(0.0, 0.4, 1.0), state.centres[away].mean(axis=0)
    centres, rotations, points = state.centres.copy(), state.rotations.copy(), state.points.copy()
    centres[away] = (centres[away] - middle) @ turn.T + middle + 900.0
    rotations[away] = turn @ rotations[away]
    # the points that only these photos see have gone with them
    elsewhere = np.bincount(problem.point[~away[problem.photo]], minlength=len(points)) > 0
    points[~elsewhere] = (points[~elsewhere] - middle) @ turn.T + middle + 900.0
    again = regrown(problem, replace(state, centres=centres, rotations=rotations, points=points))
    assert again is not None
    off = again.centres + again.origin - state.centres - state.origin
    # of a base of 1 km
    assert float(np.linalg.norm(off, axis=1).max()) < 40.0
    assert float(np.abs(again.rotations - state.rotations).max()) < 0.05


def test_what_holds_together_or_nowhere_is_left() -> None:
    problem, state = weak()
    assert regrown(problem, state) is None
    rng = np.random.default_rng(1)
    assert regrown(problem, replace(state, centres=rng.permutation(state.centres))) is None


def test_a_photo_turned_about_a_line_of_its_points_ties_nothing() -> None:
    problem, state = weak()
    photo = problem.photos.index("204")
    rays = np.bincount(problem.point, minlength=len(problem.points))
    mine = problem.point[problem.photo == photo]
    along = np.abs(state.points[mine] - state.centres[photo])[:, 0]
    line = mine[(along < 60.0) & (rays[mine] > 2)]
    assert len(line) > 2
    about = state.points[line].mean(axis=0)
    axis = state.points[line[-1]] - state.points[line[0]]
    turn = Rotation.from_rotvec(0.1 * axis / np.linalg.norm(axis)).as_matrix()
    centres, rotations = state.centres.copy(), state.rotations.copy()
    centres[photo] = turn @ (centres[photo] - about) + about
    rotations[photo] = turn @ rotations[photo]
    away = float(np.linalg.norm(centres - state.centres, axis=1).max())
    again = regrown(problem, replace(state, centres=centres, rotations=rotations))
    assert again is not None
    off = again.centres + again.origin - state.centres - state.origin
    assert float(np.linalg.norm(off, axis=1).max()) < away / 10.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 13])
def test_a_block_of_weak_strips_of_which_one_ray_in_a_hundred_is_far_off(seed: int) -> None:
    clean = planned(seed, strips=4, photos=15)
    block, wrong = mismatched(clean, 7, seed)
    found = adjust_without_misfits(make_problem(block))
    true = adjust_problem(make_problem(clean)).state
    off = found.block.state.centres + found.block.state.origin - true.centres - true.origin
    assert float(np.linalg.norm(off, axis=1).max()) < 30.0
    assert {name[1:3] for name in found.left_out if name[0] == "image"} <= wrong
