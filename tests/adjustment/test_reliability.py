"""Standardized residuals, detectable errors, correlations, transfers, odds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from anaplot.adjustment.leastsquares import Adjustment, adjust
from anaplot.adjustment.reliability import (
    critical_transfers,
    error_odds,
    residual_correlations,
    smallest_detectable_errors,
    standardize,
    undetected_effects,
)


def sample(seed=1, n=12, u=5):
    rng = np.random.default_rng(seed)
    return adjust(
        rng.normal(size=(n, u)),
        rng.normal(size=n),
        rng.uniform(0.5, 2.0, n),
        unknowns=[f"g{k}" for k in range(u)],
    )


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_expected_deviation_and_ratio(kind):
    a = sample()
    s = standardize(a, kind=kind, alpha=0.001, apriori=0.7)
    sigma = a.sigma0 if kind == "tau" else 0.7
    assert s.sigma == pytest.approx(sigma)
    assert s.expected == pytest.approx(sigma * np.sqrt(np.diag(a.q_vv)))
    assert s.ratio == pytest.approx(np.abs(a.w) / s.expected)


def test_tau_never_exceeds_the_root_of_the_redundancy():
    for seed in range(20):
        s = standardize(sample(seed), kind="tau", alpha=0.001, apriori=1.0)
        assert np.all(s.ratio <= np.sqrt(7) * (1.0 + 1e-12))


def test_without_redundancy():
    a = sample(n=5)
    tau = standardize(a, kind="tau", alpha=0.001, apriori=1.0)
    assert (tau.sigma, tau.critical, tau.expected, tau.ratio) == (None, None, None, None)
    baarda = standardize(a, kind="baarda", alpha=0.001, apriori=1.0)
    assert baarda.critical is None
    assert np.isnan(baarda.ratio).all()
    odds = error_odds(a.r, tau.ratio, 0, "tau")
    assert odds.none == pytest.approx(0.9)
    assert odds.rows == pytest.approx(np.full(5, 0.02))


def test_a_row_without_redundancy_is_not_testable():
    B = np.zeros((7, 2))
    B[0, 0] = 1.0  # the only row that knows g0
    B[1:, 1] = 1.0
    a = adjust(B, np.arange(7.0), np.ones(7), unknowns=["g0", "g1"])
    s = standardize(a, kind="baarda", alpha=0.001, apriori=1.0)
    assert np.isnan(s.ratio[0])
    assert np.isfinite(s.ratio[1:]).all()
    nabla = smallest_detectable_errors(a.r, a.q_l, apriori=1.0, alpha=0.001, power=0.8)
    assert np.isnan(nabla[0])
    assert nabla[1] == pytest.approx(4.132 / np.sqrt(5 / 6), rel=1e-4)
    effect = undetected_effects(a.r, alpha=0.001, power=0.8)
    assert np.isnan(effect[0])
    assert effect[1] == pytest.approx(4.132 * np.sqrt(1 / 5), rel=1e-4)
    rho = residual_correlations(a.q_vv, a.r)
    assert np.isnan(rho[0]).all()
    assert np.isnan(rho[:, 0]).all()
    assert rho[1, 2] == pytest.approx(-1.0 / 5.0)
    assert all(0 not in (i, j) for i, j, _ in critical_transfers(a.q_vv / a.q_l))
    odds = error_odds(a.r, s.ratio, a.redundancy, "baarda")
    assert odds.rows[0] / odds.none == pytest.approx(0.1 / 7 / 0.9)  # its prior, unmoved


def test_external_reliability_bounds_every_function_of_the_unknowns():
    rng = np.random.default_rng(2)
    B, q = rng.normal(size=(12, 5)), rng.uniform(0.5, 2.0, 12)
    a = adjust(B, np.zeros(12), q, unknowns=list("abcde"))
    nabla = smallest_detectable_errors(a.r, q, apriori=0.6, alpha=0.001, power=0.8)
    effect = undetected_effects(a.r, alpha=0.001, power=0.8)
    for i in range(12):
        planted = np.zeros(12)
        planted[i] = nabla[i]
        dx = adjust(B, planted, q, unknowns=list("abcde")).x
        for _ in range(20):
            h = rng.normal(size=5)
            assert abs(h @ dx) <= effect[i] * 0.6 * np.sqrt(h @ a.q_xx @ h) * (1.0 + 1e-9)
        # the bound is reached along Q_xx^-1 dx
        h = np.linalg.solve(a.q_xx, dx)
        assert abs(h @ dx) == pytest.approx(effect[i] * 0.6 * np.sqrt(h @ a.q_xx @ h), rel=1e-8)


def test_detectable_error_moves_the_standardized_residual_by_delta0():
    rng = np.random.default_rng(3)
    B, q = rng.normal(size=(12, 5)), rng.uniform(0.5, 2.0, 12)
    clean = adjust(B, np.zeros(12), q, unknowns=list("abcde"))
    nabla = smallest_detectable_errors(clean.r, q, apriori=0.6, alpha=0.001, power=0.8)
    for i in range(12):
        planted = np.zeros(12)
        planted[i] = nabla[i]
        a = adjust(B, planted, q, unknowns=list("abcde"))
        s = standardize(a, kind="baarda", alpha=0.001, apriori=0.6)
        assert s.ratio[i] == pytest.approx(4.132, abs=5e-4)


def test_transfers_by_definition():
    for seed in range(10):
        a = sample(seed, 9, 5)
        influence = a.q_vv @ np.diag(1.0 / a.q_l)
        expected = [
            (i, j)
            for i in range(9)
            for j in range(9)
            if i != j and abs(influence[j, i]) >= influence[i, i] - 1e-9
        ]
        found = critical_transfers(a.q_vv / a.q_l)
        assert [(i, j) for i, j, _ in found] == expected
        for i, j, value in found:
            assert value == pytest.approx(influence[j, i])


def test_correlations_are_symmetric_with_unit_diagonal():
    a = sample()
    rho = residual_correlations(a.q_vv, a.r)
    assert np.diag(rho) == pytest.approx(np.ones(12))
    assert rho == pytest.approx(rho.T)
    assert np.abs(rho).max() <= 1.0 + 1e-12


def brute_factor_known(w, g):
    """Integral of the likelihood of w over the error's prior, divided by that without error."""
    width = np.sqrt(g)
    value, _ = integrate.quad(
        lambda d: stats.norm.pdf(w, loc=d) * stats.norm.pdf(d, scale=width),
        -60.0,
        60.0,
        points=[0.0, w],
        limit=400,
        epsabs=0.0,
        epsrel=1e-10,
    )
    return value / stats.norm.pdf(w)


