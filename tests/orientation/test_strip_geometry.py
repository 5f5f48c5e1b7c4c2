"""A strip's errors against numerical derivatives of the whole chain of models."""

import numpy as np
import pytest
from flightscene import EXACT, PAPER, TAU, fly

from anaplot.orientation.model import orient
from anaplot.orientation.strip import stereopair
from anaplot.orientation.stripgeometry import extended, widened
from anaplot.photogrammetry.rotation import rotation_matrix

MODELS = 3
STEP = 0.002  # mm


def points_of(k):
    return [f"{j}{p}" for j in (k, k + 1) for p in "abcde"] + [f"{k}mb"]


def measured(flight):
    """Return (n, 4) xl, yl, xr, yr of every model."""
    return [
        np.array([flight.images[k][p] + flight.images[k + 1][p] for p in points_of(k)])
        for k in range(MODELS)
    ]


def strip(flight, values, precision, once):
    """Return the strip's geometry and the numbers in it that are checked."""
    before, solution = None, None
    for k in range(MODELS):
        again = frozenset(points_of(k)) & frozenset(points_of(k - 1)) if once and k else frozenset()
        at = values[k].copy()
        for j, name in enumerate(points_of(k)):
            if name in again:
                at[j, :2] = values[k - 1][points_of(k - 1).index(name), 2:]
        left, right = (
            {p: tuple(row[j : j + 2]) for p, row in zip(points_of(k), at.tolist(), strict=True)}
            for j in (0, 2)
        )
        pair = stereopair(
            (str(k), str(k + 1)),
            left,
            right,
            (flight.cameras[k], flight.cameras[k + 1]),
            preceding=solution,
            base=70.0,
            once=again,
        )
        solution = orient(pair, precision, TAU)
        before = extended(before, pair, solution)
    return before


def numbers(geometry):
    return np.concatenate(
        [
            *(at.xyz for at in geometry.points.values()),
            *(pose.centre for pose in geometry.photos.values()),
        ]
    )


def turned(pose, start):
    """Return the small turn about the strip's axes from one rotation to another."""
    r = pose.rotation @ start.rotation.T
    return 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])


@pytest.mark.parametrize(("precision", "once"), [(PAPER, False), (EXACT, False), (EXACT, True)])
def test_errors_are_the_derivatives_of_the_whole_strip(precision, once):
    flight = fly(7, photos=MODELS + 1, tilt=6.0, kappa=25.0)
    values = measured(flight)
    start = strip(flight, values, precision, once)
    expected = np.concatenate(
        [
            *(widened(at.errors, start.count) for at in start.points.values()),
            *(widened(pose.errors[:3], start.count) for pose in start.photos.values()),
        ]
    )
    shared = len(set(points_of(0)) & set(points_of(1)))
    assert start.count == 4 * sum(map(len, values)) - (2 * shared * (MODELS - 1) if once else 0)
    rng = np.random.default_rng(1)
    for column in rng.choice(4 * len(points_of(0)), 12, replace=False).tolist():
        # the errors of the first model reach everything; each is one column, in the points' order
        moved = []
        for sign in (1.0, -1.0):
            changed = [v.copy() for v in values]
            changed[0].flat[column] += sign * STEP
            moved.append(strip(flight, changed, precision, once))
        found = (numbers(moved[0]) - numbers(moved[1])) / (2.0 * STEP)
        scale = np.abs(expected[:, column]).max()
        assert found == pytest.approx(expected[:, column], rel=1e-3, abs=1e-3 * scale)
        for name, pose in start.photos.items():
            turn = turned(moved[0].photos[name], moved[1].photos[name]) / (2.0 * STEP)
            of_turns = np.abs(pose.errors[3:]).max(initial=1e-9)
            assert turn == pytest.approx(
                widened(pose.errors[3:], start.count)[:, column], abs=2e-3 * of_turns
            )


def test_the_first_photo_has_no_error_and_the_strip_keeps_its_sums():
    flight = fly(3, photos=MODELS + 1, tilt=6.0, kappa=25.0)
    start = strip(flight, measured(flight), EXACT, False)
    assert not start.photos["0"].errors.any()
    assert start.redundancy == 6 + 2 * (11 + 5 - 6)
    assert np.array_equal(start.photos["0"].rotation, rotation_matrix(0.0, 0.0, 0.0))
