"""The fit page: its lines, and its keys over a station made of dataclasses."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import lines, text, until

from anaplot.console.fitpage import FitChoice, fit_lines
from anaplot.orientation.stripfit import StripFit, fit_strip
from anaplot.photogrammetry.block import Block, Camera, ControlPoint, Precision, Strip, TestSettings
from anaplot.station.stripcontrol import StripOnControl

RNG = np.random.default_rng(3)
PLACES = {
    f"c{k}": (float(x), float(y), -150.0 + float(z))
    for k, (x, y, z) in enumerate(RNG.uniform([0, -100, -5], [300, 100, 5], (8, 3)))
}
CONTROL = tuple(
    ControlPoint(name, tuple((np.array(at) * 10.0 + RNG.normal(0.0, 0.03, 3)).tolist()))
    for name, at in PLACES.items()
)


def block(control=CONTROL) -> Block:
    return Block(
        name="b",
        precision=Precision(5.0, "exact"),
        test=TestSettings(),
        cameras=(Camera("c", 150.0),),
        strips=(Strip("1", ("101", "102", "103")),),
        photos=(),
        control=control,
    )


def fitted(degree, without) -> tuple[StripOnControl, ...]:
    found = fit_strip(block(), "1", PLACES, 92.0, degree=degree, without=without)
    other = "strip 2: no model is determined yet"
    return (
        StripOnControl("1", 2, tuple(PLACES), found),
        StripOnControl("2", 0, (), other),
    )


@pytest.mark.parametrize("width", [80, 160])
def test_interchanged_control_is_named_above_its_differences(width):
    first, second, *others = CONTROL
    exchanged = (replace(first, xyz=second.xyz), replace(second, xyz=first.xyz), *others)
    found = fit_strip(block(exchanged), "1", PLACES, 92.0)
    strips = (StripOnControl("1", 2, tuple(PLACES), found),)
    page = [line.plain for line in fit_lines(strips, FitChoice(), "", width)]
    assert max(map(cell_len, page)) <= width
    said = " ".join(" ".join(page).split())
    assert "control point c0 and control point c1 interchanged? With their coordinates" in said
    assert said.index("interchanged?") < said.index("dX m")


@pytest.mark.parametrize("size", [(80, 24), (160, 50)])
async def test_the_keys_of_the_page(size):
    station = FakeStation(picture(strip="1"))
    station.fitted = fitted
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.press("F")
        await until(pilot, lambda: "similarity; 2 models, 8 control points" in text(app))
        [found, _] = fitted(1, ())
        assert isinstance(found.fit, StripFit)
        x, y, z = found.fit.rms
        assert f"RMS  X {x:.3f} m   Y {y:.3f} m   Z {z:.3f} m" in text(app)
        assert {cell_len(line) for line in lines(app)} == {size[0]}
        assert "▶ c0" in text(app)
        # put out, and compared all the same
        await pilot.press("down", "x")
        await until(pilot, lambda: "7 control points" in text(app))
        [row] = [line for line in lines(app) if "▶ c1" in line]
        assert row.split("c1")[1].split()[0] == "no"
        (difference,) = [p.difference for p in fitted(1, {"c1"})[0].fit.points if p.point == "c1"]
        assert f"{difference[0]:.3f}" in row
        await pilot.press("+")
        await until(pilot, lambda: "polynomials of degree 2" in text(app))
        await pilot.press("3")
        await until(pilot, lambda: "polynomials of degree 3" in text(app))
        fits = len(station.calls)
        await pilot.press("right")
        await until(pilot, lambda: "no model is determined yet" in text(app))
        assert len(station.calls) == fits  # all strips are fitted at once
        assert "No control point is measured" in text(app)
        await pilot.press("left", "-", "minus", "minus", "x")
        await until(pilot, lambda: "similarity; 2 models, 8 control points" in text(app))
        # the bundle lies over it
        await pilot.press("b")
        await until(pilot, lambda: "The block as one bundle" in text(app))
        await pilot.press("escape")
        await until(pilot, lambda: "Strip on its control" in text(app))
        await pilot.press("2", "F")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        await pilot.press("F")  # as it was left
        await until(pilot, lambda: "polynomials of degree 2" in text(app))
    # nothing was commanded
    assert {call[0] for call in station.calls} == {"strips_on_control"}


async def test_keys_stay_live_while_a_fit_takes_its_time():
    station = FakeStation(picture(strip="1"))
    free = threading.Event()

    def slow(degree, without):
        assert free.wait(60)
        return fitted(degree, without)

    station.fitted = slow
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("F")
        await until(pilot, lambda: "being computed" in text(app))
        await pilot.press("+")
        free.set()
        # what is shown in the end is what was asked for last
        await until(pilot, lambda: "polynomials of degree 2" in text(app))
        station.tell(picture(serial=2, strip="1"))
        await until(pilot, lambda: len(station.calls) >= 3)
        await pilot.press("escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)


def said(strips, choice=FitChoice()):  # noqa: B008 - frozen
    return "\n".join(line.plain for line in fit_lines(strips, choice, "", 72))


def test_too_few_control_points_can_be_put_in_again():
    out = frozenset(f"c{k}" for k in range(6))
    words = "strip 1: 6 control coordinates are measured, degree 1 needs 7"
    page = said((StripOnControl("1", 2, tuple(PLACES), words),), FitChoice(without=out))
    assert f"no fit: {words}" in page
    rows = [line.split()[:2] for line in page.splitlines() if line.startswith("  c")]
    assert rows == [[name, "no" if name in out else "yes"] for name in PLACES]


@pytest.mark.parametrize("name", ["\x1b[2J", "[red]x[/]", "\u202eevil", "x" * 300])
def test_foreign_names_are_shown_as_they_are(name):
    page = fit_lines((StripOnControl(name, 1, (name,), f"strip {name}"),), FitChoice(), name, 72)
    assert all(cell_len(line.plain) <= 72 for line in page)
    assert not any(c in line.plain for line in page for c in "\x1b\u202e")
