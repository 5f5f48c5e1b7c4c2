"""Where a block's journal says that its session stands."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blocktoml import camera_texts, format_block_toml
from anaplot.exchange.journal import (
    Journal,
    JournalError,
    JournalRecord,
    event_of,
)
from anaplot.exchange.journalkinds import is_event
from anaplot.exchange.journalread import Choice, Take, scan_journal
from anaplot.exchange.journalsnapshot import Snapshot
from anaplot.exchange.statecodec import StateWriter, state_from_text
from anaplot.photogrammetry.block import Block
from anaplot.session.events import DecisionsTakenOver, Event, FiducialMeasured, ModelAccepted
from anaplot.session.pointedat import Targets, pointed_at
from anaplot.session.state import EventRefusedError, SessionState, apply, fold, start
from anaplot.station.imagepoints import accepted_ever

__all__ = [
    "Folding",
    "Past",
    "PastReading",
    "Snapshots",
    "block_digest",
    "choice_for",
]

SPACING = 600
"""Events from one snapshot to the next, where a block has no more models than that."""

_AT_ONCE = 500  # records: to fold them between two lines each takes longer
_BEHIND = 1200  # events wanted behind a snapshot: they hold all that may be undone, as a rule


@dataclass(frozen=True, slots=True)
class Past:
    """What happened in the sessions before.

    Attributes
    ----------
    folded
        How many events were read: all, or those behind a snapshot.
    count
        How many there were altogether.
    state
        To which they led.
    of_session
        Names "left/right" of every model that was ever accepted.
    pointed
        How often what was pointed at.
    taken
        The decisions that were taken over last in the events that were read.
    """

    folded: int
    count: int
    state: SessionState
    of_session: frozenset[str]
    pointed: Targets = field(default_factory=dict)
    taken: DecisionsTakenOver | None = None


class Folding:
    """The fold over a journal's events as its records come in, of which few are kept.

    The first that does not fit is kept in mind, and what comes behind it is left: whoever reads
    the journal says first what is wrong with it as such.

    Parameters
    ----------
    state
        In which it begins.
    before
        What was pointed at before.

    Attributes
    ----------
    state
        To which the events led.
    count
        How many there were.
    ever
        Names "left/right" of every model that was accepted in them, undone or not.
    taken
        The decisions that were taken over last in them.
    pointed
        How often what was pointed at.
    full
        Whether undo once reached back as far as it ever does. From there on it is known whatever
        happened before the state in which the fold began: what else there was to undo has been
        forgotten.
    """

    def __init__(self, state: SessionState, before: Targets | None = None) -> None:
        self.state = state
        self.count = 0
        self.ever: set[str] = set()
        self.taken: DecisionsTakenOver | None = None
        self.pointed = Counter(before)
        self.full = False
        self._wrong: InputError | None = None
        self._ahead: list[JournalRecord] = []

    @property
    def fits(self) -> bool:
        """Whether all events did, when the last ones were folded."""
        return self._wrong is None

    def take(self, record: JournalRecord) -> None:
        """Fold the event that a record is, with others or when the last one is taken."""
        self._ahead.append(record)
        if len(self._ahead) >= _AT_ONCE:
            self.fold()

    def fold(self) -> None:
        """Fold the last ones."""
        records, self._ahead = self._ahead, []
        if self._wrong is not None:
            return
        state, pointed, full = self.state, self.pointed, self.full
        for record in records:
            try:
                event = event_of(record)
                state = apply(state, event)
            except EventRefusedError as error:
                self._wrong = InputError(
                    f"{record.file} line {record.line}: does not fit block.toml: {error}"
                )
                break
            except InputError as error:
                self._wrong = error
                break
            self.count += 1
            if isinstance(event, ModelAccepted):
                self.ever |= accepted_ever((event,))
            elif isinstance(event, DecisionsTakenOver):
                self.taken = event
            target = pointed_at(event, state.current)
            if target is not None:
                pointed[target] += 1
            full = full or state.undo_is_full
        self.state, self.full = state, full

    def check(self) -> None:
        """Fold the last ones, and refuse what does not fit.

        Raises
        ------
        InputError
            A record is no event, or does not fit the block; says which.
        """
        self.fold()
        if self._wrong is not None:
            raise self._wrong


def block_digest(block: Block) -> str:
    """Return a digest of a block as declared, with its cameras."""
    digest = hashlib.sha256(format_block_toml(block).encode())
    for name, text in sorted(camera_texts(block).items()):
        digest.update(f"\0{name}\0{text}".encode())
    return digest.hexdigest()


def choice_for(block: Block) -> Choice:
    """Return what chooses the youngest snapshot of a block behind which enough happened."""
    digest = block_digest(block)

    def choose(found: Iterable[Snapshot]) -> Snapshot | None:
        youngest: int | None = None
        for snapshot in found:
            if snapshot.block != digest:
                return None
            youngest = snapshot.events if youngest is None else youngest
            if youngest - snapshot.events >= _BEHIND:
                return snapshot
        return None

    return choose


class PastReading:
    """What a block's journal says that happened, folded while the journal is opened.

    Behind a snapshot only, where one leads to a state with as much to undo as there ever is; else
    from the beginning. Both ways lead to the same state.

    Parameters
    ----------
    folder, block
        The block folder, and what it declares.
    """

    def __init__(self, folder: Path, block: Block) -> None:
        self._folder = folder
        self._start = start(block)
        self._all: Folding | None = None
        self._behind: tuple[Snapshot, frozenset[str], Folding] | None = None

    def begin(self, snapshot: Snapshot | None) -> Take:
        """Return what takes the records behind a snapshot, or all there are."""
        if snapshot is None:
            self._all = Folding(self._start)
            return self._all.take
        try:
            state, ever, before = state_from_text(snapshot.text, self._start)
        except InputError:
            return _pass_over
        self._behind = snapshot, ever, Folding(state, before)
        return self._behind[2].take

    @property
    def declared_alike(self) -> bool:
        """Whether the youngest snapshot is of the block as it is declared now."""
        return self._behind is not None

    def past(self) -> Past:
        """Return what happened, when all records were taken.

        Raises
        ------
        InputError
            As `Folding.check`.
        """
        if self._behind is not None:
            snapshot, ever, folding = self._behind
            folding.fold()
            if folding.full and folding.fits:
                return _past(folding, snapshot.events, ever)
        if self._all is None:  # the events from the beginning lead on, or say what is wrong
            self._all = Folding(self._start)
            scan_journal(self._folder, is_event, self._all.take)
        self._all.check()
        return _past(self._all, 0, frozenset())


def _pass_over(record: JournalRecord) -> None:
    """Take a record that is read again from the beginning."""


def _past(folding: Folding, before: int, ever: frozenset[str]) -> Past:
    return Past(
        folding.count,
        before + folding.count,
        folding.state,
        ever | folding.ever,
        folding.pointed,
        folding.taken,
    )


class Snapshots:
    """Writes into the journal, now and then, what the events so far led to.

    Parameters
    ----------
    journal
        The block's journal.
    block
        As declared.
    past
        What happened before.
    """

    def __init__(self, journal: Journal, block: Block, past: Past) -> None:
        self._journal = journal
        self._writer = StateWriter()
        self._digest = block_digest(block)
        self._count = past.count
        self._ever = set(past.of_session)
        self._pointed = Counter(past.pointed)
        self._state = past.state
        spacing = _spacing(past.state)
        self._next = past.count + spacing - past.count % spacing

    def happened(self, events: Iterable[Event], state: SessionState) -> None:
        """Take notice of recorded events, and of the state that they led to.

        A snapshot is written when a model was accepted. One that is refused is written later: the
        events are on disk.
        """
        events = tuple(events)
        self._count += len(events)
        accepted = accepted_ever(events)
        self._ever |= accepted
        before, self._state = self._state, state
        for number, event in enumerate(events, 1):
            after = state
            if number < len(events) and isinstance(event, FiducialMeasured):
                after = fold(before, events[:number])  # which model was in the instrument then
            target = pointed_at(event, after.current)
            if target is not None:
                self._pointed[target] += 1
        if not accepted or self._count < self._next:
            return
        try:
            text = self._writer.text(state, self._ever, self._pointed)
            self._journal.append_snapshot(text, self._digest, self._count)
        except JournalError:
            return
        self._next = self._count + _spacing(state)


def _spacing(state: SessionState) -> int:
    """Return how many events stand between two snapshots.

    A model takes about as much in a snapshot as an event in the journal: snapshots of many models
    at the same distance would soon be most of it.
    """
    return max(SPACING, len(state.models))
