"""How photos lie is no matter of undo: what is believed of them after one, and after a restart."""

from __future__ import annotations

import pytest
from deskscene import DRIVEN, DRIVEN_MONO, Bench
from innerscene import InnerScene
from sessionscene import Scene

from anaplot.exchange.eventcodec import event_from_payload
from anaplot.session.commands import Accept, Drive, NextModel, OtherPhoto, ReturnTo, Switch, Undo
from anaplot.session.desk import Desk
from anaplot.session.events import PointMeasured, Undone
from anaplot.session.state import apply, fold
from anaplot.station.blockstatus import status_of
from anaplot.station.livestatus import LiveStatus

WITH, WITHOUT = InnerScene(3), Scene(4)


def oriented(bench: Bench) -> list[bool]:
    """Which photos of the model in work have an accepted inner orientation."""
    model = bench.desk.state.current
    assert model is not None
    return [inner.accepted is not None for inner in model.inner]


def undo_to(bench: Bench, photos: tuple[str, str]) -> None:
    """Undo until a model is in work."""
    while (model := bench.desk.state.current) is None or model.photos != photos:
        bench.give(Undo())


def check(bench: Bench) -> None:
    """Record the points by which photos laid in anew are checked."""
    while (name := bench.desk.check) is not None:
        if bench.desk.target != name:
            bench.give(Drive(name))
        bench.arrive()
        bench.press()


def fiducials(bench: Bench) -> None:
    """Measure and accept the inner orientations of what lies there."""
    while bench.desk.state.current.open_inner is not None:
        while bench.desk.mode.pending:
            bench.measure(bench.desk.mode.pending[0])
        bench.give(Accept())


def test_an_undo_brings_no_photographs_back() -> None:
    bench = Bench.of(WITH.block, DRIVEN)
    bench.whole_model()
    bench.give(Accept())
    bench.give(NextModel())
    bench.measure(bench.desk.mode.pending[0])
    undo_to(bench, ("101", "102"))
    assert oriented(bench) == [False, False]
    assert "measure fiducial" in bench.desk.expected
    # nor do further undos believe what was measured before the photos were taken out
    fiducials(bench)
    for _ in range(30):
        bench.give(Undo())
        assert bench.desk.state.current.photos == ("101", "102")
        assert oriented(bench) != [True, True]


def test_what_an_older_version_has_undone_stays_as_it_was() -> None:
    """It believed the inner orientations, and points were measured with them."""
    bench = Bench.of(WITH.block, DRIVEN)
    bench.whole_model()
    first = bench.desk.state.current
    bench.give(Accept())
    bench.give(NextModel())
    bench.measure(bench.desk.mode.pending[0])
    state = fold(bench.desk.state, [Undone()] * 3)
    assert state.current == first
    again = first.measured[0]
    event = PointMeasured("101", "102", again.point, again.xl, again.yl, again.xr, again.yr, "key")
    assert apply(state, event).current.measurement(again.point).times == 2
    bench.give(Undo())
    bench.give(Undo())
    assert bench.events[-1] == Undone(False)
    bench.give(Undo())
    assert bench.events[-1] == Undone(True)
    assert event_from_payload("undone", {}) == Undone(False)


def test_what_was_called_for_by_mistake_was_not_laid_in() -> None:
    bench = Bench.of(WITH.block, DRIVEN)
    bench.whole_model()
    bench.give(Accept())
    bench.give(NextModel())
    undo_to(bench, ("101", "102"))
    assert oriented(bench) == [True, True]
    bench.give(Accept())
    bench.give(ReturnTo("101", "102"))
    undo_to(bench, ("101", "102"))
    bench.give(Undo())
    bench.give(Undo())
    assert oriented(bench) == [True, True]


def test_a_return_that_is_taken_back_has_changed_the_photographs() -> None:
    bench = Bench.of(WITH.block, DRIVEN)
    bench.whole_model()
    bench.give(Accept())
    bench.whole_model()
    bench.give(ReturnTo("101", "102"))
    fiducials(bench)
    undo_to(bench, ("102", "103"))
    assert oriented(bench) == [False, False]


