"""Strategies on models: planted errors go, clean models keep all rows."""

import pytest
from flightscene import BAARDA, PAPER, ideal_pair, spoiled

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.strategies import STRATEGIES
from anaplot.orientation.grosserrors import model_gross_errors, residual_system
from anaplot.orientation.model import orient

KNOWN_SIGMA = ("baarda", "modified", "huber", "danish", "search", "odds")


@pytest.mark.parametrize("strategy", KNOWN_SIGMA)
def test_planted_row_is_left_out_and_nothing_else(strategy: str) -> None:
    pair = ideal_pair("13/5")
    for row in orient(pair, PAPER, BAARDA).table:
        if row.axis == "y" and row.redn > 0.4:
            wrong = spoiled(pair, row.point, "y", 0.2)
            cleaned = model_gross_errors(wrong, PAPER, BAARDA, strategy)
            assert [(r.point, r.axis) for r in cleaned.rejected] == [row.key]
            (rejected,) = cleaned.rejected
            assert rejected.w is None or abs(rejected.w) > 3.3
            assert row.key not in [r.key for r in cleaned.solution.table]
            assert not cleaned.solution.flagged


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_without_errors_nothing_is_rejected(strategy: str) -> None:
    cleaned = model_gross_errors(ideal_pair("13/5"), PAPER, BAARDA, strategy)
    assert cleaned.rejected == ()
    assert len(cleaned.findings) == 1


def test_residual_system_is_that_of_the_table() -> None:
    pair = ideal_pair("13/5")
    wrong = spoiled(pair, pair.points[2], "y", 0.05)
    solution = orient(wrong, PAPER, BAARDA)
    system = residual_system(solution)
    w = abs(system.e) / system.r**0.5
    assert w == pytest.approx([row.sigf for row in solution.table], rel=1e-9)
    assert system.r == pytest.approx(system.matrix.diagonal(), abs=1e-12)


def test_what_the_strategy_remarks_is_kept() -> None:
    pair = spoiled(spoiled(ideal_pair("13/5"), "8", "y", 0.2), "4", "y", -0.3)
    cleaned = model_gross_errors(pair, PAPER, BAARDA, "search", SearchSettings(most=1))
    assert len(cleaned.rejected) == 1
    assert cleaned.remarks == ("stopped at 1 rejected rows; there may be more errors",)
    assert model_gross_errors(pair, PAPER, BAARDA, "search").remarks == ()
