"""Strategies on models: planted errors go, clean models keep all rows, what is said is true."""

from dataclasses import replace

import numpy as np
import pytest
from flightscene import (
    BAARDA,
    PAPER,
    PROPAGATED,
    TAU,
    fly,
    pair_of,
)
from idealmodel import ideal_pair, spoiled
from wild import text_of

from anaplot import bridge, plan
from anaplot.adjustment import cleaning
from anaplot.adjustment.elimination import Elimination
from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.scale import ScaleError
from anaplot.adjustment.strategies import STRATEGIES
from anaplot.errors import NotComputableError
from anaplot.orientation import grosserrors
from anaplot.orientation.grosserrors import model_gross_errors, strategy_findings
from anaplot.orientation.model import orient
from anaplot.orientation.residuals import residual_system, residuals_at
from anaplot.photogrammetry.block import Precision
from anaplot.report.modelerrors import model_errors_document

pytestmark = pytest.mark.slow

KNOWN_SIGMA = ("baarda", "modified", "huber", "danish", "search", "odds")


def keys(cleaned):
    return [row.name for row in cleaned.rejected]


def swapped(pair, one, other):
    """The pair with two points interchanged in the right photo."""
    xr = pair.xr.copy()
    a, b = pair.points.index(one), pair.points.index(other)
    xr[[a, b]] = xr[[b, a]]
    return replace(pair, xr=xr)


@pytest.mark.parametrize("strategy", KNOWN_SIGMA)
def test_planted_row_is_left_out_and_nothing_else(strategy: str) -> None:
    pair = ideal_pair("13/5")
    for row in orient(pair, PAPER, BAARDA).table:
        if row.axis == "y" and row.r > 0.4:
            wrong = spoiled(pair, row.point, "y", 0.2)
            cleaned = model_gross_errors(wrong, PAPER, BAARDA, strategy)
            assert keys(cleaned) == [row.key]
            (rejected,) = cleaned.rejected
            assert abs(rejected.w) > 3.3
            # without any other error the estimate is the error; it shows r of it alone
            assert abs(rejected.error) == pytest.approx(200.0, rel=0.01)
            assert rejected.residual == pytest.approx(rejected.r_back * rejected.error)
            assert rejected.r_back == pytest.approx(row.r, abs=0.01)
            assert rejected.r == pytest.approx(row.r, abs=0.02)
            assert row.key not in [r.key for r in cleaned.solution.table]
            assert not cleaned.solution.flagged


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_without_errors_nothing_is_rejected(
    strategy: str, capfd: pytest.CaptureFixture[str]
) -> None:
    cleaned = model_gross_errors(ideal_pair("13/5"), PAPER, BAARDA, strategy)
    assert cleaned.rejected == cleaned.came_back == cleaned.refused == ()
    assert len(cleaned.passes) == 1
    assert capfd.readouterr() == ("", "")  # nor does LAPACK complain of an empty set


def test_what_rounding_leaves_of_a_model_free_of_error_is_not_negative() -> None:
    block = plan.block(strips=3, photos=4, sidelap=60, points="5x5").result.made.block
    for strip in bridge(block, errors="tau").result.strips:
        assert strip.error is None
        for model in strip.models:
            assert residual_system(model).vtpv >= 0.0


def test_residual_system_is_that_of_the_table() -> None:
    pair = ideal_pair("13/5")
    wrong = spoiled(pair, pair.points[2], "y", 0.05)
    solution = orient(wrong, PAPER, BAARDA)
    system = residual_system(solution)
    w = abs(system.e) / system.r**0.5
    assert w == pytest.approx([row.size for row in solution.table], rel=1e-9)
    assert system.r == pytest.approx(system.matrix.diagonal(), abs=1e-12)


@pytest.mark.parametrize("precision", [PAPER, PROPAGATED])
@pytest.mark.parametrize("number", [0, 1])
def test_rows_at_their_own_orientation_are_those_of_the_table(number: int, precision) -> None:
    flight = fly(4, photos=3, noise=0.005)
    first = orient(pair_of(flight, 0), precision, BAARDA)
    pair = pair_of(flight, number, first if number else None)
    pair = replace(pair, off=frozenset({(pair.points[3], "y")}))
    solution = orient(pair, precision, BAARDA)
    own, all_rows = residual_system(solution), residuals_at(pair, precision, solution)
    assert all_rows.names == own.names
    assert all_rows.redundancy == own.redundancy
    assert all_rows.e == pytest.approx(own.e, abs=1e-6)
    assert all_rows.matrix == pytest.approx(own.matrix, abs=1e-8)
    unit = solution.apriori_um * np.sqrt(solution.q_l)
    assert all_rows.sigma == pytest.approx(unit)


