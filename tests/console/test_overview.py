"""Where am I: the overview between models, at the end of a strip, and first of all."""

import re
from dataclasses import replace

import pytest
from consolefake import FakeStation, console, picture
from overviewbench import FOLDER, MODELS, accepted, between, status, view
from rich.cells import cell_len
from screenreading import came, lines, text, until

from anaplot.console.intent import PAGES
from anaplot.console.overview import (
    SIGNS,
    doing,
    entries_of,
    foot_lines,
    map_lines,
    model_text,
    strip_text,
)
from anaplot.console.overviewview import ModelList, OverviewView
from anaplot.console.tableview import TableView
from anaplot.planning.stabilizing import ExtraPoint, StabilizingSet
from anaplot.station.blockstatus import BlockStatus, ModelStatus, StripStatus
from anaplot.station.blockstep import NextStep
from anaplot.station.coverage import Coverage

SIZES = [(80, 24), (160, 50)]
KEYS = {name: (key,) for name, key in (
    ("next_model", "g"), ("accept", "a"), ("next_point", "n"), ("drive", "enter"),
    ("report", "W"), ("add_point", "+"), ("suspend", "p"),
)}  # fmt: skip


def stands(app) -> bool:
    shown = app.screen_stack[0].query_one(OverviewView).display
    assert shown is not app.screen_stack[0].query_one(TableView).display
    return shown


def here(app) -> str:
    return app.screen_stack[0].query_one(ModelList).selected.name


# -- lines ---------------------------------------------------------------------------------------


def test_a_models_line_says_all_that_is_known_of_it():
    line = model_text(accepted("101", "102", off=2, ties=5), 80, here=True, following=False)
    assert re.split(r"  +", line.strip()) == [
        "▶ ● 101 | 102", "accepted", "4.87", "12", "0", "2", "5",
    ]  # fmt: skip
    line = model_text(ModelStatus("103", "104", "open"), 80, here=False, following=True)
    assert line.split() == ["○", "103", "|", "104", "next"]
    line = model_text(ModelStatus("103", "104", "look", why="nothing"), 80, here=False, following=0)
    assert line.split() == ["!", "103", "|", "104", "look", "–", "–", "0", "0", "0"]


@pytest.mark.parametrize("width", [40, 76, 80])
def test_long_and_strange_names_stay_in_their_columns(width):
    model = accepted("\x1b[31m" + "ä" * 300, "東京" * 20 + "[b]x", flagged=3)
    line = model_text(model, width, here=False, following=False)
    assert cell_len(line) == width
    assert "\x1b" not in line
    strip = StripStatus("[red]" + "s" * 300, (model,))
    assert cell_len(strip_text(strip, width)) == width
    found = BlockStatus((strip,), (), None, Coverage(0, 0, 0), NextStep("adjust", "x"))
    for line in (*map_lines(found, model, width, 20), *foot_lines(found, "g", width, 6)):
        assert cell_len(line.plain) <= width


def test_a_strip_is_pooled_over_its_accepted_models():
    strip = StripStatus(
        "1",
        (
            accepted("1", "2", sigma0_um=3.0, redundancy=10),
            accepted("2", "3", sigma0_um=6.0, redundancy=5),
            ModelStatus("3", "4", "in work", 100.0, 7),
            ModelStatus("4", "5", "open"),
        ),
    )
    assert strip.pooled_um == pytest.approx(((10 * 9 + 5 * 36) / 15) ** 0.5)
    assert "2 of 4 models accepted, pooled sigma0 4.24 µm" in strip_text(strip, 80)
    assert StripStatus("1", strip.models[2:]).pooled_um is None


def test_weak_spots_begin_with_what_the_block_is_sure_of():
    models = (
        accepted("101", "102", "look"),
        accepted("102", "103", "look", flagged=2),
        accepted("103", "104", redundancy=0, sigma0_um=None),
        accepted("104", "105", "look", why="not determined"),
    )
    found = status(models, NextStep("return", "x"), block=view(sure=True, aside=("207",)))
    assert [spot.words for spot in found.weak_spots] == [
        "point 102-2 in photo 102 (model 101/102): over 99 %",
        "not connected yet: photos 207",
        "model 102/103: 2 rows flagged",
        "model 103/104: no redundancy, nothing checks it",
        "model 104/105: not determined",
    ]
    two = (StripStatus("1", MODELS), StripStatus("2", (accepted("201", "202"),)))
    found = BlockStatus(two, (), None, Coverage(0, 0, 0), NextStep("adjust", "x"))
    assert [spot.words for spot in found.weak_spots] == ["no point ties the strips together yet"]
    assert replace(found, coverage=Coverage(1, 0, 0)).weak_spots == ()


