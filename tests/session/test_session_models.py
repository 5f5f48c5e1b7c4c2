"""The models of a session are the models of the bridge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sessionscene import Scene

from anaplot.errors import NotComputableError, TooFewError
from anaplot.orientation.model import orient
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import bridge_strip
from anaplot.session import models as models_module
from anaplot.session.events import ModelAccepted, RowSwitched
from anaplot.session.models import (
    diagnosis_of,
    preceding_models,
    solve,
    solved_or_none,
    without_redundancy,
)
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState, apply, fold, start


def finished(scene: Scene) -> SessionState:
    state = scene.whole(scene.chosen(2))
    return apply(state, ModelAccepted("103", "104"))


def assert_same(one: ModelSolution, other: ModelSolution) -> None:
    assert (one.left, one.right, one.ties) == (other.left, other.right, other.ties)
    assert one.table == other.table
    assert one.points == other.points
    assert (one.base, one.rotation, one.centre) == (other.base, other.rotation, other.centre)
    assert (one.sigma0_um, one.redundancy) == (other.sigma0_um, other.redundancy)
    assert np.array_equal(one.q_vv, other.q_vv)


def test_solve_equals_the_bridge_on_the_same_measurements(scene: Scene) -> None:
    state = finished(scene)
    block = replace(scene.block, image_points=scene.rows(state))
    bridged = bridge_strip(block, block.strips[0])
    assert bridged.error is None
    assert len(bridged.models) == 3
    for model, expected in zip(state.models, bridged.models, strict=True):
        assert_same(solve(state, model), expected)


def test_a_point_switched_off_is_a_point_not_measured(scene: Scene) -> None:
    state = scene.whole(scene.chosen(1))
    assert state.current is not None
    tie, new = state.current.plan[1].point, state.current.plan[-1].point
    state = fold(state, [RowSwitched(tie, None, False), RowSwitched(new, None, False)])
    assert state.current is not None
    block = replace(scene.block, image_points=scene.rows(state))
    expected = bridge_strip(block, block.strips[0]).models[1]
    assert_same(solve(state, state.current), expected)


def test_a_row_switched_off_leaves_the_table(scene: Scene) -> None:
    state = scene.whole(scene.chosen(1))
    assert state.current is not None
    tie = state.current.plan[1].point
    whole = solve(state, state.current)
    state = apply(state, RowSwitched(tie, "x", False))
    assert state.current is not None
    less = solve(state, state.current)
    assert {r.key for r in whole.table} - {r.key for r in less.table} == {(tie, "x")}
    assert less.redundancy == whole.redundancy - 1
    # the point itself stays, with model coordinates
    assert tie in {p.point for p in less.points}


def test_the_models_before(scene: Scene) -> None:
    state = finished(scene)
    first, second, third = state.models
    assert preceding_models(state.models, first) == ()
    assert preceding_models(state.models, second) == (first,)
    assert preceding_models(state.models, third) == (first, second)


def test_a_long_strip_is_solved_without_recursion() -> None:
    scene = Scene(3)
    state = scene.whole(scene.chosen(1))
    assert state.current is not None
    # the same two photos over and over, as photos of a strip too long for any stack
    ids = tuple(str(k) for k in range(1200))
    camera = scene.block.cameras[0].id
    photo = scene.block.photos[0]
    block = replace(
        scene.block,
        photos=tuple(replace(photo, id=i, camera=camera) for i in ids),
        strips=(replace(scene.block.strips[0], photos=ids),),
    )
    first = replace(state.models[0], left="0", right="1")
    models = [first] + [
        replace(first, left=ids[k], right=ids[k + 1], off=frozenset()) for k in range(1, 1100)
    ]
    long = replace(start(block), models=tuple(models))
    assert len(preceding_models(long.models, models[-1])) == 1099
    # the second model finds its ties at contradicting places: a refusal, never a RecursionError
    with pytest.raises(NotComputableError):
        solve(long, models[-1])


def test_what_is_not_determined_says_which_model(scene: Scene) -> None:
    state = scene.chosen()
    assert state.current is not None
    for planned in state.current.plan[:4]:
        state = apply(state, scene.measurement(state, planned.point))
    assert state.current is not None
    with pytest.raises(NotComputableError, match="model 101/102") as caught:
        solve(state, state.current)
    assert caught.value.exit_code == 4


def test_solutions_are_remembered_per_measurement(scene: Scene) -> None:
    state = scene.whole(scene.chosen())
    assert state.current is not None
    one = solve(state, state.current)
    assert solve(state, state.current) is one
    assert diagnosis_of(one) is diagnosis_of(one)
    name = state.current.plan[0].point
    after = apply(state, scene.measurement(state, name, dyr=0.05))
    assert after.current is not None
    assert solve(after, after.current) is not one


def test_a_model_that_was_solved_is_known_without_a_look_at_its_measurements(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = finished(scene)
    last = state.models[-1]
    known = solve(state, last)
    compared: list[str] = []
    monkeypatch.setattr(ModelState, "__hash__", lambda model: compared.append(model.name) or 0)
    assert solve(state, last) is known
    assert compared == []


def test_why_there_is_no_solution_is_found_once(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = scene.chosen(0)
    assert state.current is not None
    few = replace(state.current, measured=scene.whole(state).current.measured[:3])
    asked: list[str] = []

    def counted(pair, precision, test):
        asked.append(pair.name)
        return orient(pair, precision, test)

    monkeypatch.setattr(models_module, "orient", counted)
    said = []
    for _ in range(2):
        with pytest.raises(TooFewError, match="3 points") as refused:
            solve(state, few)
        said.append(refused.value)
    assert asked == ["101/102"]
    # no error keeps the stack to which another one was raised
    assert said[0] is not said[1]
    assert str(said[0]) == str(said[1])


def test_a_model_without_redundancy_is_told_by_counting(scene: Scene) -> None:
    for number in range(2):
        state = scene.chosen(number)
        whole = scene.whole(state).current
        assert whole is not None
        told = []
        for count in range(1, len(whole.measured) + 1):
            model = replace(whole, measured=whole.measured[:count])
            told.append(without_redundancy(state.models, model))
            solution = solved_or_none(state, model)
            assert told[-1] == (solution is None or solution.redundancy == 0)
            if told[-1] and solution is not None:
                assert all(row.size is None for row in solution.table)
        assert {False, True} == set(told)
    off = frozenset((m.point, "y") for m in whole.measured)
    assert without_redundancy(state.models, replace(whole, off=off))
    assert not without_redundancy(state.models, replace(whole, off=frozenset([*off][:1])))
