"""image_points.csv: measured image points, to and from text."""

from __future__ import annotations

import math
from codecs import BOM_UTF8
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from operator import attrgetter
from pathlib import Path

from anaplot.aliases import Array, Index
from anaplot.errors import InputError
from anaplot.exchange.keptrows import Columns, rewritten
from anaplot.exchange.measuredrows import PIXELS, REASON, USE, image_point_rows, says_pixels
from anaplot.photogrammetry.block import Block, Camera, ImagePoint
from anaplot.photogrammetry.imagepoint import unchanged_ends
from anaplot.photogrammetry.imagepoints import ImagePoints
from anaplot.photogrammetry.measuredimage import (
    first_beyond_reach,
    has_lens,
    ideal_rays,
    measured_places,
    mm_of_pixels,
    rows_by_camera,
)
from anaplot.photogrammetry.pointcolumns import (
    Coded,
    PointColumns,
    paired,
    read_columns,
    samples,
    stand_again,
    stated_sigmas,
)
from anaplot.photogrammetry.selection import model_splits
from anaplot.textfiles.csvtable import CsvColumns, csv_text_of_columns
from anaplot.textfiles.inputfile import decoded
from anaplot.textfiles.kinds import WrongValueError
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import quoted

__all__ = [
    "format_image_points",
    "image_points_of",
    "outside",
    "parse_image_points",
    "reformat_image_points",
]

_BESIDE = 0.5  # px that a coordinate may lie outside the image: programs differ by so much
_key = attrgetter("photo", "point", "model")


def parse_image_points(path: Path, block: Block, raw: bytes | None = None) -> ImagePoints:
    """Read an image_points.csv.

    Parameters
    ----------
    path
        The file.
    block
        The block as its block.toml declares it: its photos, cameras and models. Without strips
        and with one camera, photos need not be declared.
    raw
        What stands in the file; None: it is opened.

    Returns
    -------
    ImagePoints
        The rows in file order, coordinates in mm.

    Raises
    ------
    InputError
        The first row that is wrong, with file, line and column.
    """
    return image_points_of(*image_point_rows(path, block, raw))


def image_points_of(table: CsvColumns, of_photo: Mapping[str, Camera]) -> ImagePoints:
    """Return the image points that the rows of a file are, as `image_point_rows` has them.

    Raises
    ------
    InputError
        A coordinate that the photo's camera cannot have, or no camera sees.
    """
    names = PIXELS if PIXELS[0] in table.header else ("x", "y")
    model, use, reason = (Coded.read(table.coded(name)) for name in ("model", "use", "reason"))
    columns = read_columns(
        Coded.read(table.coded("photo")),
        Coded.read(table.coded("point")),
        paired(*map(table.numbers, names)),
        table.numbers("sigma_um"),
        (model, use, reason),
    )
    return ImagePoints(columns=_without_lenses(table, columns, of_photo))


def format_image_points(points: Iterable[ImagePoint], block: Block | None = None) -> str:
    """Return the text of an image_points.csv.

    Parameters
    ----------
    points
        The rows.
    block
        Says which cameras they are seen with, and whether they are written in pixels; None: all
        are ideal coordinates, in mm.

    Coordinates are written with the fewest digits that are read back as the same number; the
    columns sigma_um, use and reason only where a row needs them.

    Raises
    ------
    InputError
        A row that could not be read again: a bad name, a number that is none, a row twice.
    """
    rows = points if isinstance(points, ImagePoints) else ImagePoints(points)
    columns = rows.columns
    if not _surely_writable(rows):
        _check_rows(rows)
    places = _as_measured(rows, block)
    beside: list[tuple[str, Callable[[slice], Sequence[object]]]] = [
        ("model", columns.model.listed)
    ]
    sigmas = columns.sigma_um
    if sigmas is not None:
        beside.insert(0, ("sigma_um", lambda some: stated_sigmas(sigmas[some])))
    if any(use != "xy" for use in columns.use.values):
        beside.append(("use", columns.use.listed))
    if any(reason is not None for reason in columns.reason.values):
        beside.append(("reason", columns.reason.listed))
    xy = PIXELS if block is not None and block.in_pixels else ("x", "y")
    return csv_text_of_columns(
        ("photo", "point", *xy, *(name for name, _ in beside)),
        len(rows),
        lambda some: [
            columns.photo.listed(some),
            columns.point.listed(some),
            *places[some].T.tolist(),
            *(listed(some) for _, listed in beside),
        ],
    )


