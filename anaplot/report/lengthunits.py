"""Lengths in images are shown in px where the cameras' pixels have no size (conventions, Pixels).

There a pixel counts as 1 um, so that numbers stay and the unit alone is another. Keys of JSON and
CSV are those of every block.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any, overload

from anaplot.photogrammetry.block import Block
from anaplot.report.document import Block as Part
from anaplot.report.document import Document, Line, Listed, Names, Table, Value

__all__ = ["in_px", "with_lengths_of", "without_pixel_size"]

_UM = re.compile(r"(?<![\w.])um\b")


def without_pixel_size(block: Block) -> bool:
    """Return whether all cameras that took a photo have pixels of which no size is stated."""
    used = {photo.camera for photo in block.photos}
    cameras = [camera for camera in block.cameras if camera.id in used]
    return bool(cameras) and all(c.pixels is not None and c.pixel_um is None for c in cameras)


def with_lengths_of(block: Block, document: Document) -> Document:
    """Return a document of a block whose page names the unit that lengths in its images have."""
    if not without_pixel_size(block):
        return document
    return replace(document, page=tuple(map(in_px, document.page)))


@overload
def in_px(part: Line) -> Line: ...


@overload
def in_px(part: Table) -> Table: ...


@overload
def in_px(part: Listed) -> Listed: ...


@overload
def in_px(part: Part) -> Part: ...


def in_px(part: Part) -> Part:
    """Return a part of a page with px instead of um."""
    if isinstance(part, Line):
        return _line(part)
    if isinstance(part, Listed):
        return replace(part, lines=tuple(map(_line, part.lines)), more=_px(part.more))
    if isinstance(part, Table):
        return _table(part)
    return part


def _line(line: Line) -> Line:
    return replace(line, parts=tuple(map(_piece, line.parts)))


def _piece(piece: str | Value | Names) -> str | Value | Names:
    if isinstance(piece, str):
        return _px(piece)
    if isinstance(piece, Value):
        return replace(piece, unit=_px(piece.unit))
    return replace(piece, items=tuple(map(_line, piece.items)), more=_px(piece.more))


def _table(table: Table) -> Table:
    columns = [
        replace(
            column,
            title=_px(column.title),
            unit="kpx" if column.shown_unit == "um" else _px(column.unit),
            head=None if column.head is None else _px(column.head),
            form=None if column.form is None else _form(column.form),
        )
        for column in table.columns
    ]
    keys = {column.key for column in columns}
    shown = table.shown
    if shown is not None:
        shown = tuple(key if key in keys else _px(key) for key in shown)
    return replace(table, columns=tuple(columns), source=lambda: table.values, shown=shown)


def _form(form: Callable[[Any], str]) -> Callable[[Any], str]:
    """Return how a value is written; one that has its unit beside it gets another."""

    def written(value: Any) -> str:
        text = form(value)
        return _px(text) if isinstance(value, tuple) else text

    return written


def _px(text: str) -> str:
    return _UM.sub("px", text)
