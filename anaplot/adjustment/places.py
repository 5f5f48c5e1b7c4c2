"""Places of a large adjustment: rows that touch hardly anything else, many small systems at once.

In most places the rule of `baarda` is plain: the largest w goes, nothing is as large and nothing
hard to tell apart from it, and what has gone stays out. There it is followed in all places of equal
size by arrays; where it is not plain, a place is left to the rule itself.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple, overload

import numpy as np

from anaplot.adjustment.findings import SearchStep
from anaplot.adjustment.partners import EQUAL, WEAK
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array, Bools, Index

__all__ = [
    "Place",
    "Places",
    "inverse_among",
    "plainly_rejected",
    "reach_of",
    "seen_without",
]


_UNCHECKED = 1e-12  # of R, whose eigenvalues are between 0 and 1: nothing checks that


class Place(NamedTuple):
    """The rows of a place, as a system in which all of them are in and all others as they are.

    Attributes
    ----------
    rows
        (k,) which rows, ascending.
    system
        Of these rows.
    lever
        (k,) h: an element of R with a row of another place is no larger than the product of both.
    """

    rows: Index
    system: DenseResiduals
    lever: Array


class Places(NamedTuple):
    """Places with k rows each, see `Place`.

    Attributes
    ----------
    numbers
        (c,) which places.
    rows, e, r, matrix, lever, vtpv
        (c, k), (c, k), (c, k), (c, k, k), (c, k) and (c,).
    redundancy
        With all rows of a place in.
    names
        Of all rows of the adjustment.
    """

    numbers: Index
    rows: Index
    e: Array
    r: Array
    matrix: Array
    lever: Array
    vtpv: Array
    redundancy: int
    names: Sequence[Hashable]

    def place(self, at: int) -> Place:
        """Return one of them."""
        system = DenseResiduals(
            _NamesOf(self.names, self.rows[at]),
            self.e[at],
            self.r[at],
            float(self.vtpv[at]),
            self.redundancy,
            self.matrix[at],
        )
        return Place(self.rows[at], system, self.lever[at])

    def without(self, out: Bools) -> Places:
        """Return the places without some rows for good, which become rows of zeros.

        Parameters
        ----------
        out
            (n,) which rows, of all.
        """
        gone = out[self.rows]
        some = gone.any(axis=1)
        if not some.any():
            return self
        gone, whole = gone[some], self.matrix[some]
        e, matrix, vtpv = self.e.copy(), self.matrix.copy(), self.vtpv.copy()
        inverse, _ = seen_without(whole, gone)
        taken = np.einsum("cij,cj->ci", inverse, np.where(gone, e[some], 0.0))
        vtpv[some] -= np.einsum("ci,ci->c", taken, e[some])
        e[some] -= np.einsum("cij,cj->ci", whole, taken)
        matrix[some] -= whole @ inverse @ whole
        gone = out[self.rows]
        e[gone] = 0.0
        matrix[gone[:, :, None] | gone[:, None, :]] = 0.0
        r = np.clip(np.einsum("cii->ci", matrix), 0.0, 1.0)
        return self._replace(e=e, r=r, matrix=matrix, vtpv=np.maximum(vtpv, 0.0))


def reach_of(r: Array, lever: Array) -> Array:
    """Return (c,) the largest lever over root r of the rows of c places, of (c, k) of them.

    Of those that can be rejected by themselves.
    """
    good = r >= WEAK
    root = np.sqrt(np.where(good, r, 1.0))
    return np.asarray(np.max(np.where(good, lever / root, 0.0), axis=1, initial=0.0))


class _NamesOf(Sequence[Hashable]):
    """The names of some rows, made when they are asked for."""

    def __init__(self, names: Sequence[Hashable], rows: Index) -> None:
        self._names, self._rows = names, rows

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, at: int) -> Hashable: ...
    @overload
    def __getitem__(self, at: slice) -> list[Hashable]: ...
    def __getitem__(self, at: int | slice) -> Hashable | list[Hashable]:
        if isinstance(at, slice):
            return [self._names[row] for row in self._rows[at].tolist()]
        return self._names[int(self._rows[at])]


def plainly_rejected(
    places: Places, suspects: Bools, critical: float
) -> list[list[SearchStep] | None]:
    """Return the steps by which w-tests reject rows in every place, all being in to begin with.

    Parameters
    ----------
    places
        The places.
    suspects
        (c, k) rows that may be rejected.
    critical
        Critical value of w.

    Returns
    -------
    list
        Of c; None where a place is not plain: rows as large as the largest, or hard to tell apart
        from it, weak ones, or such as would come back.
    """
    steps: list[list[SearchStep] | None] = [[] for _ in places.numbers]
    live = np.arange(len(places.numbers))
    e, matrix, vtpv = places.e.copy(), places.matrix.copy(), places.vtpv.copy()
    out = np.zeros(e.shape, dtype=bool)
    while len(live):
        w, r = _statistics(e, matrix, suspects[live] & ~out)
        row = np.argmax(w, axis=1)
        size = w[np.arange(len(live)), row]
        going = size > critical
        plain = _stay_out(places, live, out, critical)
        plain &= ~going | _alone(w, r, matrix, row)
        for place in live[~plain].tolist():
            steps[place] = None
        going &= plain
        live, e, matrix, out = live[going], e[going], matrix[going], out[going]
        vtpv, row, size = vtpv[going], row[going], size[going]
        each = np.arange(len(live))
        column, own = matrix[each, row], matrix[each, row, row][:, None]
        along = e[each, row][:, None] / own
        before, vtpv = vtpv, np.maximum(vtpv - (along * along * own)[:, 0], 0.0)
        e = e - column * along
        matrix = matrix - column[:, :, None] * (column / own)[:, None, :]
        out[each, row] = True
        told = (live, row, size, before, vtpv)
        for place, k, one, first, last in zip(*(part.tolist() for part in told), strict=True):
            mine = steps[place]
            assert mine is not None
            mine.append(SearchStep("reject", (k,), one, critical, first, last))
    return steps


def _statistics(e: Array, matrix: Array, allowed: Bools) -> tuple[Array, Array]:
    """(c, k) abs(w) of what may be rejected, else 0, and redundancy numbers."""
    r = np.einsum("cii->ci", matrix)
    good = allowed & (r >= TESTABLE)
    return np.where(good, np.abs(e) / np.sqrt(np.where(good, r, 1.0)), 0.0), r


def _alone(w: Array, r: Array, matrix: Array, row: Index) -> Bools:
    """(c,) whether nothing else comes into question for the largest w."""
    each = np.arange(len(row))
    own = r[each, row]
    alike = np.abs(matrix[each, row]) >= HARD_TO_TELL * np.sqrt(np.maximum(r * own[:, None], 0.0))
    alike &= w > 0.0
    alike |= w >= w[each, row][:, None] * (1.0 - EQUAL)
    alike[each, row] = False
    return np.asarray((own >= WEAK) & ~alike.any(axis=1))


def _stay_out(places: Places, live: Index, out: Bools, critical: float) -> Bools:
    """(c,) whether nothing that is out is below its limit."""
    stays = np.ones(len(live), dtype=bool)
    several = np.flatnonzero(out.sum(axis=1) > 1)
    if len(several):
        mine, gone = live[several], out[several]
        inverse = inverse_among(places.matrix[mine], gone)
        error = np.einsum("cij,cj->ci", inverse, np.where(gone, places.e[mine], 0.0))
        root = np.sqrt(np.where(gone, np.einsum("cii->ci", inverse), 1.0))
        stays[several] = np.all(~gone | (np.abs(error) >= critical * root), axis=1)
    return stays


def inverse_among(matrix: Array, chosen: Bools) -> Array:
    """Return (c, k, k) inverses of the parts of matrices that belong to chosen rows, else zeros.

    Raises
    ------
    LinAlgError
        One is singular.
    """
    count, k = chosen.shape
    most = int(chosen.sum(axis=1).max(initial=0))
    out = np.zeros((count, k, k))
    if not most:
        return out
    # hardly ever are as many chosen as there are: those come first
    rows = np.argsort(~chosen, axis=1, kind="stable")[:, :most]
    real = np.take_along_axis(chosen, rows, axis=1)
    at = np.arange(count)[:, None, None], rows[:, :, None], rows[:, None, :]
    both = real[:, :, None] & real[:, None, :]
    part = np.where(both, matrix[at], 0.0) + np.eye(most) * ~real[:, None, :]
    out[at] = np.where(both, np.linalg.inv(part), 0.0)
    return out


def seen_without(matrix: Array, gone: Bools) -> tuple[Array, Array]:
    """Return what rows that are out leave of c places, and what checks each when it comes back.

    Parameters
    ----------
    matrix
        (c, k, k) R with all rows in.
    gone
        (c, k) what is out.

    Returns
    -------
    tuple
        (c, k, k) inverses of their parts of R, else zeros; what nothing checks, which moves nothing
        either, counts for nothing in them. (c, k) redundancy numbers, of rows that are in 1.
    """
    try:
        inverse = inverse_among(matrix, gone)
        own = np.where(gone, np.einsum("cii->ci", inverse), 1.0)
        checked = own > 0.0
    except np.linalg.LinAlgError:
        both = gone[:, :, None] & gone[:, None, :]
        size, along = np.linalg.eigh(np.where(both, matrix, 0.0))
        good = (size > _UNCHECKED)[:, None, :]
        inverse = (along * np.where(good, 1.0 / np.where(good, size[:, None], 1.0), 0.0)) @ (
            along.transpose(0, 2, 1)
        )
        own = np.where(gone, np.einsum("cii->ci", inverse), 1.0)
        unchecked = np.sum(np.where(good, 0.0, along**2), axis=2)
        checked = (own > 0.0) & ((unchecked <= _UNCHECKED) | ~gone)
    return inverse, np.where(checked, 1.0 / np.where(checked, own, 1.0), 0.0)
