"""Every screen by keys alone at both sizes, and by the mouse alone."""

from __future__ import annotations

import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import until

PAGES = {
    "f2": "Orientation of the model",
    "l": "Messages",
    "b": "The block as one bundle",
    "T": "Ties between strips",
    "F": "Strip on its control",
    "P": "How precise the pointing is",
    "H": "Who changed what",
    "e": "Gross errors of the model",
    "d": "103 y",
    "question_mark": "Help:",
}
CLICKED = {
    "Fit": "Strip on its control",
    "Pointing": "How precise the pointing is",
    "Errors": "Gross errors of the model",
    "More": "103 y",
    "Help": "Help:",
}
COMPUTED = {"pointing", "log", "strips_on_control"}


def lines(app) -> list[str]:
    strips = app.screen._compositor.render_strips()
    return ["".join(s.text for s in strip) for strip in strips]


async def shown(app, pilot, words: str, depth: int) -> None:
    """Wait until a screen says something, as the how many-th of those laid over one another."""
    await until(pilot, lambda: len(app.screen_stack) == depth and words in "\n".join(lines(app)))
    assert {cell_len(line) for line in lines(app)} == {app.size.width}
    assert len(lines(app)) == app.size.height


def given(station: FakeStation) -> list[tuple]:
    """What was commanded."""
    return [call for call in station.calls if call[0] not in COMPUTED]


@pytest.mark.parametrize("size", [(80, 24), (160, 50)])
async def test_by_keys_alone(size):
    station = FakeStation(picture())
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.press("f")  # the row that the details are of
        for key, title in PAGES.items():
            await pilot.press(key)
            await shown(app, pilot, title, 2)
            await pilot.press("pagedown", "down", "up", "pageup")
            await shown(app, pilot, title, 2)
            await pilot.press("escape")
            await shown(app, pilot, "NOW", 1)
            if key != "e":  # there it shows the next strategy
                await pilot.press(key)
                await shown(app, pilot, title, 2)
                await pilot.press(key)
                await shown(app, pilot, "NOW", 1)
        # table, map and stereo view in every arrangement
        for key in "mmmvvssssttr":
            await pilot.press(key)
            await shown(app, pilot, "demo", 1)
        assert given(station) == []
        await pilot.press("a")
        await shown(app, pilot, "Accept", 2)
        await pilot.press("n")
        await shown(app, pilot, "NOW", 1)
        await pilot.press("plus")
        await shown(app, pilot, "Name of the point to add", 2)
        await pilot.press(*"K7", "enter")
        await shown(app, pilot, "NOW", 1)
        await pilot.press("q")
        await shown(app, pilot, "Leave", 2)
        await pilot.press("n")
        await shown(app, pilot, "NOW", 1)
        await pilot.press("a")
        await shown(app, pilot, "Accept", 2)
        await pilot.press("y")
        await until(pilot, lambda: len(given(station)) == 2)
        assert given(station) == [("add_point", "K7"), ("accept",)]


async def test_by_the_mouse_alone():
    station = FakeStation(picture())
    app = console(station)

    async def click(words: str, times: int = 1) -> None:
        await until(pilot, lambda: words in "\n".join(lines(app)))
        y = max(k for k, line in enumerate(lines(app)) if words in line)
        x = cell_len(lines(app)[y][: lines(app)[y].rindex(words)])
        await pilot.click(offset=(x + 1, y), times=times)

    async with app.run_test(size=(150, 40)) as pilot:
        await click("Flag")
        for label, title in CLICKED.items():
            await click(f" {label} ")
            await shown(app, pilot, title, 2)
            await click("(escape closes)")
            await shown(app, pilot, "NOW", 1)
        for label in ("Map", "Size", "Stereo", "Map", "Sort"):
            if f" {label} " in lines(app)[-1] + lines(app)[-2]:
                await click(f" {label} ")
                await shown(app, pilot, "demo", 1)
        assert given(station) == []
        await click(" Accept ")
        await shown(app, pilot, "Accept it?", 2)
        await click("n go on measuring")
        await shown(app, pilot, "NOW", 1)
        await click(" Add ")
        await shown(app, pilot, "Name of the point to add", 2)
        await click("escape leave it")
        await shown(app, pilot, "NOW", 1)
        await click(" Quit ")
        await shown(app, pilot, "Leave?", 2)
        await click("n stay")
        await shown(app, pilot, "NOW", 1)
        await click(" Record ")
        await click(" Accept ")
        await shown(app, pilot, "Accept it?", 2)
        await click(" accept as it is")
        await until(pilot, lambda: len(given(station)) == 2)
        assert given(station) == [("record_point",), ("accept",)]
