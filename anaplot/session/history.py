"""What an undo brings back: a stack of moments that forgets all but the youngest."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any, Generic, TypeAlias, TypeVar

__all__ = ["History"]

T = TypeVar("T")
_Link: TypeAlias = tuple[Any, Any]  # a moment, and the link before it; None before the first


class History(Generic[T]):
    """Moments, the youngest on top; it never changes.

    To add one costs the same however many there are: they hang together like a chain, of which what
    is forgotten is cut off when it has grown to twice the length.

    Parameters
    ----------
    moments
        Oldest first.
    """

    __slots__ = ("_count", "_last", "_links")

    def __init__(self, moments: Iterable[T] = ()) -> None:
        self._count = self._links = 0
        self._last: _Link | None = None
        for moment in moments:
            self._last = moment, self._last
            self._count += 1
        self._links = self._count

    def _changed(self, count: int, links: int, last: _Link | None) -> History[T]:
        changed: History[T] = History.__new__(History)
        changed._count, changed._links, changed._last = count, links, last
        return changed

    def pushed(self, moment: T, most: int) -> History[T]:
        """Return the history with one more moment; of more than `most` the oldest goes."""
        if self._links >= 2 * most:
            return History((*self, moment)[-most:])
        return self._changed(min(self._count + 1, most), self._links + 1, (moment, self._last))

    def popped(self) -> tuple[T, History[T]]:
        """Return the youngest moment, and the history before it.

        Raises
        ------
        IndexError
            There is none.
        """
        if self._last is None or not self._count:
            raise IndexError("an empty history")
        moment, last = self._last
        return moment, self._changed(self._count - 1, self._links - 1, last)

    def _youngest_first(self) -> Iterator[T]:
        link = self._last
        while link is not None:
            yield link[0]
            link = link[1]

    def __iter__(self) -> Iterator[T]:
        """Oldest first."""
        return reversed(tuple(islice(self._youngest_first(), self._count)))

    def __len__(self) -> int:
        return self._count

    def __eq__(self, other: object) -> bool:
        return tuple(self) == tuple(other) if isinstance(other, History) else NotImplemented

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __repr__(self) -> str:
        return f"History({list(self)!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return History, (tuple(self),)  # a chain of a thousand links is too deep to copy
