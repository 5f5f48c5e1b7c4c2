"""Intervals of means: decided by what is counted, inside its range, never of zero width."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.planning.montecarlo import sums
from anaplot.planning.quantities import COUNT, MEASURE, YES_OR_NO, mean_interval, out_of, share
from anaplot.planning.rates import score_interval


def interval(quantity, values, confidence: float = 0.95) -> tuple[float, float]:
    found = mean_interval(quantity, *sums(values), confidence)
    assert found is not None
    return found


@given(st.integers(1, 9).flatmap(lambda k: st.tuples(
    st.just(k), st.lists(st.integers(0, k), min_size=1, max_size=40))))  # fmt: skip
def test_so_many_of_k(case: tuple[int, list[int]]) -> None:
    k, values = case
    low, high = interval(out_of(k), values)
    mean = float(np.mean(values))
    assert 0.0 <= low <= mean + 1e-12
    assert mean <= high + 1e-12
    assert high <= k
    assert high - low > 1e-3 * k / len(values)
    # what is missed mirrors what is right
    assert interval(out_of(k), [k - v for v in values]) == pytest.approx((k - high, k - low))


@given(st.lists(st.booleans(), min_size=1, max_size=60))
def test_yes_or_no_is_wilsons(values: list[bool]) -> None:
    rate = score_interval(sum(values) / len(values), len(values), 0.95)
    assert interval(YES_OR_NO, values) == pytest.approx(rate)


@given(st.lists(st.integers(0, 50), min_size=2, max_size=40))
def test_counts_are_never_negative(values: list[int]) -> None:
    low, high = interval(COUNT, values)
    assert 0.0 <= low <= np.mean(values) + 1e-12
    assert high > np.mean(values)


def test_the_drawn_values_do_not_decide() -> None:
    # of four errors none or one was missed: still a number out of four, not a yes or no
    assert interval(out_of(4), [0, 1, 0, 0, 1, 0]) != interval(YES_OR_NO, [0, 1, 0, 0, 1, 0])
    # nothing missed: how errors are missed together is not known, so only the runs count
    low, high = interval(out_of(4), [0] * 100)
    assert (low, high) == (0.0, pytest.approx(4.0 * score_interval(0.0, 100, 0.95)[1]))


def test_a_length_has_the_interval_of_its_mean_in_any_unit() -> None:
    values = np.array([0.11, 0.09, 0.30, 0.12])
    low, high = interval(MEASURE, values)
    half = 1.959964 * values.std(ddof=1) / 2.0
    assert (low, high) == (
        pytest.approx(values.mean() - half, abs=1e-6),
        pytest.approx(values.mean() + half, abs=1e-6),
    )
    assert interval(MEASURE, 1000.0 * values) == pytest.approx((1000.0 * low, 1000.0 * high))
    assert interval(MEASURE, [0.0, 0.0, 0.0, 1.0])[0] == 0.0


def test_a_single_run() -> None:
    assert mean_interval(COUNT, 1, 3.0, 9.0) is None
    assert mean_interval(MEASURE, 1, 3.0, 9.0) is None
    low, high = interval(out_of(2), [1])
    assert 0.0 < low < 0.2 < 1.8 < high < 2.0
    assert mean_interval(out_of(0), 1, 0.0, 0.0) == (0.0, 0.0)


@pytest.mark.parametrize(("k", "p"), [(1, 0.02), (3, 0.5), (10, 0.01), (10, 0.4), (10, 0.99)])
@pytest.mark.parametrize("together", [0.0, 0.4])
def test_it_covers_the_mean_as_often_as_it_says(k: int, p: float, together: float) -> None:
    rng = np.random.default_rng(11)
    trials, runs = 400, 60
    fate = rng.random((trials, runs, 1)) < p
    own = rng.random((trials, runs, k)) < p
    shared = rng.random((trials, runs, 1)) < together
    values = np.where(shared, fate, own).sum(axis=2)
    inside = 0
    for one in values:
        low, high = interval(out_of(k), one)
        inside += low <= k * p <= high
    assert inside / trials >= 0.90


def test_the_mean_of_counts_is_covered() -> None:
    rng = np.random.default_rng(12)
    for mean in (0.05, 1.0, 8.0):
        inside = 0
        for one in rng.poisson(mean, (400, 50)):
            low, high = interval(COUNT, one)
            inside += low <= mean <= high
        assert inside / 400 >= 0.92


def test_shares_of_many_rows_are_known_well() -> None:
    rng = np.random.default_rng(13)
    values = rng.binomial(20, 0.01, 5000) / 20.0
    low, high = interval(share(20), values)
    normal = 2 * 1.96 * values.std() / np.sqrt(5000)
    assert high - low == pytest.approx(normal, rel=0.05)
