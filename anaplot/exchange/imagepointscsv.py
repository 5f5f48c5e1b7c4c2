"""image_points.csv: measured image points, to and from text."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block, Camera, ImagePoint, Strip, image_points
from anaplot.photogrammetry.measuredimage import (
    has_lens,
    ideal_rays,
    measured_places,
    mm_of_pixels,
)
from anaplot.photogrammetry.selection import model_name, model_splits
from anaplot.textfiles.csvtable import MAX_CSV_BYTES, CsvColumns, csv_text, read_csv
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.kinds import (
    NAME,
    NUMBER,
    PHOTO,
    SIGMA,
    Blank,
    Fields,
    KnownName,
    Text,
    Word,
    WrongValueError,
)
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "format_image_points",
    "measured_rows",
    "outside",
    "parse_image_points",
    "points_in_pixels",
]

_COLUMNS = ("photo", "point", "x", "y", "sigma_um", "model", "use", "reason")
_PIXELS = ("x_px", "y_px")
_HEADER = 10_000  # bytes
_BESIDE = 0.5  # px that a coordinate may lie outside the image: programs differ by so much
_USE = Word("xy", "x", "y", "off")


class _Reason(Text):
    """What a person says of a row: text of one line."""

    def of(self, value: Any) -> str:
        """Return the text."""
        text = super().of(value)
        if not text.isprintable():
            raise WrongValueError("holds a character that cannot be printed")
        if text != text.strip():
            raise WrongValueError("begins or ends with a blank")
        return text


_REASON = _Reason(empty=False)


def parse_image_points(path: Path, block: Block) -> tuple[ImagePoint, ...]:
    """Read an image_points.csv.

    Parameters
    ----------
    path
        The file.
    block
        The block as its block.toml declares it: its photos, cameras and models. Without strips
        and with one camera, photos need not be declared.

    Returns
    -------
    tuple[ImagePoint, ...]
        The rows in file order, coordinates in mm.

    Raises
    ------
    InputError
        The first row that is wrong, with file, line and column.
    """
    either = [{"x": NUMBER, "y": NUMBER}, dict.fromkeys(_PIXELS, NUMBER)]
    table, of_photo = measured_rows(path, block, either)
    measured = _take_off_lenses(table, of_photo)
    return image_points(*(table[name] for name in _COLUMNS), measured)


def measured_rows(
    path: Path, block: Block, either: Sequence[Fields], more: Fields | None = None
) -> tuple[CsvColumns, dict[str, Camera]]:
    """Read a file of measured points, its coordinates as they stand there.

    Parameters
    ----------
    path, block
        As `parse_image_points`.
    either
        Columns of coordinates, see `read_csv`.
    more
        Further columns that may be there.

    Returns
    -------
    CsvColumns, dict[str, Camera]
        The columns, and the camera of each photo.

    Raises
    ------
    InputError
        As `parse_image_points`.
    """
    cameras = {camera.id: camera for camera in block.cameras}
    of_photo = {photo.id: cameras[photo.camera] for photo in block.photos}
    named_here = not block.strips and len(block.cameras) == 1
    table = read_csv(
        path,
        {
            "photo": PHOTO if named_here else KnownName("photo", of_photo),
            "point": NAME,
        },
        {
            "sigma_um": Blank(SIGMA),
            "model": Blank(Text()),
            "use": Blank(_USE),
            "reason": Blank(_REASON),
            **(more or {}),
        },
        either,
    )
    if named_here:
        of_photo.update(dict.fromkeys(table["photo"], block.cameras[0]))
    _check_models(table, of_photo, block.strips)
    table.refuse_twice("point", "photo", "model")
    table["use"][:] = [use or "xy" for use in table["use"]]
    return table, of_photo


def points_in_pixels(path: Path) -> bool:
    """Return whether an image_points.csv that could be read has x_px, y_px instead of x, y."""
    with open_input(path, MAX_CSV_BYTES) as file:
        return _PIXELS[0].encode() in file.readline(_HEADER)


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
    rows = list(points)
    if not _surely_writable(rows):
        _check_rows(rows)
    usual = {"sigma_um": None, "use": "xy", "reason": None}
    columns = [
        name
        for name in _COLUMNS[4:]
        if name not in usual or any(getattr(row, name) != usual[name] for row in rows)
    ]
    places = _as_measured(rows, block)
    xy = _PIXELS if block is not None and block.in_pixels else ("x", "y")
    return csv_text(
        ("photo", "point", *xy, *columns),
        (
            (row.photo, row.point, *place, *(getattr(row, name) for name in columns))
            for row, place in zip(rows, places, strict=True)
        ),
    )


def _as_measured(rows: Sequence[ImagePoint], block: Block | None) -> list[tuple[float, float]]:
    """Return what is written of rows: what was read, else what their cameras make of x and y."""
    out = [row.measured or (row.x, row.y) for row in rows]
    if block is None:
        stray = next((row for row in rows if row.measured is not None), None)
        if stray is not None:
            raise _unwritable(stray, "it was measured in pixels, or through a lens")
        return out
    if not block.in_pixels and not any(map(has_lens, block.cameras)):
        return out
    if not any(row.measured is None for row in rows):
        return out
    for row in rows:
        camera = block.camera_of(row.photo)
        if block.in_pixels and row.measured is None and camera.pixels is None:
            raise _unwritable(row, f"camera {quoted(camera.id)} has no pixels")
    places = measured_places(block, rows, pixels=block.in_pixels).tolist()
    return [(x, y) for x, y in places]


def _take_off_lenses(
    table: CsvColumns, cameras: Mapping[str, Camera]
) -> list[tuple[float, float] | None]:
    """Make the columns x and y ideal; return what was measured, where that is something else.

    Raises
    ------
    InputError
        A coordinate that the photo's camera cannot have, or no camera sees.
    """
    pixels = _PIXELS[0] in table.header
    measured: list[tuple[float, float] | None] = [None] * len(table)
    if not pixels:
        _check_inside(table, cameras)
    if not pixels and not any(map(has_lens, cameras.values())):
        return measured
    by_camera: dict[str, list[int]] = {}
    for row, photo in enumerate(table["photo"]):
        by_camera.setdefault(cameras[photo].id, []).append(row)
    if pixels:
        table["x"][:], table["y"][:] = table[_PIXELS[0]], table[_PIXELS[1]]
    xs, ys = table["x"], table["y"]
    known = {camera.id: camera for camera in cameras.values()}
    for name, rows in by_camera.items():
        camera = known[name]
        if not pixels and not has_lens(camera):
            continue
        if pixels:
            _check_pixels(table, rows, camera)
        places = [(xs[row], ys[row]) for row in rows]
        raw = mm_of_pixels(camera, places) if pixels else places
        ideal = ideal_rays(camera, raw).tolist()
        for row, place, (x, y) in zip(rows, places, ideal, strict=True):
            if math.isnan(x) or math.isnan(y):
                what = f"the lens of camera {quoted(name)} images nothing there"
                raise table.fail(row, _PIXELS[0] if pixels else "x", what)
            measured[row] = place
            xs[row], ys[row] = x, y
    return measured


def _check_pixels(table: CsvColumns, rows: Sequence[int], camera: Camera) -> None:
    """Refuse pixels of a camera that has none, and pixels outside the image."""
    if camera.pixels is None:
        raise table.fail(
            rows[0], _PIXELS[0], f"camera {quoted(camera.id)} states no pixels = [width, height]"
        )
    for name, most in zip(_PIXELS, camera.pixels, strict=True):
        column = table[name]
        for row in rows:
            if not -_BESIDE <= column[row] <= most + _BESIDE:
                raise table.fail(
                    row,
                    name,
                    f"{column[row]:g} px lies outside the image of camera {quoted(camera.id)} "
                    f"(0 to {most} px)",
                )


def _check_inside(table: CsvColumns, cameras: Mapping[str, Camera]) -> None:
    """Refuse a coordinate that the photo's camera cannot have."""
    reach = {photo: camera.reach() for photo, camera in cameras.items()}
    for row, (photo, x, y) in enumerate(zip(table["photo"], table["x"], table["y"], strict=True)):
        reach_x, reach_y = reach[photo]
        if not (-reach_x <= x <= reach_x and -reach_y <= y <= reach_y):
            raise outside(table, row, cameras[photo], x, y)


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


