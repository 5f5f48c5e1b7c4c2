"""[distortion] of a camera file: a certificate's numbers as they are printed."""

from __future__ import annotations

from math import radians, tan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange.camerafile import format_camera, parse_camera
from anaplot.photogrammetry.camera import CameraCalibration, RadialPolynomial, RadialTable
from anaplot.photogrammetry.refinement import Refinement

C = 153.124
HEAD = f'format = 1\n[camera]\nid = "rc8"\nc = {C}\n'


def camera(distortion: str, more: str = "") -> CameraCalibration:
    return parse_camera(f"{HEAD}{more}[distortion]\n{distortion}\n", Path("B/rc8.toml"))


def refused(distortion: str, more: str = "") -> str:
    with pytest.raises(InputError) as caught:
        camera(distortion, more)
    message = str(caught.value)
    assert message.startswith("B/rc8.toml line ")
    assert message.isprintable()
    return message


def test_angles_are_those_of_the_ray_in_the_object():
    deg = camera('sign = "distortion"\nunit = "deg"\nangles = [[0, 0], [7.5, 1.5], [45, -2.0]]')
    assert deg.radial == RadialTable(
        (0.0, C * tan(radians(7.5)) + 0.0015, C * tan(radians(45)) - 0.002), (0, 1.5, -2)
    )
    gon = camera('sign = "distortion"\nunit = "gon"\nangles = [[50.0, 3.0]]')
    assert isinstance(gon.radial, RadialTable)
    assert gon.radial.radius == pytest.approx((C + 0.003,), rel=1e-15)
    # what is measured there goes to where c tan a is
    at = float(gon.radial.radius[0])
    [(x, _)] = Refinement.of(gon).refine(np.array([[at, 0.0]])).tolist()
    assert x == pytest.approx(C, rel=1e-12)


@pytest.mark.parametrize(
    "form",
    ["table = [[20.0, {}1.5], [40.0, {}2.2]]", "radial = [{}1e-5, {}2e-9, 0, 0]",
     'unit = "deg"\nangles = [[10, {}1.5], [20, {}2.0]]'],
)  # fmt: skip
def test_a_correction_is_a_distortion_of_the_other_sign(form):
    tail = "\ndecentring = [{}1e-8, {}2e-8]"
    correction = camera('sign = "correction"\n' + (form + tail).replace("{}", "-"))
    assert correction == camera('sign = "distortion"\n' + (form + tail).replace("{}", ""))
    # the distortion is taken away: a measured point beyond its ideal place comes back
    ideal = Refinement.of(correction).refine(np.array([[30.0, 0.0]]))
    assert ideal[0, 0] < 30.0


def test_without_a_sign_the_numbers_are_distortions():
    assert camera("table = [[20.0, 1.5]]") == camera('sign = "distortion"\ntable = [[20.0, 1.5]]')
    assert camera("").radial is None


def test_the_mean_of_the_half_diagonals_counts():
    made = camera(
        'sign = "correction"\nunit = "deg"\n'
        "angles = [[10, 1.0, 2.0, 1.5, 1.5], [20, -3.0, 1.0], [30, 4.0]]"
    )
    assert isinstance(made.radial, RadialTable)
    assert made.radial.dr_um == (-1.5, 1.0, -4.0)
    assert made.radial.diagonals_um == ((-1.0, -2.0, -1.5, -1.5), (3.0, -1.0), (-4.0,))
    assert made.radial.spread() == (2.0, C * tan(radians(20)) + 0.001)
    assert RadialTable((1.0,), (2.0,)).spread() is None


@pytest.mark.slow
@given(
    st.lists(
        st.lists(st.floats(-30.0, 30.0), min_size=1, max_size=8), min_size=1, max_size=6
    ),
    st.sampled_from(["deg", "gon"]),
    st.sampled_from(["distortion", "correction"]),
)  # fmt: skip
def test_what_was_typed_off_a_certificate_is_written_as_radii_and_read_back(rows, unit, sign):
    angles = [[5.0 + 9.0 * k, *um] for k, um in enumerate(rows)]
    made = camera(f'sign = "{sign}"\nunit = "{unit}"\nangles = {angles}')
    assert isinstance(made.radial, RadialTable)
    turned = -1.0 if sign == "correction" else 1.0
    assert made.radial.dr_um == pytest.approx([turned * np.mean(um) for um in rows], abs=1e-12)
    assert parse_camera(format_camera(made), Path("k.toml")) == made


