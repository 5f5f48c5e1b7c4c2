"""Whether the snapshots of a journal say what its events lead to."""

from __future__ import annotations

from collections import Counter

from anaplot.errors import InputError
from anaplot.exchange.journal import JournalRecord
from anaplot.exchange.journalsnapshot import PART, SNAPSHOT, VERSIONS, text_of
from anaplot.exchange.statecodec import StateWriter, state_from_text
from anaplot.session.events import Event
from anaplot.session.pointedat import Target, pointed_at
from anaplot.session.state import SessionState, start
from anaplot.station.imagepoints import accepted_ever

__all__ = ["SnapshotCheck"]

_OTHERWISE = "the snapshot says otherwise than the events before it"


class SnapshotCheck:
    """Compares every snapshot with the fold of all events before it.

    Its text is compared with that of the state here, which costs what is new since the snapshot
    before. Only where they differ it is read: an older version may have said the same in another
    way.
    """

    def __init__(self) -> None:
        self._writer = StateWriter()
        self._parts: list[JournalRecord] = []
        self._count = 0
        self._ever: frozenset[str] = frozenset()
        self._pointed: Counter[Target] = Counter()

    def happened(self, event: Event, state: SessionState) -> None:
        """Take notice of an event, and of the state to which it led."""
        self._count += 1
        target = pointed_at(event, state.current)
        if target is not None:
            self._pointed[target] += 1
        self._ever |= accepted_ever((event,))

    def difference(self, record: JournalRecord, state: SessionState) -> str | None:
        """Return what differs between a snapshot's record and the state; None: nothing."""
        if record.kind == PART:
            self._parts.append(record)
            return None
        parts, self._parts = self._parts, []
        if record.kind != SNAPSHOT or record.payload.get("version") not in VERSIONS:
            return None
        text = text_of(parts)
        if text is None:
            return "the snapshot cannot be read"
        counted = record.payload.get("events") == self._count
        if text == self._writer.text(state, self._ever, self._pointed):
            return None if counted else _OTHERWISE
        try:
            told = state_from_text(text, start(state.block))
        except InputError as error:
            return str(error)
        said = told.state
        same = said == state and said.last_change == state.last_change
        same = same and (told.ever, told.pointed) == (self._ever, self._pointed)
        return None if same and counted else _OTHERWISE
