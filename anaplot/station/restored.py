"""Where a block's journal says that its session stands."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.errors import InputError
from anaplot.exchange.journal import JournalRecord, event_of
from anaplot.photogrammetry.block import Block
from anaplot.session.events import Event
from anaplot.session.state import EventRefusedError, SessionState, apply, start

__all__ = ["restored"]


def restored(
    block: Block, records: Iterable[JournalRecord]
) -> tuple[tuple[Event, ...], SessionState]:
    """Return what happened in the sessions before, and the state that it led to.

    Raises
    ------
    InputError
        A record is no event, or does not fit the block; says which.
    """
    state = start(block)
    events = []
    for record in records:
        event = event_of(record)
        try:
            state = apply(state, event)
        except EventRefusedError as error:
            raise InputError(
                f"{record.file} line {record.line}: does not fit block.toml: {error}"
            ) from error
        events.append(event)
    return tuple(events), state
