"""What a pure function returned for the same objects, remembered.

By identity: hashing or comparing every measurement of a long day at every look would cost more
than most functions do.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

__all__ = ["remembered"]

P = ParamSpec("P")
R = TypeVar("R")

_LAST = 8  # calls


def remembered(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function of immutable objects that remembers its last results."""
    last: deque[tuple[tuple[object, ...], R]] = deque(maxlen=_LAST)

    @wraps(function)
    def known(*args: P.args, **kwargs: P.kwargs) -> R:
        key = (*args, *kwargs.values())
        for before, result in tuple(last):
            if len(before) == len(key) and all(map(_same, before, key)):
                return result
        result = function(*args, **kwargs)
        last.append((key, result))
        return result

    return known


def _same(one: object, other: object) -> bool:
    return one is other
