"""The log page: its lines, and its keys over a station made of dataclasses."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace

import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import lines, text, until

from anaplot.console.logpage import log_lines
from anaplot.session.changes import Change, Sizes
from anaplot.session.reasons import LastChange
from anaplot.station.snapshot import InnerView

DAY = "2026-01-01T10:00:0{}.000Z"
FIRST = Change(DAY.format(0), "Ada", "measured", "101/102", "102", "7", new=(1.0, 2.0))
AGAIN = Change(
    DAY.format(1), "Ada", "remeasured", "102/103", "103", "8", "", (1.0, 2.0), (1.5, 2.25),
    w=Sizes.known(7.5, 0.4),
)  # fmt: skip
OFF = Change(DAY.format(2), "Bob", "off", "102/103", "103", "103", "y", w=Sizes.known(3.9, None))


@pytest.fixture
def utc(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TZ", "UTC-2")  # two hours east
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def said(changes, wanted=""):
    return [line.plain.rstrip() for line in log_lines(changes, wanted, 72)]


@pytest.mark.usefixtures("utc")
def test_the_newest_first_with_zone_old_and_new_and_reason():
    assert said([FIRST, AGAIN, OFF])[1:] == [
        "3 of 3 changes",
        "",
        "2026-01-01 UTC+02:00   Bob",
        "12:00:02 off        102/103       103     103 y          w   3.90 → –",
        "",
        "2026-01-01 UTC+02:00   Ada",
        "12:00:01 remeasured 102/103       103     8              w   7.50 → 0.40",
        "         1.0000 2.0000 → 1.5000 2.2500 mm",
        "12:00:00 measured   101/102       102     7",
    ]


@pytest.mark.usefixtures("utc")
@pytest.mark.parametrize(
    ("before", "after", "row", "below"),
    [
        (339.07, 2.24, "w 339.07 → 2.24", ""),
        (19.957, 19.957, "w 19.96 → 19.96", ""),
        (1234.5, 1234.5, "", "   w 1234.50 → 1234.5"),
    ],
)
def test_no_w_is_cut_off(before, after, row, below):
    first, second = said([replace(AGAIN, w=Sizes.known(before, after))])[4:6]
    assert first == f"12:00:01 remeasured 102/103       103     8              {row}".rstrip()
    assert second == f"         1.0000 2.0000 → 1.5000 2.2500 mm{below}"


def test_one_model_or_point_alone_and_no_more_than_can_be_read():
    assert "only 102/103: 2 of 3 changes" in said([FIRST, AGAIN, OFF], "102/103")
    assert "only 7: 1 of 3 changes" in said([FIRST, AGAIN, OFF], "7")
    assert "0 of 0 changes" in said([])
    assert said(None)[-1] == "being read ..."
    assert said([FIRST] * 600)[-1] == "and 100 earlier ones: anaplot log has all"


@pytest.mark.parametrize("name", ["\x1b[2J", "[red]x[/]", "\u202eevil", "x" * 300])
def test_foreign_names_are_shown_as_they_are(name):
    change = Change(DAY.format(1), name, "off", name, name, name, "y", reason=name)
    page = log_lines([change], name, 72)
    assert all(cell_len(line.plain) <= 72 for line in page)
    assert not any(c in line.plain for line in page for c in "\x1b\u202e")


@pytest.mark.parametrize("size", [(80, 24), (160, 50)])
async def test_the_keys_of_the_page(size):
    station = FakeStation()
    station.changes = [FIRST, AGAIN]
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.press("H")
        await until(pilot, lambda: "2 of 2 changes" in text(app))
        assert {cell_len(line) for line in lines(app)} == {size[0]}
        # it follows the work
        station.changes.append(OFF)
        station.tell(picture(serial=2, last_change=LastChange("off", "102/103", "103", "y")))
        await until(pilot, lambda: "3 of 3 changes" in text(app))
        await pilot.press("m")
        await until(pilot, lambda: "only 102/103: 2 of 3 changes" in text(app))
        await pilot.press("slash", *"101/1", "enter")
        await until(pilot, lambda: "only 101/1: 1 of 3 changes" in text(app))
        await pilot.press("slash", "escape")
        await until(pilot, lambda: "only 101/1: 1 of 3 changes" in text(app))
        await pilot.press("slash", "enter")
        await until(pilot, lambda: "3 of 3 changes" in text(app))
        await pilot.press("H")
        await until(pilot, lambda: len(app.screen_stack) == 1)
    assert {call[0] for call in station.calls} == {"log"}


async def test_news_that_never_end_do_not_keep_the_page_empty():
    station = FakeStation()
    station.changes = [FIRST]
    app = console(station)
    serial = itertools.count(2)
    read = station.log

    def overtaken():
        """Read, while something more is changed every time."""
        change = LastChange("off", "102/103", "103", str(next(serial)))
        app.call_from_thread(station.tell, picture(serial=next(serial), last_change=change))
        app.call_from_thread(app.screen_stack[0].on_orientation_screen_woken)
        return read()

    station.log = overtaken
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("H")
        await until(pilot, lambda: "1 of 1 changes" in text(app))
        station.log = read
        await pilot.press("H")


async def test_news_without_a_change_do_not_read_the_journal_again():
    inner = InnerView("102", "left", (), None, (), (), accepted=True)
    station = FakeStation(picture(inners=(inner,)))
    station.changes = [FIRST]
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("H")
        await until(pilot, lambda: "1 of 1 changes" in text(app))
        again = picture(serial=2, inners=(replace(inner),), expected="the plates stand")
        station.tell(replace(again, solution=replace(again.solution)))
        await until(pilot, lambda: "the plates stand" in text(app))
        await pilot.press("H")
        await until(pilot, lambda: len(app.screen_stack) == 1)
    assert station.calls == [("log",)]
