"""Pointing again at something measured: the mark moves away, nothing measured changes."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import pytest
from deskscene import DRIVEN, DRIVEN_MONO, MONO, UNDRIVEN, Bench, changes
from innerscene import InnerScene
from sessionscene import Scene

from anaplot.errors import InputError
from anaplot.photogrammetry.readings import Position, Record
from anaplot.session.changes import Happened
from anaplot.session.commands import Drive, NextModel, PointAgain, Stop, Undo
from anaplot.session.events import Place, PointRepeated
from anaplot.session.requests import DriveTo
from anaplot.session.state import EventRefusedError, apply


def measured(scene: Scene, abilities=DRIVEN) -> Bench:
    bench = Bench.of(scene.block, abilities, truth=scene.made.truth)
    bench.give(NextModel())
    if abilities.moves:
        bench.measure_all()
    else:
        for planned in bench.desk.state.current.plan:
            _set(bench, planned.point)
            bench.press()
    return bench


def _set(bench: Bench, point: str, beside: float = 0.0) -> None:
    """The mark is set by hand where the point is planned, or beside."""
    p = bench.desk.state.current.planned(point)
    bench.stands = Position(p.xl + beside, p.yl, p.xr + beside, p.yr)


def apart(a: Position, b: Position) -> tuple[float, float]:
    return hypot(a.xl - b.xl, a.yl - b.yl), hypot(a.xr - b.xr, a.yr - b.yr)


def test_the_plates_move_50_um_away_and_nothing_measured_changes(scene: Scene) -> None:
    bench = measured(scene)
    before = bench.desk
    point = before.state.current.plan[3].point
    stood = before.mode.stands(point, Position(0, 0, 0, 0))
    bench.give(PointAgain(point, 3))
    seen = []
    for k in range(3):
        assert bench.desk.target == bench.desk.next_name == point
        assert bench.desk.expected == f"set the mark on point {point} anew: {k + 1} of 3"
        drive = bench.requests[-1]
        assert isinstance(drive, DriveTo)
        assert apart(drive.position, stood) == pytest.approx((0.05, 0.05))
        seen.append(drive.position)
        bench.arrive()
        bench.stands = stood
        bench.press()
        assert bench.told[-1] == f"{point} pointed at again, {k + 1} of 3"
    assert len(set(seen)) == 3  # in directions of their own
    assert bench.desk.repeating is None
    assert bench.desk.target is None
    repeated = bench.events[-3:]
    assert [type(e) for e in repeated] == [PointRepeated] * 3
    assert all(e.moved and e.name == point and not e.fiducial for e in repeated)
    assert [p.photo for p in repeated[0].places] == ["101", "102"]
    assert bench.desk.state == before.state
    assert bench.desk.outlook.solution is before.outlook.solution


def test_the_point_under_the_mark_or_the_last_one(scene: Scene) -> None:
    bench = measured(scene)
    last = bench.desk.last_measured
    bench.give(PointAgain())
    assert bench.desk.target == last
    point = bench.desk.state.current.plan[0].point
    bench.give(Drive(last))
    assert bench.desk.repeating is not None  # it is still the repetition
    bench.give(Drive(point))
    assert bench.desk.repeating is None
    bench.arrive()
    bench.give(PointAgain())
    assert bench.desk.repeating.name == point
    bench.give(Stop())
    assert bench.desk.repeating is None
    assert bench.desk.target is None  # a record then is no measurement by mistake


def test_what_comes_next_is_driven_to_after_the_last_one(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.give(NextModel())
    first, second = (p.point for p in bench.desk.state.current.plan[:2])
    with pytest.raises(InputError, match="drive to a point first"):
        bench.give(PointAgain())
    with pytest.raises(InputError, match="not measured yet"):
        bench.give(PointAgain(second))
    bench.measure(first)
    bench.give(PointAgain(first, 1))
    bench.arrive()
    bench.press()
    assert bench.desk.target == second


def test_undo_takes_one_pointing_back_and_ends_it(scene: Scene) -> None:
    bench = measured(scene)
    state = bench.desk.state
    bench.give(PointAgain(times=2))
    bench.arrive()
    bench.press()
    bench.give(Undo())
    assert bench.desk.state == state
    assert bench.desk.repeating is None
    assert len(bench.desk.state._history) == len(state._history)
    # told as nothing: no measurement has changed
    told = changes(scene.block, [Happened("", "", e) for e in bench.events])
    assert [one.what for one in told] == ["measured"] * 26


def test_by_hand_the_mark_has_to_be_seen_away(scene: Scene) -> None:
    bench = measured(scene, UNDRIVEN)
    point = bench.desk.last_measured
    bench.give(PointAgain(point, 2))
    assert bench.desk.expected == f"move the mark away from point {point}, set it anew: 1 of 2"
    _set(bench, point, 0.01)
    bench.hear(bench.stands)
    bench.press()
    assert bench.events[-1].moved is False
    assert any("does not count" in text for text in bench.told)
    _set(bench, point, 0.2)
    bench.hear(bench.stands)
    assert bench.desk.expected == f"set the mark on point {point} anew: 2 of 2"
    _set(bench, point)
    bench.press()
    assert bench.events[-1].moved is True
    assert bench.desk.repeating is None


@pytest.mark.parametrize("abilities", [MONO, DRIVEN_MONO])
def test_in_a_mono_comparator_one_photo(scene: Scene, abilities) -> None:
    bench = Bench.of(scene.block, abilities, truth=scene.made.truth)
    bench.give(NextModel())
    point = bench.desk.state.current.plan[0].point
    if abilities.moves:
        bench.measure(point)
    else:
        _set(bench, point)
        bench.press()
    bench.give(PointAgain(point, 1))
    if abilities.moves:
        bench.arrive()
    bench.press()
    event = bench.events[-1]
    assert [place.side for place in event.places] == ["left"]
    assert event.moved is abilities.moves


def test_fiducials_on_their_plate() -> None:
    scene = InnerScene()
    bench = Bench.of(scene.block, DRIVEN)
    bench.give(NextModel())
    inner = bench.desk.state.current.open_inner
    name = inner.fiducials[0]
    bench.measure(name)
    m = bench.desk.state.current.inner_of("left").measurement(name)
    waiting = bench.stands
    bench.give(PointAgain(name, 1))
    left, _ = apart(bench.stands, Position(m.x, m.y, 0.0, 0.0))
    assert left == pytest.approx(0.05)
    assert (bench.stands.xr, bench.stands.yr) == (waiting.xr, waiting.yr)
    bench.arrive()
    bench.press()
    event = bench.events[-1]
    assert isinstance(event, PointRepeated)
    assert event.fiducial
    assert [(p.photo, p.side) for p in event.places] == [(inner.photo, "left")]
    assert bench.desk.state.current.inner_of("left").measurement(name).times == 1


def test_what_cannot_be_a_repetition_is_refused(scene: Scene) -> None:
    bench = measured(scene)
    point = bench.desk.state.current.plan[0].point
    bench.give(PointAgain(point, 1))
    bench.arrive()
    bench.press()
    good = bench.events[-1]
    state = bench.desk.state
    left, right = good.places
    apply(state, good)
    for wrong, why in [
        (replace(good, right="103"), "is in the instrument"),
        (replace(good, fiducial=True), "points are measured now"),
        (replace(good, places=(left,)), "not in the photos"),
        (replace(good, places=()), "not in the photos"),
        (replace(good, places=(left, replace(right, photo="9"))), "does not lie on the right"),
        (replace(good, places=(left, replace(right, x=float("nan")))), "is no place"),
        (replace(good, places=(left, Place("102", "right", 900.0, 0.0))), "lies outside"),
        (replace(good, name="nowhere"), "nothing to repeat"),
    ]:
        with pytest.raises(EventRefusedError, match=why):
            apply(state, wrong)
    with pytest.raises(InputError):
        bench.give(PointAgain(point, 0))
    looking = Bench(replace(bench.desk, abilities=None))
    with pytest.raises(InputError, match="no plotter"):
        looking.give(PointAgain(point))


def test_a_record_of_the_measurement_itself_stays_one(scene: Scene) -> None:
    bench = measured(scene)
    point = bench.desk.state.current.plan[0].point
    bench.give(Drive(point))
    bench.arrive()
    bench.hear(Record(bench.stands, "pedal"))
    assert bench.desk.state.current.measurement(point).times == 2
