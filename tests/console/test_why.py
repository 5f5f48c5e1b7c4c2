"""Why a measurement was changed, asked for and answered by one key that never holds anything up."""

from __future__ import annotations

import asyncio

import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import lines, until

from anaplot.console.keymap import keys_in_force
from anaplot.console.whyline import why_line
from anaplot.session.reasons import REASONS, LastChange
from anaplot.station.snapshot import LinkView

ASKED = "why? 1 pointing 2 identification 3 transfer 4 instrument"
OFF = LastChange("off", "102/103", "103", "y")


@pytest.mark.parametrize("size", [(80, 24), (160, 50)])
async def test_the_question_stands_beside_the_news_and_goes_with_the_answer(size):
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        assert "why?" not in "\n".join(lines(app))
        station.notice("info", "103 y off")
        station.tell(picture(serial=2, last_change=OFF))
        await until(pilot, lambda: ASKED in "\n".join(lines(app)))
        assert "103 y off" in "\n".join(lines(app))
        assert {cell_len(line) for line in lines(app)} == {size[0]}
        for key, reason in zip("1234", REASONS, strict=True):
            await pilot.press(key)
            await asyncio.to_thread(station.wait_for, "give_reason", reason)
        answered = LastChange("off", "102/103", "103", "y", reason="instrument")
        station.tell(picture(serial=3, last_change=answered))
        await until(pilot, lambda: "why?" not in "\n".join(lines(app)))


async def test_other_keys_go_on_and_the_question_gives_way_to_a_long_message():
    station = FakeStation(picture(last_change=OFF))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await until(pilot, lambda: ASKED in "\n".join(lines(app)))
        station.notice("warning", "a message longer than the question leaves of a line")
        whole = "warning: a message longer than the question leaves of a line"
        await until(pilot, lambda: whole in "\n".join(lines(app)))
        assert any(line.endswith(" why? 1 2 3 4 ") for line in lines(app))
        assert {cell_len(line) for line in lines(app)} == {80}
        station.notice("warning", "a message that is longer than any line of this size of screen")
        await until(pilot, lambda: "(l: all)" in "\n".join(lines(app)))
        assert any(line.endswith(" why? 1 2 3 4 ") for line in lines(app))
        await pilot.press("space")
        await until(pilot, lambda: ASKED in "\n".join(lines(app)))
        await asyncio.to_thread(station.wait_for, "record_point")


async def test_a_simulated_operator_is_not_asked():
    station = FakeStation(picture(last_change=OFF))
    station.automatic = True
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert "why?" not in "\n".join(lines(app))


def test_when_there_is_nothing_to_ask():
    keys = keys_in_force({"why_pointing": "A"})
    assert why_line(picture(last_change=OFF), keys) == (ASKED.replace("1", "A"), "why? A 2 3 4")
    assert why_line(picture(), keys) == ("", "")
    later = LastChange("off", "102/103", "103", "y", latest=False)
    assert why_line(picture(last_change=later), keys) == ("", "")
    seen = LinkView("replay", "recorded")
    assert why_line(picture(last_change=OFF, link=seen), keys) == ("", "")
