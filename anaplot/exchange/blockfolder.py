"""The block folder: block.toml, image_points.csv, control.csv, distances.csv, conditions.csv."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.blocktoml import (
    camera_texts,
    format_block_toml,
    parse_block_toml,
    with_photos,
)
from anaplot.exchange.bridgecheck import check_for_bridge
from anaplot.exchange.camerafile import read_camera, write_camera
from anaplot.exchange.conditionscsv import (
    CONDITIONS_CSV,
    DISTANCES_CSV,
    format_distances,
    parse_conditions,
    parse_distances,
)
from anaplot.exchange.controlcsv import GroundPoints, format_control, parse_control
from anaplot.exchange.patternfile import format_pattern, read_pattern
from anaplot.exchange.recordline import SESSIONS
from anaplot.photogrammetry.block import Block, ControlPoint, ImagePoint, ImagePoints, PointPrior
from anaplot.textfiles.csvtable import MAX_CSV_BYTES
from anaplot.textfiles.inputfile import read_bytes, read_text
from anaplot.textfiles.wholefile import (
    all_or_nothing,
    clear_left_over,
    create_whole,
    make_folder,
    replace_whole,
)
from anaplot.textfiles.wording import place, reason

__all__ = [
    "IMAGE_POINTS_CSV",
    "MORE_FILES",
    "PointsFound",
    "block_files",
    "check_for_bridge",
    "clear_image_points",
    "image_points_digest",
    "image_points_identity",
    "read_block",
    "read_declared",
    "with_image_points",
    "write_block",
    "write_control",
    "write_image_points",
    "write_new_block",
]

BLOCK_TOML = "block.toml"
IMAGE_POINTS_CSV = "image_points.csv"
CONTROL_CSV = "control.csv"
MORE_FILES = (DISTANCES_CSV, CONDITIONS_CSV)

MAX_TOML_BYTES = 64_000_000


class PointsFound(NamedTuple):
    """What was read of an image_points.csv.

    Attributes
    ----------
    rows
        Its rows.
    digest
        As `image_points_digest` has it.
    """

    rows: Iterable[ImagePoint]
    digest: str | None


def read_block(folder: str | os.PathLike[str]) -> Block:
    """Read a block folder; nothing is written.

    Parameters
    ----------
    folder
        Holds block.toml, and image_points.csv, control.csv, distances.csv and conditions.csv where
        they exist: a new block has none of them.

    Raises
    ------
    InputError
        The first thing that is wrong, with file, line and key or column.
    """
    folder = Path(folder)
    path = folder / BLOCK_TOML
    block = with_image_points(folder, read_declared(folder))
    if not block.photos:
        raise InputError(f"{place(path)}: no photo: no strip names one, nor does image_points.csv")
    control, distances = folder / CONTROL_CSV, folder / DISTANCES_CSV
    others = folder / CONDITIONS_CSV
    conditions = parse_distances(distances) if os.path.lexists(distances) else ()
    if os.path.lexists(others):
        conditions += parse_conditions(others)
    ground = parse_control(control) if os.path.lexists(control) else GroundPoints()
    return replace(block, control=ground.control, conditions=conditions, priors=ground.priors)


def read_declared(folder: Path) -> Block:
    """Return what a folder's block.toml declares; it may have no photo yet.

    Raises
    ------
    InputError
        There is no such block, or something is wrong in its block.toml or a camera file.
    """
    _check_folder(folder)
    path = folder / BLOCK_TOML
    return parse_block_toml(read_text(path, MAX_TOML_BYTES), path)


def with_image_points(folder: Path, block: Block) -> Block:
    """Return a block with the rows of the folder's image_points.csv, where there is one.

    Without strips and with one camera it has the photos that the rows name, too.

    Raises
    ------
    InputError
        The file cannot be read, or a row is wrong.
    """
    points = folder / IMAGE_POINTS_CSV
    # A link to nowhere is not an absent file: lexists leaves the complaint to the reader.
    if not os.path.lexists(points):
        return replace(block, image_points=ImagePoints(), in_pixels=False)
    from anaplot.exchange.measuredrows import image_point_rows, points_in_pixels

    table, of_photo = image_point_rows(points, block)
    if not len(table):
        return replace(block, image_points=ImagePoints(), in_pixels=points_in_pixels(points))
    from anaplot.exchange.imagepointscsv import image_points_of

    measured = image_points_of(table, of_photo)
    photos = block.photos
    if not block.strips and len(block.cameras) == 1:
        photos = with_photos(photos, measured.columns.photo.values, block.cameras[0].id)
    return replace(block, photos=photos, image_points=measured, in_pixels=points_in_pixels(points))


def image_points_digest(folder: Path) -> str | None:
    """Return a digest of a folder's image_points.csv; None where there is none.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    path = folder / IMAGE_POINTS_CSV
    return _digest(read_bytes(path, MAX_CSV_BYTES)) if os.path.lexists(path) else None


