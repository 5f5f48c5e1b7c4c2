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

from anaplot.errors import NotComputableError
from anaplot.station.blockview import BlockView

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
    async with app.run_test(size=(120, 36)) as pilot:
        await pilot.press("W")
        await until(pilot, lambda: "goes with this block unless you keep it" in text(app))
