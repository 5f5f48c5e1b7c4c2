"""Epochs of an object: adjusted jointly or apart, and how far every point has moved.

Gruen 1978, section D3, eq. (54), with any number of periods: the control (or points that are
declared stable) and the additional parameters may be common to all of them, every other point has
coordinates of its own in each. Of control that is given in some coordinates only those are common.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.tested import sigma0_known
from anaplot.aliases import Array, Progress
from anaplot.bundle.epochs.alone import adjust_alone, check_measured_twice, remarks_on
from anaplot.bundle.epochs.apart import Agreement, displacements_apart, displacements_laid
from anaplot.bundle.epochs.common import (
    Common,
    check_control,
    check_stable,
    common_control,
    is_weighted,
    stable_points,
)
from anaplot.bundle.epochs.expected import expected_movements
from anaplot.bundle.epochs.heldcontrol import control_agreement
from anaplot.bundle.epochs.joint import adjust_jointly, joint_displacements
from anaplot.bundle.epochs.moves import Move, chosen_points, moves_of
from anaplot.bundle.epochs.series import EpochSeries
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import on_control
from anaplot.bundle.solve.problem import Datum
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.givenmovement import GivenMovement
from anaplot.photogrammetry.imagepoints import columns_of

__all__ = ["compare_series"]


def compare_series(
    blocks: Sequence[Block],
    *,
    separate: bool = False,
    additional: AdditionalParameters | None = None,
    common_parameters: bool | None = None,
    stable: Sequence[str] = (),
    points: Sequence[str] = (),
    given: Sequence[GivenMovement] = (),
    progress: Progress | None = None,
) -> EpochSeries:
    """Adjust epochs and compute the displacements with their covariance matrix.

    Parameters
    ----------
    blocks
        Two or more, in the order of time.
    separate
        An adjustment for each, whose points are uncorrelated, in place of a joint one.
    additional
        Additional parameters.
    common_parameters
        Whether all epochs have the same ones; None: where their scope allows (block, camera) and
        the adjustment is a joint one.
    stable
        Points that hold the datum in place of control; at least three.
    points
        Names of the points to compare; empty: all that are in two epochs or more.
    given
        The movement that displacements are tested against.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    InputError
        The epochs cannot be compared as asked: no common points, control that differs, names that
        are not there, of more than two epochs one that is there twice.
    NotComputableError
        An epoch, or all together, are not determined.

    Notes
    -----
    With stable points and separate adjustments all epochs are free networks; the later ones are
    laid onto the first by a similarity over the stable points, and the covariance matrix goes the
    same way (S-transformation).

    A control point of which only some coordinates are given in several epochs is a point in each:
    what is given is common (jointly, a weighted coordinate is one observation of one unknown), what
    is not is tested. Separate adjustments observe the given coordinate once in each. Control that
    an epoch gives up is a point there, and compared with the others. Conditions between points and
    priors of points take no part.
    """
    if len(blocks) < 2:
        raise InputError("one epoch has nothing to be compared with")
    _check_tests(blocks)
    same = _shares(additional, separate, common_parameters, len(blocks))
    datum: Datum = "free" if stable else "control"
    remarks: list[str] = []
    twice = check_measured_twice(blocks)
    if not stable:
        check_control(blocks, separate)
    before = additional if separate else None
    alone = [
        adjust_alone(block, number, datum, before, progress)
        for number, block in enumerate(blocks, start=1)
    ]
    if stable:
        check_stable(alone, stable)
        common = stable_points(stable, len(blocks))
    else:
        common = common_control(blocks)
        if not common.axes:
            remarks.append(
                f"no control point is common to {'both ' if len(blocks) == 2 else ''}epochs: that "
                "their control is of one system is not checked"
            )
    names = [_points_in_order(block) for block in alone]
    left_out = [
        {part.name: part.reason for part in one.problem.left_out if part.kind == "point"}
        for one in alone
    ]
    chosen = chosen_points(names, common, points, left_out)
    moves = moves_of(chosen, names, common)
    expected = None
    if given:
        expected = expected_movements(moves, common, given, len(blocks))
    if separate:
        found = _separately(alone, moves, common, datum)
        if not stable and is_weighted(blocks):
            remarks.append(
                "control counts as determined anew in each epoch; if it is the same survey, the "
                "joint adjustment is the rigorous one"
            )
    else:
        found, warnings = _together(
            alone, moves, common, datum, additional, same=same, progress=progress
        )
        # what the block lacks, the epochs by themselves say
        remarks += [f"jointly: {warning}" for warning in warnings]
    agreement = found.agreement
    if not stable and additional is None:
        agreement = control_agreement(alone, common, progress)
    if twice is not None:
        remarks.append(twice)
    without = additional is not None and before is None
    for number, adjusted in enumerate(alone, start=1):
        remarks += remarks_on(adjusted, number, without)
    if stable and not on_control(alone[0].problem, alone[0].state):
        some = bool(np.isfinite(alone[0].problem.known).any())
        why = "control does not hold" if some else "no control in"
        remarks.append(f"{why} the first epoch: lengths are in the units of its free network")
    return EpochSeries(
        epochs=tuple(block.name for block in blocks),
        joint=not separate,
        datum="stable" if stable else "control",
        own_parameters=None if additional is None else not same,
        common=common,
        points=chosen,
        moves=moves,
        places=found.places,
        d=found.d,
        cofactors=found.cofactors,
        expected=expected,
        flagged=tuple(len(one.flagged_observations()) for one in alone),
        vtpv=found.vtpv,
        redundancy=found.redundancy,
        alone=tuple((one.vtpv, one.redundancy) for one in alone),
        by_known=sigma0_known(blocks[0].test.kind),
        power=blocks[0].test.power,
        agreement=agreement,
        names=tuple(tuple(mine) for mine in names),
        remarks=tuple(dict.fromkeys(remarks)),
    )


class _Compared(NamedTuple):
    """Displacements of one way of adjusting; as in `EpochSeries`."""

    places: Array
    d: Array
    cofactors: Array
    vtpv: float
    redundancy: int
    agreement: Agreement | None


def _separately(
    alone: Sequence[AdjustedBlock], moves: Sequence[Move], common: Common, datum: Datum
) -> _Compared:
    """Compare points of several adjustments, free networks laid onto the first by those held."""
    agreement: Agreement | None = None
    if datum == "free":
        places, d, q, agreement = displacements_laid(alone, moves, common.points())
    else:
        places, d, q = displacements_apart(alone, moves)
    vtpv, redundancy = (sum(one.vtpv for one in alone), sum(one.redundancy for one in alone))
    return _Compared(places, d, q, vtpv, redundancy, agreement)


def _together(
    alone: Sequence[AdjustedBlock],
    moves: Sequence[Move],
    common: Common,
    datum: Datum,
    additional: AdditionalParameters | None,
    *,
    same: bool,
    progress: Progress | None,
) -> tuple[_Compared, tuple[str, ...]]:
    """Compare points in a joint adjustment; also what it warns of."""
    shares: dict[str, int] = {}
    equal: list[tuple[Move, int]] = []
    for name, axes in common.partly().items():
        # jointly, all that give the point give the same of it
        mine = sorted(k for k in common.axes[name][axes[0]] if name in alone[k].problem.points)
        if len(mine) > 1:
            shares[name] = len(mine)
            steps = (Move(name, j, k) for j, k in itertools.pairwise(mine))
            equal += [(step, axis) for step in steps for axis in axes]
    block = adjust_jointly(alone, common, shares, datum, additional, same=same, progress=progress)
    places, d, q, cost = joint_displacements(block, moves, common, len(alone), equal)
    vtpv, redundancy = block.vtpv + cost, block.redundancy
    agreement = None
    if datum == "free" and additional is None:
        # what the epochs by themselves need not agree in (Gruen 1978, eq. 32)
        agreement = replace(
            displacements_laid(alone, (), common.points())[3],
            square=max(vtpv - sum(one.vtpv for one in alone), 0.0),
            dimension=redundancy - sum(one.redundancy for one in alone),
        )
    return _Compared(places, d, q, vtpv, redundancy, agreement), block.warnings


def _points_in_order(block: AdjustedBlock) -> list[str]:
    """Return the points that take part, in the order of the file."""
    there = set(block.problem.points)
    names = columns_of(block.problem.block.image_points).point.values
    return [name for name in names if name in there]


def _check_tests(blocks: Sequence[Block]) -> None:
    kinds = [block.test.kind for block in blocks]
    if len(set(kinds)) > 1:
        raise InputError(
            f"the epochs are tested differently ({', '.join(kinds)}): [test] kind must be the same"
        )


def _shares(
    additional: AdditionalParameters | None, separate: bool, asked: bool | None, epochs: int
) -> bool:
    """Whether additional parameters are common to all epochs."""
    possible = not separate and additional is not None and additional.scope in ("block", "camera")
    if asked and additional is None:
        raise InputError("common parameters: no additional parameters are asked for")
    if asked and separate:
        raise InputError("separate adjustments have no common parameters")
    if asked and not possible and additional is not None:
        raise InputError(
            f"additional parameters of every {additional.scope} cannot be common to "
            f"{'both' if epochs == 2 else 'all'} epochs: block or camera can"
        )
    return possible if asked is None else asked
