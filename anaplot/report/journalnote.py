"""That a block's files say something else than its journal: a note, and no error."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.report.document import Answer, Document, Line, say

if TYPE_CHECKING:
    from anaplot.report.running import BlockOrFolder
    from anaplot.station.journaled import Journaled
    from anaplot.station.sessionlog import SessionLog

__all__ = [
    "SessionFiles",
    "journal_answer",
    "journal_note",
    "session_note",
    "session_of",
    "with_journal_notes",
]

_MOST = 10


def journal_note(folder: BlockOrFolder, block: Block) -> Answer | None:
    """Return how the files of a block folder differ from its journal.

    The journal is read without a lock and never stands in the way: one that is damaged, or that a
    newer version wrote, is noted as well.

    Parameters
    ----------
    folder
        Where the block comes from; there is nothing to say of one that is in no folder.
    block
        As read from it.

    Returns
    -------
    dict or None
        As `journal_answer` has it.
    """
    return None if isinstance(folder, Block) else _note(Path(folder), block)


def session_note(session: Path) -> Answer | None:
    """Return how the files differ from a journal that is read itself; as `SessionFiles.note`."""
    return SessionFiles(session).note()


class SessionFiles:
    """The files of a block as they are before its journal is read: they say nothing that is newer.

    Parameters
    ----------
    session
        A block folder; there is nothing to say of a journal file or a folder `sessions`.
    """

    def __init__(self, session: Path) -> None:
        self._folder = session
        self._block: Block | None = None
        self._why = ""
        if not (session / "block.toml").is_file():
            return
        try:
            self._block = read_block(session)
        except InputError as error:
            self._why = f"the files were not read: {error}"

    def note(self, read: SessionLog | None = None) -> Answer | None:
        """Return how they differ from the journal.

        Parameters
        ----------
        read
            What was read of the journal since, where it was.

        Returns
        -------
        dict or None
            As `journal_answer` has it; a block that cannot be read is noted as well.
        """
        if self._block is None:
            return _unread(self._why) if self._why else None
        return _note(self._folder, self._block, read)


def _note(folder: Path, block: Block, read: SessionLog | None = None) -> Answer | None:
    found = session_of(folder, block, read)
    return None if found is None else journal_answer(folder, found)


def session_of(folder: Path, block: Block, read: SessionLog | None = None) -> Journaled | None:
    """Return what a block's journal says of its files; None where it has no session.

    Parameters
    ----------
    folder, block
        The block folder, and what was read from it.
    read
        What was read of the journal since, where it was.
    """
    if not os.path.lexists(folder / "sessions"):
        return None
    # only blocks with a session need what a session needs
    from anaplot.station.journaled import journaled

    return journaled(folder, block, read)


def journal_answer(folder: Path, found: Journaled) -> Answer | None:
    """Return what programs read of the difference: the first rows, how many, and the remark.

    Parameters
    ----------
    folder
        The block folder.
    found
        What its journal says.

    Returns
    -------
    dict or None
        "count" of rows that differ (None: the journal was not read, or the files), the first of
        them as "rows", how many measurements the file is "lacking", and the "remark" for people;
        None where nothing differs.
    """
    remark = found.remark(folder)
    if not remark:
        return None
    if found.unread:
        return _unread(remark)
    rows = [
        {
            "photo": here.photo,
            "point": here.point,
            "model": here.model,
            "file": _row(here),
            "journal": None if mine is None else _row(mine),
        }
        for here, mine, _ in found.edited[:_MOST]
    ]
    return {
        "count": len(found.edited),
        "lacking": found.lacking,
        "rows": rows,
        "remark": remark,
    }


def _unread(remark: str) -> Answer:
    return {"count": None, "lacking": None, "rows": [], "remark": remark}


def _row(row: ImagePoint) -> Answer:
    return {"x": row.x, "y": row.y, "use": row.use}


def with_journal_notes(document: Document, *notes: Answer | None) -> Document:
    """Return a document that ends with the notes on its blocks, where there are any.

    Programs find the note under "differs_from_journal"; of several blocks a list, None where
    nothing differs.
    """
    lines = [_line(note) for note in notes if note is not None]
    if not lines:
        return document
    told = notes[0] if len(notes) == 1 else list(notes)
    answer = document.answer | {"differs_from_journal": told}
    return replace(document, answer=answer, page=(*document.page, *lines))


def _line(note: Answer) -> Line:
    return say("note: {}", note["remark"]).of("remark")
