"""Tests in an aerial block: their size and power, and the strategies with several errors."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.planning.blockscenarios import gruen_matrix, scenarios
from anaplot.planning.linearrows import residual_matrix
from anaplot.planning.montecarlo import figures, simulate

pytestmark = pytest.mark.slow

NAMED = {scenario.name: scenario for scenario in scenarios()}


def test_the_block() -> None:
    matrix = gruen_matrix()
    np.testing.assert_allclose(matrix @ matrix, matrix, atol=1e-9)
    assert round(float(np.trace(matrix))) == 170
    assert len(matrix) == 328


def test_columns_that_depend_on_each_other() -> None:
    with pytest.raises(ValueError, match="do not determine"):
        residual_matrix(np.ones((4, 2)))
    with pytest.raises(ValueError, match="nothing observes"):
        residual_matrix(np.array([[1.0, 0.0], [2.0, 0.0], [1.0, 0.0]]))


def test_size_and_power_are_as_predicted() -> None:
    scenario = NAMED["size-blocks"]
    compared = 0
    quantities = scenario.prepare().quantities(scenario.methods)
    tally = simulate(scenario, runs=3000, seed=7)
    for figure in figures(tally, quantities, scenario.references, 0.999):
        if figure.reference is not None:
            assert figure.low <= figure.reference <= figure.high, figure
            compared += 1
    assert compared == 8


def test_strategies_with_errors() -> None:
    scenario = NAMED["block-errors-20"]
    tally = simulate(scenario, runs=5, seed=3)
    for method in scenario.methods:
        for number in (1, 5, 10):
            case = f"{number} of 20 sigma"
            right, missed = (tally[case, method, q].total for q in ("right", "missed"))
            assert right + missed == 5 * number
        if method != "rms":
            assert tally["5 of 20 sigma", method, "right"].total >= 0.8 * 25
