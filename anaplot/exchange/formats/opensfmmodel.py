"""What an OpenSfM reconstruction holds: cameras, poses, and the tracks of its points.

Image coordinates there are divided by the larger side of the image and have their origin in its
middle, y down; a shot's rotation (an axis times its angle) and translation take the world to the
camera, x right, y down, z forward. The world is east, north, up at the place of reference_lla.json.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.boundedjson import JsonPlace, read_json
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.photogrammetry.block import Camera, in_pixels
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.rotation import rotation_angles, turn
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import place, quoted

__all__ = [
    "MAX_SIDE",
    "Reconstruction",
    "Shot",
    "TrackRow",
    "camera_of",
    "read_reconstructions",
    "read_reference",
    "shown_pixels",
    "track_rows",
    "unheld_model",
]

MAX_SIDE = 10**6  # px
_LENSES = ("perspective", "brown", "simple_radial", "radial", "pinhole")
_VERSION = "OPENSFM_TRACKS_VERSION_v"
_NO_POSITION = 999_999.0  # gps_dop of a photo that has none
_COLUMNS = {0: 8, 1: 9, 2: 11}  # image, track, feature, x, y, [scale], r, g, b, [labels]


class Shot(NamedTuple):
    """A photo with its pose.

    Attributes
    ----------
    name, camera
        Names.
    centre
        Projection centre [m], east, north, up.
    rotation
        omega, phi, kappa [rad] of this program's rotation.
    measured
        Position measured in flight [m], east, north, up; None where there is none.
    """

    name: str
    camera: str
    centre: tuple[float, float, float]
    rotation: tuple[float, float, float]
    measured: tuple[float, float, float] | None


class Reconstruction(NamedTuple):
    """One of the reconstructions of a file.

    Attributes
    ----------
    cameras
        As the file has them, by name.
    shots
        Photos that have a pose.
    points
        Names of the points.
    reference
        Longitude, latitude [degrees] and height [m] of its origin, where it says so.
    """

    cameras: Mapping[str, JsonPlace]
    shots: tuple[Shot, ...]
    points: frozenset[str]
    reference: tuple[float, float, float] | None


class TrackRow(NamedTuple):
    """A row of tracks.csv: a feature of an image, and the track (point) that it belongs to."""

    line: SourceLine
    image: str
    track: str

    def at(self) -> tuple[float, float]:
        """Return x, y as the file has them; raises InputError."""
        fields = self.line.text.split("\t")
        return self.line.number_of(fields[3], "x"), self.line.number_of(fields[4], "y")


def read_reconstructions(path: Path) -> tuple[Reconstruction, ...]:
    """Return the reconstructions of a reconstruction.json; raises InputError."""
    found = tuple(_reconstruction(one) for one in read_json(path).elements())
    if not found:
        raise InputError(f"{place(path)}: no reconstruction")
    return found


def read_reference(path: Path) -> tuple[float, float, float] | None:
    """Return longitude, latitude [degrees] and height [m] of reference_lla.json.

    None where they are zeros, which OpenSfM writes without any position.
    """
    return _reference(read_json(path, 100_000))


def _reference(found: JsonPlace) -> tuple[float, float, float] | None:
    place_of_it = (
        found.get("longitude").number(-360.0, 360.0),
        found.get("latitude").number(-90.0, 90.0),
        found.get("altitude").number(-1e5, 1e7),
    )
    return place_of_it if any(place_of_it) else None


def _reconstruction(found: JsonPlace) -> Reconstruction:
    cameras = dict(found.get("cameras").items())
    shots = tuple(_shot(name, one, cameras) for name, one in found.get("shots").items())
    # old files have the origin in reference_lla.json only
    reference = _reference(found.get("reference_lla")) if "reference_lla" in found else None
    return Reconstruction(cameras, shots, found.get("points").names(), reference)


def _shot(name: str, found: JsonPlace, cameras: Mapping[str, JsonPlace]) -> Shot:
    fault = name_fault(name)
    if fault is not None:
        raise found.fail(f"the image name {quoted(name)} {fault}")
    camera = found.get("camera").checked("camera", lambda text: None)
    if camera not in cameras:
        raise found.fail(f"no camera {quoted(camera)}")
    rotation = turn(*(found.get("rotation").vector()))
    shift = np.array(found.get("translation").vector())
    x, y, z = (-rotation.T @ shift).tolist()
    ours = rotation.T @ np.diag([1.0, -1.0, -1.0])
    measured = None
    if "gps_position" in found and found.optional("gps_dop") < _NO_POSITION:
        east, north, up = found.get("gps_position").vector()
        measured = (east, north, up)
    return Shot(name, camera, (x, y, z), rotation_angles(ours), measured)


def unheld_model(found: JsonPlace) -> str | None:
    """Return the camera model where a lens of ours does not hold it; raises InputError."""
    model = found.get("projection_type").checked("projection type", name_fault)
    return None if model in _LENSES else model


def camera_of(name: str, found: JsonPlace, pixel_um: float | None) -> Camera:
    """Return a camera of ours; its lens holds the model exactly.

    Parameters
    ----------
    name
        What it is to be called.
    found
        The camera in the file, of a model that `unheld_model` knows.
    pixel_um
        Size of a pixel [um], or None.

    Raises
    ------
    InputError
        A number is missing, or none.
    """
    width, height = _side(found, "width"), _side(found, "height")
    size = float(max(width, height))
    if "focal" in found:
        fx = fy = size * found.get("focal").number(1e-3, 1e3)
    else:
        fx = size * found.get("focal_x").number(1e-3, 1e3)
        fy = size * found.get("focal_y").number(1e-3, 1e3)
    cx, cy = found.optional("c_x"), found.optional("c_y")
    k1, k2, k3, p1, p2 = (found.optional(key) for key in ("k1", "k2", "k3", "p1", "p2"))
    lens = BrownLens(k1=k1, k2=k2, k3=k3, p1=p1, p2=p2, b1=fx / fy - 1.0)
    c = fy * (1.0 if pixel_um is None else pixel_um) / 1000.0
    principal = (0.5 * width + size * cx, 0.5 * height + size * cy)
    held = lens if any(lens.coefficients) else None
    return in_pixels(Camera(name, c, lens=held), (width, height), pixel_um, principal)


def _side(found: JsonPlace, key: str) -> int:
    value = found.get(key).number(1.0, MAX_SIDE)
    if value != int(value):
        raise found.fail(f"{key} must be a whole number, not {value:g}")
    return int(value)


def shown_pixels(camera: Camera, normalized: Array) -> Array:
    """Return (n, 2) pixels from the upper left corner of (n, 2) coordinates of OpenSfM."""
    width, height = camera.pixels or (0, 0)
    out: Array = normalized * float(max(width, height)) + (0.5 * width, 0.5 * height)
    return out


def track_rows(path: Path) -> Iterator[TrackRow | SourceLine]:
    """Yield the rows of tracks.csv; a line that is none (the version) as it stands.

    Raises
    ------
    InputError
        It cannot be read, is of an unknown version, or a row has too few fields.
    """
    fields = _COLUMNS[0]
    for line in source_lines(path):
        if line.number == 1 and line.text.startswith(_VERSION):
            version = line.text.removeprefix(_VERSION).rstrip()
            if version not in ("1", "2"):
                raise line.fail(f"tracks of version {quoted(version)}: 0, 1 and 2 are read")
            fields = _COLUMNS[int(version)]
            yield line
        elif not line.text.strip():
            yield line
        else:
            parts = line.text.split("\t", 2)
            count = line.text.count("\t") + 1
            if count < fields:
                raise line.fail(f"{count} fields between tabulators, not {fields}")
            yield TrackRow(line, parts[0], parts[1])
