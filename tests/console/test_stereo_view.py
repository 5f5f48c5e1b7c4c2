"""The stereo view: what it draws, its keys, and a model measured by hand through them."""

from dataclasses import replace

import numpy as np
import pytest
from consolefake import FakeStation, console, picture
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from screenreading import came, lines, selected, text, until

from anaplot.console.app import ConsoleApp
from anaplot.console.bignumber import big_number
from anaplot.console.halftone import TONES, halftone, tones
from anaplot.console.stereodrawing import StereoLayer, draw_patch, patch_size
from anaplot.console.stereoview import StereoView
from anaplot.console.wheels import FIELDS, Wheels
from anaplot.exchange.blockfolder import write_new_block
from anaplot.photogrammetry.block import TestSettings as Settings
from anaplot.planning.synthetic import synthetic_strip
from anaplot.plotter.readings import Position
from anaplot.session.plates import ReadOut
from anaplot.simulation.controls import controls_of
from anaplot.simulation.demo import rough
from anaplot.simulation.instrument import SimulationSetup
from anaplot.simulation.stereo import MarkedPoint, StereoGround
from anaplot.station.snapshot import LinkView
from anaplot.station.station import Station

SIZES = [(80, 24), (100, 30), (120, 40), (160, 50), (220, 60)]
LEFT, RIGHT = {"103": (10.0, 20.0), "far": (12.0, 20.0)}, {"103": (-80.0, 21.0), "far": (-78.0, 21)}


def simulated() -> FakeStation:
    station = FakeStation()
    station.ground = StereoGround("102", "103", LEFT, RIGHT)
    station.at = Position(10.0, 20.0, -80.0, 21.0)
    station.read = ReadOut(10.0, 20.0, -80.0, 21.0)
    return station


def instrument() -> FakeStation:
    return FakeStation(picture(link=LinkView("live", "nd281", "/dev/ttyUSB0", False, "")))


def app_of(station, size=(80, 24)):
    app = console(station)
    return app, app.run_test(size=size)


# -- drawing -----------------------------------------------------------------------------------


def test_a_halftone_is_as_bright_as_its_picture():
    shares = [halftone(np.full((40, 40), grey)).mean() for grey in np.linspace(0, 1, 21)]
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert shares[10] == 0.5
    assert shares == sorted(shares)
    ramp = tones(np.repeat(np.linspace(0, 1, 80)[None, :], 8, axis=0))
    assert ramp.shape == (2, 40)
    assert (ramp[0, 0], ramp[0, -1]) == (0, TONES - 1)


@given(st.integers(0, 120), st.integers(0, 60))
def test_a_patch_fits_and_has_a_middle(columns, rows):
    size = patch_size(columns, rows)
    if size is None:
        assert columns < 9 or rows < 6 or columns * 3 // 4 < 6
    else:
        assert size[0] % 2 == size[1] % 2 == 1
        assert size[0] <= columns
        assert size[1] <= rows


def test_the_mark_is_in_the_middle_and_names_beside_their_points():
    grey = np.zeros((4 * 11, 2 * 25))
    canvas = draw_patch(grey, (MarkedPoint("7", 10.0, 8.0, 4.4), MarkedPoint("edge", 48, 40, 4.4)))
    drawn = canvas.text().splitlines()
    assert drawn[5].index("•") == 12
    assert drawn[5].count("━━") == 2
    assert drawn[3][12] == drawn[7][12] == "┃"
    assert " 7 " in drawn[2]
    assert any(" edge " in line for line in drawn)
    layers = {layer for row in canvas.runs() for _, layer in row}
    assert layers == {0, StereoLayer.NAME, StereoLayer.MARK}


def test_no_name_hides_the_mark_and_none_commands_the_terminal():
    grey = np.full((4 * 11, 2 * 25), 0.4)
    crowd = tuple(MarkedPoint(f"p\x1b[{i}", 4.0 + 2 * i, 21.5, 3.0) for i in range(21))
    drawn = draw_patch(grey, crowd).text()
    assert drawn.splitlines()[5][12] == "•"
    assert "\x1b" not in drawn
    assert "\\x1b" in drawn


