"""Measured fiducials of one or several photographs, as `anaplot inner` reads them.

    format = 1
    camera = "rmk.toml"        # the camera file, beside this one, or its absolute path
    sigma_um = 5.0             # a-priori standard deviation of a coordinate; this when left out
    [test]                     # as in block.toml; may be left out
    kind = "tau"
    [photo.101]                # plate coordinates [mm] of the fiducials of photo 101
    1 = [14.021, 226.110]
    2 = [226.017, 225.934]
    [photo.102]
    1 = [13.877, 226.240]

The fiducials' names are those of the camera file; a fiducial that was not measured is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from anaplot.exchange.blocktoml import read_test
from anaplot.exchange.camerafile import camera_path, read_camera
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.textfiles.kinds import PHOTO, POSITIVE, KnownName, Made, MapOf, Number, Numbers, Text
from anaplot.textfiles.tomltable import read_toml
from anaplot.textfiles.wording import quoted

__all__ = [
    "FIDUCIALS_FORMAT",
    "FiducialMeasurements",
    "PhotoFiducials",
    "read_fiducials",
]

FIDUCIALS_FORMAT = 1
_MAX_BYTES = 16_000_000

_PLATE = Number(-10_000.0, 10_000.0)  # mm; no plate carrier travels ten metres


@dataclass(frozen=True, slots=True)
class PhotoFiducials:
    """The measured fiducials of one photograph.

    Attributes
    ----------
    photo
        Its name.
    measured
        (fiducial, x, y), plate coordinates [mm], in file order.
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
    """

    camera: CameraCalibration
    camera_file: Path
    sigma_um: float
    test: TestSettings
    photos: tuple[PhotoFiducials, ...]


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
        {"camera": camera_file}, {"sigma_um": POSITIVE}, also=("format", "test", "photo")
    )
    test = read_test(root.table("test"))
    camera = read_camera(stated["camera"])
    known = camera.fiducial_names()
    if not known:
        raise root.fail(f"camera {quoted(camera.id)} states no fiducials", "camera")
    fiducial = KnownName(f"fiducial of camera {quoted(camera.id)}:", known)
    photos = root.optional("photo", MapOf(PHOTO, MapOf(fiducial, Numbers(2, _PLATE))), {})
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
    )
