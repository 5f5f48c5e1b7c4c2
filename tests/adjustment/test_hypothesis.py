"""The general linear hypothesis: against dense formulas, constrained adjustments, Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats
from scipy.special import fdtrc, fdtri, stdtrit

from anaplot.adjustment.hypothesis import (
    DependentConditionsError,
    bonferroni_alpha,
    critical_f,
    f_noncentrality,
    f_power,
    f_test,
    nearest_components,
    principal_components,
    quadratic_form,
    removable,
    scheffe_factor,
    sequential_components,
    sidak_alpha,
    variance_inflation,
)


@pytest.mark.slow
@pytest.mark.parametrize(("b", "r"), [(57, 5), (100, 10), (3000, 10), (1, 5)])
def test_a_vanishing_significance_keeps_its_limit_and_power(b, r) -> None:
    critical = critical_f(1e-300, b, r)
    assert fdtrc(b, r, critical) == pytest.approx(1e-300, rel=1e-6)
    size = f_noncentrality(1e-300, 0.8, b, r)
    assert size > b * critical
    assert f_power(size, 1e-300, b, r) == pytest.approx(0.8, abs=1e-6)


def test_a_significance_beyond_all_numbers_is_refused() -> None:
    for alpha in (1e-200, 1e-300):
        with pytest.raises(ValueError, match="too small"):
            critical_f(alpha, 1, 1)


def line(seed: int = 1, n: int = 30, u: int = 5):
    """A correlated linear model of full rank: design and cofactors."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, u))
    a[:, 1] = a[:, 0] + 0.2 * a[:, 1]
    return a, np.linalg.inv(a.T @ a)


def adjusted(a, obs):
    x = np.linalg.lstsq(a, obs, rcond=None)[0]
    return x, float(np.sum((a @ x - obs) ** 2))


def constrained(a, obs, b, w):
    """v'Pv with B x = w, by the bordered normal equations."""
    u, k = a.shape[1], len(b)
    full = np.block([[a.T @ a, b.T], [b, np.zeros((k, k))]])
    x = np.linalg.solve(full, np.concatenate((a.T @ obs, w)))[:u]
    return float(np.sum((a @ x - obs) ** 2))


def test_the_quadratic_form_is_what_the_constraint_costs() -> None:
    a, q = line()
    rng = np.random.default_rng(2)
    obs = rng.normal(size=len(a))
    b, w = rng.normal(size=(3, 5)), rng.normal(size=3)
    x, omega = adjusted(a, obs)
    square = quadratic_form(b @ x - w, b @ q @ b.T)
    assert square == pytest.approx(constrained(a, obs, b, w) - omega, rel=1e-10)


def test_critical_values() -> None:
    assert critical_f(0.001, 1) == pytest.approx(3.2905267**2, rel=1e-7)
    # b = 1 is Student's t, squared
    assert critical_f(0.05, 1, 17) == pytest.approx(float(stdtrit(17, 0.975)) ** 2, rel=1e-10)
    assert critical_f(0.05, 12, 39) == pytest.approx(float(fdtri(12, 39, 0.95)), rel=1e-10)
    # many redundancies: sigma0 is as good as known
    assert critical_f(0.01, 4, 10_000_000) == pytest.approx(critical_f(0.01, 4), rel=1e-5)
    # a small significance is not lost
    assert critical_f(1e-20, 3, 50) > critical_f(1e-15, 3, 50) > critical_f(1e-10, 3, 50)


