"""Of rows that cannot be told apart the one is rejected whose error is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.adjustment.batch import reject_stepwise
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.strategies import find_gross_errors
from anaplot.adjustment.ties import surest

N, U = 20, 4


def inseparable(seed: int, loose: int, firm: int, ratio: float) -> np.ndarray:
    """R of a design in which an unknown of their own leaves two rows a single condition.

    The redundancy number of `loose` is about ratio^2 of that of `firm`; rounding is in its favour.
    """
    rng = np.random.default_rng(seed)
    design = np.hstack((rng.normal(size=(N, U)), np.zeros((N, 1))))
    design[[loose, firm], U] = 1.0, ratio
    q, _ = np.linalg.qr(design)
    matrix = np.eye(N) - q @ q.T
    # below 1e-4 by less than R is known to; w of the row grows by a hundred millionth
    matrix[loose, loose] = matrix[loose, firm] ** 2 / matrix[firm, firm] * (1.0 - 2e-8)
    return matrix


def residuals(matrix: np.ndarray, errors: np.ndarray) -> DenseResiduals:
    e = matrix @ errors
    return DenseResiduals(tuple(range(N)), e, np.diag(matrix), float(e @ e), N - U - 1, matrix)


rows = st.permutations(range(N))


@given(st.integers(0, 10**6), rows, st.sampled_from([3e-4, 1e-3, 3e-3]))
@pytest.mark.parametrize("strategy", ["baarda", "tau", "search"])
def test_an_error_is_sought_where_it_is_seen(
    strategy: str, seed: int, order: list[int], ratio: float
) -> None:
    loose, firm, other = order[:3]
    matrix = inseparable(seed, loose, firm, ratio)
    errors = np.random.default_rng(seed).normal(size=N) * 0.1
    errors[[firm, other]] += 40.0, 60.0
    found = find_gross_errors(residuals(matrix, errors), strategy)
    if firm not in found.rows and matrix[firm, firm] < 0.05:
        return  # hardly seen at all
    assert firm in found.rows
    assert loose not in found.rows
    assert (firm, loose) in {(tie.rejected, tie.kept) for tie in found.hard_to_tell}
    if strategy != "search":
        many = reject_stepwise(matrix, errors[None], strategy, 0.001)
        assert [k for k in many.order[0] if k >= 0] == [r.row for r in found.rejected]


def test_rows_with_redundancy_enough_are_as_sure_as_any() -> None:
    matrix = inseparable(1, 3, 7, 0.1)
    errors = np.zeros(N)
    errors[7] = 60.0
    for strategy in ("baarda", "search"):
        assert find_gross_errors(residuals(matrix, errors), strategy).rows == (3,)
    assert reject_stepwise(matrix, errors[None], "baarda", 0.001).order[0].tolist() == [3]


def chosen(size: list[float], r: list[float], correlation: list[float]) -> int:
    """What is chosen in place of row 0."""
    column = np.array(correlation) * np.sqrt(np.array(r) * r[0])
    found = surest(np.array([size]), np.array([r]), column[None], np.zeros(1, dtype=np.intp))
    return int(found[0])


def test_only_what_rounding_cannot_tell_apart_is_a_tie() -> None:
    r = [1e-7, 0.1, 0.3, 0.3]
    one = 1.0 - 1e-8
    assert chosen([9.0, 9.0, 9.0 * one, 9.0], r, [1.0, -1.0, -one, 1.0]) == 2
    assert chosen([9.0, 9.0, 9.0, 9.0], r, [1.0, -1.0, 0.9999, 0.5]) == 1
    assert chosen([9.0, 8.999, 8.9, np.nan], r, [1.0, 1.0, 1.0, 1.0]) == 0
    # known to a billionth itself
    assert chosen([9.0, 9.0, 9.0, 9.0], [2e-4, *r[1:]], [1.0, 1.0, 1.0, 1.0]) == 0
