"""Where a block stands while it is measured, and from its files: the same."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from sessionscene import Scene

from anaplot.cli import command_parser
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import ControlPoint, ImagePoint, Strip, TestSettings
from anaplot.photogrammetry.imagepoints import ImagePoints, columns_of
from anaplot.session.desk import Desk
from anaplot.session.events import ModelAccepted, ModelReopened, RowSwitched
from anaplot.session.models import solve
from anaplot.session.state import SessionState, apply, fold, start
from anaplot.session.workflow import outlook
from anaplot.station.blockstatus import (
    BlockStatus,
    ModelStatus,
    StripStatus,
    status_of,
    untied,
)
from anaplot.station.blockstep import following
from anaplot.station.blockview import (
    BlockView,
    FlaggedCoordinate,
    FlaggedObservation,
    SuspectedPoint,
    SuspectedRay,
)
from anaplot.station.coverage import coverage_of
from anaplot.station.imagepoints import rows_of
from anaplot.station.livestatus import LiveStatus
from anaplot.station.modeltables import TableKeeper


def suspect(model: str, probability: float) -> BlockView:
    photo = model.split("/")[1]
    ray = SuspectedRay(photo, model, probability)
    flagged = (FlaggedCoordinate(photo, model, "y", 9.0, 0.5),)
    return BlockView(model, 1, False, suspects=(SuspectedPoint("p", flagged, (ray,), "", False),))


class Day:
    """A session whose status is asked for after every event, both ways."""

    def __init__(self) -> None:
        self.scene = Scene(photos=4)
        self.state = self.scene.start
        self.live = LiveStatus("b")
        self.keeper = TableKeeper()
        self.tables = self.keeper.update(self.scene.block, self.state)

    def both(self, view: BlockView | None = None) -> tuple[BlockStatus, BlockStatus]:
        state = self.state
        block = replace(self.scene.block, image_points=rows_of(state.models))
        self.tables = self.keeper.update(block, state)
        live = self.live.now(block, Desk.at(state), view, self.tables)
        return live, status_of(block, state, view, "b")

    def same(self, view: BlockView | None = None) -> BlockStatus:
        live, files = self.both(view)
        # where one measures, an instrument is connected: no ways to connect one are told
        assert live == replace(files, strips=live.strips, ways="")
        for one, other in zip(live.models, files.models, strict=True):
            assert one == replace(other, sigma0_um=one.sigma0_um)
            assert one.sigma0_um == (
                None if other.sigma0_um is None else pytest.approx(other.sigma0_um, rel=1e-9)
            )
        return live

    def measure(self, model: int) -> None:
        self.state = self.scene.whole(apply(self.state, self.scene.choice(self.state, model)))

    def accept(self) -> None:
        assert self.state.current is not None
        self.state = apply(self.state, ModelAccepted(*self.state.current.photos))


def states(status: BlockStatus) -> list[str]:
    return [model.state for model in status.models]


def test_the_day_says_the_same_live_and_from_the_files() -> None:
    day = Day()
    found = day.same()
    assert states(found) == ["open", "open", "open"]
    assert (found.next.do, found.next.model) == ("measure", "101/102")
    day.state = apply(day.state, day.scene.choice(day.state, 0))
    found = day.same()
    assert states(found) == ["in work", "open", "open"]
    assert found.next.point == day.state.current.plan[0].point
    # what is left out without a measurement is no row that is off, with a table and without
    kept, left = day.state, day.state.current.plan[-1].point
    day.state = apply(day.state, RowSwitched(left, "y", on=False))
    assert [model.off for model in day.same().models] == [0, 0, 0]
    day.state = kept
    day.state = day.scene.whole(day.state)
    found = day.same()
    assert found.next.do == "accept"
    assert next(found.models).redundancy == 8
    day.accept()
    day.measure(1)
    point = next(p.point for p in day.state.current.plan if p.role == "tie")
    day.state = apply(day.state, RowSwitched(point, "x", on=False))
    assert [model.off for model in day.same().models] == [0, 1, 0]
    day.accept()
    found = day.same()
    assert states(found) == ["accepted", "accepted", "open"]
    assert [model.ties for model in found.models] == [0, 4, 0]
    assert found.next.model == "103/104"
    # a surely wrong point is returned to before the next model is measured
    found = day.same(suspect("101/102", 0.995))
    assert states(found) == ["look", "accepted", "open"]
    assert (found.next.do, found.next.model, found.next.point) == ("return", "101/102", "p")
    assert day.same(suspect("101/102", 0.9)).next.do == "measure"
    # wrong control bends the rays about it: of none of them the block is sure then
    for w, state, do in ((9.5, "accepted", "measure"), (8.5, "look", "return")):
        control = FlaggedObservation("control", "X of control point 10", w)
        found = day.same(replace(suspect("101/102", 0.999), others=(control,)))
        assert (states(found)[0], found.next.do) == (state, do)
        [spot] = [one for one in found.weak_spots if one.words.startswith("point p")]
        assert spot.words.endswith("unless X of control point 10 is wrong") == (w > 9.0)
    day.measure(2)
    day.accept()
    assert day.same().next.do == "adjust"
    # solved on its control, and nothing in it flagged: adjusted it is in the background already
    solved = BlockView("103/104", 3, False, datum="control", redundancy=40, photos=4)
    for view, do in (
        (solved, "report"),
        (replace(solved, datum="free"), "adjust"),
        (replace(solved, aside=("104",)), "adjust"),
        (
            replace(solved, others=(FlaggedObservation("control", "Z of control point 4", 9.0),)),
            "adjust",
        ),
        (replace(solved, suspects=suspect("102/103", 0.6).suspects), "adjust"),
        (replace(solved, suspects=suspect("102/103", 0.6).suspects, by_chance=True), "report"),
    ):
        step = day.same(view).next
        assert step.do == do, view
        # what is advised can be typed
        assert command_parser().parse_args(step.command.split()[1:]).command == do


@pytest.mark.parametrize("common", [False, True])
def test_strips_without_a_common_point_are_to_be_tied(common: bool) -> None:
    strips = (Strip("7", ("101", "102")), Strip("8", ("103", "104")), Strip("9", ("105", "106")))
    rows = tuple(
        ImagePoint(photo, f"{photo}{point}", 1.0, 2.0)
        for photo in ("101", "102", "103", "104")
        for point in "abc"
    )
    if common:
        rows += (ImagePoint("101", "z", 1.0, 2.0), ImagePoint("103", "z", 1.0, 2.0))
    block = replace(Scene(photos=4).block, strips=strips, image_points=rows)
    coverage = coverage_of(block)
    assert coverage.apart == (() if common else ("8",))
    standing = tuple(
        StripStatus(strip.id, (ModelStatus(*strip.photos, "accepted"),)) for strip in strips[:2]
    )
    found = untied(standing, coverage)
    assert found == (None if common else ("8", "103/104"))
    step = following("", True, None, "b", untied=found)
    if common:
        assert step.do == "adjust"
    else:
        assert (step.do, step.strip, step.model) == ("tie", "8", "103/104")
        assert step.words == "tie strip 8 to the others in model 103/104"
        assert step.opens
    # fewer common points than hold a strip: it waits aside in the block
    view = BlockView("103/104", 2, False, aside=("101", "102"))
    assert untied(standing, coverage, view) == ("7", "101/102")
    assert untied(standing, coverage, replace(view, aside=("102",))) == found
    # what is still to be measured may tie them
    assert following("105/106", True, None, "b", untied=found).do == "measure"


def test_a_model_returned_to_is_in_work_and_those_after_it_are_recomputed() -> None:
    day = Day()
    for k in range(2):
        day.measure(k)
        day.accept()
    day.measure(2)
    day.state = apply(day.state, ModelReopened("101", "102", None, None))
    assert states(day.same()) == ["in work", "accepted", "in work"]
    point = day.state.current.measured[-1].point
    day.state = apply(day.state, day.scene.measurement(day.state, point, dyr=0.004))
    day.accept()
    found = day.same()
    assert states(found) == ["accepted", "recomputed", "in work"]
    assert found.weak_spots[0].model == "102/103"
    assert "computed anew" in found.weak_spots[0].words


def test_tables_are_those_of_the_session_and_computed_once() -> None:
    day = Day()
    for k in range(3):
        day.measure(k)
        day.accept()
    tables = day.keeper.update(day.scene.block, day.state)
    for model in day.state.models:
        assert tables[model.photos].solution is solve(day.state, model)
    assert day.keeper.update(day.scene.block, day.state) is tables
    # what comes after a change is computed again, what is before it is not
    changed = replace(
        day.state.models[1], off=frozenset({(day.state.models[1].plan[7].point, "y")})
    )
    models = (day.state.models[0], changed, day.state.models[2])
    after = day.keeper.update(day.scene.block, replace(day.state, models=models))
    same = [after[model.photos] is tables[model.photos] for model in models]
    assert same == [True, False, False]


def test_what_is_given_up_keeps_what_was_known() -> None:
    day = Day()
    day.measure(0)
    day.accept()
    known = day.keeper.update(day.scene.block, day.state)
    day.measure(1)
    day.accept()

    def overtaken() -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        day.keeper.update(day.scene.block, day.state, overtaken)
    assert day.keeper.update(day.scene.block, day.state)[("101", "102")] is known[("101", "102")]


def test_a_table_on_its_way_is_not_called_wrong() -> None:
    day = Day()
    day.measure(0)
    day.accept()
    block = replace(day.scene.block, image_points=rows_of(day.state.models))
    # just opened: no table is known yet
    found = LiveStatus("b").now(block, Desk.at(day.state), None, {})
    first = next(found.models)
    assert (first.state, first.sigma0_um, first.why) == ("accepted", None, "")
    # just accepted: its table is the one that stood on the screen
    live = LiveStatus("b")
    before: SessionState = fold(day.scene.start, [])
    before = day.scene.whole(apply(before, day.scene.choice(before, 0)))
    live.now(day.scene.block, Desk.at(before), None, {})
    after = apply(before, ModelAccepted("101", "102"))
    found = live.now(block, Desk.at(after), None, {})
    assert next(found.models).sigma0_um == outlook(before).solution.sigma0_um


def test_a_model_that_cannot_be_computed_needs_a_look_and_those_after_it_too() -> None:
    day = Day()
    day.measure(0)
    day.accept()
    day.measure(1)
    day.accept()
    few = replace(day.state.models[0], measured=day.state.models[0].measured[:3])
    state = replace(day.state, models=(few, day.state.models[1]))
    with pytest.raises(NotComputableError):
        solve(state, state.models[1])
    tables = day.keeper.update(day.scene.block, state)
    assert "needs five" in tables[few.photos].why
    assert "model 101/102 before it has no table" in tables[state.models[1].photos].why
    live = LiveStatus("b").now(day.scene.block, Desk.at(state), None, tables)
    assert states(live) == ["look", "look", "open"]
    assert "needs five" in live.weak_spots[0].words


def test_what_is_only_begun_is_no_alarm() -> None:
    day = Day()
    day.state = apply(day.state, day.scene.choice(day.state, 0))
    measurements = list(day.scene.measurements(day.state))
    day.state = apply(day.state, measurements[0])
    assert "needs five" in outlook(day.state).problem
    assert day.same().weak_spots == ()
    # with nothing left to measure it is one
    model = day.state.current
    assert model is not None
    ready = replace(model, plan=tuple(p for p in model.plan if p.point == model.measured[0].point))
    day.state = replace(day.state, current=ready)
    assert "needs five" in day.same().weak_spots[0].words


def test_models_from_elsewhere_are_accepted_and_control_is_seen() -> None:
    day = Day()
    day.measure(0)
    rows = (
        *day.scene.rows(day.state),
        ImagePoint("104", "101-1", 1.0, 2.0),
    )
    control = tuple(
        ControlPoint(name, (1.0, 2.0, 3.0), use=use)
        for name, use in (("101-1", "control"), ("far", "check"), ("101-2", "off"))
    )
    block = replace(day.scene.block, image_points=rows, control=control)
    tables = day.keeper.update(block, day.scene.start)
    start = day.scene.start
    live = LiveStatus("b").now(block, Desk.at(start), None, tables)
    assert states(live) == ["accepted", "open", "open"]
    assert next(live.models).sigma0_um is not None
    assert live.coverage == (0, 2, 1, ())
    # the session has not measured it: that is what its next key does
    assert live.next.model == "101/102"
    whole = replace(block, image_points=all_rows(day))
    assert whole.image_points
    live = LiveStatus("b").now(whole, Desk.at(start), None, day.keeper.update(whole, start))
    assert states(live) == ["accepted"] * 3
    assert live.next == status_of(whole, None, None, "b").next
    assert live.next.do == "adjust"


def all_rows(day: Day) -> tuple[ImagePoint, ...]:
    """The rows of a whole strip."""
    state = day.scene.chosen(2)
    return day.scene.rows(day.scene.whole(state))


def test_a_model_whose_sigma0_nothing_explains_is_not_next_to_be_accepted() -> None:
    day = Day()
    precision = replace(day.scene.block.precision, image_um=0.5)
    day.scene.block = replace(day.scene.block, precision=precision, test=TestSettings("tau"))
    day.state = start(day.scene.block)
    day.measure(0)
    found = day.same()
    assert (found.next.do, found.next.model, found.next.point) == ("measure", "101/102", "")


def test_lateral_ties_and_control_are_those_of_the_photos_that_see_them() -> None:
    block = Scene(photos=4).block
    draw = random.Random(3)
    photos = [f"f{k}" for k in range(7)]
    found, alone = set(), set()
    for _ in range(40):
        # photos of no strip, and of several; points measured twice in one photo
        strips = tuple(
            replace(block.strips[0], id=f"s{k}", photos=tuple(draw.sample(photos, 3)))
            for k in range(draw.randint(0, 3))
        )
        seen = [(draw.choice(photos), f"p{draw.randint(0, 5)}") for _ in range(draw.randint(0, 15))]
        rows = [(names, draw.choice(("xy", "xy", "y", "off"))) for names in seen]
        seen = [names for names, use in rows if use != "off"]
        one = replace(
            block,
            strips=strips,
            image_points=tuple(ImagePoint(*names, 1.0, 2.0, use=use) for names, use in rows),
            control=(ControlPoint("p1", (1.0, 2.0, 3.0)), ControlPoint("none", (1.0, 2.0, 3.0))),
        )
        tied = {
            point: {s.id for s in strips for photo, p in seen if p == point and photo in s.photos}
            for _, point in seen
        }
        lateral = sum(len(ids) > 1 for ids in tied.values())
        twice = len({photo for photo, point in seen if point == "p1"}) > 1
        reached = next(([s.id] for s in strips if any(s.id in ids for ids in tied.values())), [])
        for _ in strips:
            reached += {b for ids in tied.values() if not ids.isdisjoint(reached) for b in ids}
        measured = [s.id for s in strips if any(s.id in ids for ids in tied.values())]
        apart = tuple(name for name in measured if name not in reached)
        assert coverage_of(one) == (lateral, 2, int(twice), apart)
        columns = ImagePoints(columns=columns_of(one.image_points))
        assert coverage_of(replace(one, image_points=columns)) == (lateral, 2, int(twice), apart)
        alone.add(bool(apart))
        found.add((lateral, twice))
    assert {lateral for lateral, _ in found} > {0, 1, 2}
    assert {twice for _, twice in found} == alone == {False, True}
