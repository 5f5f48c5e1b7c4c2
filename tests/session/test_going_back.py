"""Returning to an accepted model: the fold, what is computed from it, and the desk."""

from __future__ import annotations

from dataclasses import replace

import pytest
from deskscene import DRIVEN, DRIVEN_MONO, UNDRIVEN, Bench, refusal
from hypothesis import given
from hypothesis import strategies as st
from innerscene import InnerScene
from sessionscene import Scene, however_it_lies

from anaplot.errors import InputError
from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.readings import Position, Record
from anaplot.session.checkpoints import check_points
from anaplot.session.commands import (
    Accept,
    Drive,
    KeepCounters,
    NextModel,
    Reference,
    ReturnTo,
    Switch,
    Undo,
)
from anaplot.session.events import (
    ModelAccepted,
    ModelReopened,
    MonoMeasured,
    PhotoLaid,
    PlannedPoint,
    PointAdded,
    PointMeasured,
    RowSwitched,
    Undone,
)
from anaplot.session.models import solve
from anaplot.session.recomputed import recomputed_models
from anaplot.session.requests import Lay, ReadAnew, WritePoints
from anaplot.session.state import EventRefusedError, SessionState, apply, fold
from anaplot.session.tolerances import tolerance_of_check_mm
from anaplot.station.imagepoints import rows_of

SCENE = Scene(5)
FIDUCIALS = InnerScene(4)
FIRST, SECOND, THIRD = SCENE.block.strips[0].models()[:3]


def three() -> SessionState:
    """Two models accepted, the third half measured."""
    state = SCENE.chosen(2)
    return fold(state, list(SCENE.measurements(state))[:5])


THREE = three()


def tables(state: SessionState) -> list[tuple[object, ...]]:
    return [_table(solve(state, model)) for model in state.models]


def _table(solution: ModelSolution) -> tuple[object, ...]:
    return solution.name, solution.sigma0_um, tuple(solution.listed)


def remeasured(state: SessionState, point: str, dxr: float = 0.0) -> SessionState:
    return apply(state, SCENE.measurement(state, point, dxr=dxr))


@given(st.integers(0, 1), st.booleans())
def test_a_model_left_as_it_was_changes_nothing(model: int, by_undo: bool) -> None:
    photos = THREE.models[model].photos
    state = apply(THREE, ModelReopened(*photos))
    assert state.current is not None
    assert state.current.photos == photos
    assert state.models == THREE.models
    assert state.returned is not None
    assert state.returned.parked == THREE.current
    after = apply(state, Undone() if by_undo else ModelAccepted(*photos))
    assert (after.models, after.returned, after.recomputed) == (THREE.models, None, ())
    assert however_it_lies(after).current == however_it_lies(THREE).current
    assert rows_of(after.models) == rows_of(THREE.models)


@pytest.mark.slow
@given(st.sets(st.integers(0, 12), min_size=1))
def test_the_same_values_again_give_the_same_tables(which: set[int]) -> None:
    state = apply(THREE, ModelReopened(*FIRST))
    assert state.current is not None
    for k in sorted(which):
        state = remeasured(state, state.current.plan[k % len(state.current.plan)].point)
    after = apply(state, ModelAccepted(*FIRST))
    assert tables(after) == tables(THREE)
    assert rows_of(after.models) == rows_of(THREE.models)
    assert [m.times for m in after.models[0].measured].count(2) == len(
        {k % len(state.current.plan) for k in which}
    )
    assert recomputed_models(after) == ()
    assert however_it_lies(after).current == however_it_lies(THREE).current


