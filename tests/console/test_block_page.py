"""The block page and the block's line, over a station made of dataclasses."""

import asyncio
from dataclasses import replace

import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import lines, text, until

from anaplot.console.blockline import block_line
from anaplot.console.blockpage import block_page
from anaplot.console.describe import advice_of
from anaplot.station.blockview import (
    BlockView,
    FlaggedCoordinate,
    SuspectedPoint,
    SuspectedRay,
    percent,
)


def suspect(point="102-3", model="101/102", probability=0.98, newly=True):
    return SuspectedPoint(
        point,
        (
            FlaggedCoordinate("102", model, "x", -26.79, 0.703),
            FlaggedCoordinate("101", "101/102", "x", 13.61, 0.194),
        ),
        (
            SuspectedRay("102", model, probability),
            SuspectedRay("101", "101/102", 1.0 - probability),
        ),
        "102/103",
        newly,
    )


VIEW = BlockView(
    after="102/103",
    models=2,
    provisional=True,
    sigma0=1.876,
    sigma0_um=9.38,
    redundancy=30,
    photos=3,
    points=21,
    rays=52,
    datum="free",
    test="baarda 0.001",
    critical=3.29,
    ri_x=0.159,
    ri_y=0.418,
    suspects=(suspect(), suspect("7", None, 0.6, newly=False)),
)


AT_80_BY_24 = """\
in it         2 models of this session, the newest 102/103, still to be
              accepted
size          3 photos, 21 points, 52 rays
sigma0        1.88 (9.38 µm), redundancy 30
test          baarda 0.001, critical value 3.29
mean RED-N    x 0.16, y 0.42
datum         free: control does not suffice yet
only now      102-3: earlier, and not flagged before

POINT          PHOTO       MODEL            AXIS        W  RED-N
▶ 102-3        102         101/102          x      -26.79  0.703
               101         101/102          x       13.61  0.194
  only now (102/103), wrong: photo 102 (101/102) 98 %, photo 101
  (101/102) 2 %
7              102         elsewhere        x      -26.79  0.703
               101         101/102          x       13.61  0.194
  wrong: photo 102 60 %, photo 101 (101/102) 40 %

One error may flag its neighbours: remeasure the first point, then look
again."""


