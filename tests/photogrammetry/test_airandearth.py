"""Refraction and earth curvature: against rays traced through the air, and lines to a sphere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from anaplot.errors import NotComputableError
from anaplot.photogrammetry.airandearth import AirAndEarth, refraction_constant
from anaplot.photogrammetry.camera import BrownLens, CameraCalibration, RadialPolynomial
from anaplot.photogrammetry.radialshift import RadialShift
from anaplot.photogrammetry.refinement import Refinement

C = 152.4


def traced(flying: float, ground: float, angle: float) -> float:
    """Return how far out [mm] a ray is imaged that is traced down through a standard atmosphere.

    The pressure is integrated upwards from sea level with the ray's horizontal way behind it.
    """

    def kelvin(z: float) -> float:
        return 288.15 - 0.0065 * min(z, 11_000.0)

    def index(z: float, pascal: float) -> float:
        return 1.0 + 2.77e-4 * (pascal / 101_325.0) * (288.15 / kelvin(z))

    def lapse(z: float, state: np.ndarray) -> list[float]:
        return [-9.80665 * state[0] / (287.05287 * kelvin(z))]

    up = solve_ivp(lapse, (0.0, flying), [101_325.0], rtol=1e-11, dense_output=True, max_step=500.0)
    pressure = up.sol
    top = index(flying, float(pressure(flying)[0]))

    def way(z: float, state: np.ndarray) -> list[float]:
        sine = top * np.sin(angle) / index(z, float(pressure(z)[0]))  # Snell's law
        return [sine / np.sqrt(1.0 - sine**2)]

    along = solve_ivp(way, (ground, flying), [0.0], rtol=1e-11, atol=1e-9, max_step=500.0).y[0, -1]
    return C * float(np.tan(angle)) - C * along / (flying - ground)


@pytest.mark.parametrize(
    ("flying", "ground"), [(1900.0, 0.0), (1900.0, 200.0), (3000.0, 1000.0), (15000.0, 300.0)]
)
@pytest.mark.parametrize("radius", [40.0, 150.0])
def test_a_ray_traced_through_the_air(flying, ground, radius):
    shift = RadialShift.of(AirAndEarth(flying, ground, refraction=True), C)
    told = shift.at(radius)
    assert told == pytest.approx(traced(flying, ground, np.arctan(radius / C)), rel=3e-3)


def test_the_size_of_it():
    """At 1900 m two micrometres at 70 mm, six in the corner of a wide-angle photograph."""
    shift = RadialShift.of(AirAndEarth(1900.0, 0.0, refraction=True), 152.0)
    um = [1e3 * shift.at(radius) for radius in (70.0, 140.0)]
    assert um == pytest.approx([1.95, 5.95], abs=0.02)
    both = RadialShift.of(AirAndEarth(1900.0, 0.0, refraction=True, earth_curvature=True), 152.0)
    assert both.cubic - shift.cubic == pytest.approx(-1900.0 / (2 * 6.371e6 * 152.0**2), rel=1e-9)


@pytest.mark.parametrize(
    ("flying", "ground"),
    [(500.0, 0.0), (500.0, 200.0), (1900.0, 0.0), (1900.0, 1400.0), (4000.0, 500.0), (9e3, 500.0)],
)
def test_it_agrees_with_a_published_formula(flying, ground):
    """Saastamoinen 1974, heights in km."""
    high, low = flying / 1e3, ground / 1e3
    published = 13e-6 * (high - low) * (1.0 - 0.02 * (2.0 * high + low))
    assert refraction_constant(flying, ground) == pytest.approx(published, rel=0.03)


@pytest.mark.parametrize("flying", [1900.0, 4500.0])
@pytest.mark.parametrize("radius", [50.0, 110.0, 160.0])
def test_a_line_to_the_sphere(flying, radius):
    """Where a straight ray meets the earth, against the map, on which distances are arcs."""
    ground, earth = 300.0, 6.371e6
    angle = np.arctan(radius / C)
    below = earth + ground
    arc = below * (np.arcsin((earth + flying) / below * np.sin(angle)) - angle)
    on_the_map = C * arc / (flying - ground)
    shift = RadialShift.of(AirAndEarth(flying, ground, earth_curvature=True), C)
    told = shift.taken_off(np.array([[radius, 0.0]]))[0, 0]
    assert told > radius
    assert told - radius == pytest.approx(on_the_map - radius, rel=3e-3)


def test_nothing_asked_for_is_nothing():
    shift = RadialShift.of(AirAndEarth(1900.0, 200.0), C)
    assert shift == RadialShift(0.0, 0.0)
    places = np.array([[3.0, -80.0]])
    np.testing.assert_array_equal(shift.taken_off(places), places)


def test_its_parts_add_up():
    both = AirAndEarth(1900.0, 200.0, refraction=True, earth_curvature=True)
    (first, air), (second, earth) = both.parts()
    assert (first, second) == ("refraction", "earth curvature")
    um = [1e3 * RadialShift.of(one, C).at(140.0) for one in (air, earth, both)]
    assert um[0] > 0.0 > um[1]
    assert um[0] + um[1] == pytest.approx(um[2])
    assert AirAndEarth(1900.0, 200.0).parts() == []
    assert [what for what, _ in earth.parts()] == ["earth curvature"]


heights = st.tuples(st.floats(-500.0, 19_000.0), st.floats(1.0, 19_000.0)).map(
    lambda pair: (min(pair[0] + pair[1], 20_000.0), pair[0])
)


@given(heights, st.booleans(), st.booleans(), st.floats(20.0, 400.0), st.floats(0.0, 6.28))
def test_what_is_put_on_is_taken_off(pair, refraction, curvature, c, turn):
    flying, ground = pair
    shift = RadialShift.of(AirAndEarth(flying, ground, refraction, curvature), c)
    assert 0.0 <= shift.linear < 2e-4
    places = np.outer(np.linspace(0.0, 1.5 * c, 7), [np.cos(turn), np.sin(turn)])
    laid = shift.put_on(places)
    np.testing.assert_allclose(shift.taken_off(laid), places, atol=1e-11 * c)
    step = 1e-4 * c
    for axis in range(2):
        moved = np.eye(2)[axis] * step
        change = shift.taken_off(laid + moved) - shift.taken_off(laid - moved)
        np.testing.assert_allclose(
            shift.jacobian(laid)[:, :, axis], change / (2.0 * step), atol=1e-9
        )


def test_the_end_of_the_image():
    with pytest.raises(NotComputableError, match="so far out"):
        RadialShift(0.0, 1e-4).put_on(np.array([[1000.0, 0.0]]))


@pytest.mark.parametrize("lens", [False, True])
def test_refinement_takes_it_off_after_the_lens_and_about_the_principal_point(lens):
    air = AirAndEarth(4500.0, 300.0, refraction=True, earth_curvature=True)
    camera = CameraCalibration(
        "k",
        C,
        (0.3, -0.2),
        (230.0, 230.0),
        radial=None if lens else RadialPolynomial((0.0, 1e-7, 0.0, 0.0)),
        symmetry_point=None if lens else (1.3, 0.5),
        **({"lens": BrownLens(k1=-1e-3)} if lens else {}),
    )
    alone, both = Refinement.of(camera), Refinement.of(camera, air)
    places = np.array([[80.0, -70.0], [-110.0, 3.0], [0.3, -0.2], [1.0, 2.0]])
    np.testing.assert_allclose(
        both.refine(places),
        RadialShift.of(air, C).taken_off(alone.refine(places)),
        rtol=0,
        atol=1e-14,
    )
    np.testing.assert_allclose(both.distort(both.refine(places)), places, atol=1e-9)
    for axis in range(2):
        moved = np.eye(2)[axis] * 1e-4
        change = both.refine(places + moved) - both.refine(places - moved)
        np.testing.assert_allclose(both.jacobian(places)[:, :, axis], change / 2e-4, atol=1e-8)