def test_a_model_keeps_its_place_and_those_after_it_are_computed_anew() -> None:
    point = THREE.models[1].plan[0].point
    wrong = apply(THREE, ModelReopened(*FIRST))
    wrong = apply(remeasured(wrong, point, dxr=0.05), ModelAccepted(*FIRST))
    assert [m.photos for m in wrong.models] == [FIRST, SECOND]
    (changed,) = recomputed_models(wrong)
    was, now = solve(THREE, THREE.models[1]), solve(wrong, wrong.models[1])
    old, new = ({row.key: row.residual for row in table.listed} for table in (was, now))
    assert (changed.left, changed.right) == SECOND
    assert changed.sigma0_um == (was.sigma0_um, now.sigma0_um)
    assert changed.row == (point, "x")
    assert changed.change_um == max(abs(new[key] - old[key]) for key in old)
    assert changed.in_words().endswith(f"largest change {changed.change_um:.1f} um at {point} x")
    # measured as it was, everything is as it was, and nothing is shown as changed any more
    right = remeasured(apply(wrong, ModelReopened(*FIRST)), point)
    right = apply(right, ModelAccepted(*FIRST))
    assert recomputed_models(right) == ()
    assert tables(right) == tables(THREE)


def test_accepting_the_later_model_again_makes_it_as_it_was_accepted() -> None:
    point = THREE.models[1].plan[0].point
    state = apply(THREE, ModelReopened(*FIRST))
    state = apply(remeasured(state, point, dxr=0.05), ModelAccepted(*FIRST))
    assert recomputed_models(state)
    state = remeasured(apply(state, ModelReopened(*SECOND)), THREE.models[1].plan[3].point, 1e-3)
    assert recomputed_models(apply(state, ModelAccepted(*SECOND))) == ()


def test_every_step_of_a_return_can_be_taken_back() -> None:
    states = [THREE]
    first = THREE.models[0].plan[0].point
    steps = [
        ModelReopened(*FIRST, point=first),
        RowSwitched(THREE.models[0].plan[1].point, "y", False),
        SCENE.measurement(apply(THREE, ModelReopened(*FIRST)), first, dxr=0.03),
        ModelAccepted(*FIRST),
    ]
    for event in steps:
        states.append(apply(states[-1], event))
    assert states[1].returned is not None
    assert states[1].returned.point == first
    assert states[3].returned is not None
    assert states[3].returned.point is None
    assert states[4].returned is None
    assert however_it_lies(states[4]).current == however_it_lies(THREE).current
    for before, after in zip(states[-2::-1], states[:0:-1], strict=True):
        assert however_it_lies(apply(after, Undone())) == however_it_lies(before)


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (ModelReopened(*THIRD), "is not accepted yet"),
        (ModelReopened("101", "103"), "is not accepted yet"),
        (ModelReopened(*FIRST, point="nowhere"), "point nowhere is not measured"),
        (ModelReopened(*FIRST, photo="999"), "photo 999 is not in model"),
    ],
)
def test_where_one_cannot_return_to(event: ModelReopened, words: str) -> None:
    with pytest.raises(EventRefusedError, match=words):
        apply(THREE, event)


def test_one_model_at_a_time() -> None:
    state = apply(THREE, ModelReopened(*FIRST))
    with pytest.raises(EventRefusedError, match=f"accept model {'/'.join(FIRST)} first"):
        apply(state, ModelReopened(*SECOND))


def test_ties_of_the_next_model_follow_what_is_known_now() -> None:
    tie = next(p.point for p in THREE.models[1].plan if p.role == "tie")
    before = apply(THREE, ModelReopened(*FIRST))
    state = fold(before, [RowSwitched(tie, None, False), ModelAccepted(*FIRST)])
    planned = state.models[1].planned(tie)
    assert planned is not None
    assert planned.role == "new"
    assert tie not in solve(state, state.models[1]).ties
    # and back, switched off there meanwhile: it stays off, with both its rows
    state = fold(
        state,
        [
            ModelReopened(*SECOND),
            RowSwitched(tie, None, False),
            ModelAccepted(*SECOND),
            ModelReopened(*FIRST),
            RowSwitched(tie, None, True),
            ModelAccepted(*FIRST),
        ],
    )
    planned = state.models[1].planned(tie)
    assert planned is not None
    assert planned.role == "tie"
    assert state.models[1].is_off(tie)


