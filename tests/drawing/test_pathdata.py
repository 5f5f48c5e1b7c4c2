"""Path data is read back."""

from __future__ import annotations

import re
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from svgs import runs

from anaplot.drawing import pathdata

places = arrays(float, st.tuples(st.integers(1, 12), st.just(2)), elements=st.floats(-900.0, 900.0))


@given(places, st.data())
def test_segments_lead_from_place_to_place(start: np.ndarray, data: st.DataObject) -> None:
    end = start + data.draw(arrays(float, start.shape, elements=st.floats(-50.0, 50.0)))
    found = runs(pathdata.segments(start, end))
    assert len(found) == len(start)
    for one, a, b in zip(found, start, end, strict=True):
        assert one[0] == pytest.approx(a, abs=0.0501)
        assert one[-1] == pytest.approx(b, abs=0.0502)


@given(places)
def test_a_line_does_not_drift(at: np.ndarray) -> None:
    (found,) = runs(pathdata.polyline(at))
    assert found == pytest.approx(at, abs=0.0502)


@given(places)
def test_dots_are_where_they_belong(at: np.ndarray) -> None:
    found = np.array([one[0] for one in runs(pathdata.dots(at))])
    assert found == pytest.approx(at, abs=0.0501)


def test_polygons_have_their_corners() -> None:
    corners = np.array([[[0.04, 0.0], [10.26, 0.0], [10.0, 5.5]], [[1, 1], [2, 1], [2, -2.0]]])
    found = np.array(runs(pathdata.polygons(corners)))
    assert found == pytest.approx(corners, abs=0.0502)


def test_an_arrow_ends_at_its_tip_with_barbs_behind_it() -> None:
    start, end = np.array([[10.0, 20.0]]), np.array([[40.0, 60.0]])
    shaft, head = runs(pathdata.arrows(start, end))
    assert shaft.tolist() == [[10.0, 20.0], [40.0, 60.0]]
    assert head[1].tolist() == [40.0, 60.0]
    along = (end - start)[0] / 50.0
    for barb in (head[0], head[2]):
        back = barb - end[0]
        assert back @ along == pytest.approx(-4.5, abs=0.1)
    assert (head[0] + head[2]) / 2 == pytest.approx(end[0] - 4.5 * along, abs=0.1)


def test_a_short_arrow_has_no_head() -> None:
    found = runs(pathdata.arrows(np.array([[1.0, 1.0]]), np.array([[2.0, 1.0]])))
    assert [one.tolist() for one in found] == [[[1.0, 1.0], [2.0, 1.0]]]


@pytest.mark.parametrize("shape", get_args(pathdata.Shape))
def test_marks_stand_in_their_middle(shape: pathdata.Shape) -> None:
    d = pathdata.marks(shape, np.array([[100.0, 50.0]]), 5.0)
    if shape == "circle":
        assert d == "M95 50a5 5 0 1 0 10 0a5 5 0 1 0-10 0z"
        return
    corners = np.vstack(runs(d))
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    assert middle == pytest.approx([100.0, 50.0], abs=1.1)  # a triangle's foot is nearer
    # the same at the left and at the right
    mirrored = {(round(200.0 - x, 1), round(y, 1)) for x, y in corners.tolist()}
    assert mirrored == {(round(x, 1), round(y, 1)) for x, y in corners.tolist()}
    assert np.ptp(corners, axis=0).max() < 14


@given(
    arrays(float, (2, 2), elements=st.floats(-9.0, 9.0)),
    st.floats(-200.0, 200.0),
    st.floats(-200.0, 200.0),
)
def test_half_axes_are_the_roots_of_the_eigenvalues(root: np.ndarray, x: float, y: float) -> None:
    covariance = root @ root.T + np.eye(2)
    d = pathdata.ellipses(np.array([[x, y]]), covariance[None])
    numbers = [float(one) for one in re.findall(r"-?\d*\.?\d+", d)]
    begin, (a, b, degrees), step = numbers[:2], numbers[2:5], numbers[7:9]
    values = np.linalg.eigvalsh(covariance)
    assert a == pytest.approx(np.sqrt(values[1]), abs=0.0501)
    assert b == pytest.approx(np.sqrt(values[0]), abs=0.0501)
    # it begins at one end of the longer axis and turns at the other
    assert np.hypot(*step) == pytest.approx(2 * a, abs=0.3)
    assert np.array(begin) + np.array(step) / 2 == pytest.approx([x, y], abs=0.2)
    if values[1] > 1.5 * values[0]:
        along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        assert along @ covariance @ along == pytest.approx(values[1], rel=0.01)


def test_what_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        pathdata.dots(np.array([[np.nan, 1.0]]))


def test_2400_vectors_are_short() -> None:
    random = np.random.default_rng(1)
    start = random.uniform(50, 700, (2400, 2))
    d = pathdata.arrows(start, start + random.normal(0, 12, (2400, 2)))
    assert len(d) < 110_000
    assert len(runs(d)) > 4000
