"""Measured fiducials of one or several photographs, as `anaplot inner` reads them.

    format = 1
    camera = "rmk.toml"        # the camera file, beside this one, or its absolute path
    unit = "mm"                # of plate coordinates: mm, um, px, count; mm when left out
    sigma_um = 5.0             # a priori, of a coordinate in the image; this when left out
    [test]                     # as in block.toml; may be left out
    kind = "tau"
    [photo.101]                # plate coordinates of the fiducials of photo 101
    1 = [14.021, 226.110]
    2 = [226.017, 225.934]
    [photo.102]
    1 = [13.877, 226.240]

The fiducials' names are those of the camera file; a fiducial that was not measured is left out.
Axes may lie in any direction, and y may run down, as it does in a scan.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blocktoml import read_test
from anaplot.exchange.camerafile import camera_path, read_camera
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.plateunits import MILLIMETRE, PLATE_UNITS, PlateUnit
from anaplot.textfiles.kinds import (
    PHOTO,
    POSITIVE,
    KnownName,
    Made,
    MapOf,
    Number,
    Numbers,
    Text,
    Word,
)
from anaplot.textfiles.tomltable import TomlTable, read_toml
from anaplot.textfiles.wording import quoted

__all__ = [
    "FIDUCIALS_FORMAT",
    "FiducialMeasurements",
    "PhotoFiducials",
    "read_fiducials",
]

FIDUCIALS_FORMAT = 1
_MAX_BYTES = 16_000_000


@dataclass(frozen=True, slots=True)
class PhotoFiducials:
    """The measured fiducials of one photograph.

    Attributes
    ----------
    photo
        Its name.
    measured
        (fiducial, x, y), plate coordinates, in file order.
    """

    photo: str
    measured: tuple[tuple[str, float, float], ...]


@dataclass(frozen=True, slots=True)
class FiducialMeasurements:
    """A file of measured fiducials.

    Attributes
    ----------
    camera
        The camera of all photographs.
    camera_file
        Where it stands.
    sigma_um
        A-priori standard deviation [um] of a measured coordinate.
    test
        The test that flags.
    photos
        In file order.
    unit
        Of plate coordinates.
    path
        The file.
    """

    camera: CameraCalibration
    camera_file: Path
    sigma_um: float
    test: TestSettings
    photos: tuple[PhotoFiducials, ...]
    unit: PlateUnit = MILLIMETRE
    path: Path = field(default=Path(), compare=False)
    _root: TomlTable | None = field(default=None, repr=False, compare=False)

    def fail(self, photo: str, message: str) -> InputError:
        """Return the error about a photo's fiducials, with file and line."""
        if self._root is None:
            return InputError(f"photo {quoted(photo)}: {message}")
        return self._root.fail(message, "photo", photo)


def read_fiducials(path: Path) -> FiducialMeasurements:
    """Read a file of measured fiducials and the camera file that it names; nothing is written.

    Raises
    ------
    InputError
        Anything but complete measurements of format 1, with file, line and key.
    """
    root = read_toml(path, _MAX_BYTES)
    root.version(FIDUCIALS_FORMAT)
    camera_file = Made(Text(), partial(camera_path, path.parent))
    stated = root.take(
        {"camera": camera_file},
        {"sigma_um": POSITIVE, "unit": Word(*PLATE_UNITS)},
        also=("format", "test", "photo"),
    )
    unit = PLATE_UNITS[stated.get("unit", MILLIMETRE.name)]
    test = read_test(root.table("test"))
    camera = read_camera(stated["camera"])
    known = camera.fiducial_names()
    if not known:
        raise root.fail(f"camera {quoted(camera.id)} states no fiducials", "camera")
    fiducial = KnownName(f"fiducial of camera {quoted(camera.id)}:", known)
    plate = Numbers(2, Number(-unit.most, unit.most))
    photos = root.optional("photo", MapOf(PHOTO, MapOf(fiducial, plate)), {})
    if not photos:
        raise root.fail("no photo: tables [photo.NAME] hold the measured fiducials")
    for name, places in photos.items():
        if not places:
            raise root.fail("no fiducial is measured", "photo", name)
    return FiducialMeasurements(
        camera=camera,
        camera_file=stated["camera"],
        sigma_um=stated.get("sigma_um", Precision().image_um),
        test=test,
        photos=tuple(
            PhotoFiducials(name, tuple((mark, x, y) for mark, (x, y) in places.items()))
            for name, places in photos.items()
        ),
        unit=unit,
        path=path,
        _root=root,
    )
