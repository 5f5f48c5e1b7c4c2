"""A block as it is cleaned: linearised anywhere, and adjusted without some of its observations."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.cleaning import SolvedWithout
from anaplot.adjustment.scale import AprioriSigma
from anaplot.adjustment.watch import Watch
from anaplot.adjustment.withoutrows import WithoutRows
from anaplot.aliases import Array, Bools
from anaplot.bundle.errors.blockplace import BlockPlace
from anaplot.bundle.errors.exchangedcontrol import price_of
from anaplot.bundle.errors.laterresiduals import AllRows, LaterResiduals, left_open
from anaplot.bundle.errors.leftout import without
from anaplot.bundle.errors.parted import BlockParts, can_be_parted
from anaplot.bundle.errors.snooping import model_values
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import check_datum
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.gaussnewton import Minimum, NoConvergenceError, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.normal import PointError
from anaplot.bundle.solve.observations import ObservationName, Observations
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.residuals import block_residuals, residuals_at
from anaplot.bundle.solve.structure import Structure
from anaplot.errors import NotComputableError

__all__ = ["MOST_ROWS_AS_ONE", "BlockRows"]


MOST_ROWS_AS_ONE = 10_000
"""Observations of a block up to which its rows are cleaned as one, not apart."""


class BlockRows:
    """A block as it is cleaned; see `Relinearised`.

    Parameters
    ----------
    problem, structure
        The bundle with all rows, and the structure of its equations.
    watch
        Told how far it is.
    control_only
        Whether image coordinates are not suspected.
    first
        The bundle adjusted with all rows: its cofactors serve the pass that begins there.
    """

    def __init__(
        self,
        problem: Problem,
        structure: Structure,
        watch: Watch,
        *,
        control_only: bool,
        first: AdjustedBlock | None = None,
    ) -> None:
        self.problem, self.structure = problem, structure
        self._watch, self._control_only = watch, control_only
        self._rows: Observations | None = None
        self._first = first
        self._parts: BlockParts | None = None
        block = problem.block
        # control, priors and conditions may be far better, or worse, than they say
        rows = 2 * len(problem.photo)
        idle = 0 if problem.off is None else int(problem.off.sum())
        self.apriori = AprioriSigma.image_um(
            f"block {block.name}", block.precision.image_um, rows, idle
        )

    def residuals(self, at: BlockPlace, number: int) -> AllRows:
        """Return all rows, linearised at a place."""
        label = f"gross errors, pass {number}"
        first, self._first = self._first, None
        if first is not None and at.state is first.state and first.cofactors.change is None:
            return self._told(residuals_at(first.cofactors))
        if at.reduced is not None and self._apart:
            self._watch(label, 0.0)
            return self._told(LaterResiduals(self.problem, at.state, self.structure))
        try:
            system = block_residuals(
                self.problem,
                at.state,
                self.structure,
                lambda fraction: self._watch(label, fraction),
            )
        except (PointError, NotPositiveError) as error:
            raise left_open(self.problem, self.structure, at.state, error) from error
        return self._told(system)

    def _told(self, system: AllRows) -> AllRows:
        self._rows = system.rows
        return system

    @property
    def rows(self) -> Observations:
        """Which observations the rows are; the same in every linearisation."""
        assert self._rows is not None
        return self._rows

    def problem_without(self, out: frozenset[ObservationName]) -> Problem:
        """Return the bundle without some rows."""
        return without(self.rows, frozenset(map(self.rows.row_of, out)))

    def without(
        self, out: frozenset[ObservationName], near: BlockPlace
    ) -> SolvedWithout[BlockPlace, ObservationName]:
        """Adjust without some rows."""
        rows = frozenset(map(self.rows.row_of, out))
        problem, parts, self._parts = without(self.rows, rows), self._parts, None
        state, led = near.state, 0
        if parts is not None:
            state, led = parts.foreseen(problem, sorted(rows))
            del parts  # as large as the block
        near.let_go()  # asked for again only where the passes do not settle
        found = self._minimum(problem, state, led)
        return SolvedWithout(BlockPlace.of(found), found.convergence.last)

    def suspects(self, system: AllRows) -> Bools:
        """Return which rows may be rejected: priors of additional parameters never.

        Nor, like control free of error, conditions free of error.
        """
        allowed = np.ones(len(system.names), dtype=bool)
        third, fourth = system.rows.starts[2:]
        allowed[third:fourth] = False
        if self.problem.conditions is not None:
            allowed[fourth:] = ~self.problem.conditions.firm
        allowed[: system.rows.image] &= not self._control_only
        if self.problem.off is not None:
            allowed[: system.rows.image] &= ~self.problem.off.ravel()
        return allowed

    def model_values(self, system: AllRows, at: BlockPlace) -> Array:
        """Return model values by the classes of 1980."""
        return model_values(system.whole)

    @property
    def _apart(self) -> bool:
        """Whether it is too large to be cleaned as one, and falls into places."""
        problem = self.problem
        off = 0 if problem.rejected is None else int(problem.rejected.sum())
        return problem.observations + off > MOST_ROWS_AS_ONE and can_be_parted(problem)

    def apart(self, system: AllRows, at: BlockPlace) -> WithoutRows | None:
        """Return how it is seen without some rows, of a block too large to be cleaned as one."""
        if not self._apart:
            return None
        self._parts = BlockParts(system, at.state, self.structure, at.reduced, lambda: at.cofactors)
        return self._parts

    def price(self, out: frozenset[ObservationName], at: BlockPlace, each: float) -> float:
        """Return what they cost: two control points that were interchanged are one mistake."""
        return price_of(self.problem, at, out, each)

    def astray(self, error: NotComputableError) -> bool:
        """Whether there was no minimum to be found."""
        return isinstance(error, NoConvergenceError)

    def _minimum(self, problem: Problem, state: BlockState, led: int) -> Minimum:
        check_datum(problem, state)
        return find_minimum(
            problem, state, self.structure, firm=True, led=led, progress=self._watch
        )