def test_on_a_light_screen_the_picture_is_no_negative():
    grey = np.linspace(0, 1, 4 * 11 * 2 * 25).reshape(44, 50)
    dark, light = draw_patch(grey, ()).dots(), draw_patch(grey, (), negative=True).dots()
    np.testing.assert_array_equal(dark, ~light)


@given(st.one_of(st.none(), st.floats(-999.999, 999.999)))
def test_large_numbers_are_all_as_wide(value):
    drawn = big_number(value)
    assert {cell_len(line) for line in drawn} == {22}


def test_large_numbers_have_their_sign():
    assert big_number(-12.5)[1].strip().startswith("╺━╸")
    assert big_number(12.5)[1].strip().startswith("╺╋╸")
    assert big_number(-0.0001) == big_number(0.0)
    assert "╺" not in big_number(0.0)[1]


def test_the_step_is_about_a_dot_of_the_picture():
    wheels = Wheels()
    assert (wheels.field_mm, wheels.step_um(), wheels.step_um(coarse=True)) == (1.0, 20, 200)
    assert wheels.toggled().step_um() == 200
    assert wheels.toggled().toggled() == wheels
    assert wheels.zoomed(100).step_um() == 1
    assert wheels.zoomed(-100).field_mm == 20.0
    assert wheels.zoomed(1).zoomed(-1) == wheels
    assert [Wheels(zoom).step_um() for zoom in range(len(FIELDS))] == [
        400, 200, 100, 40, 20, 10, 4, 2, 1,
    ]  # fmt: skip


# -- on the screen -----------------------------------------------------------------------------


@pytest.mark.parametrize("size", SIZES)
async def test_the_view_at_every_size(size):
    station = simulated()
    app, running = app_of(station, size)
    async with running as pilot:
        await pilot.press("v")
        await until(pilot, lambda: "left 102" in text(app))
        shown = lines(app)
        assert len(shown) == size[1]
        assert {cell_len(line) for line in shown} == {size[0]}
        whole = text(app)
        for part in (
            "right 103", " 1 mm ", "step 20 µm", "hand on", "px", "py", "━━", "•", "SIGF",
            "<< REMEASURE", "v Map", "h Hand off", "z/Z Zoom", "←↑↓→ x y", "pgup/pgdn px",
            ",/. py", "c Coarse", "space Record", "q Quit", " 103 ",
        ):  # fmt: skip
            assert part in whole, part
        assert ("● done" in whole) == (size[0] >= 156)  # the map beside it
        assert whole.count("•") == 2
        assert "…" not in whole
        if size[1] < 40:
            assert "px  +90.000   py   -1.000 mm" in whole
        await pilot.press("v")
        await until(pilot, lambda: "● done" in text(app))
        assert "left 102" not in text(app)


async def test_the_patches_move_with_the_wheels():
    station = simulated()
    app, running = app_of(station)
    async with running as pilot:
        await pilot.press("v")
        await until(pilot, lambda: "right 103" in text(app))
        before = lines(app)
        station.at = replace(station.at, xr=-79.8)
        station.read = replace(station.read, xr=-79.8)
        await until(pilot, lambda: "px  +89.800" in text(app))
        after = lines(app)
        assert [line[32:55] for line in before[5:16]] == [line[32:55] for line in after[5:16]]
        assert [line[57:] for line in before[5:16]] != [line[57:] for line in after[5:16]]


FINE, COARSE = 0.02, 0.2