async def test_the_block_page_at_80_by_24():
    app = console(FakeStation(picture(block_view=VIEW)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("b")
        await until(pilot, lambda: len(app.screen_stack) == 2)
        shown = lines(app)
        assert {cell_len(line) for line in shown} == {80}
        page = [line[3:-4].rstrip() for line in shown]  # without the scrollbar
        assert page[1] == "The block as one bundle   (escape closes)   (m the map)   (W the report)"
        assert page[3:23] == AT_80_BY_24.splitlines()
        # the same key closes it again
        await pilot.press("b")
        await until(pilot, lambda: len(app.screen_stack) == 1)


async def test_the_page_follows_the_block_while_it_is_read():
    station = FakeStation(picture(block_view=replace(VIEW, busy=True)))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("b")
        await until(pilot, lambda: "what was measured since is being adjusted" in text(app))
        done = replace(VIEW, redundancy=31, suspects=(), datum="control", provisional=False)
        station.tell(picture(serial=2, block_view=done))
        await until(pilot, lambda: "No point is flagged." in text(app))
        assert "redundancy 31" in text(app)
        assert "control and priors" in text(app)
        assert "is being adjusted" not in text(app)
        await pilot.press("escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        # closed: the next news is for the key alone
        station.tell(picture(serial=3, block_view=None, expected="later"))
        await until(pilot, lambda: "later" in text(app))
        await pilot.press("b")
        await until(pilot, lambda: "Nothing is in the block yet" in text(app))


async def test_one_line_of_advice_and_the_key():
    app = console(FakeStation(picture(block_view=VIEW)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        shown = lines(app)
        # the model has the first word
        assert shown[18].strip() == "· remeasure 103 (y): 12 to 1 over 102"
        said = "· block: point 102-3 in photo 102 (model 101/102): 98 %, and 1 more"
        assert shown[19].strip() == said
        assert "b Block" in text(app)
        assert {cell_len(line) for line in shown} == {80}


def test_the_line_is_for_points_of_earlier_models_only():
    assert block_line(picture()) == ""
    assert block_line(picture(block_view=replace(VIEW, suspects=()))) == ""
    own = replace(VIEW, suspects=(suspect(model="102/103"),))
    assert block_line(picture(block_view=own)) == ""
    one = picture(block_view=replace(VIEW, suspects=(suspect(model="102/103"), suspect("9"))))
    assert block_line(one) == "block: point 9 in photo 102 (model 101/102): 98 %"
    assert advice_of(one)[1] == block_line(one)
    # rows from elsewhere are earlier than anything
    other = picture(block_view=replace(VIEW, suspects=(suspect(model=None),)))
    assert block_line(other) == "block: point 102-3 in photo 102: 98 %"
    # between two models every model is an earlier one
    between = picture(block_view=own, left="", right="", solution=None, diagnosis=None)
    assert block_line(between) == "block: point 102-3 in photo 102 (model 102/103): 98 %"
    assert advice_of(between) == [block_line(between)]


@pytest.mark.parametrize(
    ("probability", "words"),
    [
        (1.0, "over 99 %"),
        (0.9949, "99 %"),
        (0.5, "50 %"),
        (0.009, "under 1 %"),
        (1e-9, "under 1 %"),
    ],
)
def test_certainty_is_never_claimed(probability, words):
    assert percent(probability) == words


def test_what_the_page_says_without_a_solution():
    def said(view):
        return "\n".join(line.plain for line in block_page(view, 72))

    empty = BlockView("101/102", 1, provisional=False, remark="photo 102 is not determined")
    assert "no solution   photo 102 is not determined" in said(empty)
    assert "POINT" not in said(empty)
    assert "is being adjusted" in said(BlockView("101/102", 1, provisional=True, busy=True))
    assert "rows from elsewhere" in said(replace(VIEW, after="", models=0, provisional=False))
    none = replace(VIEW, sigma0=None, sigma0_um=None, critical=None, redundancy=0)
    assert "none: no redundancy" in said(none)
    assert "critical value none" in said(none)
    assert "photos 103, 104" in said(replace(VIEW, aside=("103", "104")))
    many = replace(VIEW, suspects=tuple(suspect(f"p{i}") for i in range(130)))
    assert "and 30 more points" in said(many)


HOSTILE = ("[red]x[/]", "[/", "\x1b[2J", "a\nb", "\u202eevil", "x" * 500)


@pytest.mark.parametrize("name", HOSTILE)
async def test_foreign_names_are_shown_as_they_are(name):
    point = SuspectedPoint(
        name,
        (FlaggedCoordinate(name, name, "y", 5.0, 0.5),),
        (SuspectedRay(name, name, 0.7),),
        name,
        True,
    )
    view = replace(VIEW, after=name, suspects=(point,), aside=(name,), remark=name)
    app = console(FakeStation(picture(block_view=view)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("b")
        await until(pilot, lambda: len(app.screen_stack) == 2)
        for _ in range(4):
            assert {cell_len(line) for line in lines(app)} == {80}
            assert not any(c in text(app) for c in ("\x1b", "\u202e", "\x00"))
            await pilot.press("pagedown")
        await pilot.press("escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        assert not any(c in text(app) for c in ("\x1b", "\u202e"))


async def test_the_cursor_stays_on_its_point_when_the_rows_change():
    held = replace(VIEW, suspects=(suspect(), suspect("102-9"), suspect("7", None, 0.6)))
    station = FakeStation(picture(block_view=held))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("b", "down")
        await until(pilot, lambda: "▶ 102-9" in text(app))
        fewer = replace(held, suspects=(*held.suspects[1:], suspect("8")))
        station.tell(picture(serial=2, block_view=fewer))
        await until(pilot, lambda: "102-3" not in text(app))
        assert "▶ 102-9" in text(app)
        station.tell(
            picture(serial=3, block_view=replace(held, suspects=(suspect(), suspect("8"))))
        )
        await until(pilot, lambda: "▶ 102-3" in text(app))


async def test_enter_on_a_line_returns_to_its_model():
    held = replace(VIEW, suspects=(suspect(), suspect("102-9"), suspect("7", None, 0.6)))
    station = FakeStation(picture(block_view=held, accepted=(("101", "102"),)))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("b")
        await until(pilot, lambda: "▶ 102-3" in text(app))
        await pilot.press("down")
        await until(pilot, lambda: "▶ 102-9" in text(app))
        assert "▶ 102-3" not in text(app)
        await pilot.press("enter")
        await asyncio.to_thread(station.wait_for, "return_to", "101", "102", "102-9", "102")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        # where nobody knows the model, Enter closes the page
        await pilot.press("b", "down", "down", "down")
        await until(pilot, lambda: "▶ 7 " in text(app))
        await pilot.press("enter")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        assert [call[0] for call in station.calls] == ["return_to"]