@pytest.mark.parametrize(("w", "r"), [(0.0, 0.1), (1.5, 0.02), (3.5, 0.08), (5.0, 0.1)])
def test_odds_with_known_sigma_against_integration_of_the_prior(w, r):
    odds = error_odds(np.array([r, 0.0]), np.array([w, np.nan]), 3, "baarda")
    factor = brute_factor_known(w, 400.0 * r)
    assert odds.rows[0] / odds.none == pytest.approx(factor * 0.05 / 0.9, rel=1e-6)


@pytest.mark.parametrize(("sigf", "r", "f"), [(1.0, 0.05, 4), (2.2, 0.3, 8), (3.0, 0.6, 12)])
def test_odds_with_estimated_sigma_against_integration_of_the_prior(sigf, r, f):
    """Error of 20 sigma in units of the unknown sigma, sigma with the prior 1 / sigma."""
    g = 400.0 * r
    ss, along = float(f), sigf**2  # v'Pv and its part along the suspected row, sigma0_hat = 1

    def likelihood(with_error):
        def integrand(log_sigma):
            s2 = np.exp(2.0 * log_sigma)
            # given sigma the row's part has variance (1 + g) sigma^2 under an error
            rest = np.exp(-0.5 * (ss - along) / s2) * s2 ** (-0.5 * (f - 1))
            spread = s2 * (1.0 + g) if with_error else s2
            return rest * np.exp(-0.5 * along / spread) / np.sqrt(spread)

        return integrate.quad(integrand, -8.0, 8.0, limit=400, epsabs=0.0, epsrel=1e-10)[0]

    odds = error_odds(np.array([r, 0.0]), np.array([sigf, np.nan]), f, "tau")
    factor = likelihood(True) / likelihood(False)
    assert odds.rows[0] / odds.none == pytest.approx(factor * 0.05 / 0.9, rel=1e-5)