def _check_models(table: CsvColumns, photos: Iterable[str], strips: Collection[Strip]) -> None:
    """Refuse a model that is none of the strips', or not one of the row's photo.

    Without strips every pair of photos may have been a model.
    """
    if not any(table["model"]):
        return
    known: dict[str, set[str]] = {photo: set() for photo in photos}
    for strip in strips:
        for left, right in strip.models():
            known[left].add(model_name(left, right))
            known[right].add(model_name(left, right))
    rows = list(zip(table["photo"], table["model"], strict=True))
    suspect = {(photo, model) for photo, model in set(rows) if model and model not in known[photo]}
    for row, pair in enumerate(rows):
        # one after another: what is near an unknown name is looked for among all of them
        if pair in suspect:
            fault = _model_fault(*pair, known, bool(strips))
            if fault is not None:
                raise table.fail(row, "model", fault)
            suspect.remove(pair)


def _model_fault(
    photo: str, model: str, known: Mapping[str, Collection[str]], in_strip: bool
) -> str | None:
    splits = model_splits(model)
    if not splits:
        return f"{quoted(model)} must be of the form left/right"
    fits = [split for split in splits if split[0] in known and split[1] in known]
    if len(fits) > 1 and not in_strip:
        return f"{quoted(model)}: slashes in names of photos: more than one pair is meant"
    left, right = fits[0] if fits else splits[0]
    for name in (left, right):
        if name not in known:
            return f"{quoted(model)}: unknown photo {quoted(name)}{hint(name, known)}"
    if photo not in (left, right):
        return f"{quoted(model)} does not contain the row's photo {quoted(photo)}"
    if not in_strip:
        return None if left != right else f"{quoted(model)}: a photo beside itself"
    turned = model_name(right, left)
    if turned in known[photo]:
        return f"{quoted(model)}: in flight order it is {quoted(turned)}"
    return f"{quoted(model)}: the two photos do not follow each other in a strip"