def image_points_identity(folder: Path) -> str | None:
    """Return which image_points.csv a folder has: its digest, and when it was written [ns].

    None where there is none. One that is written again with the same words is another one.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    path = folder / IMAGE_POINTS_CSV
    digest = image_points_digest(folder)
    try:
        return None if digest is None else f"{digest} {path.stat().st_mtime_ns}"
    except OSError as error:
        raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from error


def _digest(data: bytes) -> str:
    import hashlib  # nearly as long to load as what reads a block

    return hashlib.sha256(data).hexdigest()


def write_image_points(
    folder: Path,
    points: Iterable[ImagePoint],
    block: Block | None = None,
    found: PointsFound | None = None,
) -> str:
    """Write image_points.csv whole and atomically, in place of the one before.

    Of a block, what has not changed stays as it stands in the file: line ends, columns, digits.

    Parameters
    ----------
    folder
        The block folder.
    points
        Rows in file order; their coordinates are read back exactly.
    block
        The block that they belong to: its cameras say what is written where they have pixels or
        a lens. None: the file before is not looked at.
    found
        What was read of the file before. While that is what it says, it is not read again.

    Returns
    -------
    str
        The digest of the file, as `image_points_digest` has it.

    Raises
    ------
    InputError
        A row that could not be read again, or the file before cannot be read, or not be replaced:
        it stays.
    """
    path = folder / IMAGE_POINTS_CSV
    if block is None or not os.path.lexists(path):
        data = _image_points_data(path, points, block)
    else:
        from anaplot.exchange.imagepointscsv import reformat_image_points

        raw = read_bytes(path, MAX_CSV_BYTES)
        there = found.rows if found is not None and found.digest == _digest(raw) else None
        text = reformat_image_points(path, raw, points, block, there)
        data = _bounded(path, text.encode(), MAX_CSV_BYTES)
    replace_whole(path, data)
    return _digest(data)


def clear_image_points(folder: Path) -> None:
    """Remove what a killed session left beside image_points.csv; only under the block's lock."""
    clear_left_over(folder / IMAGE_POINTS_CSV)


def _image_points_data(path: Path, points: Iterable[ImagePoint], block: Block | None) -> bytes:
    from anaplot.exchange.imagepointscsv import format_image_points

    return _bounded(path, format_image_points(points, block).encode(), MAX_CSV_BYTES)


def write_control(
    folder: Path, control: Iterable[ControlPoint], priors: Iterable[PointPrior] = ()
) -> None:
    """Write a new control.csv, and in it what is known of points beforehand.

    Raises
    ------
    InputError
        There is one already, or it cannot be written.
    """
    path = folder / CONTROL_CSV
    create_whole(path, _bounded(path, format_control(control, priors).encode(), MAX_CSV_BYTES))


def block_files(folder: Path) -> tuple[Path, ...]:
    """Return the files by which a folder is a block, whether they exist or not."""
    return folder / BLOCK_TOML, folder / IMAGE_POINTS_CSV, folder / CONTROL_CSV


