"""What a block's journal says of it beside its files, where it has one."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import IMAGE_POINTS_CSV
from anaplot.photogrammetry.block import Block
from anaplot.textfiles.wording import place

if TYPE_CHECKING:
    from anaplot.exchange.recordline import JournalRecord
    from anaplot.session.state import SessionState
    from anaplot.station.editedrows import EditedRow

__all__ = ["Journaled", "journaled"]


class Journaled(NamedTuple):
    """What a block's journal says of it, read without a lock beside the files.

    Attributes
    ----------
    state
        To which it led; None where there is none, or it was not read.
    edited
        Rows of which the file says something else.
    lacking
        How many measurements of accepted models have no row in the file.
    unread
        Why it was not read, or "".
    """

    state: SessionState | None = None
    edited: tuple[EditedRow, ...] = ()
    unread: str = ""
    lacking: int = 0

    def remark(self, folder: Path) -> str:
        """Return in a line that the journal was not read or that the file differs, or ""."""
        if self.unread:
            return self.unread
        if not self.edited:
            return self._lacking(folder)
        more = len(self.edited) - 1
        others = "" if not more else f" (and {more} more row{'s' if more > 1 else ''})"
        from anaplot.station.editedrows import told

        return told(folder, self.edited[0]) + others

    def _lacking(self, folder: Path) -> str:
        if not self.lacking:
            return ""
        rows = "a measurement" if self.lacking == 1 else f"{self.lacking} measurements"
        return (
            f"{place(folder / IMAGE_POINTS_CSV)} lacks {rows} of accepted models that the journal "
            "has: anaplot open brings them back"
        )


def journaled(folder: Path, block: Block) -> Journaled:
    """Return what the journal in a block folder says; nothing is locked, and nothing changed.

    A console may be writing it: what of it is on disk counts.

    Parameters
    ----------
    folder
        The block folder.
    block
        As read from it, before: whatever of the session's stands in it is in the journal by now.
    """
    sessions = folder / "sessions"
    if not os.path.lexists(sessions) or (sessions.is_dir() and not any(sessions.glob("*.jsonl"))):
        return Journaled()
    from anaplot.exchange.journal import read_journal
    from anaplot.exchange.journalkinds import is_event
    from anaplot.session.state import start

    try:
        records = read_journal(folder, keep=is_event).records
        if not records:
            return Journaled(start(block))  # nothing happened that a file could differ from
        return _compared(folder, block, records)
    except InputError as error:
        return Journaled(unread=f"the journal was not read: {error}")


def _compared(folder: Path, block: Block, records: Iterable[JournalRecord]) -> Journaled:
    from anaplot.station.edited import decided_rows, edited_rows
    from anaplot.station.imagepoints import accepted_ever, measured_here
    from anaplot.station.rejectedelsewhere import elsewhere
    from anaplot.station.restored import restored

    events, state = restored(block, records)
    new, said = elsewhere(folder, block, state, events)
    edited = edited_rows(folder, block, said, accepted_ever(events))
    there = {(row.photo, row.point) for row in block.image_points}
    lacking = {(photo, point) for photo, point, *_ in measured_here(state.models)} - there
    return Journaled(state, (*decided_rows(block, state, new), *edited), lacking=len(lacking))
