from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from svgs import SVG, boxes, paths, runs, sound, texts

from anaplot.drawing.charts.bars import MOST_BARS, bars
from anaplot.drawing.charts.histogram import histogram
from anaplot.drawing.charts.matrix import LARGEST, correlation_matrix
from anaplot.drawing.charts.quantileplot import quantile_plot, shown_ranks
from anaplot.drawing.classes import classes_of
from anaplot.drawing.element import shortened
from anaplot.drawing.frame import equal_frame, free_frame
from anaplot.drawing.labels import placed
from anaplot.drawing.legend import Entry
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.textwidth import text_width
from anaplot.drawing.thinning import thinned

HEAD = Head("one", "One & only", "3 of them.")


def test_bars_of_a_histogram_are_as_high_as_their_counts() -> None:
    edges = np.array([-4.0, -2.0, 0.0, 2.0, 4.0])
    drawing = histogram(HEAD, [1, 4, 3, 2], edges, "10 values", x_title="w", bounds=(-2.0, 2.0))
    root = sound(drawing)
    (d,) = paths(root, "gap")
    found = runs(d)
    heights = np.array([np.ptp(one[:, 1]) for one in found])
    assert heights / heights[0] == pytest.approx([1.0, 4.0, 3.0, 2.0], abs=0.02)
    assert all(one[0, 1] == found[0][0, 1] for one in found)  # all stand on one line
    assert len(paths(root, "thin")) == 3  # the two outer bars, and the legend
    assert {"−2.00", "2.00"} <= set(texts(root))


def test_quantiles_are_drawn_where_they_are() -> None:
    x = np.linspace(-2.0, 2.0, 9)
    marked = np.zeros(9, dtype=bool)
    marked[-1] = True
    drawing = quantile_plot(
        HEAD, x, 2.0 * x, "9 values", x_title="x", y_title="y", marked=marked, marked_label="far"
    )
    root = sound(drawing)
    (dots,) = (d for d in paths(root, "dot") if d.count("M") > 1)
    at = np.array([one[0] for one in runs(dots)])
    assert len(at) == 8
    steps = np.diff(at, axis=0)
    assert np.ptp(steps[:, 0]) < 0.21
    assert np.ptp(steps[:, 1]) < 0.21
    assert (steps[:, 0] > 0).all()
    assert (steps[:, 1] < 0).all()  # up
    assert "far" in texts(root)


@given(st.integers(0, 5000), st.integers(8, 600))
def test_ranks_at_both_ends_are_shown(n: int, most: int) -> None:
    found = shown_ranks(n, most)
    assert len(found) <= most
    assert (np.diff(found) > 0).all()
    if n > most:
        end = most // 4
        assert set(range(end)) | set(range(n - end, n)) <= set(found.tolist())


def test_a_matrix_writes_its_lower_triangle() -> None:
    rho = np.array([[1.0, 0.2, -0.95], [0.2, 1.0, np.nan], [-0.95, np.nan, 1.0]])
    root = sound(correlation_matrix(HEAD, ["a", "b", "<c>"], rho, "3 rows"))
    shown = texts(root)
    assert "0.20" in shown
    assert "−0.95" in shown
    assert "·" in shown
    assert shown.count("<c>") == 2
    strong = [one.text for one in root.iter(f"{SVG}text") if "t-strong" in one.get("class", "")]
    assert "−0.95" in strong
    tinted = [one for one in root.iter(f"{SVG}rect") if "f-minus-3" in one.get("class", "")]
    assert len(tinted) == 2  # the cell and the legend


def test_a_large_matrix_writes_signs() -> None:
    n = 40
    rho = np.eye(n)
    rho[5, 2], rho[9, 3] = 0.7, -0.4
    root = sound(correlation_matrix(HEAD, [f"p{k}" for k in range(n)], rho, "40 rows"))
    assert texts(root).count("+") == 1
    assert texts(root).count("−") == 1
    with pytest.raises(ValueError, match="not drawn"):
        correlation_matrix(HEAD, ["x"] * (LARGEST + 1), np.eye(LARGEST + 1), "61 rows")


