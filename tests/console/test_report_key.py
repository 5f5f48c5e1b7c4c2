"""The key that writes the report: beside the screen, one at a time, told in one line."""

from __future__ import annotations

import asyncio
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import came, lines, text, until

from anaplot.console.panels import MessagePanel
from anaplot.errors import NotComputableError
from anaplot.station.blockstatus import BlockStatus, ModelStatus, StripStatus
from anaplot.station.blockstep import NextStep
from anaplot.station.blockview import BlockView
from anaplot.station.coverage import Coverage

FREE = BlockView("101/102", 1, False, datum="free")


class Writer:
    """Writes when it is let."""

    def __init__(self) -> None:
        self.let = threading.Event()
        self.begun = threading.Event()
        self.asked: list[bool] = []
        self.fault: Exception | None = None

    def __call__(self, *, free, progress):
        self.asked.append(free)
        self.begun.set()
        progress("adjusting", 0.5)
        assert self.let.wait(60)
        if self.fault is not None:
            raise self.fault
        return Path("myblock/reports/2026-05-31-1430.html")


async def test_the_station_is_served_while_the_report_is_written() -> None:
    station, writer = FakeStation(picture(gross=False)), Writer()
    app = console(station, report=writer)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("W")
        await until(pilot, lambda: "is being written: go on measuring" in text(app))
        await asyncio.to_thread(writer.begun.wait, 60)
        await pilot.press("space")
        await came(station, "record_point")
        station.tell(replace(picture(serial=2), expected="now another one"))
        await until(pilot, lambda: "now another one" in text(app))
        # one at a time
        await pilot.press("W")
        await until(pilot, lambda: "the report is being written" in text(app))
        assert writer.asked == [False]
        writer.let.set()
        await until(pilot, lambda: "report: myblock/reports/2026-05-31-1430.html" in text(app))
        assert {cell_len(line) for line in lines(app)} == {80}
        # and the next when it is asked for, in the datum that the block has by then
        station.tell(picture(serial=3, block_view=FREE))
        await until(pilot, lambda: "W Report" in text(app) or "b Block" in text(app))
        await pilot.press("W")
        await until(pilot, lambda: writer.asked == [False, True])


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (
            NotComputableError("photo 103 is not determined"),
            "no report: photo 103 is not determined",
        ),
        (RuntimeError("[red]x[/]\n\x1b[2J"), "no report: unexpected RuntimeError: [red]x[/]"),
    ],
)
async def test_what_goes_wrong_is_one_line_and_the_key_works_again(fault, words) -> None:
    writer = Writer()
    writer.fault = fault
    writer.let.set()
    app = console(FakeStation(), report=writer)
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.press("W")
        await until(pilot, lambda: words in text(app))
        assert "\x1b" not in text(app)
        writer.fault = None
        await pilot.press("W")
        await until(pilot, lambda: "report: myblock/reports" in text(app))


async def test_a_report_of_which_nobody_hears_is_given_up() -> None:
    ended = threading.Event()

    def write(*, free, progress):
        try:
            while True:
                progress("adjusting", 0.5)
        finally:
            ended.set()

    app = console(FakeStation(picture(gross=False)), report=write)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("W")
        await until(pilot, lambda: "go on measuring" in text(app))
        app.exit(0)
    assert await asyncio.to_thread(ended.wait, 60)


async def test_a_recorded_session_has_no_block_of_its_own() -> None:
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("W")
        await until(pilot, lambda: "anaplot report BLOCK writes the report" in text(app))


async def test_of_a_block_that_will_be_deleted_that_is_said() -> None:
    writer = Writer()
    writer.let.set()
    app = console(FakeStation(), report=writer, temporary=True)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("W")
        await until(
            pilot,
            lambda: (
                "report: reports/2026-05-31-1430.html, gone with this block unless kept"
                in text(app)
            ),
        )


async def test_before_a_model_is_accepted_that_is_said() -> None:
    writer = Writer()
    open_one = ModelStatus("101", "102", "in work")
    status = BlockStatus(
        (StripStatus("1", (open_one,)),), (), None, Coverage(0, 0, 0), NextStep("adjust", "x")
    )
    app = console(FakeStation(picture(accepted=(), status=status)), {"accept": "f9"}, report=writer)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("W")
        await until(pilot, lambda: "no model is accepted yet: f9 accepts one" in text(app))
        assert not writer.asked


async def test_the_block_page_has_the_key_and_says_where_the_report_lies() -> None:
    station, writer = FakeStation(picture(block_view=FREE)), Writer()
    app = console(station, {"report": "f9"}, report=writer)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("b")
        await until(pilot, lambda: "(f9 the report)" in text(app))
        for keys in ((), ("m",)):
            writer.let.clear()
            await pilot.press(*keys, "f9")
            await until(pilot, lambda: "is being written: go on measuring" in text(app))
            writer.let.set()
            await until(pilot, lambda: "report: myblock/reports/2026-05-31-1430.html" in text(app))
        assert writer.asked == [True, True]
        await pilot.press("escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)


async def test_nothing_takes_the_place_of_where_the_report_lies_at_once() -> None:
    now = [0.0]
    panel = MessagePanel(clock=lambda: now[0])
    panel.say("report", "a/long/way/" * 9 + "reports/2026-05-31-1430.html")
    panel.say("warning", "103 is flagged")
    panel.clear()
    panel.say("record", "104")
    (line,) = panel.lines(80, 1)
    assert line.plain.startswith(" report: …")
    assert line.plain.endswith("/reports/2026-05-31-1430.html (l: all)")
    assert cell_len(line.plain) <= 80
    assert panel.lines(80, 3)[0].plain == " record: 104"
    now[0] = 7.0
    assert panel.lines(80, 1)[0].plain == " record: 104"
    panel.clear()
    assert panel.lines(80, 1) == []
