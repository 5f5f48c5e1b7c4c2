"""BAL, "bundle adjustment in the large": cameras, points and observations in one text file.

    cameras points observations
    camera point x y                 (pixels from the middle of the image, y up)
    ...
    nine numbers a camera            (Rodrigues vector, translation, f, k1, k2)
    three numbers a point

A point is at P = R X + t in the camera, which looks down its -z axis as ours does, and is seen at
f (1 + k1 r^2 + k2 r^4) p with p = -(P_x, P_y) / P_z: k1 and k2 are those of our lens.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.errors import InputError
from anaplot.exchange.formats.balwriter import BAL_SOURCE, KeptRay, write_bal
from anaplot.exchange.formats.door import SOURCE, Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.gathered import MAX_TABLE_BYTES, head_of
from anaplot.exchange.formats.measuredrays import MeasuredRay, image_points_of, kept_names
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    Photo,
    Precision,
    TestSettings,
    in_pixels,
)
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.rotation import rotation_angles, turn
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.wording import place, quoted

__all__ = ["read", "recognises", "write"]

_LOOK = 1000  # bytes that are looked at
_CAMERA, _POINT, _RAY = 9, 3, 4  # numbers of each
_SHORTEST = 2  # bytes of a number and what parts it from the next
_LARGEST = 500_000.0  # px from the middle of an image


class _Ray(NamedTuple):
    camera: int
    point: int
    x: str
    y: str
    line: int


def recognises(source: Path) -> bool:
    """Return whether a file begins with three counts and an observation."""
    head = head_of(source, _LOOK)
    rows = [line.split() for line in head.splitlines()[:2]] if head.isascii() else []
    if len(rows) < 2 or len(rows[0]) != 3 or len(rows[1]) != _RAY:
        return False
    whole = (*rows[0], *rows[1][:2])
    if not all(text.isdecimal() for text in whole) or int(rows[0][2]) < 1:
        return False
    cameras, points, _ = map(int, rows[0])
    return int(rows[1][0]) < cameras and int(rows[1][1]) < points


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a problem; raises InputError."""
    rays, of_camera, points = _problem(source)
    notes: list[Note] = []
    width, height = size = _size(rays)
    text = f"images of {width} x {height} pixels, their middle the principal point"
    notes.append(Note("assumed", None, f"{text}: the file does not say how large they are"))
    made, of_photo = _cameras(of_camera, source, size, notes)
    sigma = options.sigma_px
    if sigma is None:
        sigma = 1.0
        notes.append(Note("assumed", None, "sigma of image coordinates one pixel (--sigma-px)"))
    found, told = image_points_of(
        _measured(rays, size), {str(k): camera for k, camera in enumerate(of_photo)}, pixels=True
    )
    notes += told
    seen = {ray.camera for ray in rays}
    idle = [str(k) for k in range(len(of_camera)) if k not in seen]
    if idle:
        notes.append(Note("assumed", len(idle), "photos without a ray", tuple(idle[:4])))
    text = "approximate coordinates of points: they are found anew, and kept in source/"
    notes.append(Note("dropped", points, text))
    block = Block(
        source.stem or "bal",
        Precision(sigma, "exact"),
        TestSettings(),
        made,
        tuple(_photo(k, *rest) for k, rest in enumerate(zip(of_camera, of_photo, strict=True))),
        (),
        found,
        in_pixels=True,
    )
    return Imported(block, tuple(notes), (f"from {source.name}, BAL",), {BAL_SOURCE: source})


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a block as one file; raises InputError."""
    kept = exporting.folder / SOURCE / BAL_SOURCE
    return write_bal(exporting, target, _kept(kept) if kept.exists() else None)


def _kept(source: Path) -> list[KeptRay]:
    """Return the observations that import makes image points of."""
    rays, of_camera, _ = _problem(source)
    size = _size(rays)
    _, of_photo = _cameras(of_camera, source, size, [])
    cameras = {str(k): camera for k, camera in enumerate(of_photo)}
    names = kept_names(_measured(rays, size), cameras)
    return [
        KeptRay(ray.line, str(ray.camera), name)
        for ray, name in zip(rays, names, strict=True)
        if name is not None
    ]


def _problem(source: Path) -> tuple[list[_Ray], list[list[float]], int]:
    """Return observations, the numbers of every camera, and how many points there are."""
    with open_input(source, MAX_TABLE_BYTES) as file:
        size = os.fstat(file.fileno()).st_size
    lines = (line for line in source_lines(source) if line.text.strip())
    cameras, points, count = _counts(lines, source, size)
    rays = [_ray(lines, source, cameras, points) for _ in range(count)]
    numbers = _numbers(lines)
    of_camera = [_take(numbers, source, _CAMERA, f"camera {k}") for k in range(cameras)]
    for k in range(points):
        _take(numbers, source, _POINT, f"point {k}")
    more = next(numbers, None)
    if more is not None:
        raise more[0].fail("more numbers than the first line says")
    return rays, of_camera, points


def _counts(lines: Iterator[SourceLine], source: Path, size: int) -> tuple[int, int, int]:
    first = next(lines, None)
    if first is None:
        raise InputError(f"{place(source)}: is empty")
    fields = first.text.split()
    if len(fields) != 3:
        raise first.fail("three counts are expected: cameras, points, observations")
    cameras, points, count = (
        first.whole_of(text, f"the count of {what}")
        for text, what in zip(fields, ("cameras", "points", "observations"), strict=True)
    )
    if _SHORTEST * (_CAMERA * cameras + _POINT * points + _RAY * count) > size + 1:
        what = f"{cameras} cameras, {points} points and {count} observations"
        raise first.fail(f"{what} do not fit in {size} bytes")
    if not (cameras and count):
        raise first.fail("no camera, or no observation")
    return cameras, points, count


def _ray(lines: Iterator[SourceLine], source: Path, cameras: int, points: int) -> _Ray:
    line = next(lines, None)
    if line is None:
        raise InputError(f"{place(source)}: ends among the observations: the file is cut")
    fields = line.text.split()
    if len(fields) != _RAY:
        raise line.fail(f"{len(fields)} fields, where camera, point, x and y are expected")
    camera = line.whole_of(fields[0], "the camera", high=cameras - 1)
    point = line.whole_of(fields[1], "the point", high=points - 1)
    for value in line.numbers_of(fields[2:], "x and y"):
        if abs(value) > _LARGEST:
            raise line.fail(f"{value:g} px from the middle of an image")
    return _Ray(camera, point, fields[2], fields[3], line.number)


def _numbers(lines: Iterator[SourceLine]) -> Iterator[tuple[SourceLine, str]]:
    for line in lines:
        for text in line.text.split():
            yield line, text


def _take(
    numbers: Iterator[tuple[SourceLine, str]], source: Path, count: int, what: str
) -> list[float]:
    out = []
    for _ in range(count):
        found = next(numbers, None)
        if found is None:
            raise InputError(f"{place(source)}: ends in {what}: the file is cut")
        out.append(found[0].number_of(found[1], f"a number of {what}"))
    return out


def _extent(values: Iterator[str]) -> int:
    """Return an even number of pixels within which all coordinates lie."""
    return 2 * (math.floor(max(abs(float(value)) for value in values)) + 1)


def _size(rays: list[_Ray]) -> tuple[int, int]:
    return _extent(ray.x for ray in rays), _extent(ray.y for ray in rays)


def _measured(rays: list[_Ray], size: tuple[int, int]) -> list[MeasuredRay]:
    across, down = size[0] // 2, size[1] // 2
    # in decimals: what is taken off again on the way out is what was added
    return [
        MeasuredRay(
            str(ray.camera),
            str(ray.point),
            float(_decimal(ray.x) + across),
            float(down - _decimal(ray.y)),
        )
        for ray in rays
    ]


def _decimal(text: str) -> Decimal:
    """Return the number that a text says; one whose exponent is beyond all bounds says zero."""
    try:
        return Decimal(text)
    except InvalidOperation:
        return Decimal(float(text))


def _cameras(
    of_camera: list[list[float]], source: Path, size: tuple[int, int], notes: list[Note]
) -> tuple[tuple[Camera, ...], list[Camera]]:
    """Return the different cameras, and the camera of every photo."""
    made: dict[tuple[float, ...], Camera] = {}
    of_photo = []
    for k, numbers in enumerate(of_camera):
        f, k1, k2 = numbers[6:]
        if not f > 0.0:
            raise InputError(f"{place(source)}: camera {k}: f must be greater than 0, not {f:g}")
        lens = BrownLens(k1=k1, k2=k2) if k1 or k2 else None
        camera = Camera(str(k), f / 1000.0, lens=lens)
        of_photo.append(made.setdefault((f, k1, k2), in_pixels(camera, size)))
    if len(made) < len(of_photo):
        text = f"cameras of the same f, k1 and k2: {len(made)} are left"
        notes.append(Note("joined", len(of_photo), text))
    return tuple(made.values()), of_photo


def _photo(index: int, numbers: list[float], camera: Camera) -> Photo:
    if math.hypot(*numbers[:3]) > 1e3:
        raise InputError(f"camera {quoted(str(index))}: a rotation by more than 1000 rad")
    rotation = turn(*numbers[:3]).T  # image to ground
    x, y, z = (-rotation @ np.array(numbers[3:6])).tolist()
    return Photo(str(index), camera.id, (x, y, z), rotation_angles(rotation))
