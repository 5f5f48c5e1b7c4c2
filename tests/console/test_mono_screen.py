"""The screen with a mono comparator, and with counters that have lost their reference."""

import asyncio
from dataclasses import replace

import pytest
from consolefake import FakeStation, console, picture
from overviewbench import MODELS, status
from screenreading import text

from anaplot.console.describe import describe_row
from anaplot.console.keys import ACTIONS, is_live, label_now
from anaplot.console.overviewview import OverviewView
from anaplot.console.rows import shown_rows
from anaplot.console.tableview import TableView
from anaplot.errors import InputError
from anaplot.session.plates import ReadOut
from anaplot.station.blockstep import NextStep
from anaplot.station.snapshot import Snapshot

LOST = "the counters have lost their reference: set the mark on point 114 and press R"


def lines(app) -> list[str]:
    return [strip.text for strip in app.screen._compositor.render_strips()]


async def until(pilot, condition):
    async with asyncio.timeout(60):
        while not condition():
            await pilot.pause(0.01)


def half(seen: int = 4, **changes: object) -> Snapshot:
    """The left photo in the comparator, so many of its points measured."""
    shown = picture(measured=0)
    points = tuple(
        replace(view, seen=("left",) if i < seen else ()) for i, view in enumerate(shown.points)
    )
    nxt = points[seen].point if seen < len(points) else None
    expected = (
        f"measure {nxt} in photo 102: 9 of 13 points to go"
        if nxt
        else "lay photo 103 into the comparator: 13 points to go"
    )
    return replace(
        shown,
        points=points,
        mono=True,
        laid="102",
        next_point=nxt,
        target=nxt,
        next_photo=None if nxt else "103",
        expected=expected,
        **changes,
    )


def lost(**changes: object) -> Snapshot:
    return picture(
        unreferenced=True, reference_point="114", next_point="114", expected=LOST, **changes
    )


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
async def test_one_photo_is_shown_as_one(size):
    station = FakeStation(half())
    station.read = ReadOut(12.5, -7.25, 12.5, -7.25, mono=True)
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        shown = lines(app)
        assert "in: 102" in shown[0]
        assert "4 of 13 measured in 102" in shown[1]
        assert "x   12.500" in shown[2]
        assert "y   -7.250" in shown[2]
        assert "px" not in shown[2]
        assert "x''" not in shown[2]
        assert text(app).count("left only") >= 4
        # y of four points and, all of them ties, their x
        assert [row.verdict for row in shown_rows(half())].count("left only") == 4 + 4
        await pilot.press("v")
        await pilot.pause()
        assert "px" not in text(app)
        # a device that speaks only when it records
        station.read = None
        await until(pilot, lambda: "old" in lines(app)[2])
        assert "x   12.500" in lines(app)[2]
        assert "px" not in text(app)
        assert "x''" not in text(app)


async def test_the_overview_gives_way_to_a_record_in_one_photo():
    work = status(MODELS, NextStep("measure", "x", "102/103", point="107"))
    station = FakeStation(half(status=work))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert app.screen.query_one(OverviewView).display
        station.tell(half(5, status=work, serial=2))
        await until(pilot, lambda: not app.screen.query_one(OverviewView).display)


async def test_plate_coordinates_of_the_one_photo_are_said_to_be():
    station = FakeStation(half())
    station.read = ReadOut(12.5, -7.25, 12.5, -7.25, True, True, mono=True)
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert "PLATE" in lines(app)[2]
        assert "left and right" not in lines(app)[2]


async def test_the_next_photo_is_laid_in_by_the_key_for_going_on():
    station = FakeStation(half(13))
    app = console(station)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.pause()
        assert "lay photo 103 into the comparator" in text(app)
        assert "g Photo" in text(app)
        await pilot.press("g")
        await asyncio.to_thread(station.wait_for, "next_model")
        await pilot.press("L")
        await asyncio.to_thread(station.wait_for, "other_photo")


def test_a_row_of_one_photo_says_so_in_full():
    snapshot = half()
    row = shown_rows(snapshot)[0]
    assert row.verdict == "left only"
    assert ("measured", "only in the left photo") in describe_row(row, snapshot)


def test_keys_of_one_photo():
    go_on = next(action for action in ACTIONS if action.id == "next_model")
    for snapshot, live, label in ((half(4), False, "Model"), (half(13), True, "Photo")):
        assert is_live("next_model", snapshot, rows=13) is live
        assert label_now(go_on, snapshot, row_off=False, point_off=False) == label


async def test_a_lost_reference_is_said_and_measured_by_a_key():
    station = FakeStation(lost())
    app = console(station)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.pause()
        assert LOST in text(app)
        assert "R Reference" in text(app)
        assert "space Record" not in text(app)
        await pilot.press("R")
        await asyncio.to_thread(station.wait_for, "reference", None)
        # a row selected by hand goes before what is proposed
        await pilot.press("home", "j", "R")
        chosen = app.screen.query_one(TableView).selected
        assert chosen is not None
        await asyncio.to_thread(station.wait_for, "reference", chosen.point)
        await pilot.press("n")
        await asyncio.to_thread(station.wait_for, "drive", "114")
        station.fault = InputError("point 114 (left) is 0.400 mm from where")
        await pilot.press("R")
        await until(pilot, lambda: "point 114 (left) is 0.400 mm" in text(app))


async def test_a_row_that_is_not_measured_is_no_reference():
    station = FakeStation(replace(lost(), points=picture(measured=0).points, solution=None))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("home", "j", "R")
        await asyncio.to_thread(station.wait_for, "reference", None)


async def test_counters_are_kept_only_when_it_is_said_twice():
    station = FakeStation(picture())
    app = console(station)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("K")
        await until(pilot, lambda: "the counters have their reference" in text(app))
        station.tell(lost(serial=2))
        await until(pilot, lambda: LOST in text(app))
        await pilot.press("K")
        await until(pilot, lambda: "Did the counters keep their origin" in text(app))
        await pilot.press("escape")
        await pilot.pause()
        assert ("keep_counters",) not in station.calls
        await pilot.press("K", "y")
        await asyncio.to_thread(station.wait_for, "keep_counters")


def test_the_key_is_there_only_when_needed():
    assert not is_live("reference", picture(), rows=18)
    assert not is_live("keep_counters", picture(), rows=18)
    # while something measured is offered, the doubtful way is not put beside it
    assert is_live("reference", lost(), rows=18)
    assert not is_live("keep_counters", lost(), rows=18)


async def test_where_nothing_can_be_referred_to_the_key_that_now_names_is_in_the_key_bar():
    nothing = "the counters have lost their reference: nothing is measured; set them, and press K"
    station = FakeStation(lost())
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await until(pilot, lambda: "R Reference" in text(app))
        assert "K Keep" not in text(app)
        station.tell(replace(lost(serial=2), reference_point=None, expected=nothing))
        await until(pilot, lambda: "K Keep" in text(app))
    assert is_live("record", picture(), rows=18)
    assert is_live("reference", lost(), rows=18)
    assert not is_live("record", lost(), rows=18)
    assert is_live("stop", picture(), rows=18)
    assert not is_live("stop", picture(drives=False), rows=18)
