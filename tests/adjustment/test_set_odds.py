"""Odds over sets of gross errors."""

from __future__ import annotations

from itertools import combinations
from math import comb, log

import numpy as np
import pytest

from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.setodds import set_odds
from anaplot.adjustment.strategies import find_gross_errors, pair_odds


def system(errors: dict[int, float], n: int = 14, u: int = 5, seed: int = 1) -> DenseResiduals:
    rng = np.random.default_rng(seed)
    left = np.linalg.svd(rng.normal(size=(n, u)), full_matrices=False)[0]
    matrix = np.eye(n) - left @ left.T
    noise = rng.normal(size=n)
    for row, size in errors.items():
        noise[row] += size
    e = matrix @ noise
    return DenseResiduals(tuple(range(n)), e, np.diag(matrix).copy(), float(e @ e), n - u, matrix)


def by_hand(
    of: DenseResiduals, most: int, widths: np.ndarray | None = None
) -> tuple[dict[tuple[int, ...], float], np.ndarray]:
    """J of all sets up to a size, and the probabilities of the rows."""
    n = len(of.e)
    square = np.full(n, 400.0) if widths is None else widths**2
    values = {}
    for k in range(most + 1):
        for rows in combinations(range(n), k):
            part = list(rows)
            own = np.diag(square[part])
            block = of.matrix[np.ix_(part, part)] + np.linalg.inv(own)
            value = 2.0 * log(comb(n, k)) + 2.0 * k * log(10.0)
            if k:
                e = of.e[part]
                value += np.linalg.slogdet(own @ block)[1] - e @ np.linalg.solve(block, e)
            values[rows] = float(value)
    least = min(values.values())
    weights = {rows: np.exp(-0.5 * (value - least)) for rows, value in values.items()}
    total = sum(weights.values())
    marginal = np.zeros(n)
    for rows, weight in weights.items():
        marginal[list(rows)] += weight / total
    return values, marginal


@pytest.mark.parametrize("errors", [{}, {3: 6.0}, {2: 9.0, 7: -12.0}])
def test_against_all_sets(errors: dict[int, float]) -> None:
    of = system(errors)
    values, marginal = by_hand(of, 4)
    found = set_odds(of, most=4, steps=8000)
    best = min(values, key=lambda rows: values[rows])
    assert found.best == best
    assert found.objective == pytest.approx(values[best], abs=1e-8)
    np.testing.assert_allclose(found.rows, marginal, atol=0.05)
    assert set(errors) == set(found.sure)


def test_rows_of_their_own_widths_against_all_sets() -> None:
    of = system({2: 9.0, 7: -900.0})
    widths = np.full(14, 20.0)
    widths[[7, 9]] = 900.0, 50.0
    values, marginal = by_hand(of, 3, widths)
    found = set_odds(of, most=3, steps=8000, widths=widths)
    best = min(values, key=lambda rows: values[rows])
    assert found.best == best == (2, 7)
    assert found.objective == pytest.approx(values[best], abs=1e-8)
    np.testing.assert_allclose(found.rows, marginal, atol=0.05)


@pytest.mark.parametrize("size", [-30.0, -3000.0])
def test_a_small_error_is_found_whatever_the_size_of_another(size: float) -> None:
    found = find_gross_errors(system({2: 6.5, 7: size}), "odds")
    assert set(found.rows) == {2, 7}


def test_up_to_two_it_agrees_with_the_odds_over_pairs() -> None:
    of = system({4: 5.0})
    found = set_odds(of, most=2, steps=8000)
    np.testing.assert_allclose(found.rows, pair_odds(of).marginal, atol=0.05)


def test_the_same_answer_every_time_and_limits() -> None:
    of = system({2: 15.0, 9: 20.0})
    one, two = set_odds(of, steps=300), set_odds(of, steps=300)
    assert one.best == two.best
    np.testing.assert_array_equal(one.rows, two.rows)
    suspects = np.ones(14, dtype=bool)
    suspects[2] = False
    assert 2 not in set_odds(of, suspects=suspects, steps=300).best
    assert set_odds(of, most=0, steps=5).best == ()
    assert len(set_odds(of, most=1, steps=300).best) == 1
    with pytest.raises(ValueError, match="jumps"):
        set_odds(of, steps=0)
