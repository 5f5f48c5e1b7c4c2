"""The desk alone: no threads, no files, no ports; every mode, every refusal, random work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from deskscene import DRIVEN, DRIVEN_MONO, MONO, UNDRIVEN, Bench, refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from innerscene import InnerScene
from sessionscene import Scene

from anaplot.errors import AnaplotError, InputError, NotComputableError
from anaplot.photogrammetry.readings import (
    KEY,
    UNREFERENCED,
    Fault,
    InPosition,
    Position,
    Record,
    Refused,
)
from anaplot.session.commanding import decide
from anaplot.session.commands import (
    Accept,
    AddPoint,
    Command,
    Drive,
    KeepCounters,
    NextModel,
    OtherPhoto,
    RecordPoint,
    Reference,
    Resume,
    ReturnTo,
    Stop,
    Suspend,
    Switch,
    TakeOver,
    TurnWheels,
    Undo,
)
from anaplot.session.desk import Desk
from anaplot.session.events import (
    FiducialMeasured,
    ModelAccepted,
    ModelChosen,
    MonoMeasured,
    PhotoLaid,
    PlannedPoint,
    PointMeasured,
)
from anaplot.session.heard import (
    Abilities,
    DriveFailed,
    KeyFailed,
    LinkChanged,
    MarkSet,
    ReferenceLost,
    Seen,
)
from anaplot.session.hearing import hear
from anaplot.session.modes import Fiducials, Pairs, Singles
from anaplot.session.requests import (
    DriveTo,
    Lay,
    ReadAnew,
    Refer,
    SetMark,
    StopDrive,
    TakeRecord,
    Tell,
    WarmUp,
    WritePoints,
)
from anaplot.session.state import fold, start

FAR = Position(400.0, 400.0, 400.0, 400.0)


@pytest.fixture
def bench(scene: Scene) -> Bench:
    """Plates that are driven, all points known."""
    return Bench.of(scene.block, truth=scene.made.truth)


def kinds(bench: Bench) -> list[type]:
    return [type(request) for request in bench.requests]


# -- the work --------------------------------------------------------------------------------------


def test_a_strip_in_pairs(scene: Scene, bench: Bench) -> None:
    for left, right in scene.block.strips[0].models():
        bench.whole_model()
        assert isinstance(bench.desk.mode, Pairs)
        assert bench.desk.expected == "accept the model"
        bench.give(Accept())
        assert bench.events[-1] == ModelAccepted(left, right)
        assert bench.requests[-1] == WritePoints()
    assert bench.desk.mode is None
    assert bench.desk.outlook.finished
    assert fold(start(scene.block), bench.events) == bench.desk.state
    assert refusal(bench.desk, NextModel(), bench.seen) == "every model of the block is accepted"


def test_what_is_asked_for_when_a_model_is_chosen(bench: Bench) -> None:
    bench.give(NextModel())
    assert kinds(bench) == [WritePoints, WarmUp, Tell, Lay, DriveTo]
    assert bench.told == ["photos 101 and 102: 13 points to measure"]
    assert bench.desk.laid == Lay("101", "102")
    first = bench.desk.target
    assert first == bench.desk.next_name
    assert bench.desk.drive_target == bench.stands
    # the plates go on by themselves after a record
    bench.arrive()
    bench.press()
    assert bench.told[-1] == f"{first} recorded"
    assert bench.desk.target == bench.desk.next_name != first


def test_fiducials_come_first() -> None:
    scene = InnerScene(3)
    bench = Bench.of(scene.block)
    bench.give(NextModel())
    for photo in ("101", "102"):
        mode = bench.desk.mode
        assert isinstance(mode, Fiducials)
        assert mode.inner.photo == photo
        for fiducial in mode.pending:
            bench.measure(fiducial)
        bench.give(Accept())
        assert bench.told[-1].startswith(f"inner orientation of photo {photo}")
    assert isinstance(bench.desk.mode, Pairs)
    measured = [event for event in bench.events if isinstance(event, FiducialMeasured)]
    assert {event.side for event in measured} == {"left", "right"}


def test_one_photo_after_the_other(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN_MONO, truth=scene.made.truth)
    assert bench.desk.expected == "lay photo 101 into the comparator: next model, 101 / 102"
    bench.whole_model()
    assert isinstance(bench.desk.mode, Singles)
    laid = [event.photo for event in bench.events if isinstance(event, PhotoLaid)]
    assert laid == ["101", "102"]
    assert isinstance(bench.events[0], ModelChosen)
    assert bench.events[0].mono
    sides = [event.side for event in bench.events if isinstance(event, MonoMeasured)]
    assert sides == ["left"] * 13 + ["right"] * 13
    assert bench.desk.laid == Lay("101", "102", "right", "right")
    bench.give(OtherPhoto())
    assert bench.desk.state.current is not None
    assert bench.desk.state.current.laid == "left"
    bench.give(Accept())
    bench.give(NextModel())
    # 102 is laid in again: in the placement of a left photo
    assert bench.desk.laid == Lay("102", "103", "left", "left")


def test_a_photo_that_stays_in_the_comparator_stays_as_it_lies(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN_MONO, truth=scene.made.truth)
    bench.whole_model()
    bench.give(Accept())
    bench.give(NextModel())
    assert [type(event) for event in bench.events[-1:]] == [ModelChosen]
    assert bench.desk.laid == Lay("102", "103", "left", "right")


def test_points_by_hand_in_the_order_of_the_plan(scene: Scene) -> None:
    bench = Bench.of(scene.block, UNDRIVEN, truth=scene.made.truth)
    bench.give(NextModel())
    assert DriveTo not in kinds(bench)
    # the next one is named, and not believed when another is chosen
    model = bench.desk.state.current
    assert model is not None
    assert bench.desk.target == model.plan[0].point
    bench.give(Drive(model.plan[3].point))
    bench.stands = Position(model.plan[3].xl, model.plan[3].yl, model.plan[3].xr, model.plan[3].yr)
    (event,) = bench.press().events
    assert isinstance(event, PointMeasured)
    assert event.point == model.plan[3].point


def test_without_an_instrument_one_looks_on(scene: Scene) -> None:
    bench = Bench.of(scene.block, None, truth=scene.made.truth)
    bench.give(NextModel())
    assert bench.desk.laid is None
    assert {Lay, DriveTo} & set(kinds(bench)) == set()
    assert refusal(bench.desk, RecordPoint(), bench.seen) == (
        "no plotter is connected: nothing to record"
    )
    bench.give(Stop())
    assert StopDrive not in kinds(bench)


def test_a_point_beyond_the_plan(bench: Bench) -> None:
    bench.give(NextModel())
    bench.seen = replace(bench.seen, position=Position(1.0, 2.0, -90.0, 2.0))
    # where the drive ends it would not be this point
    with pytest.raises(InputError, match="the plates are still under way"):
        bench.give(AddPoint("extra"))
    bench.arrive()
    bench.seen = replace(bench.seen, position=Position(1.0, 2.0, -90.0, 2.0))
    bench.give(AddPoint("extra"))
    assert bench.desk.target == "extra"
    model = bench.desk.state.current
    assert model is not None
    assert model.plan[-1] == PlannedPoint("extra", "new", 1.0, 2.0, -90.0, 2.0)


# -- plates and mark -------------------------------------------------------------------------------


def test_plates_under_way_record_nothing(bench: Bench) -> None:
    bench.give(NextModel())
    assert not bench.desk.standing
    with pytest.raises(InputError, match="the plates are still under way"):
        bench.give(RecordPoint())
    bench.press()
    assert bench.told[-1] == "not recorded: the plates are still under way"
    assert bench.notes[-1] == ("record-refused", {"reason": "the plates are still under way"})
    assert len(bench.events) == 1
    with pytest.raises(InputError, match="under way"):
        bench.give(TurnWheels())


@pytest.mark.parametrize(("dx", "arrives"), [(0.0, True), (0.9, True), (1.1, False)])
def test_a_reply_belongs_to_the_present_drive(bench: Bench, dx: float, arrives: bool) -> None:
    bench.give(NextModel())
    at = bench.stands
    bench.hear(InPosition(replace(at, xl=at.xl + dx)))
    assert bench.desk.standing == arrives


def test_a_late_reply_of_a_drive_given_up_ends_no_other(bench: Bench) -> None:
    bench.give(NextModel())
    given_up = bench.stands
    bench.give(Stop())
    bench.hear(InPosition(given_up))
    near = replace(given_up, xl=given_up.xl + 0.5, xr=given_up.xr + 0.5)
    bench.give(Drive(bench.desk.next_name or ""))
    # as near as points of one place are to each other
    assert bench.desk.replies.unanswered == (given_up,)
    bench.desk = replace(
        bench.desk, drive_target=near, replies=bench.desk.replies.driven(near), errand=9
    )
    bench.hear(InPosition(replace(given_up, yl=given_up.yl + 0.01)))
    assert not bench.desk.standing
    bench.hear(InPosition(replace(near, yl=near.yl + 0.1)))
    assert bench.desk.standing


def test_driven_again_to_where_it_was_given_up(bench: Bench) -> None:
    bench.give(NextModel())
    point = bench.desk.target or ""
    bench.give(Stop())
    bench.give(Drive(point))
    bench.hear(InPosition(replace(bench.stands, yl=bench.stands.yl + 0.3)))
    assert bench.desk.standing
    assert bench.desk.target == point


def test_a_reply_that_does_not_say_where_the_plates_are_needs_read_outs(bench: Bench) -> None:
    bench.give(NextModel())
    at = bench.stands
    on_the_way = [replace(at, xl=at.xl - dx) for dx in (40.0, 40.0, 20.0, 0.9, 0.5)]
    # of a drive given up before
    bench.hear(InPosition())
    for here in on_the_way:
        bench.hear(here)
        assert not bench.desk.standing
    # they stand, as near as such a drive comes
    bench.hear(replace(on_the_way[-1], yr=at.yr + 0.002))
    assert bench.desk.standing


def test_without_a_reply_plates_that_stand_beside_have_not_arrived(bench: Bench) -> None:
    bench.give(NextModel())
    for _ in range(3):
        bench.hear(replace(bench.stands, xl=bench.stands.xl - 0.5))
    assert not bench.desk.standing
    bench.hear(InPosition())
    bench.give(Drive(bench.desk.next_name or ""))  # what was said is of the drive before
    for _ in range(3):
        bench.hear(replace(bench.stands, xl=bench.stands.xl - 0.5))
    assert not bench.desk.standing


def test_where_nothing_is_read_a_reply_is_all_that_there_is(scene: Scene) -> None:
    bench = Bench.of(scene.block, Abilities(reads=False), truth=scene.made.truth)
    bench.give(NextModel())
    bench.hear(InPosition())
    assert bench.desk.standing


@pytest.mark.parametrize(("dx", "arrives"), [(0.019, True), (0.021, False)])
def test_a_read_out_at_the_target_ends_a_drive(bench: Bench, dx: float, arrives: bool) -> None:
    bench.give(NextModel())
    at = bench.stands
    bench.hear(replace(at, yr=at.yr - dx))
    assert bench.desk.standing == arrives


def test_a_mark_set_after_an_earlier_drive_does_not_count(bench: Bench) -> None:
    bench.at_hand()
    bench.give(NextModel())
    first = bench.begun
    bench.give(Drive(bench.desk.target or ""))
    bench.hear(InPosition(bench.stands))
    bench.hear(MarkSet(first))
    bench.press()
    assert bench.told[-1] == "not recorded: the hand is still setting the mark"
    bench.hear(MarkSet(bench.begun, "nothing there"))
    assert bench.told[-1] == "nothing there"
    assert bench.requests[-2] == ReadAnew()
    assert bench.press().events


def test_plates_that_are_stopped_are_nowhere(bench: Bench) -> None:
    bench.give(NextModel())
    target, there = bench.desk.target, bench.stands
    bench.give(Stop())
    assert bench.desk.standing
    assert bench.desk.target is None
    assert bench.desk.next_name == target
    # wherever they stand, and though they ran on
    bench.hear(InPosition(there))
    bench.hear(there)
    bench.press()
    assert bench.told[-1] == "not recorded: drive to a point first"
    bench.measure(target or "")


def test_plates_that_stand_stay_where_they_are(bench: Bench) -> None:
    bench.give(NextModel())
    target = bench.desk.target
    bench.arrive()
    bench.give(Stop())
    assert bench.desk.target == target
    assert bench.press().events


def test_a_hand_that_was_not_asked_yet_has_set_no_mark(scene: Scene) -> None:
    bench = Bench.of(scene.block, Abilities(drives=False), truth=scene.made.truth)
    bench.at_hand()
    bench.give(NextModel())
    bench.desk = replace(bench.desk, settles_after=None)
    bench.give(Stop())
    assert bench.desk.standing
    assert bench.desk.target is None


@pytest.mark.parametrize("command", [TakeOver(), TurnWheels(), Stop()])
def test_whoever_takes_the_wheels_sets_the_mark(bench: Bench, command: Command) -> None:
    bench.at_hand()
    bench.give(NextModel())
    bench.hear(InPosition(bench.stands))
    assert not bench.desk.standing
    bench.give(command)
    assert bench.desk.standing
    assert bench.press().events


def test_the_key_asks_for_a_record(bench: Bench) -> None:
    bench.give(NextModel())
    bench.arrive()
    before = bench.desk
    bench.give(RecordPoint())
    assert bench.requests[-1] == TakeRecord()
    assert bench.desk.state is before.state
    assert bench.desk.target == before.target


def test_a_second_press_is_not_another_point(scene: Scene) -> None:
    bench = Bench.of(scene.block, truth=scene.made.truth, auto_drive=False)
    bench.give(NextModel())
    assert bench.desk.mode is not None
    bench.measure(bench.desk.mode.pending[0])
    bench.press()
    assert bench.told[-1] == "not recorded: drive to a point first"


@pytest.mark.parametrize(
    "heard", [Fault("3", "lost counts"), LinkChanged("lost", "gone"), DriveFailed(0)]
)
def test_what_interrupts_a_drive_leads_nowhere(bench: Bench, heard: Fault) -> None:
    bench.give(NextModel())
    if isinstance(heard, DriveFailed):
        # one that another has followed is of no concern
        bench.hear(heard)
        assert not bench.desk.standing
        heard = DriveFailed(bench.desk.errand)
    bench.hear(heard)
    assert bench.desk.target is None
    assert bench.desk.standing
    # while the plates stand, it changes nothing
    bench.give(Drive(bench.desk.mode.pending[0]))
    bench.arrive()
    target = bench.desk.target
    bench.hear(heard)
    assert bench.desk.target == target


def test_what_is_told_of_the_line(bench: Bench) -> None:
    bench.hear(LinkChanged("lost", "unplugged"))
    bench.hear(LinkChanged("reconnecting"))
    bench.hear(LinkChanged("lost"))
    bench.hear(Fault("7", "overheated"))
    assert bench.told == ["link lost: unplugged", "link lost", "plotter fault 7: overheated"]
    assert bench.notes == [("fault", {"code": "7", "text": "overheated"})]


def test_bytes_that_are_no_reading_are_told_once_a_second(bench: Bench) -> None:
    for time in (0.0, 0.4, 0.9, 1.0, 1.5):
        bench.seen = replace(bench.seen, time=time)
        bench.hear(Refused(b"?", "not a record"))
    assert bench.told == ["line: not a record"] * 2
    assert len(bench.notes) == 5
    bench.hear(Refused(b"", UNREFERENCED))
    assert len(bench.notes) == 5


def test_a_flagged_row_is_told(bench: Bench) -> None:
    bench.give(NextModel())
    while len(bench.desk.mode.pending) > 1:
        bench.measure(bench.desk.mode.pending[0])
    bench.arrive()
    bench.press(dyr=0.5)
    assert any(text.startswith("flagged: ") for text in bench.told)


# -- taking back -----------------------------------------------------------------------------------


def test_undo_of_an_acceptance_lays_the_photos_again(bench: Bench) -> None:
    bench.whole_model()
    bench.give(Accept())
    decision = bench.give(Undo())
    told = Tell("info", "undone: model 101/102 is in work again")
    assert decision.requests == (WritePoints(), Lay("101", "102"), told)
    assert bench.desk.target is None
    assert bench.desk.expected == "accept the model"


def test_undo_of_a_record_keeps_the_target_that_there_still_is(bench: Bench) -> None:
    bench.give(NextModel())
    bench.measure(bench.desk.target or "")
    target = bench.desk.target
    bench.give(Undo())
    assert bench.desk.target == target
    bench.seen = replace(bench.seen, position=Position(1.0, 2.0, -90.0, 2.0))
    bench.arrive()
    bench.give(AddPoint("extra"))
    bench.give(Undo())
    assert bench.desk.target is None


# -- the counters' reference -----------------------------------------------------------------------


def lost(scene: Scene) -> Bench:
    """Counters that lost their reference after six points."""
    bench = Bench.of(scene.block, truth=scene.made.truth)
    bench.give(NextModel())
    for _ in range(6):
        bench.measure(bench.desk.target or "")
    bench.arrive()
    bench.hear(ReferenceLost())
    return bench


def point_at(bench: Bench, shift: float) -> None:
    """Point at the reference proposed, with counters that are off."""
    at = bench.desk.reference
    assert at is not None
    left, right = at.places["left"], at.places["right"]
    counters = Position(left[0] - shift, left[1], right[0] - shift, right[1])
    bench.seen = replace(bench.seen, counters=counters, read=True)
    bench.give(Reference())


def moved_away(bench: Bench) -> None:
    """Move the plates away from where they are, in what their counters are moved by."""
    at, by = bench.seen.counters, bench.seen.shift
    assert at is not None
    bench.hear(Position(at.xl + by.xl, at.yl + by.yl, at.xr + by.xr, at.yr + by.yr))
    assert bench.desk.referencing is not None
    assert not bench.desk.referencing.moved
    bench.hear(Position(at.xl + by.xl + 0.05, at.yl + by.yl, at.xr + by.xr, at.yr + by.yr))
    assert bench.desk.referencing.moved


@pytest.mark.parametrize("line", ["lost", "reconnecting"])
def test_nothing_is_recorded_over_a_line_that_is_lost(scene: Scene, line: str) -> None:
    # "drive to a point first" was said, although the plates stood on it
    bench = lost(scene)
    bench.seen = replace(bench.seen, line=line)
    with pytest.raises(InputError, match=f"the plotter's line is {line}"):
        bench.give(RecordPoint())


def test_a_reference_is_measured_twice(scene: Scene) -> None:
    bench = lost(scene)
    last = bench.desk.last_measured
    assert bench.told[-1] == UNREFERENCED
    assert bench.notes[-1] == ("unreferenced", {"reason": UNREFERENCED})
    assert bench.desk.target is None
    assert bench.desk.next_name == last
    assert bench.desk.expected == (
        f"the counters have lost their reference: set the mark on point {last} and press R"
    )
    # heard again and again, told once
    again = bench.hear(ReferenceLost())
    assert again.requests == ()
    with pytest.raises(InputError, match="have lost their reference"):
        bench.give(RecordPoint())
    point_at(bench, 3.0)
    assert bench.desk.next_name != last
    assert bench.desk.expected.endswith(f"point {bench.desk.next_name}, too, and press R")
    # a key that is held, or pressed twice, is one pointing
    with pytest.raises(InputError, match="the mark has not been moved since"):
        bench.give(Reference())
    moved_away(bench)
    point_at(bench, 3.0)
    assert bench.desk.referencing is None
    refer = next(r for r in bench.requests if isinstance(r, Refer))
    assert refer.shift is not None
    assert refer.shift.xl == pytest.approx(3.0)
    assert refer.shift.yr == pytest.approx(0.0, abs=1e-9)
    assert "the counters are moved by x' +3.000" in bench.told[-1]
    # and the work goes on
    assert isinstance(bench.requests[-1], DriveTo)


def test_counters_that_kept_their_origin(scene: Scene) -> None:
    bench = lost(scene)
    point_at(bench, 0.0)
    moved_away(bench)
    point_at(bench, 0.0)
    assert Refer(None) in bench.requests
    assert "the counters kept their origin" in bench.told


def test_pointings_that_disagree_are_both_forgotten(scene: Scene) -> None:
    bench = lost(scene)
    point_at(bench, 3.0)
    with pytest.raises(InputError, match="more than"):
        point_at(bench, 4.0)
    assert bench.notes[-1][0] == "reference-refused"
    assert bench.desk.referencing is not None
    assert bench.desk.referencing.once == {}


def test_a_chosen_reference_is_pointed_at(scene: Scene) -> None:
    bench = lost(scene)
    bench.at_hand()
    model = bench.desk.state.current
    assert model is not None
    first = model.measured[0].point
    bench.give(Drive(first))
    mark = bench.requests[-1]
    assert isinstance(mark, SetMark)
    assert mark.side is None
    assert set(mark.places) == {"left", "right"}
    assert bench.desk.next_name == first
    with pytest.raises(InputError, match="not been read since"):
        bench.give(Reference())
    bench.hear(MarkSet(bench.begun))
    with pytest.raises(InputError, match="helps no further"):
        bench.give(Drive(model.pending[0].point))


def test_counters_are_kept(scene: Scene) -> None:
    bench = lost(scene)
    bench.give(KeepCounters())
    assert Refer(None) in bench.requests
    assert bench.desk.referencing is None
    assert bench.notes[-1] == ("referenced", {"text": "the counters are taken as they are"})


def test_where_nothing_is_measured_nothing_depends_on_the_counters(bench: Bench) -> None:
    bench.hear(ReferenceLost())
    assert "nothing measured depends on it" in bench.desk.expected
    bench.seen = replace(bench.seen, counters=FAR, read=True)
    bench.give(Reference())
    assert bench.desk.referencing is None


# -- refusals --------------------------------------------------------------------------------------


def chosen(bench: Bench) -> None:
    bench.give(NextModel())


def suspended(bench: Bench) -> None:
    bench.give(NextModel())
    bench.give(Suspend())


def unreferenced(bench: Bench) -> None:
    bench.give(NextModel())
    bench.hear(ReferenceLost())


def off_line(bench: Bench) -> None:
    unreferenced(bench)
    bench.seen = replace(bench.seen, line="lost")


def counting(bench: Bench) -> None:
    unreferenced(bench)
    bench.seen = replace(bench.seen, counters=FAR, read=True)


def nothing(bench: Bench) -> None:
    del bench


REFUSED: list[tuple[Callable[[Bench], None], Command, str]] = [
    (nothing, Drive("1"), "no model is in the instrument: choose the next model"),
    (nothing, RecordPoint(), "no model is in the instrument"),
    (nothing, Accept(), "no model is in the instrument"),
    (nothing, OtherPhoto(), "no model is in the instrument"),
    (nothing, AddPoint("1"), "no model is in the instrument"),
    (nothing, Switch("1", None, False), "no model is in the instrument"),
    (nothing, Undo(), "there is nothing to undo"),
    (nothing, Resume(), "work is not suspended"),
    (nothing, Reference(), "the counters have their reference"),
    (nothing, KeepCounters(), "the counters have their reference"),
    (chosen, NextModel(), "accept model 101/102 first"),
    (chosen, Accept(), "model 101/102 is not determined yet"),
    (chosen, OtherPhoto(), "was begun in an instrument that holds both photos"),
    (chosen, Drive("no-such"), "point no-such is not in model 101/102"),
    (chosen, RecordPoint(), "the plates are still under way"),
    (chosen, TurnWheels(), "the plates are still under way"),
    (chosen, Switch("no-such", "y", False), "point no-such is not measured"),
    (chosen, AddPoint(" "), "a point needs a printable name of at most 100 characters"),
    (chosen, AddPoint("\x1b[31m"), "a point needs a printable name"),
    (chosen, AddPoint("x" * 101), "a point needs a printable name"),
    (chosen, AddPoint(" 9"), "a point's name begins and ends without a blank"),
    (chosen, AddPoint("9\xa0"), "a point"),
    (chosen, AddPoint("new"), "there is no read-out: drive the plates to the new point first"),
    (suspended, Drive("101-1"), "work is suspended: resume first"),
    (suspended, RecordPoint(), "work is suspended: resume first"),
    (suspended, Undo(), "work is suspended: resume first"),
    (suspended, Suspend(), "work is suspended: resume first"),
    (unreferenced, RecordPoint(), "the counters have lost their reference"),
    (unreferenced, Drive("no-such"), "no-such is not measured or helps no further"),
    (unreferenced, Reference(), "the counters have not been read since: try again"),
    (off_line, Reference(), "the plotter's line is lost"),
    (counting, Reference(), "nothing measured is there to refer the counters to"),
    (counting, Reference("no-such"), "nothing measured is there to refer the counters to"),
]


@pytest.mark.parametrize(("prepare", "command", "text"), REFUSED)
def test_what_is_refused_changes_nothing(
    bench: Bench, prepare: Callable[[Bench], None], command: Command, text: str
) -> None:
    prepare(bench)
    with pytest.raises(AnaplotError) as caught:
        decide(bench.desk, command, bench.seen)
    assert text in str(caught.value)
    assert refusal(bench.desk, command, bench.seen) == str(caught.value)


def test_an_inner_orientation_refuses_what_comes_after_it() -> None:
    bench = Bench.of(InnerScene(3).block)
    bench.give(NextModel())
    bench.seen = replace(bench.seen, position=FAR)
    for command, text in (
        (Drive("101-1"), "photo 101 (left) has no fiducial 101-1"),
        (AddPoint("new"), "photo 101 (left): inner orientation comes first"),
        (Accept(), "the inner orientation of photo 101 (left) is not determined yet"),
        (Switch("1", "x", False), "fiducial 1 of photo 101 (left) is not measured"),
    ):
        assert text in (refusal(bench.desk, command, bench.seen) or "")
    with pytest.raises(NotComputableError):
        bench.give(Accept())


@pytest.mark.parametrize("abilities", [DRIVEN, UNDRIVEN])
def test_what_cannot_be_measured_is_not_asked_for_again(abilities, scene: Scene) -> None:
    bench = Bench.of(scene.block, abilities)
    bench.give(NextModel())
    first, second, *_ = pending = bench.desk.mode.pending
    bench.give(Drive(first))
    bench.arrive()
    bench.give(Switch(first, None, False))
    assert bench.desk.mode.pending == pending[1:]
    # a press records the next one, or nothing, but not what is left out
    assert bench.desk.target != first
    assert bench.desk.next_name == second
    to_go = f"{len(pending) - 1} of {len(pending) - 1} points to go"
    assert bench.desk.expected == f"measure {second}: {to_go}"
    bench.measure(second)
    assert [m.point for m in bench.desk.state.current.measured] == [second]
    bench.give(Undo())
    bench.give(Undo())
    assert bench.desk.mode.pending == pending


def test_what_cannot_be_measured_in_one_photo_is_left_out_of_both(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN_MONO)
    bench.give(NextModel())
    first, *others = bench.desk.mode.pending
    bench.measure(first)
    bench.give(Switch(first, None, False))
    for name in others:
        bench.measure(name)
    bench.give(NextModel())
    assert list(bench.desk.mode.pending) == others


def test_a_model_begun_in_another_kind_of_instrument(bench: Bench, scene: Scene) -> None:
    bench.give(NextModel())
    mono = replace(bench.desk, abilities=MONO)
    target = bench.desk.target or ""
    assert "holds both photos: connect one, or undo" in (refusal(mono, Drive(target), Seen()) or "")
    begun = Bench.of(scene.block, MONO, truth=scene.made.truth)
    begun.give(NextModel())
    paired = replace(begun.desk, abilities=DRIVEN)
    for command in (Drive(target), RecordPoint()):
        assert "begun in a mono comparator" in (refusal(paired, command, Seen()) or "")
    begun.give(Undo())
    assert refusal(begun.desk, Drive(target), Seen()) == (
        "no photo lies in the comparator: lay one in first"
    )


def test_a_record_outside_the_photo(bench: Bench) -> None:
    bench.give(NextModel())
    bench.arrive()
    target = bench.desk.target
    bench.hear(Record(FAR, "pedal"))
    assert "lies outside photo 101" in bench.told[-1]
    assert bench.desk.target == target


def test_a_decision_that_is_not_adopted_has_not_happened(bench: Bench) -> None:
    bench.give(NextModel())
    bench.arrive()
    desk, at = bench.desk, bench.stands
    once = hear(desk, Record(at, "pedal"), bench.seen)
    again = hear(desk, Record(at, "pedal"), bench.seen)
    assert once.events == again.events != ()
    assert once.requests == again.requests
    assert desk.state.current is not None
    assert not desk.state.current.measured


# -- whatever happens ------------------------------------------------------------------------------

COMMANDS = st.sampled_from(
    [
        NextModel(),
        NextModel(),
        Accept(),
        Undo(),
        Stop(),
        RecordPoint(),
        Suspend(),
        Resume(),
        OtherPhoto(),
        KeepCounters(),
        Reference(),
        TakeOver(),
        TurnWheels(),
        AddPoint("extra"),
        ReturnTo("101", "102"),
        ReturnTo("102", "103"),
    ]
)
HEARD = st.sampled_from(
    [
        "arrive",
        "arrive",
        "press",
        "press",
        "press",
        "stale",
        ReferenceLost(),
        LinkChanged("lost"),
        LinkChanged("live"),
        Fault("1", "x"),
        "fail",
        InPosition(),
        InPosition(FAR),
        FAR,
        Record(FAR, "key"),
        Refused(b"", "x"),
    ]
)
STEPS = st.lists(
    st.one_of(COMMANDS, HEARD, st.tuples(st.sampled_from(["drive", "switch"]), st.integers(0, 14))),
    max_size=40,
)


def check(desk: Desk) -> None:
    """What always holds."""
    mode, model = desk.mode, desk.state.current
    if desk.target is not None:
        assert mode is not None
        assert mode.has(desk.target)
    assert (mode is None) == (model is None)
    if desk.drive_target is not None:
        assert desk.target is not None
    if isinstance(mode, Singles):
        assert model is not None
        assert model.mono
    if desk.abilities is not None and not desk.abilities.drives:
        assert desk.drive_target is None


@pytest.mark.parametrize("abilities", [DRIVEN, UNDRIVEN, MONO, DRIVEN_MONO])
@settings(max_examples=25, deadline=None)
@given(steps=STEPS, hand=st.booleans())
def test_whatever_is_commanded_and_heard(abilities, steps: list, hand: bool) -> None:
    scene = _fiducial_scene() if hand else _scene()
    bench = Bench.of(scene.block, abilities, truth=scene.made.truth)
    if hand:
        bench.at_hand()
    bench.seen = replace(bench.seen, position=Position(1.0, 2.0, -90.0, 2.0), read=True)
    for step in steps:
        before, count = bench.desk, len(bench.events)
        if step in ("arrive", "press", "stale", "fail"):
            if step == "arrive":
                bench.arrive()
            elif step == "fail":
                bench.hear(DriveFailed(bench.desk.errand))
            elif step == "stale":
                bench.hear(MarkSet(bench.begun - 1))
            else:
                bench.press()
                moving = not before.standing
                if moving or before.state.suspended or before.mode is None:
                    assert len(bench.events) == count
        elif isinstance(step, tuple):
            names = [] if before.mode is None else _names(before)
            if names:
                name = names[step[1] % len(names)]
                _try(bench, Drive(name) if step[0] == "drive" else Switch(name, None, False))
        elif isinstance(step, Command):
            _try(bench, step)
        else:
            bench.hear(step)
            if not isinstance(step, Record):
                assert len(bench.events) == count
        check(bench.desk)
        if before.state.suspended and bench.desk.state.suspended:
            assert len(bench.events) == count
    assert fold(start(scene.block), bench.events) == bench.desk.state


def _try(bench: Bench, command: Command) -> None:
    before, count = bench.desk, len(bench.events)
    foreseen = refusal(before, command, bench.seen)
    if foreseen is None:
        bench.give(command)
        return
    with pytest.raises(AnaplotError) as caught:
        bench.give(command)
    assert str(caught.value) == foreseen
    if bench.desk is before:
        assert len(bench.events) == count


def _names(desk: Desk) -> list[str]:
    mode = desk.mode
    if isinstance(mode, Fiducials):
        return list(mode.inner.fiducials)
    return [] if mode is None else [p.point for p in mode.model.plan]


_SCENES: dict[str, Scene] = {}


def _scene() -> Scene:
    return _SCENES.setdefault("pairs", Scene(3))


def _fiducial_scene() -> Scene:
    return _SCENES.setdefault("fiducials", InnerScene(3))


def test_a_record_asked_for_by_key_belongs_to_where_the_key_was_pressed(scene: Scene) -> None:
    by_hand = Bench.of(scene.block, UNDRIVEN)
    here = Position(1.2, 3.4, -90.1, 2.9)
    by_hand.give(NextModel())
    first, second = (point.point for point in by_hand.desk.state.current.plan[:2])
    by_hand.give(Drive(first))
    by_hand.give(RecordPoint())
    by_hand.give(Drive(second))
    # the read-out that the key waited for comes only now: it is neither's
    decision = by_hand.hear(Record(here, KEY))
    assert decision.events == ()
    assert "since the key was pressed" in by_hand.told[-1]
    # a press after that is the second point's
    by_hand.give(RecordPoint())
    (event,) = by_hand.hear(Record(here, KEY)).events
    assert isinstance(event, PointMeasured)
    assert event.point == second
    # what a pedal says was pressed when it came
    by_hand.give(Drive(first))
    by_hand.give(RecordPoint())
    by_hand.give(Drive(second))
    assert by_hand.hear(Record(here, "pedal")).events


def test_of_two_presses_in_different_places_the_first_record_is_nobodys(scene: Scene) -> None:
    here = Position(1.2, 3.4, -90.1, 2.9)

    def pressed_twice() -> tuple[Bench, str]:
        by_hand = Bench.of(scene.block, UNDRIVEN)
        by_hand.give(NextModel())
        first, second = (point.point for point in by_hand.desk.state.current.plan[:2])
        for point in (first, second):
            by_hand.give(Drive(point))
            by_hand.give(RecordPoint())
        return by_hand, second

    # the first press's record was under way while the second was made
    by_hand, second = pressed_twice()
    assert by_hand.hear(Record(here, KEY)).events == ()
    (event,) = by_hand.hear(Record(here, KEY)).events
    assert isinstance(event, PointMeasured)
    assert event.point == second
    # or it will never come: then the next is the second's
    refused = Refused(b"", "key was not recorded: no position came after it")
    for end in (refused, LinkChanged("lost", "unplugged"), LinkChanged("reconnecting")):
        by_hand, second = pressed_twice()
        by_hand.hear(end)
        (event,) = by_hand.hear(Record(here, KEY)).events
        assert isinstance(event, PointMeasured)
        assert event.point == second
    # a press that could not be passed on is none
    by_hand, second = pressed_twice()
    by_hand.hear(LinkChanged("lost"))
    by_hand.give(RecordPoint())
    by_hand.hear(KeyFailed(by_hand.desk.errand))
    assert by_hand.desk.pressed is None


def test_driving_again_to_where_the_key_was_pressed_changes_nothing(scene: Scene) -> None:
    bench = Bench.of(scene.block, UNDRIVEN)
    here = Position(1.2, 3.4, -90.1, 2.9)
    bench.give(NextModel())
    first, second = (point.point for point in bench.desk.state.current.plan[:2])
    bench.give(Drive(first))
    bench.give(RecordPoint())
    bench.give(Drive(first))
    (event,) = bench.hear(Record(here, KEY)).events
    assert event.point == first
    # elsewhere and back is another drive
    bench.give(Drive(second))
    bench.give(RecordPoint())
    bench.give(Drive(first))
    bench.give(Drive(second))
    assert bench.hear(Record(here, KEY)).events == ()
