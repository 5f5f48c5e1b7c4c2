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
from pathlib import Path

from anaplot.exchange.blocktoml import read_test
from anaplot.exchange.camerafile import camera_path, read_camera
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.textfiles.inputfile import read_text
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.tomlfile import TomlFile, TomlTable
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "FIDUCIALS_FORMAT",
    "MAX_FIDUCIALS_BYTES",
    "FiducialMeasurements",
    "PhotoFiducials",
    "parse_fiducials",
    "read_fiducials",
]

FIDUCIALS_FORMAT = 1
MAX_FIDUCIALS_BYTES = 16_000_000

_FARTHEST = 10_000.0  # mm; no plate carrier travels ten metres


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
    sigma_um
        A-priori standard deviation [um] of a measured coordinate.
    test
        The test that flags.
    photos
        In file order.
    """

    camera: CameraCalibration
    sigma_um: float
    test: TestSettings
    photos: tuple[PhotoFiducials, ...]


def read_fiducials(path: Path) -> FiducialMeasurements:
    """Read a file of measured fiducials and the camera file that it names; nothing is written.

    Raises
    ------
    InputError
        The first thing that is wrong, with file, line and key.
    """
    return parse_fiducials(read_text(path, MAX_FIDUCIALS_BYTES), path)


def parse_fiducials(text: str, path: Path) -> FiducialMeasurements:
    """Return the measurements that a text holds.

    Parameters
    ----------
    text
        Content of the file.
    path
        Its name, for messages, and where the camera file is looked for.

    Raises
    ------
    InputError
        Anything but complete measurements of format 1, with file, line and key.
    """
    root = TomlFile(path, text).root
    root.version(FIDUCIALS_FORMAT)
    root.only("format", "camera", "sigma_um", "test", "photo")
    sigma_um = root.positive("sigma_um", Precision().image_um)
    test = read_test(root.table("test", "[test]"))
    try:
        camera_file = camera_path(path.parent, root.text("camera"))
    except ValueError as error:
        raise root.fail("camera", f"camera: {error}") from None
    camera = read_camera(camera_file)
    if not camera.fiducial_names():
        raise root.fail("camera", f"camera {quoted(camera.id)} states no fiducials")
    photos = root.table("photo", "[photo]")
    if not photos.key_names():
        raise root.fail(None, "no photo: tables [photo.NAME] hold the measured fiducials")
    return FiducialMeasurements(
        camera=camera,
        sigma_um=sigma_um,
        test=test,
        photos=tuple(_photo(photos, name, camera) for name in photos.key_names()),
    )


def _photo(photos: TomlTable, name: str, camera: CameraCalibration) -> PhotoFiducials:
    fault = name_fault(name, photo=True)
    if fault is not None:
        raise photos.fail(name, f"photo: the name {quoted(name)} {fault}")
    title = f"photo {quoted(name)}"
    table = photos.table(name, title)
    known = camera.fiducial_names()
    measured = []
    for fiducial in table.key_names():
        if fiducial not in known:
            raise table.fail(
                fiducial,
                f"{title}: camera {quoted(camera.id)} has no fiducial {quoted(fiducial)}"
                + hint(fiducial, known),
            )
        x, y = table.numbers(fiducial, 2)
        if abs(x) > _FARTHEST or abs(y) > _FARTHEST:
            raise table.fail(
                fiducial,
                f"{title}: fiducial {quoted(fiducial)} lies further off than {_FARTHEST:g} mm",
            )
        measured.append((fiducial, x, y))
    if not measured:
        raise photos.fail(name, f"{title}: no fiducial is measured")
    return PhotoFiducials(name, tuple(measured))
