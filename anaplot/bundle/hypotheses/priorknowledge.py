"""A block with prior knowledge of its unknowns: three estimators (Bayesian phototriangulation).

Prior knowledge is all that is known of unknowns beforehand: priors of points, stated positions and
rotations with their sigmas, additional parameters with theirs, and weighted control. Where points
have priors of their own, control is a group by itself: these priors are of another variance. With P
the weights of the image coordinates, Px those of the prior knowledge and s^2, s_x^2 the factors of
their variances, all three minimise v'Pv / s^2 + v_x'Px v_x / s_x^2 (and what control adds), and C
is the inverse of these normal equations:

- known variance factors: s^2 = s_x^2 = 1;
- one common unknown factor (eq. 2): s^2 = (v'Pv + v_x'Px v_x) / (r + r_x);
- separate unknown factors (eq. 3): s^2 = v'Pv / r, s_x^2 = v_x'Px v_x / r_x, iterated; that of
  control likewise.

r and r_x are the sums of the redundancy numbers; the divisors printed in the paper are
approximations of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.variancecomponents import VarianceComponents, estimate_components
from anaplot.aliases import PriorEstimator, Progress, TestKind
from anaplot.bundle.hypotheses.observationgroups import GroupedBlock, ObservationGroups
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Problem
from anaplot.errors import InputError, NotComputableError

__all__ = ["BlockPrior", "PriorGroup", "prior_estimate"]

_TOLERANCE = 1e-6  # relative change of a variance factor that ends the iteration


class PriorGroup(NamedTuple):
    """The image coordinates, the prior knowledge, or control beside it.

    Attributes
    ----------
    observations, redundancy
        Their number and the sum of their redundancy numbers.
    vtpv
        Their weighted sum of squares, with the stated variances.
    factor
        Their variance factor.
    interval
        95 % confidence interval of the factor; None where it is known or held.
    """

    observations: int
    redundancy: float
    vtpv: float
    factor: float
    interval: tuple[float, float] | None


@dataclass(frozen=True, slots=True, eq=False)
class BlockPrior:
    """A block adjusted with prior knowledge.

    Attributes
    ----------
    estimator
        "known", "common" or "separate".
    image, prior
        The image coordinates and the prior knowledge.
    control
        The weighted control, where points have priors of their own beside it; else None: it is
        part of the prior knowledge.
    iterations, converged
        Adjustments made, and whether the last one changed the factors by less than the tolerance.
    block
        The adjusted block: standard deviations and tests with the a-priori sigma0 ("known"), the
        estimated one ("common"), or with the stated variances times their factors ("separate").
    remarks
        Sentences for a person.
    """

    estimator: PriorEstimator
    image: PriorGroup
    prior: PriorGroup
    control: PriorGroup | None
    iterations: int
    converged: bool
    block: AdjustedBlock = field(repr=False)
    remarks: tuple[str, ...]


def prior_estimate(
    block: AdjustedBlock, estimator: PriorEstimator, *, progress: Progress | None = None
) -> BlockPrior:
    """Adjust a block with its prior knowledge by one of the three estimators.

    Parameters
    ----------
    block
        The adjusted block.
    estimator
        "known", "common" or "separate".
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    InputError
        Nothing is known beforehand.
    NotComputableError
        There is no redundancy to estimate a factor from, or no minimum with the factors on the
        way.
    """
    problem = block.problem
    given: list[int | None] = [
        1 if bool(np.isfinite(sigma).any()) else None
        for sigma in (
            problem.known_sigma,
            problem.expected_sigma,
            problem.position_sigma,
            problem.rotation_sigma,
            problem.additional_sigma,
        )
    ]
    if given == [None] * 5:
        raise InputError(
            f"block {problem.block.name}: nothing is known beforehand: no control and no points "
            "with sigmas, no stated position or rotation with sigmas, no additional parameters "
            "with a sigma"
        )
    image = np.zeros((len(problem.photo), 2), dtype=np.intp)
    names: tuple[str, ...] = ("image coordinates", "prior knowledge")
    if given[0] and given[1]:
        names, given[0] = (*names, "control"), 2
    groups = ObservationGroups(names, image, *given)
    grouped = GroupedBlock(block, groups, progress)
    if estimator == "separate":
        variances = estimate_components(
            groups.names,
            groups.counts(problem),
            grouped.readjust,
            redundancies=grouped.redundancies,
            tolerance=_TOLERANCE,
        )
        return _separate(grouped, variances)
    sums = grouped.readjust(np.ones(len(names)))
    factor = 1.0
    if estimator == "common":
        if not problem.redundancy > 0:
            raise NotComputableError(
                f"block {problem.block.name}: no redundancy: no variance factor can be estimated"
            )
        factor = float(sums.vtpv.sum()) / problem.redundancy
    kind: TestKind = "baarda" if estimator == "known" else "tau"
    of = [
        PriorGroup(count, redundancy, vtpv, factor, None)
        for count, redundancy, vtpv in zip(
            groups.counts(problem), sums.redundancy.tolist(), sums.vtpv.tolist(), strict=True
        )
    ]

    def tested(changed: Problem) -> Problem:
        test = replace(changed.block.test, kind=kind)
        # nothing but sigma0 is estimated
        return replace(changed, block=replace(changed.block, test=test), estimated=None)

    return BlockPrior(estimator, *_three(of), 1, True, grouped.last(tested), ())


def _three(groups: list[PriorGroup]) -> tuple[PriorGroup, PriorGroup, PriorGroup | None]:
    return groups[0], groups[1], groups[2] if len(groups) > 2 else None


def _separate(grouped: GroupedBlock, variances: VarianceComponents) -> BlockPrior:
    groups = [
        PriorGroup(c.observations, c.redundancy, c.vtpv * c.factor, c.factor, c.interval)
        for c in variances.components
    ]
    return BlockPrior(
        "separate",
        *_three(groups),
        variances.iterations,
        variances.converged,
        grouped.last(lambda problem: grouped.groups.told(problem, variances)),
        tuple(variances.remarks()),
    )
