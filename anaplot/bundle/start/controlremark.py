"""What is wrong with what is given as a whole: a mirror image of the photos, exchanged, or foreign.

The free network of the photos, in which nothing that is given has influence, tells; of control and
stated positions also which of them it is that the photos do not agree with.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from anaplot.bundle.solve.gaussnewton import NoConvergenceError
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import objective
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure
from anaplot.bundle.solve.upright import look_up
from anaplot.bundle.start.absolute import turn_onto
from anaplot.bundle.start.freenetwork import free_network
from anaplot.bundle.start.givenfamilies import (
    CLEARLY,
    FEWEST,
    MOST,
    foreign_family,
    known_control,
    misfit,
)
from anaplot.bundle.start.robustsuspects import no_minimum_error
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.exchangedpoints import ControlRemark, likely_exchange

__all__ = ["WithoutControl", "unsolved_error"]

_IN_SCALE = 2.5  # sigma0 without control, or one over it: the photos agree with their sigma
_TOGETHER = 0.9  # length of the mean direction in which photos look that are taken from above
_SMALL = 10_000  # rays of a block of which a wrong control point bends nearly all


class WithoutControl:
    """What the photos alone say of control; their free network is adjusted where it is asked for.

    Parameters
    ----------
    problem, start
        The bundle, and where the free network begins.
    """

    def __init__(self, problem: Problem, start: BlockState) -> None:
        self._problem, self._start = problem, start

    @cached_property
    def _network(self) -> tuple[Problem, BlockState] | None:
        try:
            return free_network(self._problem, self._start, anew=True)
        except (NotComputableError, np.linalg.LinAlgError):
            return None

    @cached_property
    def remark(self) -> ControlRemark | None:
        """What is wrong with control, or with stated positions, as a whole; None: nothing."""
        if self._problem.defect or len(known_control(self._problem, plan=True)) < FEWEST:
            return None
        if self._network is None:
            return None
        return self._of_control(*self._network) or foreign_family(self._problem, *self._network)

    def _of_control(self, free: Problem, bare: BlockState) -> ControlRemark | None:
        """Return what is wrong with control alone.

        That it is the mirror image of what the photos show: no rotation makes one of the other, and
        adjusted together they tear the block anywhere. Control in one plane fits both. Or that two
        control points are exchanged: one mistake, but of four control points two others are left,
        and these hold no block. Where less than four are known in all coordinates, those known in
        plan are asked below photos that look down together.
        """
        problem = self._problem
        at = {point: k for k, point in enumerate(free.points)}
        known = {
            name: xyz for name, xyz in known_control(problem, plan=False).items() if name in at
        }
        if len(known) < FEWEST:
            plan = {
                name: xyz for name, xyz in known_control(problem, plan=True).items() if name in at
            }
            return _exchanged_in_plan(bare, plan, [at[name] for name in plan])
        ground = np.array(list(known.values()), dtype=float)
        ground -= ground.mean(axis=0)
        network = bare.points[[at[name] for name in known]]
        # where most of control lies in one plane, which fits either way, all of it tells
        for most in (MOST, 1.0):
            by_itself, by_mirror = (misfit(side * network, ground, most) for side in (1.0, -1.0))
            if by_mirror * CLEARLY < by_itself:
                return ControlRemark(
                    "control is the mirror image of what the photos show: mirrored it fits to "
                    f"{by_mirror:.2g} m, else to {by_itself:.2g} m; does y of the images point "
                    "down, are x and y, or X and Y, exchanged, or does Z point down?"
                )
        return likely_exchange(
            list(known),
            network,
            ground,
            "the photos",
            lambda fitted: look_up(free, fitted.rotation @ bare.rotations),
        )

    @property
    def agree(self) -> bool:
        """Whether the photos agree with their a-priori sigma: else it is control that bends them.

        A height at one of four or five corners bends a whole block, all residuals of it alike.
        """
        problem = self._problem
        if problem.defect or len(problem.photo) > _SMALL or self._network is None:
            return False
        free, bare = self._network
        vtpv, usual = objective(free, bare)[0], float(free.redundancy)
        return usual / _IN_SCALE**2 <= vtpv <= usual * _IN_SCALE**2


def _exchanged_in_plan(
    bare: BlockState, known: dict[str, tuple[float | None, ...]], at: list[int]
) -> ControlRemark | None:
    """Say which two points known in plan are exchanged, below photos that look down together."""
    down = -bare.rotations[:, :, 2].mean(axis=0)
    length = float(np.linalg.norm(down))
    if len(known) < FEWEST or length < _TOGETHER:
        return None
    upright = turn_onto(down / length, np.array([0.0, 0.0, -1.0]))
    network = bare.points[at] @ upright.T
    ground = np.array([(*xyz[:2], 0.0) for xyz in known.values()], dtype=float)
    ground -= ground.mean(axis=0)
    network[:, 2] = 0.0
    return likely_exchange(
        list(known), network, ground, "the photos", lambda fitted: fitted.rotation[2, 2] < 0.0
    )


def unsolved_error(
    problem: Problem, structure: Structure, start: BlockState, state: BlockState | None = None
) -> NotComputableError:
    """Return `no_minimum_error`, or where control is wrong as a whole, the error that says so."""
    remark = WithoutControl(problem, start).remark
    if remark is None:
        return no_minimum_error(problem, structure, start, state)
    return NoConvergenceError(
        f"block {problem.block.name}: no solution found: {remark.text}", start
    )
