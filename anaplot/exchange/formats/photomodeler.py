"""PhotoModeler's 2D export: image points in pixels, with a header of named columns."""

from __future__ import annotations

import csv
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.formats.door import Imported, ImportOptions, Note
from anaplot.exchange.formats.gathered import MAX_TABLE_BYTES, check_with, head_of
from anaplot.exchange.formats.pixeltables import (
    PixelRow,
    pixel_block,
    read_control_table,
    read_image_names,
    shift_of,
)
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.exchange.formats.statedcameras import needed_camera
from anaplot.photogrammetry.block import ControlPoint
from anaplot.textfiles.wording import place, plain

__all__ = ["read", "recognises"]

_COLUMNS = {name.lower(): name for name in ("Object Point ID", "Photo #", "X", "Y")}
_FILES = ("control", "images")
_LOOK = 2000


def recognises(source: Path) -> bool:
    """Return whether a file begins with the header of a 2D export."""
    first = head_of(source, _LOOK).lstrip("\ufeff").split("\n", 1)[0].lower().replace('"', "")
    return [part.strip() for part in first.split(",")][:2] == ["object point id", "photo #"]


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a 2D export; raises InputError."""
    check_with(options.files, _FILES)
    camera, notes = needed_camera(options, pixels=True)
    shift = shift_of(options, notes)
    rows = _rows(source, notes)
    names = read_image_names(options.files["images"]) if "images" in options.files else {}
    control: list[ControlPoint] = []
    labels = 0
    if "control" in options.files:
        control, labels = read_control_table(options.files["control"])
    if labels:
        notes.append(Note("dropped", labels, "labels of control points: ids serve"))
    block = pixel_block(source.stem, camera, rows, names, control, options, shift, notes)
    return Imported(block, tuple(notes), (f"from {source.name}, PhotoModeler",))


def _rows(source: Path, notes: list[Note]) -> list[PixelRow]:
    rows: list[PixelRow] = []
    header: list[str] = []
    places: list[int] = []
    for line in source_lines(source, MAX_TABLE_BYTES):
        fields = _fields(line)
        if not any(fields):
            continue
        if not header:
            header = [field.lower() for field in fields]
            missing = next((name for key, name in _COLUMNS.items() if key not in header), None)
            if missing is not None:
                raise line.fail(f"the header names no column {missing}")
            places = [header.index(key) for key in _COLUMNS]
            more = [field for field in fields if field.lower() not in _COLUMNS]
            if more:
                text = "columns are not read"
                notes.append(Note("dropped", len(more), text, tuple(plain(n, 40) for n in more)))
            continue
        if len(fields) != len(header):
            raise line.fail(f"{len(fields)} fields, the header has {len(header)}")
        point, photo, x, y = (fields[k] for k in places)
        at = line.numbers_of([x, y], "X and Y")
        names = line.name_of(photo, "photo"), line.name_of(point, "point")
        rows.append(PixelRow(line, *names, at[0], at[1], None))
    if not rows:
        raise InputError(f"{place(source)}: no image point")
    return rows


def _fields(line: SourceLine) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([line.text], strict=True), [])]
    except csv.Error as error:
        raise line.fail(f"not a row: {plain(str(error), 80)}") from None