def reformat_image_points(
    path: Path,
    raw: bytes,
    points: Iterable[ImagePoint],
    block: Block,
    found: Iterable[ImagePoint] | None = None,
) -> str:
    """Return the text of an image_points.csv that is there already, with other rows.

    What has not changed stands there as it stood: line ends, order of columns, digits.

    Parameters
    ----------
    path, raw
        The file, and what stands in it.
    points
        The rows.
    block
        As `format_image_points` has it, and as `parse_image_points`.
    found
        The rows that the file has, where they are known: only those that change are looked at.

    Raises
    ------
    InputError
        As `format_image_points`; the file cannot be read.
    """
    rows = points if isinstance(points, ImagePoints) else ImagePoints(points)
    if says_pixels(BytesIO(raw)) != block.in_pixels:
        return format_image_points(rows, block)
    first, old, new = 0, None, rows
    if found is not None:
        there = ImagePoints(found).rows
        first, behind = unchanged_ends(there, rows.rows, measured=True)
        old, new = (ImagePoints(every[first : len(every) - behind]) for every in (there, rows.rows))
        kept = (*rows[:first], *rows[len(rows) - behind :])
        if not (_surely_writable(new) and set(map(_key, new)).isdisjoint(map(_key, kept))):
            _check_rows(rows)
    elif not _surely_writable(rows):
        _check_rows(rows)
    text = (BOM_UTF8.decode() if raw.startswith(BOM_UTF8) else "") + decoded(raw, path)
    if old is None:
        # of the same bytes: lines of another file would be taken for these rows
        old = parse_image_points(path, block, raw)
    return rewritten(text, _written(old, block), _written(new, block), first)


def _written(rows: ImagePoints, block: Block) -> Columns:
    """Return the fields that say rows."""
    columns = rows.columns
    sigmas = columns.sigma_um
    x, y = _as_measured(rows, block).T.tolist()
    names = PIXELS if block.in_pixels else ("x", "y")
    return {
        "photo": columns.photo.listed(),
        "point": columns.point.listed(),
        names[0]: x,
        names[1]: y,
        "sigma_um": [None] * len(rows) if sigmas is None else stated_sigmas(sigmas),
        "model": columns.model.listed(),
        "use": columns.use.listed(),
        "reason": columns.reason.listed(),
    }


def _as_measured(rows: ImagePoints, block: Block | None) -> Array:
    """Return (n, 2) what is written: what was read, else what their cameras make of x and y."""
    columns = rows.columns
    stated = columns.stated
    if block is None:
        if stated.any():
            raise _unwritable(
                rows[int(stated.argmax())], "it was measured in pixels, or through a lens"
            )
        return columns.xy
    if columns.measured is not None and stated.all():
        return columns.measured
    if not block.in_pixels and not any(map(has_lens, block.cameras)):
        # nothing stands between
        return columns.xy if columns.measured is None else columns.placed
    bare = columns.photo.each(lambda photo: block.camera_of(photo).pixels is None)
    if block.in_pixels and any(bare.values):
        for k, without in enumerate(bare.listed()):
            if without and not stated[k]:
                camera = quoted(block.camera_of(rows[k].photo).id)
                raise _unwritable(rows[k], f"camera {camera} has no pixels")
    return measured_places(block, rows, pixels=block.in_pixels)


