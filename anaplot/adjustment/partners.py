"""Which row to propose of those that are hard to tell apart, and which rows go together.

Rows with highly correlated residuals (at a point of two rays all four coordinates: its parallax is
their only check) have nearly the same abs(w), and noise or rounding decides which is the largest.
The row with the larger redundancy number r explains the same misclosures by a smaller error, and to
reject the other one lets an error that nobody made move the ground. An error of size z being the
less probable the larger it is (1 / z^2, the tail of a Cauchy distribution), the posterior of row i
goes as exp(w_i^2 / 2) sqrt(r_i): of partners that with the largest w^2 + log r is proposed.

A row that shows less than a hundredth of its error is never rejected by itself, but with the other
coordinates of its measurement (the ray, the control point, the point of a model), and they come
back together.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import cached_property
from math import log

import numpy as np

from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.aliases import Array, Bools, Index

__all__ = ["EQUAL", "WEAK", "Proposals", "likeliest", "rounded"]


EQUAL = 1e-9
"""Relative difference below which two statistics cannot be told apart, however large r."""

WEAK = 0.01
"""Redundancy number below which a row is not rejected by itself."""

_ROUNDING = 1e-13  # of R
_SAME = 1e-6  # difference of the evidence that is none


def rounded(statistic: float) -> float:
    """Return a statistic to nine digits, for an order: what differs by rounding is equal."""
    return float(f"{statistic:.9g}")


def likeliest(w: Array, r: Array, columns: Array, rows: Index) -> Index:
    """Return the rows themselves, or those of their partners that are the likelier ones.

    Parameters
    ----------
    w
        (m, n) standardized residuals in m cases; NaN: not to be chosen.
    r
        (m, n) redundancy numbers.
    columns
        (m, n) columns of R of the rows.
    rows
        (m,) rows with the largest abs(w), or nearly so.

    Returns
    -------
    ndarray
        (m,) of the row and those that are hard to tell apart from it the one with the largest
        w^2 + log r, of equal ones the first.
    """
    at = (np.arange(len(rows)), rows)
    own = r[at][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        square, mine = w * w, np.square(w[at])[:, None]
        # R is known to some 1e-13, w to that over r
        rounding = 2.0 * mine * (2.0 * EQUAL + _ROUNDING / r + _ROUNDING / own)
        differ = square - mine
        gain = np.where(np.abs(differ) <= rounding, 0.0, differ) + np.log(r / own)
        near = np.abs(columns) >= HARD_TO_TELL * np.sqrt(r * own)
    gain = np.where(near & np.isfinite(gain), gain, -np.inf)
    gain[at] = 0.0
    best = gain.max(axis=1, keepdims=True)
    chosen: Index = np.argmax(gain >= best - _SAME, axis=1).astype(np.intp)
    return chosen


class Proposals:
    """What is to be rejected next of the rows of a system.

    Parameters
    ----------
    names
        Identities of the rows. Coordinates of one measurement have names that are tuples alike but
        for their last element; every other row is a measurement of its own.
    """

    def __init__(self, names: Sequence[Hashable]) -> None:
        self._names = names

    @cached_property
    def _measurements(self) -> dict[Hashable, list[int]]:
        """Rows of every measurement."""
        found: dict[Hashable, list[int]] = {}
        for row, name in enumerate(self._names):
            found.setdefault(_measurement(name), []).append(row)
        return found

    def measured_with(self, row: int) -> list[int]:
        """Return the rows of the same measurement as one, itself among them, ascending."""
        return self._measurements[_measurement(self._names[row])]

    def next(
        self, size: Array, limit: Array, suspects: Bools, state: Elimination
    ) -> tuple[int, ...]:
        """Return the rows to reject next by their size; none when there are none.

        Parameters
        ----------
        size
            (n,) abs(w) of the rows, or what stands for it; NaN: not conspicuous.
        limit
            (n,) what it is tested against.
        suspects
            (n,) rows that may be rejected.
        state
            The rows that are out.

        Returns
        -------
        tuple of int
            The row of the largest size, of equal ones the first, or its likeliest partner; where
            that is weak, all rows of its measurement, if the others check them.
        """
        conspicuous = np.isfinite(size) & suspects
        left = conspicuous.copy()
        while left.any():
            values = np.where(left, size, -np.inf)
            first = int(np.argmax(values >= values.max() * (1.0 - EQUAL)))
            beyond = float(size[first] ** 2 - limit[first] ** 2)
            rows = self.instead(first, beyond, conspicuous, suspects, state)
            if rows:
                return rows
            left[first] = False
        return ()

    def instead(
        self, row: int, beyond: float, partners: Bools, suspects: Bools, state: Elimination
    ) -> tuple[int, ...]:
        """Return the rows to reject where one is conspicuous; none where nothing checks them.

        Parameters
        ----------
        row
            A row that is not out.
        beyond
            By how much its squared size exceeds its squared limit. A weak row needs more: an error
            that large is the less probable the less of it is seen, see `likeliest`.
        partners
            (n,) rows that may go in its place.
        suspects
            (n,) rows that may be rejected.
        state
            The rows that are out.
        """
        w = np.where(partners, state.w, np.nan)
        columns = state.column(row)[None]
        at = np.array([row], dtype=np.intp)
        best = int(likeliest(w[None], state.r[None], columns, at)[0])
        if state.r[best] >= WEAK:
            return (best,)
        rows = [best, *(k for k in self.measured_with(best) if k != best and k not in state.rows)]
        if beyond < log(WEAK / max(state.r[best], 1e-300)) or not suspects[rows].all():
            return ()
        trial = state.copy()
        try:
            for one in rows:
                trial.add(one)
        except NotSeparableError:
            return ()
        return tuple(rows)

    def together(self, state: Elimination) -> dict[int, tuple[int, ...]]:
        """Return for every row that is out the rows that come back with it.

        Those of its measurement that are out, where one of them is weak; else it comes back alone.
        """
        return self.together_of(state.rows, state.estimates()[1])

    def together_of(self, rows: Sequence[int], sigma: Array) -> dict[int, tuple[int, ...]]:
        """Return the same of rows that are out, by the (k,) sigmas of their estimated errors."""
        out: dict[int, tuple[int, ...]] = {row: (row,) for row in rows}
        for row, one in zip(rows, sigma.tolist(), strict=True):
            if one**-2 < WEAK:
                unit: tuple[int, ...] = tuple(k for k in self.measured_with(row) if k in out)
                out.update(dict.fromkeys(unit, unit))
        return out


def _measurement(name: Hashable) -> Hashable:
    return name[:-1] if isinstance(name, tuple) and len(name) > 1 else (name,)
