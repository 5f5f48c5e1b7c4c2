"""Who changed what, told from events."""

from __future__ import annotations

from pathlib import Path

import pytest
from deskscene import DRIVEN, MONO, Bench, changes, told
from innerscene import InnerScene
from orientedforw import models_of_w
from sessionscene import Scene

from anaplot.exchange.journal import event_of, read_journal
from anaplot.session.changes import Change, Happened, Sizes
from anaplot.session.commands import (
    Accept,
    KeepCounters,
    NextModel,
    OtherPhoto,
    Resume,
    ReturnTo,
    Suspend,
    Switch,
    Undo,
)
from anaplot.session.events import EVENT_KINDS, MonoMeasured, PointMeasured
from anaplot.session.innerwork import solve_inner
from anaplot.session.models import solve
from anaplot.session.state import EventRefusedError, SessionState, apply, fold
from anaplot.station.replay import recorded_block

SESSIONS = Path(__file__).parents[1] / "sessions"


def test_a_first_measurement_and_a_second_one(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.give(NextModel())
    bench.measure_all()
    state = bench.desk.state
    point = state.current.plan[0].point
    old = state.current.measurement(point)
    before = max(row.size for row in solve(state, state.current).table if row.point == point)
    bench.give(Suspend())
    bench.give(Resume())
    bench.measure(point)
    new = bench.desk.state.current.measurement(point)
    found = told(bench)
    assert len(found) == 2 * 14  # each in both photos
    assert {one.what for one in found[:26]} == {"measured"}
    left, right = found[-2:]
    assert (left.what, left.model, left.photo, left.point) == (
        "remeasured",
        "101/102",
        "101",
        point,
    )
    assert (left.old, left.new) == ((old.xl, old.yl), (new.xl, new.yl))
    assert (right.photo, right.old, right.new) == ("102", (old.xr, old.yr), (new.xr, new.yr))
    assert left.w_before == right.w_before == before
    assert left.w_after is not None
    assert (left.time, left.who) == ("2026-01-01T10:00:00Z", "me")
    # the first five determine nothing: nothing is tested
    assert all(one.w_after is None for one in found[:10])
    assert found[24].w_after is not None


def test_what_is_switched_off_taken_back_and_accepted(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.give(NextModel())
    bench.measure_all()
    point = bench.desk.state.current.plan[2].point
    bench.give(Switch(point, "y", False))
    bench.give(Undo())
    bench.give(Switch(point, None, False))
    bench.give(Switch(point, None, True))
    bench.give(Accept())
    *_, off, undone, whole, on, accepted = told(bench)
    assert (off.what, off.photo, off.point, off.axis) == ("off", "102", point, "y")
    assert off.w_before is not None
    assert off.w_after is None
    assert (undone.what, undone.point, undone.axis) == ("undone", point, "y")
    assert (undone.w_before, undone.w_after) == (off.w_after, off.w_before)
    assert (whole.what, whole.axis) == ("off", "")
    assert (on.what, on.w_after) == ("on", off.w_before)
    assert (accepted.what, accepted.model, accepted.photo) == ("accepted", "101/102", "")


def test_a_return_is_told_with_what_was_measured_again_in_it(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    bench.give(Accept())
    bench.give(NextModel())
    point = bench.desk.state.models[0].plan[0].point
    bench.give(ReturnTo("101", "102", point))
    bench.give(KeepCounters())
    bench.measure(point)
    bench.give(Accept())
    bench.give(Undo())
    *_, reopened, left, right, accepted, undone = told(bench)
    assert (reopened.what, reopened.model, reopened.point) == ("reopened", "101/102", point)
    assert {(one.what, one.model, one.point) for one in (left, right)} == {
        ("remeasured", "101/102", point)
    }
    assert left.old is not None
    assert (accepted.what, accepted.model) == ("accepted", "101/102")
    assert (undone.what, undone.model) == ("undone", "101/102")


def test_an_undone_measurement_says_what_stands_again(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.give(NextModel())
    bench.measure_all()
    point = bench.desk.state.current.plan[0].point
    bench.measure(point)
    bench.give(Undo())
    *_, first, again, back, back_right = told(bench)
    assert again.photo == back_right.photo == "102"
    assert back.what == "undone"
    assert (back.old, back.new) == (first.new, first.old)
    assert (back_right.old, back_right.new) == (again.new, again.old)


@pytest.mark.slow
def test_in_a_mono_comparator_each_photo_by_itself(scene: Scene) -> None:
    bench = Bench.of(scene.block, MONO, truth=scene.made.truth)
    bench.give(NextModel())
    bench.measure_all()
    bench.give(OtherPhoto())
    bench.measure_all()
    found = told(bench)
    measured = [e for e in bench.events if isinstance(e, MonoMeasured)]
    assert [one.new for one in found] == [(e.x, e.y) for e in measured]
    assert {one.photo for one in found[:13]} == {"101"}
    assert {one.photo for one in found[13:]} == {"102"}


@pytest.mark.parametrize("session", sorted(p.name for p in SESSIONS.glob("*.jsonl")))
def test_every_recorded_session_can_be_told(session: str) -> None:
    records = read_journal(SESSIONS / session).records
    history = [
        Happened(record.time, "", event_of(record))
        for record in records
        if record.kind in EVENT_KINDS
    ]
    found = changes(recorded_block(SESSIONS / session, records), history)
    measured = sum(isinstance(happened.event, PointMeasured) for happened in history)
    assert sum(one.what in ("measured", "remeasured") for one in found) >= 2 * measured
    for one in found:
        assert (one.what == "remeasured") <= (one.old is not None)


def test_events_that_do_not_fit_are_refused(scene: Scene) -> None:
    event = PointMeasured("101", "102", "p", 0.0, 0.0, 0.0, 0.0, "key")
    with pytest.raises(EventRefusedError):
        changes(scene.block, [Happened("", "", event)])


def test_a_fiducial_is_told_with_a_residual_of_its_own() -> None:
    scene = InnerScene()
    laid = scene.choice(scene.start, 0)
    model = apply(scene.start, laid)
    before = fold(model, [scene.fiducial(model, name) for name in "12345678"])
    wrong = scene.fiducial(before, "3", dx=0.05)
    after = apply(before, wrong)

    def largest(state: SessionState, name: str) -> float:
        rows = solve_inner(scene.block, state.current.open_inner).rows
        return max(row.size for row in rows if row.point == name)

    events = (laid, *(scene.fiducial(model, name) for name in "12345678"), wrong)
    told_of = changes(scene.block, [Happened("", "", event) for event in events])[-1]
    assert (told_of.what, told_of.point) == ("remeasured", "3")
    assert (told_of.w_before, told_of.w_after) == (largest(before, "3"), largest(after, "3"))
    # others are off by more before
    assert told_of.w_before < max(largest(before, name) for name in "12345678")


def test_a_model_is_oriented_for_a_change_when_its_w_is_asked_for(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = models_of_w(monkeypatch)
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    bench.measure(bench.desk.state.current.plan[0].point)
    found = told(bench)
    assert asked == []
    again = found[-1]
    assert again.w_before is not None
    assert again.w_after is not None
    assert (again.w_before, again.w_after) == found[-2].w.both
    assert len(asked) == 2  # before and after it, for both photos
    # five points determine a model and test nothing: it is not oriented for them
    assert all(one.w.both == (None, None) for one in found[:10])
    assert len(asked) == 2
    assert found[10].w_after is not None


def test_w_is_a_part_of_what_makes_changes_equal() -> None:
    one = Change("t", "me", "off", "1/2", w=Sizes.known(3.0, None))
    assert one == Change("t", "me", "off", "1/2", w=Sizes.known(3.0, None))
    assert one != Change("t", "me", "off", "1/2", w=Sizes.known(3.5, None))
    assert hash(one) == hash(Change("t", "me", "off", "1/2", w=Sizes.known(3.0, None)))
    assert repr(one.w) == "Sizes(3.0, None)"
