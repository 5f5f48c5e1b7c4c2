"""Odds over sets of gross errors."""

from __future__ import annotations

from itertools import combinations, product
from math import log

import numpy as np
import pytest

from anaplot.adjustment import setodds
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.setodds import WIDTHS, most_probable_set, set_odds
from anaplot.adjustment.strategies import find_gross_errors

N, U = 14, 5
CRITICAL = 3.29


def system(errors: dict[int, float], n: int = N, u: int = U, seed: int = 1) -> DenseResiduals:
    rng = np.random.default_rng(seed)
    left = np.linalg.svd(rng.normal(size=(n, u)), full_matrices=False)[0]
    matrix = np.eye(n) - left @ left.T
    noise = rng.normal(size=n)
    for row, size in errors.items():
        noise[row] += size
    e = matrix @ noise
    return DenseResiduals(tuple(range(n)), e, np.diag(matrix).copy(), float(e @ e), n - u, matrix)


def by_hand(
    of: DenseResiduals, most: int, width: float, levels: int = 2
) -> tuple[dict[tuple[int, ...], float], np.ndarray]:
    """J of all sets up to a size with their best widths, and the probabilities of the rows."""
    n = len(of.e)
    mean = of.r.mean()
    price = CRITICAL**2 - log(1.0 + 100.0 * mean) - 36.0 / width**2 * np.log(of.r / mean)
    best: dict[tuple[int, ...], float] = {}
    weights: list[tuple[tuple[int, ...], float]] = []
    for k in range(most + 1):
        for rows in combinations(range(n), k):
            part = list(rows)
            for own in product(range(levels), repeat=k):
                square = np.diag([(width * 8.0**level) ** 2 for level in own])
                value = price[part].sum()
                value += sum(2.0 * (level * log(8.0) + (level > 0) * log(5.0)) for level in own)
                if k:
                    block = of.matrix[np.ix_(part, part)] + np.linalg.inv(square)
                    e = of.e[part]
                    value += np.linalg.slogdet(square @ block)[1] - e @ np.linalg.solve(block, e)
                best[rows] = min(best.get(rows, np.inf), float(value))
                weights.append((rows, float(value)))
    least = min(best.values())
    marginal, total = np.zeros(n), 0.0
    for rows, value in weights:
        weight = np.exp(-0.5 * (value - least))
        total += weight
        marginal[list(rows)] += weight
    return best, marginal / total


