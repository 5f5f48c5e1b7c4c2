"""A block as a BAL problem: what it was imported from without the rays that are off, or anew."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.errors import InputError
from anaplot.exchange.formats.door import SOURCE, AdjustedResult, Exported, Exporting, Note
from anaplot.exchange.formats.gathered import not_held, rays_that_count
from anaplot.exchange.formats.sourcelines import source_lines
from anaplot.photogrammetry.block import Block, Camera
from anaplot.photogrammetry.measuredimage import measured_places
from anaplot.photogrammetry.rotation import axis_angle, rotation_matrix
from anaplot.photogrammetry.selection import rows_by_photo
from anaplot.textfiles.wholefile import create_whole
from anaplot.textfiles.wording import quoted

__all__ = ["BAL_SOURCE", "KeptRay", "write_bal"]

BAL_SOURCE = "problem.txt"
"""What a problem is called under `source/`."""


class KeptRay(NamedTuple):
    """An observation of a problem: its line there, and the image point that import makes of it."""

    line: int
    photo: str
    point: str


def write_bal(exporting: Exporting, target: Path, kept: list[KeptRay] | None) -> Exported:
    """Write a block.

    Where the problem that it was imported from is kept in `source/`, this is written again, without
    the rays that are off or doubled, and not a digit of the rest is changed. Else the adjusted
    block is written, with photos and points by numbers.

    Parameters
    ----------
    exporting, target
        As `registry.Format.write` has them.
    kept
        The observations of that problem that import does not leave out; None where there is no
        problem.

    Raises
    ------
    InputError
        A camera has no pixels or a lens that is not k1 and k2, or the file cannot be written.
    """
    block = exporting.block
    if kept is not None:
        lines, notes = _without_off(block, exporting.folder / SOURCE / BAL_SOURCE, kept)
    else:
        lines, notes = _anew(block, exporting.adjusted)
    create_whole(target, (f"{line}\n".encode() for line in lines))
    return Exported((target,), tuple(notes))


def _without_off(
    block: Block, source: Path, kept: list[KeptRay]
) -> tuple[Iterator[str], list[Note]]:
    uses = {(row.photo, row.point): row.use for row in block.image_points}
    half = sum(row.use in ("x", "y") for row in block.image_points)
    out = {ray.line for ray in kept if uses.get((ray.photo, ray.point)) == "off"}
    unknown = sum((ray.photo, ray.point) not in uses for ray in kept)

    def lines() -> Iterator[str]:
        first = True
        for line in source_lines(source):
            if first and line.text.strip():
                cameras, points, count = line.text.split()
                first = False
                yield f"{cameras} {points} {int(count) - len(out)}"
            elif line.number not in out:
                yield line.text

    notes = []
    if out:
        text = "rays that are off or doubled: everything else is as it was"
        notes.append(Note("dropped", len(out), text))
    if unknown:
        text = "rays that are not in the block stay as they were"
        notes.append(Note("assumed", unknown, text))
    if half:
        notes.append(Note("not held", half, "rays of which one coordinate counts: written whole"))
    return lines(), notes


def _anew(block: Block, adjusted: AdjustedResult | None) -> tuple[Iterator[str], list[Note]]:
    if adjusted is None:
        raise InputError("bal: the block has to be adjusted")
    points = {row.point: k for k, row in enumerate(adjusted.points)}
    rays, notes = rays_that_count(block)
    single = [row for row in rays if row.point not in points]
    if single:
        notes.append(Note("dropped", len(single), "rays of points that are not determined"))
    rays = [row for row in rays if row.point in points]
    notes += not_held(block, holds=("lens",))
    control = sum(row.use == "control" for row in block.control)
    if control:
        notes.append(Note("not held", control, "control points"))
    notes.append(Note("not held", None, "names of photos and points, which are counted from 0"))
    photos = {row.photo: k for k, row in enumerate(adjusted.photos)}
    by_photo = rows_by_photo(row for row in rays if row.photo in photos)
    rays = [row for rows in by_photo.values() for row in rows]
    centres = {camera.id: _centre(camera) for camera in block.cameras}

    def lines() -> Iterator[str]:
        yield f"{len(photos)} {len(points)} {len(rays)}"
        places = measured_places(block, rays, pixels=True).tolist()
        for ray, (px, py) in zip(rays, places, strict=True):
            cx, cy = centres[block.camera_of(ray.photo).id]
            x, y = Decimal(repr(px)) - cx, cy - Decimal(repr(py))
            yield f"{photos[ray.photo]} {points[ray.point]} {x} {y}"
        for row in adjusted.photos:
            camera = block.camera_of(row.photo)
            turned = rotation_matrix(*row.rotation).T
            moved = -turned @ np.array(row.position)
            lens = camera.lens_parameters
            f = camera.c / camera.pixel_mm
            for value in (*axis_angle(turned), *moved.tolist(), f, lens[3], lens[4]):
                yield repr(value)
        for point in adjusted.points:
            yield from map(repr, point.xyz)

    return lines(), notes


def _centre(camera: Camera) -> tuple[Decimal, Decimal]:
    """Return the principal point [px]; raises InputError for a camera that BAL cannot hold."""
    if camera.pixels is None:
        raise InputError(f"camera {quoted(camera.id)} has no pixels, which BAL needs")
    if any(camera.lens_parameters[5:]):
        raise InputError(f"camera {quoted(camera.id)}: of a lens BAL has k1 and k2 alone")
    width, height = camera.pixels
    cx, cy = camera.principal_px or (width / 2.0, height / 2.0)
    return Decimal(repr(cx)), Decimal(repr(cy))