def test_the_foot_says_how_much_it_leaves_out():
    models = tuple(accepted(str(k), str(k + 1), "look", flagged=1) for k in range(9))
    found = status(models, NextStep("adjust", "anaplot adjust b"), coverage=Coverage(0, 4, 1))
    shown = [line.plain.strip() for line in foot_lines(found, "anaplot adjust b", 80, 6)]
    assert shown[0] == "block   nothing is in it yet"
    assert shown[1] == "joined  control 1 of 4 measured"
    assert shown[2] == "look    ! model 0/1: 1 row flagged"
    assert shown[4] == "! and 7 more to look at"
    assert shown[5] == "next    adjust the block: anaplot adjust b"
    assert len(foot_lines(found, "x", 80, 40)) == 12
    # a command is not cut
    shown = [line.plain.strip() for line in foot_lines(found, "anaplot adjust /a/long/path", 50, 6)]
    assert shown[-2:] == ["next    adjust the block: anaplot adjust", "/a/long/path"]


def test_a_weak_spot_is_told_whole_where_there_is_room_and_else_shows_that_it_is_not():
    said = "no orientation with 101-1, 101-1'; 101-1 and 101-1' interchanged? All agree then"
    model = accepted("101", "102", why=said)
    found = status((model,), NextStep("measure", "x"))
    whole, cut = (
        [line.plain.strip() for line in foot_lines(found, "n", 80, height)] for height in (6, 3)
    )
    assert " ".join(whole[1:3]) == f"look    ! model 101/102: {said}"
    assert len(whole) == 4
    assert len(cut) == 3
    assert cut[1].endswith("…")
    assert cut[1][:-1] in f"look    ! model 101/102: {said}"


def test_the_foot_names_points_for_weak_photos_where_there_is_room():
    points = tuple(
        ExtraPoint(x, 92.0, (x, 92.0, 0.0), ("101", "102")) for x in (-92.0, -46.2, 0.0, 92.4)
    )
    sets = tuple(
        StabilizingSet(photo, points[:size], 0.231, 0.3 + size / 25, 0.0, 0.0)
        for photo in ("101", "104")
        for size in (1, 2, 4)
    )
    seen = replace(view(), weak=("101", "104"), stabilizing=sets)
    found = replace(status(MODELS, NextStep("adjust", "x")), block=seen)
    words = "photo 101: mean r 0.23, 0.38 with (-92, 92) and (-46, 92)"
    assert found.weak_photos == (words, words.replace("101", "104"))
    shown = [line.plain.strip() for line in foot_lines(found, "x", 80, 12)]
    assert f"weak    {words}" in shown
    assert shown[-1].startswith("next")
    # the verdict and what is next go before
    few = [line.plain.strip() for line in foot_lines(found, "x", 80, 2)]
    assert not any("mean r" in line for line in few)


@pytest.mark.parametrize(
    ("step", "lead", "key"),
    [
        (NextStep("measure", "c", "1/2"), None, "g"),
        (NextStep("measure", "c", "1/2", point="7"), "next_point", "n"),
        (NextStep("measure", "c", "1/2", "2"), "next_model", "g"),
        (NextStep("measure", "c", "1/2"), "suspend", "p"),
        (NextStep("measure", "c", "1/2"), "add_point", "+"),
        (NextStep("accept", "c", "1/2"), "next_point", "a"),
        (NextStep("return", "c", "1/2"), None, "enter"),
        (NextStep("tie", "c", "1/2", strip="2"), None, "enter"),
        (NextStep("adjust", "anaplot adjust c"), None, "anaplot adjust c"),
        (NextStep("report", "anaplot report c"), None, "W"),
    ],
)
def test_what_is_next_has_its_key(step, lead, key):
    assert doing(step, lead, KEYS) == key


