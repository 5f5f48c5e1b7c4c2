"""Pooled variances: degrees of freedom, intervals and tests that hold what they say."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import chdtri

from anaplot.adjustment.pooling import (
    Pooled,
    covariance_degrees,
    equal_variances,
    pooled_rows,
    student_two_sided,
    variance_interval,
)

RUNS = 1000


def adjusted(seed: int, n: int = 14, u: int = 5):
    """Residuals, weights, w, redundancy numbers and correlations of an adjustment, sigma0 1."""
    rng = np.random.default_rng(seed)
    design, p = rng.normal(size=(n, u)), rng.uniform(0.5, 2.0, n)
    q_vv = np.diag(1.0 / p) - design @ np.linalg.inv(design.T @ (p[:, None] * design)) @ design.T
    v = -(q_vv * p) @ (rng.normal(size=n) / np.sqrt(p))
    size = np.sqrt(np.diag(q_vv))
    return v, p, v / size, np.diag(q_vv * p), q_vv / size[:, None] / size


@given(st.integers(0, 10_000))
def test_all_rows_of_an_adjustment_have_its_redundancy_as_degrees(seed: int) -> None:
    v, p, w, r, correlation = adjusted(seed)
    found = pooled_rows(w, r, correlation, np.ones(len(w), dtype=bool))
    assert found.weighted == pytest.approx(float(v @ (p * v)))
    assert found.redundancy == pytest.approx(9.0)
    assert found.degrees == pytest.approx(9.0)


def test_some_rows_are_as_good_as_their_degrees_say() -> None:
    rows = np.arange(14) < 6
    factors, degrees = [], []
    for seed in range(RUNS):
        _, _, w, r, correlation = adjusted(seed)
        found = pooled_rows(w, r, correlation, rows)
        factors.append(found.factor)
        degrees.append(found.degrees)
    # mean 1 and variance 2 / nu; four standard deviations of the mean of RUNS
    spread = sqrt(float(np.mean(2.0 / np.array(degrees))))
    assert abs(np.mean(factors) - 1.0) < 4.0 * spread / sqrt(RUNS)
    # of a variance of chi-square like values: sqrt((kurtosis - 1) / RUNS), 12 / nu + 2
    nu = float(np.mean(degrees))
    assert abs(np.var(factors) / spread**2 - 1.0) < 4.0 * sqrt((12.0 / nu + 2.0) / RUNS)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(RUNS):
        low, high = variance_interval(float(rng.chisquare(4.0)) / 4.0, 4.0)
        held += low <= 1.0 and (high is None or high >= 1.0)
    # binomial, four standard deviations
    assert abs(held - 0.95 * RUNS) < 4.0 * sqrt(RUNS * 0.95 * 0.05)
    assert variance_interval(1.0, 0.01)[1] is None


@pytest.mark.parametrize("degrees", [(7.0, 12.0), (7.0, 12.0, 20.0, 9.0)])
def test_equal_variances_are_called_different_as_often_as_is_said(degrees) -> None:
    rng = np.random.default_rng(4)
    found = [
        equal_variances([float(rng.chisquare(nu)) / nu for nu in degrees], degrees)
        for _ in range(RUNS)
    ]
    assert {test.kind for test in found} == {"F" if len(degrees) == 2 else "Bartlett"}
    for level in (0.05, 0.3):
        few = sum(test.probability < level for test in found)
        assert abs(few - level * RUNS) < 4.0 * sqrt(RUNS * level * (1.0 - level))


def test_different_variances_are_found() -> None:
    # 1.8 times the sigma: F of 60 and 60 degrees is 3.24, its 99.5 % point 1.96
    test = equal_variances([1.0, 1.8**2], [60.0, 60.0])
    assert test is not None
    assert test.probability < 1e-4
    assert equal_variances([1.0], [5.0]) is None
    assert equal_variances([0.0, 1.0], [5.0, 5.0]) is None


@given(st.integers(2, 30), st.integers(1, 4), st.integers(0, 1000))
def test_degrees_lie_between_one_coordinate_and_all(n: int, p: int, seed: int) -> None:
    drawn = np.random.default_rng(seed).normal(size=(n, p)) * [1.0, 2.0, 3.0, 4.0][:p]
    found = covariance_degrees(drawn.T @ drawn / n, n)
    assert n <= found <= n * p


def test_coordinates_that_err_alike_count_once_independent_ones_each() -> None:
    one = np.random.default_rng(5).normal(size=(400, 1))
    alike = np.repeat(one, 4, axis=1)
    assert covariance_degrees(alike.T @ alike / 400, 400) == pytest.approx(400, rel=0.02)
    each = np.random.default_rng(6).normal(size=(400, 4))
    assert covariance_degrees(each.T @ each / 400, 400) > 1500


def test_sums_add_and_t_is_students() -> None:
    both = Pooled(3, 2.0, 1.5, 1.2).plus(Pooled(2, 1.0, 0.5, 0.4))
    assert both == Pooled(5, 3.0, 2.0, 1.6)
    assert (both.factor, both.degrees) == (1.5, 2.5)
    assert (Pooled().factor, Pooled().degrees) == (None, 0.0)
    # t^2 of one and very many degrees is chi-square of one
    assert student_two_sided(sqrt(float(chdtri(1.0, 0.05))), 1e9) == pytest.approx(0.05, rel=1e-6)
