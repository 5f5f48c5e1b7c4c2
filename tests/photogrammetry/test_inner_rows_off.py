"""Rows of fiducials switched off: the fit without them, worked by an independent path."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.errors import NotComputableError
from anaplot.photogrammetry.camera import CameraCalibration, Fiducial, FiducialDistance
from anaplot.photogrammetry.inner import orient_inner
from anaplot.photogrammetry.platetransformation import random_placement

PLACES = (
    (-106, -106),
    (106, 106),
    (-106, 106),
    (106, -106),
    (-113, 0),
    (113, 0),
    (0, 113),
    (0, -113),
)
CAMERA = CameraCalibration(
    "rmk", 152.4, fiducials=tuple(Fiducial(str(k), *xy) for k, xy in enumerate(PLACES, 1))
)


def measured(seed: int = 1, **wrong: tuple[float, float]) -> dict[str, tuple[float, float]]:
    """Plate coordinates with noise, and errors along the image's axes."""
    rng = np.random.default_rng(seed)
    image = np.array(PLACES, dtype=np.float64)
    image += [wrong.get(f"f{k}", (0.0, 0.0)) for k in range(1, 9)]
    plate = random_placement(seed).to_plate(image)
    plate += rng.normal(0.0, 0.004, plate.shape)
    return {str(k): (x, y) for k, (x, y) in enumerate(plate.tolist(), 1)}


def affine_without(plate: dict[str, tuple[float, float]], off: set[tuple[str, str]]):
    """Two separate parametric fits, x and y: for an affine plate that is the whole adjustment."""
    out = {}
    for k, axis in enumerate("xy"):
        names = [name for name in plate if (name, axis) not in off]
        design = np.array([(1.0, *plate[name]) for name in names])
        wanted = np.array([PLACES[int(name) - 1][k] for name in names], dtype=np.float64)
        g = np.linalg.lstsq(design, wanted, rcond=None)[0]
        hat = design @ np.linalg.inv(design.T @ design) @ design.T
        # adjusted minus measured, in the image: what the fit lacks, seen from the observation
        for name, v, h in zip(names, wanted - design @ g, np.diag(hat), strict=True):
            out[name, axis] = (v * 1e3, 1.0 - h)
    return out


@pytest.mark.parametrize(
    "off", [{("3", "x")}, {("3", "x"), ("5", "y")}, {("1", "x"), ("1", "y")}, set()]
)
def test_residuals_and_redundancy_without_the_rows(off) -> None:
    plate = measured()
    found = orient_inner(CAMERA, plate, transformation="affine", off=off)
    wanted = affine_without(plate, off)
    assert {row.key for row in found.rows} == set(wanted)
    assert found.redundancy == len(wanted) - 6
    assert sum(row.r for row in found.rows) == pytest.approx(found.redundancy, abs=1e-6)
    for row in found.rows:
        residual, redn = wanted[row.key]
        assert row.residual == pytest.approx(residual, abs=0.01)
        assert row.r == pytest.approx(redn, abs=2e-3)
    assert found.tested.q_vv.shape == (len(wanted), len(wanted))


def test_a_row_off_says_nothing_of_its_error() -> None:
    clean, wrong = measured(), measured(f4=(0.5, 0.0))
    off = {("4", "x")}
    one, other = (orient_inner(CAMERA, plate, off=off) for plate in (clean, wrong))
    assert {row.key for row in other.rows} == {row.key for row in one.rows}
    for a, b in zip(one.rows, other.rows, strict=True):
        # what lies half a millimetre aside is weighed at another place of the plate, that is all
        assert b.residual == pytest.approx(a.residual, abs=0.1)
    assert not other.flagged
    assert orient_inner(CAMERA, wrong).flagged[0].key == ("4", "x")


def test_the_transformation_follows_what_is_left() -> None:
    plate = measured()
    names = "12345678"
    five = {(name, axis) for name in names[5:] for axis in "xy"}
    assert orient_inner(CAMERA, plate, off=five).kind == "bilinear"
    assert orient_inner(CAMERA, plate, off=five | {("5", "x")}).kind == "affine"
    three = {(name, axis) for name in names[3:] for axis in "xy"}
    assert orient_inner(CAMERA, plate, off=three).kind == "helmert"
    with pytest.raises(NotComputableError, match="needs 3 fiducials, 2 measured"):
        orient_inner(CAMERA, plate, off=three | {("3", "x"), ("3", "y")})


def test_rows_that_leave_a_term_undetermined() -> None:
    off = {(name, "x") for name in "12345"}
    with pytest.raises(NotComputableError, match="undetermined"):
        orient_inner(CAMERA, measured(), transformation="bilinear", off=off)


def test_with_distances_only_a_fiducial_is_off_as_a_whole() -> None:
    distances = (FiducialDistance("5", "6", 226.0), FiducialDistance("8", "7", 226.0))
    camera = CameraCalibration("old", 152.4, distances=distances)
    plate = {name: xy for name, xy in measured().items() if name in "5678"}
    assert orient_inner(camera, plate).kind == "distances"
    with pytest.raises(ValueError, match="as a whole"):
        orient_inner(camera, plate, off={("5", "x")})
    with pytest.raises(NotComputableError, match="fiducial 5 is not measured"):
        orient_inner(camera, plate, off={("5", "x"), ("5", "y")})
