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

Where there are many photos, `measured = "fiducials.csv"` names a table photo,fiducial,x,y instead
of the tables [photo.NAME]. The fiducials' names are those of the camera file; a fiducial that was
not measured is left out. Axes may lie in any direction, and y may run down, as it does in a scan.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blocktoml import read_test
from anaplot.exchange.camerafile import camera_path, read_camera
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.plateunits import MILLIMETRE, PLATE_UNITS, PlateUnit
from anaplot.textfiles.csvtable import read_csv
from anaplot.textfiles.kinds import (
    PHOTO,
    SIGMA,
    Fields,
    Kind,
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

Fail = Callable[[str, str], InputError]
_Places = Mapping[str, Mapping[str, tuple[float, ...]]]
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
    measured_file
        The table that holds the measured fiducials, where it is one of its own.
    """

    camera: CameraCalibration
    camera_file: Path
    sigma_um: float
    test: TestSettings
    photos: tuple[PhotoFiducials, ...]
    unit: PlateUnit = MILLIMETRE
    path: Path = field(default=Path(), compare=False)
    measured_file: Path | None = field(default=None, compare=False)
    _fail: Fail | None = field(default=None, repr=False, compare=False)

    def fail(self, photo: str, message: str) -> InputError:
        """Return the error about a photo's fiducials, with file and line."""
        if self._fail is None:
            return InputError(f"photo {quoted(photo)}: {message}")
        return self._fail(photo, message)


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
        {"sigma_um": SIGMA, "unit": Word(*PLATE_UNITS), "measured": camera_file},
        also=("format", "test", "photo"),
    )
    unit = PLATE_UNITS[stated.get("unit", MILLIMETRE.name)]
    test = read_test(root.table("test"))
    camera = read_camera(stated["camera"])
    known = camera.fiducial_names()
    if not known:
        raise root.fail(f"camera {quoted(camera.id)} states no fiducials", "camera")
    fiducial = KnownName(f"fiducial of camera {quoted(camera.id)}:", known)
    coordinate = Number(-unit.most, unit.most)
    if "measured" in stated and "photo" in root:
        raise root.fail("[photo] beside measured: only one of them", "photo")
    if "measured" in stated:
        photos, fail = _from_table(stated["measured"], fiducial, coordinate)
    else:
        photos, fail = _from_toml(root, fiducial, coordinate)
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
        measured_file=stated.get("measured"),
        _fail=fail,
    )


def _from_toml(
    root: TomlTable, fiducial: Kind[str], coordinate: Kind[float]
) -> tuple[_Places, Fail]:
    """Return the places of fiducials by photo, and what makes an error about a photo."""
    photos = root.optional("photo", MapOf(PHOTO, MapOf(fiducial, Numbers(2, coordinate))), {})
    if not photos:
        raise root.fail("no photo: tables [photo.NAME] hold the measured fiducials")
    for name, places in photos.items():
        if not places:
            raise root.fail("no fiducial is measured", "photo", name)
    return photos, lambda photo, message: root.fail(message, "photo", photo)


def _from_table(path: Path, fiducial: Kind[str], coordinate: Kind[float]) -> tuple[_Places, Fail]:
    kinds: Fields = {"photo": PHOTO, "fiducial": fiducial, "x": coordinate, "y": coordinate}
    table = read_csv(path, kinds)
    table.refuse_twice("fiducial", "photo")
    photos: dict[str, dict[str, tuple[float, ...]]] = {}
    first: dict[str, int] = {}
    for row, (photo, mark, x, y) in enumerate(zip(*(table[one] for one in kinds), strict=True)):
        photos.setdefault(photo, {})[mark] = x, y
        first.setdefault(photo, row)
    if not photos:
        raise table.fail(None, None, "no photo")
    return photos, lambda photo, said: table.fail(first[photo], f"photo {quoted(photo)}", said)