def test_bars_are_as_long_as_their_numbers() -> None:
    values = np.array([1.0, -0.5, 2.0])
    drawing = bars(
        HEAD,
        ["a", "b", "c" * 300],
        values,
        "3 bars",
        x_title="m",
        what="one",
        marked=np.array([False, True, False]),
        marked_label="look",
    )
    root = sound(drawing)
    drawn = [one for one in root.iter(f"{SVG}rect") if one.get("class") == "f-series-1"][:3]
    wide = np.array([float(one.get("width", "0")) for one in drawn])
    assert wide / wide[0] == pytest.approx(np.abs(values), abs=0.01)
    left = [float(one.get("x", "0")) for one in drawn]
    assert left[1] + wide[1] == pytest.approx(left[0], abs=0.2)
    assert {"1.00", "−0.50", "2.00"} <= set(texts(root))
    assert any("…" in one for one in texts(root))
    for count in (0, MOST_BARS + 1):
        with pytest.raises(ValueError, match="not drawn"):
            bars(HEAD, ["x"] * count, np.ones(count), "none", x_title="m", what="one")


@given(
    st.lists(st.floats(-1e6, 1e6).map(lambda v: round(v, 4)), min_size=1, max_size=60),
    st.integers(1, 5),
)
def test_every_value_has_one_class(values: list[float], count: int) -> None:
    of = np.array(values)
    found = classes_of(of, "m", count)
    k = found.of(of)
    assert list(found.limits) == sorted(set(found.limits))
    assert len(found.labels) == len(found.limits) + 1 <= count
    assert ((k >= 0) & (k < len(found.labels))).all()
    order = np.argsort(of)
    assert (np.diff(k[order]) >= 0).all()
    steps = [found.step(one) for one in range(len(found.labels))]
    assert steps == sorted(set(steps))
    assert steps[0] >= 1
    assert steps[-1] <= 5


@given(st.integers(0, 400), st.integers(1, 100), st.integers(0, 30), st.integers(0, 2**32 - 1))
def test_thinning_keeps_what_matters(n: int, most: int, important: int, seed: int) -> None:
    at = np.random.default_rng(seed).normal(size=(n, 2))
    first = np.zeros(n, dtype=bool)
    first[: min(important, n)] = True
    found = thinned(at, most, first)
    assert len(found) <= most
    assert (np.diff(found) > 0).all()
    if n <= most:
        assert len(found) == n
    assert set(np.flatnonzero(first)[:most].tolist()) <= set(found.tolist())


def test_thinning_leaves_no_part_of_a_map_empty() -> None:
    x, y = np.meshgrid(np.arange(100.0), np.arange(50.0))
    at = np.stack((x.ravel(), y.ravel()), axis=1)
    found = at[thinned(at, 200)]
    assert 150 <= len(found) <= 200
    for low in range(0, 100, 20):
        assert ((found[:, 0] >= low) & (found[:, 0] < low + 20)).sum() >= 20


@pytest.mark.parametrize("origin", [0.0, 5.4e6])
def test_an_equal_frame_is_to_scale_and_holds_its_points(origin: float) -> None:
    points = np.array([[0.0, 0.0], [30.0, 8.0], [2.0, 9.0]]) + origin
    frame = equal_frame(50.0, points)
    assert frame.scale[0] == pytest.approx(frame.scale[1], rel=1e-9)
    x, y = frame.places(points).T
    assert ((x >= frame.left) & (x <= frame.right)).all()
    assert ((y >= frame.top) & (y <= frame.bottom)).all()
    places = frame.places(points)
    assert np.hypot(*(places[1] - places[0])) == pytest.approx(
        frame.scale[0] * np.hypot(30.0, 8.0), rel=1e-6
    )
    assert places[2, 1] < places[0, 1]


@pytest.mark.parametrize("points", [np.empty((0, 2)), np.array([[3.0, 4.0]]), np.full((5, 2), 1e7)])
def test_frames_of_nothing_and_of_one_place(points: np.ndarray) -> None:
    frame = equal_frame(50.0, points)
    plot = Plot(HEAD, frame)
    plot.axes("X [m]", "Y [m]")
    plot.marks("circle", points, "f-ink")
    sound(plot.drawing("0 or 1 point"))
    other = free_frame(50.0, (5.0, 5.0), (0.0, 0.0))
    assert other.x[0] < 5.0 < other.x[1]


