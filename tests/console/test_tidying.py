"""Complete searches for garbage wait for moments in which nobody waits."""

from __future__ import annotations

import gc
import sys
import weakref
from collections.abc import Iterator

import pytest
from consolefake import FakeStation, picture
from screenreading import text, until

from anaplot.console.app import ConsoleApp
from anaplot.console.panels import DetailsPane, MessagePanel
from anaplot.console.tidying import at_ease, tidy


class Circle:
    """Refers to itself, so that only a search finds it."""

    def __init__(self) -> None:
        self.itself = self


def left_behind() -> weakref.ref[Circle]:
    """What complete searches alone find: it is as old as objects can be."""
    circle = Circle()
    gc.collect(0)
    gc.collect(1)
    return weakref.ref(circle)


@pytest.fixture
def complete_searches() -> Iterator[list[int]]:
    found: list[int] = []

    def note(phase: str, what: dict[str, int]) -> None:
        if phase == "stop" and what["generation"] == 2:
            found.append(what["collected"])

    gc.callbacks.append(note)
    yield found
    gc.callbacks.remove(note)


def old_objects(searches: int) -> None:
    """Let so many longer searches have been made since the last complete one."""
    gc.collect()
    for _ in range(searches):
        gc.collect(1)
    if gc.get_count()[2] < searches:
        pytest.skip("this Python makes its complete searches in small steps")


def test_only_what_is_worth_it_is_searched(complete_searches: list[int]) -> None:
    old_objects(5)
    old_objects(0)
    circle = left_behind()
    complete_searches.clear()
    tidy()
    assert circle() is not None
    assert not complete_searches
    for _ in range(3):  # with the two before, five longer searches
        tidy()
    assert circle() is not None
    assert not complete_searches
    tidy()
    assert circle() is None
    assert len(complete_searches) == 1
    young = weakref.ref(Circle())
    tidy()  # among new objects
    assert young() is None
    assert len(complete_searches) == 1


def test_no_complete_search_comes_by_itself_at_ease(complete_searches: list[int]) -> None:
    old_objects(5)
    before = gc.get_threshold(), sys.getswitchinterval(), gc.get_freeze_count()
    with at_ease():
        complete_searches.clear()
        kept = [[] for _ in range(700 * 10 * 70)]  # seventy times what Python waits for
        assert not complete_searches
        assert gc.get_count()[2] == 2
        assert gc.get_threshold()[2] >= 1000
        assert gc.get_freeze_count() > before[2]
    assert len(kept) == 700 * 10 * 70
    assert (gc.get_threshold(), sys.getswitchinterval(), gc.get_freeze_count()) == before


async def test_a_search_follows_a_record_and_waits_for_its_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    when: list[str] = []
    station = FakeStation(picture(measured=12))
    app = ConsoleApp(station)
    monkeypatch.setattr("anaplot.console.screen.tidy", lambda: when.append(text(app)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        station.notice("info", "nothing was recorded")
        await until(pilot, lambda: "nothing was recorded" in text(app))
        await pilot.pause(0.3)
        assert not when
        station.notice("record", "point 103 recorded")
        station.tell(picture(measured=13, serial=2))
        await until(pilot, lambda: bool(when))
        assert "<< REMEASURE" in when[0]
        assert len(when) == 1


async def test_a_search_comes_when_nothing_has_happened_for_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    when: list[bool] = []
    monkeypatch.setattr("anaplot.console.screen._QUIET", 0.2)
    monkeypatch.setattr("anaplot.console.screen.tidy", lambda: when.append(True))
    async with ConsoleApp(FakeStation()).run_test(size=(80, 24)) as pilot:
        await until(pilot, lambda: bool(when))


async def test_lines_that_only_move_are_painted_as_they_were() -> None:
    station = FakeStation()
    app = ConsoleApp(station)
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.pause()
        for k in range(3):
            station.notice("info", f"note number {k}")
        await until(pilot, lambda: "note number 2" in text(app))
        pane = app.screen.query_one(DetailsPane)

        def painted(what: str):
            rows = [pane.render_line(y) for y in range(pane.size.height)]
            (row,) = [row for row in rows if what in row.text]
            return row

        before = painted("note number 2")
        app.screen.query_one(MessagePanel).say("info", "one more")
        pane.show_lines()
        assert painted("note number 2") is before
        colours = [segment.style for segment in before]
        app.theme = "textual-light"
        await until(pilot, lambda: [s.style for s in painted("note number 2")] != colours)
