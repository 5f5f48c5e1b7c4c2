"""Error ellipses, heights and distances of places by their covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from conditionblocks import condition, flat_scene, with_conditions
from hypothesis import given
from hypothesis import strategies as st

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.coordinatefunctions import CoordinateFunction, evaluate_functions
from anaplot.bundle.solve.covariances import covariance_of
from anaplot.bundle.solve.placeaccuracy import (
    Place,
    error_ellipse,
    pair_accuracies,
    place_accuracies,
)
from anaplot.bundle.solve.unknownnames import unknowns_meant


@pytest.fixture(scope="module")
def block():
    return adjust_block(aerial(2, 4, noise_um=5.0, control_sigma=0.05, tilt=0.1, seed=2).block)


def of(block, *wanted):
    return covariance_of(block, unknowns_meant(block.problem, wanted, "x"))


@given(st.floats(1e-3, 1e3), st.floats(1e-6, 1.0), st.floats(-np.pi / 2 + 1e-6, np.pi / 2 - 1e-6))
def test_an_ellipse_is_that_of_its_covariance(a, ratio, direction) -> None:
    b = a * ratio
    turned = np.array([[np.cos(direction), -np.sin(direction)],
                       [np.sin(direction), np.cos(direction)]])  # fmt: skip
    covariance = turned @ np.diag((a * a, b * b)) @ turned.T
    found = error_ellipse(covariance)
    assert found.a == pytest.approx(a, rel=1e-9)
    # of a thin one by what is left of the determinant
    assert found.b == pytest.approx(b, rel=1e-6, abs=1e-7 * a)
    if ratio < 0.99:
        assert found.direction == pytest.approx(direction, abs=1e-6)
    assert -np.pi / 2 < found.direction <= np.pi / 2


def test_ellipses_that_are_none() -> None:
    assert error_ellipse(np.zeros((2, 2))) == (0.0, 0.0, 0.0)
    assert error_ellipse(np.diag((4.0, 4.0))) == (2.0, 2.0, 0.0)
    assert error_ellipse(np.diag((1.0, 4.0))) == (2.0, 1.0, pytest.approx(np.pi / 2))
    across = error_ellipse(np.array([[1.0, -0.0], [-0.0, 4.0]]))
    assert across.direction == pytest.approx(np.pi / 2)
    assert np.isnan(error_ellipse(np.full((2, 2), np.nan))).all()


def test_distances_and_heights_are_those_of_functions(block) -> None:
    pairs = pair_accuracies(of(block, "points:p2,p7,p11"))
    assert [(one.first.name, one.second.name) for one in pairs] == [
        ("p2", "p7"), ("p2", "p11"), ("p7", "p11")
    ]  # fmt: skip
    for one in pairs:
        names = (one.first.name, one.second.name)
        length, height = evaluate_functions(
            block, [CoordinateFunction("distance", names), CoordinateFunction("height", names)]
        )
        assert one.distance == pytest.approx(length.value, rel=1e-9)
        assert one.s_distance == pytest.approx(length.s, rel=1e-7)
        assert one.difference[2] == pytest.approx(height.value, abs=1e-9)
        assert one.s[2] == pytest.approx(height.s, rel=1e-7)


def test_places_are_points_and_photos_that_are_there_whole(block) -> None:
    found = of(block, "point:p2:Z", "points:p7", "photo:102", "photo:103:X", "photo:103:Y")
    places = place_accuracies(found)
    assert [one.place for one in places] == [Place("point", "p7"), Place("photo", "102")]
    rows = {row.point: row for row in block.point_rows()}
    assert places[0].s == pytest.approx(rows["p7"].s_xyz, rel=1e-7)
    # of the base between two photos, by its gradient and their covariance
    (pair,) = pair_accuracies(of(block, "photos:102,103"))
    both = of(block, "photos:102,103")
    at = [0, 1, 2, 6, 7, 8]
    step = both.values[6:9] - both.values[:3]
    gradient = np.concatenate((-step, step)) / np.linalg.norm(step)
    s = np.sqrt(gradient @ both.matrix[np.ix_(at, at)] @ gradient)
    assert pair.s_distance == pytest.approx(s, rel=1e-9)
    plan = both.matrix[np.ix_(at, at)]
    plan = plan[:2, :2] + plan[3:5, 3:5] - plan[:2, 3:5] - plan[3:5, :2]
    assert pair.ellipse.a**2 + pair.ellipse.b**2 == pytest.approx(np.trace(plan), rel=1e-9)
    assert pair.ellipse.a * pair.ellipse.b == pytest.approx(np.sqrt(np.linalg.det(plan)), rel=1e-7)


def test_what_a_condition_holds_does_not_vary() -> None:
    scene = flat_scene()
    block = with_conditions(scene, [condition(scene, "distance", "p2 p7", 0.0)])
    (pair,) = pair_accuracies(of(block, "points:p2,p7"))
    # the root of what rounding leaves of the variance
    assert pair.s_distance < 1e-5 * min(pair.s)
    assert pair.distance == pytest.approx(
        np.linalg.norm(scene.points["p2"] - scene.points["p7"]), abs=1e-9
    )


def test_places_that_coincide_have_no_direction(block) -> None:
    found = of(block, "points:p2,p7")
    values = found.values.copy()
    values[3:] = values[:3]
    (pair,) = pair_accuracies(replace(found, values=values))
    assert pair.distance == 0.0
    assert np.isnan(pair.s_distance)
    assert pair.s[2] > 0.0
    (pair,) = pair_accuracies(replace(found, sigma=None))
    assert pair.distance > 0.0
    assert np.isnan([*pair.s, pair.s_distance, *pair.ellipse]).all()
