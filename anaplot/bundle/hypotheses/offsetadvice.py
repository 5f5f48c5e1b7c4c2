"""Would stated positions or angles fit if they were allowed to be off by the same.

With the rows D of unknowns y that the adjustment is without, its residuals e and R = Q_vv P, v'Pv
would fall by (D'e)'(D'R D)^-1 D'e: the multipliers of "y is zero". Of D'R D = K - C'N^-1 C all is
there, see `anaplot.bundle.solve.offsetequations`.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import FTest, f_test
from anaplot.adjustment.reliability import SPUR
from anaplot.aliases import Array, Index
from anaplot.bundle.hypotheses.verdict import VarianceFactor
from anaplot.bundle.onward import adjust_onward
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.checkedrows import checked_rows
from anaplot.bundle.solve.laidoffsets import OFFSET_KINDS, OffsetKind, OffsetName, lay_out_offsets
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.offsetequations import OffsetsOpenError, OffsetUpdate, best_offsets
from anaplot.bundle.solve.remade import with_given_back
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.prioroffsets import BoresightScope, OffsetScope, PriorOffsets
from anaplot.photogrammetry.rotation import rotation_angles

__all__ = ["OffsetAdvice", "offset_advice"]

_GIVEN = ("control", "prior", "point prior")
_SEVERAL = 2  # rejected of what is given, or times as many as by chance
_ALPHA = 1e-3  # significance: a remark that nobody asked for is not made by chance
_WORSE = 0.01  # significance of "what is stated errs by more than all else", whatever is off
_OF_KIND: dict[OffsetKind, slice] = {
    "shift": slice(0, 3),
    "drift": slice(0, 3),
    "boresight": slice(3, 6),
}


class OffsetAdvice(NamedTuple):
    """Unknowns that stated positions or angles ask for.

    Attributes
    ----------
    kind, scope
        "shift" of "strip" or "block", or "boresight" of "camera" or "block".
    unknowns
        How many.
    falls, vtpv
        What v'Pv would fall by to first order, beside the other kinds, and what it is.
    test
        Of "all are zero", with what is left of v'Pv.
    """

    kind: OffsetKind
    scope: str
    unknowns: int
    falls: float
    vtpv: float
    test: FTest


def offset_advice(
    block: AdjustedBlock, rejected: Iterable[ObservationName] = ()
) -> list[OffsetAdvice]:
    """Return what a block without offsets should have; nothing where it has some.

    Each kind is tested beside the others: what is left of v'Pv once all are there decides. One
    observation that explains more by itself is wrong, and offsets are not.

    Parameters
    ----------
    block
        The adjusted block.
    rejected
        Observations without which it was adjusted. Control and stated positions that differ by the
        same are rejected one by one, and then nothing is left to tell: with more of them out than
        by chance it is asked with all that is given.
    """
    problem, rows = block.problem, block.observations
    if problem.datum != "control" or problem.offsets is not None:
        return []
    gone = sum(name[0] in _GIVEN for name in rejected)
    by_chance = problem.test.alpha * (rows.starts[2] - rows.image + gone)
    stated = any(one.position_sigma or one.rotation_sigma for one in problem.block.photos)
    if stated and problem.given is None and gone >= _SEVERAL * max(1.0, by_chance):
        with suppress(NotComputableError):
            block = adjust_onward(with_given_back(problem), block)
            problem = block.problem
    shift: OffsetScope | None = None
    boresight: BoresightScope | None = None
    if np.isfinite(problem.position_sigma).any():
        shift = "strip" if len(problem.block.strips) > 1 else "block"
    if np.isfinite(problem.rotation_sigma).any():
        boresight = "camera" if len(problem.block.cameras) > 1 else "block"
    every = PriorOffsets(shift, None, boresight)
    # without control positions hold the datum, and nothing tells of their shift
    for wanted in (every, replace(every, shift=None)):
        if wanted.any and (found := _Multipliers.of(block, wanted)) is not None:
            return found.advice(block, wanted)
    return []


class _Multipliers(NamedTuple):
    """Of "all offsets are zero": names of the k offsets, D'e and D'R D."""

    names: tuple[OffsetName, ...]
    told: Array
    matrix: Array

    @classmethod
    def of(cls, block: AdjustedBlock, wanted: PriorOffsets) -> _Multipliers | None:
        """Return them; None where the offsets could not be determined."""
        problem, normal, factor = block.problem, block.cofactors.normal, block.cofactors.factor
        stated = problem.position_sigma, problem.rotation_sigma
        laid = None
        # a photo in two strips, standard deviations far apart: nobody asked for offsets
        with suppress(InputError, NotComputableError):
            laid = lay_out_offsets(problem.block, problem.photos, *stated, wanted)
        if laid is None or len(laid) >= block.redundancy:
            return None
        # as if all were stated as it is: the derivatives where there are no offsets
        rotations, fitting = block.state.rotations, np.zeros((len(problem.photos), 3))
        angles = np.array([rotation_angles(one) for one in rotations])
        equations, _ = best_offsets(laid, fitting, rotations, angles, problem.prior_sigma)
        sides = equations.sides(normal.linear.photo_rows)
        others = np.zeros((len(problem.points), 3, len(laid)))
        shared = np.zeros((problem.in_border, len(laid)))
        try:
            update = OffsetUpdate.of(equations, sides, normal.solve(factor, sides, others, shared))
        except OffsetsOpenError:
            return None
        told = equations.gathered(normal.linear.photo_e[:, :, None])[:, 0]
        matrix = np.asarray(-np.linalg.inv(update.inner), dtype=np.float64)
        return cls(laid.names, told, matrix)

    def falls(self, its: Index) -> float:
        """Return what v'Pv falls by with some of them."""
        if not len(its):
            return 0.0
        return float(
            self.told[its] @ np.linalg.solve(self.matrix[np.ix_(its, its)], self.told[its])
        )

    def advice(self, block: AdjustedBlock, wanted: PriorOffsets) -> list[OffsetAdvice]:
        """Return those that are needed beside the others."""
        kinds = np.array([name.kind for name in self.names])
        whole, alone = self.falls(np.arange(len(kinds))), _by_one(block)
        left = VarianceFactor(
            max(block.vtpv - whole, 0.0), block.redundancy - len(kinds), by_known=False
        )
        sigma = max(1.0, left.sigma or 0.0)
        out = []
        for kind in OFFSET_KINDS:
            its, others = np.flatnonzero(kinds == kind), np.flatnonzero(kinds != kind)
            if not len(its):
                continue
            falls = max(whole - self.falls(others), 0.0)
            used, degrees = sigma, left.redundancy
            own = _by_itself(block, kind, len(its), falls)
            if own.sigma is not None and _errs_more(own, sigma, left.redundancy):
                # what errs by more than it states differs from control by more, too
                used, degrees = own.sigma, own.redundancy
            test = f_test(falls, len(its), alpha=_ALPHA, sigma=used, redundancy=degrees)
            if test.rejected and falls >= alone:
                scope = getattr(wanted, kind)
                out.append(OffsetAdvice(kind, scope, len(its), falls, block.vtpv, test))
        return out


def _by_itself(
    block: AdjustedBlock, kind: OffsetKind, unknowns: int, falls: float
) -> VarianceFactor:
    """Return the variance factor of stated positions, or angles, without offsets.

    All that v'Pv falls by is taken for theirs.
    """
    mine = _OF_KIND[kind]
    square = float(np.nansum(block.cofactors.normal.linear.photo_e[:, mine] ** 2))
    redundancy = int(np.nansum(block.cofactors.r_photo[:, mine]))
    return VarianceFactor(square, redundancy, by_known=False).without(falls, unknowns)


def _errs_more(own: VarianceFactor, sigma: float, redundancy: int) -> bool:
    """Whether what has a variance factor of its own errs by more than all else."""
    test = f_test(own.vtpv, own.redundancy, alpha=_WORSE, sigma=sigma, redundancy=redundancy)
    return test.rejected


def _by_one(block: AdjustedBlock) -> float:
    """Return the most that v'Pv falls by without a single observation."""
    tested = block.tested
    first = block.observations.starts[3]
    checked = checked_rows(tested, block.problem.conditions, first, SPUR)
    v = tested.residual[checked] / block.observations.sigma[checked]
    return float(np.max(v**2 / tested.r[checked], initial=0.0))