def test_the_noncentrality_of_the_paper() -> None:
    assert f_noncentrality(0.001, 0.80, 1) == pytest.approx(17.0746, abs=1e-4)
    # eq. (33) and (38) carry the factor 1/2
    deviation, q = np.array([1.0, -2.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
    paper = 0.5 * deviation @ np.linalg.inv(q) @ deviation
    assert quadratic_form(deviation, q) == pytest.approx(2.0 * paper)


@pytest.mark.slow
@given(
    alpha=st.floats(1e-6, 0.2),
    power=st.floats(0.3, 0.999),
    dimension=st.integers(1, 60),
    redundancy=st.none() | st.integers(1, 2000),
)
@settings(max_examples=40)
def test_power_and_noncentrality_go_round(alpha, power, dimension, redundancy) -> None:
    size = f_noncentrality(alpha, power, dimension, redundancy)
    assert f_power(size, alpha, dimension, redundancy) == pytest.approx(power, abs=1e-6)
    # more redundancy never needs a larger error
    assert f_noncentrality(alpha, power, dimension) <= size * (1 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("redundancy", [None, 7])
def test_size_and_power_by_monte_carlo(redundancy) -> None:
    n, u = (12, 5) if redundancy else (40, 5)
    a, q = line(3, n, u)
    b = np.eye(u)[2:]
    alpha, runs = 0.05, 20_000
    rng = np.random.default_rng(20)
    project = np.eye(n) - a @ q @ a.T
    away = np.array([0.3, -0.4, 0.5])
    for deviation in (np.zeros(3), away):
        truth = np.concatenate((np.zeros(2), deviation))
        obs = rng.normal(size=(runs, n)) * 1.0 + a @ truth
        x = obs @ a @ q
        inverse = np.linalg.inv(b @ q @ b.T)
        square = np.einsum("ri,ij,rj->r", x @ b.T, inverse, x @ b.T)
        sigma = np.ones(runs)
        if redundancy:
            sigma = np.sqrt(np.einsum("ri,ij,rj->r", obs, project, obs) / redundancy)
        rate = np.mean(square / (3 * sigma**2) > critical_f(alpha, 3, redundancy))
        wanted = f_power(quadratic_form(deviation, b @ q @ b.T), alpha, 3, redundancy)
        assert abs(rate - wanted) < 4.0 * np.sqrt(wanted * (1 - wanted) / runs)
        one = f_test(float(square[0]), 3, alpha=alpha, sigma=float(sigma[0]), redundancy=redundancy)
        assert one.rejected == (one.significance < alpha)
        assert one.statistic == pytest.approx(square[0] / (3 * sigma[0] ** 2))


def test_significance_matches_the_critical_value() -> None:
    for redundancy, sigma in ((None, 1.0), (9, 1.3)):
        limit = critical_f(0.02, 4, redundancy) * 4 * sigma**2
        found = f_test(limit, 4, alpha=0.02, sigma=sigma, redundancy=redundancy)
        assert found.significance == pytest.approx(0.02, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dimension", "redundancy"), [(1, 4), (1, 11), (2, 12), (6, 400), (5, None)]
)
def test_the_power_exists_at_every_noncentrality(dimension, redundancy) -> None:
    # scipy.special.ncfdtr is not a number at some of these
    for alpha in (0.05, 0.001, 1e-6):
        before = 0.0
        for size in [0.5, 20.0, 300.0, *np.linspace(1500.0, 4000.0, 251), 1e5, 0.99e6, 1.01e6]:
            power = f_power(float(size), alpha, dimension, redundancy)
            assert before - 1e-9 <= power <= 1.0
            before = power
        assert before == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("size", [3.0, 40.0, 700.0, 2500.0])
@pytest.mark.parametrize(("dimension", "redundancy"), [(1, 3), (3, 7), (6, 40)])
def test_the_power_is_the_mean_over_the_variance_factor(dimension, redundancy, size) -> None:
    limit = critical_f(1e-4, dimension, redundancy) * dimension / redundancy
    expected = integrate.quad(
        lambda u: stats.chi2.pdf(u, redundancy) * stats.ncx2.sf(limit * u, dimension, size),
        0.0,
        40.0 * redundancy,
        points=np.linspace(0.1, 4.0, 30) * redundancy,
        limit=200,
    )[0]
    assert f_power(size, 1e-4, dimension, redundancy) == pytest.approx(expected, abs=1e-8)


def test_power_of_huge_alternatives() -> None:
    # one redundancy and a tiny significance need an error beyond the series of ncfdtr
    size = f_noncentrality(1e-6, 0.5, 1, 1)
    assert size > 1e9
    # sqrt(lambda) / abs(normal) > sqrt(critical) in half of the cases
    assert size == pytest.approx(critical_f(1e-6, 1, 1) * 0.6744898**2, rel=1e-6)
    for b, r in ((1, 3), (12, 40), (60, 90)):
        alpha = float(fdtrc(b, r, 1.02e6 / b))
        assert alpha > 0.0
        step = f_power(1.000001e6, alpha, b, r) - f_power(0.999999e6, alpha, b, r)
        assert 0.0 <= step < 1e-4
    assert f_power(1e12, 0.05, 3, 20) == 1.0


def test_sequential_components_are_constrained_adjustments() -> None:
    a, q = line()
    rng = np.random.default_rng(5)
    obs = rng.normal(size=len(a))
    x, omega = adjusted(a, obs)
    parts = sequential_components(x, q)
    assert sorted(p.member for p in parts) == list(range(5))
    # the two that are nearly the same are taken apart first
    assert parts[0].member in {0, 1}
    assert parts[0].variance == pytest.approx(1.0)
    held: list[int] = []
    before = omega
    for part in parts:
        held.append(part.member)
        after = constrained(a, obs, np.eye(5)[held], np.zeros(len(held)))
        assert part.value**2 == pytest.approx(after - before, rel=1e-8, abs=1e-10)
        before = after
    # the order does not look at the data
    assert [p.member for p in sequential_components(-3.0 * x[::1] + 1.0, q)] == [
        p.member for p in parts
    ]


@pytest.mark.parametrize("seed", range(8))
def test_the_order_of_a_set_is_that_of_the_largest_inflation_and_of_equals_the_first(seed) -> None:
    a = np.random.default_rng(seed).normal(size=(15, 7))
    q = np.linalg.inv(a.T @ a)
    left, wanted = list(range(7)), []
    while left:
        # the earlier ones held: their rows and columns leave the inverse
        held = np.linalg.inv(np.linalg.inv(q)[np.ix_(left, left)])
        inflation = variance_inflation(held)
        wanted.append(left.pop(int(np.argmax(inflation > inflation.max() * (1.0 - 1e-6)))))
    assert [p.member for p in sequential_components(np.ones(7), q)] == wanted


@pytest.mark.parametrize("seed", range(12))
def test_a_component_has_nothing_of_the_parameters_that_are_free(seed) -> None:
    a = np.random.default_rng(seed).normal(size=(20, 8))
    a[:, 3] = a[:, 0] + 1e-3 * a[:, 3]  # badly separated: a row would be exchanged for another
    parts = sequential_components(np.ones(8), np.linalg.inv(a.T @ a))
    loadings = np.array([p.loadings for p in parts])[:, [p.member for p in parts]]
    # exactly: nothing but rounding could be there
    assert (loadings[np.triu_indices(8, 1)] == 0.0).all()
    assert (np.diag(loadings) > 0.0).all()


@pytest.mark.parametrize("take_apart", [sequential_components, principal_components])
def test_components_are_independent_and_add_up(take_apart) -> None:
    _, q = line(7)
    x = np.random.default_rng(8).normal(size=5)
    parts = take_apart(x, q)
    assert sum(p.value**2 for p in parts) == pytest.approx(quadratic_form(x, q))
    scale = np.sqrt(np.diag(q))
    rho = q / scale[:, None] / scale
    loadings = np.array([p.loadings for p in parts])
    np.testing.assert_allclose(loadings @ rho @ loadings.T, np.eye(5), atol=1e-9)
    np.testing.assert_allclose(loadings @ (x / scale), [p.value for p in parts])


def test_nearest_components_are_independent_and_nearest() -> None:
    _, q = line(7)
    x = np.random.default_rng(8).normal(size=5)
    scale = np.sqrt(np.diag(q))
    rho = q / scale[:, None] / scale
    loadings = np.array([nearest_components(row, q)[0] for row in np.diag(scale)]).T
    values, alike = nearest_components(x, q)
    np.testing.assert_allclose(loadings @ (x / scale), values)
    np.testing.assert_allclose(loadings @ rho @ loadings.T, np.eye(5), atol=1e-9)
    np.testing.assert_allclose(loadings, loadings.T, atol=1e-9)  # no member comes before another
    np.testing.assert_allclose(alike, np.diag(loadings @ rho))
    assert np.sum(values**2) == pytest.approx(quadratic_form(x, q))
    # the others that are independent, turned by any rotation, are less like the members
    turn = np.linalg.qr(np.random.default_rng(9).normal(size=(5, 5)))[0]
    assert np.trace(turn @ loadings @ rho) < np.sum(alike)
    # what is correlated with nothing stands for itself
    np.testing.assert_allclose(nearest_components(x, np.eye(5)), (x, np.ones(5)))
    with pytest.raises(DependentConditionsError):
        nearest_components(np.ones(2), np.ones((2, 2)))


def test_components_of_a_family_keep_their_size() -> None:
    _, q = line(7)
    runs, alpha = 4000, 0.05
    root = np.linalg.cholesky(q)
    z = np.random.default_rng(9).normal(size=(runs, 5)) @ root.T
    scale = np.sqrt(np.diag(q))
    loadings = np.array([p.loadings for p in sequential_components(z[0], q)])
    single = sidak_alpha(alpha, 5)
    values = (z / scale) @ loadings.T
    rate = np.mean((values**2 > critical_f(single, 1)).any(axis=1))
    assert abs(rate - alpha) < 4.0 * np.sqrt(alpha * (1 - alpha) / runs)


def test_removing_parameters_keeps_the_significance() -> None:
    _, q = line(7)
    runs, alpha = 1500, 0.10
    root = np.linalg.cholesky(q)
    rng = np.random.default_rng(10)
    kept = 0
    for z in rng.normal(size=(runs, 5)) @ root.T:
        steps = removable(z, q, alpha=alpha, sigma=1.0, redundancy=None)
        kept += len(steps) < 5
    assert abs(kept / runs - alpha) < 4.0 * np.sqrt(alpha * (1 - alpha) / runs)
    # one large parameter stays and the others go
    x = np.zeros(5)
    x[3] = 40.0 * np.sqrt(q[3, 3])
    steps = removable(x, q, alpha=alpha, sigma=1.0, redundancy=20)
    assert 3 not in {s.member for s in steps}
    rest = [s.member for s in steps]
    assert steps[-1].square == pytest.approx(quadratic_form(x[rest], q[np.ix_(rest, rest)]))


def test_variance_inflation() -> None:
    _, q = line()
    np.testing.assert_allclose(variance_inflation(q), np.diag(q) * np.diag(np.linalg.inv(q)))
    np.testing.assert_allclose(variance_inflation(np.diag([1.0, 1e-12])), 1.0)


def test_significances_of_several_tests() -> None:
    assert sidak_alpha(0.05, 1) == pytest.approx(0.05)
    assert (1 - sidak_alpha(0.05, 12)) ** 12 == pytest.approx(0.95)
    assert sidak_alpha(1e-18, 10) == pytest.approx(1e-19)
    assert bonferroni_alpha(0.05, 12) < sidak_alpha(0.05, 12)
    assert scheffe_factor(0.05, 1) == pytest.approx(1.95996, abs=1e-5)


def test_what_is_no_hypothesis() -> None:
    with pytest.raises(DependentConditionsError, match="full rank"):
        quadratic_form(np.ones(2), np.ones((2, 2)))
    with pytest.raises(DependentConditionsError, match="full rank"):
        quadratic_form(np.ones(2), np.diag([1.0, 0.0]))
    with pytest.raises(ValueError, match="square") as caught:
        quadratic_form(np.ones(2), np.ones((2, 3)))
    # what calls it goes on without dependent conditions, never with wrong shapes
    assert not isinstance(caught.value, DependentConditionsError)
    with pytest.raises(ValueError, match="between 0 and 1"):
        critical_f(0.0, 1)
    with pytest.raises(ValueError, match="at least one"):
        critical_f(0.05, 0)
    with pytest.raises(ValueError, match="redundancy"):
        critical_f(0.05, 1, 0)
    with pytest.raises(ValueError, match="power"):
        f_noncentrality(0.05, 0.04, 1)
    with pytest.raises(ValueError, match="noncentrality"):
        f_power(-1.0, 0.05, 1)
    for square in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="quadratic form"):
            f_test(square, 1, alpha=0.05)
    with pytest.raises(ValueError, match="positive"):
        f_test(1.0, 1, alpha=0.05, sigma=0.0, redundancy=4)
    with pytest.raises(ValueError, match="redundancy"):
        f_test(1.0, 1, alpha=0.05, sigma=1.2)
