"""Where fiducials are looked for."""

from __future__ import annotations

from math import hypot

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.camera import CameraCalibration, FiducialDistance, RadialPolynomial
from anaplot.photogrammetry.platetransformation import Placement, random_placement
from anaplot.photogrammetry.refinement import Refinement
from anaplot.planning.fiducialplan import expected_fiducials, predicted_fiducial
from anaplot.planning.syntheticcamera import with_calibration

CAMERA = with_calibration(Camera("rmk", 152.4, (230.0, 230.0)))
assert CAMERA.calibration is not None
EXPECTED = expected_fiducials(CAMERA.calibration)
NAMES = tuple(EXPECTED)


def placed(placement) -> dict[str, tuple[float, float]]:
    at = placement.to_plate(np.array(list(EXPECTED.values())))
    return {name: (x, y) for name, (x, y) in zip(EXPECTED, at.tolist(), strict=True)}


NOMINAL = placed(Placement(0.0, 0.0).transformation())


def off(a: tuple[float, float], b: tuple[float, float]) -> float:
    return hypot(a[0] - b[0], a[1] - b[1])


def test_the_made_up_camera_is_a_camera() -> None:
    calibration = CAMERA.calibration
    assert calibration is not None
    assert len(EXPECTED) == 8
    assert isinstance(calibration.radial, RadialPolynomial)
    refinement = Refinement.of(calibration)
    radius = np.linspace(0.0, 162.0, 200)
    dr = refinement.radial_distortion(radius)[0] * 1e3
    assert 5.0 < np.abs(dr).max() < 20.0
    with pytest.raises(ValueError, match="no format"):
        with_calibration(Camera("x", 100.0))


@given(st.integers(0, 2**32), st.permutations(NAMES))
def test_the_more_is_measured_the_nearer_is_the_prediction(seed: int, order: list[str]) -> None:
    true = placed(random_placement(seed))
    measured: dict[str, tuple[float, float]] = {}
    # before anything: the shift, and the rotation at the frame's corner
    limits = [2.9 + 0.02 * 152.0, 0.02 * 310.0, *[0.4] * 6]
    for name, limit in zip(order, limits, strict=True):
        assert off(predicted_fiducial(EXPECTED, NOMINAL, measured, name), true[name]) <= limit
        measured[name] = true[name]
    for name in order:
        # again: from where the others lie, not from where it was wrongly measured
        wrong = {**measured, name: (0.0, 0.0)}
        assert off(predicted_fiducial(EXPECTED, NOMINAL, wrong, name), true[name]) < 0.4


def test_a_plate_seen_from_behind_shows_from_the_third_fiducial_on() -> None:
    true = placed(Placement(150.0, 140.0, 1.7, mirrored=True).transformation())
    measured = {name: true[name] for name in ("1", "2", "5")}
    for name in ("3", "4", "6", "7", "8"):
        assert off(predicted_fiducial(EXPECTED, NOMINAL, measured, name), true[name]) < 1e-6


def test_one_fiducial_again() -> None:
    assert predicted_fiducial(EXPECTED, NOMINAL, {"3": (1.0, 2.0)}, "3") == (1.0, 2.0)


def test_fiducials_in_one_place_say_nothing_of_the_rotation() -> None:
    expected = {"1": (0.0, 0.0), "2": (0.1, 0.0), "3": (100.0, 0.0)}
    found = predicted_fiducial(expected, expected, {"1": (5.0, 5.0), "2": (5.1, 5.0)}, "3")
    assert found == pytest.approx((105.0, 5.0))


def distances(*rows: tuple[str, str, float]) -> dict[str, tuple[float, float]]:
    made = tuple(FiducialDistance(*row) for row in rows)
    return expected_fiducials(CameraCalibration("old", 152.4, distances=made))


def test_distances_across_the_frame() -> None:
    assert distances(("1", "3", 220.0), ("4", "2", 200.0)) == {
        "1": (-110.0, 0.0),
        "3": (110.0, 0.0),
        "4": (0.0, -100.0),
        "2": (0.0, 100.0),
    }


@pytest.mark.parametrize("second", [("2", "3", 200.0), ("1", "4", 200.0)])
def test_distances_along_its_edges(second: tuple[str, str, float]) -> None:
    corners = {
        "1": (-110.0, -100.0),
        "2": (110.0, -100.0),
        "3": (110.0, 100.0),
        "4": (-110.0, 100.0),
    }
    rest = [
        row for row in (("2", "3", 200.0), ("1", "4", 200.0), ("4", "3", 220.0)) if row != second
    ]
    found = distances(("1", "2", 220.0), second, *rest)
    assert found.keys() == corners.keys()
    for name, place in corners.items():
        assert found[name] == pytest.approx(place, abs=1e-9)


def test_a_fiducial_whose_place_does_not_follow() -> None:
    found = distances(("1", "3", 220.0), ("4", "2", 220.0), ("1", "9", 30.0))
    assert "9" not in found
    assert predicted_fiducial(found, {"9": (7.0, 8.0)}, {"1": (0.0, 0.0)}, "9") == (7.0, 8.0)
