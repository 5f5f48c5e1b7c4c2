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
    """Where the fields of a class stand, how all are read, and how each is written."""

    place: dict[str, int]
    read: Callable[[Any], tuple[Any, ...]]
    write: tuple[Callable[[Any, Any], None], ...]


_KNOWN: dict[type[Any], _Layout] = {}


def _layout(cls: type[Any]) -> _Layout:
    names = [field.name for field in fields(cls)]
    if len(names) < 2 or "__slots__" not in vars(cls) or hasattr(cls, "__post_init__"):
        raise TypeError(f"{cls.__name__}: no class with slots that are its fields and nothing more")
    place = {name: k for k, name in enumerate(names)}
    write = tuple(vars(cls)[name].__set__ for name in names)
    return _KNOWN.setdefault(cls, _Layout(place, attrgetter(*names), write))


def copied(one: T, **changes: Any) -> T:
    """Return a copy of an instance of a dataclass with slots, with other values in some fields.

    Raises
    ------
    TypeError
        There is no such field, or the class has more to do than to keep its fields.
    """
    cls = type(one)
    place, read, write = _KNOWN.get(cls) or _layout(cls)
    cells = list(read(one))
    for name, value in changes.items():
        if name not in place:
            raise TypeError(f"{cls.__name__} has no field {name!r}")
        cells[place[name]] = value
    copy = object.__new__(cls)
    for put, cell in zip(write, cells, strict=True):
        put(copy, cell)
    return copy