def test_without_a_row_both_ways_of_looking_agree() -> None:
    """A row that the orientation lacks, seen from outside, leaves what the orientation has."""
    pair = spoiled(pair_of(fly(5, noise=0.005), 0), "0a", "y", 0.4)
    solution = orient(replace(pair, off=frozenset({("0a", "y")})), PROPAGATED, BAARDA)
    rows = residuals_at(pair, PROPAGATED, solution)
    state = Elimination(rows)
    state.add(rows.names.index(("0a", "y")))
    inside = [k for k, key in enumerate(rows.names) if key != ("0a", "y")]
    own = residual_system(solution)
    assert state.e[inside] == pytest.approx(own.e, abs=1e-6)
    assert state.r[inside] == pytest.approx(own.r, abs=1e-8)


def test_what_was_rejected_by_the_estimated_sigma_does_not_come_back_by_the_stated_one() -> None:
    stated = Precision(50.0, "propagated")
    for seed in range(10):
        pair = spoiled(pair_of(fly(seed, noise=0.005), 0), "0c", "y", 0.15)
        cleaned = model_gross_errors(pair, stated, TAU, "tau")
        assert ("0c", "y") in keys(cleaned)
        assert abs(cleaned.rejected[0].w) < 3.3


@pytest.mark.parametrize("strategy", ["baarda", "search", "odds", "danish"])
def test_two_interchanged_points_are_found_with_their_evidence(strategy: str) -> None:
    pair = swapped(pair_of(fly(2, noise=0.005, kappa=5.0), 0), "0a", "1d")
    cleaned = model_gross_errors(pair, PROPAGATED, BAARDA, strategy)
    assert {point for point, _ in keys(cleaned)} == {"0a", "1d"}
    assert [row.order for row in cleaned.rejected] == [1, 2]
    assert all(abs(row.error) > 1e4 for row in cleaned.rejected)
    assert cleaned.findings.odds.none < 1e-6
    assert len(cleaned.names) == len(pair.points)


@pytest.mark.slow
def test_rows_that_a_strategy_cannot_cope_with_are_held_and_said_so() -> None:
    """Ten thousand sigmas in two points are more than one re-weighting can tell from the others."""
    held = 0
    for seed in range(12):
        first = orient(pair_of(fly(seed, noise=0.005, kappa=5.0), 0), PROPAGATED, BAARDA)
        pair = pair_of(fly(seed, noise=0.005, kappa=5.0), 1, first)
        cleaned = model_gross_errors(swapped(pair, "1a", "2d"), PROPAGATED, BAARDA, "danish")
        text = text_of(model_errors_document(cleaned))
        assert ("all rows in but those far off, by the a-priori sigma0" in text) == bool(
            cleaned.held
        )
        assert set(cleaned.held) <= set(keys(cleaned)) & set(cleaned.begun_without)
        answer = model_errors_document(cleaned).to_dict()
        assert {(row["point"], row["axis"]) for row in answer["held"]} == cleaned.held
        assert answer["odds"]["sigma0"] == "a-priori"
        weighed = {(row["point"], row["axis"]) for row in answer["odds"]["single"]}
        assert weighed == set(cleaned.names) - cleaned.held
        assert all(
            cleaned.findings.odds.rows[cleaned.names.index(key)] == 0.0 for key in cleaned.held
        )
        held += bool(cleaned.held)
    assert 0 < held < 12


def test_partners_are_those_of_the_rows_that_are_out_at_the_end() -> None:
    pairs = 0
    for seed in range(6):
        pair = spoiled(pair_of(fly(seed, noise=0.005), 0), "0a", "y", 0.4)
        pair = spoiled(pair, "1c", "y", -0.3)
        cleaned = model_gross_errors(
            pair, PROPAGATED, BAARDA, "search", SearchSettings(partner=0.3)
        )
        out = keys(cleaned)
        for gone, kept, rho in cleaned.hard_to_tell:
            state = Elimination(cleaned.system)
            names = cleaned.names
            for key in out[: out.index(gone)]:  # those that had gone before
                state.add(names.index(key))
            expected = state.correlations(names.index(gone))[names.index(kept)]
            assert kept not in out
            assert abs(expected) >= 0.3
            assert rho == pytest.approx(expected, abs=1e-6)
            pairs += 1
    assert pairs > 6


