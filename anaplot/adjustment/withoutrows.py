"""An adjustment seen without some of its rows: what is asked for to clean it apart."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Protocol

import numpy as np

from anaplot.adjustment.doubts import Touching
from anaplot.adjustment.places import Places
from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array, Index

__all__ = ["RowsGiven", "WithoutRows", "places_without", "standardized"]


class RowsGiven(Protocol):
    """All rows of an adjustment, seen from what it is without some of them."""

    @property
    def e(self) -> Array:
        """(n,) misclosures left in a-priori sigmas; of a row that is out its estimated error."""
        ...

    @property
    def r(self) -> Array:
        """(n,) redundancy numbers; of a row that is out the one that it has if it comes back."""
        ...

    @property
    def vtpv(self) -> float:
        """The v'Pv of what is in."""
        ...

    @property
    def exact(self) -> bool:
        """Whether redundancy numbers have what places do to each other."""
        ...

    def back(self, row: int) -> float | None:
        """Return that of one row, with what places do to each other.

        None of a row that was in where all is seen from, or where it is not found.
        """
        ...

    def places_of(self, rows: Index) -> Index:
        """Return (k,) the places of k rows; -1 of a row that has none."""
        ...

    def places(self, numbers: Index) -> Iterator[Places]:
        """Yield places by their numbers, in any order, those of as many rows together."""
        ...

    def reach(self, numbers: Index) -> Array:
        """Return (k,) the `reach_of` places."""
        ...

    def touching(self, numbers: Index) -> Touching:
        """Return what k places have in common."""
        ...


class WithoutRows(Protocol):
    """What an adjustment is without some of its rows."""

    @property
    def begun(self) -> Collection[int]:
        """Rows without which the place was found where all is linearised."""
        ...

    def adjusted(self, out: Sequence[int]) -> RowsGiven:
        """Return all rows, adjusted anew without some."""
        ...

    def drafted(self, out: Sequence[int]) -> RowsGiven:
        """Return all rows: misclosures as `adjusted`, redundancy numbers by the place alone."""
        ...


def places_without(given: RowsGiven, numbers: Index, out: Collection[int]) -> Iterator[Places]:
    """Yield places by their numbers, in which some rows are out for good."""
    gone = np.zeros(len(given.e), dtype=bool)
    gone[list(out)] = True
    return (places.without(gone) for places in given.places(numbers))


def standardized(given: RowsGiven, out: Collection[int]) -> Array:
    """Return (n,) abs(w), of rows that are out that of their estimated errors; NaN: no test."""
    rows = np.array([*out], dtype=np.intp)
    good = given.r >= TESTABLE
    good[rows] = given.r[rows] > 0.0
    size = np.full(len(given.r), np.nan)
    np.sqrt(given.r, out=size, where=good)
    np.divide(np.abs(given.e), size, out=size, where=good)
    size[rows] *= given.r[rows]
    return size
