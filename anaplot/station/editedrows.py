"""Rows of the session's in image_points.csv that somebody else changed, and what is said then."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from anaplot.exchange.blockfolder import IMAGE_POINTS_CSV
from anaplot.photogrammetry.block import ImagePoint
from anaplot.photogrammetry.measuredimage import computed_place
from anaplot.textfiles.wording import place, quoted

__all__ = ["EditedRow", "told"]

_BACK = "adjust --apply-undo takes back what --apply switched off"


class EditedRow(NamedTuple):
    """A row of the session's that somebody else changed.

    Attributes
    ----------
    here
        As the file has it.
    journal
        As the journal has it; None where the journal has no such row.
    taken_over
        Whether the session takes that over when it is opened.
    """

    here: ImagePoint
    journal: ImagePoint | None
    taken_over: bool = False


def told(folder: Path, edited: EditedRow) -> str:
    """Return in words what was changed in a folder's file, and what to do."""
    words = _told_taken(*edited[:2]) if edited.taken_over else _told(*edited[:2])
    return f"{place(folder / IMAGE_POINTS_CSV)}: {words}"


def _where(row: ImagePoint) -> str:
    where = f"photo {quoted(row.photo)}, point {quoted(row.point)}"
    return where if row.model is None else f"{where} of model {quoted(row.model)}"


def _told_taken(row: ImagePoint, mine: ImagePoint | None) -> str:
    before = "" if mine is None else f" and {mine.use} in the journal"
    return (
        f"{_where(row)} was switched by adjust: use is {row.use} there{before}: the console takes "
        f"that over when it opens the block"
    )


def _told(row: ImagePoint, mine: ImagePoint | None) -> str:
    where = _where(row)
    if mine is None:
        return (
            f"{where} is not in the session's journal: take the row out, or leave its model blank"
        )
    if (mine.x, mine.y) != computed_place(row):
        return (
            f"{where} was changed outside the session: x, y are {row.x}, {row.y} there and "
            f"{mine.x}, {mine.y} in the journal: put them back, then measure again in the console"
        )
    return (
        f"{where} was changed outside the session: use is {row.use} there and {mine.use} in the "
        f"journal: put it back ({_BACK}), then switch the row in the console"
    )
