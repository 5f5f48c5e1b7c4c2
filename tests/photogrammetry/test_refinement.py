"""Refinement: sign, formula, table, inverse, derivatives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.camera import (
    CameraCalibration,
    Fiducial,
    RadialPolynomial,
    RadialTable,
)
from anaplot.photogrammetry.refinement import Refinement

POLYNOMIAL = RadialPolynomial((2e-4, -3e-8, 4e-13, 1e-18))
# a wide-angle certificate's list, um every 20 mm
TABLE = RadialTable(
    (20.0, 40.0, 60.0, 80.0, 100.0, 120.0, 140.0, 148.0),
    (1.5, 2.2, 2.4, 1.0, -1.1, -2.6, 0.4, 4.0),
)
CAMERAS = [
    Refinement(),
    Refinement((0.02, -0.011), POLYNOMIAL, (1e-7, -2e-7)),
    Refinement((-0.3, 0.4), TABLE, (-3e-7, 5e-8)),
    Refinement((0.0, 0.0), RadialPolynomial((0.0, 2e-6, 0.0, 0.0)), (1e-5, 1e-5)),  # 2 mm
]
places = st.lists(
    st.tuples(st.floats(-115.0, 115.0), st.floats(-115.0, 115.0)), min_size=1, max_size=8
).map(np.array)
cameras = st.sampled_from(CAMERAS)


@given(cameras, places)
def test_distort_is_the_inverse_of_refine(camera, measured):
    ideal = camera.refine(measured)
    assert np.abs(camera.distort(ideal) - measured).max() < 1e-9
    assert np.abs(camera.refine(camera.distort(measured)) - measured).max() < 1e-9


@given(cameras, places)
def test_derivatives_against_differences(camera, measured):
    h = 1e-4
    exact = camera.jacobian(measured)
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = h
        slope = (camera.refine(measured + step) - camera.refine(measured - step)) / (2 * h)
        # across a table's radius the second derivative jumps
        assert np.abs(exact[:, :, axis] - slope).max() < 1e-7


def test_the_default_is_the_identity():
    points = np.array([[3.0, 4.0], [-100.0, 50.0], [0.0, 0.0]])
    assert (Refinement().refine(points) == points).all()
    assert (Refinement().distort(points) == points).all()
    assert Refinement.of(CameraCalibration("k", 150.0)) == Refinement()


def test_dr_is_subtracted_from_the_measured_radius():
    """Worked by hand: r = 50 mm, dr = 1e-4 * 50 + 1e-8 * 125000 = 6.25 um."""
    camera = Refinement((1.0, 2.0), RadialPolynomial((1e-4, 1e-8, 0.0, 0.0)))
    assert camera.refine(np.array([[1.0 + 30.0, 2.0 + 40.0]]))[0] == pytest.approx(
        (30.0 - 0.00625 * 0.6, 40.0 - 0.00625 * 0.8), abs=1e-12
    )
    table = Refinement(radial=RadialTable((25.0, 50.0), (3.0, 6.25)))
    assert table.refine(np.array([[30.0, 40.0]]))[0] == pytest.approx(
        (30.0 - 0.00375, 40.0 - 0.005), abs=1e-12
    )


def test_all_terms_of_the_polynomial():
    k = np.array([1e-4, 1e-8, 1e-12, 1e-16])
    dr, slope = Refinement(radial=RadialPolynomial(tuple(k))).radial_distortion(np.array([90.0]))
    assert dr[0] == pytest.approx(sum(k * 90.0 ** np.array([1, 3, 5, 7])))
    assert slope[0] == pytest.approx(sum(k * [1, 3, 5, 7] * 90.0 ** np.array([0, 2, 4, 6])))


def test_decentring_by_its_formula():
    p1, p2, x, y = 3e-6, -2e-6, 20.0, -70.0
    r2 = x * x + y * y
    expected = (
        x - (p1 * (r2 + 2 * x * x) + 2 * p2 * x * y),
        y - (p2 * (r2 + 2 * y * y) + 2 * p1 * x * y),
    )
    camera = Refinement(decentring=(p1, p2))
    assert camera.refine(np.array([[x, y]]))[0] == pytest.approx(expected, abs=1e-12)


def test_the_table_is_met_in_every_entry_and_smooth_between():
    camera = Refinement(radial=TABLE)
    radius = np.array(TABLE.radius)
    dr, slope = camera.radial_distortion(radius)
    assert dr == pytest.approx(np.array(TABLE.dr_um) / 1000.0, abs=1e-15)
    nodes, values = np.append(0.0, radius), np.append(0.0, np.array(TABLE.dr_um) / 1000.0)
    # slopes of parabolas, here through numpy's own polynomial fit
    slopes = []
    for k in range(len(nodes)):
        a = min(max(k - 1, 0), len(nodes) - 3)
        near = ([-nodes[1], 0.0, nodes[1]], [-values[1], 0.0, values[1]])
        xs, ys = near if k == 0 else (nodes[a : a + 3], values[a : a + 3])
        slopes.append(np.polyval(np.polyder(np.polyfit(xs, ys, 2)), nodes[k]))
    assert slope[:-1] == pytest.approx(slopes[1:-1], abs=1e-12)
    between = np.linspace(0.0, 147.9, 500)
    expected = CubicHermiteSpline(nodes, values, slopes)(between)
    assert camera.radial_distortion(between)[0] == pytest.approx(expected, abs=1e-12)


def test_beyond_the_table_its_last_value_is_held():
    camera = Refinement(radial=TABLE)
    dr, slope = camera.radial_distortion(np.array([148.1, 160.0, 1000.0]))
    assert (dr == 0.004).all()
    assert (slope == 0.0).all()
    corner = np.array([[115.0, 115.0]])
    assert np.abs(camera.distort(camera.refine(corner)) - corner).max() < 1e-12


@pytest.mark.parametrize(
    ("radius", "dr_um", "at", "expected_um"),
    [((50.0,), (5.0,), 25.0, 2.5), ((0.0,), (0.0,), 25.0, 0.0), ((0.0, 50.0), (0.0, 5.0), 10.0, 1)],
)
def test_the_shortest_tables(radius, dr_um, at, expected_um):
    camera = Refinement(radial=RadialTable(radius, dr_um))
    assert camera.radial_distortion(np.array([at]))[0][0] == pytest.approx(expected_um / 1000.0)


def test_a_distortion_that_folds_the_image_is_refused():
    # coefficients for metres, a usual slip
    wrong = CameraCalibration("k", 150.0, radial=RadialPolynomial((0.0, 1.2e-2, 0.0, 0.0)))
    with pytest.raises(InputError, match="folds the image at radius"):
        Refinement.of(wrong)
    framed = CameraCalibration(
        "k", 150.0, (0.0, 0.0), (230.0, 230.0), radial=RadialPolynomial((0, 1e300, 1e300, 0))
    )
    with pytest.raises(InputError, match="folds"):
        Refinement.of(framed)
    marks = (Fiducial("1", 300.0, 0.0),)
    with pytest.raises(InputError, match="folds"):
        Refinement.of(
            CameraCalibration(
                "k", 10.0, fiducials=marks, radial=RadialPolynomial((0.0, 5e-6, 0.0, 0.0))
            )
        )


def test_a_place_that_no_measured_one_refines_to():
    # r - 1e-4 r^3 has its largest value, 38.5, at r = 57.7
    camera = Refinement(radial=RadialPolynomial((0.0, 1e-4, 0.0, 0.0)))
    with pytest.raises(NotComputableError, match="cannot be inverted at x = 50, y = 0"):
        camera.distort(np.array([[10.0, 0.0], [50.0, 0.0]]))
    with pytest.raises(ValueError, match="shape"):
        camera.refine(np.zeros(2))
