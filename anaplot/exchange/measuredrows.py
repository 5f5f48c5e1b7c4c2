"""The rows of a file of measured points, as they stand there: names, models, numbers.

A file without rows is read by this alone, without arrays.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from anaplot.exchange.rejectedrows import own_text
from anaplot.photogrammetry.block import Block, Camera, Strip
from anaplot.photogrammetry.selection import model_name, model_splits
from anaplot.textfiles.csvtable import MAX_CSV_BYTES, CsvColumns, read_csv
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
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "PIXELS",
    "REASON",
    "USE",
    "image_point_rows",
    "measured_rows",
    "points_in_pixels",
    "says_pixels",
]

PIXELS = ("x_px", "y_px")
"""Columns of coordinates in pixels."""
USE = Word("xy", "x", "y", "off")
"""Which coordinates of a row count."""
_HEADER = 10_000  # bytes
_MOST_REASON = 400


class _Reason(Text):
    """What a person says of a row: text of one line; strategies may have put something before."""

    def of(self, value: Any) -> str:
        """Return the text."""
        text = super().of(value)
        if len(text) > _MOST_REASON and len(own_text(text)) > _MOST_REASON:
            raise WrongValueError(f"is longer than {_MOST_REASON} characters")
        if not text.isprintable():
            raise WrongValueError("holds a character that cannot be printed")
        if text != text.strip():
            raise WrongValueError("begins or ends with a blank")
        return text


REASON = Blank(_Reason(10 * _MOST_REASON, empty=False))
"""Why a row does not count, or blank."""


def image_point_rows(
    path: Path, block: Block, raw: bytes | None = None
) -> tuple[CsvColumns, dict[str, Camera]]:
    """Read the rows of an image_points.csv, as `measured_rows` does; x, y or x_px, y_px.

    Raises
    ------
    InputError
        As `measured_rows`.
    """
    either = [{"x": NUMBER, "y": NUMBER}, dict.fromkeys(PIXELS, NUMBER)]
    return measured_rows(path, block, either, raw=raw)


def measured_rows(
    path: Path,
    block: Block,
    either: Sequence[Fields],
    more: Fields | None = None,
    raw: bytes | None = None,
) -> tuple[CsvColumns, dict[str, Camera]]:
    """Read a file of measured points, its coordinates as they stand there.

    Parameters
    ----------
    path, block, raw
        As `parse_image_points` has them.
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
        },
        {
            "sigma_um": Blank(SIGMA),
            "model": Blank(Text()),
            "use": Blank(USE),
            "reason": REASON,
            **(more or {}),
        },
        either,
        raw,
    )
    if named_here:
        of_photo.update(dict.fromkeys(table.coded("photo")[0], block.cameras[0]))
    _check_models(table, of_photo, block.strips)
    if not len(table):
        return table, of_photo
    from anaplot.photogrammetry.pointcolumns import Coded, stand_again

    key = ("point", "photo", "model")
    if stand_again(*(Coded.read(table.coded(name)) for name in key)).any():
        table.refuse_twice(*key)
    return table, of_photo


def points_in_pixels(path: Path) -> bool:
    """Return whether an image_points.csv that could be read has x_px, y_px instead of x, y."""
    with open_input(path, MAX_CSV_BYTES) as file:
        return says_pixels(file)


def says_pixels(file: BinaryIO) -> bool:
    """Return whether the file's header has them."""
    return PIXELS[0].encode() in file.readline(_HEADER)


def _check_models(table: CsvColumns, photos: Iterable[str], strips: Collection[Strip]) -> None:
    """Refuse a model that is none of the strips', or not one of the row's photo.

    Without strips every pair of photos may have been a model.
    """
    if not any(table.coded("model")[0]):
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