def test_how_long_the_chain_stays_weighs_a_set() -> None:
    of = system({3: 9.0}, n=7, u=3)
    found = most_probable_set(of, CRITICAL, most=1, widths=(9.0,))
    odds = set_odds(of, CRITICAL, found, most=1, steps=4000)
    marginal = by_hand(of, 1, 9.0)[1]
    assert 0.1 < marginal.max() < 0.9
    np.testing.assert_allclose(odds.rows, marginal, atol=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("errors", [{}, {3: 6.0}, {2: 9.0, 7: -12.0}, {2: 9.0, 7: -90.0}])
def test_against_all_sets(errors: dict[int, float]) -> None:
    of = system(errors)
    width = 9.0
    values, marginal = by_hand(of, 3, width, 3)
    found = most_probable_set(of, CRITICAL, most=3, widths=(width,))
    best = min(values, key=lambda rows: values[rows])
    assert found.rows == best
    price = 4.0 * (2.0 * log(width / 6.0) + (6.0 / width) ** 2 - 1.0)
    assert found.objective == pytest.approx(values[best] + price, abs=1e-8)
    odds = set_odds(of, CRITICAL, found, most=3, steps=8000)
    np.testing.assert_allclose(odds.rows, marginal, atol=0.05)
    assert set(errors) == set(odds.sure)


@pytest.mark.parametrize("size", [-30.0, -3000.0, 3e6])
def test_a_small_error_is_found_whatever_the_size_of_another(size: float) -> None:
    found = find_gross_errors(system({2: 6.5, 7: size}), "odds")
    assert set(found.rows) == {2, 7}


def test_the_width_is_that_of_the_errors() -> None:
    rng = np.random.default_rng(4)
    for size in (6.0, 18.0, 50.0):
        rows = rng.choice(80, 10, replace=False)
        of = system(dict(zip(rows.tolist(), np.tile((size, -size), 5), strict=True)), n=80, u=10)
        found = most_probable_set(of, CRITICAL)
        assert set(found.rows) >= set(rows.tolist())
        assert size / 1.5 < found.width < size * 1.5
    # of one error alone little is learned
    assert most_probable_set(system({3: 18.0}), CRITICAL).width <= 12.0


@pytest.mark.slow
def test_without_errors_a_row_alone_goes_out_about_as_often_as_its_test_says() -> None:
    n, runs, alpha = 40, 400, 0.01
    rng = np.random.default_rng(9)
    left = np.linalg.svd(rng.normal(size=(n, 8)), full_matrices=False)[0]
    matrix = np.eye(n) - left @ left.T
    r = np.diag(matrix).copy()
    gone = 0
    for _ in range(runs):
        e = matrix @ rng.normal(size=n)
        of = DenseResiduals(tuple(range(n)), e, r, float(e @ e), n - 8, matrix)
        gone += len(most_probable_set(of, 2.5758).rows)
    # the price is that of the test for one width; for others the level moves by a factor below two
    assert 0.5 * alpha < gone / (n * runs) < 2.0 * alpha


def test_the_same_answer_every_time_and_limits() -> None:
    of = system({2: 15.0, 9: 20.0})
    found = most_probable_set(of, CRITICAL)
    assert found.rows == (2, 9)
    assert found.width in WIDTHS
    one, two = (set_odds(of, CRITICAL, found, steps=300) for _ in range(2))
    np.testing.assert_array_equal(one.rows, two.rows)
    assert one.sure == found.rows
    assert one.rows.max() <= 1.0
    assert one.rows[list(found.rows)] == pytest.approx([1.0, 1.0], abs=0.01)
    suspects = np.ones(N, dtype=bool)
    suspects[2] = False
    assert 2 not in most_probable_set(of, CRITICAL, suspects=suspects).rows
    none = most_probable_set(of, CRITICAL, most=0)
    assert none.rows == ()
    assert not set_odds(of, CRITICAL, none, most=0, steps=5).rows.any()
    assert len(most_probable_set(of, CRITICAL, most=1).rows) == 1
    with pytest.raises(ValueError, match="jumps"):
        set_odds(of, CRITICAL, found, steps=0)


@pytest.mark.parametrize(("errors", "wide"), [({2: 9.0, 7: -12.0}, 2), ({2: 90.0, 8: 2000.0}, 4)])
def test_neighbours_change_the_objective_by_what_is_said(
    errors: dict[int, float], wide: int
) -> None:
    of = system(errors, n=9, u=3)
    sets = setodds._Sets(of, CRITICAL, np.arange(9) != 4, 3)
    sets.take(2.0)
    assert max(sets.levels_of(np.array([1e9]))) == wide - 1
    for held, levels in (([], []), ([7], [0]), ([7, 2], [0, 1]), ([2, 7, 0], [1, 0, 0])):
        here = sets.objective(held, levels)
        numbers, change = sets.neighbours(held, levels, np.inf)
        assert (np.diff(numbers) > 0).all()
        free = 8 - len(held)
        more = wide * free if len(held) < 3 else 0
        exchanged = len(held) * (wide * free + wide - 1)
        assert len(numbers) == more + len(held) + exchanged
        for number, said in zip(numbers.tolist(), change.tolist(), strict=True):
            rows, own = list(held), list(levels)
            sets.jump(rows, own, number)
            assert 4 not in rows
            assert len(set(rows)) == len(rows)
            assert sets.objective(rows, own) - here == pytest.approx(said, rel=1e-6, abs=1e-6)
        for beyond in (1e-7, 5.0, 40.0):
            some, of_some = sets.neighbours(held, levels, beyond)
            matter = change <= max(change.min(), 0.0) + beyond
            assert set(numbers[matter].tolist()) <= set(some.tolist())
            at = np.searchsorted(numbers, some)
            np.testing.assert_allclose(of_some, change[at], rtol=1e-12, atol=1e-12)


def test_what_does_not_matter_is_not_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    of = system({3: 12.0, 11: -300.0}, n=40, u=12)
    found = most_probable_set(of, CRITICAL)
    few = set_odds(of, CRITICAL, found)
    monkeypatch.setattr(setodds, "_NEGLIGIBLE", 1e-300)
    every = set_odds(of, CRITICAL, found)
    np.testing.assert_allclose(few.rows, every.rows, rtol=1e-9)


def test_sets_are_weighed_when_it_is_asked_for() -> None:
    of = system({3: 12.0, 11: -30.0}, n=40, u=12)
    whole, postponed = (find_gross_errors(of, "odds", weigh=now) for now in (True, False))
    assert any("more probably in error than not: 2 of 2" in one for one in whole.remarks)
    assert not any("more probably" in one for one in postponed.remarks)
    assert postponed.weighed.remarks == whole.remarks
    assert whole.weighed is whole
