"""Some points of a large block orient its photos, and lead where all of them lead."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bundleblocks import Scene
from startkinds import drone, measured, with_mismatches

from anaplot.bundle.adjust import adjust_problem
from anaplot.bundle.errors import misfits
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.misfits import minimum_without_misfits
from anaplot.bundle.solve import somepoints
from anaplot.bundle.solve.gaussnewton import Step, damped_step, led_by_factor
from anaplot.bundle.solve.imaging import BlockState, RobustPlace
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.somepoints import of_points, some_points
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start import robust
from anaplot.bundle.start.bysomepoints import oriented_by_some
from anaplot.bundle.start.robust import far_off, robust_state


def scene(mismatches: float = 0.0) -> Scene:
    """Thirty photos of a drone with 16 600 rays, five points of control."""
    rng = np.random.default_rng(11)
    made = measured(replace(drone(rng, 1), share=1.0), rng)
    return with_mismatches(made, rng, mismatches) if mismatches else made


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let small blocks count as large ones."""
    monkeypatch.setattr(somepoints, "_LARGE", 100)
    monkeypatch.setattr(somepoints, "_RAYS", 20)
    monkeypatch.setattr(somepoints, "_FEWEST", 15)


def rough(made: Scene, problem: Problem) -> BlockState:
    return made.start(problem, np.random.default_rng(5), 1.0, 0.02)


def test_a_small_block_is_not_parted() -> None:
    assert some_points(make_problem(scene().block)) is None


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_every_photo_keeps_enough_rays_and_everything_known() -> None:
    problem = make_problem(scene().block)
    chosen = some_points(problem)
    assert chosen is not None
    rays = np.bincount(problem.photo)
    kept = np.bincount(problem.photo[chosen[problem.point]], minlength=len(rays))
    assert (kept >= np.minimum(rays, 15)).all()
    assert kept.sum() < rays.sum() / 2
    assert chosen[np.isfinite(problem.known).any(axis=1)].all()


@pytest.mark.usefixtures("few")
def test_rays_without_weight_are_not_counted() -> None:
    problem = make_problem(scene().block)
    rng = np.random.default_rng(3)
    of_one = problem.photo == 3
    rejected = np.repeat((rng.random(len(of_one)) < np.where(of_one, 0.9, 0.2))[:, None], 2, axis=1)
    counts = ~rejected[:, 0]
    chosen = some_points(replace(problem, rejected=rejected))
    assert chosen is not None
    rays = np.bincount(problem.photo[counts])
    kept = np.bincount(problem.photo[counts & chosen[problem.point]], minlength=len(rays))
    assert (kept >= np.minimum(rays, 15)).all()
    assert kept[3] < rays[3]


def test_some_points_have_the_rows_that_they_had_among_all() -> None:
    made = scene()
    problem = make_problem(made.block)
    rng = np.random.default_rng(2)
    rejected = rng.random((len(problem.photo), 2)) < 0.1
    factor = rng.uniform(0.5, 2.0, (len(problem.photo), 2))
    problem = replace(problem, rejected=rejected, axis_factor=factor)
    chosen = rng.random(len(problem.points)) < 0.4
    smaller = of_points(problem, chosen)
    state = rough(made, problem)
    every = linearise(problem, state)
    some = linearise(smaller, replace(state, points=state.points[chosen]))
    rays = chosen[problem.point]
    for name in ("a", "b", "e", "depth"):
        np.testing.assert_array_equal(getattr(some, name), getattr(every, name)[rays])
    np.testing.assert_array_equal(some.point_e, every.point_e[:, chosen])
    names = np.array(problem.points)
    assert (np.array(smaller.points)[smaller.point] == names[problem.point[rays]]).all()
    for group in smaller.groups:
        its = smaller.point[group.ray_slice].reshape(group.points, group.rays)
        assert (its == its[:, :1]).all()


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_some_points_lead_where_all_of_them_lead() -> None:
    made = scene(mismatches=0.01)
    problem = make_problem(made.block)
    start = rough(made, problem)
    structure = make_structure(problem, start.centres)
    by_some = oriented_by_some(problem, start)
    assert by_some is not None
    settled = robust_state(problem, structure, by_some, of_some=True)
    every = robust_state(problem, structure, start)
    assert settled.settled
    assert settled.explains(problem)
    np.testing.assert_allclose(settled.misfit, every.misfit, rtol=0.05)
    here = far_off(problem, structure, settled.place)
    there = far_off(problem, structure, RobustPlace(every.state))
    np.testing.assert_array_equal(here.rays, there.rays)
    assert here.rays.any()


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_a_state_has_settled_only_where_a_step_with_all_points_was_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = scene(mismatches=0.01)
    problem = make_problem(made.block)
    start = rough(made, problem)
    structure = make_structure(problem, start.centres)
    by_some = oriented_by_some(problem, start)
    assert by_some is not None
    asked: list[float] = []

    def refused(*given: object) -> Step | None:
        asked.append(given[3])
        return None if len(asked) < 3 else damped_step(*given)

    monkeypatch.setattr(robust, "damped_step", refused)
    # what cannot be solved at first is damped more, as from any other start
    assert robust_state(problem, structure, by_some, of_some=True).settled
    assert len(asked) == 3
    assert asked == sorted(set(asked))
    monkeypatch.setattr(robust, "damped_step", lambda *_: None)
    unmoved = robust_state(problem, structure, by_some, of_some=True)
    assert not unmoved.settled
    np.testing.assert_array_equal(unmoved.state.centres, by_some.centres)