def test_a_point_added_on_return_is_a_tie_of_the_next_model() -> None:
    state = apply(THREE, ModelReopened(*FIRST))
    here = state.models[1].plan[-1]
    x, y = state.models[1].measured[-1].xl, state.models[1].measured[-1].yl
    state = fold(
        state,
        [
            PointAdded(PlannedPoint(here.point, "new", x + 90.0, y, x, y)),
            PointMeasured(*FIRST, here.point, min(x + 90.0, 110.0), y, x, y, "key"),
            ModelAccepted(*FIRST),
        ],
    )
    planned = state.models[1].planned(here.point)
    assert here.role == "new"
    assert planned is not None
    assert planned.role == "tie"


# -- in a mono comparator --------------------------------------------------------------------------


def mono() -> SessionState:
    """Two models accepted in a mono comparator."""
    state = SCENE.start
    for k, photos in enumerate((FIRST, SECOND)):
        state = apply(state, replace(SCENE.choice(state, k), mono=True))
        for side, photo in zip(("left", "right"), photos, strict=True):
            assert state.current is not None
            if state.current.laid != side:
                state = apply(state, PhotoLaid(photo))
            assert state.current is not None
            for planned in state.current.pending_in(side):
                x, y = SCENE.noisy[photos, photo, planned.point]
                state = apply(state, MonoMeasured(*photos, side, planned.point, x, y, "key"))
        state = apply(state, ModelAccepted(*photos))
    return state


MONO = mono()


def test_what_was_measured_once_follows_into_the_next_model() -> None:
    tie = next(p.point for p in MONO.models[1].plan if p.role == "tie")
    old = MONO.models[0].sighting("right", tie)
    assert old is not None
    state = fold(
        MONO,
        [
            ModelReopened(*FIRST, point=tie, photo=FIRST[1]),
            PhotoLaid(FIRST[1]),
            MonoMeasured(*FIRST, "right", tie, old.x + 0.01, old.y, "key"),
            ModelAccepted(*FIRST),
        ],
    )
    left = state.models[1].sighting("left", tie)
    assert left is not None
    assert left.x == old.x + 0.01
    assert sum(row.point == tie and row.photo == FIRST[1] for row in rows_of(state.models)) == 1
    assert state.models[1].measured != MONO.models[1].measured


def test_what_was_measured_anew_in_the_next_model_stays() -> None:
    tie = next(p.point for p in MONO.models[1].plan if p.role == "tie")
    seen = MONO.models[1].sighting("left", tie)
    assert seen is not None
    own = MonoMeasured(*SECOND, "left", tie, seen.x + 0.002, seen.y, "key")
    state = fold(MONO, [ModelReopened(*SECOND), PhotoLaid(SECOND[0]), own, ModelAccepted(*SECOND)])
    state = fold(
        state,
        [
            ModelReopened(*FIRST),
            PhotoLaid(FIRST[1]),
            MonoMeasured(*FIRST, "right", tie, seen.x + 0.01, seen.y, "key"),
            ModelAccepted(*FIRST),
        ],
    )
    left = state.models[1].sighting("left", tie)
    assert left is not None
    assert left.x == seen.x + 0.002


def test_the_photo_that_lies_there_still_needs_not_be_laid_in() -> None:
    assert MONO.models[1].laid == "right"
    state = apply(MONO, ModelReopened(*SECOND))
    assert state.current is not None
    assert state.current.laid == "right"
    assert apply(state, ModelAccepted(*SECOND)) == replace(MONO)
    state = apply(MONO, ModelReopened(*FIRST))
    assert state.current is not None
    assert state.current.laid is None
    # left again without anything laid in, the next model goes on where the last one ended
    state = apply(state, ModelAccepted(*FIRST))
    state = apply(state, replace(SCENE.choice(state, 2), mono=True))
    assert state.current is not None
    assert state.current.laid == "left"


# -- fiducials -------------------------------------------------------------------------------------


