"""Strategies for gross errors: exact updates, planted errors, limits that must show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from anaplot.adjustment import strategies
from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.leastsquares import adjust
from anaplot.adjustment.leftout import ReducedSystem
from anaplot.adjustment.modelvalues import beyond_model
from anaplot.adjustment.partners import Proposals
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.reweighting import HUBER_LIMIT, reweight, weighted_misclosures
from anaplot.adjustment.search import search
from anaplot.adjustment.significance import critical_normal, critical_tau
from anaplot.adjustment.stepwise import bring_back, rule_of, step_by_step, stepwise
from anaplot.adjustment.strategies import STRATEGIES, find_gross_errors, pair_odds, sigma_of
from anaplot.adjustment.watch import Watch
from anaplot.errors import NotComputableError


def system_of(design: np.ndarray, misclosures: np.ndarray) -> DenseResiduals:
    n, u = design.shape
    unknowns = tuple(f"u{k}" for k in range(u))
    found = adjust(design, misclosures, np.ones(n), unknowns=unknowns)
    return DenseResiduals(
        tuple(range(n)), found.w, found.r, found.vtpv, found.redundancy, found.q_vv
    )


def random_system(seed: int, n: int = 40, u: int = 8, errors: dict[int, float] | None = None):
    rng = np.random.default_rng(seed)
    design, misclosures = rng.normal(size=(n, u)), rng.normal(size=n)
    for row, size in (errors or {}).items():
        misclosures[row] += size
    return design, misclosures, system_of(design, misclosures)


@given(st.integers(0, 10**6), st.permutations(range(14)), st.integers(1, 5))
def test_left_out_is_adjusted_anew(seed: int, order: list[int], k: int) -> None:
    design, misclosures, system = random_system(seed, 14, 4)
    state = Elimination(system)
    for row in order[:k]:
        state.add(row)
    keep = np.sort(order[k:])
    anew = system_of(design[keep], misclosures[keep])
    assert state.e[keep] == pytest.approx(anew.e, abs=1e-7)
    assert state.r[keep] == pytest.approx(anew.r, abs=1e-7)
    assert state.vtpv == pytest.approx(anew.vtpv, abs=1e-7)
    assert state.redundancy == anew.redundancy
    x = np.linalg.lstsq(design[keep], misclosures[keep], rcond=None)[0]
    error, sigma = state.estimates()
    out = order[:k]
    assert np.abs(error) == pytest.approx(np.abs(misclosures[out] - design[out] @ x), rel=1e-6)
    q = np.linalg.inv(design[keep].T @ design[keep])
    expected = 1.0 + np.einsum("ij,jk,ik->i", design[out], q, design[out])
    assert sigma**2 == pytest.approx(expected, rel=1e-6)


@given(st.integers(0, 10**6), st.permutations(range(12)))
def test_order_does_not_matter_and_drop_undoes(seed: int, order: list[int]) -> None:
    system = random_system(seed, 12, 4)[2]
    first, second = Elimination(system), Elimination(system)
    for row in order[:4]:
        first.add(row)
    for row in (order[3], order[1], order[5], order[0], order[2]):
        second.add(row)
    second.drop(order[5])
    assert second.e == pytest.approx(first.e, abs=1e-7)
    assert second.r == pytest.approx(first.r, abs=1e-7)
    second.swap(order[1], order[6])
    second.swap(order[6], order[1])
    assert second.e == pytest.approx(first.e, abs=1e-7)
    for row in order[:4]:
        second.drop(row)
    assert second.e == pytest.approx(system.e, abs=1e-12)
    assert second.rows == ()


@given(st.integers(0, 10**6), st.permutations(range(14)), st.integers(1, 5))
def test_rows_left_out_for_good_are_a_smaller_system(seed: int, order: list[int], k: int) -> None:
    design, misclosures, system = random_system(seed, 14, 4)
    left, keep = ReducedSystem(system, order[:k]), np.sort(order[k:])
    anew = system_of(design[keep], misclosures[keep])
    assert left.names == system.names
    assert left.redundancy == anew.redundancy
    assert left.vtpv == pytest.approx(anew.vtpv, abs=1e-7)
    assert left.e[keep] == pytest.approx(anew.e, abs=1e-7)
    assert left.r[keep] == pytest.approx(anew.r, abs=1e-7)
    columns = left.columns(keep)
    assert columns[keep] == pytest.approx(anew.matrix, abs=1e-6)
    assert columns[order[:k]] == pytest.approx(0.0, abs=1e-9)
    assert not left.r[order[:k]].any()


@given(st.integers(0, 10**6), st.permutations(range(14)), st.integers(1, 5))
def test_returns_are_those_of_rows_really_dropped(seed: int, order: list[int], k: int) -> None:
    state = Elimination(random_system(seed, 14, 4)[2])
    for row in order[:k]:
        state.add(row)
    returns = state.returns()
    for at, row in enumerate(order[:k]):
        other = state.copy()
        other.drop(row)
        assert returns.root[at] ** 2 == pytest.approx(other.vtpv - state.vtpv, abs=1e-7)
        w, r = state.given_back(returns.back[at], float(returns.root[at]))
        np.testing.assert_allclose(w, other.w, atol=1e-6)
        np.testing.assert_allclose(r, other.r, atol=1e-7)
        column = state.column(order[5]) + returns.back[at] * returns.back[at][order[5]]
        np.testing.assert_allclose(column, other.column(order[5]), atol=1e-7)


@given(st.integers(0, 10**6))
def test_weights_from_columns_are_those_of_a_new_adjustment(seed: int) -> None:
    design, misclosures, system = random_system(seed, 15, 4)
    rng = np.random.default_rng(seed)
    weights = np.where(rng.random(15) < 0.5, 1.0, rng.uniform(0.001, 1.0, 15))
    x = np.linalg.solve(design.T @ (weights[:, None] * design), design.T @ (weights * misclosures))
    sign = np.sign(
        system.e[0]
        * (misclosures - design @ np.linalg.lstsq(design, misclosures, rcond=None)[0])[0]
    )
    found = weighted_misclosures(system, weights)
    assert sign * found == pytest.approx(misclosures - design @ x, abs=1e-7)


def test_steps_that_nobody_asks_for_are_not_done() -> None:
    planted = {3: 60.0, 17: 45.0, 30: -30.0}
    system, suspects = random_system(4, errors=planted)[2], np.ones(40, dtype=bool)
    rule = rule_of("baarda", 0.001)
    every, steps = stepwise(Elimination(system), rule, suspects, 20, Watch(), together=False)
    assert planted.keys() <= set(every.rows)
    state = Elimination(system)
    one_by_one = step_by_step(state, rule, suspects, 20, Watch(), together=False)
    assert next(one_by_one) == steps[0]
    assert state.rows == steps[0].rows
    assert [*one_by_one] == steps[1:]
    assert state.rows == every.rows


def test_what_is_rejected_was_taken_out_also_by_an_exchange() -> None:
    # the last step of this search exchanges a row for another
    rows = np.random.default_rng(8).choice(24, 6, replace=False).tolist()
    found = find_gross_errors(random_system(8, 24, 9, dict.fromkeys(rows, 15.0))[2], "search")
    *_, swap = found.steps
    assert swap.action == "swap"
    came, went = swap.rows
    assert came in found.rows
    assert went not in found.rows
    assert found.taken_out[-1] == came
    assert set(found.taken_out) == {*found.rows, went}


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_one_large_error_is_found_by_all(strategy: str) -> None:
    for seed in range(10):
        system = random_system(seed, errors={7: 30.0})[2]
        found = find_gross_errors(system, strategy, models=np.full(40, 0.9))
        assert 7 in found.rows
        planted = found.rejected[found.rows.index(7)]
        assert planted.error is not None
        assert planted.sigma is not None
        assert abs(abs(planted.error) - 30.0) < 5.0 * planted.sigma
        assert abs(found.at_end.w[7]) == pytest.approx(abs(planted.error) / planted.sigma)
        assert found.odds.rows[7] > 0.99


@pytest.mark.parametrize("strategy", ["baarda", "danish", "search"])
def test_three_errors_are_found(strategy: str) -> None:
    right = 0
    for seed in range(10):
        system = random_system(seed, errors={3: 20.0, 10: -18.0, 21: 22.0})[2]
        right += {3, 10, 21} <= set(find_gross_errors(system, strategy).rows)
    assert right == 10


@pytest.mark.slow
def test_search_is_never_worse_than_stepwise() -> None:
    cost = critical_normal(0.001) ** 2
    for seed in range(15):
        rng = np.random.default_rng(seed)
        rows = rng.choice(30, 7, replace=False).tolist()
        system = random_system(seed, 30, 10, dict.fromkeys(rows, 18.0))[2]
        score = [
            found.at_end.vtpv + cost * len(found.rows)
            for found in (find_gross_errors(system, name) for name in ("baarda", "search"))
        ]
        assert score[1] <= score[0] + 1e-6


def test_a_set_found_otherwise_begins_a_search_that_alone_finds_nothing() -> None:
    # two errors hide each other: neither is conspicuous, nor any other row
    system = random_system(1239, 9, 4, {1: 6.0, 4: -6.0})[2]
    critical, suspects = critical_normal(0.001), np.ones(9, dtype=bool)
    assert np.abs(Elimination(system).w).max() < critical
    best, steps = search(system, critical, suspects, 4, Watch(), (1, 4))
    assert set(best.rows) == {1, 4}
    assert best.vtpv + 2.0 * critical**2 < system.vtpv
    assert steps
    assert search(system, critical, suspects, 4, Watch())[0].rows == ()


def test_spur_row_cannot_be_tested_nor_left_out() -> None:
    rng = np.random.default_rng(2)
    design = rng.normal(size=(20, 4))
    design[:, 3] = 0.0
    design[5, 3] = 1.0  # the only row that sees the last unknown
    misclosures = rng.normal(size=20)
    misclosures[5] += 1000.0
    system = system_of(design, misclosures)
    for strategy in STRATEGIES:
        found = find_gross_errors(system, strategy, models=np.full(20, 0.9))
        assert found.untestable == (5,)
        assert 5 not in found.rows
        assert np.isnan(found.at_end.w[5])
    with pytest.raises(NotSeparableError):
        Elimination(system).add(5)


@pytest.mark.parametrize("strategy", ["baarda", "tau", "search"])
def test_inseparable_pair_is_named(strategy: str) -> None:
    rng = np.random.default_rng(3)
    design = rng.normal(size=(20, 4))
    design[:, 3] = 0.0
    design[[5, 9], 3] = 1.0  # these two check each other and nothing else does
    misclosures = rng.normal(size=20)
    misclosures[9] += 60.0
    found = find_gross_errors(system_of(design, misclosures), strategy)
    assert found.rows == (5,)  # of equal evidence the first
    (partner,) = found.hard_to_tell
    assert (partner.rejected, partner.kept) == (5, 9)
    assert abs(partner.correlation) == pytest.approx(1.0, abs=1e-9)


def test_tau_hides_many_equal_errors() -> None:
    """k equal well-separated errors give at most tau = sqrt(r / k)."""
    design = np.ones((60, 1))
    misclosures = np.zeros(60)
    misclosures[:12] = [1000.0, -1000.0] * 6
    system = system_of(design, misclosures)
    critical = critical_tau(0.001, 59)
    assert critical is not None
    assert critical > (59 / 12) ** 0.5
    assert find_gross_errors(system, "tau").rows == ()
    assert find_gross_errors(system, "rms").rows == ()
    for strategy in ("baarda", "search", "danish"):
        assert set(find_gross_errors(system, strategy).rows) == set(range(12))


def test_rejected_comes_back() -> None:
    came_back = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        rows = rng.choice(24, 6, replace=False).tolist()
        system = random_system(seed, 24, 9, dict.fromkeys(rows, 15.0))[2]
        found = find_gross_errors(system, "baarda")
        for step in found.steps:
            if step.action == "drop":
                came_back += 1
                assert step.statistic is not None
                assert step.critical is not None
                assert step.statistic < step.critical
    assert came_back > 0


@pytest.mark.parametrize("strategy", ["baarda", "tau"])
def test_size_of_a_single_test(strategy: str) -> None:
    """Under no error the share of rows beyond the critical value is alpha (4.5 sigma of it)."""
    rng = np.random.default_rng(11)
    design = rng.normal(size=(20, 5))
    alpha, runs = 0.01, 1500
    beyond = 0
    matrix = system_of(design, np.zeros(20)).matrix
    for _ in range(runs):
        e = matrix @ rng.normal(size=20)
        state = Elimination(
            DenseResiduals(tuple(range(20)), e, np.diag(matrix), float(e @ e), 15, matrix)
        )
        if strategy == "baarda":
            beyond += int((np.abs(state.w) > critical_normal(alpha)).sum())
        else:
            limit = critical_tau(alpha, 15)
            assert limit is not None
            beyond += int((np.abs(state.w) > limit * (state.vtpv / 15) ** 0.5).sum())
    sigma = (alpha * (1 - alpha) / (runs * 20)) ** 0.5
    assert abs(beyond / (runs * 20) - alpha) < 4.5 * sigma * 1.5  # rows are correlated


def test_modified_counts_what_it_decides_otherwise() -> None:
    system = random_system(5, errors={4: 12.0})[2]
    exact = find_gross_errors(system, "modified", models=np.full(40, np.nan))
    assert exact.rows == find_gross_errors(system, "baarda").rows
    assert exact.model_values is not None
    assert exact.model_values.decided == 0
    blind = find_gross_errors(system, "modified", models=np.zeros(40))
    assert blind.rows == ()
    assert blind.model_values is not None
    assert 4 in blind.model_values.wrongly_accepted
    with pytest.raises(ValueError, match="model values"):
        find_gross_errors(system, "modified")


@pytest.mark.parametrize("seed", range(6))
def test_rows_brought_back_together_are_those_brought_back_one_by_one(seed: int) -> None:
    _, _, system = random_system(seed, 40, 8, {3: 30.0, 11: -25.0})
    names = tuple((k // 2, "xy"[k % 2]) for k in range(40))
    # rows that show next to nothing of their errors come back with their measurement
    system = replace(system, names=names)
    state, single = Elimination(system), Elimination(system)
    for row in (3, 8, 9, 11, 14, 20, 21, 22, 30, 35):
        state.add(row)
        single.add(row)
    limit, told = critical_normal(0.001), list[str]()
    steps = bring_back(state, limit, Watch(lambda what, _: told.append(what)))
    for step in steps:
        error, sigma = single.estimates()
        size = dict(zip(single.rows, np.abs(error) / sigma, strict=True))
        unit = min(
            dict.fromkeys(Proposals(names).together(single).values()),
            key=lambda rows: max(size[k] for k in rows),
        )
        assert unit == step.rows
        assert step.statistic == pytest.approx(max(size[k] for k in unit), rel=1e-9)
        assert step.before == pytest.approx(single.vtpv, rel=1e-9)
        for row in unit:
            single.drop(row)
        assert step.after == pytest.approx(single.vtpv, rel=1e-9)
    assert len(steps) >= 6
    assert set(told) == {"bringing back"}
    error, sigma = single.estimates()
    assert (np.abs(error) / sigma >= limit).all()
    assert state.rows == single.rows
    for one, other in ((state.e, single.e), (state.r, single.r), (state.vtpv, single.vtpv)):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(state.triangle(), single.triangle(), rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(state.column(5), single.column(5), rtol=1e-9, atol=1e-10)


def test_suspects_and_most_are_kept() -> None:
    system = random_system(6, errors={1: 30.0, 2: 40.0, 3: 50.0})[2]
    suspects = np.ones(40, dtype=bool)
    suspects[3] = False
    for strategy in STRATEGIES:
        found = find_gross_errors(
            system, strategy, SearchSettings(most=1), models=np.full(40, 0.9), suspects=suspects
        )
        assert 3 not in found.rows
        assert len(found.rows) <= 1


@given(st.integers(0, 10**6), st.lists(st.integers(0, 23), min_size=1, max_size=60))
def test_coming_and_going_in_any_order_is_the_same_set(seed: int, rows: list[int]) -> None:
    """Every row named goes out, or comes back where it is out."""
    system = random_system(seed, 24, 4)[2]
    state = Elimination(system)
    for row in rows:
        if row in state.rows:
            state.drop(row)
        elif len(state.rows) < 10:
            state.add(row)
    once = Elimination(system)
    for row in sorted(state.rows):
        once.add(row)
    assert state.e == pytest.approx(once.e, abs=1e-7)
    assert state.r == pytest.approx(once.r, abs=1e-7)
    assert state.vtpv == pytest.approx(once.vtpv, abs=1e-7)
    inner = system.matrix[np.ix_(state.rows, state.rows)]
    assert state.triangle() @ state.triangle().T == pytest.approx(inner, abs=1e-9)
    found = dict(zip(state.rows, np.array(state.estimates()).T.tolist(), strict=True))
    for row, expected in zip(once.rows, np.array(once.estimates()).T.tolist(), strict=True):
        assert found[row] == pytest.approx(expected, abs=1e-6)


def test_a_row_that_cannot_go_instead_changes_nothing() -> None:
    matrix = np.eye(3) - np.full((3, 3), 1.0 / 3.0)
    e = np.array([1.0, 2.0, -3.0])
    state = Elimination(DenseResiduals((0, 1, 2), e, np.diag(matrix), 14.0, 2, matrix))
    state.add(0)
    state.add(1)
    with pytest.raises(NotSeparableError):
        state.swap(0, 1)
    assert state.rows == (1, 0)
    assert state.vtpv == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("method", ["huber", "danish"])
def test_weights_never_turn_against_most_of_the_rows(method: str) -> None:
    rng = np.random.default_rng(2)
    wild = {int(k): 1000.0 * rng.normal() for k in rng.choice(40, 25, replace=False)}
    system = random_system(4, errors=wild)[2]
    found = find_gross_errors(system, method)
    assert len(found.rows) == system.redundancy // 2
    assert any("there may be more errors" in remark for remark in found.remarks)


def test_pair_odds_name_the_pair_and_sum_to_one() -> None:
    system = random_system(8, errors={4: 14.0, 30: -15.0})[2]
    odds = pair_odds(system)
    assert {int(odds.rows[0]), int(odds.others[0])} == {4, 30}
    assert odds.probability[0] > 0.9
    assert odds.none + odds.single.sum() + odds.pairs == pytest.approx(1.0)
    assert odds.marginal[4] > 0.99


def test_pair_odds_of_unknown_sigma_are_those_of_all_sigmas_together() -> None:
    n, u = 9, 3
    design, misclosures, system = random_system(5, n, u, errors={2: 9.0, 6: -12.0})
    odds = pair_odds(system, kind="tau")
    null = np.linalg.svd(design)[0][:, u:]
    y, s = null.T @ misclosures, np.exp(np.linspace(-4.0, 7.0, 20001))

    def density(rows: list[int]) -> float:
        """Density of the residuals, summed over log sigma; errors of 20 true sigmas."""
        spread = np.eye(n - u) + 400.0 * null[rows].T @ null[rows]
        square = y @ np.linalg.solve(spread, y)
        weight = s ** -float(n - u) * np.exp(-0.5 * square / s**2)
        return float(weight.sum()) / np.sqrt(np.linalg.det(spread))

    pairs = [(a, b) for a in range(n) for b in range(a + 1, n)]
    none = density([])
    single = np.array([density([k]) for k in range(n)]) * 0.1 / n
    both = {pair: density(list(pair)) * 0.01 / len(pairs) for pair in pairs}
    total = none + single.sum() + sum(both.values())
    assert odds.none == pytest.approx(none / total, rel=1e-6)
    assert odds.single == pytest.approx(single / total, rel=1e-6)
    for a, b, p in zip(odds.rows.tolist(), odds.others.tolist(), odds.probability, strict=True):
        assert p == pytest.approx(both[a, b] / total, rel=1e-6)
    assert (odds.rows[0], odds.others[0]) == (2, 6)


@pytest.mark.parametrize("strategy", ["tau", "rms", "baarda", "search"])
def test_single_and_pair_odds_go_by_the_same_sigma(strategy: str) -> None:
    design, misclosures, _ = random_system(8, errors={4: 6.0})
    found = find_gross_errors(
        system_of(design, 0.25 * misclosures), strategy, SearchSettings(pairs=True)
    )
    single, pairs = found.odds, found.pair_odds
    # the priors of one error differ by the prior of none
    expected = 0.9 * single.rows / single.none
    assert pairs.single / pairs.none == pytest.approx(expected, rel=1e-9)
    assert sigma_of(strategy) == ("tau" if strategy in ("tau", "rms") else "baarda")
    assert (single.rows[4] > 0.5) == (strategy in ("tau", "rms"))


def test_weights_that_creep_are_said_to() -> None:
    # two rows of each unknown: either bears an error for nearly the same sum
    pairs = np.zeros((40, 20))
    pairs[np.arange(40), np.arange(40) // 2] = np.tile([1.0, 1.0001], 20)
    misclosures = np.random.default_rng(1).normal(size=40)
    misclosures[6] += 40.0
    found = find_gross_errors(system_of(pairs, misclosures), "huber")
    said = "the weights did not settle in 200 iterations: the last ones count, which still change"
    assert [remark for remark in found.remarks if remark.startswith(f"{said} by up to ")]
    assert 6 in found.rows or 7 in found.rows


def test_huber_weights_at_the_end_and_their_efficiency() -> None:
    system = random_system(8, errors={4: 14.0, 30: -15.0})[2]
    found = reweight(system, "huber", np.ones(40, dtype=bool))
    assert found.converged
    size = np.abs(found.misclosures)
    assert found.weights == pytest.approx(np.minimum(1.0, HUBER_LIMIT / size), abs=1e-2)
    assert 0 < (found.weights < 1.0).sum() < 40
    # 95 % under the normal distribution: (mean of psi')^2 / mean of psi^2 (Huber 1964)
    k = HUBER_LIMIT
    inside = 2.0 * stats.norm.cdf(k) - 1.0
    square = inside - 2.0 * k * stats.norm.pdf(k) + 2.0 * k * k * stats.norm.sf(k)
    assert inside**2 / square == pytest.approx(0.95, abs=5e-4)


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_odds_by_the_estimated_sigma_do_not_ask_for_the_unit(scale: float) -> None:
    design, misclosures, system = random_system(8, errors={4: 14.0, 30: -15.0})
    odds = pair_odds(system, kind="tau")
    assert odds.pairs > 0.9
    other = pair_odds(system_of(design, scale * misclosures), kind="tau")
    assert other.none == pytest.approx(odds.none, rel=1e-6)
    assert other.single == pytest.approx(odds.single, rel=1e-6)
    assert other.pairs == pytest.approx(odds.pairs, rel=1e-6)


def test_pair_odds_where_there_is_no_sigma_are_the_priors() -> None:
    design = random_system(3, 8, 4)[0]
    exact = system_of(design, design @ np.ones(4))
    odds = pair_odds(exact, kind="tau")
    assert odds.none == pytest.approx(1.0 / 1.11)
    assert odds.single == pytest.approx(np.full(8, 0.1 / 8 / 1.11))
    assert odds.pairs == pytest.approx(0.01 / 1.11)


def test_rounding_is_not_beyond_a_model_value() -> None:
    r = np.array([1e-9, 9e-5, 0.25, 0.25, 0.25, 1e-9])
    root = np.array([1e-7, 0.0, 0.0, 0.45, 0.3, np.nan])
    assert beyond_model(r, root, 0.25).tolist() == [False, False, True, False, True, False]
    design = np.vstack((random_system(4, 11, 4)[0], np.zeros(4)))
    design = np.hstack((design, np.eye(12)[:, 11:]))  # the last row alone determines an unknown
    system = system_of(design, np.random.default_rng(1).normal(size=12))
    models = np.sqrt(np.append(system.r[:11], 1e-12))
    found = find_gross_errors(system, "modified", models=models)
    assert found.model_values.beyond_tolerance == 0


def test_rows_left_out_are_not_weighed() -> None:
    design, misclosures, system = random_system(8, n=14, u=4, errors={4: 14.0, 9: 30.0})
    keep = np.delete(np.arange(14), [9, 2])
    anew = system_of(design[keep], misclosures[keep])
    settings = SearchSettings(pairs=True)
    found = find_gross_errors(system, "search", settings, left_out=(9, 2))
    expected = find_gross_errors(anew, "search", settings)
    assert found.rows == tuple(keep[list(expected.rows)]) == (4,)
    assert found.odds.none == pytest.approx(expected.odds.none)
    assert found.odds.rows[keep] == pytest.approx(expected.odds.rows)
    odds, other = pair_odds(system, left_out=(9, 2)), expected.pair_odds
    assert odds.none == pytest.approx(other.none)
    for name in ("single", "marginal"):
        assert getattr(odds, name)[keep] == pytest.approx(getattr(other, name))
        assert getattr(odds, name)[[9, 2]].sum() == 0.0
    np.testing.assert_array_equal(odds.rows, keep[other.rows])
    np.testing.assert_array_equal(found.pair_odds.others, keep[other.others])


def test_refusals() -> None:
    system = random_system(1)[2]
    with pytest.raises(ValueError, match="no strategy"):
        find_gross_errors(system, "guess")
    with pytest.raises(ValueError, match="alpha"):
        SearchSettings(alpha=0.7)


@pytest.mark.slow
def test_odds_begin_with_the_first_of_equal_ends_whatever_the_rounding() -> None:
    same = 0
    for seed in range(12):
        system = random_system(seed, n=60, errors={3: 900.0, 20: -700.0, 41: 800.0, 50: -850.0})[2]
        first, other = (find_gross_errors(system, name) for name in ("l1", "baarda"))
        if set(first.rows) != set(other.rows):
            continue
        same += [step.rows for step in first.steps] != [step.rows for step in other.steps]
        steps = find_gross_errors(system, "odds").steps
        assert steps[: len(first.steps)] == first.steps
    assert same > 3


@pytest.mark.parametrize("strategy", ["l1", "huber", "danish"])
def test_columns_that_memory_does_not_hold_are_refused_before(strategy: str, monkeypatch) -> None:
    system = random_system(1, errors={3: 90.0, 20: -70.0})[2]
    held = find_gross_errors(system, strategy).rows
    assert set(held) == {3, 20}
    monkeypatch.setattr(strategies, "MOST_IN_COLUMNS", 2 * 40)
    assert find_gross_errors(system, strategy).rows == held
    monkeypatch.setattr(strategies, "MOST_IN_COLUMNS", 2 * 40 - 1)
    with pytest.raises(NotComputableError, match=r"2 of 40 observations .* memory; baarda"):
        find_gross_errors(system, strategy)