def _without_lenses(
    table: CsvColumns, columns: PointColumns, cameras: Mapping[str, Camera]
) -> PointColumns:
    """Return columns with ideal coordinates, and what was measured where that is something else.

    Raises
    ------
    InputError
        A coordinate that the photo's camera cannot have, or no camera sees.
    """
    pixels = PIXELS[0] in table.header
    if not pixels:
        row = first_beyond_reach(columns, cameras)
        if row is not None:
            raise outside(table, row, cameras[columns.photo.at(row)], *columns.xy[row].tolist())
        if not any(map(has_lens, cameras.values())):
            return columns
    ideal, measured = columns.xy.copy(), columns.xy.copy()
    for camera, rows in rows_by_camera(columns.photo, cameras):
        if not pixels and not has_lens(camera):
            measured[rows] = math.nan
            continue
        places = columns.xy[rows]
        if pixels:
            _check_pixels(table, rows, places, camera)
        found = ideal_rays(camera, mm_of_pixels(camera, places) if pixels else places)
        unseen = (found != found).any(axis=1)
        if unseen.any():
            what = f"the lens of camera {quoted(camera.id)} images nothing there"
            raise table.fail(int(rows[unseen.argmax()]), PIXELS[0] if pixels else "x", what)
        ideal[rows] = found
    return replace(columns, xy=ideal, measured=measured)


def _check_pixels(table: CsvColumns, rows: Index, places: Array, camera: Camera) -> None:
    """Refuse pixels of a camera that has none, and pixels outside the image."""
    if camera.pixels is None:
        raise table.fail(
            int(rows[0]),
            PIXELS[0],
            f"camera {quoted(camera.id)} states no pixels = [width, height]",
        )
    for name, most, values in zip(PIXELS, camera.pixels, places.T, strict=True):
        beside = (values < -_BESIDE) | (values > most + _BESIDE)
        if beside.any():
            at = int(beside.argmax())
            raise table.fail(
                int(rows[at]),
                name,
                f"{values[at]:g} px lies outside the image of camera {quoted(camera.id)} "
                f"(0 to {most} px)",
            )


def outside(table: CsvColumns, row: int, camera: Camera, x: float, y: float) -> InputError:
    """Return the error about a row whose image coordinates [mm] a camera cannot have."""
    reach_x, reach_y = camera.reach()
    column, value, most = ("y", y, reach_y) if abs(x) <= reach_x else ("x", x, reach_x)
    limit = "the format" if camera.format is not None else "4 c"
    return table.fail(
        row,
        column,
        f"{value:g} mm lies outside {limit} of camera {quoted(camera.id)} "
        f"(-{most:g} to {most:g} mm)",
    )


def _surely_writable(rows: ImagePoints) -> bool:
    """Return whether nothing of any row can be wrong: what many rows have is looked at once."""
    columns = rows.columns
    if stand_again(columns.photo, columns.point, columns.model).any():
        return False
    if any(map(name_fault, columns.point.values)) or any(map(name_fault, columns.photo.values)):
        return False
    if not columns.finite:
        return False
    try:
        for k in samples(columns):
            _check_writable(rows[k])
    except InputError:
        return False
    return True


def _check_rows(rows: Iterable[ImagePoint]) -> None:
    """Refuse the first row that could not be read again."""
    seen: set[tuple[str, str, str | None]] = set()
    for row in rows:
        _check_writable(row)
        key = _key(row)
        if key in seen:
            raise _unwritable(row, "stands twice")
        seen.add(key)


def _check_writable(row: ImagePoint) -> None:
    for what, name in (("photo", row.photo), ("point", row.point)):
        fault = name_fault(name)
        if fault is not None:
            raise _unwritable(row, f"its {what} name {fault}")
    if row.model is not None:
        splits = [s for s in model_splits(row.model) if not any(map(name_fault, s))]
        if not splits:
            raise _unwritable(row, "its model is not of the form left/right")
        if not any(row.photo in split for split in splits):
            raise _unwritable(row, "its model does not contain its photo")
    if not (math.isfinite(row.x) and math.isfinite(row.y)):
        raise _unwritable(row, "its coordinates are not finite")
    if row.sigma_um is not None and not (math.isfinite(row.sigma_um) and row.sigma_um > 0.0):
        raise _unwritable(row, "its sigma_um is not a finite number greater than 0")
    for what, kind in (("use", USE), ("reason", REASON)):
        try:
            kind.of(getattr(row, what))
        except WrongValueError as error:
            raise _unwritable(row, f"its {what} {error}") from None


def _unwritable(row: ImagePoint, why: str) -> InputError:
    return InputError(
        f"image point {quoted(row.point)} of photo {quoted(row.photo)} cannot be written: {why}"
    )