@pytest.mark.parametrize(
    ("key", "turned"),
    [
        ("left", (-FINE, 0, 0, 0)),
        ("right", (FINE, 0, 0, 0)),
        ("up", (0, FINE, 0, 0)),
        ("down", (0, -FINE, 0, 0)),
        ("pageup", (0, 0, FINE, 0)),
        ("pagedown", (0, 0, -FINE, 0)),
        ("comma", (0, 0, 0, -FINE)),
        ("full_stop", (0, 0, 0, FINE)),
        ("shift+left", (-COARSE, 0, 0, 0)),
        ("shift+right", (COARSE, 0, 0, 0)),
        ("shift+up", (0, COARSE, 0, 0)),
        ("shift+down", (0, -COARSE, 0, 0)),
        ("shift+pageup", (0, 0, COARSE, 0)),
        ("shift+pagedown", (0, 0, -COARSE, 0)),
        ("less_than_sign", (0, 0, 0, -COARSE)),
        ("greater_than_sign", (0, 0, 0, COARSE)),
    ],
)
async def test_a_key_turns_a_wheel(key, turned):
    station = simulated()
    app, running = app_of(station)
    async with running as pilot:
        await pilot.press("v", key)
        await came(station, "turn", *turned)
        assert station.calls == [("turn", *turned)]
        assert selected(app).key == ("103", "y")
        # and nothing once the view is gone
        await pilot.press("v", key)
        await pilot.press("space")
        await came(station, "record_point")
        assert station.calls[1:] == [("record_point",)]


async def test_zoom_and_step_are_shown_and_used():
    station = simulated()
    app, running = app_of(station)
    async with running as pilot:
        await pilot.press("v", "c")
        await until(pilot, lambda: "step 200 µm coarse" in text(app))
        assert "c Fine" in text(app)
        await pilot.press("right")
        await came(station, "turn", 0.2, 0, 0, 0)
        await pilot.press("c", *"zzzz", "right")
        await came(station, "turn", 0.001, 0, 0, 0)
        assert " 0.05 mm " in text(app)
        assert "step 1 µm " in text(app)
        await pilot.press("Z", "right")
        await came(station, "turn", 0.002, 0, 0, 0)


async def test_rows_are_selected_and_driven_to_while_the_arrows_turn():
    station = simulated()
    app, running = app_of(station)
    async with running as pilot:
        await pilot.press("v", "j", "j", "k", "enter")
        await came(station, "drive", "104")
        await pilot.press("space")
        await came(station, "record_point")
        await pilot.press("home")
        assert selected(app).key == ("102", "y")


async def test_the_hand_is_switched_off_and_on():
    station = simulated()
    app, running = app_of(station)
    async with running as pilot:
        await pilot.press("v", "h")
        await came(station, "set_hand", False)
        station.tell(picture(serial=2))
        await until(pilot, lambda: "hand off" in text(app) and "h Hand on" in text(app))
        await pilot.press("h")
        await came(station, "set_hand", True)
        await until(pilot, lambda: "hand on" in text(app))


async def test_the_layouts_go_with_it():
    station = simulated()
    app, running = app_of(station)
    async with running as pilot:
        await pilot.press("v")
        await until(pilot, lambda: "left 102" in text(app))
        await pilot.press("m")
        await until(pilot, lambda: "POINT" not in text(app))
        assert "left 102" in text(app)
        assert lines(app)[4].index("right 103") >= 39  # the patches have the whole width
        await pilot.press("m")
        await until(pilot, lambda: "RED-N" in text(app))
        assert "left 102" not in text(app)
        # hidden, it has no keys
        await pilot.press("down", "enter")
        await came(station, "drive", "104")
        await pilot.press("v")
        await until(pilot, lambda: "left 102" in text(app) and "POINT" in text(app))


@pytest.mark.parametrize("size", SIZES)
async def test_without_a_simulator_the_bare_readout_is_shown_large(size):
    station = instrument()
    app, running = app_of(station, size)
    async with running as pilot:
        await pilot.press("v")
        await until(pilot, lambda: "┗━┛" in text(app))
        view = app.screen.query_one(StereoView)
        shown = [line[view.region.x : view.region.right] for line in lines(app)]
        shown = shown[view.region.y : view.region.bottom]
        named = [line.split() for line in shown if line.split()[:1] in (["x'"], ["y'"], ["px"])]
        assert [line[0] for line in named] == ["x'", "y'", "px"]
        read = station.read
        for value in (read.xl, read.yl, read.xr, read.yr, read.px, read.py):
            for part in big_number(value)[1:]:
                assert part in "\n".join(shown)
        # the arrows belong to the table
        assert "x y" not in lines(app)[-1] + lines(app)[-2]
        await pilot.press("down", "enter")
        await came(station, "drive", "104")
        await pilot.press("left")
        await until(pilot, lambda: "handwheels" in text(app))
        assert station.calls == [("drive", "104")]
        # nothing is shown as if it were live
        station.tell(picture(serial=2, link=LinkView("lost", "nd281", "/dev/x", False, "gone")))
        await until(pilot, lambda: "┗━┛" not in text(app))


