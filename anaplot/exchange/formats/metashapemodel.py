"""What Metashape says of sensors and poses, in conventions of a block's own.

With x, y the ideal coordinates, x to the right and y down, and r^2 = x^2 + y^2, the manual has

    x' = x (1 + K1 r^2 + K2 r^4 + K3 r^6 + K4 r^8) + P1 (r^2 + 2 x^2) + 2 P2 x y
    y' = y (1 + K1 r^2 + K2 r^4 + K3 r^6 + K4 r^8) + P2 (r^2 + 2 y^2) + 2 P1 x y
    u = w / 2 + c_x + x' f + x' B1 + y' B2,   v = h / 2 + c_y + y' f

with the centre of the upper left pixel at (0.5, 0.5): P1 and P2 are p2 and p1 of OPENCV. A camera's
transform takes its axes (x right, y down, z forwards) to the chunk, and the chunk's or component's
one takes the chunk to geocentric coordinates, or to local ones where the chunk's system is local.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.exchange.camerafile import MAX_PIXELS
from anaplot.exchange.formats.colmapcamera import (
    magnification,
    undistorted,
    undistorted_spread,
)
from anaplot.exchange.formats.xmlstream import Element
from anaplot.photogrammetry.block import Camera, in_pixels
from anaplot.photogrammetry.camera import BrownLens, pixel_size
from anaplot.photogrammetry.rotation import is_rotation
from anaplot.textfiles.wording import quoted

__all__ = ["Sensor", "Similarity", "matrix_of", "sensor_of", "similarity_of", "system_of"]

_LAST_NUMBER: Final = re.compile(r'AUTHORITY\["(EPSG)","([0-9]{1,6})"\]\]\s*$')
_TURN: Final = np.diag((1.0, -1.0, -1.0))


class Sensor(NamedTuple):
    """A sensor.

    Attributes
    ----------
    camera
        Its camera; without a lens where measured pixels become those of a pinhole camera.
    radial, tangential
        K1 to K4, and p1, p2 as OPENCV has them, where our lens does not hold them; else none.
    rolling
        Whether it has a rolling shutter.
    initial
        Whether there is no adjusted calibration, so that it has the one that was stated at first.
    """

    camera: Camera
    radial: tuple[float, ...]
    tangential: tuple[float, float]
    rolling: bool
    initial: bool = False

    def pinhole(self, pixels: Array) -> tuple[Array, Array]:
        """Return (n, 2) pixels as a pinhole camera had measured them; NaN where nothing is.

        Beside them by how much (n,) their errors are larger there.
        """
        if not self.radial:
            return pixels, np.ones(len(pixels))
        principal = np.array(self.camera.principal_px)
        focal = self.camera.c / self.camera.pixel_mm
        lens = self.camera.lens or BrownLens()
        affine = np.array([[1.0 + lens.b1, -lens.b2], [0.0, 1.0]])
        measured = (pixels - principal) / focal @ np.linalg.inv(affine).T
        bent = undistorted(measured, self.radial, *self.tangential)
        spread = undistorted_spread(bent, self.radial, *self.tangential)
        return principal + focal * bent @ affine.T, magnification(spread, affine)


class Similarity(NamedTuple):
    """Scale, rotation (3, 3) and translation (3,) from chunk to world."""

    scale: float
    rotation: Array
    translation: Array


def sensor_of(found: Element, name: str) -> Sensor:
    """Return what a sensor says; raises InputError for what is missing or not read."""
    kind = found.attributes.get("type", "frame")
    if kind != "frame":
        raise found.at.fail(f"sensor type {quoted(kind)}: only frame is read")
    stated = [one for one in found.children if one.name == "calibration"]
    adjusted = [one for one in stated if one.attributes.get("class") == "adjusted"]
    if not stated:
        raise found.at.fail(f"sensor {quoted(name)} has no calibration")
    calibration = (adjusted or stated)[0]
    if calibration.attributes.get("type", "frame") != "frame":
        raise calibration.at.fail("only the calibration of a frame camera is read")
    size = calibration.child("resolution") or found.child("resolution")
    if size is None:
        raise found.at.fail(f"sensor {quoted(name)} has no resolution")
    width, height = (
        size.at.whole_of(size.attribute(key), key, 1, MAX_PIXELS) for key in ("width", "height")
    )
    value = {key: calibration.number(key) or 0.0 for key in _NUMBERS}
    focal = value["f"] or value["fy"]
    if not 1e-3 < focal < 1e9:
        raise calibration.at.fail(f"f must be positive, not {focal:g}")
    b1 = (value["b1"] if value["f"] else value["fx"] - focal) / focal
    b2 = -(value["b2"] or value["skew"]) / focal
    if not abs(b1) < 0.5:
        raise calibration.at.fail(f"B1 of {b1 * focal:g} px")
    for key in ("p3", "p4"):
        if value[key]:
            raise calibration.at.fail(f"{key} is not 0: it is not read")
    k = tuple(value[key] for key in ("k1", "k2", "k3", "k4"))
    p1, p2 = value["p2"], value["p1"]
    lens = BrownLens(0.0, 0.0, 0.0, 0.0, 0.0, b1, b2)
    if not k[3]:
        lens = BrownLens(k[0], k[1], k[2], p1, p2, b1, b2)
    pixel_mm = _pixel(found)
    pixel_um = None if pixel_mm is None else round(pixel_mm * 1e3, 12)
    camera = in_pixels(
        Camera(name, focal * pixel_size(pixel_um), lens=lens if any(lens.coefficients) else None),
        (width, height),
        pixel_um,
        (width / 2.0 + value["cx"], height / 2.0 + value["cy"]),
    )
    mode = found.value("rolling_shutter") or found.value("rolling_shutter_mode") or "false"
    rolling = mode.lower() not in ("false", "disabled", "0")
    return Sensor(camera, k if k[3] else (), (p1, p2), rolling, not adjusted)


_NUMBERS: Final = (
    *("f", "fx", "fy", "cx", "cy", "b1", "b2", "skew", "k1", "k2", "k3", "k4"),
    *("p1", "p2", "p3", "p4"),
)


def _pixel(found: Element) -> float | None:
    """Return the size of a pixel [mm], where it is stated and square."""
    sizes = {
        one.attributes.get("name"): one.at.number_of(one.attribute("value"), "value")
        for one in found.children
        if one.name == "property" and one.attributes.get("name") in ("pixel_width", "pixel_height")
    }
    size = sizes.get("pixel_width", 0.0)
    return size if 1e-6 < size < 10.0 and sizes.get("pixel_height", size) == size else None


def matrix_of(found: Element) -> tuple[Array, Array]:
    """Return (3, 3) our rotation from image to chunk, and (3,) the centre of a camera's transform.

    Raises
    ------
    InputError
        It is no rotation and translation.
    """
    cells = _numbers(found, 16).reshape(4, 4)
    rotation = cells[:3, :3]
    if not is_rotation(rotation):
        raise found.at.fail("the matrix is no rotation")
    if not np.array_equal(cells[3], (0.0, 0.0, 0.0, 1.0)):
        raise found.at.fail("the transform's last row is not 0 0 0 1")
    return rotation @ _TURN, cells[:3, 3]


def similarity_of(found: Element | None) -> Similarity | None:
    """Return a chunk's or component's transform; None where it has none."""
    if found is None or found.child("rotation") is None:
        return None
    parts = {key: found.child(key) for key in ("rotation", "translation", "scale")}
    numbers = {}
    for key, count in (("rotation", 9), ("translation", 3), ("scale", 1)):
        part = parts[key]
        if part is None:
            raise found.at.fail(f"the transform has no {key}")
        numbers[key] = _numbers(part, count)
    rotation = numbers["rotation"].reshape(3, 3)
    if not is_rotation(rotation):
        raise found.at.fail("the matrix is no rotation")
    scale = float(numbers["scale"][0])
    if not 1e-12 < scale < 1e12:
        raise found.at.fail(f"a scale of {scale:g}")
    return Similarity(scale, rotation, numbers["translation"])


def _numbers(found: Element, count: int) -> Array:
    words = found.text.split()
    if len(words) != count:
        raise found.at.fail(f"<{found.name}> has {len(words)} numbers, not {count}")
    return np.array(found.at.numbers_of(words, found.name))


def system_of(text: str) -> str | None:
    """Return the coordinate system that a chunk's reference names.

    Returns
    -------
    str or None
        "EPSG:number" of the whole definition, "" for a local one, None for any other.
    """
    words = text.strip()
    if not words or words.upper().startswith("LOCAL_CS"):
        return ""
    found = _LAST_NUMBER.search(words[-200:])
    return None if found is None else f"EPSG:{found[2]}"
