"""Whether the control that all epochs have is where it was, as their free networks see it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Progress
from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.epochs.apart import Agreement, displacements_laid
from anaplot.bundle.epochs.common import Common, nearly_in_line
from anaplot.bundle.epochs.joint import progress_of
from anaplot.bundle.errors.bychance import may_be_chance
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.start.freenetwork import free_network
from anaplot.errors import NotComputableError

__all__ = ["control_agreement"]

_LEAST = 3  # points that a similarity is found by


def control_agreement(
    alone: Sequence[AdjustedBlock], common: Common, progress: Progress | None
) -> Agreement | None:
    """Return how well the common control agrees between the epochs without any of it.

    Control that has moved bends every epoch after it, and shows as rays or points beside it. Rays
    that disagree with each other without any control are wrong themselves: they take no part, and
    their points are not asked.

    Parameters
    ----------
    alone
        The epochs, each adjusted by itself, without additional parameters.
    common
        What control gives in several of them.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    Agreement or None
        None where fewer than three points not on one line are control in all epochs, with the same
        coordinates, or an epoch has no free network.
    """
    every = frozenset(range(len(alone)))
    # what was surveyed anew may have moved as its coordinates say
    places = [
        {row.point: row.xyz for row in one.problem.block.control if row.use == "control"}
        for one in alone
    ]
    names = [
        name
        for name in common.points()
        if common.whole(name) == every and len({each[name] for each in places}) == 1
    ]
    if len(names) < _LEAST:
        return None
    free, wrong = [], set[str]()
    for number, one in enumerate(alone, start=1):
        try:
            problem, state = free_network(one.problem, one.state)
            part = progress_of(f"epoch {number} without control", progress)
            net, its = _without_wrong_rays(adjust_bundle(problem, state, progress=part), part)
            free.append(net)
            wrong |= its
        except (NotComputableError, np.linalg.LinAlgError):
            return None
    known = set(names).intersection(*(net.problem.points for net in free)) - wrong
    there = [name for name in names if name in known]
    if len(there) < _LEAST or nearly_in_line(free[0], there):
        return None
    return displacements_laid(free, (), there)[3]


def _without_wrong_rays(
    net: AdjustedBlock, progress: Progress | None
) -> tuple[AdjustedBlock, set[str]]:
    """Return a free network without the rays that are wrong in it, and the points of these."""
    if not net.tested.flagged.any() or may_be_chance(net):
        return net, set()
    clean = block_gross_errors(net, "search", watch=Watch(progress)).block
    problem = clean.problem
    if problem.rejected is None:
        return net, set()
    wrong = problem.rejected if problem.off is None else problem.rejected & ~problem.off
    of = problem.point[wrong.any(axis=1)].tolist()
    return clean, {problem.points[k] for k in of}
