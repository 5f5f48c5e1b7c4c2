"""The changes that a block's journal tells of."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.journal import JournalRecord, Recovered, event_of, read_journal
from anaplot.exchange.journalkinds import is_event
from anaplot.exchange.recordline import OPENING
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.session.changes import AcceptedInner, Change, ChangeLog, Happened
from anaplot.session.innerwork import solve_inner
from anaplot.session.state import EventRefusedError

__all__ = ["SessionLog", "read_history", "read_inner", "read_log"]


class SessionLog:
    """Who changed what, from a journal that may go on while it is read.

    Parameters
    ----------
    session
        A journal file, a folder `sessions` or a block folder.

    Attributes
    ----------
    remarks
        What of it was left out when it was read last: a torn end, files that are none of it.
    """

    def __init__(self, session: Path) -> None:
        self._session = session
        self._one = threading.Lock()
        self._log: ChangeLog | None = None
        self._count = 0  # events taken notice of
        self.remarks: tuple[str, ...] = ()

    def read(self) -> tuple[Change, ...]:
        """Return what changed so far; only what is new since the last time is worked out.

        Raises
        ------
        InputError
            It cannot be read, is damaged, or does not fit its block.
        """
        with self._one:
            recovered = _recovered(self._session)
            self.remarks = recovered.remarks
            records, history = recovered.records, _history(recovered.records)
            if not history:
                return ()
            if self._log is None:
                from anaplot.station.replay import recorded_block  # loads the room of instruments

                self._log = ChangeLog(recorded_block(self._session, records))
            try:
                for happened in history[self._count :]:
                    self._log.add(happened)
                    self._count += 1
            except EventRefusedError as error:
                events = (record for record in records if record.kind not in OPENING)
                at = next(islice(events, self._count, None))
                raise InputError(
                    f"{at.file} line {at.line}: does not fit the block of the journal: {error}"
                ) from None
            return self._log.changes

    @property
    def inner(self) -> tuple[AcceptedInner, ...]:
        """The inner orientations that were accepted in what was read."""
        return () if self._log is None else self._log.inner

    @property
    def block(self) -> Block | None:
        """The block as it was declared when it was opened last; None where nothing was read."""
        return None if self._log is None else self._log.block


def read_log(session: Path) -> tuple[Change, ...]:
    """Return who changed what, from a journal file, a folder `sessions` or a block folder.

    Raises
    ------
    InputError
        It cannot be read, is damaged, or does not fit its block.
    """
    return SessionLog(session).read()


def read_inner(session: Path) -> tuple[tuple[AcceptedInner, InnerOrientation], ...]:
    """Return the inner orientations that were accepted in a session, in order.

    Raises
    ------
    InputError
        It cannot be read, is damaged, or does not fit its block.
    """
    log = SessionLog(session)
    log.read()
    if log.block is None:
        return ()
    return tuple((one, solve_inner(log.block, one.inner)) for one in log.inner)


def read_history(session: Path) -> tuple[tuple[JournalRecord, ...], tuple[Happened, ...]]:
    """Return the records of headers and events of a journal, and the events with who and when.

    Raises
    ------
    InputError
        It cannot be read, or is damaged.
    """
    records = _recovered(session).records
    return records, _history(records)


def _recovered(session: Path) -> Recovered:
    return read_journal(session, keep=lambda kind: is_event(kind) or kind in OPENING)


def _history(records: Iterable[JournalRecord]) -> tuple[Happened, ...]:
    who = ""
    history = []
    for record in records:
        if record.kind in OPENING:
            named = record.payload.get("operator", "")
            who = named if isinstance(named, str) else ""
        else:
            history.append(Happened(record.time, who, event_of(record)))
    return tuple(history)