@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_no_name_covers_another_or_a_mark(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    frame = equal_frame(50.0, np.array([[0.0, 0.0], [500.0, 300.0]]))
    at = random.uniform((frame.left, frame.top), (frame.right, frame.bottom), (n, 2))
    sizes = random.uniform(8.0, 60.0, (n, 2)) * [1.0, 0.3]
    found = placed(frame, at, sizes, most=80)
    taken = [(p.x, p.y, p.x + sizes[p.which, 0], p.y + sizes[p.which, 1]) for p in found]
    for k, one in enumerate(taken):
        assert frame.left <= one[0]
        assert one[2] <= frame.right
        assert not any(one[0] < x < one[2] and one[1] < y < one[3] for x, y in at)
        for other in taken[:k]:
            apart = (
                one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
            )
            assert apart
    if n == 1:
        assert len(found) == 1


def test_arrows_and_ellipses_are_exaggerated_as_said() -> None:
    points = np.array([[0.0, 0.0], [100.0, 50.0]])
    plot = Plot(HEAD, equal_frame(50.0, points))
    plot.arrows(points[:1], np.array([[0.01, 0.02]]), 1000.0, "l-series-1")
    plot.ellipses(points[:1], np.diag([4e-4, 1e-4])[None], 500.0, "l-series-2")
    root = sound(plot.drawing("1 arrow"))
    scale = plot.frame.scale[0]
    (d,) = paths(root, "l-series-1")
    shaft = runs(d)[0]
    assert shaft[0] == pytest.approx(plot.frame.places(points[:1])[0], abs=0.06)
    assert shaft[1] - shaft[0] == pytest.approx([10.0 * scale, -20.0 * scale], abs=0.11)
    (d,) = paths(root, "l-series-2")
    axes = re.findall(r"a(\S+?) (\S+?) ", d)[0]
    assert [float(one) for one in axes] == pytest.approx([10.0 * scale, 5.0 * scale], abs=0.06)


def test_an_ellipse_of_x_and_y_that_grow_together_rises_to_the_right() -> None:
    plot = Plot(HEAD, equal_frame(50.0, np.array([[0.0, 0.0], [100.0, 50.0]])))
    together = np.array([[[4.0, 3.0], [3.0, 4.0]]])
    plot.ellipses(np.array([[50.0, 25.0]]), together, 1.0, "l-series-2")
    (d,) = paths(sound(plot.drawing("1 ellipse")), "l-series-2")
    degrees = float(re.findall(r"a\S+? \S+? (\S+?) ", d)[0])
    assert degrees % 180.0 == pytest.approx(135.0, abs=0.1)  # y is down


def test_an_arrow_that_leaves_the_frame_ends_at_its_side_without_a_head() -> None:
    points = np.array([[0.0, 0.0], [100.0, 50.0]])
    plot = Plot(HEAD, equal_frame(50.0, points))
    vectors = np.array([[3.0, 0.0], [3000.0, 1000.0], [0.0, 0.0]])
    cut = plot.arrows(np.array([[50.0, 25.0]] * 3), vectors, 1.0, "l-series-1")
    assert cut == 1
    (d,) = paths(sound(plot.drawing("3 arrows")), "l-series-1")
    begun = plot.frame.places(np.array([50.0, 25.0]))
    lines = [one for one in runs(d) if one[0] == pytest.approx(begun, abs=0.06)]
    ends = np.array([one[-1] for one in lines])
    frame = plot.frame
    assert (ends >= [frame.left - 0.1, frame.top - 0.1]).all()
    assert (ends <= [frame.right + 0.1, frame.bottom + 0.1]).all()
    long = max(lines, key=lambda one: np.hypot(*(one[-1] - one[0])))
    step = (long[-1] - long[0]) * [1, -1]
    assert step[0] / step[1] == pytest.approx(3.0, rel=0.01)
    heads = [one for one in runs(d) if len(one) == 3]
    assert len(heads) == 1


@pytest.mark.parametrize("origin", [0.0, 5.4e6, -3.2e7])
@pytest.mark.parametrize("size", [0.003, 7.0, 2600.0])
def test_numbers_of_an_axis_stand_apart(origin: float, size: float) -> None:
    plot = Plot(HEAD, equal_frame(50.0, np.array([[0.0, 0.0], [size, size / 3]]) + origin))
    plot.axes("X [m]", "Y [m]")
    root = sound(plot.drawing("no points: 0"))
    below = [
        (float(one.get("x", "0")), text_width(one.text or "", 10.5))
        for one in root.iter(f"{SVG}text")
        if one.get("class") == "t-soft t-small t-mid"
    ]
    assert len(below) >= 2
    for (a, wide), (b, other) in pairwise(below):
        assert b - a > (wide + other) / 2 + 5.0


@pytest.mark.parametrize("n", [1, 2, 6, 22, 40, LARGEST])
@pytest.mark.parametrize("name", ["b", "a long name of a parameter"])
def test_names_of_a_matrix_stand_beside_its_cells(n: int, name: str) -> None:
    names = [f"{name} {k}" for k in range(n)]
    root = sound(correlation_matrix(HEAD, names, np.full((n, n), 0.95), f"{n} rows"))
    cells = [
        [float(one.get(side, "0")) for side in ("x", "y", "width", "height")]
        for one in root.iter(f"{SVG}rect")
        if "gap" in (one.get("class") or "")
    ]
    left = min(x for x, _, _, _ in cells)
    below = max(y + high for _, y, _, high in cells)
    assert all(width >= 5.0 for _, _, width, _ in cells)
    found = zip(boxes(root), texts(root), strict=True)
    of_names = [box for box, shown in found if shown in {shortened(each, 18) for each in names}]
    assert len(of_names) == 2 * n
    for low_x, low_y, high_x, _ in of_names:
        assert high_x <= left or low_y >= below - 1.0
        assert low_x >= 0.0


def test_no_name_covers_one_that_was_added_before() -> None:
    at = np.array([[x, y] for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0)])
    plot = Plot(HEAD, equal_frame(HEAD.bottom, np.array([[-0.5, -0.5], [2.5, 1.5]])))
    assert plot.names(at, [f"point {k}" for k in range(6)]) == []
    # photos over the same places, as over a standard point
    assert plot.names(at, [f"photo {k}" for k in range(6)], "t-soft", gap=4.0) == []
    root = sound(plot.drawing("12 names"))
    named = zip(boxes(root), texts(root), strict=True)
    found = [box for box, shown in named if shown.startswith(("point", "photo"))]
    assert len(found) == 12
    for k, (left, upper, right, lower) in enumerate(found):
        for other in found[k + 1 :]:
            beside = right <= other[0] or other[2] <= left
            assert beside or lower <= other[1] + 3.0 or other[3] <= upper + 3.0