def _surely_writable(rows: Sequence[ImagePoint]) -> bool:
    """Return whether nothing of any row can be wrong: what many rows have is looked at once."""
    photos: dict[tuple[str, str | None], set[str]] = {}
    for row in rows:
        photos.setdefault((row.photo, row.model), set()).add(row.point)
    if sum(map(len, photos.values())) < len(rows):
        return False
    points = set().union(*photos.values())
    if any(map(name_fault, points)) or any(name_fault(photo) for photo, _ in photos):
        return False
    if not all(math.isfinite(row.x) and math.isfinite(row.y) for row in rows):
        return False
    # of rows with the same entries of these columns one is looked at
    others = {(row.photo, row.model, row.sigma_um, row.use, row.reason): row for row in rows}
    try:
        for row in others.values():
            _check_writable(row)
    except InputError:
        return False
    return True


def _check_rows(rows: Iterable[ImagePoint]) -> None:
    """Refuse the first row that could not be read again."""
    seen: set[tuple[str, str, str | None]] = set()
    for row in rows:
        _check_writable(row)
        key = (row.photo, row.point, row.model)
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
    for what, kind in (("use", _USE), ("reason", Blank(_REASON))):
        try:
            kind.of(getattr(row, what))
        except WrongValueError as error:
            raise _unwritable(row, f"its {what} {error}") from None


def _unwritable(row: ImagePoint, why: str) -> InputError:
    return InputError(
        f"image point {quoted(row.point)} of photo {quoted(row.photo)} cannot be written: {why}"
    )