def test_inner_orientations_are_measured_anew_and_the_parked_model_too() -> None:
    state = FIDUCIALS.oriented(FIDUCIALS.chosen(1))
    one = FIDUCIALS.measurement(state, state.current.plan[0].point)  # type: ignore[union-attr]
    state = apply(state, one)
    back = apply(state, ModelReopened(*FIRST))
    assert back.current is not None
    assert [i.accepted for i in back.current.inner] == [None, None]
    with pytest.raises(EventRefusedError, match="inner orientation comes first"):
        apply(back, FIDUCIALS.measurement(back, back.current.plan[0].point))
    left = apply(back, ModelAccepted(*FIRST))
    assert left.models == state.models
    assert left.current is not None
    assert state.current is not None
    assert left.current.measured == state.current.measured
    assert [i.accepted for i in left.current.inner] == [None, None]
    assert apply(back, Undone()) == state
    # oriented, but nothing else done: the same tables
    again = apply(FIDUCIALS.oriented(back), ModelAccepted(*FIRST))
    assert tables(again) == tables(state)
    assert recomputed_models(again) == ()


# -- the desk --------------------------------------------------------------------------------------


class AtPlates(Bench):
    """Plates that nobody but the person at the instrument moves, and he finds what is asked for."""

    def _follow(self, decision):
        decision = super()._follow(decision)
        desk = self.desk
        if desk.abilities is not None and not desk.abilities.moves and desk.target is not None:
            assert desk.mode is not None
            self.stands = desk.mode.place(desk.target, desk.abilities.middle, known=True)
        return decision


def measured_bench(abilities=DRIVEN, scene: Scene = SCENE, models: int = 2) -> Bench:
    bench = AtPlates.of(scene.block, abilities, truth=scene.made.truth)
    for _ in range(models):
        bench.whole_model()
        bench.give(Accept())
    return bench


def finished(bench: Bench, models: int) -> None:
    """Go on until so many models are accepted."""
    while len(bench.desk.state.models) < models:
        if bench.desk.state.current is None:
            bench.give(NextModel())
        bench.measure_all()
        bench.give(Accept())


@pytest.mark.slow
@pytest.mark.parametrize("abilities", [DRIVEN, UNDRIVEN])
def test_interrupted_returned_and_continued_as_if_undisturbed(abilities) -> None:
    undisturbed = measured_bench(abilities, models=4).desk.state
    bench = measured_bench(abilities, models=3)
    bench.give(NextModel())
    bench.measure(bench.desk.due or "")
    # interrupted: what was folded is all that is left
    bench.desk = type(bench.desk).at(
        fold(SCENE.start, bench.events), abilities, candidates=SCENE.made.truth
    )
    bench.give(ReturnTo(*THIRD))
    again = [m.point for m in bench.desk.state.models[2].measured][::3]
    bench.give(KeepCounters())
    for point in again:
        bench.measure(point)
    bench.desk = type(bench.desk).at(
        fold(SCENE.start, bench.events), abilities, candidates=SCENE.made.truth
    )
    bench.give(KeepCounters())
    bench.give(Accept())
    bench.give(KeepCounters())
    finished(bench, 4)
    after = bench.desk.state
    assert tables(after) == tables(undisturbed)
    assert rows_of(after.models) == rows_of(undisturbed.models)
    assert recomputed_models(after) == ()
    assert {m.point for m in after.models[2].measured if m.times == 2} == set(again)


def shifted(bench: Bench, dx: float) -> None:
    """The pedal is pressed with the left plate lying elsewhere."""
    at = bench.stands
    bench.hear(Record(Position(at.xl + dx, at.yl, at.xr, at.yr), "pedal"))


