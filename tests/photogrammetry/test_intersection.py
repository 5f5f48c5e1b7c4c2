"""Model points: rays meet in the XZ plane, Y is the mean of both."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.photogrammetry.intersection import intersect


@given(st.integers(0, 10**6))
def test_exact_rays_meet_in_their_point(seed):
    rng = np.random.default_rng(seed)
    base = np.array([92.0, 4.0, -3.0]) * rng.choice([-1, 1])
    points = np.vstack((rng.uniform(-90, 90, (2, 6)), rng.uniform(-180, -120, 6)))
    x1 = points / rng.uniform(0.5, 2.0, 6)
    x2 = (points - base[:, None]) / rng.uniform(0.5, 2.0, 6)
    meet = intersect(tuple(base.tolist()), x1, x2)
    assert meet.points == pytest.approx(points, abs=1e-9)
    assert meet.left * x1 == pytest.approx(points, abs=1e-9)
    assert meet.in_front.all()


def test_y_is_the_mean_of_the_two_rays_and_xz_do_not_feel_a_parallax():
    base = (90.0, 2.0, 1.0)
    x1 = np.array([[30.0], [20.0], [-150.0]])
    x2 = np.array([[-60.0], [18.0], [-150.0]])
    plain = intersect(base, x1, x2)
    x2[1] += 0.5
    shifted = intersect(base, x1, x2)
    assert shifted.points[0] == plain.points[0]
    assert shifted.points[2] == plain.points[2]
    assert shifted.points[1] - plain.points[1] == pytest.approx(0.25 * plain.right)
    left, right = plain.left * x1, np.array(base)[:, None] + plain.right * x2
    assert left[[0, 2]] == pytest.approx(right[[0, 2]])


def test_a_base_of_the_wrong_sign_puts_points_behind_both_photos():
    x1 = np.array([[30.0], [20.0], [-150.0]])
    x2 = np.array([[-60.0], [20.0], [-150.0]])
    meet = intersect((-90.0, 0.0, 0.0), x1, x2)
    assert meet.left[0] < 0.0
    assert meet.right[0] < 0.0
    assert not meet.in_front.any()


def test_parallel_rays_meet_nowhere_and_are_not_in_front():
    x = np.array([[30.0], [20.0], [-150.0]])
    with np.errstate(divide="ignore", invalid="ignore"):
        meet = intersect((90.0, 0.0, 0.0), x, x)
        still = intersect((0.0, 0.0, 0.0), x, x)
    assert not np.isfinite(meet.points[2]).any()
    assert not still.in_front.any()
