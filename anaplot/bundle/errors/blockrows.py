"""A block as it is cleaned: linearised anywhere, and adjusted without some of its observations."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.cleaning import SolvedWithout
from anaplot.adjustment.scale import AprioriSigma
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools
from anaplot.bundle.errors.leftout import without
from anaplot.bundle.errors.snooping import model_values
from anaplot.bundle.solve.datum import anchor, check_datum
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.gaussnewton import Minimum, NoConvergenceError, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.openmovement import undetermined
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.residuals import BlockResiduals, block_residuals
from anaplot.bundle.solve.structure import Structure
from anaplot.errors import NotComputableError

__all__ = ["BlockPlace", "BlockRows"]


class BlockPlace(NamedTuple):
    """Where a block lies; the minimum that was found, None where it was given."""

    state: BlockState
    found: Minimum | None


class BlockRows:
    """A block as it is cleaned; see `Relinearised`."""

    def __init__(
        self,
        problem: Problem,
        structure: Structure,
        watch: Watch,
        *,
        control_only: bool,
    ) -> None:
        self.problem, self.structure = problem, structure
        self._watch, self._control_only = watch, control_only
        self._system: BlockResiduals | None = None
        block = problem.block
        # control, priors and conditions may be far better, or worse, than they say
        rows = 2 * len(problem.photo)
        self.apriori = AprioriSigma.image_um(f"block {block.name}", block.precision.image_um, rows)

    def residuals(self, at: BlockPlace, number: int) -> BlockResiduals:
        """Return all rows, linearised at a place."""
        label = f"gross errors, pass {number}"
        try:
            self._system = block_residuals(
                self.problem,
                at.state,
                self.structure,
                lambda fraction: self._watch(label, fraction),
            )
        except (PointError, NotPositiveError) as error:
            raise self._open(self.problem, at.state, error) from error
        return self._system

    @cached_property
    def rows(self) -> dict[ObservationName, int]:
        """Row of every name; the same in every linearisation."""
        assert self._system is not None
        return {name: row for row, name in enumerate(self._system.names)}

    def problem_without(self, out: frozenset[ObservationName]) -> Problem:
        """Return the bundle without some rows."""
        assert self._system is not None
        return without(self._system, frozenset(self.rows[name] for name in out))

    def without(
        self, out: frozenset[ObservationName], near: BlockPlace
    ) -> SolvedWithout[BlockPlace, ObservationName]:
        """Adjust without some rows."""
        found = self._minimum(self.problem_without(out), near.state)
        return SolvedWithout(BlockPlace(found.state, found), found.convergence.last)

    def suspects(self, system: BlockResiduals) -> Bools:
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

    def model_values(self, system: BlockResiduals, at: BlockPlace) -> Array:
        """Return model values by the classes of 1980."""
        return model_values(system)

    def astray(self, error: NotComputableError) -> bool:
        """Whether there was no minimum to be found."""
        return isinstance(error, NoConvergenceError)

    def _minimum(self, problem: Problem, state: BlockState) -> Minimum:
        linear = linearise(problem, state)
        check_datum(problem, state, linear)
        tie = anchor(problem, state) if problem.defect else None
        try:
            weights = None if tie is None else tie.weights
            NormalEquations(problem, self.structure, linear, 0.0, weights).factor()
        except (PointError, NotPositiveError) as error:
            raise self._open(problem, state, error) from error
        return find_minimum(problem, state, self.structure, progress=self._watch)

    def _open(
        self, problem: Problem, state: BlockState, error: PointError | NotPositiveError
    ) -> NotComputableError:
        tie = anchor(problem, state) if problem.defect else None
        return undetermined(problem, self.structure, linearise(problem, state), tie, error)
