"""The changes that a block's journal tells of."""

from __future__ import annotations

import threading
from collections import deque
from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.journal import JournalRecord, event_of
from anaplot.exchange.journalfollowed import FollowedJournal
from anaplot.exchange.journalkinds import is_event
from anaplot.exchange.journalread import scan_journal
from anaplot.exchange.recordline import OPENING
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.session.changes import AcceptedInner, Change, ChangeLog, Happened
from anaplot.session.events import DecisionsTakenOver
from anaplot.session.innerwork import solve_inner
from anaplot.session.state import EventRefusedError, SessionState
from anaplot.station.imagepoints import accepted_ever

__all__ = ["SessionLog", "read_history", "read_inner", "read_log"]


class _Told(NamedTuple):
    """What happened, and where the journal tells of it."""

    happened: Happened
    file: str
    line: int


class _History:
    """What the records of a journal tell, as they come in.

    The first that tells nothing is kept in mind, and what comes behind it is left: whoever reads
    the journal says first what is wrong with it as such.

    Parameters
    ----------
    who
        The operator so far.

    Attributes
    ----------
    openings
        The records of headers.
    events
        What happened.
    wrong
        Why a record is no event, or None.
    """

    def __init__(self, who: str = "") -> None:
        self.who = who
        self.openings: list[JournalRecord] = []
        self.events: list[_Told] = []
        self.wrong: InputError | None = None

    def take(self, record: JournalRecord) -> None:
        """Take notice of a record."""
        if record.kind in OPENING:
            self.openings.append(record)
            named = record.payload.get("operator", "")
            self.who = named if isinstance(named, str) else ""
        elif self.wrong is None:
            try:
                happened = Happened(record.time, self.who, event_of(record))
            except InputError as error:
                self.wrong = error
            else:
                self.events.append(_Told(happened, record.file, record.line))


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
        self._journal = FollowedJournal(session, _is_wanted)
        self.remarks: tuple[str, ...] = ()
        self._begin()

    def _begin(self) -> None:
        self._log: ChangeLog | None = None
        self._who = ""
        self._openings: list[JournalRecord] = []  # until it is known which block it is
        self._ahead: deque[_Told] = deque()
        self._wrong: InputError | None = None
        self._ever: set[str] = set()
        self._taken: DecisionsTakenOver | None = None

    def read(self) -> tuple[Change, ...]:
        """Return what changed so far; only what is new since the last time is read.

        Raises
        ------
        InputError
            It cannot be read, is damaged, or does not fit its block.
        """
        with self._one:
            if not self._journal.goes_on():
                self._begin()
            history = _History(self._who)
            self.remarks = self._journal.read(history.take)
            self._who = history.who
            if self._log is None:
                self._openings += history.openings
            self._ahead += history.events
            self._wrong = self._wrong or history.wrong
            if self._wrong is not None:
                raise InputError(str(self._wrong))
            self._go_on()
            return () if self._log is None else self._log.changes

    def _go_on(self) -> None:
        """Work out what is new."""
        if self._log is None and self._ahead:
            from anaplot.station.replay import recorded_block  # loads the room of instruments

            self._log = ChangeLog(recorded_block(self._session, self._openings))
            self._openings.clear()
        while self._log is not None and self._ahead:
            happened, file, line = self._ahead[0]
            try:
                self._log.add(happened)
            except EventRefusedError as error:
                raise InputError(
                    f"{file} line {line}: does not fit the block of the journal: {error}"
                ) from None
            self._ahead.popleft()
            self._ever |= accepted_ever((happened.event,))
            if isinstance(happened.event, DecisionsTakenOver):
                self._taken = happened.event

    @property
    def inner(self) -> tuple[AcceptedInner, ...]:
        """The inner orientations that were accepted in what was read."""
        return () if self._log is None else self._log.inner

    @property
    def block(self) -> Block | None:
        """The block as it was declared when it was opened last; None where nothing was read."""
        return None if self._log is None else self._log.state.block

    @property
    def state(self) -> SessionState | None:
        """To which what was read has led; None where nothing was."""
        return None if self._log is None else self._log.state

    @property
    def ever(self) -> frozenset[str]:
        """Names "left/right" of every model that was ever accepted in what was read."""
        return frozenset(self._ever)

    @property
    def taken(self) -> DecisionsTakenOver | None:
        """The decisions that were taken over last in what was read."""
        return self._taken


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
    """Return the records of headers of a journal, and its events with who and when.

    Raises
    ------
    InputError
        It cannot be read, or is damaged.
    """
    history = _History()
    scan_journal(session, _is_wanted, history.take)
    if history.wrong is not None:
        raise history.wrong
    return tuple(history.openings), tuple(told.happened for told in history.events)


def _is_wanted(kind: str) -> bool:
    return is_event(kind) or kind in OPENING
