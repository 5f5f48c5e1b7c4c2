"""The free network: approximate values by way of it, and whether control is its mirror image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.aliases import Array, Progress
from anaplot.bundle.solve.datum import check_datum
from anaplot.bundle.solve.gaussnewton import NoConvergenceError, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import Structure, make_structure
from anaplot.bundle.start.approximate import laid_onto_control, restricted
from anaplot.bundle.start.pull import foreseen_torn
from anaplot.bundle.start.robust import no_minimum_error, robust_state
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.similarity import robust_similarity

__all__ = ["MIRRORED", "free_network", "from_free_network", "mirror_remark", "unsolved_error"]

MIRRORED = "control is the mirror image of what the photos show"
"""Where the remark of `mirror_remark` begins."""

_FEWEST = 4  # control points of which a mirror image may be told from the block itself
_CLEARLY = 20.0  # times better than the block has its mirror image to fit
_MOST = 0.75  # of the control points, and fit these


def free_network(
    problem: Problem, start: BlockState, progress: Progress | None = None
) -> tuple[Problem, BlockState]:
    """Return the block without its datum, and its solution from a state.

    Where gross errors would tear its minimum it is the robust one.

    Raises
    ------
    NotComputableError
        There is no such network, or no minimum is found.
    numpy.linalg.LinAlgError
        Nor can its equations be solved.
    """
    free = make_problem(
        replace(problem.block, conditions=()), datum="free", undetermined=problem.undetermined
    )
    bare = restricted(free, problem, start)
    structure = make_structure(free, bare.centres)
    check_datum(free, bare)
    solution = robust_state(free, structure, bare)
    bare = solution.state
    if not foreseen_torn(free, structure, solution):
        bare = find_minimum(free, bare, structure, progress=progress).state
    return free, bare


def from_free_network(
    problem: Problem, start: BlockState, progress: Progress | None
) -> BlockState | None:
    """Approximate values by way of the free network, in which control has no influence.

    Gross errors that would tear its minimum have little weight: that of a robust solution. What
    only control determines (a control point in one photo) is added after the network lies on
    control. None when there is no such network.
    """
    try:
        free, bare = free_network(problem, start, progress)
        return laid_onto_control(problem, free, bare)
    except (NotComputableError, np.linalg.LinAlgError):
        return None


def mirror_remark(problem: Problem, start: BlockState) -> str | None:
    """Say that control is the mirror image of what the photos show; None where it is not.

    No rotation makes one of the other, and adjusted together they tear the block anywhere. Control
    in one plane fits both.

    Parameters
    ----------
    problem, start
        The bundle, and where the free network begins.
    """
    known = [
        (row.point, row.xyz)
        for row in problem.block.control
        if row.use == "control" and None not in row.xyz
    ]
    if problem.defect or len(known) < _FEWEST:
        return None
    try:
        free, bare = free_network(problem, start, None)
    except (NotComputableError, np.linalg.LinAlgError):
        return None
    at = {point: k for k, point in enumerate(free.points)}
    known = [row for row in known if row[0] in at]
    if len(known) < _FEWEST:
        return None
    ground = np.array([xyz for _, xyz in known], dtype=float)
    ground -= ground.mean(axis=0)
    network = bare.points[[at[point] for point, _ in known]]
    by_itself, by_mirror = (_misfit(side * network, ground) for side in (1.0, -1.0))
    if not by_mirror * _CLEARLY < by_itself:
        return None
    return (
        f"{MIRRORED}: mirrored it fits to {by_mirror:.2g} m, else to {by_itself:.2g} m; does y of"
        " the images point down, are x and y, or X and Y, exchanged, or does Z point down?"
    )


def unsolved_error(
    problem: Problem, structure: Structure, start: BlockState, state: BlockState | None = None
) -> NotComputableError:
    """Return `no_minimum_error`, or where control is a mirror image, the error that says so."""
    mirrored = mirror_remark(problem, start)
    if mirrored is None:
        return no_minimum_error(problem, structure, start, state)
    return NoConvergenceError(f"block {problem.block.name}: no solution found: {mirrored}", start)


def _misfit(network: Array, ground: Array) -> float:
    """Return what most points miss by [m] after a similarity; infinite where there is none."""
    found = robust_similarity(network, ground)
    if found is None:
        return float("inf")
    off = np.linalg.norm(found[0].apply(network) - ground, axis=1)
    return float(np.quantile(off, _MOST, method="higher"))
