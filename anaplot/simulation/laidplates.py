"""Photographs as they lie in a simulated plotter: distorted, shifted, turned, shrunk."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np

from anaplot.aliases import Side
from anaplot.errors import InputError
from anaplot.photogrammetry.airandearth import AirAndEarth
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.measuredimage import plate_calibration
from anaplot.photogrammetry.platetransformation import PlateTransformation, random_placement
from anaplot.photogrammetry.refinement import Refinement
from anaplot.planning.fiducialplan import expected_fiducials
from anaplot.planning.synthetic import Truth
from anaplot.plotter.device.hand import Photographs, fiducial_name

__all__ = ["SIDES", "Placements", "laid_photographs", "random_placements"]

Placements = Mapping[tuple[str, Side], PlateTransformation]
"""(photo, carriage) -> how the photo lies there: plate to fiducial system."""

SIDES: tuple[Side, Side] = ("left", "right")


def random_placements(block: Block, seed: int) -> dict[tuple[str, Side], PlateTransformation]:
    """Lay every photo that has fiducials as a hand would, differently in either carriage.

    Parameters
    ----------
    block
        For photos and cameras.
    seed
        The same seed gives the same placements.
    """
    out = {}
    for photo in block.photos:
        calibration = block.camera_of(photo.id).calibration
        if calibration is None or not calibration.fiducial_names():
            continue
        for side in SIDES:
            digest = hashlib.sha256(repr((seed, "placement", photo.id, side)).encode()).digest()
            out[photo.id, side] = random_placement(int.from_bytes(digest[:8], "big"))
    return out


def laid_photographs(
    block: Block, truth: Truth, placements: Placements
) -> tuple[Photographs, Photographs]:
    """Return what lies in the left and in the right carriage.

    Parameters
    ----------
    block
        For the cameras; photos that it does not know are taken as they are.
    truth
        True ideal image coordinates [mm] by photo and point.
    placements
        How photos lie; the others lie in the fiducial system.

    Returns
    -------
    Photographs, Photographs
        Plate coordinates [mm] by photo and point, fiducials among them.

    Raises
    ------
    InputError
        Fiducials whose place does not follow from calibrated distances.
    NotComputableError
        Points where the camera's distortion cannot be inverted.
    """
    cameras = {photo.id: plate_calibration(block, photo.id) for photo in block.photos}
    air = block.air
    left, right = (
        {
            photo: _laid(points, cameras.get(photo), air, placements.get((photo, side)), side)
            for photo, points in truth.items()
        }
        for side in SIDES
    )
    return left, right


def _laid(
    points: Mapping[str, tuple[float, float]],
    calibration: CameraCalibration | None,
    air: AirAndEarth | None,
    placement: PlateTransformation | None,
    side: Side,
) -> dict[str, tuple[float, float]]:
    if calibration is None:
        return dict(points)
    ideal = np.array(list(points.values()), dtype=np.float64).reshape(-1, 2)
    measured = Refinement.of(calibration, air, folds=True).distort(ideal)
    fiducials = expected_fiducials(calibration)
    unknown = [name for name in calibration.fiducial_names() if name not in fiducials]
    if unknown:
        raise InputError(
            f"camera {calibration.id}: its distances do not say where fiducial {unknown[0]} lies, "
            "so it cannot be simulated"
        )
    marks = np.array(list(fiducials.values()), dtype=np.float64).reshape(-1, 2)
    plate = (placement or PlateTransformation()).to_plate(np.concatenate((measured, marks)))
    names = [*points, *(fiducial_name(side, name) for name in fiducials)]
    return {name: (x, y) for name, (x, y) in zip(names, plate.tolist(), strict=True)}
