"""Critical values and powers against scipy.stats."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, special, stats

from anaplot.adjustment import significance
from anaplot.adjustment.significance import (
    critical_normal,
    critical_tau,
    noncentral_f_power,
    noncentrality,
    normal_power,
    tau_power,
)


def test_the_values_of_the_conventions():
    assert critical_normal(0.001) == pytest.approx(3.29, abs=0.002)
    assert noncentrality(0.001, 0.80) == pytest.approx(4.132, abs=0.0005)


@given(st.floats(1e-6, 0.5), st.integers(2, 500))
def test_tau_critical_value_by_the_formula_with_student_t(alpha, f):
    t = stats.t.isf(alpha / 2.0, f - 1)
    expected = t * np.sqrt(f) / np.sqrt(f - 1 + t * t)
    assert critical_tau(alpha, f) == pytest.approx(expected, rel=1e-9)
    assert critical_tau(alpha, f) < np.sqrt(f)
    assert critical_normal(alpha) == pytest.approx(stats.norm.isf(alpha / 2.0), rel=1e-9)


@pytest.mark.parametrize("f", [-1, 0, 1])
def test_tau_has_no_critical_value_below_two_redundancies(f):
    assert critical_tau(0.001, f) is None
    assert tau_power(4.0, 0.001, f) is None


def test_tau_tends_to_the_normal_distribution():
    assert critical_tau(0.001, 10**7) == pytest.approx(critical_normal(0.001), abs=1e-5)


@given(st.floats(1e-4, 0.1), st.floats(0.2, 0.99))
def test_noncentrality_gives_the_power_asked_for(alpha, power):
    delta = noncentrality(alpha, power)
    k = stats.norm.isf(alpha / 2.0)
    assert stats.norm.sf(k - delta) + stats.norm.cdf(-k - delta) == pytest.approx(power, rel=1e-9)
    assert normal_power(delta, alpha) == pytest.approx(power, rel=1e-9)


@pytest.mark.parametrize("power", [0.0005, 0.001, 1.0])
def test_noncentrality_refuses_impossible_powers(power):
    with pytest.raises(ValueError, match="between alpha"):
        noncentrality(0.001, power)


@pytest.mark.parametrize("f", [2, 3, 5, 8, 12, 100])
def test_tau_power_is_that_of_the_noncentral_t(f):
    t = stats.t.isf(0.0005, f - 1)
    with np.errstate(divide="ignore"):  # on the way to the right value, with scipy before 1.12
        expected = stats.nct.sf(t, f - 1, 4.132) + stats.nct.cdf(-t, f - 1, 4.132)
    assert tau_power(4.132, 0.001, f) == pytest.approx(expected, rel=1e-8)
    assert tau_power(4.132, 0.001, f) < 0.80


def tau_power_over_the_tested_row(delta, alpha, f):
    """Integrate over the error of the tested row, piece by piece between the bends."""
    t, n = stats.t.isf(alpha / 2.0, f - 1), f - 1
    ends = np.unique(np.clip([-delta, t - delta, -t - delta, *np.linspace(-9, 9, 19)], -9, 9))
    share = 0.0
    for low, high in pairwise(ends):
        share += integrate.quad(
            lambda z: stats.norm.pdf(z) * special.chdtr(n, n * ((z + delta) / t) ** 2), low, high
        )[0]
    return share


def test_tau_power_where_the_noncentral_t_has_none():
    delta = noncentrality(0.001, 0.995)
    # scipy.special.nctdtr is not a number here
    assert tau_power(delta, 0.001, 12) == pytest.approx(
        tau_power_over_the_tested_row(delta, 0.001, 12), abs=1e-8
    )


@pytest.mark.slow
@pytest.mark.parametrize("f", [2, 3, 4, 5, 8, 12, 30, 100, 500])
def test_tau_power_is_finite_and_grows_with_the_error(f):
    for alpha in (1e-5, 0.001, 0.05):
        before = 0.0
        for delta in range(61):
            power = tau_power(float(delta), alpha, f)
            assert before - 1e-12 <= power <= 1.0
            before = power
        for delta in (0.0, 0.7, 2.0, 4.1, 6.7, 11.0, 17.0, 30.0, 60.0):
            expected = tau_power_over_the_tested_row(delta, alpha, f)
            assert tau_power(delta, alpha, f) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("dimension", [1, 3])
@pytest.mark.parametrize("redundancy", [None, 8])
def test_the_power_of_very_large_errors_goes_on_where_the_sum_ends(
    dimension, redundancy, monkeypatch
):
    size = 1.5 * significance._LARGE
    limits = [factor * size / dimension for factor in (0.998, 1.0, 1.002)]
    found = [noncentral_f_power(size, limit, dimension, redundancy) for limit in limits]
    monkeypatch.setattr(significance, "_LARGE", np.inf)
    summed = [noncentral_f_power(size, limit, dimension, redundancy) for limit in limits]
    assert 0.05 < found[2] < found[0] < 0.95
    assert found == pytest.approx(summed, abs=1e-6)


def test_tau_power_by_simulation():
    rng = np.random.default_rng(1983)
    f, alpha, delta = 8, 0.01, 3.5
    e = rng.normal(size=(40000, f))
    e[:, 0] += delta  # a direction of the residual space that holds the error
    tau = np.abs(e[:, 0]) / np.sqrt((e**2).sum(axis=1) / f)
    share = float(np.mean(tau > critical_tau(alpha, f)))
    assert share == pytest.approx(tau_power(delta, alpha, f), abs=0.01)
