"""Variance components from sums per group."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from anaplot.adjustment.variancecomponents import (
    GroupSums,
    VarianceComponent,
    estimate_components,
)
from anaplot.errors import InputError


def linear(a, observed, group, k):
    """Return a callback that adjusts a dense linear model with variances per group."""

    def readjust(factors):
        p = 1.0 / factors[group]
        q = np.linalg.inv(a.T @ (p[:, None] * a))
        v = a @ (q @ (a.T @ (p * observed))) - observed
        r = 1.0 - np.einsum("ij,jk,ik->i", a, q, a) * p
        return GroupSums(
            np.bincount(group, weights=p * v * v, minlength=k),
            np.bincount(group, weights=r, minlength=k),
        )

    return readjust


def test_a_common_factor_is_one_step():
    rng = np.random.default_rng(1)
    a = rng.normal(size=(20, 4))
    group = np.zeros(20, dtype=int)
    found = estimate_components(["all"], [20], linear(a, rng.normal(size=20), group, 1))
    readjusted = linear(a, rng.normal(size=20), group, 1)(np.ones(1))
    assert readjusted.redundancy[0] == pytest.approx(16.0)
    assert found.converged
    assert found.iterations == 2
    assert found.components[0].redundancy == pytest.approx(16.0)
    assert found.components[0].vtpv == pytest.approx(16.0)


@pytest.mark.slow
def test_factors_that_made_the_noise_come_back_on_average():
    rng = np.random.default_rng(2)
    group = np.repeat([0, 1, 2], [60, 40, 30])
    truth = np.array([1.0, 4.0, 0.25])
    a = rng.normal(size=(130, 20))
    found, stated = [], []
    for _ in range(120):
        observed = rng.normal(size=130) * np.sqrt(truth[group])
        result = estimate_components("abc", [60, 40, 30], linear(a, observed, group, 3))
        assert result.converged
        assert sum(c.redundancy for c in result.components) == pytest.approx(110.0)
        found.append(result.factors)
        stated.append([c.deviation for c in result.components])
    mean, error = np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(len(found))
    assert (np.abs(mean - truth) < 4.0 * error).all()
    # the stated deviation is about the one that is seen
    ratio = np.mean(stated, axis=0) / np.std(found, axis=0)
    assert (np.abs(ratio - 1.0) < 0.3).all()


def test_the_fixed_point_solves_helmerts_equations():
    rng = np.random.default_rng(3)
    group = np.repeat([0, 1], [25, 25])
    a = rng.normal(size=(50, 6))
    observed = rng.normal(size=50) * np.where(group, 3.0, 1.0)
    found = estimate_components("ab", [25, 25], linear(a, observed, group, 2), tolerance=1e-10)
    p = 1.0 / found.factors[group]
    q_vv = np.diag(1.0 / p) - a @ np.linalg.inv(a.T @ (p[:, None] * a)) @ a.T
    v = q_vv @ (p * observed)
    redundant = q_vv * p
    traces = np.array(
        [
            [np.trace(redundant[np.ix_(group == g, group == h)]
                      @ redundant[np.ix_(group == h, group == g)]) for h in (0, 1)]
            for g in (0, 1)
        ]
    )  # fmt: skip
    vtpv = np.bincount(group, weights=p * v * v)
    # Helmert's equations, solved once more, change nothing
    np.testing.assert_allclose(np.linalg.solve(traces, vtpv), [1.0, 1.0], rtol=1e-6)


def helmert_traces(a, factors, group):
    """Dense tr(Q_vv P_g Q_vv P_h)."""
    p = 1.0 / factors[group]
    redundant = np.eye(len(p)) - a @ np.linalg.inv(a.T @ (p[:, None] * a)) @ a.T * p
    k = len(factors)
    return np.array(
        [[np.sum(redundant[np.ix_(group == g, group == h)]
                 * redundant[np.ix_(group == h, group == g)].T) for h in range(k)]
         for g in range(k)]
    )  # fmt: skip


def test_deviations_are_those_of_helmerts_equations():
    rng = np.random.default_rng(8)
    group = np.repeat([0, 1, 2], [14, 12, 10])
    a = rng.normal(size=(36, 16))
    observed = rng.normal(size=36) * np.array([1.0, 2.0, 0.5])[group]
    found = estimate_components("abc", [14, 12, 10], linear(a, observed, group, 3))
    assert all(c.state == "estimated" for c in found.components)
    traces = helmert_traces(a, found.factors, group)
    expected = found.factors * np.sqrt(2.0 * np.diag(np.linalg.inv(traces)))
    np.testing.assert_allclose([c.deviation for c in found.components], expected, rtol=1e-4)
    # what the redundancies alone would promise is too good
    r = np.array([c.redundancy for c in found.components])
    ratio = expected / (found.factors * np.sqrt(2.0 / r))
    assert (ratio > 1.0).all()
    assert ratio.max() > 1.4
    # two directions of three are enough: the last follows from their sum
    asked = []

    def count(factors):
        asked.append(factors)
        return linear(a, observed, group, 3)(factors).redundancy

    again = estimate_components(
        "abc", [14, 12, 10], linear(a, observed, group, 3), redundancies=count
    )
    assert len(asked) == 4
    assert [c.deviation for c in again.components] == [c.deviation for c in found.components]


def test_held_groups_take_no_part_in_the_deviations():
    rng = np.random.default_rng(9)
    a = np.zeros((41, 9))
    a[:40, :8] = rng.normal(size=(40, 8))
    a[40] = rng.normal(size=9)  # the only one that sees the last unknown
    group = np.repeat([0, 1, 2], [20, 20, 1])
    found = estimate_components(
        "abc", [20, 20, 1], linear(a, rng.normal(size=41), group, 3), tolerance=1e-10
    )
    assert found.components[2].state == "undetermined"
    traces = helmert_traces(a, found.factors, group)[:2, :2]
    expected = found.factors[:2] * np.sqrt(2.0 * np.diag(np.linalg.inv(traces)))
    np.testing.assert_allclose([c.deviation for c in found.components[:2]], expected, rtol=1e-5)


def test_groups_that_nothing_tells_apart_have_no_deviations():
    rng = np.random.default_rng(10)
    a = np.vstack((np.eye(8), np.eye(8)))  # pairs: only the sum of both variances shows
    group = np.repeat([0, 1], [8, 8])
    found = estimate_components("ab", [8, 8], linear(a, rng.normal(size=16), group, 2))
    assert [c.deviation for c in found.components] == [None, None]
    assert any("apart" in remark for remark in found.remarks())


def test_a_group_without_redundancy_is_held_and_named():
    rng = np.random.default_rng(5)
    a = np.zeros((21, 5))
    a[:20, :4] = rng.normal(size=(20, 4))
    a[20, 4] = 1.0  # nothing checks it
    group = np.repeat([0, 1], [20, 1])
    found = estimate_components(
        ["good", "lonely"], [20, 1], linear(a, rng.normal(size=21), group, 2)
    )
    assert found.converged
    assert found.components[1].state == "undetermined"
    assert found.components[1].factor == 1.0
    assert found.components[1].deviation is None
    assert "lonely" in found.remarks()[0]


def test_a_group_that_fits_exactly_vanishes_and_is_named():
    rng = np.random.default_rng(6)
    a = rng.normal(size=(40, 3))
    observed = np.concatenate((rng.normal(size=20), np.zeros(20)))  # the last 20 agree exactly
    group = np.repeat([0, 1], [20, 20])
    found = estimate_components(["rough", "exact"], [20, 20], linear(a, observed, group, 2))
    assert found.components[1].state == "vanishing"
    assert found.components[1].deviation is None
    assert found.components[0].state == "estimated"
    assert any(line.startswith("exact: ") for line in found.remarks())


def test_no_convergence_is_said():
    rng = np.random.default_rng(7)
    group = np.repeat([0, 1], [20, 20])
    a = rng.normal(size=(40, 6))
    found = estimate_components(
        "ab", [20, 20], linear(a, rng.normal(size=40) * 3.0, group, 2), most=1
    )
    assert not found.converged
    assert found.remarks() == ["no convergence after 1 adjustments"]


def test_groups_are_needed():
    with pytest.raises(InputError, match="groups"):
        estimate_components([], [], lambda f: GroupSums(f, f))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sizes", "unknowns", "truth"),
    [((6,), 3, (1.0,)), ((8, 8), 4, (1.0, 1.0)), ((6, 30), 4, (9.0, 1.0))],
)
def test_intervals_hold_the_truth_as_often_as_they_say(sizes, unknowns, truth):
    rng = np.random.default_rng(1979)
    group = np.repeat(np.arange(len(sizes)), sizes)
    a = rng.normal(size=(len(group), unknowns))
    runs, held, symmetric, intervals = 400, 0, 0, 0
    for _ in range(runs):
        observed = rng.normal(size=len(group)) * np.sqrt(np.array(truth)[group])
        found = estimate_components(
            "ab"[: len(sizes)], sizes, linear(a, observed, group, len(sizes))
        )
        for c, true in zip(found.components, truth, strict=True):
            if c.interval is None:
                assert c.deviation is None
                continue
            low, high = c.interval
            assert low < c.factor < high
            intervals += 1
            held += low < true < high
            symmetric += abs(c.factor - true) < 1.96 * c.deviation
    # 3.3 deviations of a binomial number; 0.01 for groups that are not quite one chi-square each
    room = 3.3 * np.sqrt(intervals * 0.95 * 0.05)
    assert abs(held - 0.95 * intervals) < room + 0.01 * intervals
    # what a standard deviation to both sides gives
    assert symmetric < 0.95 * intervals - room


def test_an_interval_of_one_group_is_that_of_chi_square():
    component = VarianceComponent("a", 12, 8.0, 8.0, 2.0, 2.0 * np.sqrt(2.0 / 8.0), "estimated")
    low, high = component.interval
    assert stats.chi2.sf(8.0 * 2.0 / low, 8) == pytest.approx(0.025)
    assert stats.chi2.cdf(8.0 * 2.0 / high, 8) == pytest.approx(0.025)
    assert replace(component, deviation=None).interval is None
    # nearly nothing is known: no end, and no number that would stand for it
    assert replace(component, deviation=2000.0).interval is None
