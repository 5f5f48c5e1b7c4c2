"""What a station writes into its journal, and in which order."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import Journal, JournalError
from anaplot.session.events import Event
from anaplot.session.notes import Note, NoteKind
from anaplot.session.workflow import Outlook
from anaplot.station.idlepolls import Item, folded, is_one_run, recent_part
from anaplot.station.tables import inner_table_payload, table_payload

__all__ = ["Recorder"]

_BATCH_CHARACTERS = 40_000
_BATCH_SECONDS = 1.0
_MOST_CHARACTERS = 600_000  # what one line holds safely; more gathers only while a disk is full
_ITEM_CHARACTERS = 40  # brackets, quotes, commas and the time of one item
_WHOLE_SECONDS = 2.5  # of polls stay whole before whatever happens
_IDLE_SECONDS = 60.0  # after which a run of identical polls is written


class Recorder:
    """Puts the line's raw traffic before the event that came of it.

    Traffic is written in batches: with the next event, when much has gathered, or after a second;
    while a device says the same again and again, once a minute (see `idlepolls`). Not safe to use
    from several threads: the station calls it under its own lock.

    Parameters
    ----------
    journal
        The block's journal.
    clock
        Seconds that never go back.
    """

    def __init__(self, journal: Journal, clock: Callable[[], float]) -> None:
        self._journal = journal
        self._clock = clock
        self._traffic: list[Item] = []
        self._first = 0.0
        self._idle = False
        self._bytes = 0
        self._characters = 0
        self._refused = False
        self._since = self._begin = clock()

    def traffic(self, direction: Literal["in", "out"], link: str, data: bytes, when: float) -> None:
        """Remember bytes of the line (as Latin-1 text, one character a byte) and their time [s].

        Raises
        ------
        JournalError
            What had gathered could not be written: told once, until the disk takes some again.
        """
        self._bytes += len(data)
        self._gather(direction, link, data.decode("latin-1"), when)
        # a disk that is full is not asked with every byte
        most = _MOST_CHARACTERS / 2 if self._idle else _BATCH_CHARACTERS
        full = self._characters >= most and not self._refused
        if full or self._clock() - self._since >= _BATCH_SECONDS:
            told = self._refused
            try:
                self._flush_in_time()
            except JournalError:
                if not told:
                    raise

    def _flush_in_time(self) -> None:
        """Write what has gathered, but for a run of identical polls that goes on."""
        if self._refused:
            self.flush()
            return
        now = self._clock()
        before = self._time(now) - _WHOLE_SECONDS
        self._traffic = folded(self._traffic, before)
        self._characters = _characters(self._traffic)
        self._idle = is_one_run(self._traffic) and self._characters < _MOST_CHARACTERS / 2
        if not self._idle:
            self.flush()
            return
        self._since = now
        at = recent_part(self._traffic, before)
        if at and now - self._first >= _IDLE_SECONDS:
            recent = self._traffic[at:]
            del self._traffic[at:]
            try:
                self.flush()
            finally:
                self._traffic += recent
                self._characters = _characters(self._traffic)
                self._first = now

    def told(self, kind: str, text: str, when: float) -> None:
        """Remember what else the decoder was told (a press, a reference)."""
        self._gather("decoder", kind, text, when)

    def _gather(self, kind: str, name: str, text: str, when: float) -> None:
        size = _characters([(kind, name, text, when)])
        if self._characters + size > _MOST_CHARACTERS:
            lost = self._bytes
            self._forget()
            self._bytes = lost
            words = f"{lost} bytes: the disk took no records"
            self._traffic.append(("lost", name, words, self._time(when)))
            self._characters = len(words) + len(name) + _ITEM_CHARACTERS
            if kind != "decoder":
                return
        if not self._traffic:
            self._first = self._clock()
        self._traffic.append((kind, name, text, self._time(when)))
        self._characters += size

    def _time(self, when: float) -> float:
        return round(when - self._begin, 5)

    def flush(self) -> None:
        """Write the gathered traffic.

        Raises
        ------
        JournalError
            It could not be written; it is kept for the next attempt.
        """
        self._since = self._clock()
        records = self._gathered()
        if records:
            self._refused = True
            self._journal.append_many(records, durable=False)
            self._forget()
        self._refused = False

    def events(self, events: Sequence[Event]) -> None:
        """Write events and bring them to disk, the traffic before them first.

        Raises
        ------
        JournalError
            They were refused; nothing is recorded.
        """
        if not events:
            return
        records = [*self._gathered(), *((e.kind, event_to_payload(e)) for e in events)]
        self._journal.append_many(records, durable=True)
        self._forget()

    def tables(self, old: Outlook, new: Outlook) -> str:
        """Write the tables that are new: what a replay will be compared with.

        Returns
        -------
        str
            Why the journal did not take them, or "": the measurements are safe in it, and a table
            can be computed again.
        """
        try:
            if new.solution is not None and new.solution is not old.solution:
                self.note("table", table_payload(new.solution))
            inner = None if new.inner is None else new.inner.solution
            before = None if old.inner is None else old.inner.solution
            if new.inner is not None and inner is not None and inner is not before:
                self.note("inner-table", inner_table_payload(new.inner.state, inner))
        except JournalError as error:
            return str(error)
        return ""

    def note(
        self, kind: NoteKind | Literal["table", "inner-table"], payload: Mapping[str, Any]
    ) -> None:
        """Write something that follows from events (a table) or explains them (a refusal)."""
        records = [*self._gathered(), (kind, payload)]
        self._journal.append_many(records, durable=False)
        self._forget()

    def explain(self, notes: Iterable[Note]) -> None:
        """Write what explains events, one after the other."""
        for kind, payload in notes:
            self.note(kind, payload)

    def _gathered(self) -> list[tuple[str, Mapping[str, Any]]]:
        before = self._time(self._clock()) - _WHOLE_SECONDS
        # while a disk is full there is much, and it was folded before
        items = self._traffic if self._refused else folded(self._traffic, before)
        return [("traffic", {"items": items})] if items else []

    def _forget(self) -> None:
        self._traffic = []
        self._bytes = self._characters = 0


def _characters(items: list[Item]) -> int:
    """Return about how long items are in the journal."""
    return sum(
        len(json.dumps(text)) + len(json.dumps(name)) + _ITEM_CHARACTERS
        for _, name, text, _ in items
    )