def test_the_map_has_a_sign_for_every_model():
    models = tuple(
        ModelStatus(str(k), str(k + 1), state) for k, state in enumerate([*SIGNS] * 30, 1)
    )
    found = BlockStatus(
        (StripStatus("east", models), StripStatus("west", models[:2])),
        (), None, Coverage(0, 0, 0), NextStep("adjust", "x"),
    )  # fmt: skip
    shown = [line.plain for line in map_lines(found, models[3], 60, 40)]
    assert all(cell_len(line) <= 60 for line in shown)
    whole = "".join(shown[: shown.index("")] + shown[2 : shown.index("", 2)])
    for sign in SIGNS.values():
        assert whole.count(sign) == 30 + (sign in "○◆")
    assert "west" in whole
    assert any("lines more" in line.plain for line in map_lines(found, None, 60, 6))
    assert [entry.model for entry in entries_of(found)].count(None) == 2


# -- on the screen -------------------------------------------------------------------------------


AT_80_BY_24 = """\
    MODEL                STATE      SIGMA0 µm  REDUND  FLAGGED  OFF  TIES
 STRIP 1   2 of 4 models accepted, pooled sigma0 4.87 µm
  ● 101 | 102            accepted        4.87      12        0    0     0
  ● 102 | 103            accepted        4.87      12        0    2     5
▶ ○ 103 | 104            next
  ○ 104 | 105            open"""


async def test_between_models_it_stands_at_80_by_24_and_every_key_acts():
    station = FakeStation(between())
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert stands(app)
        shown = [line.rstrip() for line in lines(app)]
        assert shown[4:10] == AT_80_BY_24.splitlines()
        foot = " block   4 photos, 28 points, sigma0 4.86 µm, nothing flagged, free of control"
        assert foot in shown
        assert " next    measure model 103/104: g" in shown
        assert "enter Go there" in text(app)
        assert "w Table" in text(app)
        await pilot.press("g")
        await came(station, "next_model")
        await pilot.press("space")
        await came(station, "record_point")
        await pilot.press("u")
        await came(station, "undo")
        assert stands(app)
        await pilot.press("b")
        await until(pilot, lambda: "The block as one bundle" in text(app))
        await pilot.press("escape")
        assert stands(app)


async def test_enter_does_what_is_next_and_then_what_is_selected():
    station = FakeStation(between())
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert here(app) == "103/104"
        await pilot.press("enter")
        await came(station, "next_model")
        await pilot.press("down", "down", "down")
        assert here(app) == "104/105"
        await pilot.press("enter")
        await until(pilot, lambda: "model 104/105 comes after model 103/104" in text(app))
        assert station.calls == [("next_model",)]
        await pilot.press("home")
        assert here(app) == "101/102"
        await pilot.press("k", "pagedown", "pageup", "end", "up")
        assert here(app) == "103/104"
        # the cursor that was moved by hand stays where it is
        station.tell(between(serial=2))
        await pilot.pause()
        assert here(app) == "103/104"


@pytest.mark.parametrize("size", SIZES)
async def test_enter_on_an_accepted_model_returns_to_it(size):
    station = FakeStation(between())
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        await pilot.press("home", "enter")
        await came(station, "return_to", "101", "102", "", "")
        # what the block is sure of is next: the cursor is there by itself
        wrong = status(
            (accepted("101", "102", "look"), *MODELS[1:]),
            NextStep("return", "x", "101/102", "102", "102-2"),
            block=view(sure=True),
        )
        station.tell(picture(serial=2))
        station.tell(between(wrong, serial=3))
        await until(pilot, lambda: "next    return to model 101/102" in text(app))
        assert "look    ! point 102-2 in photo 102 (model 101/102): over 99 %" in text(app)
        await pilot.press("w", "w")
        assert here(app) == "101/102"
        await pilot.press("enter")
        await came(station, "return_to", "101", "102", "102-2", "102")