@pytest.mark.parametrize("name", ["P" * 90, "i" * 90, "m" * 20, "short"])
def test_a_title_stays_in_its_drawing(name: str) -> None:
    head = Head("one", f"Residuals of photo {name}", "")
    plot = Plot(head, equal_frame(head.bottom, np.array([[0.0, 0.0], [2.0, 1.0]])))
    root = sound(plot.drawing("1 photo"))
    [(box, shown)] = [
        found for found in zip(boxes(root), texts(root), strict=True) if "Residuals" in found[1]
    ]
    assert box[2] <= 640.0 - 16.0
    assert (shown == head.title) == (name == "short" or name.startswith("m"))


def test_no_text_of_a_legend_covers_another() -> None:
    entries = [Entry("mark", f"{'wide ' * (k % 5)}entry {k}", "f-ink", "square") for k in range(12)]
    plot = Plot(HEAD, equal_frame(HEAD.bottom, np.array([[0.0, 0.0], [2.0, 1.0]])))
    plot.axes("X [m]", "Y [m]")
    plot.explain(*entries, Entry("arrow", "10 um", "line l-ink", length=70.0))
    plot.note("A note. " * 30)
    root = sound(plot.drawing("13 entries"))
    found = boxes(root)
    for k, one in enumerate(found):
        for other in found[:k]:
            assert (
                one[2] <= other[0] + 0.5
                or other[2] <= one[0] + 0.5
                or one[3] <= other[1] + 0.5
                or other[3] <= one[1] + 0.5
            )
