"""Rows that are cleaned apart, on systems so small that every set can be looked at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from scipy.sparse import csr_array

from anaplot.adjustment.apart import clean_apart
from anaplot.adjustment.doubts import Touching
from anaplot.adjustment.places import Places
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Index

ALPHA = 0.001


class Seen:
    """Rows of which each is a place by itself, without some; how far they touch all it says."""

    far = 0.0

    def __init__(self, matrix: Array, e: Array, out: Sequence[int]) -> None:
        n = len(e)
        self._matrix, self._e, self._gone = matrix, e, np.isin(np.arange(n), out)
        self.e, self.r, self.vtpv = self._without(self._gone)
        for row in out:
            left, r, _ = self._without(self._gone & (np.arange(n) != row))
            self.e[row], self.r[row] = left[row] / r[row], r[row]

    def _without(self, gone: Array) -> tuple[Array, Array, float]:
        matrix, e = self._matrix, self._e
        column = matrix[:, gone] @ np.linalg.inv(matrix[np.ix_(gone, gone)])
        left = e - column @ e[gone]
        vtpv = float(e @ np.linalg.pinv(matrix) @ e)
        spent = float(e[gone] @ np.linalg.inv(matrix[np.ix_(gone, gone)]) @ e[gone])
        return left, np.diag(matrix - column @ matrix[gone]).copy(), vtpv - spent

    exact = True

    def back(self, row: int) -> float:
        return float(self.r[row])

    def places_of(self, rows: Index) -> Index:
        return np.asarray(rows)

    def places(self, numbers: Index) -> Iterator[Places]:
        for k in numbers.tolist():
            mine = np.array([k])
            e, r, vtpv = self._without(self._gone & (np.arange(len(self.e)) != k))
            one = r[mine][None]
            names = list(range(len(self.e)))
            yield Places(
                mine, mine[None], e[mine][None], one, one[:, :, None], 0.0 * one,
                np.array([vtpv]), len(names), names,
            )  # fmt: skip

    def reach(self, numbers: Index) -> Array:
        return np.full(len(numbers), self.far)

    def touching(self, numbers: Index) -> Touching:
        k = len(numbers)
        return Touching(csr_array((k, 1)), np.full(k, self.far > 0.0))


class Rows:
    """A system, adjusted without some of its rows; `asked` counts how often exactly."""

    def __init__(self, matrix: Array, e: Array, begun: tuple[int, ...] = ()) -> None:
        self._matrix, self._e, self.begun, self.asked = matrix, e, begun, 0

    def adjusted(self, out: Sequence[int]) -> Seen:
        self.asked += 1
        return self.drafted(out)

    def drafted(self, out: Sequence[int]) -> Seen:
        return Seen(self._matrix, self._e, out)


class FarSeen(Seen):
    """The same where each of them may carry far."""

    far = 0.5


class FarRows(Rows):
    """The same of these."""

    def drafted(self, out: Sequence[int]) -> Seen:
        return FarSeen(self._matrix, self._e, out)


def alike(count: int) -> tuple[Array, Array]:
    """Pairs of rows that are both beyond the limit as long as the other is in, and a plain error.

    With both out, each that comes back is within it.
    """
    n = 2 * count + 1
    matrix = 0.9 * np.eye(n)
    for k in range(count):
        matrix[2 * k, 2 * k + 1] = matrix[2 * k + 1, 2 * k] = 0.05
    e = np.full(n, 3.35) * 0.9**0.5
    e[::2] *= 1.005
    e[-1] = 30.0
    return matrix, e


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("draft", [False, True])
@pytest.mark.parametrize("best", [False, True])
def test_of_rows_that_go_for_each_others_sake_one_goes(count: int, draft: bool, best: bool) -> None:
    matrix, e = alike(count)
    rows, suspects = Rows(matrix, e), np.ones(len(e), dtype=bool)
    end = clean_apart(rows, suspects, len(e), ALPHA, Watch(), draft=draft, best=best)
    assert not end.remarks
    assert end.rows[-1] == 2 * count
    assert len(end.rows) == count + 1
    assert {row // 2 for row in end.rows} == set(range(count + 1))
    # no row that is in is beyond the limit, none that is out is within it
    gone = np.isin(np.arange(len(e)), end.rows)
    w = np.abs(end.given.e) * np.where(gone, end.given.r**0.5, end.given.r**-0.5)
    np.testing.assert_array_equal(w > critical_normal(ALPHA), gone)
    assert (rows.asked > 0) == (not draft)


def test_on_the_way_from_a_robust_solution_nothing_is_adjusted_anew() -> None:
    matrix, e = alike(2)
    rows = Rows(matrix, e, begun=(4,))
    end = clean_apart(rows, np.ones(5, dtype=bool), 5, ALPHA, Watch(), draft=True)
    assert rows.asked == 0
    assert len(end.rows) == 3


@pytest.mark.parametrize("draft", [False, True])
def test_for_rows_that_cannot_go_no_other_waits(draft: bool) -> None:
    """Of rows 0 and 3 too little is seen for a w of that size: they stay, see `Proposals`."""
    matrix = np.diag([1e-8, 0.9, 0.9, 1e-8, 0.9])
    e = np.array([4.5, 4.2, 1.0, 4.4, 3.6]) * np.sqrt(np.diag(matrix))
    suspects = np.ones(5, dtype=bool)
    end = clean_apart(FarRows(matrix, e), suspects, 5, ALPHA, Watch(), draft=draft)
    assert end.rows == (1, 4)
    # a row that goes is waited for
    e[0] = 40.0 * 1e-4
    end = clean_apart(FarRows(matrix, e), suspects, 5, ALPHA, Watch(), draft=draft)
    assert end.rows == (0, 1, 4)
