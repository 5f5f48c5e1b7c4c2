"""Session events to and from JSON objects, strictly: what is written is read back equal.

What a field may hold is what its annotation in `anaplot.session.events` says, so that a new kind
of event needs nothing here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, get_type_hints

from anaplot.errors import InputError
from anaplot.exchange.annotatedkinds import AnnotatedKinds
from anaplot.session.events import EVENT_KINDS, Event, PhotoName
from anaplot.textfiles.kinds import (
    FLAG,
    NAME,
    NUMBER,
    PHOTO,
    Keys,
    Kind,
    Made,
    WrongValueError,
)
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = ["event_from_payload", "event_to_payload"]

MAX_PLAN = 4000
"""Points in one plan: what stays within one line of a journal."""


def event_to_payload(event: Event) -> dict[str, Any]:
    """Return an event as a JSON object without its kind.

    Values that are usual are left out: fields that came later read so in older journals.

    Raises
    ------
    InputError
        A name or a number that may not stand in a file.
    """
    checked = _read(event.kind, _plain(event))
    return {
        field.name: _plain(getattr(checked, field.name))
        for field in fields(checked)
        if field.default is MISSING or getattr(checked, field.name) != field.default
    }


def event_from_payload(kind: str, payload: Mapping[str, Any]) -> Event:
    """Return the event of a kind from its JSON object.

    Raises
    ------
    InputError
        Unknown kind, unknown or missing key, value of a wrong type.
    """
    if kind not in EVENT_KINDS:
        raise InputError(f"event: unknown kind {quoted(kind)}{hint(kind, EVENT_KINDS)}")
    return _read(kind, payload)


def _read(kind: str, payload: Mapping[str, Any]) -> Event:
    try:
        event: Event = _KINDS[kind].of(payload)
    except WrongValueError as error:
        raise InputError(plain(f"event {quoted(kind)}: {error.placed()}", 400)) from None
    return event


def _plain(value: Any) -> Any:
    """Return a value as JSON has it."""
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _class_kind(cls: type[Any]) -> Kind[Any]:
    """Return the kind of the JSON objects that stand for instances of a dataclass."""
    hints = get_type_hints(cls, include_extras=True)
    kinds = {field.name: _kind(hints[field.name]) for field in fields(cls)}
    usual = {field.name for field in fields(cls) if field.default is not MISSING}
    required = {name: kind for name, kind in kinds.items() if name not in usual}
    return Made(Keys(required, {name: kinds[name] for name in usual}), lambda found: cls(**found))


_kind = AnnotatedKinds(
    {str: NAME, PhotoName: PHOTO, float: NUMBER, bool: FLAG}, _class_kind, "points", most=MAX_PLAN
).kind
_KINDS = {kind: _class_kind(cls) for kind, cls in EVENT_KINDS.items()}
