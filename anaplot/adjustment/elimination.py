"""Observations taken out of an adjustment and put back, exactly, without adjusting again.

With S the rows left out, R_SS = R[S, S] and z = R_SS^-1 e_S the estimated gross errors,

    e given S = e - R[:, S] z,    r given S = r - diag(R[:, S] R_SS^-1 R[S, :]),
    v'Pv given S = v'Pv - e_S' z,

the same as a new adjustment without them (Gruen 1980, eq. 17; Baarda 1968). For a rejected row the
role of the residual is played by its error estimate: standardized by its sigma it is what the w of
the row would be if it alone came back.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dtrtri

from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array, Bools

__all__ = ["Elimination", "NotSeparableError", "Returns", "testable"]


# R is known to about 1e-13; what is left of r after an elimination carries its rounding amplified
_LOST = 1e-8
_ROOM = 8  # rows out that there is place for at first


class NotSeparableError(ValueError):
    """A row that cannot be left out: without the rows already out nothing checks it.

    Attributes
    ----------
    row
        Its number.
    """

    def __init__(self, row: int) -> None:
        self.row = row
        super().__init__(f"row {row} cannot be left out as well")


class Returns(NamedTuple):
    """What each of k rows that are left out would do by coming back, alone.

    Attributes
    ----------
    root
        (k,) the w that the row then has; v'Pv rises by its square.
    back
        (k, n) e rises by `back * root`, r by `back^2`, column j of R by `back * back[j]`.
    """

    root: Array
    back: Array


class Elimination:
    """An adjustment and the set S of its rows that are left out.

    Parameters
    ----------
    system
        All rows.

    Notes
    -----
    `e`, `r` and the columns given S are kept by a stack of orthogonalised columns c_k = column k
    given the rows before it, divided by the root of its own r: R[:, S] R_SS^-1 R[S, :] is the sum
    of c_k c_k'. A row more or less costs O(n |S|): to drop one, plane rotations of the stack make
    it the last (Golub and Van Loan, Matrix Computations, 6.5).
    """

    def __init__(self, system: ResidualSystem) -> None:
        self.system = system
        self._e0 = np.asarray(system.e, dtype=float)
        self._r0 = np.asarray(system.r, dtype=float)
        self._rows: list[int] = []
        self._room = np.empty((_ROOM, len(self._e0)))  # the stack, and place for more of it
        self._along = np.empty(_ROOM)  # the misclosure along each of them
        self._e = self._e0.copy()
        self._r = self._r0.copy()
        self._latest: tuple[int, Array] | None = None  # a row that is looked at, then left out

    @property
    def _stack(self) -> Array:
        """(k, n) orthogonalised, scaled columns."""
        return self._room[: len(self._rows)]

    @property
    def rows(self) -> tuple[int, ...]:
        """S in the order in which the rows were left out."""
        return tuple(self._rows)

    @property
    def e(self) -> Array:
        """(n,) misclosures given S; zero in S."""
        return self._e.copy()

    @property
    def r(self) -> Array:
        """(n,) redundancy numbers given S; zero in S."""
        return self._r.copy()

    @property
    def vtpv(self) -> float:
        """The v'Pv of the remaining rows."""
        along = self._along[: len(self._rows)]
        return max(self.system.vtpv - float(along @ along), 0.0)

    @property
    def redundancy(self) -> int:
        """Redundancy of the remaining rows."""
        return self.system.redundancy - len(self._rows)

    def copy(self) -> Elimination:
        """Return an independent state with the same rows out."""
        other = Elimination(self.system)
        other._rows = list(self._rows)
        other._room, other._along = self._room.copy(), self._along.copy()
        other._e, other._r = self._e.copy(), self._r.copy()
        return other

    def testable(self, row: int) -> bool:
        """Whether a row can be tested, given S; a row in S never."""
        return bool(self._limit(row) <= self._r[row])

    def _limit(self, row: int) -> float:
        return max(TESTABLE, _LOST * self._r0[row] if self._rows else 0.0)

    @property
    def checked_rows(self) -> Bools:
        """(n,) which rows can be tested given S."""
        return testable(self._r, self._r0, beside=bool(self._rows))

    @property
    def w(self) -> Array:
        """(n,) e / sqrt(r) given S; NaN in S and where a row cannot be tested."""
        out = np.full(len(self._e), np.nan)
        good = self.checked_rows
        out[good] = self._e[good] / np.sqrt(self._r[good])
        return out

    def column(self, row: int) -> Array:
        """Return (n,) the column of R of a row, given S; it cannot be written to."""
        if self._latest is None or self._latest[0] != row:
            column = self.system.columns(np.array([row], dtype=np.intp))[:, 0].copy()
            if self._rows:
                column -= self._stack[:, row] @ self._stack
                column[self._rows] = 0.0
            column.flags.writeable = False
            self._latest = row, column
        return self._latest[1]

    def correlations(self, row: int) -> Array:
        """Return (n,) correlations of all residuals with that of a row, given S; NaN: no test."""
        out = np.full(len(self._e), np.nan)
        good = self.checked_rows
        if good[row]:
            column = self.column(row)
            out[good] = column[good] / np.sqrt(self._r[good] * self._r[row])
        return out

    def add(self, row: int) -> None:
        """Leave a row out.

        Raises
        ------
        NotSeparableError
            It is out already, or the rows that remain do not check it.
        """
        if row in self._rows or not self.testable(row):
            raise NotSeparableError(row)
        column = self.column(row)
        own = float(column[row])
        if own < self._limit(row):
            raise NotSeparableError(row)
        scaled = column / np.sqrt(own)
        along = float(self._e[row] / np.sqrt(own))
        k = len(self._rows)
        if k == len(self._along):
            self._room = np.concatenate((self._room, np.empty_like(self._room)))
            self._along = np.concatenate((self._along, np.empty(k)))
        self._room[k], self._along[k] = scaled, along
        self._rows.append(row)
        self._latest = None
        self._e -= scaled * along
        self._r = np.maximum(self._r - scaled * scaled, 0.0)
        self._e[self._rows] = 0.0
        self._r[self._rows] = 0.0

    def drop(self, row: int) -> None:
        """Bring a row back.

        Raises
        ------
        ValueError
            It is not left out.
        """
        at, last = self._rows.index(row), len(self._rows) - 1
        stack, along = self._stack, self._along
        order = [*range(at), *range(at + 1, last + 1)]
        for k in range(at, last):
            # without row `at` the triangle has one element above its diagonal: turned to zero
            own, above = stack[k : k + 2, self._rows[order[k]]]
            size = np.hypot(own, above)
            c, s = own / size, above / size
            turn = np.array([[c, s], [-s, c]])
            stack[k : k + 2] = turn @ stack[k : k + 2]
            along[k : k + 2] = turn @ along[k : k + 2]
        self._rows.pop(at)
        self._latest = None
        stack, along = stack[:last], along[:last]
        self._e = self._e0 - along @ stack
        self._r = np.maximum(self._r0 - np.einsum("kn,kn->n", stack, stack), 0.0)
        self._e[self._rows] = 0.0
        self._r[self._rows] = 0.0

    def drop_all(self, rows: Collection[int]) -> None:
        """Bring rows back together: what dropping one after the other comes to, for one product.

        Raises
        ------
        ValueError
            One of them is not left out.
        """
        gone = {self._rows.index(row) for row in rows}
        if not gone:
            return
        kept = [k for k in range(len(self._rows)) if k not in gone]
        left = [self._rows[k] for k in kept]
        turn, upper = np.linalg.qr(self._stack[:, left])
        turn *= np.where(np.diagonal(upper) < 0.0, -1.0, 1.0)
        stack, along = turn.T @ self._stack, turn.T @ self._along[: len(self._rows)]
        self._rows, self._latest = left, None
        self._room[: len(left)], self._along[: len(left)] = stack, along
        self._e = self._e0 - along @ stack
        self._r = np.maximum(self._r0 - np.einsum("kn,kn->n", stack, stack), 0.0)
        self._e[left] = 0.0
        self._r[left] = 0.0

    def swap(self, row: int, instead: int) -> None:
        """Bring `row` back and leave `instead` out.

        Raises
        ------
        ValueError
            `row` is not left out.
        NotSeparableError
            `instead` cannot be; the same rows are out as before.
        """
        self.drop(row)
        try:
            self.add(instead)
        except NotSeparableError:
            self.add(row)
            raise

    def triangle(self) -> Array:
        """Return (k, k) lower triangle L with L L' = R_SS, in the order of `rows`."""
        if not self._rows:
            return np.zeros((0, 0))
        return np.tril(self._stack[:, self._rows].T)

    def returns(self) -> Returns:
        """Say what each row of S would do by coming back, alone.

        With D = R_SS^-1 and B = R[:, S] D, the return of row j of S raises v'Pv by z_j^2 / D_jj,
        e by B[:, j] z_j / D_jj and r by B[:, j]^2 / D_jj.
        """
        k = len(self._rows)
        if not k:
            return Returns(np.zeros(0), np.zeros((0, len(self._e))))
        inverse = self._inverse()
        size = np.sqrt((inverse * inverse).sum(axis=0))
        inverse /= size
        return Returns(inverse.T @ self._along[:k], inverse.T @ self._stack)

    def given_back(self, back: Array, root: Array | float) -> tuple[Array, Array]:
        """Return (n,) w and (n,) r of all rows when one of S comes back, see `Returns`.

        w is NaN in the rest of S and where a row cannot be tested. Of (m, n) and (m, 1) for m rows,
        each of which comes back alone, (m, n).
        """
        e, r = self._e + back * root, self._r + back * back
        limit = np.maximum(TESTABLE, _LOST * self._r0 if len(self._rows) > 1 else 0.0)
        w = np.full(e.shape, np.nan)
        np.divide(e, np.sqrt(r), out=w, where=r >= limit)
        return w, r

    def estimates(self) -> tuple[Array, Array]:
        """Return (k,) estimated gross errors of S and (k,) their sigmas, in a-priori sigmas.

        The sigmas are the a-priori ones: roots of the diagonal of R_SS^-1.
        """
        inverse = self._inverse()
        sigma = np.sqrt((inverse * inverse).sum(axis=0))
        return inverse.T @ self._along[: len(self._rows)], sigma

    def correlated_estimates(self) -> tuple[Array, Array]:
        """Return (k,) estimated gross errors of S and (k, k) R_SS^-1, in a-priori sigmas."""
        inverse = self._inverse()
        return inverse.T @ self._along[: len(self._rows)], inverse.T @ inverse

    def _inverse(self) -> Array:
        """(k, k) inverse of the triangle."""
        if not self._rows:
            return np.zeros((0, 0))  # LAPACK prints that it is asked for nothing
        inverse, _ = dtrtri(self.triangle(), lower=1)
        return np.asarray(inverse)


def testable(r: Array, before: Array, *, beside: bool) -> Bools:
    """Return which rows can be tested.

    Parameters
    ----------
    r
        Redundancy numbers, given what is out.
    before
        The same with all rows in.
    beside
        Whether anything is out.
    """
    return np.asarray(r >= np.maximum(TESTABLE, _LOST * before if beside else 0.0))