@pytest.mark.parametrize("size", [(20, 6), (60, 16), (80, 12)])
async def test_small_terminals_break_nothing(size):
    for station in (simulated(), instrument()):
        app, running = app_of(station, size)
        async with running as pilot:
            await pilot.press("v", "m", "left", "z", "m", "v")
            await pilot.pause()
            assert {cell_len(line) for line in lines(app)} == {size[0]}
            await pilot.resize_terminal(80, 24)
            await until(pilot, lambda app=app: len(lines(app)) == 24)


async def test_a_light_theme_is_drawn_in_its_own_colours():
    station = simulated()
    app, running = app_of(station)
    async with running as pilot:
        await pilot.press("v")
        await until(pilot, lambda: "left 102" in text(app))
        view = app.screen.query_one(StereoView)

        def drawn():
            return [view.render_line(y).text for y in range(1, 12)]

        dark = drawn()
        app.theme = "textual-light"
        await until(pilot, lambda: drawn() != dark)
        assert len({style.color for style in view._picture_styles()[:TONES]}) == TONES
        # colours of the terminal's own cannot be mixed: the dots alone make the picture
        app.theme = "ansi-dark"
        await until(pilot, lambda: len({s.color for s in view._picture_styles()[:TONES]}) == 1)
        assert drawn() == dark


# -- the whole way -----------------------------------------------------------------------------


@pytest.fixture
def station(tmp_path):
    made = synthetic_strip(3, seed=5, image_um=5.0, test=Settings(kind="baarda"))
    folder = tmp_path / "block"
    write_new_block(folder, made.block)
    with Station(
        folder,
        plotter=SimulationSetup(made.truth, seed=5, noise_um=5.0, time_scale=1000.0),
        candidates=rough(made.truth),
        point_pattern="6",
    ) as station:
        yield station


@pytest.mark.long
async def test_a_model_measured_by_hand_through_the_keys(station):
    controls = controls_of(station)
    app = ConsoleApp(station, controls=controls)

    def lacking():
        pair = controls.stereo(50, 44, 1.0)
        return pair.x, pair.y, pair.px, pair.py

    keys = (("left", "right"), ("down", "up"), ("pagedown", "pageup"), ("comma", "full_stop"))
    async with app.run_test(size=(80, 24)) as pilot:
        await until(pilot, lambda: station.snapshot().link.state == "live")
        await pilot.press("v", "h")
        await until(pilot, lambda: not controls.hand)
        await pilot.press("g")
        await until(pilot, lambda: station.snapshot().left)
        points = [view.point for view in station.snapshot().points]
        zoom = Wheels().zoom
        for point in points:
            await until(pilot, lambda p=point: station.snapshot().target == p)
            await until(pilot, lambda: station.desk.drive_target is None)
            for field in (1.0, 0.2, 0.05):
                wanted = FIELDS.index(field)
                await pilot.press(*(["z"] * (wanted - zoom) or ["Z"] * (zoom - wanted)))
                zoom = wanted
                step = Wheels(zoom).step_um() / 1000.0
                for i, (less, more) in enumerate(keys):
                    count = round(lacking()[i] / step)
                    await pilot.press(*([more] * count or [less] * -count))
                    await until(pilot, lambda i=i, s=step: abs(lacking()[i]) <= 0.51 * s)
            assert controls.stereo(50, 44, 1.0).nearest == point
            assert max(map(abs, lacking()[2:])) < 0.002
            await pilot.press("space")
            await until(
                pilot,
                lambda p=point: next(v.times for v in station.snapshot().points if v.point == p),
            )
        solution = station.snapshot().solution
        assert solution is not None
        assert len(solution.table) == len(points)
        assert max(abs(row.residual) for row in solution.table) < 2.0
        assert not solution.flagged
        await until(pilot, lambda: "a Accept" in text(app))
