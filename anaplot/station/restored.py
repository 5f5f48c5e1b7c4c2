"""Where a block's journal says that its session stands."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.blocktoml import camera_texts, format_block_toml
from anaplot.exchange.journal import (
    Journal,
    JournalError,
    JournalRecord,
    Recovered,
    event_of,
    read_journal,
)
from anaplot.exchange.journalkinds import is_event
from anaplot.exchange.journalread import Choice
from anaplot.exchange.journalsnapshot import Snapshot
from anaplot.exchange.statecodec import StateWriter, state_from_text
from anaplot.photogrammetry.block import Block
from anaplot.session.events import Event, FiducialMeasured
from anaplot.session.pointedat import Target, Targets, pointed_at
from anaplot.session.state import EventRefusedError, SessionState, apply, fold, start
from anaplot.station.imagepoints import accepted_ever

__all__ = [
    "Past",
    "Snapshots",
    "block_digest",
    "choice_for",
    "past_of",
    "restored",
]

SPACING = 600
"""Events from one snapshot to the next."""

_BEHIND = 1200  # events wanted behind a snapshot: they hold all that may be undone, as a rule


@dataclass(frozen=True, slots=True)
class Past:
    """What happened in the sessions before.

    Attributes
    ----------
    events
        The events, those before a snapshot left out.
    count
        How many there were altogether.
    state
        To which they led.
    of_session
        Names "left/right" of every model that was ever accepted.
    pointed
        How often what was pointed at.
    """

    events: tuple[Event, ...]
    count: int
    state: SessionState
    of_session: frozenset[str]
    pointed: Targets = field(default_factory=dict)


def restored(
    block: Block, records: Iterable[JournalRecord]
) -> tuple[tuple[Event, ...], SessionState]:
    """Return what happened in the sessions before, and the state that it led to.

    Raises
    ------
    InputError
        A record is no event, or does not fit the block; says which.
    """
    folded = _folded(start(block), records)
    return folded.events, folded.state


class _Folded(NamedTuple):
    """Events, the state to which they led, and what was pointed at in them.

    `full` says whether undo once reached back as far as it ever does. From there on it is known
    whatever happened before the state in which the fold began: what else there was to undo has
    been forgotten.
    """

    events: tuple[Event, ...]
    state: SessionState
    pointed: Counter[Target]
    full: bool


def _folded(
    state: SessionState, records: Iterable[JournalRecord], before: Targets | None = None
) -> _Folded:
    """Fold the events that records are, with what was pointed at before."""
    events = []
    pointed = Counter(before)
    full = False
    for record in records:
        event = event_of(record)
        try:
            state = apply(state, event)
        except EventRefusedError as error:
            raise InputError(
                f"{record.file} line {record.line}: does not fit block.toml: {error}"
            ) from error
        events.append(event)
        target = pointed_at(event, state.current)
        if target is not None:
            pointed[target] += 1
        full = full or state.undo_is_full
    return _Folded(tuple(events), state, pointed, full)


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


def past_of(folder: Path, block: Block, recovered: Recovered) -> Past:
    """Return what a block's journal says that happened.

    Behind a snapshot only, where one leads to a state with as much to undo as there ever is;
    else from the beginning. Both ways lead to the same state.

    Parameters
    ----------
    folder, block
        The block folder, and what it declares.
    recovered
        What opening the journal gave.

    Raises
    ------
    InputError
        As `restored`.
    """
    past = _behind(block, recovered)
    if past is not None:
        return past
    records = recovered.records
    if recovered.snapshot is not None:
        records = read_journal(folder, keep=is_event).records
    events, state, pointed, _ = _folded(start(block), records)
    return Past(events, len(events), state, frozenset(accepted_ever(events)), pointed)


def _behind(block: Block, recovered: Recovered) -> Past | None:
    """Return what a snapshot and the events behind it lead to; None when that is not all."""
    snapshot = recovered.snapshot
    if snapshot is None:
        return None
    try:
        state, ever, before = state_from_text(snapshot.text, start(block))
        events, state, pointed, full = _folded(state, recovered.records, before)
    except InputError:
        return None  # the events from the beginning lead on, or say what is wrong
    if not full:
        return None
    count = snapshot.events + len(events)
    return Past(events, count, state, ever | accepted_ever(events), pointed)


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
        self._next = past.count + SPACING - past.count % SPACING

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
        self._next = self._count + SPACING
