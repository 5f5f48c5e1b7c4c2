"""The screen during an inner orientation: fiducials in table and map, the same keys."""

from dataclasses import replace

import numpy as np
import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import came, lines, selected, text, until

from anaplot.console.describe import advice_of, describe_model, describe_row
from anaplot.console.inwork import in_work
from anaplot.console.keys import is_live
from anaplot.console.mapdrawing import draw_map
from anaplot.console.panels import ReadOutLine
from anaplot.console.rows import shown_rows
from anaplot.photogrammetry.block import Camera, TestSettings
from anaplot.photogrammetry.inner import orient_inner
from anaplot.photogrammetry.inneradvice import inner_advice
from anaplot.photogrammetry.platetransformation import random_placement
from anaplot.planning.syntheticcamera import with_calibration
from anaplot.session.plates import ReadOut
from anaplot.station.snapshot import FiducialView, InnerView

CAMERA = with_calibration(Camera("rmk", 152.4, (230.0, 230.0))).calibration
assert CAMERA is not None


def inner(measured=8, wrong="", *, side="left", accepted=False, off=()) -> InnerView:
    """A photo's inner orientation, `wrong` missed by 0.2 mm along x."""
    rng = np.random.default_rng(3)
    places = np.array([(m.x, m.y) for m in CAMERA.fiducials])
    places[[m.id == wrong for m in CAMERA.fiducials], 0] += 0.2
    plate = random_placement(5).to_plate(places) + rng.normal(0.0, 0.003, places.shape)
    seen = {m.id: tuple(xy) for m, xy in zip(CAMERA.fiducials, plate.tolist(), strict=True)}
    seen = dict(list(seen.items())[:measured])
    solution = None
    if measured >= 3:
        solution = orient_inner(CAMERA, seen, test=TestSettings(kind="baarda"), off=off)
    flagged = {row.key[0] for row in solution.flagged} if solution else set()
    return InnerView(
        photo="102" if side == "left" else "103",
        side=side,
        fiducials=tuple(
            FiducialView(
                m.id,
                (m.x, m.y),
                "pending" if m.id not in seen else "flagged" if m.id in flagged else "measured",
                int(m.id in seen),
                tuple(axis for axis in "xy" if (m.id, axis) in off),
            )
            for m in CAMERA.fiducials
        ),
        solution=solution,
        suspects=tuple(row.key for row in solution.flagged) if solution else (),
        advice=inner_advice(replace(solution, unmeasured=())) if solution else (),
        accepted=accepted,
    )


def scene(view: InnerView, *more: InnerView, **changes):
    pending = [f.fiducial for f in view.fiducials if f.status == "pending"]
    following = pending[0] if pending else view.suspects[0][0] if view.suspects else None
    expected = f"measure fiducial {following}" if following else "accept the inner orientation"
    return picture(
        measured=0,
        inners=(view, *more),
        target=following,
        next_point=following,
        expected=expected,
        may_accept=view.solution is not None,
        problem="",
        **changes,
    )


SIZES = [(80, 24), (120, 40), (160, 50)]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("measured", [0, 2, 8])
async def test_everything_that_matters_is_there_at_every_size(size, measured):
    station = FakeStation(scene(inner(measured, "3" if measured == 8 else "")))
    station.read = ReadOut(-105.5, 104.25, 0.0, 0.0, plate_left=True, plate_right=True)
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        shown = lines(app)
        assert len(shown) == size[1]
        assert {cell_len(line) for line in shown} == {size[0]}
        whole = "\n".join(shown)
        for part in (
            "INNER ORIENTATION photo 102 left", "model 2 of 4", "SIMULATED", "live",
            "FIDUCIAL", "RED-N", "RESID µm", "EXPD µm", "SIGF", "-105.500", "104.250",
            "left and right: PLATE", "● done", "? Help", "q Quit",
        ):  # fmt: skip
            assert part in whole, part
        assert "PARX" not in whole
        assert "px" not in shown[2]
        assert ("<< REMEASURE" in whole) == (measured == 8)
        assert ("sigma0" in shown[1]) == (measured == 8)
        assert (f"{measured} of 8 measured" in shown[1]) == (measured < 8)


