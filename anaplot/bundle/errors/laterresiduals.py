"""All rows of a block, linearised: what an adjustment with all of them leaves is found when asked.

Where rows are cleaned apart from an adjustment without most of the wrong ones, nobody asks.
"""

from __future__ import annotations

from functools import cached_property

from scipy.sparse import csr_array

from anaplot.adjustment.residualsystem import WeightedAdjustments
from anaplot.aliases import Array, Index
from anaplot.bundle.solve.datum import anchor
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.normal import PointError
from anaplot.bundle.solve.observations import observations_at
from anaplot.bundle.solve.openmovement import undetermined
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.residuals import BlockResiduals, NamedRows, block_residuals
from anaplot.bundle.solve.structure import Structure
from anaplot.errors import NotComputableError

__all__ = ["AllRows", "LaterResiduals", "left_open"]


def left_open(
    problem: Problem,
    structure: Structure,
    state: BlockState,
    error: PointError | NotPositiveError,
) -> NotComputableError:
    """Return the error that names what a bundle leaves open at a place; see `undetermined`."""
    tie = anchor(problem, state) if problem.defect else None
    return undetermined(problem, structure, state, linearise(problem, state), tie, error)


class LaterResiduals(NamedRows):
    """A block as a residual system, see `ResidualSystem`, that is solved when it is asked for.

    Parameters
    ----------
    problem, state, structure
        As `block_residuals` has them.
    """

    def __init__(self, problem: Problem, state: BlockState, structure: Structure) -> None:
        self.problem, self._state, self._structure = problem, state, structure
        self.linear = linearise(problem, state)
        self.rows = observations_at(problem, self.linear)

    @cached_property
    def whole(self) -> BlockResiduals:
        """The same with all that an adjustment with all rows leaves.

        Raises
        ------
        NotComputableError
            Not all unknowns are determined there.
        """
        problem, state, structure = self.problem, self._state, self._structure
        try:
            return block_residuals(problem, state, structure, linear=self.linear)
        except (PointError, NotPositiveError) as error:
            raise left_open(problem, structure, state, error) from error

    @property
    def redundancy(self) -> int:
        """Observations minus unknowns."""
        return self.problem.redundancy

    @property
    def e(self) -> Array:
        """(n,) misclosures left."""
        return self.whole.e

    @property
    def r(self) -> Array:
        """(n,) redundancy numbers."""
        return self.whole.r

    @property
    def vtpv(self) -> float:
        """Sum of the squares of e."""
        return self.whole.vtpv

    def columns(self, rows: Index) -> Array:
        """Return (n, k): the columns of R that belong to k rows."""
        return self.whole.columns(rows)

    def design(self) -> csr_array | None:
        """Return (n, u) derivatives, each row divided by its sigma; see `BlockResiduals`."""
        return self.whole.design()

    def reweighting(self) -> WeightedAdjustments:
        """Return the adjustments with other weights; see `Reweightable`."""
        return self.whole.reweighting()


AllRows = BlockResiduals | LaterResiduals
"""All rows of a block, linearised somewhere; nothing is rejected in them but what is off."""