def test_what_the_orientation_cannot_do_without_is_refused(monkeypatch) -> None:
    """Here nothing can be oriented without point 8."""
    real = grosserrors.orient

    def needs_8(pair, precision, test):
        if ("8", "y") in pair.off:
            raise NotComputableError("model 1/2: nothing holds it without point 8")
        return real(pair, precision, test)

    monkeypatch.setattr(grosserrors, "orient", needs_8)
    pair = spoiled(ideal_pair("13/5"), "8", "y", 0.05)
    cleaned = model_gross_errors(pair, PAPER, BAARDA, "baarda")
    assert cleaned.refused[0] == (("8", "y"), "model 1/2: nothing holds it without point 8")
    assert ("8", "y") not in keys(cleaned)
    assert ("8", "y") not in cleaned.came_back


def test_what_is_said_of_a_set_that_does_not_settle_is_true_where_the_model_lies(
    monkeypatch,
) -> None:
    """Here every second pass may only reject another point."""
    real, calls = cleaning.find_gross_errors, 0

    def turning(system, *args, suspects, **more):
        nonlocal calls
        calls += 1
        allowed = ("8", "y") if calls % 2 else ("4", "y")
        return real(
            system, *args, suspects=np.array([key == allowed for key in system.names]), **more
        )

    monkeypatch.setattr(cleaning, "find_gross_errors", turning)
    pair = spoiled(spoiled(ideal_pair("13/5"), "8", "y", 2.0), "4", "y", -3.0)
    cleaned = model_gross_errors(pair, PAPER, BAARDA, "baarda", SearchSettings(partner=0.3))
    assert any("did not settle" in remark for remark in cleaned.remarks)
    (gone,) = cleaned.rejected
    assert gone.name not in [row.key for row in cleaned.solution.table]
    there = residuals_at(pair, PAPER, cleaned.solution)
    assert cleaned.system.e == pytest.approx(there.e, abs=1e-9)
    own = real(there, "baarda", SearchSettings(alpha=0.001))
    assert cleaned.findings.odds.rows == pytest.approx(own.odds.rows, abs=1e-12)
    state = Elimination(there)
    row = there.names.index(gone.name)
    for mine, kept, rho in cleaned.findings.hard_to_tell:
        assert mine == row
        assert rho == pytest.approx(state.correlations(row)[kept], abs=1e-12)
    state.add(row)
    assert gone.error == pytest.approx(state.estimates()[0][0] * there.sigma[row])


def test_what_the_strategy_remarks_is_kept() -> None:
    pair = spoiled(spoiled(ideal_pair("13/5"), "8", "y", 0.2), "4", "y", -0.3)
    cleaned = model_gross_errors(pair, PAPER, BAARDA, "search", SearchSettings(most=1))
    assert len(cleaned.rejected) == 1
    assert cleaned.remarks == ("stopped at 1 rejected rows; there may be more errors",)
    assert model_gross_errors(pair, PAPER, BAARDA, "search").remarks == ()


def test_what_was_done_to_the_model_is_said() -> None:
    clean = pair_of(fly(4, noise=0.005), 0)
    pair = spoiled(clean, "0c", "y", 0.4)
    precision = Precision(5.0, "exact")
    cleaned = model_gross_errors(pair, precision, BAARDA, "baarda")
    assert keys(cleaned) == [("0c", "y")]
    before = {p.point: np.array(p[1:]) for p in orient(pair, precision, BAARDA).points}
    moved = {p.point: np.array(p[1:]) - before[p.point] for p in cleaned.solution.points}
    farthest = max(moved, key=lambda point: np.abs(moved[point]).max())
    ground = model_errors_document(cleaned).to_dict()["ground"]
    assert ground["point"] == farthest
    assert ground["change_mm"] == pytest.approx(moved[farthest]["XYZ".index(ground["axis"])])
    assert ground["sigma_after_mm"] > ground["sigma_before_mm"] > 0.0
    assert f"in the model: {farthest} moves most" in text_of(model_errors_document(cleaned))
    propagated = model_gross_errors(pair, PROPAGATED, BAARDA, "baarda")
    assert model_errors_document(propagated).to_dict()["ground"]["sigma_point"] is None


def test_a_sigma_far_from_the_truth_is_doubted() -> None:
    pair, stated = pair_of(fly(4, noise=0.180), 0), Precision(5.0, "propagated")
    for strategy in ("baarda", "search"):
        with pytest.raises(ScaleError, match=r"model .*is image_um = 5 right"):
            model_gross_errors(pair, stated, BAARDA, strategy)
        assert model_gross_errors(pair, stated, BAARDA, strategy, as_given=True).rejected
    assert model_gross_errors(pair, stated, TAU, "tau").rejected == ()
    found = strategy_findings(orient(pair, stated, BAARDA), "search")
    assert any("is image_um = 5 right" in remark for remark in found.remarks)
    found = strategy_findings(orient(pair, stated, TAU), "tau")
    assert not any("image_um" in remark for remark in found.remarks)
