"""Why a measurement was changed: asked once, kept, and written where the row is switched off."""

from __future__ import annotations

import pytest
from deskscene import DRIVEN, DRIVEN_MONO, Bench, changes, told
from innerscene import InnerScene
from sessionscene import Scene

from anaplot.errors import InputError
from anaplot.session.changes import Happened
from anaplot.session.commands import Accept, GiveReason, NextModel, Suspend, Switch, Undo
from anaplot.session.events import Event, FiducialSwitched, ReasonGiven, Undone
from anaplot.session.reasons import REASONS, LastChange
from anaplot.session.requests import WritePoints
from anaplot.session.state import EventRefusedError, apply
from anaplot.station.imagepoints import rows_of


@pytest.fixture
def bench(scene: Scene) -> Bench:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.give(NextModel())
    bench.measure_all()
    return bench


def test_a_first_measurement_is_no_change(bench: Bench) -> None:
    assert bench.desk.state.last_change is None
    with pytest.raises(InputError, match="nothing was changed yet"):
        bench.give(GiveReason("pointing"))
    with pytest.raises(EventRefusedError):
        apply(bench.desk.state, ReasonGiven("pointing"))


def test_a_reason_is_of_the_latest_change_until_the_next_one(bench: Bench) -> None:
    first, second = (p.point for p in bench.desk.state.current.plan[:2])
    bench.measure(first)
    name = bench.desk.state.current.name
    assert bench.desk.state.last_change == LastChange("remeasured", name, first)
    bench.give(GiveReason("pointing"))
    bench.give(GiveReason("identification"))  # thought better of
    assert bench.told[-1] == f"{first} measured again: identification"
    assert [one.reason for one in told(bench)[-2:]] == ["identification"] * 2
    bench.give(Switch(second, "y", False))
    assert bench.desk.state.last_change == LastChange("off", name, second, "y")
    # something that changes nothing measured comes between
    bench.give(Accept())
    assert not bench.desk.state.last_change.latest
    bench.give(GiveReason("transfer"))
    *_, again, _, off, accepted = told(bench)
    assert (again.reason, off.what, off.reason) == ("identification", "off", "transfer")
    assert (accepted.what, accepted.reason) == ("accepted", "")


def test_the_file_says_why_a_row_is_off(bench: Bench) -> None:
    state = bench.desk.state
    first, second, third = (p.point for p in state.current.plan[:3])
    bench.give(Switch(first, None, False))
    bench.give(GiveReason("instrument"))
    bench.give(Switch(second, "y", False))
    bench.give(Switch(third, "y", False))
    bench.give(GiveReason("pointing"))
    bench.give(Switch(third, "y", True))
    bench.give(Accept())
    state = bench.desk.state
    rows = {
        (row.photo, row.point): (row.use, row.reason)
        for row in rows_of(state.models, state.reasons)
    }
    assert rows.pop(("102", first)) == ("off", "instrument")
    assert rows.pop(("102", second)) == ("off", None)
    assert set(rows.values()) == {("xy", None)}  # on again: there is nothing to say
    # a reason given after the acceptance is written as well
    bench.give(Undo())
    bench.give(Switch(second, "y", True))
    bench.give(Switch(second, "y", False))
    bench.give(Accept())
    bench.requests.clear()
    bench.give(GiveReason("transfer"))
    assert WritePoints() in bench.requests
    state = bench.desk.state
    [row] = [r for r in rows_of(state.models, state.reasons) if r.reason == "transfer"]
    assert (row.photo, row.point, row.use) == ("102", second, "off")


def test_a_reason_is_not_what_an_undo_takes_back(bench: Bench) -> None:
    point = bench.desk.state.current.plan[0].point
    before = bench.desk.state
    bench.give(Switch(point, "y", False))
    bench.give(GiveReason("pointing"))
    bench.give(Undo())
    assert bench.desk.state.current == before.current
    assert bench.desk.state.last_change == LastChange("undone", before.current.name)
    bench.give(GiveReason("identification"))
    *_, off, undone = told(bench)
    assert (off.what, off.reason) == ("off", "pointing")
    assert (undone.what, undone.point, undone.reason) == ("undone", point, "identification")
    # switched off once more, it was for another reason
    bench.give(Switch(point, "y", False))
    state = bench.desk.state
    assert state.reasons == ()
    bench.give(Suspend())
    with pytest.raises(EventRefusedError, match="suspended"):
        bench.give(GiveReason("pointing"))


def test_each_reason_is_one_of_four() -> None:
    assert REASONS == ("pointing", "identification", "transfer", "instrument")


def test_tests_before_and_after_of_a_mono_comparator(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN_MONO, truth=scene.made.truth)
    bench.whole_model()
    model = bench.desk.state.current
    point = model.plan[3].point
    bench.measure(point)
    bench.give(GiveReason("pointing"))
    change = told(bench)[-1]
    assert (change.what, change.photo, change.reason) == ("remeasured", model.right, "pointing")
    assert change.old is not None
    assert change.w_before is not None
    assert change.w_after is not None
    # before the point was measured in both photos there was no row of it
    assert told(bench)[0].w_after is None


def test_a_fiducial_has_its_tests_before_and_after_and_its_reason() -> None:
    scene = InnerScene()
    state = scene.start
    events: list[Event] = []

    def happen(event: Event) -> None:
        nonlocal state
        events.append(event)
        state = apply(state, event)

    happen(scene.choice(state, 0))
    for name in "12345678":
        happen(scene.fiducial(state, name, dx=0.2 if name == "3" else 0.0))
    happen(scene.fiducial(state, "3"))
    happen(ReasonGiven("pointing"))
    happen(FiducialSwitched("101", "5", "x", on=False))
    happen(ReasonGiven("instrument"))
    happen(Undone())
    found = changes(scene.block, (Happened("", "", event) for event in events))
    *_, last, again, off, undone = found
    assert (again.what, again.photo, again.reason) == ("remeasured", "101", "pointing")
    assert again.new == pytest.approx((again.old[0] - 0.2, again.old[1]))
    assert again.w_before > 6.0 > 4.0 > again.w_after
    assert last.w_after is not None
    assert (off.what, off.point, off.axis, off.reason) == ("off", "5", "x", "instrument")
    assert off.w_before is not None
    assert off.w_after is not None  # that of the fiducial's other coordinate
    assert (undone.what, undone.w_before, undone.w_after) == ("undone", off.w_after, off.w_before)
    assert state.reasons == ()  # no file has a place for them
