import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.console.braille import Canvas


def test_every_dot_of_a_cell_has_its_braille_bit():
    # Unicode: dots 1-8 are the bits of U+2800 upwards, columns first, the lowest row last.
    expected = {
        (0, 0): "⠁", (0, 1): "⠂", (0, 2): "⠄", (1, 0): "⠈",
        (1, 1): "⠐", (1, 2): "⠠", (0, 3): "⡀", (1, 3): "⢀",
    }  # fmt: skip
    for (x, y), character in expected.items():
        canvas = Canvas(1, 1)
        canvas.plot(x, y, 1)
        assert canvas.text() == character


def test_a_circle_is_as_wide_as_high():
    canvas = Canvas(40, 20)
    t = np.linspace(0.0, 2.0 * np.pi, 2000)
    canvas.plot(40.0 + 30.0 * np.cos(t), 40.0 + 30.0 * np.sin(t), 1)
    y, x = np.nonzero(canvas.dots())
    assert (x.min(), x.max()) == (10, 70)
    assert (y.min(), y.max()) == (10, 70)
    assert len(canvas.text().splitlines()) == 20


def test_a_diagonal_is_made_of_exactly_its_dots():
    canvas = Canvas(2, 1)
    canvas.lines(0, 0, 3, 3, 1)
    assert canvas.text() == "⠑⢄"
    assert np.array_equal(np.argwhere(canvas.dots()), [[0, 0], [1, 1], [2, 2], [3, 3]])


def test_a_heavy_line_is_two_dots_wide_whatever_its_direction():
    level, upright = Canvas(10, 3), Canvas(10, 3)
    level.lines(2, 5, 15, 5, 1, heavy=True)
    upright.lines(5, 1, 5, 9, 1, heavy=True)
    assert set(level.dots().sum(axis=0)) == {0, 2}
    assert set(upright.dots().sum(axis=1)) == {0, 2}


def test_an_arrow_has_its_barbs_at_its_head():
    canvas = Canvas(20, 10)
    canvas.arrow(2, 20, 36, 20, 1)
    heights = canvas.dots().sum(axis=0)
    assert heights[3:28].max() == 2
    assert heights[28:38].max() >= 4
    dotted = Canvas(20, 10)
    dotted.arrow(2, 20, 36, 20, 1, dotted=True)
    gaps = dotted.dots().sum(axis=0)
    assert set(gaps[3:28]) == {0, 2}
    assert np.array_equal(gaps[34:], heights[34:])
    canvas = Canvas(4, 4)
    canvas.arrow(3, 3, 3, 3, 1)
    assert not canvas.dots().any()


def test_the_highest_layer_colours_a_cell_whatever_the_order():
    for layers in ((1, 5), (5, 1)):
        canvas = Canvas(1, 1)
        for i, layer in enumerate(layers):
            canvas.plot(i, 0, layer)
        assert canvas.runs() == [[("⠉", 5)]]


def test_text_covers_dots_and_is_cut_at_the_edges():
    canvas = Canvas(6, 1)
    canvas.lines(0, 1, 11, 1, 1)
    canvas.write(1, 0, "ab", 2)
    canvas.write(5, 0, "xyz", 3)
    canvas.write(-1, 0, "QR", 4)
    canvas.write(0, 7, "below", 9)
    assert canvas.runs() == [[("R", 4), ("ab", 2), ("⠒⠒", 1), ("x", 3)]]


def test_wide_characters_take_two_cells_and_marks_none():
    canvas = Canvas(6, 1)
    canvas.write(0, 0, "点a\u0301b", 1)
    assert canvas.text() == "点ab  "
    canvas = Canvas(3, 1)
    canvas.write(2, 0, "点", 1)
    assert canvas.text() == "   "


def test_room_is_where_nothing_is():
    canvas = Canvas(10, 2)
    canvas.write(0, 0, "abc", 1)
    canvas.plot(14, 1, 1)
    assert canvas.has_room(3, 0, 4)
    assert not canvas.has_room(2, 0, 4)
    assert not canvas.has_room(5, 0, 4)
    assert canvas.has_room(5, 0, 4, over_dots=True)
    assert not canvas.has_room(7, 0, 4, over_dots=True)
    assert not canvas.has_room(0, 2, 1)
    assert not canvas.has_room(-1, 1, 1)


def test_what_is_not_finite_is_left_out():
    canvas = Canvas(4, 4)
    canvas.plot([np.nan, np.inf, 1.0], [1.0, 1.0, np.nan], 1)
    canvas.lines([0.0, np.nan], [0.0, 0.0], [np.inf, 3.0], [3.0, 3.0], 1)
    assert not canvas.dots().any()


@pytest.mark.parametrize(("columns", "rows"), [(0, 0), (0, 3), (5, 0), (-2, 4)])
def test_a_raster_without_cells_takes_anything(columns, rows):
    canvas = Canvas(columns, rows)
    canvas.lines(0, 0, 5, 5, 1)
    canvas.arrow(0, 0, 9, 9, 1)
    canvas.write(0, 0, "abc", 1)
    assert len(canvas.runs()) == max(rows, 0)


finite = st.floats(-1e12, 1e12, allow_nan=False)


@given(st.tuples(finite, finite, finite, finite))
def test_a_far_line_shows_exactly_where_it_crosses(ends):
    x0, y0, x1, y1 = ends
    canvas = Canvas(12, 6)
    canvas.lines(x0, y0, x1, y1, 1)
    y, x = np.nonzero(canvas.dots())
    # Every dot lies within one dot of the line (distance by the cross product).
    length = np.hypot(x1 - x0, y1 - y0)
    if length > 1e-6 and x.size:
        far = np.abs((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) / length
        assert far.max() <= 1.0 + 1e-3


@given(
    st.integers(1, 40),
    st.integers(1, 20),
    st.lists(st.tuples(*[st.floats(-50, 200)] * 4), max_size=30),
)
def test_every_row_is_as_wide_as_the_raster(columns, rows, ends):
    canvas = Canvas(columns, rows)
    for i, (x0, y0, x1, y1) in enumerate(ends):
        canvas.lines(x0, y0, x1, y1, i % 4, heavy=i % 2 == 0)
    drawn = canvas.runs()
    assert [sum(len(text) for text, _ in row) for row in drawn] == [columns] * rows
