"""Orders of whole numbers, at the speed that millions of them ask for."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Index

__all__ = ["distinct", "each_pair", "order_of"]

_BITS = 16


def distinct(numbers: Index) -> Index:
    """Return some numbers, ascending and each once.

    NumPy's own `unique` looks for them in a table by now, many times as slow where most differ.
    """
    ordered = np.sort(numbers)
    first = np.ones(len(ordered), dtype=bool)
    np.not_equal(ordered[1:], ordered[:-1], out=first[1:])
    found: Index = ordered[first]
    return found


def each_pair(first: Index, second: Index) -> tuple[Index, Index]:
    """Return pairs of numbers that are not negative, ascending and each once."""
    count = int(second.max(initial=0)) + 1
    pairs = distinct(first * count + second)
    return pairs // count, pairs % count


def order_of(numbers: Index, below: int) -> Index:
    """Return what sorts numbers from 0 to `below`, the first of equal ones first."""
    # two bytes of a number are counted, not compared
    order: Index = np.argsort(numbers.astype(np.uint16), kind="stable")
    for shift in range(_BITS, (below - 1).bit_length(), _BITS):
        digits = (numbers >> shift).astype(np.uint16)
        order = order[np.argsort(digits[order], kind="stable")]
    return order
