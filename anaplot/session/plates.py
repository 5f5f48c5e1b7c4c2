"""From the plotter's plates to the photographs' ideal image systems, and back.

Plate to ideal image is the accepted inner orientation and then the camera's refinement. A photo
whose camera states neither calibration nor lens lies in the image system, and where there are no
fiducials plate and fiducial system are the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from anaplot.aliases import Array, Side
from anaplot.photogrammetry.airandearth import AirAndEarth
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.measuredimage import COMPUTED_DIGITS, plate_calibration
from anaplot.photogrammetry.platetransformation import PlateTransformation
from anaplot.photogrammetry.readings import Position
from anaplot.photogrammetry.refinement import Refinement
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState

__all__ = [
    "IN_IMAGE",
    "PlateSystem",
    "Plates",
    "ReadOut",
    "image_of",
    "plate_of",
    "plates_of",
    "plates_of_model",
]


@dataclass(frozen=True, slots=True)
class ReadOut:
    """The live read-out: image coordinates [mm], parallaxes px = x' - x'', py = y' - y'' [mm].

    `plate_left` and `plate_right` say that the coordinates of that photo are plate coordinates,
    for its inner orientation is still to be accepted; parallaxes mean nothing then. `mono`: both
    are those of the one photo in a mono comparator.
    """

    xl: float
    yl: float
    xr: float
    yr: float
    plate_left: bool = False
    plate_right: bool = False
    mono: bool = False

    @property
    def px(self) -> float:
        """x-parallax [mm]."""
        return self.xl - self.xr

    @property
    def py(self) -> float:
        """y-parallax [mm]."""
        return self.yl - self.yr


@dataclass(frozen=True, slots=True)
class PlateSystem:
    """How plate coordinates of one carriage become image coordinates.

    Attributes
    ----------
    transformation
        Plate to fiducial system; None where the inner orientation is still to be accepted.
    calibration
        Of the camera, or its lens alone; None where plate coordinates are image coordinates.
    air
        What of air and earth is taken off, or None.
    """

    transformation: PlateTransformation | None = field(default_factory=PlateTransformation)
    calibration: CameraCalibration | None = None
    air: AirAndEarth | None = None

    @property
    def oriented(self) -> bool:
        """Whether image coordinates can be had; plate coordinates stay what they are if not."""
        return self.transformation is not None

    def to_image(self, x: float, y: float) -> tuple[float, float]:
        """Return image coordinates [mm] of plate coordinates [mm]."""
        if self.transformation is None or self.calibration is None:
            return x, y
        return self.to_images(np.array([[x, y]]))[0]

    def to_images(self, plate: Array) -> list[tuple[float, float]]:
        """Return image coordinates [mm] of (n, 2) plate coordinates."""
        if self.transformation is None or self.calibration is None:
            return [(x, y) for x, y in plate.tolist()]
        measured = self.transformation.to_image(plate)
        ideal = _refinement(self.calibration, self.air).refine(measured).tolist()
        return [(round(x, COMPUTED_DIGITS), round(y, COMPUTED_DIGITS)) for x, y in ideal]

    def to_plate(self, x: float, y: float) -> tuple[float, float]:
        """Return plate coordinates [mm] of image coordinates [mm].

        Raises
        ------
        NotComputableError
            Image coordinates to which no place of the plate belongs.
        """
        if self.transformation is None or self.calibration is None:
            return x, y
        measured = _refinement(self.calibration, self.air).distort(np.array([[x, y]]))
        plate = self.transformation.to_plate(measured)[0].tolist()
        return plate[0], plate[1]


@lru_cache(maxsize=64)
def _refinement(calibration: CameraCalibration, air: AirAndEarth | None) -> Refinement:
    return Refinement.of(calibration, air, folds=True)


@dataclass(frozen=True, slots=True)
class Plates:
    """Both carriages; of a mono comparator (`mono`) the one, twice."""

    left: PlateSystem = field(default_factory=PlateSystem)
    right: PlateSystem = field(default_factory=PlateSystem)
    mono: bool = False


IN_IMAGE = Plates()
"""Plates that lie in the image system."""


def plates_of(state: SessionState) -> Plates:
    """Return how plate coordinates become image coordinates in a session's present state."""
    return IN_IMAGE if state.current is None else plates_of_model(state, state.current)


def plates_of_model(state: SessionState, model: ModelState) -> Plates:
    """Return how plate coordinates become image coordinates while a model is in the instrument."""

    def system(photo: str, side: Side) -> PlateSystem:
        inner = model.inner_of(side)
        transformation = PlateTransformation() if inner is None else inner.accepted
        return PlateSystem(transformation, plate_calibration(state.block, photo), state.block.air)

    if model.mono:
        there = system(model.photo(model.laid or "left"), model.laid or "left")
        return Plates(there, there, mono=True)
    return Plates(system(model.left, "left"), system(model.right, "right"))


def image_of(position: Position, plates: Plates = IN_IMAGE) -> ReadOut:
    """Return image coordinates [mm] of plate coordinates.

    In a carriage without inner orientation they are still plate coordinates, and said to be.
    """
    return ReadOut(
        *plates.left.to_image(position.xl, position.yl),
        *plates.right.to_image(position.xr, position.yr),
        plate_left=not plates.left.oriented,
        plate_right=not plates.right.oriented,
        mono=plates.mono,
    )


def plate_of(xl: float, yl: float, xr: float, yr: float, plates: Plates = IN_IMAGE) -> Position:
    """Return plate coordinates of image coordinates [mm], the inverse of `image_of`.

    Raises
    ------
    NotComputableError
        Image coordinates to which no place of a plate belongs.
    """
    return Position(*plates.left.to_plate(xl, yl), *plates.right.to_plate(xr, yr))
