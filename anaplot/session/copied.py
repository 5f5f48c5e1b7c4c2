"""Copies of frozen dataclasses with other values in some fields, as a fold over events makes them.

`dataclasses.replace` calls the constructor, which finds a way past what is frozen for every field;
a long journal is half a million of such copies.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar

__all__ = ["copied"]

T = TypeVar("T")


class _Layout(NamedTuple):
    """How all fields of a class are read, and how each is written, by its name."""

    read: Callable[[Any], tuple[Any, ...]]
    write: dict[str, Callable[[Any, Any], None]]


_KNOWN: dict[type[Any], _Layout] = {}


def _layout(cls: type[Any]) -> _Layout:
    names = [field.name for field in fields(cls)]
    if len(names) < 2 or "__slots__" not in vars(cls) or hasattr(cls, "__post_init__"):
        raise TypeError(f"{cls.__name__}: no class with slots that are its fields and nothing more")
    write = {name: vars(cls)[name].__set__ for name in names}
    return _KNOWN.setdefault(cls, _Layout(attrgetter(*names), write))


def copied(one: T, **changes: Any) -> T:
    """Return a copy of an instance of a dataclass with slots, with other values in some fields.

    Raises
    ------
    TypeError
        There is no such field, or the class has more to do than to keep its fields.
    """
    cls = type(one)
    read, write = _KNOWN.get(cls) or _layout(cls)
    copy = object.__new__(cls)
    for put, cell in zip(write.values(), read(one), strict=True):
        put(copy, cell)
    for name, value in changes.items():
        if name not in write:
            raise TypeError(f"{cls.__name__} has no field {name!r}")
        write[name](copy, value)
    return copy
