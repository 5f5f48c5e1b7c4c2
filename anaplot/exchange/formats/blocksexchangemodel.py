"""What a BlocksExchange file says of cameras and poses, in conventions of a block's own.

Pixels of the file have their origin at the centre of the upper left pixel. With u, v the ideal
coordinates, x to the right and y down, and r^2 = u^2 + v^2, Bentley documents

    u' = u (1 + K1 r^2 + K2 r^4 + K3 r^6) + 2 P2 u v + P1 (r^2 + 2 u^2)
    v' = v (1 + K1 r^2 + K2 r^4 + K3 r^6) + 2 P1 u v + P2 (r^2 + 2 v^2)
    x = f u' + skew v' + c_x,   y = f aspect v' + c_y :

P1 and P2 are p2 and p1 of OPENCV. A rotation takes world to camera coordinates, whose axes the
CameraOrientation names; omega, phi and kappa make R1(omega) R2(phi) R3(kappa) of its transpose.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Final, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.exchange.camerafile import MAX_PIXELS
from anaplot.exchange.formats.sourcelines import SourceLine
from anaplot.exchange.formats.xmlstream import Element
from anaplot.photogrammetry.block import Camera, in_pixels
from anaplot.photogrammetry.camera import BrownLens, pixel_size
from anaplot.photogrammetry.rotation import is_rotation, rotation_angles, rotation_matrix
from anaplot.textfiles.wording import quoted

__all__ = ["HALF", "ORIENTATIONS", "Group", "Place", "group_of", "position_of", "rotation_of"]

HALF: Final = 0.5
"""px between the centre of the corner pixel and its corner."""

_AXES: Final = {"Right": (1.0, 0.0), "Left": (-1.0, 0.0), "Down": (0.0, 1.0), "Up": (0.0, -1.0)}
ORIENTATIONS: Final = tuple(
    f"X{x}Y{y}"
    for x in _AXES
    for y in _AXES
    if (x in ("Right", "Left")) != (y in ("Right", "Left"))
)
"""CameraOrientation: which way x and y point."""


class Place(NamedTuple):
    """Where something is in an image.

    Attributes
    ----------
    at
        Its line.
    x, y
        Pixels from the centre of the upper left one, or mm from the principal point.
    mm
        Which of the two.
    """

    at: SourceLine
    x: float
    y: float
    mm: bool

    @classmethod
    def of(cls, found: Element) -> Place:
        """Return what a Measurement or PrincipalPoint says; raises InputError."""
        x, y = found.number("x"), found.number("y")
        if x is not None and y is not None:
            return cls(found.at, x, y, False)
        if found.child("xmm") is None and found.child("ymm") is None:
            raise found.at.fail(f"<{found.name}> has no x and y")
        return cls(found.at, found.needed_number("xmm"), found.needed_number("ymm"), True)


class Group(NamedTuple):
    """A Photogroup.

    Attributes
    ----------
    camera
        Its camera.
    axes
        (2, 2): columns are its x and y in an image with x to the right and y down.
    skewed
        Whether it has a skew.
    """

    camera: Camera
    axes: Array
    skewed: bool

    def pixel(self, at: Place) -> tuple[float, float]:
        """Return pixels from the upper left corner; raises InputError for mm of unknown pixels."""
        if not at.mm:
            return at.x + HALF, at.y + HALF
        if self.camera.pixel_um is None:
            raise at.at.fail("xmm and ymm, but nothing says how large a pixel is")
        with np.errstate(over="ignore"):  # it lies outside then
            away = self.axes @ (at.x, at.y) / self.camera.pixel_mm
        cx, cy = self.camera.principal_px or (0.0, 0.0)
        return cx + float(away[0]), cy + float(away[1])


def group_of(found: Element, name: str) -> Group:
    """Return what a Photogroup says of its camera.

    Raises
    ------
    InputError
        Something is missing, or the camera is none that is known.
    """
    model = found.value("CameraModelType") or "Perspective"
    if model != "Perspective":
        raise found.at.fail(f"camera model {quoted(model)}: only Perspective is read")
    size = []
    for key in ("Width", "Height"):
        text = found.needed("ImageDimensions", key)
        size.append(found.at.whole_of(text, key, 1, MAX_PIXELS))
    width, height = size
    word = found.value("CameraOrientation") or "XRightYDown"
    if word not in ORIENTATIONS:
        known = ", ".join(ORIENTATIONS)
        raise found.at.fail(f"CameraOrientation {quoted(word)}: none of {known}")
    x, y = word[1:].split("Y")
    axes = np.array((_AXES[x], _AXES[y])).T
    pixel_mm = _positive(found, "PixelSize")
    sensor = _positive(found, "SensorSize")
    if pixel_mm is None and sensor is not None:
        pixel_mm = sensor / max(width, height)
    focal = _positive(found, "FocalLengthPixels")
    if focal is None:
        mm = _positive(found, "FocalLength")
        if mm is None or pixel_mm is None:
            raise found.at.fail("neither FocalLengthPixels, nor FocalLength with SensorSize")
        focal = mm / pixel_mm
    aspect = _positive(found, "AspectRatio") or 1.0
    skew = found.number("Skew") or 0.0
    # not 1000 * pixel_mm: 0.0024 mm are 2.4 um and not 2.4000000000000004
    pixel_um = None if pixel_mm is None else round(pixel_mm * 1e3, 12)
    k1, k2, k3, p1, p2 = (found.number("Distortion", key) or 0.0 for key in _COEFFICIENTS)
    b1, b2 = 1.0 / aspect - 1.0, -skew / (focal * aspect)
    lens = BrownLens(k1, k2, k3, p2, p1, b1, b2)
    c = focal * aspect * pixel_size(pixel_um)
    camera = in_pixels(
        Camera(name, c, lens=lens if any(lens.coefficients) else None),
        (width, height),
        pixel_um,
        (width / 2.0, height / 2.0),
    )
    middle = Group(camera, axes, skew != 0.0)
    principal = found.child("PrincipalPoint")
    if principal is None:
        return middle
    # in mm it counts from the middle of the sensor
    return middle._replace(camera=replace(camera, principal_px=middle.pixel(Place.of(principal))))


_COEFFICIENTS: Final = ("K1", "K2", "K3", "P1", "P2")


def _positive(found: Element, name: str) -> float | None:
    value = found.number(name)
    if value is not None and not 1e-9 < value < 1e9:
        raise found.at.fail(f"{name} must be positive, not {value:g}")
    return value


def rotation_of(pose: Element, axes: Array) -> tuple[float, float, float] | None:
    """Return omega, phi, kappa [rad] of our rotation from image to object.

    Parameters
    ----------
    pose
        Of a photo.
    axes
        Of its group.

    Returns
    -------
    tuple or None
        None where there is none, or only yaw, pitch and roll.

    Raises
    ------
    InputError
        A matrix that is no rotation.
    """
    found = pose.child("Rotation")
    if found is None:
        return None
    if found.child("M_00") is not None:
        matrix = np.array([[found.needed_number(f"M_{i}{j}") for j in range(3)] for i in range(3)])
        if not is_rotation(matrix):
            raise found.at.fail("the matrix is no rotation")
    elif found.child("Omega") is not None:
        angles = [radians(found.needed_number(key)) for key in ("Omega", "Phi", "Kappa")]
        matrix = rotation_matrix(*angles).T
    else:
        return None
    return rotation_angles(_turn(axes).dot(matrix).T)


def _turn(axes: Array) -> Array:
    """Return (3, 3): from camera axes as a group names them to our image axes."""
    camera = np.zeros((3, 3))
    camera[:2, :2] = axes
    camera[2, 2] = np.linalg.det(axes)
    out: Array = np.diag((1.0, -1.0, -1.0)) @ camera
    return out


def position_of(found: Element | None) -> tuple[float, float, float] | None:
    """Return x, y, z of a Center or a Position; raises InputError where one is missing."""
    if found is None:
        return None
    x, y, z = (found.needed_number(key) for key in "xyz")
    return x, y, z