@pytest.mark.parametrize("abilities", [DRIVEN, UNDRIVEN, DRIVEN_MONO])
def test_a_return_in_each_kind_of_instrument(abilities) -> None:
    bench = measured_bench(abilities)
    before = bench.desk.state
    bench.give(NextModel())
    bench.measure(bench.desk.mode.pending[0])  # type: ignore[union-attr]
    point = next(p.point for p in before.models[0].plan if p.point.startswith(FIRST[1]))
    parked = bench.desk.state.current
    bench.give(ReturnTo(*FIRST, point, FIRST[1]))
    assert bench.events[-1] == ModelReopened(*FIRST, point=point, photo=FIRST[1])
    if abilities.mono:
        assert bench.desk.expected.startswith(f"lay photo {FIRST[1]} in again to remeasure {point}")
        assert bench.desk.checks == ()
        bench.give(NextModel())
    else:
        assert bench.requests.count(Lay(*FIRST)) == 2
    checks = bench.desk.checks
    assert len(checks) == 2
    assert point not in checks
    for left in (2, 1):
        assert bench.desk.expected == (
            f"check point {bench.desk.check}: the photos lie anew, {left} to go"
        )
        assert bench.desk.next_name == bench.desk.target == bench.desk.check
        bench.arrive()
        assert bench.press().events == ()
    assert [kind for kind, _ in bench.notes].count("point-checked") == 2
    # then what the operator came for
    assert bench.desk.next_name == bench.desk.target == point
    bench.arrive()
    bench.press()
    assert bench.desk.state.returned.point is None  # type: ignore[union-attr]
    bench.give(Accept())
    assert WritePoints() in bench.requests
    after = bench.desk.state
    assert after.current is not None
    assert parked is not None
    assert after.current.measured == parked.measured
    assert after.returned is None
    assert [m.photos for m in after.models] == [FIRST, SECOND]
    # the same place again: the hand of the bench has the same noise there
    assert rows_of(after.models) == rows_of(before.models)


def test_photos_that_lie_otherwise_ask_for_the_counters_reference() -> None:
    bench = measured_bench(UNDRIVEN)
    bench.give(ReturnTo(*FIRST))
    name = bench.desk.check
    assert name is not None
    measured = bench.desk.state.models[0].measurement(name)
    assert measured is not None
    beyond = tolerance_of_check_mm(SCENE.block.precision.image_um) + 1e-3
    bench.stands = Position(measured.xl, measured.yl, measured.xr, measured.yr)
    before = bench.requests.count(ReadAnew())
    shifted(bench, beyond)
    assert bench.desk.referencing is not None
    # what was read of the counters before is none of theirs
    assert bench.requests.count(ReadAnew()) == before + 1
    assert f"point {name} is {beyond:.3f} mm from where it is on record" in bench.told[-1]
    # nothing counts before the reference is there
    shifted(bench, beyond)
    assert "not recorded" in bench.told[-1]
    here = replace(bench.stands, xl=bench.stands.xl + beyond)
    bench.seen = replace(bench.seen, counters=here, read=True)
    bench.give(Reference(name))
    bench.seen = replace(bench.seen, counters=replace(here, xl=here.xl + 0.001), read=True)
    bench.give(Reference(name))
    assert bench.desk.referencing is None
    assert bench.desk.checks == ()
    assert "the counters are moved by x' " in bench.told[-1]


def test_within_the_tolerance_they_lie_as_they_did() -> None:
    bench = measured_bench(UNDRIVEN)
    bench.give(ReturnTo(*FIRST))
    for _ in range(2):
        name = bench.desk.check
        measured = bench.desk.state.models[0].measurement(name or "")
        assert measured is not None
        bench.stands = Position(measured.xl, measured.yl, measured.xr, measured.yr)
        shifted(bench, tolerance_of_check_mm(SCENE.block.precision.image_um) - 1e-4)
    assert bench.desk.checks == ()
    assert bench.desk.referencing is None


def test_another_point_is_not_recorded_before_the_check_and_k_leaves_it_out() -> None:
    bench = measured_bench()
    bench.give(ReturnTo(*FIRST))
    check = bench.desk.check
    other = next(
        p.point for p in bench.desk.state.models[0].plan if p.point not in bench.desk.checks
    )
    bench.give(Drive(other))
    bench.arrive()
    assert bench.press().events == ()
    assert bench.told[-1] == f"not recorded: the photos lie anew: check point {check} first"
    bench.give(KeepCounters())
    bench.measure(other)
    assert isinstance(bench.events[-1], PointMeasured)