@given(
    st.lists(st.tuples(st.floats(1e-8, 0.999), st.floats(0.0, 60.0)), min_size=1, max_size=30),
    st.integers(1, 40),
    st.sampled_from(["tau", "baarda"]),
)
def test_probabilities_sum_to_one(rows, f, kind):
    r, w = np.array(rows).T
    odds = error_odds(r, np.minimum(w, np.sqrt(f)) if kind == "tau" else w, f, kind)
    assert odds.rows.sum() + odds.none == pytest.approx(1.0)
    assert (odds.rows >= 0.0).all()


def test_larger_residual_larger_probability():
    odds = error_odds(np.full(4, 0.5), np.array([0.5, 1.0, 4.0, 3.0]), 6, "baarda")
    assert np.argsort(odds.rows).tolist() == [0, 1, 3, 2]
    assert odds.rows[2] > odds.none


def test_table_2_of_the_paper_obeys_expd_and_sigf():
    """EXPD = sigma0_hat sqrt(2 r), SIGF = |PARX| / EXPD, from the printed r and parallaxes."""
    r = np.array([0.09, 0.77, 0.07, 0.32, 0.40, 0.23])
    parallax = np.array([6.6, -20.7, 6.6, -2.6, 11.8, -2.0])
    printed = np.array([1.38, 1.44, 1.51, 0.27, 1.14, 0.25])
    table = Adjustment(
        unknowns=(),
        x=np.zeros(0),
        w=parallax,
        q_l=np.full(6, 2.0),
        q_xx=np.zeros((0, 0)),
        q_vv=np.diag(2.0 * r),
        r=r,
        vtpv=float(parallax @ parallax / 2.0),
        redundancy=3,  # 6 + 3 rows, 6 unknowns; the three x parallaxes are not printed
        condition=1.0,
    )
    sigma = 20.7 / (1.44 * np.sqrt(2.0 * 0.77))
    s = standardize(table, kind="baarda", alpha=0.001, apriori=sigma)
    # r is printed with two digits: up to half a unit of its last one, 4 percent of sqrt(0.07)
    assert s.ratio == pytest.approx(printed, rel=0.045, abs=0.006)


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_odds_are_right_as_often_as_they_say(kind) -> None:
    rng = np.random.default_rng(20)
    n, u, runs = 11, 6, 6000
    design = rng.normal(size=(n, u))
    q_l = np.where(np.arange(n) < 7, 2.0, 1.0)
    white = design / np.sqrt(q_l)[:, None]
    residual = np.eye(n) - white @ np.linalg.inv(white.T @ white) @ white.T
    r = np.diag(residual).copy()
    wrong = rng.integers(n, size=runs)
    wrong[rng.random(runs) < 0.9] = -1
    noise = 3.7 * rng.normal(size=(runs, n))
    noise[wrong >= 0, wrong[wrong >= 0]] += 3.7 * 20.0 * rng.normal(size=int((wrong >= 0).sum()))
    v = noise @ residual
    sigma = 3.7 if kind == "baarda" else np.sqrt((v * v).sum(axis=1, keepdims=True) / (n - u))
    ratio = np.abs(v) / (sigma * np.sqrt(r))
    claimed, truth, pairs, firsts = [], [], [], []
    for k in range(runs):
        odds = error_odds(r, ratio[k], n - u, kind)
        claimed.append([*odds.rows.tolist(), odds.none])
        truth.append([*(wrong[k] == np.arange(n)).tolist(), wrong[k] < 0])
        second, first = np.argsort(odds.rows)[-2:].tolist()
        if wrong[k] in (first, second):
            pairs.append(odds.rows[first] / (odds.rows[first] + odds.rows[second]))
            firsts.append(wrong[k] == first)
    p, hit = np.array(claimed), np.array(truth)
    # what is chosen by the data alone is right as often as it says: 3.3 deviations
    best = np.arange(runs), np.argmax(p[:, :n], axis=1)
    for some in (p[:, n] < 0.5, p[best] > 0.5, p[best] < 0.3):
        mine = p[best][some]
        assert len(mine) > 100
        room = 3.3 * np.sqrt(np.sum(mine * (1.0 - mine)))
        assert abs(np.sum(hit[best][some] - mine)) < room
    none = p[:, n]
    assert abs(np.sum(hit[:, n] - none)) < 3.3 * np.sqrt(np.sum(none * (1.0 - none)))
    said, right = np.array(pairs), np.array(firsts)
    assert abs(np.sum(right - said)) < 3.3 * np.sqrt(np.sum(said * (1.0 - said)))