@pytest.mark.parametrize(
    ("distortion", "words"),
    [
        ("angles = [[7.5, 1.0]]", ["angles without sign", '"correction"']),
        ('sign = "distortion"\nangles = [[7.5, 1.0]]', ["angles without unit", '"gon"']),
        ('unit = "deg"\ntable = [[7.5, 1.0]]', ["unit without angles"]),
        ('sign = "corrections"\ntable = [[7.5, 1.0]]', ["did you mean 'correction'"]),
        ('sign = "distortion"\nunit = "rad"\nangles = [[0.1, 1.0]]', ['"deg" or "gon"']),
        ("radial = [0, 0, 0, 0]\ntable = [[1, 2]]", ["table beside radial"]),
        ("table = [[1, 2]]\nangles = [[1, 2]]", ["angles beside table"]),
        ("table = [[1]]", ["must hold 2 numbers, not 1"]),
        ("table = [[1,2,3,4,5,6,7,8,9,10]]", ["more than 8 half-diagonals"]),
        ("table = [[0, 0, 1]]", ["at radius 0 must be 0"]),
        ('sign = "correction"\ntable = [[1, 2], [1, 3]]', ["radii must grow"]),
        (
            "table = [[20, 1e308, 1e308], [40, 2]]",
            ["line 6", "table: more than 1e+06 mm, or um"],
        ),
    ],
)
def test_what_is_wrong_is_named(distortion, words):
    for word in words:
        assert word in refused(distortion)


@pytest.mark.parametrize("angle", [-1.0, 85.1, 90.0, 1e300])
def test_angles_that_no_lens_has(angle):
    words = f'sign = "distortion"\nunit = "deg"\nangles = [[{angle!r}, 1.0]]'
    assert "must lie between 0 and 85 deg" in refused(words)


# -- the point of symmetry -------------------------------------------------------------------

POINTS = np.array([[80.0, -70.0], [-110.0, 3.0], [0.2, 0.1], [0.013, 0.002]])


def test_distortion_is_about_the_point_of_symmetry():
    text = "principal_point = [0.010, 0.002]\nsymmetry_point = [0.210, -0.102]\n"
    made = camera("radial = [0, 2e-7, 0, 0]\ndecentring = [1e-7, -2e-7]", text)
    away = POINTS - [0.210, -0.102]
    r2 = np.sum(away**2, axis=1)
    x, y = away.T
    wanted = POINTS - [0.010, 0.002] - away * (2e-7 * r2)[:, None]
    wanted[:, 0] -= 1e-7 * (r2 + 2 * x * x) - 4e-7 * x * y
    wanted[:, 1] -= -2e-7 * (r2 + 2 * y * y) + 2e-7 * x * y
    refinement = Refinement.of(made)
    np.testing.assert_allclose(refinement.refine(POINTS), wanted, atol=1e-13)
    np.testing.assert_allclose(refinement.distort(wanted), POINTS, atol=1e-12)
    step = 1e-6
    for axis in range(2):
        moved = np.zeros(2)
        moved[axis] = step
        change = refinement.refine(POINTS + moved) - refinement.refine(POINTS - moved)
        np.testing.assert_allclose(
            refinement.jacobian(POINTS)[:, :, axis], change / (2 * step), atol=1e-8
        )
    assert parse_camera(format_camera(made), Path("k.toml")) == made


def test_without_one_it_is_the_principal_point():
    point = "principal_point = [0.010, 0.002]\n"
    with_it = camera("radial = [0, 2e-7, 0, 0]", point + "symmetry_point = [0.010, 0.002]\n")
    without = camera("radial = [0, 2e-7, 0, 0]", point)
    assert without.symmetry_point is None
    np.testing.assert_array_equal(
        Refinement.of(with_it).refine(POINTS), Refinement.of(without).refine(POINTS)
    )
    assert "lies further off than c" in refused("", "symmetry_point = [0.0, 160.0]\n")


def test_a_polynomial_has_no_half_diagonals():
    made = camera('sign = "correction"\nradial = [0.0, -1e-8, 0.0, 0.0]')
    assert made.radial == RadialPolynomial((0.0, 1e-8, 0.0, 0.0))
    assert "-0.0" not in format_camera(made)
