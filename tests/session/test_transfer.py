"""Points known from other strips and from the ground: offered, predicted, checked at once."""

from dataclasses import replace

import pytest
from deskscene import DRIVEN, Bench
from transferscene import BlockBench, flown, marked, second_strip_begun

from anaplot.exchange.eventcodec import event_from_payload, event_to_payload
from anaplot.photogrammetry.readings import InPosition, Position, Record
from anaplot.planning.synthetic import synthetic_strip
from anaplot.session import transfer as transfer_module
from anaplot.session.commands import Accept, AddPoint, Drive, NextModel, Switch, Undo
from anaplot.session.desk import Desk
from anaplot.session.events import PlannedPoint, PointAdded, PointMeasured, RowSwitched
from anaplot.session.models import geometry_of
from anaplot.session.othernames import OtherName
from anaplot.session.state import EventRefusedError, apply, fold, start
from anaplot.session.tiecheck import GROUND, NOTHING_KNOWN, Known
from anaplot.session.transfer import transfer, transfer_of_strip
from anaplot.station.snapshot import LinkView, snapshot_of

SEEDS = (1, 5)


@pytest.fixture(scope="module")
def measured():
    """The block measured with two points of the first strip marked on the second."""
    return [BlockBench.over(flown(s), marked(flown(s), transferred=2), s).block(6) for s in SEEDS]


@pytest.fixture(scope="module")
def begun():
    """The first strip measured, and a model of the second; everything is marked."""
    return BlockBench.over(flown(4), marked(flown(4)), 4).block(4).desk


def bench_at(desk, seed=4, **mistakes):
    """A bench that goes on from a desk."""
    bench = BlockBench.over(flown(seed), marked(flown(seed)), seed, **mistakes)
    bench.desk = desk
    return bench


def test_check_points_are_known_and_what_is_off_is_not():
    off, check, control, *_ = flown(4).block.control
    off, check = replace(off, use="off"), replace(check, use="check")
    assert Known.of((off, check, control), None).control == (check, control)


def test_lateral_ties_are_spread_from_the_left_and_away_from_the_edge():
    made = flown(4)
    state = second_strip_begun(made)
    photos = state.current.photos
    empty = replace(state, current=replace(state.current, plan=(), measured=()))
    marks = marked(made)
    theirs = {m.point for model in state.models for m in model.measured}
    at = {p: marks[photos[0]][p][0] for p in theirs if all(p in marks[photo] for photo in photos)}

    def offered():
        found = transfer(empty, Known.of((), marks)).offers
        assert {o.source for o in found} == {"1"}
        return [o.planned.point for o in found]

    first, second, third = offered()
    assert at[first] == min(at.values())
    assert at[second] == max(at.values())
    ends = at[first], at[second]
    between = {p: min(abs(x - end) for end in ends) for p, x in at.items()}
    assert between[third] == max(between.values())
    reach = made.block.camera_of(photos[0]).reach()
    x, y = marks[photos[0]][first]
    for edge in ((x, reach[1] - 2.9), (x, 2.9 - reach[1]), (2.9 - reach[0], y)):
        marks[photos[0]][first] = edge
        assert first not in offered()


@pytest.mark.slow
def test_no_check_point_helps_to_determine_the_ground(measured):
    for bench in measured:
        seen = {m.point for model in bench.desk.state.models[3:] for m in model.measured}
        point = next(c for c in bench.made.block.control if c.point in seen)
        rest = [c for c in bench.made.block.control if c is not point]

        def similarity(use, point=point, rest=rest, state=bench.desk.state):
            known = Known.of((replace(point, use=use), *rest), None)
            return next(
                c for c in transfer(state, known).checks if c.other == GROUND
            ).tie.similarity

        shift = {use: similarity(use).shift.tolist() for use in ("control", "check", "off")}
        assert shift["check"] == shift["off"] != shift["control"]


@pytest.mark.slow
def test_plates_drive_to_points_of_the_other_strip_and_of_the_ground(measured):
    for bench in measured:
        assert len(bench.predicted) >= 6
        assert {o.source for o, _ in bench.predicted} == {"1", GROUND}
        for offer, error in bench.predicted:
            # all coordinates of all seeds at once: normal, exceeded by chance in one of 600 runs
            assert abs(error).max() < 4.5 * (offer.sigma + 1e-4), offer


