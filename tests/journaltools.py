"""Events into a journal, and out of its records."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import Journal, JournalRecord, event_of
from anaplot.session.events import EVENT_KINDS, Event


def append_event(journal: Journal, event: Event, *, durable: bool = True) -> int:
    """Write a session event; its sequence number."""
    return journal.append(event.kind, event_to_payload(event), durable=durable)


def events_of(records: Iterable[JournalRecord]) -> tuple[Event, ...]:
    """The session events among records, in order."""
    return tuple(event_of(record) for record in records if record.kind in EVENT_KINDS)
