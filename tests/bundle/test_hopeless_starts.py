"""What is left early: searches that gross errors make vain, and starts that lead nowhere."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import Scene
from startkinds import KINDS, building, measured

from anaplot.bundle.solve.gaussnewton import NoConvergenceError, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start import bestminimum
from anaplot.bundle.start.approximate import Way
from anaplot.bundle.start.pull import foreseen_torn, torn
from anaplot.bundle.start.robust import RobustState, robust_state
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.collinearity import turns


def ring(seed: int = 0) -> Scene:
    rng = np.random.default_rng(seed)
    return measured(KINDS["ring"](rng, 1), rng)


def wild(scene: Scene, share: float) -> tuple[Scene, set[str]]:
    """Some rays lie anywhere in their photos; also what these are called."""
    rng = np.random.default_rng(5)
    rows = list(scene.block.image_points)
    most = 0.4 * scene.block.cameras[0].c
    off = np.flatnonzero(rng.random(len(rows)) < share).tolist()
    for k in off:
        x, y = rng.uniform(-most, most, 2).tolist()
        rows[k] = replace(rows[k], x=x, y=y)
    named = {f"point {rows[k].point} in photo {rows[k].photo}" for k in off}
    return replace(scene, block=replace(scene.block, image_points=tuple(rows))), named


@pytest.mark.parametrize(("share", "tears"), [(0.0, False), (0.04, True)])
def test_one_step_foresees_what_the_minimum_is(share: float, tears: bool) -> None:
    scene, _ = wild(ring(), share)
    problem = make_problem(scene.block)
    start = scene.start(problem)
    structure = make_structure(problem, start.centres)
    solution = robust_state(problem, structure, start)
    assert solution.orients(problem)
    assert foreseen_torn(problem, structure, solution) == tears
    found = find_minimum(problem, start, structure)
    assert torn(problem, found.convergence.last, solution) == tears
    # a block that lies wrongly on its control is laid onto it another way, not by least squares
    assert foreseen_torn(problem, structure, solution._replace(control_off=1)) == tears


def test_what_is_not_oriented_foresees_nothing() -> None:
    scene, _ = wild(ring(), 0.04)
    problem = make_problem(scene.block)
    start = scene.start(problem)
    structure = make_structure(problem, start.centres)
    solution = robust_state(problem, structure, start)
    assert not foreseen_torn(problem, structure, solution._replace(most_off=0.3))
    assert not foreseen_torn(problem, structure, solution._replace(misfit=0.002 * problem.c[0]))


def beside_control(problem: Problem, state: BlockState) -> BlockState:
    """The state turned and shifted by its own size, but for its control."""
    turn, shift = turns(np.array([[1.5, 0.0, 0.0]]))[0], float(np.ptp(state.points))
    held = np.isfinite(problem.near).all(axis=1)
    return replace(
        state,
        centres=state.centres @ turn.T + shift,
        rotations=turn @ state.rotations,
        points=np.where(held[:, None], state.points, state.points @ turn.T + shift),
    )


def test_a_block_beside_its_control_is_told_by_their_rays() -> None:
    """Control draws its points along; the many others stay where they are."""
    problem = make_problem(ring().block)
    state = ring().start(problem)
    structure = make_structure(problem, state.centres)
    assert robust_state(problem, structure, state).grounded
    wrong = robust_state(problem, structure, beside_control(problem, state))
    assert wrong.orients(problem)
    assert wrong.beside
    assert not wrong.grounded


@pytest.mark.parametrize(
    ("most_off", "misfit", "orients", "misleads"),
    [
        (0.2, 1e-4, True, False),
        (0.2, 2e-3, False, False),  # a lens that nobody stated
        (0.3, 1e-4, False, False),
        (1.0, 1e-4, False, False),  # one photo whose points have the names of others
        (1.0, 2e-3, False, True),
    ],
)
def test_what_tells_right_orientations(
    most_off: float, misfit: float, orients: bool, misleads: bool
) -> None:
    problem = make_problem(ring().block)
    state = ring().start(problem)
    solution = RobustState(state, misfit * float(problem.c[0]), 50, 0, most_off)
    assert solution.orients(problem) == orients
    assert solution.misleads(problem) == misleads


@pytest.mark.slow
def test_no_long_search_where_gross_errors_tear_every_minimum(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene, named = wild(ring(2), 0.08)
    limits = []

    def counted(*args, tries=None, **named):
        limits.append(tries)
        return find_minimum(*args, tries=tries, **named)

    monkeypatch.setattr(bestminimum, "find_minimum", counted)
    problem = make_problem(scene.block)
    with pytest.raises(NotComputableError, match="no solution found") as failure:
        bestminimum.best_minimum(problem, None, problem)
    assert limits
    assert None not in limits
    said = re.findall(r"point \w+ in photo \w+", str(failure.value))
    assert len(said) == 3
    assert set(said) <= named


@pytest.mark.slow
def test_photos_that_no_way_orients_are_named() -> None:
    # a walk of which most steps share too little: level photos are far from the truth
    rng = np.random.default_rng(1)
    scene = measured(replace(building(rng, 20, 350), share=0.3), rng)
    problem = make_problem(scene.block)
    with pytest.raises(NotComputableError, match=r"no approximate orientation found for photos f2"):
        bestminimum.best_minimum(problem, None, problem)


def test_ways_that_end_in_the_same_place_are_one(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = make_problem(ring().block)
    start = ring().start(problem, np.random.default_rng(1), shift=2.0, turn=0.5)
    begun: list[BlockState] = []

    def found(_: Problem, at: BlockState, *__: object, **___: object) -> None:
        begun.append(at)
        raise NoConvergenceError("nowhere", at)

    ways = [Way(lambda _: replace(start)) for _ in range(4)]
    monkeypatch.setattr(bestminimum, "approximate_ways", lambda _: list(ways))
    monkeypatch.setattr(bestminimum, "find_minimum", found)
    with suppress(NotComputableError):
        bestminimum.best_minimum(problem, None, problem)
    # a few steps, and all of them once the other ways have led nowhere
    assert sum(np.array_equal(at.centres, start.centres) for at in begun) == 2
