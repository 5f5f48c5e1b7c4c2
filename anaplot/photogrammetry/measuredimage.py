"""What is measured in an image - pixels, or mm through a lens - and ideal image coordinates.

Pixels have their origin at the upper left corner of the upper left pixel, and y down; measured
coordinates in mm have it at the principal point, and y up; ideal ones are those in which a ray is
(x, y, -c) (conventions, Pixels).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.photogrammetry.block import Block, Camera, ImagePoint
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.lens import lens_places, without_lens
from anaplot.photogrammetry.planar import as_points
from anaplot.photogrammetry.pointcolumns import Coded, PointColumns

__all__ = [
    "COMPUTED_DIGITS",
    "computed_place",
    "first_beyond_reach",
    "has_lens",
    "ideal_rays",
    "measured_places",
    "measured_rays",
    "mm_of_pixels",
    "pixels_of_mm",
    "plate_calibration",
    "rows_by_camera",
]

COMPUTED_DIGITS = 7
"""Decimals of computed image coordinates [mm].

Far below what any instrument resolves, and above what the arithmetic of different machines leaves
uncertain: a replay finds the same coordinates to the last digit.
"""

Pairs: TypeAlias = "Sequence[tuple[float, float]] | Array"


def has_lens(camera: Camera) -> bool:
    """Return whether measured coordinates of a camera are not ideal ones."""
    return camera.lens is not None and any(camera.lens.coefficients)


def mm_of_pixels(camera: Camera, pixels: Pairs) -> Array:
    """Return (n, 2) measured coordinates [mm] of (n, 2) pixels.

    Raises
    ------
    ValueError
        The camera has no pixels.
    """
    away = as_points(np.asarray(pixels)) - _principal(camera)
    out: Array = away * (camera.pixel_mm, -camera.pixel_mm)
    return out


def pixels_of_mm(camera: Camera, measured: Pairs) -> Array:
    """Return (n, 2) pixels of (n, 2) measured coordinates [mm]; raises as `mm_of_pixels`."""
    away = as_points(np.asarray(measured)) / (camera.pixel_mm, -camera.pixel_mm)
    out: Array = away + _principal(camera)
    return out


def ideal_rays(camera: Camera, measured: Pairs) -> Array:
    """Return (n, 2) ideal image coordinates of (n, 2) measured ones, both [mm].

    NaN where the lens images no direction there.
    """
    places = as_points(np.asarray(measured))
    if not has_lens(camera):
        return places
    out: Array = camera.c * without_lens(places, np.array(camera.lens_parameters))
    return out


def measured_rays(camera: Camera, ideal: Pairs) -> Array:
    """Return (n, 2) measured image coordinates of (n, 2) ideal ones, both [mm]."""
    places = as_points(np.asarray(ideal))
    if not has_lens(camera):
        return places
    return lens_places(places / camera.c, np.array(camera.lens_parameters))


def measured_places(block: Block, image_points: Sequence[ImagePoint], *, pixels: bool) -> Array:
    """Return (n, 2) coordinates of a block's image points as they were measured.

    Parameters
    ----------
    block
        The block.
    image_points
        All of them, or some.
    pixels
        Whether pixels are wanted, which every camera must have then, or mm about the principal
        point, y up. Where that is what the block's file has, the numbers are the same.
    """
    columns = columns_of(image_points)
    cameras = {camera.id: camera for camera in block.cameras}
    of_photo = {photo.id: cameras[photo.camera] for photo in block.photos}
    measured = columns.measured
    stated = columns.stated
    out = columns.xy.copy()
    for camera, rows in rows_by_camera(columns.photo, of_photo):
        rest = rows[~stated[rows]]
        if len(rest):
            seen = measured_rays(camera, columns.xy[rest])
            out[rest] = pixels_of_mm(camera, seen) if pixels else seen
        kept = rows[stated[rows]]
        if measured is not None and len(kept):
            given = measured[kept]
            if pixels != block.in_pixels:
                given = pixels_of_mm(camera, given) if pixels else mm_of_pixels(camera, given)
            out[kept] = given
    return out


def rows_by_camera(photo: Coded[str], cameras: Mapping[str, Camera]) -> list[tuple[Camera, Index]]:
    """Return cameras in the order of their first rows, and the rows that were seen with each.

    Parameters
    ----------
    photo
        Of each row.
    cameras
        By photo.
    """
    seen = {cameras[name].id: cameras[name] for name in photo.values}
    number = {name: k for k, name in enumerate(seen)}
    of_photo = np.array([number[cameras[name].id] for name in photo.values], dtype=np.intp)
    of_row = of_photo[photo.index]
    return [(camera, np.flatnonzero(of_row == k)) for k, camera in enumerate(seen.values())]


def first_beyond_reach(columns: PointColumns, cameras: Mapping[str, Camera]) -> int | None:
    """Return the first row whose coordinates its photo's camera cannot have; None: there is none.

    Parameters
    ----------
    columns
        Coordinates [mm] as they were measured.
    cameras
        By photo.
    """
    if not len(columns):
        return None
    reach = np.array([cameras[name].reach() for name in columns.photo.values])
    beyond = (np.abs(columns.xy) > reach[columns.photo.index]).any(axis=1)
    return int(beyond.argmax()) if beyond.any() else None


def computed_place(row: ImagePoint) -> tuple[float, float]:
    """Return x and y [mm] of a row as a session that measured it has them.

    What pixels or a lens stand between comes back from its file with other last digits.
    """
    if row.measured is None:
        return row.x, row.y
    return round(row.x, COMPUTED_DIGITS), round(row.y, COMPUTED_DIGITS)


def plate_calibration(block: Block, photo: str) -> CameraCalibration | None:
    """Return by what ideal coordinates of a photo follow from its plate; None: they are the same.

    The camera's file, else its lens; rows in pixels are computed ones even without any.
    """
    camera = block.camera_of(photo)
    if camera.calibration is None and (has_lens(camera) or block.in_pixels):
        return CameraCalibration(camera.id, camera.c, format=camera.format, lens=camera.lens)
    return camera.calibration


def _principal(camera: Camera) -> tuple[float, float]:
    if camera.principal_px is not None:
        return camera.principal_px
    if camera.pixels is None:
        raise ValueError(f"camera {camera.id!r} has no pixels")
    return camera.pixels[0] / 2.0, camera.pixels[1] / 2.0
