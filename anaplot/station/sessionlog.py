"""The changes that a block's journal tells of."""

from __future__ import annotations

from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.journal import JournalRecord, event_of, read_journal
from anaplot.session.changes import Change, Happened, changes
from anaplot.session.events import EVENT_KINDS
from anaplot.session.state import EventRefusedError
from anaplot.station.replay import recorded_block

__all__ = ["read_history", "read_log"]

_OPENED = ("header", "opened")
_WANTED = {*_OPENED, *EVENT_KINDS}


def read_log(session: Path) -> tuple[Change, ...]:
    """Return who changed what, from a journal file, a folder `sessions` or a block folder.

    Raises
    ------
    InputError
        It cannot be read, is damaged, or does not fit its block.
    """
    records, history = read_history(session)
    if not history:
        return ()
    try:
        return changes(recorded_block(session, records), history)
    except EventRefusedError as error:
        raise InputError(f"{session}: the journal does not fit its block: {error}") from None


def read_history(session: Path) -> tuple[tuple[JournalRecord, ...], tuple[Happened, ...]]:
    """Return the records of headers and events of a journal, and the events with who and when.

    Raises
    ------
    InputError
        It cannot be read, or is damaged.
    """
    records = read_journal(session, keep=lambda kind: kind in _WANTED).records
    who = ""
    history = []
    for record in records:
        if record.kind in _OPENED:
            named = record.payload.get("operator", "")
            who = named if isinstance(named, str) else ""
        else:
            history.append(Happened(record.time, who, event_of(record)))
    return tuple(records), tuple(history)
