"""Tables 1 and 3 of the Bayesian paper: the figures are those of a dense adjustment."""

from __future__ import annotations

import json
from math import sqrt

import numpy as np
import pytest

from anaplot.adjustment.significance import critical_tau
from anaplot.cli import main
from anaplot.planning.bayesblock import CORNERS, bayes_block
from anaplot.planning.bayesfolder import CONTROL_M
from anaplot.planning.bayestables import bayes_step, rows_by_rms, scenarios
from anaplot.planning.montecarlo import simulate

TABLES = scenarios()[0]


@pytest.fixture(scope="module")
def block():
    return bayes_block(10.0)


def stacked(block, errors, prior, out, control=None):
    """Unknowns, residuals and cofactors: image coordinates, priors and control in one system."""
    u = block.design.shape[1]
    rows = [block.design[~out], np.eye(u) / sqrt(block.prior_variance)]
    right = [errors[~out], prior]
    if control is not None:
        at = (60 + 3 * np.array(CORNERS)[:, None] + np.arange(3)).ravel()
        rows.append(np.eye(u)[at] / CONTROL_M)
        right.append(control)
    design = np.vstack(rows)
    x = np.linalg.lstsq(design, np.concatenate(right), rcond=None)[0]
    # of the rows, not of their squares: that costs half of the digits
    inverse = np.linalg.pinv(design)
    return x, errors - block.design @ x, inverse @ inverse.T


def test_the_figures_are_those_of_pseudo_observations(block) -> None:
    rng = np.random.default_rng(4)
    errors, prior, control = rng.normal(size=156), rng.normal(size=135), rng.normal(size=12)
    out = np.zeros(156, dtype=bool)
    out[[3, 40, 77]] = True
    found = bayes_step(block, errors, prior, control, out)
    x, v, q = stacked(block, errors, prior, out, control)
    off = np.sqrt((x[60:].reshape(25, 3) ** 2).mean(axis=0))
    deviation = np.sqrt(np.diag(q)[60:].reshape(25, 3).mean(axis=0))
    for k, axis in enumerate("XYZ"):
        assert found[f"EMQ {axis}"] == pytest.approx(off[k], rel=1e-6)
        assert found[f"DPE {axis}"] == pytest.approx(deviation[k], rel=1e-6)
        assert found[f"EMQ/DPE {axis}"] == pytest.approx(off[k] / deviation[k], rel=1e-6)
    assert found["GL"] == 18
    assert found["VUP"] == pytest.approx((v[~out] ** 2).sum() / 18, rel=1e-6)
    assert found["largest V"] == pytest.approx(5.0 * np.abs(v[~out]).max(), rel=1e-6)


def test_the_papers_rule_ends_where_no_residual_is_beyond_it(block) -> None:
    errors = np.random.default_rng(11).normal(size=156)
    errors[[5, 90]] += 18.0
    nothing, none = np.zeros(135), np.zeros(156, dtype=bool)
    e = stacked(block, errors, nothing, none)[1]
    first = np.abs(e) > critical_tau(0.001, 21) * np.sqrt((e**2).mean())
    out = rows_by_rms(block, e, 0.001)
    assert first.any()
    assert out[first].all()
    assert out.sum() <= 10
    v = stacked(block, errors, nothing, out)[1][~out]
    beyond = np.abs(v) > critical_tau(0.001, 21 - int(out.sum())) * np.sqrt((v**2).mean())
    assert not beyond.any() or out.sum() == 10


def test_printed_degrees_of_freedom_are_what_is_left_of_21() -> None:
    assert len(TABLES.groups) == 14
    assert [group.variance for group in TABLES.groups[:2]] == [10.0, 100.0]
    for group in TABLES.groups:
        of = group.printed
        assert of["GL"] == 21 - of["right"] - of["wrong"]
        assert of["right"] + of["missed"] == group.case.number


@pytest.mark.slow
def test_without_errors_the_points_are_as_good_as_they_say() -> None:
    tally = simulate(TABLES, runs=20, seed=3, methods=("baarda",))

    def mean(group: str, what: str) -> float:
        of = tally[group, "baarda", what]
        return of.total / of.runs

    for group in ("G0A", "G0B"):
        for axis in "XYZ":
            # the rms of 25 correlated points scatters by less than its own size
            assert abs(mean(group, f"EMQ/DPE {axis}") - 1.0) < 4.0 / sqrt(20)
        assert mean(group, "wrong") < 0.5
    # ten times the variance: the heights hang on the priors, the plan does not (printed: 2.9)
    assert 2.5 < mean("G0B", "DPE Z") / mean("G0A", "DPE Z") < sqrt(10.0)
    assert mean("G0B", "DPE X") / mean("G0A", "DPE X") < 1.1
    # ten errors of 18 sigma hide
    assert mean("G3C", "VUP") > 3.0 * mean("G3A", "VUP")


@pytest.mark.slow
def test_the_command_prints_them(capsys) -> None:
    call = ["plan", "simulate", "bayes-tables", "--strategy", "rms", "--runs", "2"]
    assert main([*call, "--processes", "1", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)["figures"]
    assert len(figures) == 14 * 15
    known = {(row["case"], row["quantity"]): row["reference"] for row in figures}
    assert known["G3C", "VUP"] == 12.01
    assert known["G4B", "DPE Y"] == 2.24
