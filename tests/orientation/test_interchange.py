"""Two points whose records are exchanged are named as one mistake; gross errors never are."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from flightscene import PAPER, PROPAGATED, TAU, fly, pair_of

from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import WrongPointsError, orient

SIZES = (6, 7, 8, 9, 12, 13)


def names(count, k):
    a, b = k, k + 1
    return [
        f"{photo}{place}"
        for place, photos in (
            ("a", (a, b)),
            ("c", (a, b)),
            ("d", (a, b)),
            ("b", (a, b)),
            ("e", (a, b)),
            ("mb", (a,)),
            ("ma", (a,)),
            ("mc", (a,)),
        )
        for photo in photos
    ][:count]


@cache
def scene(seed, count, later):
    flight = fly(seed, tilt=3, kappa=10, noise=0.004)
    before = orient(pair_of(flight, 0), PAPER, TAU) if later else None
    return pair_of(flight, int(later), before, points=names(count, int(later)))


def told(pair, precision=PAPER):
    """Return the points named, and the first sentence."""
    try:
        solution = orient(pair, precision, TAU)
    except WrongPointsError as error:
        return points_of(error.interchange), str(error)
    else:
        found = diagnose(solution)
        return points_of(found.interchange), found.advice[0]


def points_of(interchange):
    """Return the two points that are exchanged, or ()."""
    return () if interchange is None else interchange.points


def exchanged(pair, i, j, photos):
    order = np.arange(len(pair.points))
    order[[i, j]] = j, i
    xl = pair.xl[order] if "l" in photos else pair.xl
    return replace(pair, xl=xl, xr=pair.xr[order] if "r" in photos else pair.xr)


@pytest.mark.slow
@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("later", [False, True])
def test_an_interchanged_pair_is_named_by_both_names(count, later):
    named = 0
    for seed in range(6):
        pair = scene(seed, count, later)
        i, j = sorted(np.random.default_rng(seed).choice(count, 2, replace=False).tolist())
        points, text = told(exchanged(pair, i, j, "r"), PROPAGATED if seed % 2 else PAPER)
        assert points in ((), (pair.points[i], pair.points[j]))  # never another pair
        if points:
            named += 1
            assert f"{points[0]} and {points[1]} interchanged" in text
    assert named >= 4  # with few checks two pairs may do, and then none is named


def test_ties_that_are_interchanged_in_both_photos_are_named_without_a_photo():
    pair = scene(1, 13, later=True)
    ties = [pair.points.index(point) for point in pair.points if point in pair.ties]
    i, j = ties[0], ties[-1]
    points, text = told(exchanged(pair, i, j, "lr"))
    assert points == (pair.points[i], pair.points[j])
    assert "in photo" not in text
    points, text = told(exchanged(pair, i, j, "l"))
    assert points == (pair.points[i], pair.points[j])
    assert f"interchanged in photo {pair.left}?" in text


def test_in_a_first_model_nothing_tells_in_which_photo():
    pair = scene(1, 13, later=False)
    for photos in ("l", "r"):
        points, text = told(exchanged(pair, 1, 11, photos))
        assert set(points) == {pair.points[1], pair.points[11]}
        assert "interchanged?" in text


def test_the_pair_is_suspected_first():
    pair = scene(1, 13, later=True)
    ties = [pair.points.index(point) for point in pair.points if point in pair.ties]
    found = diagnose(orient(exchanged(pair, ties[0], ties[-1], "lr"), PAPER, TAU))
    assert {point for point, _ in found.suspects[:2]} == set(found.interchange.points)


@pytest.mark.slow
@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("later", [False, True])
@pytest.mark.parametrize("errors", [1, 2])
def test_ordinary_gross_errors_are_no_interchange(count, later, errors):
    for seed in range(4):
        pair = scene(seed, count, later)
        rng = np.random.default_rng(100 + seed)
        xr = pair.xr.copy()
        for k in rng.choice(count, errors, replace=False):
            xr[k] += rng.choice([-1, 1], 2) * 10.0 ** rng.uniform(-1.3, 1.0, 2)
        assert told(replace(pair, xr=xr))[0] == ()
