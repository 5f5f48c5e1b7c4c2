"""The lens function: COLMAP's OPENCV model with y up, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.photogrammetry.lens import (
    LENS_PARAMETERS,
    lens_fold,
    lens_places,
    through_lens,
    without_lens,
)

PARAMETERS = np.array([52.0, 0.3, -0.2, -0.05, 0.02, -0.004, 1.5e-3, -8e-4, 2e-3, -1e-3])


def directions(n: int = 40) -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.6, 0.6, (n, 2))


def test_without_distortion_it_is_the_camera_constant() -> None:
    parameters = np.array([100.0, 1.0, 2.0, *[0.0] * 7])
    np.testing.assert_allclose(
        through_lens(directions(), parameters).xy, 100.0 * directions() + [1.0, 2.0]
    )


def test_it_is_the_opencv_model_seen_upside_down() -> None:
    c, x0, y0, k1, k2, _, p1, p2, _, _ = PARAMETERS
    parameters = PARAMETERS.copy()
    parameters[[5, 8, 9]] = 0.0
    direction = directions()
    # COLMAP, src/colmap/sensor/models.h, OpenCVCameraModel: u, v with v down
    u, v = direction[:, 0], -direction[:, 1]
    radial = k1 * (u * u + v * v) + k2 * (u * u + v * v) ** 2
    du = u * radial + 2.0 * p1 * u * v + p2 * (u * u + v * v + 2.0 * u * u)
    dv = v * radial + 2.0 * p2 * u * v + p1 * (u * u + v * v + 2.0 * v * v)
    xy = through_lens(direction, parameters).xy
    np.testing.assert_allclose(xy[:, 0], x0 + c * (u + du), rtol=1e-13)
    np.testing.assert_allclose(xy[:, 1], y0 - c * (v + dv), rtol=1e-13)


def test_affinity_and_shear_move_x_alone() -> None:
    plain, bent = np.zeros(10), np.zeros(10)
    plain[0] = bent[0] = 50.0
    bent[8:] = 1e-3, 2e-3
    d = directions()
    moved = through_lens(d, bent).xy - through_lens(d, plain).xy
    np.testing.assert_allclose(moved[:, 0], 50.0 * (1e-3 * d[:, 0] + 2e-3 * d[:, 1]), atol=1e-14)
    np.testing.assert_array_equal(moved[:, 1], 0.0)


@pytest.mark.parametrize("k", range(10))
def test_derivatives_by_parameters(k: int) -> None:
    step = np.zeros(10)
    step[k] = 1e-5
    d = directions()
    ends = [through_lens(d, PARAMETERS + sign * step).xy for sign in (1.0, -1.0)]
    analytic = through_lens(d, PARAMETERS).by_parameter[:, :, k]
    np.testing.assert_allclose((ends[0] - ends[1]) / 2e-5, analytic, rtol=1e-6, atol=1e-8)
    assert len(LENS_PARAMETERS) == 10


@pytest.mark.parametrize("axis", range(2))
def test_derivatives_by_the_direction(axis: int) -> None:
    step = 1e-5 * np.eye(2)[axis]
    d = directions()
    ends = [through_lens(d + sign * step, PARAMETERS).xy for sign in (1.0, -1.0)]
    analytic = through_lens(d, PARAMETERS).by_direction[:, :, axis]
    np.testing.assert_allclose((ends[0] - ends[1]) / 2e-5, analytic, rtol=1e-7, atol=1e-7)


def test_affinity_and_shear_are_of_the_distorted_image() -> None:
    # as f_x = c (1 + b1) of COLMAP's OPENCV multiplies what the lens has distorted
    square = PARAMETERS.copy()
    square[8:] = 0.0
    x, y = (through_lens(directions(), square).xy - square[1:3]).T
    b1, b2 = PARAMETERS[8:]
    xy = through_lens(directions(), PARAMETERS).xy - PARAMETERS[1:3]
    np.testing.assert_allclose(xy[:, 0], x + b1 * x + b2 * y, rtol=1e-13)
    np.testing.assert_allclose(xy[:, 1], y, rtol=1e-13)


@pytest.mark.parametrize(
    "lens",
    [
        PARAMETERS,
        np.array([52.0, 0.3, -0.2, *[0.0] * 7]),
        np.array([24.0, 0.0, 0.0, -0.35, 0.15, -0.03, 1e-3, 2e-3, 1e-3, 0.0]),
        np.array([24.0, 0.0, 0.0, 0.8, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_the_lens_is_taken_off_exactly(lens: np.ndarray) -> None:
    direction = np.vstack((directions(500), [[0.0, 0.0], [1e-9, 0.0]]))
    back = without_lens(through_lens(direction, lens).xy, lens)
    np.testing.assert_allclose(back, direction, atol=1e-13)


def test_places_alone_are_those_that_come_with_derivatives() -> None:
    of_each = PARAMETERS * np.linspace(0.9, 1.1, 40)[:, None]
    for lens in (PARAMETERS, of_each):
        seen = lens_places(directions(), lens)
        np.testing.assert_array_equal(seen, through_lens(directions(), lens).xy)


def test_what_is_found_of_a_ray_does_not_hang_on_others() -> None:
    # far more than are taken at a time, some of them beyond the fold
    lens = np.array([24.0, 0.0, 0.0, -0.35, 0.15, -0.03, 1e-3, 2e-3, 1e-3, 0.0])
    measured = np.random.default_rng(2).uniform(-40.0, 40.0, (20_000, 2))
    together = without_lens(measured, lens)
    assert np.isnan(together).any()
    for k in (0, 8191, 8192, 19_999):
        np.testing.assert_array_equal(without_lens(measured[k : k + 1], lens)[0], together[k])
    back = lens_places(together, lens)
    seen = np.isfinite(together[:, 0])
    np.testing.assert_allclose(back[seen], measured[seen], rtol=0.0, atol=1e-12)


def test_beyond_the_fold_nothing_is_seen() -> None:
    # r (1 - r^2 / 3) grows up to r = 1, where it is 2/3
    lens = np.array([10.0, 0.0, 0.0, -1.0 / 3.0, *[0.0] * 6])
    seen = without_lens(np.array([[6.6, 0.0], [0.0, -6.7], [30.0, 1.0], [1e9, 1e9]]), lens)
    assert np.isfinite(seen[0]).all()
    assert np.hypot(*seen[0]) < 1.0
    assert np.isnan(seen[1:]).all()


@given(
    st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    st.tuples(*[st.floats(-0.01, 0.01)] * 4),
    st.lists(st.tuples(st.floats(-80.0, 80.0), st.floats(-80.0, 80.0)), min_size=1, max_size=9),
)
def test_what_is_found_without_the_lens_is_seen_where_it_was(
    radial: tuple[float, ...], other: tuple[float, ...], places: list[tuple[float, float]]
) -> None:
    lens = np.array([50.0, 0.1, -0.1, *radial, *other])
    measured = np.array(places)
    direction = without_lens(measured, lens)
    found = np.isfinite(direction).all(axis=1)
    assert np.array_equal(found, np.isfinite(direction).any(axis=1))
    np.testing.assert_allclose(
        through_lens(direction[found], lens).xy, measured[found], rtol=0.0, atol=1e-9
    )


@given(st.lists(st.sampled_from((0.0, 1.0, -1.0)), min_size=3, max_size=3), st.data())
def test_no_measure_of_coefficients_stops_the_fold(signs: list[float], data: st.DataObject) -> None:
    powers = st.floats(-320.0, 308.0)
    k1, k2, k3 = (sign * 10.0 ** data.draw(powers) for sign in signs)
    radius = lens_fold(k1, k2, k3)
    assert radius >= 0.0
    if 0.0 < radius < np.inf and max(abs(k1), abs(k2), abs(k3)) < 1e6:
        q = radius * radius
        terms = (3.0 * k1 * q, 5.0 * k2 * q**2, 7.0 * k3 * q**3)
        assert abs(1.0 + sum(terms)) < 1e-6 * (1.0 + sum(map(abs, terms)))


@pytest.mark.parametrize("k3", [0.0, 1e-320, 1e-150, 1e-60, -1e-30, 1e-16])
def test_a_coefficient_that_does_nothing_leaves_the_fold_where_it_is(k3: float) -> None:
    assert lens_fold(-0.4, 0.0, k3) == pytest.approx(np.sqrt(1.0 / 1.2), rel=1e-12)
    assert lens_fold(0.0, -0.2, k3) == pytest.approx(1.0, rel=1e-12)
    assert lens_fold(0.4, 0.3, abs(k3)) == np.inf
