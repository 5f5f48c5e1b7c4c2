"""Are stated positions and angles off by what they have in common: shifts, drifts, boresights."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import DependentConditionsError, quadratic_form, sidak_alpha
from anaplot.bundle.hypotheses.verdict import USUAL, HypothesisSettings, VarianceFactor, Verdict
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.laidoffsets import OffsetKind
from anaplot.bundle.solve.rows import OffsetRow
from anaplot.photogrammetry.prioroffsets import PriorOffsets

__all__ = ["OffsetGroupTest", "OffsetTest", "OffsetTests", "offset_rows", "offset_tests"]


class OffsetTest(NamedTuple):
    """One offset against zero.

    Attributes
    ----------
    row
        Its value.
    verdict
        Of its single test; the family of all offsets keeps the significance.
    mdb
        Smallest offset that is found with the settings' power, in its unit.
    """

    row: OffsetRow
    verdict: Verdict
    mdb: float


class OffsetGroupTest(NamedTuple):
    """The three of a strip, a camera or the block together against zero; None: they are as one."""

    kind: OffsetKind
    group: str
    verdict: Verdict | None


@dataclass(frozen=True, slots=True, eq=False)
class OffsetTests:
    """The hypotheses about offsets of stated positions and angles.

    Attributes
    ----------
    declared
        Which there are.
    groups, single
        Each three together, each by itself; the families of both keep the significance.
    """

    declared: PriorOffsets
    groups: tuple[OffsetGroupTest, ...]
    single: tuple[OffsetTest, ...]


def offset_rows(block: AdjustedBlock) -> list[OffsetRow]:
    """Return what the photos' priors have in common; not what nothing is observed of."""
    laid, equations = block.problem.offsets, block.cofactors.normal.linear.offsets
    found, sigma = block.cofactors.offsets, block.sigma
    if laid is None or equations is None or found is None:
        return []
    deviations = np.sqrt(np.maximum(np.diag(found.own), 0.0)).tolist()
    values, middles = equations.value.tolist(), laid.middles.tolist()
    return [
        OffsetRow(
            *laid.names[k],
            values[k],
            None if sigma is None else sigma * deviations[k],
            None if np.isnan(middles[k]) else middles[k],
        )
        for k in np.flatnonzero(laid.observed(block.problem.prior_sigma)).tolist()
    ]


def offset_tests(block: AdjustedBlock, settings: HypothesisSettings = USUAL) -> OffsetTests | None:
    """Test the offsets of stated positions and angles against zero; None when there are none.

    What is known of them beforehand counts as in the adjustment: as an observation of zero.
    """
    problem, cofactors = block.problem, block.cofactors.offsets
    rows, declared = offset_rows(block), problem.block.offsets
    if not rows or cofactors is None or problem.offsets is None or declared is None:
        return None
    variance = VarianceFactor.of(block)
    at = {(name.kind, name.group, name.axis): k for k, name in enumerate(problem.offsets.names)}
    q = cofactors.own
    together = dict.fromkeys((row.kind, row.group) for row in rows)
    alpha = sidak_alpha(settings.alpha, len(together))
    groups = []
    for kind, group in together:
        mine = [row for row in rows if (row.kind, row.group) == (kind, group)]
        its = [at[kind, group, row.axis] for row in mine]
        verdict = None
        with suppress(DependentConditionsError, np.linalg.LinAlgError):
            square = quadratic_form(np.array([row.value for row in mine]), q[np.ix_(its, its)])
            verdict = variance.test(square, len(mine), alpha)
        groups.append(OffsetGroupTest(kind, group, verdict))
    alone = sidak_alpha(settings.alpha, len(rows))
    noncentrality = variance.detectable(alone, settings.power)
    single = []
    for row in rows:
        k = at[row.kind, row.group, row.axis]
        cofactor = float(q[k, k])
        verdict = variance.test(row.value**2 / cofactor, 1, alone)
        single.append(OffsetTest(row, verdict, float(np.sqrt(noncentrality * cofactor))))
    return OffsetTests(declared, tuple(groups), tuple(single))