def test_checks_are_sound_points_far_apart() -> None:
    state = apply(THREE, ModelReopened(*FIRST))
    first, second = check_points(state)
    solution = solve(state, state.models[0])
    at = {m.point: m for m in state.models[0].measured}
    assert {first, second}.isdisjoint(row.point for row in solution.flagged)
    gap = ((at[first].xl - at[second].xl) ** 2 + (at[first].yl - at[second].yl) ** 2) ** 0.5
    assert gap > 80.0
    # not the one that is to be measured again, nor one that is switched off in the next model
    for doubted in (first, second):
        again = apply(THREE, ModelReopened(*FIRST, point=doubted))
        assert doubted not in check_points(again)
    if THREE.models[1].measurement(first) is not None:
        off = fold(
            THREE,
            [
                ModelReopened(*SECOND),
                RowSwitched(first, "y", False),
                ModelAccepted(*SECOND),
                ModelReopened(*FIRST),
            ],
        )
        assert first not in check_points(off)


def test_what_is_flagged_in_the_next_model_is_no_check() -> None:
    usual = check_points(apply(THREE, ModelReopened(*FIRST)))
    ties = [point for point in usual if THREE.models[1].measurement(point) is not None]
    assert ties
    for point in ties:
        state = remeasured(apply(THREE, ModelReopened(*SECOND)), point, dxr=0.2)
        state = apply(state, ModelAccepted(*SECOND))
        assert (point, "x") in {row.key for row in solve(state, state.models[1]).flagged}
        assert point not in check_points(apply(state, ModelReopened(*FIRST)))


def test_a_point_beyond_the_pattern_keeps_its_mark() -> None:
    photos = SCENE.block.strips[0].models()[1]
    before = SCENE.chosen(1)
    at = before.models[0].measured[0]
    marked = PlannedPoint("L1", "lateral", at.xl, at.yl, at.xr, at.yr)
    assert before.current is not None
    state = apply(before, PointAdded(marked))
    state = apply(state, ModelReopened(*FIRST))
    tie = before.models[0].plan[-1].point
    state = fold(state, [RowSwitched(tie, None, False), ModelAccepted(*FIRST)])
    assert state.current is not None
    assert state.current.photos == photos
    assert state.current.planned("L1") == marked


def test_what_one_cannot_return_to_is_said() -> None:
    bench = measured_bench()
    words = refusal(bench.desk, ReturnTo(*THIRD), bench.seen)
    assert words == f"model {'/'.join(THIRD)} is not accepted: there is nothing to return to"
    bench.desk = replace(bench.desk, abilities=DRIVEN_MONO)
    with pytest.raises(InputError, match="was begun in an instrument that holds both photos"):
        bench.give(ReturnTo(*FIRST))


def test_without_an_instrument_rows_are_switched_and_accepted() -> None:
    state = measured_bench().desk.state
    bench = Bench.of(SCENE.block, None)
    bench.desk = replace(type(bench.desk).at(state))
    bench.give(ReturnTo(*FIRST))
    assert bench.desk.expected == "remeasure, add or switch points, or accept: it stays as it was"
    tie = next(p.point for p in state.models[1].plan if p.role == "tie")
    bench.give(Switch(tie, None, False))
    bench.give(Accept())
    assert bench.desk.recomputed[0].name == "/".join(SECOND)
    assert bench.told[-1] == f"computed anew, and changed: {'/'.join(SECOND)}"
    bench.give(Undo())
    bench.give(Undo())
    bench.give(Undo())
    assert bench.desk.state.models == state.models
    assert bench.desk.recomputed == ()


def test_a_model_with_fiducials_can_be_left_at_once() -> None:
    bench = measured_bench(scene=FIDUCIALS, models=1)
    before = bench.desk.state
    bench.give(ReturnTo(*FIRST))
    assert bench.desk.outlook.inner is not None
    assert bench.desk.outlook.may_accept
    assert bench.desk.checks == ()
    bench.give(Accept())
    assert bench.desk.state.models == before.models
    assert bench.desk.state.current is None
    # but not when a fiducial was measured: then the inner orientation is what is accepted
    bench.give(ReturnTo(*FIRST))
    bench.measure(bench.desk.mode.pending[0])  # type: ignore[union-attr]
    assert not bench.desk.outlook.leaves