def write_new_block(
    folder: Path, block: Block, *, text: str | None = None, remark: str = ""
) -> None:
    """Write the block.toml of a new block, and before it what stands beside it.

    That is its camera files, and the file of its point pattern.

    Parameters
    ----------
    folder
        The block folder, made when it does not exist.
    block
        The block. Files that it names by absolute paths are expected there.
    text
        What block.toml is to say where it is not the block without any comment.
    remark
        A line for people at the beginning of the camera files.

    Raises
    ------
    InputError
        The block could not be read again, there is a block.toml already, or a file of that name
        that says something else, or it cannot be written: then no part of it is there.
    """
    path = folder / BLOCK_TOML
    if os.path.lexists(path):
        raise InputError(f"{place(path)}: exists already and is not overwritten")
    text = format_block_toml(block) if text is None else text
    parse_block_toml(text, path, camera_texts(block))
    pattern = _pattern_text(folder, block)
    with all_or_nothing():
        make_folder(folder)
        for camera in block.cameras:
            if camera.file is None or camera.calibration is None or Path(camera.file).is_absolute():
                continue
            target = folder / camera.file
            if not os.path.lexists(target):
                make_folder(target.parent)
                write_camera(target, camera.calibration, remark)
            elif read_camera(target) != camera.calibration:
                raise InputError(f"{place(target)}: exists already and says something else")
        for name, points in pattern.items():
            make_folder((folder / name).parent)
            create_whole(folder / name, points.encode())
        parse_block_toml(text, path)  # now with the camera files, those named by absolute paths too
        create_whole(path, _bounded(path, text.encode(), MAX_TOML_BYTES))


def write_block(folder: Path, block: Block, *, text: str | None = None) -> None:
    """Write a whole new block: image_points.csv, control.csv where there is any, and block.toml.

    block.toml is the last file: without it there is no block.

    Parameters
    ----------
    folder
        The block folder, made when it does not exist.
    block
        The block. Of conditions between points only distances are written.
    text
        What block.toml is to say where it is not the block without any comment.

    Raises
    ------
    ValueError
        There are other conditions.
    InputError
        One of the files of a block is there already, or its sessions, or they cannot be written; no
        part of them is left.
    """
    _, points, _ = block_files(folder)
    # what lies there of another block would be part of this one
    others = (folder / name for name in (*MORE_FILES, SESSIONS))
    there = next((path for path in (*block_files(folder), *others) if os.path.lexists(path)), None)
    if there is not None:
        raise InputError(f"{place(there)}: exists already and is not overwritten")
    with all_or_nothing():
        make_folder(folder)
        create_whole(points, _image_points_data(points, block.image_points, block))
        if block.control or block.priors:
            write_control(folder, block.control, block.priors)
        if block.conditions:
            text_of = format_distances(block.conditions).encode()
            create_whole(folder / DISTANCES_CSV, text_of)
        write_new_block(folder, block, text=text)


def _pattern_text(folder: Path, block: Block) -> dict[str, str]:
    """Return the file of a block's point pattern, by its name, where one is to be written."""
    name, points = block.measuring.pattern, block.measuring.points
    if name is None or points is None or Path(name).is_absolute():
        return {}
    target = folder / name
    own = (*MORE_FILES, *(path.name for path in block_files(folder)))
    if Path(name) in (*map(Path, own), *(Path(c.file) for c in block.cameras if c.file)):
        raise InputError(f"{place(target)}: no name for a pattern: another file of a block has it")
    if not os.path.lexists(target):
        return {name: format_pattern(points, target.suffix)}
    if read_pattern(target).points != points:
        raise InputError(f"{place(target)}: exists already and says something else")
    return {}


def _bounded(path: Path, data: bytes, max_bytes: int) -> bytes:
    if len(data) > max_bytes:
        raise InputError(f"{place(path)}: larger than what is read ({max_bytes / 1e6:g} MB)")
    return data


def _check_folder(folder: Path) -> None:
    try:
        folder.stat()
    except FileNotFoundError:
        raise InputError(f"{place(folder)}: no such folder") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{place(folder)}: cannot be read: {reason(error)}") from error
    if not folder.is_dir():
        raise InputError(f"{place(folder)}: not a folder")