async def test_the_table_is_that_of_the_fiducials():
    view = inner(8, "3")
    app = console(FakeStation(scene(view)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        shown = lines(app)
        assert shown[4].startswith("  FIDUCIAL RED-N RESID µm EXPD µm  SIGF")
        # the flagged row is selected by itself
        assert selected(app).key == ("3", "x")
        row = next(r for r in view.solution.rows if r.key == ("3", "x"))
        line = next(line for line in shown if line.startswith("▶"))
        assert line.split()[1:3] == ["3", "x"]
        for value in (f"{row.r:.3f}", f"{row.residual:.1f}", f"{abs(row.w):.2f}"):
            assert value in line
        assert "<< REMEASURE" in line
        assert "remeasure 3 (x)" in text(app)
        await pilot.press("s", "s", "s")
        assert "FIDUCIA▴" in text(app)
        await pilot.press("d")
        await until(pilot, lambda: "fiducial of photo 102" in text(app))
        assert "RESID" in text(app)


async def test_the_same_keys():
    station = FakeStation(scene(inner(8, "3")))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.press("space")
        await came(station, "record_point")
        await pilot.press("enter")
        await came(station, "drive", "3")
        await pilot.press("x")
        await came(station, "switch", "3", "x", False)
        await pilot.press("X")
        await came(station, "switch", "3", None, False)
        await pilot.press("u")
        await came(station, "undo")
        await pilot.press("f")
        assert selected(app).flagged
        await pilot.press("a")
        await until(pilot, lambda: "still flagged in the inner" in text(app))
        await pilot.press("y")
        await came(station, "accept")
        station.tell(scene(inner(3), serial=2))
        await until(pilot, lambda: "next" in text(app))
        await pilot.press("n")
        await came(station, "drive", "4")


async def test_rows_that_are_off_are_switched_on():
    station = FakeStation(scene(inner(8, off={("1", "x"), ("2", "x"), ("2", "y")})))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert text(app).count(" off") >= 3
        await pilot.press("x")
        await came(station, "switch", "1", "x", True)


async def test_what_cannot_be_accepted_yet():
    station = FakeStation(replace(scene(inner(2)), problem="inner orientation needs 3 fiducials"))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.press("a")
        words = "the inner orientation cannot be accepted now"
        await until(pilot, lambda: words in text(app))
        assert ("accept",) not in station.calls


async def test_then_come_the_points():
    station = FakeStation(scene(inner(8)))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.press("down", "down", "down")
        assert selected(app).key == ("2", "y")
        right = inner(0, side="right")
        station.tell(scene(inner(8, accepted=True), right, serial=2))
        await until(pilot, lambda: "photo 103 right" in text(app))
        # the cursor begins anew
        assert selected(app).key == ("1", "x")
        done = (inner(8, accepted=True), inner(8, side="right", accepted=True))
        station.tell(picture(measured=0, serial=3, inners=done))
        await until(pilot, lambda: "photos 102 | 103" in text(app))
        assert "POINT" in text(app)
        assert "FIDUCIAL" not in text(app)
        assert selected(app).key == ("102", "y")
        await pilot.press("f2")
        await until(pilot, lambda: "Orientation of the model" in text(app))
        assert "left photo" in text(app)
        assert "102: the bilinear transformation, accepted" in text(app)
        assert "film shrinkage" in text(app)


async def test_leaving_in_the_middle_asks_first():
    station = FakeStation(scene(inner(2)))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.press("q")
        await until(pilot, lambda: "is not accepted yet" in text(app))
        await pilot.press("n")
        station.tell(scene(inner(0), serial=2))
        await until(pilot, lambda: "0 of 8 measured" in text(app))
        await pilot.press("q")
        await until(pilot, lambda: not app.is_running)


async def test_the_inner_orientation_has_its_page():
    app = console(FakeStation(scene(inner(8), inner(0, side="right"))))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.press("f2")
        await until(pilot, lambda: "Inner orientation   (escape" in text(app))
        for part in ("102: the bilinear", "not accepted yet", "103: inner orientation not det"):
            assert part in text(app)


def test_the_map_shows_the_fiducials():
    snapshot = scene(inner(8, "3"))
    canvas = draw_map(snapshot, ("3", "x"), 60, 30)
    whole = "\n".join("".join(part for part, _ in row) for row in canvas.runs())
    assert whole.count("●") + whole.count("!") >= 8
    assert "µm residual" in whole
    # in the corners and on the sides, as the certificate says
    rows = whole.splitlines()
    at = {name: next((i, row.index(name)) for i, row in enumerate(rows) if name in row)
          for name in ("1", "2", "3", "4")}  # fmt: skip
    assert at["3"][0] < at["1"][0]
    assert at["2"][0] < at["4"][0]
    assert at["3"][1] < at["2"][1]


def test_a_fiducial_without_a_place_is_not_on_the_map():
    view = inner(0)
    view = replace(view, fiducials=tuple(replace(f, place=None) for f in view.fiducials))
    canvas = draw_map(scene(view), None, 60, 30)
    rows = ["".join(part for part, _ in row) for row in canvas.runs()]
    assert not any("○" in row for row in rows[:-1])


def test_the_readout_says_which_photo():
    line = ReadOutLine()
    for left, right, words in (
        (True, True, "left and right: PLATE"),
        (True, False, "left: PLATE"),
        (False, True, "right: PLATE"),
        (False, False, "px"),
    ):
        line._readout = ReadOut(1.0, 2.0, 3.0, 4.0, left, right)
        line._live = True
        for width in (80, 160):
            (shown,) = line.lines(width, 1)
            assert words in shown.plain
            assert ("px" in shown.plain) == (not left and not right)
            assert cell_len(shown.plain) <= width


def test_the_last_readout_of_a_device_that_is_silent_stays_and_is_called_old(monkeypatch):
    line = ReadOutLine()
    monkeypatch.setattr(line, "show_lines", lambda: None)
    last = ReadOut(1.25, 2.5, 1.25, 2.5, mono=True)
    for width in (80, 160):
        line.show(last, live=True)
        assert "old" not in line.lines(width, 1)[0].plain
        line.show(None, live=True)
        (shown,) = line.lines(width, 1)
        assert "1.250" in shown.plain
        assert shown.plain.rstrip().endswith("old")
        assert cell_len(shown.plain) <= width
        line.show(replace(last, xl=7.5), live=True)
        assert "7.500" in line.lines(width, 1)[0].plain
        assert "old" not in line.lines(width, 1)[0].plain
        line.show(None, live=False)  # the link is down: nothing is known
        assert "7.500" not in line.lines(width, 1)[0].plain
        line.show(None, live=True)
        assert "7.500" not in line.lines(width, 1)[0].plain


def test_rows_and_words():
    snapshot = scene(inner(8, "3"))
    rows = shown_rows(snapshot)
    assert [row.key for row in rows][:4] == [("1", "x"), ("1", "y"), ("2", "x"), ("2", "y")]
    assert len(rows) == 16
    assert [row.key for row in rows if row.accused] == [("3", "x")]
    work = in_work(snapshot)
    assert work.flagged[0] == ("3", "x")
    assert work.redundancy == 8
    entries = dict(describe_row(next(r for r in rows if r.accused), snapshot))
    assert entries["row"] == "3 x, fiducial of photo 102"
    assert "RESID" in entries
    assert "holds the error" in entries
    assert advice_of(snapshot)[0].startswith("remeasure 3 (x)")
    assert any(value.startswith("102: the bilinear") for _, value in describe_model(snapshot))


def test_which_keys_make_sense():
    snapshot = scene(inner(8, "3"))
    assert is_live("next_flag", snapshot, rows=16)
    assert is_live("accept", snapshot, rows=16)
    assert not is_live("add_point", snapshot, rows=16)
    assert not is_live("transfers", snapshot, rows=16)
    assert not is_live("next_flag", scene(inner(8)), rows=16)
