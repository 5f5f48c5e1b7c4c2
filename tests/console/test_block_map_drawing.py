"""The block's map in cells, as drawn from a map made of arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from consolefake import FakeStation, console, picture
from rich.cells import cell_len
from screenreading import lines, text, until

from anaplot.bundle.blockmap import BlockMap
from anaplot.console.blockmapdrawing import BlockLayer, draw_block_map
from anaplot.station.blockview import BlockView

EAST, NORTH = 4_500_000.0, 5_400_000.0  # as in national systems


def made(places, *, r=0.7, kinds=None, flagged=(), ellipse=(0.0, 0.0, 0.0), names=None):
    """A map of points at places [m] beside the origin, over two photos."""
    count = len(places)
    return BlockMap(
        photos=("101", "102"),
        centres=np.array([(EAST + 200.0, NORTH + 500.0), (EAST + 800.0, NORTH + 500.0)]),
        strips=((0, 1),),
        points=tuple(names or (f"p{k}" for k in range(count))),
        places=np.array(places, dtype=float).reshape(-1, 2) + np.array((EAST, NORTH)),
        kinds=tuple(kinds or ("tie",) * count),
        r=np.broadcast_to(np.asarray(r, dtype=float), (count,)),
        flagged=np.array([k in flagged for k in range(count)], dtype=bool),
        ellipses=np.broadcast_to(np.asarray(ellipse, dtype=float), (count, 3)),
    )


SQUARE = ((0.0, 0.0), (1000.0, 0.0), (0.0, 1000.0), (1000.0, 1000.0))


def at(canvas, sign: str) -> list[tuple[int, int]]:
    """Column and row of every sign above the legend."""
    rows = canvas.text().splitlines()[:-2]
    return [(x, y) for y, row in enumerate(rows) for x, c in enumerate(row) if c == sign]


def test_signs_say_how_well_points_are_checked() -> None:
    assert len(at(draw_block_map(made(SQUARE, r=0.59), 60, 24), "◐")) == 4
    block = made(SQUARE, r=(0.6, 0.29, 0.09, np.nan), names="abcd")
    canvas = draw_block_map(block, 60, 24)
    (good,), (weak,) = at(canvas, "●"), at(canvas, "○")
    unchecked = at(canvas, "?")
    # north is up, east to the right
    assert good[1] == weak[1]
    assert good[0] < weak[0]
    assert [p[1] < good[1] for p in unchecked] == [True, True]
    assert sorted(p[0] for p in unchecked) == [good[0], weak[0]]
    assert len(at(canvas, "+")) == 2
    assert "a" in canvas.text()


def test_control_and_flags_are_told_apart_without_colour() -> None:
    block = made(SQUARE, kinds=("control", "check", "tie", "control"), flagged=(2, 3))
    canvas = draw_block_map(block, 72, 24)
    assert [len(at(canvas, sign)) for sign in "▲□!●"] == [1, 1, 2, 0]
    legend = canvas.text().splitlines()[-1]
    assert all(words in legend for words in ("! flagged", "▲ control", "□ check", "+ photo"))
    assert "check" not in draw_block_map(made(SQUARE), 60, 24).text()


def test_of_several_in_a_cell_the_worst_is_seen() -> None:
    places = (*SQUARE, *[(500.0, 200.0)] * 4)
    for worst, sign in ((4, "!"), (6, "!")):
        block = made(places, r=(*[0.9] * 7, 0.0), flagged=(worst,))
        assert len(at(draw_block_map(block, 60, 24), sign)) == 1
    assert len(at(draw_block_map(made(places, r=(*[0.9] * 7, 0.0)), 60, 24), "?")) == 1


@pytest.mark.parametrize("direction", [0.0, 0.6, np.pi / 2, -0.6])
def test_ellipses_have_the_size_and_the_direction_that_the_legend_states(direction) -> None:
    a, b = 0.08, 0.03
    # one point: its ellipse is the only line on the paper
    block = replace(made([(500.0, 500.0)], ellipse=(a, b, direction)), strips=())
    canvas = draw_block_map(block, 110, 50)
    words = canvas.text().splitlines()[-2]
    bar = float(words.split(" m in ellipses")[0].split()[-1])
    rows = canvas.dots()[: 4 * (canvas.rows - 2)]
    y, x = np.nonzero(rows)
    assert len(x) > 20
    off = np.stack([x - x.mean(), -(y - y.mean())]) * (bar / 10.0)  # m
    along = off[0] * np.cos(direction) + off[1] * np.sin(direction)
    across = off[1] * np.cos(direction) - off[0] * np.sin(direction)
    # every dot is on the curve, as far as dots can be, and the curve is drawn all around
    nearest = np.abs(np.hypot(along / a, across / b) - 1.0) * b / (bar / 10.0)
    assert nearest.max() < 1.5
    assert np.abs(along).max() == pytest.approx(a, abs=1.5 * bar / 10.0)
    assert along.min() < -0.7 * a
    assert along.max() > 0.7 * a


def test_where_points_are_many_ellipses_do_not_cover_one_another() -> None:
    random = np.random.default_rng(3)
    places = random.uniform(0.0, 1000.0, (3000, 2))
    block = made(places, r=random.uniform(0.0, 1.0, 3000), ellipse=(0.1, 0.1, 0.0))
    canvas = draw_block_map(block, 100, 40)
    assert "the largest of each patch" in canvas.text()
    words = next(line for line in canvas.text().splitlines() if "in ellipses" in line)
    metres = float(words.split(" m in ellipses")[0].split()[-1]) / 10.0
    assert 3.0 <= 0.1 / metres <= 6.0  # dots: half a patch
    # one that is large hides that all others are small
    ellipses = np.full((3000, 3), 0.001)
    ellipses[1234] = 1.0, 1.0, 0.0
    one = draw_block_map(replace(block, ellipses=ellipses, strips=()), 100, 40)
    drawn = [run for row in one.runs() for run in row if run[1] == BlockLayer.ELLIPSE]
    assert 0 < sum(len(text) for text, _ in drawn) < 40
    assert "the largest" not in draw_block_map(made(SQUARE, ellipse=(1, 1, 0)), 100, 40).text()


def test_what_lies_far_off_is_counted_and_does_not_shrink_the_rest() -> None:
    inner = [(100.0 * i, 100.0 * j) for i in range(11) for j in range(11)]
    calm = draw_block_map(made(inner), 80, 30)
    far = draw_block_map(made([*inner, (1e7, 0.0), (np.nan, 0.0)]), 80, 30)
    assert at(far, "●") == at(calm, "●")
    assert "2 beyond" in far.text()
    assert "beyond" not in calm.text()


@pytest.mark.parametrize("size", [(0, 0), (1, 1), (5, 3), (20, 7), (72, 18), (300, 80)])
@pytest.mark.parametrize("places", [[], [(0.0, 0.0)], SQUARE, [(np.nan, np.nan)]])
def test_any_block_fits_any_paper(size, places) -> None:
    canvas = draw_block_map(made(places, ellipse=(np.nan,) * 3), *size)
    assert [cell_len(line) for line in canvas.text().splitlines()] == [size[0]] * size[1]


@pytest.mark.parametrize("name", ["[red]x[/]", "\x1b[2J", "a\nb", "\u202eevil", "x" * 500, "漢字"])
def test_foreign_names_are_cut_and_harmless(name) -> None:
    canvas = draw_block_map(made(SQUARE, names=(name, "b", "c", "d")), 72, 18, selected=name)
    assert {cell_len(line) for line in canvas.text().splitlines()} == {72}
    assert not any(c in canvas.text() for c in "\x1b\u202e")
    runs = [run for row in canvas.runs() for run in row]
    assert any(layer == BlockLayer.SELECTED for _, layer in runs)


VIEW = BlockView("101/102", 1, False, datum="free", sigma0=1.0, sigma0_um=5.0, photos=2, points=4)


@pytest.mark.parametrize(("size", "at_once"), [((80, 24), False), ((160, 50), True)])
async def test_the_page_shows_the_map(size, at_once) -> None:
    view = replace(VIEW, block_map=made(SQUARE, names=("north", "b", "c", "d")))
    station = FakeStation(picture(block_view=view))
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.press("b")
        await until(pilot, lambda: len(app.screen_stack) == 2 and "datum" in text(app))
        await until(pilot, lambda: ("+ photo" in text(app)) == at_once)
        await pilot.press("m")
        await until(pilot, lambda: "+ photo" in text(app) and "datum" not in text(app))
        assert {cell_len(line) for line in lines(app)} == {size[0]}
        assert "north" in text(app)
        # a new answer of the block is drawn at once
        other = replace(view, block_map=made(SQUARE, names=("south", "b", "c", "d")))
        station.tell(picture(serial=2, block_view=other))
        await until(pilot, lambda: "south" in text(app) and "north" not in text(app))
        # without a solution there is no map, and the page says why
        none = BlockView("101/102", 1, False, remark="photo 102 is not determined")
        station.tell(picture(serial=3, block_view=none))
        await until(pilot, lambda: "photo 102 is not determined" in text(app))
        assert "+ photo" not in text(app)