@pytest.mark.slow
def test_the_block_comes_out_tied_and_nothing_is_accused(measured):
    for bench in measured:
        checks = {check.other: check for check in bench.desk.transfer.checks}
        assert set(checks) == {"1", GROUND}
        assert all(check.common >= 4 and check.tie is not None for check in checks.values())
        assert not any(a.certain for a in bench.desk.accidents)
        roles = {p.role for model in bench.desk.state.models for p in model.plan}
        assert roles == {"tie", "new", "lateral", "control"}
        assert fold(start(bench.made.block), bench.events) == bench.desk.state


@pytest.mark.slow
def test_the_model_is_complete_without_what_is_offered(begun):
    bench = bench_at(begun)
    bench.give(NextModel())
    while pending := bench.desk.mode.pending:
        bench.point_at(pending[0])
    first, *_ = bench.offers
    assert not bench.desk.state.current.pending
    assert bench.desk.outlook.may_accept
    assert bench.desk.next_name == first.planned.point
    assert first.words in bench.desk.expected
    assert bench.desk.expected.endswith("or accept the model")
    # one is left out, and can be taken in again
    bench.give(Switch(first.planned.point, None, False))
    assert first.planned.point not in {o.planned.point for o in bench.offers}
    assert not bench.desk.state.current.pending
    bench.give(Switch(first.planned.point, None, True))
    assert [p.point for p in bench.desk.state.current.pending] == [first.planned.point]
    bench.give(Undo())
    bench.give(Accept())


@pytest.mark.slow
def test_undo_takes_back_the_record_of_what_was_offered(begun):
    bench = bench_at(begun)
    bench.give(NextModel())
    while pending := bench.desk.mode.pending:
        bench.point_at(pending[0])
    name = bench.offers[0].planned.point
    bench.point_at(name)
    added, taken = bench.events[-2:]
    assert isinstance(added, PointAdded)
    assert isinstance(taken, PointMeasured)
    assert added.planned.point == taken.point == name
    bench.give(Undo())
    assert [p.point for p in bench.desk.state.current.pending] == [name]
    bench.give(Undo())
    assert name in {o.planned.point for o in bench.offers}


@pytest.mark.parametrize("x", [100.0, 300.0])
def test_what_was_offered_is_in_the_plan_only_when_it_was_measured(x):
    made = flown(4)
    desk = Desk.at(second_strip_begun(made), DRIVEN, control=made.block.control)
    bench = Bench(desk)
    offered = bench.desk.transfer.offers[0].planned
    bench.give(Drive(offered.point))
    bench.arrive()
    decision = bench.hear(Record(Position(x, 10.0, 10.0, 10.0), "pedal"))
    model = bench.desk.state.current
    if x < made.block.cameras[0].reach()[0]:
        assert [event.kind for event in decision.events] == ["point-added", "point-measured"]
        assert model.planned(offered.point) == offered
        return
    assert any(text.startswith("not recorded: ") for text in bench.told)
    assert not decision.events
    assert model.planned(offered.point) is None
    assert bench.desk.state == desk.state


@pytest.mark.slow
def test_a_wrong_lateral_tie_is_named_with_the_record(begun):
    bench = bench_at(begun)
    bench.give(NextModel())
    while pending := bench.desk.mode.pending:
        bench.point_at(pending[0])
    wrong = next(o.planned.point for o in bench.offers if o.mark == "lateral")
    left = bench.desk.state.current.left
    bench.off = {(left, wrong): (2.5, 1.5)}
    told = len(bench.told)
    bench.point_at(wrong)
    assert [t for t in bench.told[told:] if t.startswith(f"{wrong} measured ")]
    assert bench.desk.accidents[0].point == wrong
    assert bench.desk.accidents[0].certain
    check = next(c for c in bench.desk.transfer.checks if c.other == "1")
    assert check.wrong == (wrong,)
    flagged = next(p for p in check.tie.points if p.point == wrong)
    assert flagged.flagged
    # driven to again, the plates go where the others say that it lies
    bench.off = {}
    bench.point_at(wrong)
    assert not bench.desk.accidents


