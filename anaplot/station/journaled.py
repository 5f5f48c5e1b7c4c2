"""What a block's journal says of it beside its files, where it has one."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import IMAGE_POINTS_CSV
from anaplot.photogrammetry.block import Block
from anaplot.textfiles.wording import place

if TYPE_CHECKING:
    from anaplot.exchange.recordline import JournalRecord
    from anaplot.session.events import DecisionsTakenOver
    from anaplot.session.state import SessionState
    from anaplot.station.editedrows import EditedRow
    from anaplot.station.restored import Folding
    from anaplot.station.sessionlog import SessionLog

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


def journaled(folder: Path, block: Block, read: SessionLog | None = None) -> Journaled:
    """Return what the journal in a block folder says; nothing is locked, and nothing changed.

    A console may be writing it: what of it is on disk counts.

    Parameters
    ----------
    folder
        The block folder.
    block
        As read from it, before: whatever of the session's stands in it is in the journal by now.
    read
        What was read of the journal after the block, where it was: it is not read again, if it
        was of the block as it is declared there.
    """
    sessions = folder / "sessions"
    if not os.path.lexists(sessions) or (sessions.is_dir() and not any(sessions.glob("*.jsonl"))):
        return Journaled()
    from anaplot.exchange.journalkinds import is_event
    from anaplot.exchange.journalread import scan_journal
    from anaplot.session.state import start

    begin = start(block)
    try:
        if read is not None and read.state is not None and read.block == begin.block:
            return _compared(folder, block, read.state, read.ever, read.taken)
        begun: list[Folding] = []

        def take(record: JournalRecord) -> None:
            if not begun:  # where nothing happened yet, what an event needs is not loaded
                from anaplot.station.restored import Folding

                begun.append(Folding(begin))
            begun[0].take(record)

        scan_journal(folder, is_event, take)
        if not begun:
            return Journaled(begin)  # nothing happened that a file could differ from
        (folding,) = begun
        folding.check()
        return _compared(folder, block, folding.state, folding.ever, folding.taken)
    except InputError as error:
        return Journaled(unread=f"the journal was not read: {error}")


def _compared(
    folder: Path,
    block: Block,
    state: SessionState,
    ever: Collection[str],
    taken: DecisionsTakenOver | None,
) -> Journaled:
    """Compare files with what the journal led to.

    `ever` are the names of all models that were ever accepted, `taken` the decisions that were
    taken over last.
    """
    from anaplot.station.edited import decided_rows, edited_rows
    from anaplot.station.imagepoints import measured_here
    from anaplot.station.rejectedelsewhere import elsewhere

    new, said = elsewhere(folder, block, state, taken)
    edited = edited_rows(folder, block, said, ever)
    there = {(row.photo, row.point) for row in block.image_points}
    lacking = {(photo, point) for photo, point, *_ in measured_here(state.models)} - there
    return Journaled(state, (*decided_rows(block, state, new), *edited), lacking=len(lacking))
