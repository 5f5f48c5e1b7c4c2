"""A block as BINGO's image file, geoin and itera in a new folder."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.formats.bingofiles import GON, ORDERS, angles_in
from anaplot.exchange.formats.door import Exported, Exporting, Note
from anaplot.exchange.formats.gathered import (
    check_order,
    not_held,
    poses_of,
    rays_that_count,
    whole_name,
)
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.selection import rows_by_photo
from anaplot.textfiles.names import MAX_NAME
from anaplot.textfiles.wholefile import create_folder
from anaplot.textfiles.wording import quoted

__all__ = ["write_bingo"]

_WORDS = {"control": "CONT", "check": "CHCK"}


def write_bingo(exporting: Exporting, target: Path) -> Exported:
    """Write a block; all of it, or nothing.

    Raises
    ------
    InputError
        An unknown order, a name that the files cannot hold, a control point without all
        coordinates, or a file that cannot be written.
    """
    block, order = exporting.block, exporting.options.order or ORDERS[0]
    check_order(order, ORDERS)
    rays, notes = _believed(block, *rays_that_count(block))
    notes += not_held(block, holds=("check",))
    made = {"image.dat": "".join(_images(block, rays)), "geoin.dat": "".join(_geoin(block))}
    itera = "".join(_itera(exporting, order))
    if itera:
        made["itera.dat"] = itera
    files = create_folder(target, ((name, text.encode()) for name, text in made.items()))
    if itera:
        notes.append(
            Note("assumed", None, f"rotations in gon are {order}, image to ground (--order)")
        )
    return Exported(files, tuple(notes))


def _believed(
    block: Block, rays: list[ImagePoint], notes: list[Note]
) -> tuple[list[ImagePoint], list[Note]]:
    """Leave out rays that no camera without a format can have, as those of BINGO are."""
    most = {camera.id: max(replace(camera, format=None).reach()) for camera in block.cameras}
    of = {photo.id: most[photo.camera] for photo in block.photos}
    kept = [row for row in rays if max(abs(row.x), abs(row.y)) <= of[row.photo]]
    if len(kept) < len(rays):
        text = "rays farther off than 4 c: left out"
        notes = [*notes, Note("not held", len(rays) - len(kept), text)]
    return kept, notes


def _name(what: str, name: str) -> str:
    if name == "C":
        raise InputError(f"{what} {quoted(name)} would be a comment in BINGO")
    return whole_name(what, name, MAX_NAME, "BINGO")


def _images(block: Block, rays: list[ImagePoint]) -> Iterator[str]:
    rows = rows_by_photo(rays)
    for photo in block.photos:
        yield f"{_name('photo', photo.id)} {_name('camera', photo.camera)}\n"
        for row in rows.get(photo.id, ()):
            yield f"{_name('point', row.point)} {row.x!r} {row.y!r}\n"
        yield "-99\n"


def _geoin(block: Block) -> Iterator[str]:
    yield "* CAPA camera . c x0 y0 [mm], CONT and CHCK id E N H [m]\n"
    for camera in block.cameras:
        yield f"CAPA {_name('camera', camera.id)} 0 {camera.c!r} 0.0 0.0\n"
    for row in block.control:
        if row.use not in _WORDS:
            continue
        if any(value is None for value in row.xyz):
            raise InputError(f"control point {quoted(row.point)}: BINGO has E, N and H, or nothing")
        values = " ".join(repr(value) for value in row.xyz)
        yield f"{_WORDS[row.use]} {_name('point', row.point)} {values}\n"


def _itera(exporting: Exporting, order: str) -> Iterator[str]:
    adjusted = exporting.adjusted
    poses = poses_of(exporting)
    if poses:
        a, b, c = ORDERS[2 if order == ORDERS[2] else 0].split("-")
        yield f"* ORIA photo X Y Z [m] {a} {b} {c} [gon] flag; CORD id X Y Z\n"
        yield f"* image to ground: {order}\n"
    for photo, position, angles in poses:
        turned = (value / GON for value in angles_in(order, rotation_matrix(*angles)))
        numbers = " ".join(repr(value) for value in (*position, *turned))
        yield f"ORIA {_name('photo', photo)} {numbers} 0\n"
    for point in () if adjusted is None else adjusted.points:
        yield f"CORD {_name('point', point.point)} {' '.join(repr(v) for v in point.xyz)}\n"