@pytest.mark.parametrize("size", SIZES)
async def test_it_gives_way_to_a_model_and_comes_back(size):
    station = FakeStation(between())
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        assert stands(app)
        work = status(
            (*MODELS[:2], ModelStatus("102", "103", "in work"), MODELS[3]),
            NextStep("measure", "x", "102/103", point="107"),
        )
        station.tell(picture(measured=5, serial=2, status=work))
        await until(pilot, lambda: not stands(app))
        await pilot.press("w")
        assert stands(app)
        assert here(app) == "102/103"
        await pilot.press("w")
        assert not stands(app)
        # called by hand it stays while points come in; a key that works in the model ends it
        await pilot.press("w")
        station.tell(picture(measured=6, serial=3, status=work))
        await until(pilot, lambda: "6 of 13 measured" in text(app))
        assert stands(app)
        await pilot.press("n")
        await came(station, "drive", "108")
        assert not stands(app)
        station.tell(between(serial=4))
        await until(pilot, lambda: stands(app))


async def test_first_of_all_it_stands_over_a_model_in_work_until_something_is_measured():
    work = status(MODELS, NextStep("measure", "x", "102/103", point="107"))
    station = FakeStation(picture(measured=5, status=work))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert stands(app)
        station.tell(picture(measured=6, serial=2, status=work))
        await until(pilot, lambda: not stands(app))
        assert "107   y" in text(app)


async def test_a_users_own_key_is_written_as_it_is():
    app = console(FakeStation(between()), {"drive": "y"})
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("home")
        await until(pilot, lambda: "return to model 101/102: y, or" in text(app))


async def test_what_enter_does_is_said_as_it_does_it():
    # rows of a model that no session has measured stand in the file: it is accepted, and measured
    # next
    found = status((accepted("101", "102"), *MODELS[2:]), NextStep("measure", "x", "101/102"))
    station = FakeStation(between(found, accepted=()))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("home")
        await pilot.pause()
        assert "return to" not in text(app)
        await pilot.press("enter")
        await came(station, "next_model")


async def test_a_page_lies_over_it_and_leaves_it_where_it_is():
    work = status(MODELS, NextStep("measure", "x", "102/103", point="107"))
    app = console(FakeStation(picture(measured=5, status=work)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        for page in PAGES:
            app.screen.action_press(page)
            await until(pilot, lambda: len(app.screen_stack) == 2)
            app.pop_screen()
            await pilot.pause()
            assert stands(app), page


async def test_at_160_by_50_the_map_stands_beside_it():
    app = console(FakeStation(between()))
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.pause()
        whole = text(app)
        assert " 1 101 ●●○○" in whole
        assert "○ open, ◆ in work, ● accepted, ~ recomputed, ! look" in whole


async def test_five_hundred_models_scroll():
    models = tuple(
        accepted(str(k), str(k + 1)) if k < 400 else ModelStatus(str(k), str(k + 1), "open")
        for k in range(500)
    )
    found = status(models, NextStep("measure", "x", "400/401"), block=view(sure=True))
    app = console(FakeStation(between(found)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert "▶ ○ 400 | 401" in text(app)
        assert "○ 499 | 500" not in text(app)
        await pilot.press("end")
        assert "▶ ○ 499 | 500" in text(app)
        await pilot.press("home")
        assert "▶ ● 0 | 1" in text(app)
        assert "STRIP 1   400 of 500" in text(app)
        await pilot.press("pagedown")
        assert 5 < int(here(app).split("/")[0]) < 20
        assert f"▶ ● {here(app).split('/')[0]} |" in text(app)


async def test_the_mouse_selects_and_goes_there():
    station = FakeStation(between())
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.click(offset=(10, 6))
        assert here(app) == "101/102"
        await pilot.click(offset=(10, 8))
        assert here(app) == "103/104"
        assert station.calls == []
        await pilot.click(offset=(12, 8))
        await came(station, "next_model")
        # a strip's line, the heading, and where there is nothing
        for y in (4, 5, 12):
            await pilot.click(offset=(10, y))
        assert here(app) == "103/104"
        assert station.calls == [("next_model",)]


async def test_what_is_finished_says_how_to_go_on():
    done = tuple(accepted(m.left, m.right) for m in MODELS)
    found = status(done, NextStep("adjust", f"anaplot adjust {FOLDER}"), block=view())
    app = console(FakeStation(between(found, finished=True, expected="every model is accepted")))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert stands(app)
        assert " next    adjust the block: anaplot adjust survey" in text(app)
        assert "4 of 4 models accepted" in text(app)


async def test_without_a_status_there_is_no_overview():
    app = console(FakeStation(picture(left="", right="", points=())))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert not stands(app)
        await pilot.press("w")
        assert not stands(app)
