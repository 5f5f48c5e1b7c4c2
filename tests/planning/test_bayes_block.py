"""The Bayesian paper's block: what limits it, and what the strategies make of it."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.planning.bayesblock import bayes_block
from anaplot.planning.bayesscenarios import noise_within_three, scenarios
from anaplot.planning.montecarlo import simulate

pytestmark = pytest.mark.slow

GROUPS = {scenario.name: scenario for scenario in scenarios()}


def test_facts() -> None:
    facts = bayes_block(10.0).facts()
    assert (facts.observations, facts.unknowns) == (156, 135)
    assert (facts.rank, facts.firm_rank) == (128, 127)
    assert facts.redundancy == pytest.approx(29.0, abs=0.5)
    assert (facts.untestable, facts.inseparable) == (16, 52)
    # weaker priors check less
    assert bayes_block(100.0).facts().redundancy < facts.redundancy


def test_untestable_are_x_of_points_that_two_photos_of_one_strip_see() -> None:
    block = bayes_block(10.0)
    r = np.diag(block.matrix)
    hidden = [block.rows[k] for k in np.flatnonzero(r < 0.01).tolist()]
    assert {axis for _, _, axis in hidden} == {"x"}
    points = [point for _, point, _ in hidden]
    assert set(points) == {"11", "15", "21", "25", "41", "45", "51", "55"}
    assert all(points.count(point) == 2 for point in points)


def test_residuals_are_those_of_an_adjustment_with_priors() -> None:
    block = bayes_block(10.0)
    errors = np.random.default_rng(3).normal(size=156)
    a = block.design
    normal = a.T @ a + np.eye(135) / 10.0
    x = np.linalg.solve(normal, a.T @ errors)
    v = errors - a @ x
    system = block.residuals(errors)
    np.testing.assert_allclose(system.e, v, atol=1e-6)
    assert system.vtpv == pytest.approx(float(v @ v + x @ x / 10.0), rel=1e-8)
    assert system.redundancy == 29
    assert block.residuals(errors, 21).redundancy == 21


def test_no_prior_no_block() -> None:
    with pytest.raises(ValueError, match="not positive"):
        bayes_block(0.0)


def test_fourteen_groups() -> None:
    assert list(GROUPS) == ["bayes-G0A", "bayes-G0B"] + [
        f"bayes-G{k}{letter}" for k in (1, 2, 3, 4) for letter in "ABC"
    ]
    assert GROUPS["bayes-G3C"].references["10 of 18 sigma", "search", "right"] == 4.6
    # what was found with priors of 10 m^2 says nothing of priors of 100 m^2
    assert GROUPS["bayes-G4C"].references == {}


def test_noise_is_cut_at_three_sigma() -> None:
    noise = noise_within_three(np.random.default_rng(1), 2000, 156)
    assert np.abs(noise).max() <= 3.0
    assert noise.std() == pytest.approx(0.9866, abs=0.005)


@pytest.mark.long
@pytest.mark.parametrize("name", ["bayes-G3C", "bayes-G4C"])
def test_ten_errors_hide_from_sigmas_of_their_own(name: str) -> None:
    tally = simulate(GROUPS[name], runs=20, seed=11)

    def mean(method: str, quantity: str) -> float:
        of = tally["10 of 18 sigma", method, quantity]
        assert of.runs == 20
        return of.total / of.runs

    assert mean("tau", "right") < 1.5 < mean("baarda", "right")
    assert mean("search", "right") >= mean("baarda", "right")
    assert mean("search", "wrong") < mean("baarda", "wrong")
    assert mean("odds", "right") > mean("search", "right") - 0.3
    assert mean("odds", "wrong") < mean("search", "wrong")
    assert mean("sure", "wrong") < mean("odds", "wrong")
    for method in ("rms", "tau", "baarda", "search", "odds", "sure"):
        assert mean(method, "right") + mean(method, "missed") == pytest.approx(10.0)


def test_without_errors_little_is_rejected() -> None:
    tally = simulate(GROUPS["bayes-G0A"], runs=20, seed=2, methods=("baarda", "search", "odds"))
    for method in ("baarda", "search", "odds"):
        of = tally["no gross error", method, "wrong"]
        assert of.total / of.runs < 0.5
        assert tally["no gross error", method, "right"].total == 0.0
