"""Do check distances, and other conditions that are compared only, agree with the block."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import DependentConditionsError, quadratic_form, sidak_alpha
from anaplot.bundle.hypotheses.verdict import USUAL, HypothesisSettings, VarianceFactor, Verdict
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.comparedconditions import checked_conditions

__all__ = ["ConditionTest", "ConditionTests", "condition_tests"]


class ConditionTest(NamedTuple):
    """One row of a condition that is compared only.

    Attributes
    ----------
    id, what, axis
        What it is called: file and line, points, what is compared.
    unit
        "m" or "rad".
    difference
        Adjusted minus given.
    s, s_given
        Its standard deviation for the a-priori sigma0, and that of what is given alone.
    verdict
        The family of all rows keeps the significance.
    mdb
        Smallest difference that is found with the settings' power.
    """

    id: str
    what: str
    axis: str
    unit: str
    difference: float
    s: float
    s_given: float
    verdict: Verdict
    mdb: float


@dataclass(frozen=True, slots=True, eq=False)
class ConditionTests:
    """The hypotheses about conditions that are compared only.

    Attributes
    ----------
    everything
        All differences are zero, by as many combinations as they have that are not parameters of
        lines, planes and equal distances; None where they repeat each other.
    distances
        Number of check distances.
    rms, expected
        Root mean square of their differences [m], and what it is expected to be for the a-priori
        sigma0; None without check distances.
    single
        Each row by itself.
    """

    everything: Verdict | None
    distances: int
    rms: float | None
    expected: float | None
    single: tuple[ConditionTest, ...]


def condition_tests(
    block: AdjustedBlock, settings: HypothesisSettings = USUAL
) -> ConditionTests | None:
    """Test the conditions with `use` = check; None without any, or where lengths mean nothing."""
    found = checked_conditions(block)
    if found is None:
        return None
    variance = VarianceFactor.of(block)
    d, q = found.differences, found.cofactors
    everything = None
    with suppress(DependentConditionsError, np.linalg.LinAlgError):
        square = quadratic_form(found.independent, found.their_cofactors)
        everything = variance.test(square, len(found.independent), settings.alpha)
    alone = sidak_alpha(settings.alpha, len(d))
    noncentrality = variance.detectable(alone, settings.power)
    single = tuple(
        ConditionTest(
            *row,
            unit,
            difference,
            s,
            given,
            variance.test((difference / s) ** 2, 1, alone),
            float(noncentrality**0.5 * s),
        )
        for row, unit, difference, s, given in zip(
            found.rows,
            found.units,
            d.tolist(),
            np.sqrt(np.diag(q)).tolist(),
            found.given.tolist(),
            strict=True,
        )
    )
    lengths = [one for one in single if one.axis == "distance"]
    rms = expected = None
    if lengths:
        rms = float(np.sqrt(np.mean([one.difference**2 for one in lengths])))
        expected = float(np.sqrt(np.mean([one.s**2 for one in lengths])))
    return ConditionTests(everything, len(lengths), rms, expected, single)
