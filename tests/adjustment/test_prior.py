"""Three Bayesian estimators against dense formulas, and their size over many noises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anaplot.adjustment.leastsquares import RankDefectError
from anaplot.adjustment.prior import (
    LinearSystem,
    classic_estimate,
    common_estimate,
    known_estimate,
    separate_estimate,
)
from anaplot.errors import NotComputableError

ESTIMATORS = {"known": known_estimate, "common": common_estimate, "separate": separate_estimate}


def estimate_classical(a, vector, p, **options):
    return classic_estimate(
        LinearSystem(a, vector, p, np.zeros(a.shape[1]), np.zeros(a.shape[1])), **options
    )


def estimate_with_prior(a, vector, p, l_x, p_x, *, factors="common", **options):
    return ESTIMATORS[factors](LinearSystem(a, vector, p, l_x, p_x), **options)


def system(seed: int, n: int = 12, u: int = 4):
    rng = np.random.default_rng(seed)
    return (
        rng.normal(size=(n, u)),
        rng.normal(size=n),
        rng.uniform(0.5, 3.0, n),
        rng.normal(size=u),
        rng.uniform(0.2, 2.0, u),
    )


def test_classical_is_equation_1():
    a, vector, p, _, _ = system(1)
    normal = a.T @ np.diag(p) @ a
    x = -np.linalg.solve(normal, a.T @ (p * vector))
    v = a @ x + vector
    for divisors, divisor in (("paper", 12 - 4 - 2), ("rigorous", 12 - 4)):
        found = estimate_classical(a, vector, p, divisors=divisors)
        s2 = float(v @ (p * v)) / divisor
        np.testing.assert_allclose(found.x, x)
        np.testing.assert_allclose(found.v, v)
        assert found.variance == pytest.approx(s2)
        np.testing.assert_allclose(found.covariance, s2 * np.linalg.inv(normal))
        np.testing.assert_allclose(found.deviations, np.sqrt(s2 * np.diag(np.linalg.inv(normal))))
        assert found.redundancy == pytest.approx(8.0)
        assert np.isnan(found.r_x).all()


def test_known_and_common_are_equation_2():
    a, vector, p, l_x, p_x = system(2)
    normal = a.T @ np.diag(p) @ a + np.diag(p_x)
    x = -np.linalg.solve(normal, a.T @ (p * vector) + p_x * l_x)
    v, v_x = a @ x + vector, x + l_x
    total = float(v @ (p * v) + v_x @ (p_x * v_x))
    known = estimate_with_prior(a, vector, p, l_x, p_x, factors="known")
    np.testing.assert_allclose(known.covariance, np.linalg.inv(normal))
    for divisors, divisor in (("paper", 12 - 2), ("rigorous", 12)):
        found = estimate_with_prior(a, vector, p, l_x, p_x, factors="common", divisors=divisors)
        np.testing.assert_allclose(found.x, x)
        np.testing.assert_allclose(found.v_x, v_x)
        assert found.variance == found.prior_variance == pytest.approx(total / divisor)
        np.testing.assert_allclose(found.covariance, total / divisor * np.linalg.inv(normal))


@pytest.mark.parametrize("divisors", ["paper", "rigorous"])
def test_separate_is_a_fixed_point_of_equation_3(divisors):
    a, vector, p, l_x, p_x = system(3, n=30, u=8)
    l_x *= 5.0
    found = estimate_with_prior(a, vector, p, l_x, p_x, factors="separate", divisors=divisors)
    assert found.converged
    assert len(found.history) - 1 == found.iterations > 2
    np.testing.assert_array_equal(found.history[0], [1.0, 1.0])
    s2, s2_x = found.variance, found.prior_variance
    covariance = np.linalg.inv(a.T @ np.diag(p) @ a / s2 + np.diag(p_x) / s2_x)
    x = -covariance @ (a.T @ (p * vector) / s2 + p_x * l_x / s2_x)
    np.testing.assert_allclose(found.x, x, atol=1e-10)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-9, atol=1e-12)
    v, v_x = a @ x + vector, x + l_x
    r = 30 - np.trace(covariance @ a.T @ np.diag(p) @ a) / s2
    r_x = 8 - np.trace(covariance @ np.diag(p_x)) / s2_x
    assert found.redundancy == pytest.approx(r)
    assert found.prior_redundancy == pytest.approx(r_x)
    assert r + r_x == pytest.approx(30.0)
    shares = (30 - 8, 30 - 8) if divisors == "paper" else (r, r_x)
    assert s2 == pytest.approx(float(v @ (p * v)) / shares[0], rel=1e-7)
    assert s2_x == pytest.approx(float(v_x @ (p_x * v_x)) / shares[1], rel=1e-7)


def test_an_iteration_cut_short_says_so():
    a, vector, p, l_x, p_x = system(3, n=30, u=8)
    found = estimate_with_prior(a, vector, p, l_x, p_x, factors="separate", limit=2)
    assert not found.converged
    assert found.iterations == 2


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(0, 12))
@settings(max_examples=60)
def test_redundancies_add_up_to_n_when_all_unknowns_have_a_prior(seed, u, more):
    n = u + more
    a, vector, p, l_x, p_x = system(seed, n, u)
    found = estimate_with_prior(a, vector, p, l_x, p_x, factors="known")
    assert found.redundancy + found.prior_redundancy == pytest.approx(n)
    assert (found.r > -1e-9).all()
    assert (found.r < 1 + 1e-9).all()
    assert (found.r_x > -1e-9).all()
    assert (found.r_x < 1 + 1e-9).all()


def test_correlated_weights_equal_their_decorrelated_observations():
    a, vector, _, l_x, _ = system(4)
    rng = np.random.default_rng(4)
    root, root_x = rng.normal(size=(12, 12)), rng.normal(size=(4, 4))
    p, p_x = root.T @ root + np.eye(12), root_x.T @ root_x + np.eye(4)
    found = estimate_with_prior(a, vector, p, l_x, p_x, factors="known")
    normal = a.T @ p @ a + p_x
    x = -np.linalg.solve(normal, a.T @ p @ vector + p_x @ l_x)
    np.testing.assert_allclose(found.x, x)
    q_vv = np.linalg.inv(p) - a @ np.linalg.inv(normal) @ a.T
    np.testing.assert_allclose(found.r, np.diag(q_vv @ p), atol=1e-10)


def test_unknowns_without_prior_have_none():
    a, vector, p, l_x, p_x = system(5)
    p_x[1] = 0.0
    found = estimate_with_prior(a, vector, p, l_x, p_x, factors="known")
    assert np.isnan(found.r_x[1])
    assert found.redundancy + found.prior_redundancy == pytest.approx(12 - 1)


def test_separate_rigorous_factors_are_those_that_made_the_noise():
    rng = np.random.default_rng(11)
    n, u, runs = 60, 25, 200
    a = rng.normal(size=(n, u))
    factors = []
    for _ in range(runs):
        truth = rng.normal(size=u) * 3.0  # prior of sigma 1, really 3
        observed = a @ truth + rng.normal(size=n) * 0.5  # sigma 1, really 0.5
        found = estimate_with_prior(
            a, -observed, np.ones(n), np.zeros(u), np.ones(u), factors="separate"
        )
        assert found.converged
        factors.append((found.variance, found.prior_variance))
    mean = np.mean(factors, axis=0)
    error = np.std(factors, axis=0) / np.sqrt(runs)
    assert abs(mean[0] - 0.25) < 4.0 * error[0]
    assert abs(mean[1] - 9.0) < 4.0 * error[1]


def test_the_papers_divisor_overstates_the_observations_factor():
    # n - u = 21 in its block where the observations' own share is larger
    rng = np.random.default_rng(12)
    n, u = 60, 40
    a = rng.normal(size=(n, u))
    truth = rng.normal(size=u)
    observed = a @ truth + rng.normal(size=n)
    arguments = (a, -observed, np.ones(n), np.zeros(u), np.ones(u))
    paper = estimate_with_prior(*arguments, factors="separate", divisors="paper")
    rigorous = estimate_with_prior(*arguments, factors="separate", divisors="rigorous")
    assert rigorous.redundancy > n - u
    assert paper.variance > rigorous.variance


def test_no_redundancy_gives_no_factor():
    a, vector, p, _, _ = system(6, n=4, u=4)
    with pytest.raises(NotComputableError, match="divisor is 0"):
        estimate_classical(a, vector, p)
    with pytest.raises(NotComputableError, match="there are none"):
        estimate_with_prior(
            np.eye(3), np.ones(3), np.ones(3), np.zeros(3), np.zeros(3), factors="separate"
        )


def test_a_factor_that_vanishes_is_named():
    a, _, p, _, p_x = system(7)
    with pytest.raises(NotComputableError, match="observations is not determined"):
        estimate_with_prior(a, np.zeros(12), p, np.zeros(4), p_x, factors="separate")


def test_rank_defects_and_bad_input():
    a, vector, p, l_x, p_x = system(8)
    a[:, 2] = a[:, 1]
    with pytest.raises(RankDefectError, match=r"x[23]"):
        estimate_classical(a, vector, p)
    resolved = estimate_with_prior(a, vector, p, l_x, p_x)
    assert np.isfinite(resolved.x).all()
    with pytest.raises(ValueError, match="must be positive"):
        estimate_classical(a, vector, -p)
    with pytest.raises(ValueError, match="must not be negative"):
        estimate_with_prior(a, vector, p, l_x, -p_x)
    with pytest.raises(ValueError, match="finite"):
        estimate_classical(a, vector * np.nan, p)
    with pytest.raises(ValueError, match="shapes"):
        estimate_with_prior(a, vector, p, l_x[:-1], p_x)
    with pytest.raises(ValueError, match="positive definite"):
        estimate_classical(a, vector, -np.eye(12))
    with pytest.raises(NotComputableError, match="divisor"):
        estimate_with_prior(
            a[:3], vector[:3], p[:3], l_x, p_x, factors="separate", divisors="paper"
        )