@pytest.mark.usefixtures("few")
def test_photos_that_lie_elsewhere_are_left_to_all_points() -> None:
    made = scene()
    problem = make_problem(made.block)
    start = made.start(problem)
    turned = start.rotations.copy()
    turned[:6] = turned[:6] @ np.diag([-1.0, 1.0, -1.0])
    assert oriented_by_some(problem, replace(start, rotations=turned)) is None


@pytest.mark.slow
@pytest.mark.parametrize("mismatches", [0.0, 0.01])
def test_the_minimum_is_the_same(mismatches: float, monkeypatch: pytest.MonkeyPatch) -> None:
    made = scene(mismatches)
    problem = make_problem(made.block)
    start = rough(made, problem)
    before = adjust_problem(problem, start=start)
    monkeypatch.setattr(somepoints, "_LARGE", 100)
    monkeypatch.setattr(somepoints, "_RAYS", 20)
    asked: list[BlockState | None] = []

    def seen(*given: object) -> BlockState | None:
        asked.append(oriented_by_some(*given))
        return asked[-1]

    monkeypatch.setattr("anaplot.bundle.start.bestminimum.oriented_by_some", seen)
    after = adjust_problem(problem, start=start)
    assert len(asked) == 1
    assert asked[0] is not None
    np.testing.assert_allclose(after.vtpv, before.vtpv, rtol=1e-11)
    np.testing.assert_allclose(after.state.centres, before.state.centres, atol=1e-7)
    if mismatches:
        assert before.robust is not None
        assert after.robust is not None
        places = [
            minimum_without_misfits(
                problem,
                block.cofactors.normal.structure,
                block.robust,
            )
            for block in (before, after)
        ]
        first, second = places
        assert first is not None
        assert second is not None
        np.testing.assert_array_equal(first[0].rejected, second[0].rejected)


@pytest.mark.slow
@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("strategy", ["search", "baarda"])
def test_a_torn_block_is_reached_through_that_without_its_errors(
    strategy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    block = with_mismatches(scene(), np.random.default_rng(4), 0.003, 0.05).block
    led: list[int] = []

    def counted(*given: Any) -> Any:
        state, steps = led_by_factor(*given)
        led.append(steps)
        return state, steps

    monkeypatch.setattr(misfits, "led_by_factor", counted)
    through = block_gross_errors(block, strategy)
    assert led
    assert led[0] > 4
    # equations of its own are those of the minimum, and it is told of, though they are let go of
    assert through.begun.block.convergence.iterations == led[0]
    assert through.begun.block.kept is None

    def not_known(*_: Any) -> None:
        if strategy == "search":
            raise np.linalg.LinAlgError

    monkeypatch.setattr(misfits.WithoutFirst, "__call__", not_known)
    straight = block_gross_errors(block, strategy)
    assert straight.first is not None
    assert through.first is not None
    assert straight.first.sigma0 > 4.0
    for of in ("vtpv", "v", "r", "deviations"):
        np.testing.assert_allclose(
            getattr(through.first, of), getattr(straight.first, of), rtol=1e-7, atol=1e-7
        )
    assert through.rejected == straight.rejected
    assert through.block.warnings == straight.block.warnings
    np.testing.assert_allclose(through.block.vtpv, straight.block.vtpv, rtol=1e-11)
    change, other = through.point_change, straight.point_change
    assert change is not None
    assert other is not None
    assert (change.point, change.axis) == (other.point, other.axis)
    assert change.sigma == pytest.approx(other.sigma)
    assert (change.change, *change.rms) == pytest.approx((other.change, *other.rms))
    # made anew, it is the same
    again = through.first.whole()
    assert again.vtpv == pytest.approx(through.first.vtpv, rel=1e-12)
    np.testing.assert_allclose(again.cofactors.r, through.first.r, atol=1e-12)
    np.testing.assert_allclose(
        again.cofactors.point_deviations, through.first.deviations, rtol=1e-9
    )
    assert again.warnings == through.first.warnings
