"""Session events to and from JSON objects, strictly: what is written is read back equal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from anaplot.errors import InputError
from anaplot.photogrammetry.platetransformation import TRANSFORMATIONS
from anaplot.session.events import EVENT_KINDS, Event, PlannedPoint
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import describe_type, hint, quoted

__all__ = ["event_from_dict", "event_from_payload", "event_to_dict", "event_to_payload"]

MAX_PLAN = 4000
"""Points in one plan: what stays within one line of a journal."""


def event_to_dict(event: Event) -> dict[str, Any]:
    """Return an event as a JSON object with its kind.

    Raises
    ------
    InputError
        A name or a number that may not stand in a file.
    """
    return {"kind": event.kind, **event_to_payload(event)}


def event_from_dict(data: Mapping[str, Any]) -> Event:
    """Return the event that `event_to_dict` made into this object.

    Raises
    ------
    InputError
        Unknown kind, unknown or missing key, value of a wrong type.
    """
    kind = data.get("kind")
    if not isinstance(kind, str):
        raise InputError(f"event: kind must be text, not {describe_type(kind)}")
    return event_from_payload(kind, {key: data[key] for key in data if key != "kind"})


def event_to_payload(event: Event) -> dict[str, Any]:
    """Return an event as a JSON object without its kind.

    Raises
    ------
    InputError
        As `event_to_dict`.
    """
    title = f"event {quoted(event.kind)}"
    fields = _EVENT_FIELDS[event.kind]
    payload = {
        name: field.write(title, name, getattr(event, name)) for name, field in fields.items()
    }
    for name, usual in _USUAL.get(event.kind, {}).items():
        if payload[name] == usual:
            del payload[name]
    return payload


def event_from_payload(kind: str, payload: Mapping[str, Any]) -> Event:
    """Return the event of a kind from its JSON object.

    Raises
    ------
    InputError
        As `event_from_dict`.
    """
    if kind not in EVENT_KINDS:
        raise InputError(f"event: unknown kind {quoted(kind)}{hint(kind, EVENT_KINDS)}")
    given = {**_USUAL.get(kind, {}), **payload}
    values = _read_fields(f"event {quoted(kind)}", _EVENT_FIELDS[kind], given)
    return EVENT_KINDS[kind](**values)


@dataclass(frozen=True, slots=True)
class _Field:
    """How one field is written and read: (title of the event, name of the field, value)."""

    write: Callable[[str, str, Any], Any]
    read: Callable[[str, str, Any], Any]


def _read_fields(title: str, fields: Mapping[str, _Field], data: object) -> dict[str, Any]:
    if not isinstance(data, Mapping):
        raise InputError(f"{title}: must be an object, not {describe_type(data)}")
    for key in data:
        if key not in fields:
            raise InputError(f"{title}: unknown key {quoted(str(key))}{hint(str(key), fields)}")
    for name in fields:
        if name not in data:
            raise InputError(f"{title}: key {quoted(name)} is missing")
    return {name: field.read(title, name, data[name]) for name, field in fields.items()}


def _wrong(title: str, name: str, wanted: str, value: object) -> InputError:
    return InputError(f"{title}: {name} must be {wanted}, not {describe_type(value)}")


def _name(title: str, name: str, value: Any) -> str:
    return _checked_name(title, name, value, photo=False)


def _photo_name(title: str, name: str, value: Any) -> str:
    return _checked_name(title, name, value, photo=True)


def _checked_name(title: str, name: str, value: Any, *, photo: bool) -> str:
    if not isinstance(value, str):
        raise _wrong(title, name, "a name", value)
    fault = name_fault(value, photo=photo)
    if fault is not None:
        raise InputError(f"{title}: {name}: the name {quoted(value)} {fault}")
    return value


def _number(title: str, name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _wrong(title, name, "a number", value)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{title}: {name} must be a finite number")
    return number


def _truth(title: str, name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise _wrong(title, name, "true or false", value)
    return value


def _word(*choices: str | None) -> _Field:
    wanted = " or ".join("null" if choice is None else f'"{choice}"' for choice in choices)

    def same(title: str, name: str, value: Any) -> str | None:
        if value is not None and not isinstance(value, str):
            raise _wrong(title, name, wanted, value)
        if value not in choices:
            shown = "nothing" if value is None else quoted(value)
            raise InputError(f"{title}: {name} must be {wanted}, not {shown}")
        return value

    return _Field(same, same)


_NAME = _Field(_name, _name)
_PHOTO = _Field(_photo_name, _photo_name)
_NUMBER = _Field(_number, _number)
_TRUTH = _Field(_truth, _truth)
_AXIS_OR_NONE = _word("x", "y", None)
_SIDE = _word("left", "right")
_COORDINATES = {"xl": _NUMBER, "yl": _NUMBER, "xr": _NUMBER, "yr": _NUMBER}

_PLANNED_FIELDS: dict[str, _Field] = {
    "point": _NAME,
    "role": _word("tie", "new"),
    **_COORDINATES,
}


def _write_planned(title: str, name: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, PlannedPoint):
        raise _wrong(title, name, "a planned point", value)
    return {
        key: field.write(f"{title}: {name}", key, getattr(value, key))
        for key, field in _PLANNED_FIELDS.items()
    }


def _read_planned(title: str, name: str, value: Any) -> PlannedPoint:
    return PlannedPoint(**_read_fields(f"{title}: {name}", _PLANNED_FIELDS, value))


def _write_plan(title: str, name: str, value: Any) -> list[dict[str, Any]]:
    _check_plan_length(title, name, value)
    return [_write_planned(title, f"{name}[{index}]", item) for index, item in enumerate(value)]


def _read_plan(title: str, name: str, value: Any) -> tuple[PlannedPoint, ...]:
    if not isinstance(value, list):
        raise _wrong(title, name, "a list", value)
    _check_plan_length(title, name, value)
    return tuple(_read_planned(title, f"{name}[{index}]", item) for index, item in enumerate(value))


def _check_plan_length(title: str, name: str, plan: Any) -> None:
    if len(plan) > MAX_PLAN:
        raise InputError(f"{title}: {name} holds {len(plan)} points, more than {MAX_PLAN}")


def _list_of(length: int, item: _Field) -> _Field:
    """Return a field that holds so many of another, a tuple here and a list in the file."""
    wanted = f"a list of {length}"

    def each(
        convert: Callable[[str, str, Any], Any], title: str, name: str, value: Any
    ) -> list[Any]:
        if len(value) != length:
            raise InputError(f"{title}: {name} must be {wanted}, not of {len(value)}")
        return [convert(title, f"{name}[{k}]", part) for k, part in enumerate(value)]

    def write(title: str, name: str, value: Any) -> list[Any]:
        if not isinstance(value, tuple):
            raise _wrong(title, name, wanted, value)
        return each(item.write, title, name, value)

    def read(title: str, name: str, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise _wrong(title, name, wanted, value)
        return tuple(each(item.read, title, name, value))

    return _Field(write, read)


_EVENT_FIELDS: dict[str, dict[str, _Field]] = {
    "model-chosen": {
        "strip": _NAME,
        "left": _PHOTO,
        "right": _PHOTO,
        "plan": _Field(_write_plan, _read_plan),
        "mono": _TRUTH,
    },
    "photo-laid": {"photo": _PHOTO},
    "fiducial-measured": {
        "photo": _PHOTO,
        "side": _SIDE,
        "fiducial": _NAME,
        "x": _NUMBER,
        "y": _NUMBER,
        "switch": _NAME,
    },
    "fiducial-switched": {
        "photo": _PHOTO,
        "fiducial": _NAME,
        "axis": _AXIS_OR_NONE,
        "on": _TRUTH,
    },
    "inner-accepted": {
        "photo": _PHOTO,
        "side": _SIDE,
        "transformation": _word(*TRANSFORMATIONS),
        "frame": _list_of(2, _list_of(3, _NUMBER)),
        "numerator": _list_of(2, _list_of(4, _NUMBER)),
        "denominator": _list_of(2, _NUMBER),
    },
    "point-added": {"planned": _Field(_write_planned, _read_planned)},
    "point-measured": {
        "left": _PHOTO,
        "right": _PHOTO,
        "point": _NAME,
        **_COORDINATES,
        "switch": _NAME,
    },
    "mono-measured": {
        "left": _PHOTO,
        "right": _PHOTO,
        "side": _SIDE,
        "point": _NAME,
        "x": _NUMBER,
        "y": _NUMBER,
        "switch": _NAME,
    },
    "row-switched": {"point": _NAME, "axis": _AXIS_OR_NONE, "on": _TRUTH},
    "model-accepted": {"left": _PHOTO, "right": _PHOTO},
    "undone": {},
    "suspended": {},
    "resumed": {},
}

_USUAL: dict[str, dict[str, Any]] = {"model-chosen": {"mono": False}}
"""Values that are left out of a file: fields that came later read so in older journals."""
