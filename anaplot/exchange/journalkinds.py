"""Which kinds of records the journal of a session has, and which of them decide where it stands."""

from __future__ import annotations

from typing import get_args

from anaplot.exchange.journalsnapshot import PART, SNAPSHOT
from anaplot.exchange.recordline import OPENING, UnknownKindError
from anaplot.session.events import EVENT_KINDS
from anaplot.session.notes import NoteKind
from anaplot.textfiles.wording import quoted

__all__ = ["is_event", "is_known"]

_BESIDE = frozenset(
    (*OPENING, "traffic", "table", "inner-table", SNAPSHOT, PART, *get_args(NoteKind))
)


def is_event(kind: str) -> bool:
    """Whether records of a kind are events, which lead to where the session stands.

    Raises
    ------
    UnknownKindError
        It is not known: whether it decides anything cannot be told.
    """
    if kind in EVENT_KINDS:
        return True
    if kind not in _BESIDE:
        raise UnknownKindError(
            f"a record of kind {quoted(kind)}: written by a newer version of anaplot, this one "
            "does not know it"
        )
    return False


def is_known(kind: str) -> bool:
    """Whether a kind is known: True, or the error of `is_event`."""
    is_event(kind)
    return True
