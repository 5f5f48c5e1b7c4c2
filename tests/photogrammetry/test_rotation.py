"""Rotations: convention, round trip, derivatives."""

from math import cos, hypot, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from anaplot.photogrammetry.rotation import (
    angle_derivatives,
    axis_angle,
    is_rotation,
    rotation_angles,
    rotation_axes,
    rotation_matrix,
    turn,
)

angles = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))


def about(axis, angle):
    c, s = cos(angle), sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = c
    out[i, j], out[j, i] = -s, s
    return out


@given(angles)
def test_product_of_the_three_rotations(a):
    expected = about(0, a[0]) @ about(1, a[1]) @ about(2, a[2])
    assert rotation_matrix(*a) == pytest.approx(expected, abs=1e-15)


@given(angles)
def test_round_trip(a):
    assert rotation_angles(rotation_matrix(*a)) == pytest.approx(a, abs=1e-12)


@pytest.mark.parametrize("phi", [pi / 2, -pi / 2])
def test_where_omega_and_kappa_cannot_be_told_apart(phi):
    R = rotation_matrix(0.3, phi, 0.4)
    omega, found, kappa = rotation_angles(R)
    assert omega == 0.0
    assert found == pytest.approx(phi)
    assert rotation_matrix(omega, found, kappa) == pytest.approx(R, abs=1e-12)


def test_half_turns_are_pi_and_not_minus_pi():
    upside_down = np.diag([-1.0, -1.0, 1.0])
    for zero in (0.0, -0.0):
        R = upside_down.copy()
        R[0, 1] = zero
        R[1, 0] = zero
        assert rotation_angles(R) == (0.0, 0.0, pi)
    rolled = np.diag([1.0, -1.0, -1.0])
    rolled[1, 2] = 0.0
    assert rotation_angles(rolled)[0] == pi


@given(angles, st.integers(0, 2))
def test_axes_against_numerical_derivatives(a, which):
    h = 1e-6
    up, down = list(a), list(a)
    up[which] += h
    down[which] -= h
    numerical = (rotation_matrix(*up) - rotation_matrix(*down)) / (2 * h)
    axis = rotation_axes(a[0], a[1])[:, which]
    cross = np.array([np.cross(axis, column) for column in rotation_matrix(*a).T]).T
    assert cross == pytest.approx(numerical, abs=1e-8)


@given(angles, st.integers(0, 2))
def test_derivatives_of_angles_against_differences(a, which):
    assume(abs(cos(a[1])) > 0.1)
    h = 1e-6
    small = np.eye(3)[which] * h
    up, down = (
        rotation_angles(turn(*(s * small).tolist()) @ rotation_matrix(*a)) for s in (1.0, -1.0)
    )
    difference = (np.subtract(up, down) + pi) % (2.0 * pi) - pi
    found = angle_derivatives(rotation_matrix(*a))[:, which]
    assert found == pytest.approx(difference / (2.0 * h), abs=1e-6)


@given(st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.floats(0.0, 1.0))
def test_turn_is_a_right_handed_rotation_about_its_vector(v, shrink):
    vector = np.array(v) * shrink**8  # large and tiny turns
    R = turn(*vector.tolist())
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-14
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert R @ vector == pytest.approx(vector, abs=1e-14)
    size = float(np.linalg.norm(vector))
    axial = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    factor = sin(size) / size if size > 1e-150 else 1.0
    assert axial == pytest.approx(vector * factor, abs=1e-14)


def test_turn_about_z():
    assert turn(0.0, 0.0, 0.5) == pytest.approx(rotation_matrix(0.0, 0.0, 0.5), abs=1e-15)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 3.1415))
def test_a_rotation_has_its_vector(x: float, y: float, z: float, angle: float) -> None:
    length = sqrt(x * x + y * y + z * z)
    if length < 1e-3:
        x, length = 1.0, sqrt(1.0 + y * y + z * z)
    vector = [part * angle / length for part in (x, y, z)]
    rotation = turn(*vector)
    found = axis_angle(rotation)
    assert hypot(*found) <= pi + 1e-12
    assert np.abs(turn(*found) - rotation).max() < 4e-15
    assert np.abs(np.subtract(found, vector)).max() < 2e-11
    half_turn = axis_angle(np.diag([-1.0, 1.0, -1.0]))
    assert half_turn == (0.0, pi, 0.0)


@given(angles, st.integers(0, 2), st.sampled_from([0.0, 1e-9, 0.1, -1.0, 1e200, float("nan")]))
def test_what_is_a_rotation(a, column, size):
    matrix = rotation_matrix(*a)
    assert is_rotation(matrix)
    assert is_rotation(matrix, 1e-15 * 10)
    matrix[:, column] *= size
    assert not is_rotation(matrix)  # flat, mirrored, squeezed, or no numbers


def test_a_rotation_is_one_within_bounds():
    matrix = np.diag((1.0, 1.0, 1.0 + 1e-4))
    assert is_rotation(matrix)
    assert not is_rotation(matrix, 1e-4)
