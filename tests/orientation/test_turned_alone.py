"""Two photos of one place make no model, whatever fits."""

from __future__ import annotations

import numpy as np
import pytest
from flightscene import BAARDA, PROPAGATED, TAU, bridge_flight, fly, pair_of

from anaplot.errors import NotComputableError
from anaplot.orientation.model import orient
from anaplot.orientation.turnedalone import turned_alone
from anaplot.photogrammetry.rotation import rotation_matrix

C, SIGMA = 152.4, 0.005


def rays(rng, count=13, half=90.0):
    xy = rng.uniform(-half, half, (2, count))
    return np.vstack((xy, np.full(count, -C)))


def seen(turned, rng, sigma=SIGMA):
    xy = -C * turned[:2] / turned[2] + rng.normal(0.0, sigma, (2, turned.shape[1]))
    return np.vstack((xy, np.full(turned.shape[1], -C)))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.02, -0.05, 0.3), (0.0, 0.01, 3.1)])
def test_a_rotation_is_found_whatever_it_is(seed, angles):
    rng = np.random.default_rng(seed)
    one = rays(rng)
    left, right = seen(one, rng), seen(rotation_matrix(*angles).T @ one, rng)
    found = turned_alone(left, right, SIGMA)
    assert found is not None
    # inclined rays turn by less: to a half at 45 degrees
    assert 0.4 < found < 1.0 + 4.0 / np.sqrt(2.0 * 23.0)
    assert turned_alone(left, right, SIGMA / 10.0) is None


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("relief", [0.0, 0.2])
def test_a_base_is_no_rotation(seed, relief):
    """However small it is that it serves for anything, and over a plane."""
    rng = np.random.default_rng(seed)
    one = rays(rng)
    ground = one * (1000.0 / C) * (1.0 + relief * rng.uniform(-1.0, 1.0, 13))
    for base in (600.0, 60.0, 6.0):
        right = ground - np.array([[base], [0.0], [0.0]])
        assert turned_alone(seen(ground, rng), seen(right, rng), SIGMA) is None


def test_points_of_one_place_or_too_few_say_nothing():
    rng = np.random.default_rng(1)
    one = rays(rng, 13, 0.5)
    assert turned_alone(seen(one, rng), seen(one, rng), SIGMA) is None
    line = rays(rng)
    line[1] = 0.3
    assert turned_alone(seen(line, rng), seen(line, rng), SIGMA) is None
    four = rays(rng, 4)
    assert turned_alone(seen(four, rng), seen(four, rng), SIGMA) is None


@pytest.mark.parametrize("test", [TAU, BAARDA])
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("later", [False, True])
def test_a_photo_laid_in_twice_is_named(seed, later, test):
    f = fly(13, 3, tilt=3.0, kappa=10.0, noise=0.004, same_camera=True)
    rng = np.random.default_rng(seed)
    preceding = bridge_flight(f, PROPAGATED, test)[0] if later else None
    k = 1 if later else 0
    again = {
        point: tuple(np.add(xy, rng.normal(0.0, 0.004, 2)).tolist())
        for point, xy in f.images[k].items()
    }
    pair = pair_of(f, k, preceding, right=again, **({} if later else {"base": 90.0}))
    with pytest.raises(NotComputableError, match="there is no base between the photos: a rotation"):
        orient(pair, PROPAGATED, test)
