"""Common aerial cameras as their makers named them: nominal values, no calibration."""

from __future__ import annotations

from dataclasses import dataclass

from anaplot.photogrammetry.camera import CameraCalibration, Fiducial

__all__ = ["NOMINAL_CAMERAS", "NominalCamera"]

_FRAME = (230.0, 230.0)


@dataclass(frozen=True, slots=True)
class NominalCamera:
    """A type of camera.

    Attributes
    ----------
    id
        Short name.
    title
        Maker and type.
    c
        Nominal camera constant [mm].
    corners, sides
        Nominal distance [mm] of the fiducials in the corners and in the middles of the sides from
        the axes, or None where there are none or their nominal place is not known. Corners are
        1 to 4 from the lower right one clockwise, sides 5 to 8: left, right, upper, lower.
    """

    id: str
    title: str
    c: float
    corners: float | None = None
    sides: float | None = None

    def calibration(self) -> CameraCalibration:
        """Return the nominal values: no distortion, the principal point in the centre."""
        marks: list[Fiducial] = []
        if self.corners is not None:
            a = self.corners
            marks += [
                Fiducial("1", a, -a),
                Fiducial("2", -a, -a),
                Fiducial("3", -a, a),
                Fiducial("4", a, a),
            ]
        if self.sides is not None:
            b, first = self.sides, len(marks) + 1
            places = ((-b, 0.0), (b, 0.0), (0.0, b), (0.0, -b))
            marks += [Fiducial(str(first + k), x, y) for k, (x, y) in enumerate(places)]
        return CameraCalibration(self.id, self.c, format=_FRAME, fiducials=tuple(marks))


_ALL = (
    NominalCamera("rmk15", "Zeiss RMK A 15/23", 153.0, sides=113.0),
    NominalCamera("rmk8", "Zeiss RMK A 8.5/23", 85.0, sides=113.0),
    NominalCamera("rmk21", "Zeiss RMK A 21/23", 210.0, sides=113.0),
    NominalCamera("rmk30", "Zeiss RMK A 30/23", 305.0, sides=113.0),
    NominalCamera("rmk60", "Zeiss RMK A 60/23", 610.0, sides=113.0),
    NominalCamera("rc8", "Wild RC5, RC8, 15 cm", 152.0, corners=106.0),
    NominalCamera("rc10", "Wild RC10, 15 cm", 153.0, corners=106.0, sides=110.0),
    NominalCamera("rc10-9", "Wild RC10, 9 cm", 88.0, corners=106.0, sides=110.0),
    NominalCamera("rc10-21", "Wild RC10, 21 cm", 214.0, corners=106.0, sides=110.0),
    NominalCamera("rc10-30", "Wild RC10, 30 cm", 303.0, corners=106.0, sides=110.0),
    NominalCamera("rc30", "Wild RC20, Leica RC30, 15 cm", 153.0, corners=106.0, sides=110.0),
    NominalCamera("rc30-30", "Wild RC20, Leica RC30, 30 cm", 303.0, corners=106.0, sides=110.0),
    NominalCamera("mrb9", "Jena MRB 9/2323", 90.0),
    NominalCamera("mrb15", "Jena MRB 15/2323", 152.0),
    NominalCamera("mrb30", "Jena MRB 30/2323", 305.0),
    NominalCamera("lmk9", "Jena LMK 9/2323", 89.0),
    NominalCamera("lmk15", "Jena LMK 15/2323", 152.0),
    NominalCamera("lmk21", "Jena LMK 21/2323", 210.0),
    NominalCamera("lmk30", "Jena LMK 30/2323", 305.0),
)

NOMINAL_CAMERAS = {camera.id: camera for camera in _ALL}
"""Common cameras by their short names."""
