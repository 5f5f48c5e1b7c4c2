"""The hypotheses of an adjusted block: additional parameters, checks, control."""

from __future__ import annotations

from dataclasses import dataclass

from anaplot.bundle.hypotheses.checktests import CheckTests, check_tests
from anaplot.bundle.hypotheses.conditiontests import ConditionTests, condition_tests
from anaplot.bundle.hypotheses.controltests import ControlTests, control_tests
from anaplot.bundle.hypotheses.parametertests import ParameterTests, parameter_tests
from anaplot.bundle.hypotheses.verdict import USUAL, HypothesisSettings
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["BlockHypotheses", "block_hypotheses"]


@dataclass(frozen=True, slots=True, eq=False)
class BlockHypotheses:
    """What was tested; None where there is nothing of the kind.

    Attributes
    ----------
    settings
        Significance and power.
    additional, check, control
        The tests of additional parameters, of check points and of control.
    conditions
        Those of conditions between points that are compared: check distances and others.
    """

    settings: HypothesisSettings
    additional: ParameterTests | None
    check: CheckTests | None
    control: ControlTests | None
    conditions: ConditionTests | None = None


def block_hypotheses(block: AdjustedBlock, settings: HypothesisSettings = USUAL) -> BlockHypotheses:
    """Test the hypotheses of Gruen 1978, section D, that one block allows."""
    return BlockHypotheses(
        settings,
        parameter_tests(block, settings),
        check_tests(block, settings),
        control_tests(block, settings),
        condition_tests(block, settings),
    )
