"""A new COLMAP model of a block that came from elsewhere: binary, of adjusted orientations."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.door import Exported, Exporting, Note, PhotoResult, PointResult
from anaplot.exchange.formats.gathered import not_held
from anaplot.photogrammetry.block import Block, Camera, ImagePoint, in_pixels
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.measuredimage import measured_rays, pixels_of_mm
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.textfiles.wholefile import create_folder

__all__ = ["write_new"]

_PIXEL_UM = 10.0  # of a camera in mm, which is to have pixels
_MAX_ID = 2**32 - 2
_PINHOLE, _OPENCV, _FULL_OPENCV = 1, 4, 6
_SOME = 4


class _Ray(NamedTuple):
    image: int
    x: float
    y: float
    off: float  # from where the adjusted point is seen [px]


def write_new(exporting: Exporting, target: Path) -> Exported:
    """Write a binary model into a new folder; all of it, or nothing.

    Parameters
    ----------
    exporting
        The block with what its adjustment says.

    Raises
    ------
    InputError
        A file is there already or cannot be written, or no point has two rays.
    """
    adjusted, block = exporting.adjusted, exporting.block
    if adjusted is None:
        raise InputError("colmap: the block has no source, and is not adjusted")
    notes: list[Note] = []
    photos = {row.photo: row for row in adjusted.photos}
    images = _numbers([p.id for p in block.photos if p.id in photos], _MAX_ID)
    used = {photo.camera for photo in block.photos if photo.id in photos}
    cameras = [camera for camera in block.cameras if camera.id in used]
    ids = _numbers([camera.id for camera in cameras], _MAX_ID)
    reach = _reach(block)
    made = {camera.id: _in_pixels(camera, reach, notes) for camera in cameras}
    rays, told = _rays(block, made, images, photos, {p.point: p for p in adjusted.points})
    notes += told
    points = _numbers([p.point for p in adjusted.points if p.point in rays], 2**63 - 1)
    renamed = [name for name, number in points.items() if name != str(number)]
    if renamed:
        text = "points whose name is no number have another one"
        notes.append(Note("changed", len(renamed), text, tuple(renamed[:_SOME])))
    if not points:
        raise InputError("colmap: no adjusted point has two rays that count")
    notes.append(Note("not held", None, "standard deviations, control, colours of points"))
    notes += not_held(block, holds=("lens", "image sigmas", "control sigmas", "control_m"))
    files = {
        "cameras.bin": _cameras([(ids[name], camera) for name, camera in made.items()]),
        **_images_and_points(block, photos, images, ids, points, rays, adjusted.points),
    }
    return Exported(create_folder(target, files.items()), tuple(notes))


def _numbers(names: list[str], most: int) -> dict[str, int]:
    """Return a number for every name: itself where it is one, else the next after the largest."""
    own = {
        name: int(name)
        for name in names
        if name.isascii() and name.isdigit() and len(name) < 20 and str(int(name)) == name
        and 0 < int(name) <= most
    }  # fmt: skip
    largest = max(own.values(), default=0)
    if largest + len(names) > most:
        own, largest = {}, 0
    for name in names:
        if name not in own:
            largest += 1
            own[name] = largest
    return {name: own[name] for name in names}


def _reach(block: Block) -> dict[str, float]:
    """Return the largest abs(x) or abs(y) [mm] of every camera that has rays."""
    out: dict[str, float] = {}
    for row in block.image_points:
        name = block.camera_of(row.photo).id
        out[name] = max(out.get(name, 0.0), abs(row.x), abs(row.y))
    return out


def _in_pixels(camera: Camera, reach: Mapping[str, float], notes: list[Note]) -> Camera:
    """Return a camera that has pixels, and a lens that COLMAP has."""
    if camera.pixels is None:
        width, height = camera.format or (2.0 * reach.get(camera.id, camera.c),) * 2
        size = [max(math.ceil(side * 1000.0 / _PIXEL_UM), 1) for side in (width, height)]
        camera = in_pixels(camera, (size[0], size[1]), _PIXEL_UM)
        notes.append(Note("assumed", None, f"{_PIXEL_UM:g} um as the pixels of camera {camera.id}"))
    if camera.lens is not None and camera.lens.b2:
        lens = BrownLens(b1=camera.lens.b1)
        text = f"camera {camera.id}: its shear b2: pixels are those without its lens"
        notes.append(Note("not held", None, text))
        camera = replace(camera, lens=lens)
    return camera


def _rays(
    block: Block,
    cameras: Mapping[str, Camera],
    images: Mapping[str, int],
    photos: Mapping[str, PhotoResult],
    points: Mapping[str, PointResult],
) -> tuple[dict[str, list[_Ray]], list[Note]]:
    """Return what counts of every point that has two rays, in photos that are adjusted."""
    by_photo: dict[str, list[ImagePoint]] = {}
    seen: set[tuple[str, str]] = set()
    again = half = 0
    for row in block.image_points:
        if row.photo not in images or row.point not in points or row.use == "off":
            continue
        if row.use != "xy":
            half += 1
        elif (row.photo, row.point) in seen:
            again += 1
        else:
            seen.add((row.photo, row.point))
            by_photo.setdefault(row.photo, []).append(row)
    camera_of = {photo.id: photo.camera for photo in block.photos}
    out: dict[str, list[_Ray]] = {}
    for name, rows in by_photo.items():
        camera = cameras[camera_of[name]]
        places = pixels_of_mm(camera, measured_rays(camera, [(row.x, row.y) for row in rows]))
        if block.in_pixels and camera is block.camera_of(name):
            kept = [row.measured or place for row, place in zip(rows, places.tolist(), strict=True)]
            places = np.array(kept)
        away = np.hypot(*(_seen(camera, photos[name], [points[r.point] for r in rows]) - places).T)
        for row, (x, y), off in zip(rows, places.tolist(), away.tolist(), strict=True):
            out.setdefault(row.point, []).append(_Ray(images[name], x, y, off))
    notes = []
    few = [name for name, mine in out.items() if len(mine) < 2]
    for count, text in (
        (half, "rays that count in one coordinate"),
        (again, "rays that were measured again in another model"),
        (len(few), "points of fewer than two rays"),
    ):
        if count:
            notes.append(Note("dropped", count, text))
    for name in few:
        del out[name]
    return out, notes


def _seen(camera: Camera, photo: PhotoResult, points: list[PointResult]) -> Array:
    """Return (n, 2) pixels at which adjusted points are seen."""
    away = np.array([point.xyz for point in points]) - photo.position
    inside = away @ rotation_matrix(*photo.rotation)
    ideal = inside[:, :2] * (-camera.c / inside[:, 2:])
    return pixels_of_mm(camera, measured_rays(camera, ideal))


def _cameras(cameras: list[tuple[int, Camera]]) -> bytes:
    out = [struct.pack("<Q", len(cameras))]
    for number, camera in cameras:
        lens = camera.lens or BrownLens()
        fy = camera.c / camera.pixel_mm
        cx, cy = pixels_of_mm(camera, [(0.0, 0.0)])[0].tolist()
        params: tuple[float, ...] = (fy * (1.0 + lens.b1), fy, cx, cy)
        model = _PINHOLE
        if lens.k3:
            model = _FULL_OPENCV
            params += (lens.k1, lens.k2, lens.p1, lens.p2, lens.k3, 0.0, 0.0, 0.0)
        elif any((lens.k1, lens.k2, lens.p1, lens.p2)):
            model = _OPENCV
            params += (lens.k1, lens.k2, lens.p1, lens.p2)
        size = camera.pixels or (1, 1)
        out.append(struct.pack(f"<IiQQ{len(params)}d", number, model, *size, *params))
    return b"".join(out)


def _images_and_points(
    block: Block,
    photos: Mapping[str, PhotoResult],
    images: Mapping[str, int],
    cameras: Mapping[str, int],
    numbers: Mapping[str, int],
    rays: Mapping[str, list[_Ray]],
    results: tuple[PointResult, ...],
) -> dict[str, bytes]:
    """Return images.bin and points3D.bin."""
    features: dict[int, list[bytes]] = {number: [] for number in images.values()}
    tracks: list[bytes] = [struct.pack("<Q", len(numbers))]
    xyz = {result.point: result.xyz for result in results}
    for name, number in numbers.items():
        mine = rays[name]
        error = sum(ray.off for ray in mine) / len(mine)
        tracks.append(struct.pack("<Q3d3BdQ", number, *xyz[name], 0, 0, 0, error, len(mine)))
        for ray in mine:
            tracks.append(struct.pack("<2I", ray.image, len(features[ray.image])))
            features[ray.image].append(struct.pack("<2dQ", ray.x, ray.y, number))
    out = [struct.pack("<Q", len(images))]
    for photo in block.photos:
        if photo.id not in images:
            continue
        result, here = photos[photo.id], features[images[photo.id]]
        to_camera = (rotation_matrix(*result.rotation) * (1.0, -1.0, -1.0)).T
        pose = (*_quaternion(to_camera), *(-to_camera @ result.position).tolist())
        head = struct.pack("<I7dI", images[photo.id], *pose, cameras[photo.camera])
        out.append(head + photo.id.encode() + b"\0" + struct.pack("<Q", len(here)))
        out += here
    return {"images.bin": b"".join(out), "points3D.bin": b"".join(tracks)}


def _quaternion(rotation: Array) -> tuple[float, ...]:
    """Return the quaternion, w first and not negative, of a (3, 3) rotation.

    The eigenvector of the largest eigenvalue of Bar-Itzhack's matrix: stable at every angle.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    key = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    x, y, z, w = np.linalg.eigh(key)[1][:, -1].tolist()
    sign = -1.0 if w < 0.0 else 1.0
    return sign * w, sign * x, sign * y, sign * z
