"""Steps with the factor of an earlier one lead to the same minimum, or are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from conditionblocks import every_kind, flat_scene
from gnssblocks import flown
from startkinds import drone, measured

from anaplot.bundle.solve import gaussnewton
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.gaussnewton import (
    LEFT,
    Minimum,
    NoConvergenceError,
    _nearer,
    _Place,
    _Using,
    damped_step,
    equations_at,
    find_minimum,
    led_by_factor,
)
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import effect, linearise, rounding
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.reliability import compute_cofactors
from anaplot.bundle.solve.structure import make_structure
from anaplot.photogrammetry.block import PriorOffsets

CASES: dict[str, dict] = {
    "control": {"control_sigma": 0.05},
    "error-free control": {"control_sigma": 0.0},
    "tilted, with priors": {"control_sigma": 0.1, "priors": True, "tilt": 0.4},
    "free": {"control_sigma": 0.05},
    "minimal": {"control_sigma": 0.05},
    "self-calibration": {"control_sigma": 0.05, "per_base": 2},
    "a lens a photo": {"control_sigma": 0.05, "priors": True},
    "gross errors": {"control_sigma": 0.05},
    "offsets": {},
}
ADDITIONAL = {"self-calibration": ("ebner", 10.0), "a lens a photo": ("physical:photo", 5.0)}


def case_of(name: str) -> tuple[Problem, BlockState]:
    """A bundle, and approximate values some way from its minimum."""
    if name == "offsets":
        scene = flown(PriorOffsets(shift="strip", drift="strip", boresight="block")).scene
    else:
        scene = aerial(2, 5, **{"per_base": 1, "noise_um": 5.0, **CASES[name]})
    if name == "gross errors":
        rows = scene.block.image_points
        moved = [replace(row, x=row.x + 0.5 * (k % 40 == 7)) for k, row in enumerate(rows)]
        scene = scene.with_rows(moved)
    extra = ADDITIONAL.get(name)
    problem = make_problem(
        scene.block,
        datum=name if name in ("free", "minimal") else "control",
        additional=None if extra is None else additional_parameters(*extra),
    )
    return problem, scene.start(problem, np.random.default_rng(2), 3.0, 0.01)


def found_with(monkeypatch, case, close: float, nearer: float) -> tuple[Minimum, int]:
    """The minimum, and how many equations were made for it."""
    problem, start = case
    made = 0
    make = NormalEquations.__init__

    def counted(self, *args, **options) -> None:
        nonlocal made
        made += 1
        make(self, *args, **options)

    with monkeypatch.context() as patched:
        patched.setattr(gaussnewton, "_CLOSE", close)
        patched.setattr(gaussnewton, "_NEARER", nearer)
        patched.setattr(NormalEquations, "__init__", counted)
        return find_minimum(problem, start, make_structure(problem, start.centres)), made


def left_at(found: Minimum) -> float:
    """Squared change of the residuals in the step that the equations of the minimum lead to."""
    dx = found.normal.step(found.factor)
    pairs = zip(found.normal.own_gradient, dx, strict=True)
    return sum(float(np.vdot(side, of)) for side, of in pairs)


@pytest.mark.parametrize("name", CASES)
def test_the_minimum_is_the_same_with_fewer_factors(monkeypatch, name: str) -> None:
    case = case_of(name)
    every, made = found_with(monkeypatch, case, -1.0, 0.0)  # no factor serves twice
    found, fewer = found_with(monkeypatch, case, gaussnewton._CLOSE, gaussnewton._NEARER)
    anyhow, _ = found_with(monkeypatch, case, np.inf, np.inf)  # also factors from far away
    assert fewer < made
    for one in (found, anyhow):
        for kind in ("centres", "rotations", "points", "own", "shared"):
            mine, other = getattr(one.state, kind), getattr(every.state, kind)
            np.testing.assert_allclose(mine, other, rtol=1e-9, atol=2e-8)
        np.testing.assert_allclose(one.normal.linear.e, every.normal.linear.e, atol=1e-7)
        q, other = (compute_cofactors(of.normal, of.factor) for of in (one, every))
        np.testing.assert_allclose(q.r, other.r, atol=1e-9)
        # the equations are those at the minimum itself: their step leads nowhere
        assert abs(left_at(one)) < 1e-14 * case[0].observations


@pytest.mark.parametrize("name", ["control", "free", "self-calibration", "gross errors"])
def test_a_place_near_the_minimum_is_enough_where_that_is_asked_for(name: str) -> None:
    problem, start = case_of(name)
    structure, enough = make_structure(problem, start.centres), 0.1
    exact = find_minimum(problem, start, structure)
    near = find_minimum(problem, start, structure, enough=enough)
    assert near.convergence.iterations < exact.convergence.iterations
    assert 1e-14 * problem.observations < left_at(near) < enough * problem.observations
    # the equations are those of where the last step began, or of where it is in the datum kept
    there = linearise(problem, near.state).e
    led = (
        near.normal.linear.e + effect(problem, near.normal.linear, near.normal.step(near.factor)).e
    )
    np.testing.assert_allclose(led, there, atol=0.02 * np.abs(there).max())
    assert np.array_equal(near.normal.linear.e, there) == bool(problem.defect)
    on = find_minimum(problem, near.state, structure)
    np.testing.assert_allclose(on.state.points, exact.state.points, rtol=1e-9, atol=2e-8)
    np.testing.assert_allclose(on.normal.linear.e, exact.normal.linear.e, atol=1e-7)


@pytest.mark.parametrize("name", ["control", "self-calibration", "gross errors"])
def test_where_steps_have_led_to_the_minimum_its_equations_end_it(name: str) -> None:
    problem, start = case_of(name)
    structure = make_structure(problem, start.centres)
    exact = find_minimum(problem, start, structure)
    found = find_minimum(problem, exact.state, structure, led=3)
    assert found.convergence.iterations == 3
    assert found.state is exact.state
    assert abs(left_at(found)) < LEFT * problem.observations
    # from elsewhere it goes on, and all steps count
    again = find_minimum(problem, start, structure, led=3)
    assert again.convergence.iterations == exact.convergence.iterations + 3
    np.testing.assert_array_equal(again.state.points, exact.state.points)


def test_a_damped_step_that_hardly_moves_is_no_minimum(monkeypatch) -> None:
    problem, start = case_of("control")
    structure = make_structure(problem, start.centres)
    exact = find_minimum(problem, start, structure)
    real, asked = gaussnewton.damped_step, []

    def refused_once(*given):
        asked.append(given[3])
        return None if len(asked) == 1 else real(*given)

    monkeypatch.setattr(gaussnewton, "damped_step", refused_once)
    monkeypatch.setattr(gaussnewton, "LEFT", np.inf)  # as if any step hardly moved
    found = find_minimum(problem, start, structure, led=3)
    assert asked[0] == 0.0 < asked[1]
    assert found.state is not start
    np.testing.assert_allclose(found.state.points, exact.state.points, rtol=1e-3, atol=0.1)


@pytest.mark.parametrize(
    ("control_sigma", "sigma_um", "shift", "height"),
    [(1e-7, 5000.0, 3.0, 100.0), (1e-9, 5000.0, 3.0, -200.0), (1e-9, 300.0, 0.1, 100.0)],
)
def test_a_point_that_hardly_weighs_is_at_its_minimum_too(
    control_sigma: float, sigma_um: float, shift: float, height: float
) -> None:
    """What it moves by hides behind rays that weigh more, and behind the rounding of control."""
    scene = aerial(2, 5, per_base=1, noise_um=5.0, control_sigma=control_sigma)
    control = {row.point for row in scene.block.control}
    weak = next(row.point for row in scene.block.image_points if row.point not in control)
    others = [row for row in scene.block.image_points if row.point != weak]
    two = [row for row in scene.block.image_points if row.point == weak][:2]
    scene = scene.with_rows([*others, *(replace(row, sigma_um=sigma_um) for row in two)])
    problem = make_problem(scene.block)
    start = scene.start(problem, np.random.default_rng(1), shift, 1e-3 * shift)
    start.points[problem.points.index(weak), 2] += height
    found = find_minimum(problem, start, make_structure(problem, start.centres))
    noise = rounding(problem, found.state, found.normal.linear.depth)
    left = left_at(found)
    assert left <= max(1e-13 * problem.observations, noise)
    # no unknown is off by more than the root of it, of its own standard deviation
    assert left <= 1e-12 * problem.observations


@pytest.mark.parametrize("away", [False, True])
def test_what_is_too_little_to_be_made_less_is_no_reason_to_go_on(away: bool) -> None:
    """Where rounding is all that is left, an earlier factor does not lead nearer, and need not."""
    problem, start = case_of("control")
    structure = make_structure(problem, start.centres)
    there = find_minimum(problem, start, structure).state
    state = start if away else there
    linear = linearise(problem, state)
    step = damped_step(problem, structure, linear, 0.0, None, None)
    assert step is not None
    place = _Place(state, linear, linear.vtpv, 0)
    # a step before this one that changed as little: nothing has been gained
    using = _Using(step.normal, step.factor)
    ended, steps, settled = _nearer(problem, structure, using, place, step.change, 0, None)
    assert ended is place
    assert steps == 0
    assert settled is not away


@pytest.mark.slow
@pytest.mark.parametrize(("every", "sigmas"), [(397, 100.0), (397, 30.0), (101, 100.0)])
def test_the_factor_without_some_rows_leads_to_the_minimum_with_them(
    every: int, sigmas: float
) -> None:
    rng = np.random.default_rng(4)
    scene = measured(replace(drone(rng, 1), share=1.0), rng)
    whole = make_problem(scene.block)
    start = scene.start(whole, rng, 1.0, 0.02)
    structure = make_structure(whole, start.centres)
    rejected = np.zeros((len(whole.photo), 2), dtype=bool)
    rejected[::every, 0] = True
    clean = find_minimum(replace(whole, rejected=rejected), start, structure)
    # what is out may be wrong by much
    off = sigmas * rng.normal(size=rejected.shape) * rejected
    problem = replace(whole, xy=whole.xy + off * whole.sigma_xy)
    exact = find_minimum(problem, clean.state, structure)
    told: list[str] = []
    state, steps = led_by_factor(
        problem, structure, clean.state, clean.factor, lambda what, _: told.append(what)
    )
    assert 4 <= steps <= 30
    assert told[:2] == ["iteration 1", "iteration 2"]
    found = find_minimum(problem, state, structure, led=steps)
    assert found.convergence.iterations == steps  # its first equations are those of the minimum
    np.testing.assert_allclose(found.convergence.last, exact.convergence.last, rtol=1e-11)
    for of in ("centres", "rotations", "points"):
        np.testing.assert_allclose(
            getattr(found.state, of), getattr(exact.state, of), rtol=1e-9, atol=2e-8
        )


def test_a_factor_that_leads_nowhere_is_left_alone() -> None:
    problem, start = case_of("control")
    structure = make_structure(problem, start.centres)
    found = find_minimum(problem, start, structure)
    # a hundredth of the weights: steps of a hundred times the length
    weak = replace(problem, sigma=10.0 * problem.sigma)
    _, factor, _ = equations_at(weak, structure, found.state)
    assert led_by_factor(problem, structure, start, factor) == (start, 0)
    free, there = case_of("free")
    held = equations_at(free, structure, there)
    assert led_by_factor(free, structure, there, held[1]) == (there, 0)
    # points whose rays do not meet
    flat = replace(start, centres=np.zeros_like(start.centres))
    assert led_by_factor(problem, structure, flat, found.factor) == (flat, 0)


def test_steps_with_an_earlier_factor_are_told_and_counted(monkeypatch) -> None:
    problem, start = case_of("control")
    structure = make_structure(problem, start.centres)
    told: list[str] = []
    found = find_minimum(problem, start, structure, progress=lambda what, _: told.append(what))
    steps = found.convergence.iterations
    named = [what for what in told if what.startswith("iteration")]
    assert set(named) >= {f"iteration {k + 1}" for k in range(steps)}
    _, made = found_with(monkeypatch, (problem, start), gaussnewton._CLOSE, gaussnewton._NEARER)
    assert made - 1 < steps  # the last equations are those of the minimum
    few = find_minimum(problem, start, structure, tries=made - 1)
    assert few.convergence == found.convergence
    monkeypatch.setattr(gaussnewton, "MAX_ITERATIONS", steps - 1)
    with pytest.raises(NoConvergenceError, match=f"in {steps - 1} steps"):
        find_minimum(problem, start, structure)


def test_conditions_between_points_take_full_steps(monkeypatch) -> None:
    """What holds exactly has multipliers of the equations where the step begins."""
    scene = flat_scene()
    block = replace(scene.block, conditions=tuple(every_kind(scene)))
    problem = make_problem(block)
    case = problem, scene.start(problem, np.random.default_rng(2), 0.5, 0.001)
    every, made = found_with(monkeypatch, case, -1.0, 0.0)
    found, as_many = found_with(monkeypatch, case, np.inf, np.inf)
    assert as_many == made
    np.testing.assert_array_equal(found.state.points, every.state.points)
