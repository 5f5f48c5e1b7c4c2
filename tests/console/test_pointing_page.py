"""The page of the precision of pointing: its lines, and its keys over a station of dataclasses."""

from __future__ import annotations

import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import text, until

from anaplot.adjustment.pooling import VarianceTest
from anaplot.console.pointingpage import pointing_lines
from anaplot.errors import InputError
from anaplot.station.drift import Drift
from anaplot.station.pointing import GroupTest, Pointing, PooledSigma
from anaplot.station.pooledrows import Sigma
from anaplot.station.repeatedpointing import RepeatedPointing

OFFER = Sigma(3.1, 2.6, 3.9, 40.0)
WHOLE = Sigma(6.2, 5.1, None, 4.0)
F = VarianceTest("F", 4.0, (30.0, 40.0), 0.0001)


def found(who: str = "ann") -> Pointing:
    return Pointing(
        apriori_um=5.0,
        pooled=(PooledSigma("all", "", 60, 40.0, WHOLE), PooledSigma("strip", who, 9, 4.0, OFFER)),
        tests=(GroupTest("operator", F),),
        repeated=(RepeatedPointing(who, "tie", 4, 24, 2, OFFER, 3.0, 3.2, 4.4, 4.5, 20),),
        offer=OFFER,
        pointings=24,
        against_models=F,
        drift=(
            Drift("2026-05-04", who, OFFER, WHOLE, F),
            Drift("2026-05-05", who, why="12 minutes of work: no first and last hour"),
        ),
        remarks=("1 flagged row counts in the sigma0 of the models",),
    )


@pytest.mark.parametrize("size", [(80, 24), (160, 50)])
async def test_p_shows_it_and_enter_points_again(size):
    station = FakeStation(picture())
    station.pointed = found
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.press("P")
        await until(pilot, lambda: "pointing 3.1 um (24 pointings, 2.6 to 3.9)" in text(app))
        assert "image_um = 3.1" in text(app)
        assert {cell_len(line) for line in text(app).splitlines()} == {size[0]}
        await pilot.press("P")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        assert {call[0] for call in station.calls} == {"pointing"}
        await pilot.press("P")
        await until(pilot, lambda: "3.1 um" in text(app))
        await pilot.press("enter")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        await until(pilot, lambda: ("point_again", None, 5) in station.calls)


async def test_what_cannot_be_read_is_told():
    station = FakeStation(picture())

    def refused():
        raise InputError("the journal is damaged")

    station.pointed = refused
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("P")
        await until(pilot, lambda: "the journal is damaged" in text(app))


def test_the_lines_say_what_is_found():
    lines = [line.plain for line in pointing_lines(found(), 72)]
    assert all(cell_len(line) <= 72 for line in lines)
    page = "\n".join(lines)
    for words in ("they differ", "2 more do not count", "DRIFT", "12 minutes", "remark: 1 flagged"):
        assert words in page
    assert "Nothing was pointed at twice" in "\n".join(
        line.plain for line in pointing_lines(Pointing(5.0), 72)
    )
    assert "being computed" in pointing_lines(None, 72)[0].plain


@pytest.mark.parametrize("name", ["\x1b[2J", "[red]x[/]", "\u202eevil", "x" * 300])
def test_foreign_names_are_shown_as_they_are(name):
    lines = pointing_lines(found(name), 72)
    assert all(cell_len(line.plain) <= 72 for line in lines)
    assert not any(c in line.plain for line in lines for c in "\x1b\u202e")
