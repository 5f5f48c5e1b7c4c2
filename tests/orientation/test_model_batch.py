"""Models oriented at once are those oriented one by one, where they are beyond doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flightscene import PAPER, PROPAGATED, TAU, fly, pair_of

from anaplot.orientation.model import orient
from anaplot.orientation.modelbatch import ModelBatch, orient_at_once
from anaplot.orientation.pair import Stereopair
from anaplot.photogrammetry.block import Precision
from anaplot.photogrammetry.rotation import rotation_matrix


def batch_of(pairs: list[Stereopair]) -> ModelBatch:
    """Stereopairs side by side, with empty places behind the shorter ones."""
    m, n = len(pairs), max(len(pair.points) for pair in pairs)
    left, right, ties = np.zeros((3, m, 3, n))
    y, x = np.zeros((2, m, n), dtype=bool)
    base = []
    for k, pair in enumerate(pairs):
        for rays, xy, c in ((left, pair.xl, pair.c_left), (right, pair.xr, pair.c_right)):
            rays[k, :2, : len(xy)], rays[k, 2, : len(xy)] = xy.T, -c
        for at, point in enumerate(pair.points):
            y[k, at] = (point, "y") not in pair.off
            if pair.ties and point in pair.ties and (point, "x") not in pair.off:
                x[k, at] = True
                ties[k, :, at] = np.array(pair.ties[point]) - pair.fixed.centre
        mean = abs(float((pair.xl - pair.xr)[:, 0].mean()))
        base.append(pair.base or mean if pair.ties is None else pair.preceding_bx)
    first = np.array([pair.ties is None for pair in pairs])
    rotation = np.array([pair.fixed.rotation for pair in pairs])
    return ModelBatch(left, right, y, x, ties, rotation, first, np.array(base))


def flown(precision: Precision) -> list[Stereopair]:
    """First and later models of flights in either direction, some with few points or rows off."""
    pairs = []
    for seed in range(12):
        flight = fly(seed, tilt=6.0, kappa=30.0, noise=0.005)
        first = pair_of(flight, 0)
        off = frozenset({("1a", "y"), ("1c", "x"), ("1md", "y")}) if seed % 3 == 0 else frozenset()
        points = [p for p in flight.images[1] if p[0] in "12"][: None if seed % 4 else 9]
        before = orient(first, precision, TAU)
        pairs += [first, pair_of(flight, 1, before, points=points, off=off)]
    return pairs


@pytest.mark.parametrize("precision", [PAPER, PROPAGATED])
def test_they_are_those_of_one_model_at_a_time(precision: Precision) -> None:
    pairs = flown(precision)
    found = orient_at_once(batch_of(pairs), precision.tie_variance, precision.image_um * 1e-3)
    assert found.sure.sum() >= len(pairs) - 2
    for k in np.flatnonzero(found.sure).tolist():
        one = orient(pairs[k], precision, TAU)
        np.testing.assert_allclose(found.base[k], one.base, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(found.rotation[k], rotation_matrix(*one.rotation), atol=1e-9)
        at = np.array([point[1:] for point in one.points]) - one.centre
        np.testing.assert_allclose(found.points[k, :, : len(at)].T, at, rtol=1e-9, atol=1e-7)


def test_what_is_not_beyond_doubt_is_not_sure() -> None:
    (good, later), precision = flown(PAPER)[2:4], PAPER
    wrong = replace(good, xr=good.xr + np.eye(len(good.xr), 2) * 4.0)
    line = replace(good, xl=good.xl * [1.0, 0.0], xr=good.xr * [1.0, 0.0])
    turned = replace(good, xl=good.xl[:, ::-1] * [-1.0, 1.0], xr=good.xr[:, ::-1] * [-1.0, 1.0])
    mirrored = replace(later, xr=later.xr * [1.0, -1.0])
    few = replace(good, off=frozenset((point, "y") for point in good.points[6:]))
    nowhere = replace(later, xr=later.xl)
    odd = [wrong, line, turned, mirrored, few, nowhere, replace(good, base=np.nan)]
    pairs = [good, *odd, later]
    found = orient_at_once(batch_of(pairs), precision.tie_variance, precision.image_um * 1e-3)
    assert found.sure.tolist() == [True, *[False] * len(odd), True]
    # what is beside them does not touch those that are right
    alone = orient_at_once(batch_of([good]), precision.tie_variance, precision.image_um * 1e-3)
    np.testing.assert_allclose(found.base[0], alone.base[0], rtol=1e-12)
