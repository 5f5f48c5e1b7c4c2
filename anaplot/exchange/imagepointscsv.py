"""image_points.csv: measured image points, to and from text."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block, Camera, ImagePoint, Strip
from anaplot.photogrammetry.selection import model_name
from anaplot.textfiles.csvtable import CsvColumns, csv_text, read_csv
from anaplot.textfiles.kinds import (
    NAME,
    NUMBER,
    PHOTO,
    POSITIVE,
    Blank,
    KnownName,
    Text,
    Word,
    WrongValueError,
)
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import hint, quoted

__all__ = ["format_image_points", "parse_image_points"]

_COLUMNS = ("photo", "point", "x", "y", "sigma_um", "model", "use", "reason")
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
    cameras = {camera.id: camera for camera in block.cameras}
    of_photo = {photo.id: cameras[photo.camera] for photo in block.photos}
    named_here = not block.strips and len(block.cameras) == 1
    table = read_csv(
        path,
        {
            "photo": PHOTO if named_here else KnownName("photo", of_photo),
            "point": NAME,
            "x": NUMBER,
            "y": NUMBER,
        },
        {
            "sigma_um": Blank(POSITIVE),
            "model": Blank(Text()),
            "use": Blank(_USE),
            "reason": Blank(_REASON),
        },
    )
    if named_here:
        of_photo.update(dict.fromkeys(table["photo"], block.cameras[0]))
    _check_inside(table, of_photo)
    _check_models(table, of_photo, block.strips)
    table.refuse_twice("point", "photo", "model")
    table["use"][:] = [use or "xy" for use in table["use"]]
    return tuple(map(ImagePoint, *(table[name] for name in _COLUMNS)))


def format_image_points(points: Iterable[ImagePoint]) -> str:
    """Return the text of an image_points.csv.

    Coordinates are written with the fewest digits that are read back as the same number; the
    columns sigma_um, use and reason only where a row needs them.

    Raises
    ------
    InputError
        A row that could not be read again: a bad name, a number that is none, a row twice.
    """
    rows = list(points)
    seen: set[tuple[str, str, str | None]] = set()
    for row in rows:
        _check_writable(row)
        key = (row.photo, row.point, row.model)
        if key in seen:
            raise _unwritable(row, "stands twice")
        seen.add(key)
    usual = {"sigma_um": None, "use": "xy", "reason": None}
    columns = [
        name
        for name in _COLUMNS
        if name not in usual or any(getattr(row, name) != usual[name] for row in rows)
    ]
    return csv_text(columns, ([getattr(row, name) for name in columns] for row in rows))


def _check_inside(table: CsvColumns, cameras: Mapping[str, Camera]) -> None:
    """Refuse a coordinate that the photo's camera cannot have."""
    reach = {photo: camera.reach() for photo, camera in cameras.items()}
    for row, (photo, x, y) in enumerate(zip(table["photo"], table["x"], table["y"], strict=True)):
        reach_x, reach_y = reach[photo]
        if -reach_x <= x <= reach_x and -reach_y <= y <= reach_y:
            continue
        column, value, most = ("x", x, reach_x) if abs(x) > reach_x else ("y", y, reach_y)
        camera = cameras[photo]
        limit = "the format" if camera.format is not None else "4 c"
        raise table.fail(
            row,
            column,
            f"{value:g} mm lies outside {limit} of camera {quoted(camera.id)} "
            f"(-{most:g} to {most:g} mm)",
        )


def _check_models(table: CsvColumns, photos: Iterable[str], strips: Collection[Strip]) -> None:
    """Refuse a model that is none of the strips', or not one of the row's photo.

    Without strips every pair of photos may have been a model.
    """
    known: dict[str, set[str]] = {photo: set() for photo in photos}
    for strip in strips:
        for left, right in strip.models():
            known[left].add(model_name(left, right))
            known[right].add(model_name(left, right))
    rows = list(zip(table["photo"], table["model"], strict=True))
    suspect = {(photo, model) for photo, model in set(rows) if model and model not in known[photo]}
    wrong = {pair: fault for pair in suspect if (fault := _model_fault(*pair, known, bool(strips)))}
    if wrong:
        row = next(row for row, pair in enumerate(rows) if pair in wrong)
        raise table.fail(row, "model", wrong[rows[row]])


def _model_fault(
    photo: str, model: str, known: Mapping[str, Collection[str]], in_strip: bool
) -> str | None:
    left, slash, right = model.partition("/")
    if not slash or "/" in right or not left or not right:
        return f"{quoted(model)} must be of the form left/right"
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


def _check_writable(row: ImagePoint) -> None:
    for what, name, is_photo in (("photo", row.photo, True), ("point", row.point, False)):
        fault = name_fault(name, photo=is_photo)
        if fault is not None:
            raise _unwritable(row, f"its {what} name {fault}")
    if row.model is not None:
        parts = row.model.split("/")
        if len(parts) != 2 or any(name_fault(part, photo=True) for part in parts):
            raise _unwritable(row, "its model is not of the form left/right")
        if row.photo not in parts:
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