def test_without_fiducials_two_points_are_checked_after_such_an_undo() -> None:
    bench = Bench.of(WITHOUT.block, DRIVEN)
    bench.whole_model()
    bench.give(Accept())
    bench.whole_model()
    bench.give(ReturnTo("101", "102", "101-1"))
    check(bench)
    bench.measure("101-1")
    undo_to(bench, ("102", "103"))
    assert len(bench.desk.checks) == 2
    assert "the photos lie anew" in bench.desk.expected
    check(bench)
    assert bench.desk.checks == ()


def test_checks_of_a_model_that_waited_are_due_after_a_restart() -> None:
    bench = Bench.of(WITHOUT.block, DRIVEN)
    bench.whole_model()
    bench.give(Accept())
    bench.give(NextModel())
    while len(bench.desk.mode.pending) > 4:
        bench.measure(bench.desk.mode.pending[0])
    assert Desk.at(bench.desk.state, DRIVEN).checks == ()
    bench.give(ReturnTo("101", "102", "101-1"))
    check(bench)
    bench.measure("101-1")
    bench.give(Accept())
    due = bench.desk.checks
    assert len(due) == 2
    assert Desk.at(bench.desk.state, DRIVEN).checks == due
    assert Desk.at(bench.desk.state).checks == ()  # nothing can be recorded
    check(bench)
    bench.measure(bench.desk.mode.pending[0])
    assert Desk.at(bench.desk.state, DRIVEN).checks == ()


def test_a_photo_laid_into_a_comparator_again_is_checked() -> None:
    bench = Bench.of(WITHOUT.block, DRIVEN_MONO)
    bench.whole_model()
    assert bench.desk.checks == ()
    bench.give(OtherPhoto())
    assert len(bench.desk.checks) == 2
    check(bench)
    bench.give(Accept())
    bench.give(NextModel())
    check(bench)
    bench.measure_all()
    # what was measured in one photo only is on record, too
    bench.give(ReturnTo("101", "102"))
    bench.give(OtherPhoto())
    check(bench)
    bench.give(Accept())
    assert bench.desk.state.current.photos == ("102", "103")
    bench.give(OtherPhoto())
    assert bench.desk.state.current.laid == "left"
    assert len(bench.desk.checks) == 2


@pytest.mark.parametrize("scene", [WITH, WITHOUT])
def test_a_photo_can_be_laid_in_where_nobody_knows_which_lies_there(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN_MONO)
    bench.whole_model()
    bench.give(OtherPhoto())
    bench.give(Undo())
    assert bench.desk.state.current.laid is None
    for side in ("left", "right", "left"):
        bench.give(OtherPhoto())
        assert bench.desk.state.current.laid == side


def test_a_photo_of_a_comparator_is_laid_in_before_its_model_is_accepted() -> None:
    bench = Bench.of(WITHOUT.block, DRIVEN_MONO)

    def next_photo() -> tuple[str, str]:
        state = bench.desk.state
        step = LiveStatus("b").now(state.block, bench.desk, None, {}).next
        assert step == status_of(state.block, state, None, "b").next
        return step.do, step.photo

    bench.give(NextModel())
    bench.measure_all()
    assert next_photo() == ("measure", "102")
    bench.give(NextModel())
    while len(bench.desk.mode.pending) > 3:
        bench.measure(bench.desk.mode.pending[0])
    assert next_photo() == ("measure", "")
    bench.give(OtherPhoto())
    assert next_photo() == ("measure", "102")
    bench.give(NextModel())
    check(bench)
    bench.measure_all()
    while (doubted := bench.desk.outlook.next_point) is not None:
        bench.give(Switch(doubted, None, False))
    assert next_photo() == ("accept", "")


def test_an_undo_says_what_is_taken_back_where_photos_lie_anew() -> None:
    bench = Bench.of(WITH.block, DRIVEN_MONO)
    bench.whole_model()
    bench.give(OtherPhoto())
    bench.give(Undo())
    assert bench.told[-1] == "undone: the photo in the comparator is not known any more"
    bench = Bench.of(WITH.block, DRIVEN)
    bench.whole_model()
    last = bench.desk.last_measured
    bench.give(Accept())
    bench.give(NextModel())
    bench.measure(bench.desk.mode.pending[0])
    undo_to(bench, ("101", "102"))
    assert bench.told[-1] == "undone: model 101/102 is in work again"
    fiducials(bench)
    while bench.desk.state.current.measurement(last) is not None:
        bench.give(Undo())
    assert bench.told[-1] == f"undone: {last} is not measured any more"
