"""Observations taken out of an adjustment and put back, exactly, without adjusting again.

With S the rows left out, R_SS = R[S, S] and z = R_SS^-1 e_S the estimated gross errors,

    e given S = e - R[:, S] z,    r given S = r - diag(R[:, S] R_SS^-1 R[S, :]),
    v'Pv given S = v'Pv - e_S' z,

the same as a new adjustment without them (Gruen 1980, eq. 17; Baarda 1968). For a rejected row the
role of the residual is played by its error estimate: standardized by its sigma it is what the w of
the row would be if it alone came back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.significance import TESTABLE

__all__ = ["Elimination", "NotSeparableError"]

Array = NDArray[np.float64]

# R is known to about 1e-13; what is left of r after an elimination carries its rounding amplified
_LOST = 1e-8


class NotSeparableError(ValueError):
    """A row that cannot be left out: without the rows already out nothing checks it."""


class Elimination:
    """An adjustment and the set S of its rows that are left out.

    Parameters
    ----------
    system
        All rows.

    Notes
    -----
    `e`, `r` and the columns given S are kept as a stack of orthogonalised columns, one rank-one
    update for each row: c_k = column k given the rows before it, divided by the root of its own
    r. Adding costs O(n |S|). Dropping the last row of the stack is free; dropping another one
    rebuilds those after it.
    """

    def __init__(self, system: ResidualSystem) -> None:
        self.system = system
        self._e0 = np.asarray(system.e, dtype=float)
        self._r0 = np.asarray(system.r, dtype=float)
        self._rows: list[int] = []
        self._stack: list[Array] = []  # orthogonalised, scaled columns
        self._along: list[float] = []  # the misclosure along each of them: w when it was added
        self._e = self._e0.copy()
        self._r = self._r0.copy()

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
        return max(self.system.vtpv - float(np.dot(self._along, self._along)), 0.0)

    @property
    def redundancy(self) -> int:
        """Redundancy of the remaining rows."""
        return self.system.redundancy - len(self._rows)

    @property
    def log_determinant(self) -> float:
        """Natural logarithm of det(R_SS)."""
        return float(
            sum(2.0 * np.log(c[row]) for c, row in zip(self._stack, self._rows, strict=True))
        )

    def copy(self) -> Elimination:
        """Return an independent state with the same rows out."""
        other = Elimination(self.system)
        other._rows, other._stack = list(self._rows), list(self._stack)
        other._along = list(self._along)
        other._e, other._r = self._e.copy(), self._r.copy()
        return other

    def testable(self, row: int) -> bool:
        """Whether a row can be tested, given S; a row in S never."""
        return bool(self._limit(row) <= self._r[row])

    def _limit(self, row: int) -> float:
        return max(TESTABLE, _LOST * self._r0[row] if self._rows else 0.0)

    @property
    def testable_rows(self) -> NDArray[np.bool_]:
        """(n,) which rows can be tested given S."""
        limit = np.maximum(TESTABLE, _LOST * self._r0 if self._rows else 0.0)
        return np.asarray(self._r >= limit)

    @property
    def w(self) -> Array:
        """(n,) e / sqrt(r) given S; NaN in S and where a row cannot be tested."""
        out = np.full(len(self._e), np.nan)
        good = self.testable_rows
        out[good] = self._e[good] / np.sqrt(self._r[good])
        return out

    def column(self, row: int) -> Array:
        """Return (n,) the column of R of a row, given S."""
        column = self.system.columns(np.array([row], dtype=np.intp))[:, 0].copy()
        for c in self._stack:
            column -= c * c[row]
        column[self._rows] = 0.0
        return column

    def correlations(self, row: int) -> Array:
        """Return (n,) correlations of all residuals with that of a row, given S; NaN: no test."""
        out = np.full(len(self._e), np.nan)
        good = self.testable_rows
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
            raise NotSeparableError(f"row {row} cannot be left out as well")
        column = self.column(row)
        own = float(column[row])
        if own < self._limit(row):
            raise NotSeparableError(f"row {row} cannot be left out as well")
        scaled = column / np.sqrt(own)
        along = float(self._e[row] / np.sqrt(own))
        self._rows.append(row)
        self._stack.append(scaled)
        self._along.append(along)
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
        NotSeparableError
            The others are so nearly inseparable that rounding decides; S is as before.
        """
        at = self._rows.index(row)
        after = self._rows[at + 1 :]
        try:
            self._rebuild(at, after)
        except NotSeparableError:
            self._rebuild(at, [row, *after])
            raise

    def swap(self, row: int, instead: int) -> None:
        """Bring `row` back and leave `instead` out.

        Raises
        ------
        ValueError
            `row` is not left out.
        NotSeparableError
            `instead` cannot be; S is as before.
        """
        at = self._rows.index(row)
        after = self._rows[at + 1 :]
        try:
            self._rebuild(at, after)
            self.add(instead)
        except NotSeparableError:
            self._rebuild(at, [row, *after])
            raise

    def _rebuild(self, at: int, rows: list[int]) -> None:
        """Keep the stack below `at`, then leave `rows` out."""
        del self._rows[at:], self._stack[at:], self._along[at:]
        if self._stack:
            stack = np.array(self._stack)
            self._e = self._e0 - np.array(self._along) @ stack
            self._r = np.maximum(self._r0 - np.einsum("ki,ki->i", stack, stack), 0.0)
            self._e[self._rows] = 0.0
            self._r[self._rows] = 0.0
        else:
            self._e, self._r = self._e0.copy(), self._r0.copy()
        for row in rows:
            self.add(row)

    def triangle(self) -> Array:
        """Return (k, k) lower triangle L with L L' = R_SS, in the order of `rows`."""
        if not self._rows:
            return np.zeros((0, 0))
        return np.tril(np.array([c[self._rows] for c in self._stack]).T)

    def returns(self) -> tuple[Array, Array]:
        """Say what each row of S would do by coming back, alone.

        With D = R_SS^-1 and B = R[:, S] D, the return of row j of S raises v'Pv by z_j^2 / D_jj,
        e by B[:, j] z_j / D_jj and r by B[:, j]^2 / D_jj.

        Returns
        -------
        ndarray
            (k,) increase of v'Pv, the square of the w that the row then has.
        ndarray
            (n, k) w of every other row then; NaN in S and where a row cannot be tested.
        """
        k, n = len(self._rows), len(self._e)
        if not k:
            return np.zeros(0), np.zeros((n, 0))
        inverse = np.linalg.inv(self.triangle())
        own = (inverse * inverse).sum(axis=0)
        shift = np.array(self._stack).T @ (inverse / np.sqrt(own))
        root = (inverse.T @ np.array(self._along)) / np.sqrt(own)
        r = self._r[:, None] + shift * shift
        good = r >= np.maximum(TESTABLE, _LOST * self._r0 * float(k > 1))[:, None]
        good[self._rows] = False
        w = np.full((n, k), np.nan)
        np.divide(self._e[:, None] + shift * root, np.sqrt(r), out=w, where=good)
        return root * root, w

    def estimates(self) -> tuple[Array, Array]:
        """Return (k,) estimated gross errors of S and (k,) their sigmas, in a-priori sigmas.

        The sigmas are the a-priori ones: roots of the diagonal of R_SS^-1.
        """
        if not self._rows:
            return np.zeros(0), np.zeros(0)
        inverse = np.linalg.inv(self.triangle())
        sigma = np.sqrt((inverse * inverse).sum(axis=0))
        return inverse.T @ np.array(self._along), sigma