@pytest.mark.slow
def test_interchanged_lateral_ties_are_named_as_such(begun):
    bench = bench_at(begun)
    bench.give(NextModel())
    while pending := bench.desk.mode.pending:
        bench.point_at(pending[0])
    while control := [o for o in bench.offers if o.mark == "control"]:
        bench.point_at(control[0].planned.point)
    left = bench.desk.state.current.left
    one, two, *_ = (o.planned.point for o in bench.offers if o.mark == "lateral")
    bench.wrong = {(left, one): two, (left, two): one}
    bench.point_at(one)
    assert bench.desk.accidents[0].text.startswith(f"{one} measured ")
    bench.point_at(two)
    assert {a.point for a in bench.desk.accidents} == {one, two}
    assert f"{one} and {two} interchanged?" in " ".join(a.text for a in bench.desk.accidents)
    assert [s.words for s in bench.desk.agenda.steps if s.kind == "rename"] == [f"name it {two}"]
    assert set(bench.desk.other_names) == {OtherName(one, two), OtherName(two, one)}


@pytest.mark.slow
def test_a_point_under_a_second_name_is_told(begun):
    bench = bench_at(begun)
    bench.give(NextModel())
    while pending := bench.desk.mode.pending:
        bench.point_at(pending[0])
    lateral = next(o.planned for o in bench.offers if o.mark == "lateral")
    sharp = bench.desk.transfer.places
    known = next(p.point for p in bench.desk.state.current.plan)
    # under another name where a point of this model lies
    bench.give(Drive(known))
    place = bench.true(known)
    record(bench, "9001", place)
    assert f"9001 lies where {known} lies: the same point under two names?" in bench.told
    assert lateral.point not in sharp, "what is marked is not predicted"


def record(bench, name, place):
    """Add a point where the plates stand, and record it."""
    at = Position(*place.tolist())
    bench.hear(InPosition(bench.stands))
    bench.seen = type(bench.seen)(line="live", position=at)
    bench.give(AddPoint(name))
    bench.hear(Record(at, "pedal"))


@pytest.mark.slow
def test_an_id_that_an_earlier_model_has_elsewhere_is_told(monkeypatch):
    made = flown(4)
    bench = BlockBench.over(made, {p: v for p, v in marked(made).items() if p < "2"}, 4)
    bench.block(2)
    bench.model()
    first = next(
        p.point
        for p in bench.desk.state.models[0].plan
        if bench.desk.state.current.planned(p.point) is None
        and p.point not in {m.point for m in bench.desk.state.models[1].measured}
    )
    bench.give(Drive(bench.desk.state.current.plan[-1].point))
    place = bench.true(bench.desk.state.current.plan[-1].point) + 1.0
    record(bench, first, place)
    assert any(t.startswith(f"{first} measured ") and "101/102 has it" in t for t in bench.told)
    # a place that could not be computed anew stays the former one: no two places to compare
    block, models, current = made.block, bench.desk.state.models, bench.desk.state.current
    whole = (*models, current)
    (last,) = transfer_of_strip(block, whole, whole, NOTHING_KNOWN, 1, 0.5)
    assert [name for name, _, _ in last.strayed] == [first]
    former = geometry_of(block, models[:1]).points[first]

    def kept(block, chain):
        geometry = geometry_of(block, chain)
        return replace(geometry, points={**geometry.points, first: former})

    monkeypatch.setattr(transfer_module, "geometry_of", kept)
    (last,) = transfer_of_strip(block, whole, whole, NOTHING_KNOWN, 1, 0.5)
    assert last.strayed == ()


def test_a_single_strip_without_control_has_nothing_of_all_that():
    made = synthetic_strip(3, seed=5)
    bench = Bench.of(made.block, DRIVEN, truth=made.truth)
    bench.whole_model()
    known = bench.desk.transfer
    assert not known.offers
    assert not known.checks
    assert not known.marks
    assert not bench.desk.accidents


def test_models_are_numbered_in_their_own_strip():
    shown = snapshot_of(Desk.at(second_strip_begun(flown(1))), 1, LinkView("none"))
    assert (shown.strip, shown.left, shown.right) == ("2", "201", "202")
    assert (shown.model_number, shown.model_count) == (1, 3)


def test_what_is_neither_planned_nor_offered_is_not_left_out():
    made = synthetic_strip(3, seed=5)
    bench = Bench.of(made.block, DRIVEN, truth=made.truth)
    bench.give(NextModel())
    with pytest.raises(EventRefusedError, match="is not measured"):
        apply(bench.desk.state, RowSwitched("nowhere", None, False))


@pytest.mark.parametrize("role", ["tie", "new", "lateral", "control"])
def test_the_journal_keeps_the_role_of_a_point(role):
    event = PointAdded(PlannedPoint("7", role, 1.0, 2.0, 3.0, 4.0))
    payload = event_to_payload(event)
    assert event_from_payload("point-added", payload) == event
