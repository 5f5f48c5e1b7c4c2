"""A block as it was before a search for gross errors: what is told of it beside what came of that.

Its equations and cofactors are as large as the block. Where the search begins at another place they
are let go of meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from anaplot.aliases import Array
from anaplot.bundle.adjust import evaluate
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.gaussnewton import Convergence, Minimum, equations_at
from anaplot.bundle.solve.imaging import BlockState, RobustPlace
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure

__all__ = ["BlockBefore"]


@dataclass(frozen=True, eq=False)
class BlockBefore:
    """An adjusted block, of which the largest parts may be let go of.

    Attributes
    ----------
    problem, state, convergence, vtpv, redundancy, sigma0, v, warnings, of_control, robust
        As `AdjustedBlock` has them.
    structure
        Of its normal equations.
    r
        (m, 2) redundancy numbers of the image coordinates.
    deviations
        (p, 3) standard deviations of the points [m], with the a-priori sigma0.
    kept
        The whole adjustment; None: let go of.
    """

    problem: Problem = field(repr=False)
    state: BlockState = field(repr=False)
    structure: Structure = field(repr=False)
    convergence: Convergence
    vtpv: float
    redundancy: int
    sigma0: float | None
    v: Array = field(repr=False)
    r: Array = field(repr=False)
    deviations: Array = field(repr=False)
    warnings: tuple[str, ...]
    of_control: str | None
    robust: RobustPlace | None = field(repr=False)
    kept: AdjustedBlock | None = field(repr=False)

    @classmethod
    def of(cls, block: AdjustedBlock, *, keep: bool) -> BlockBefore:
        """Return what is told of an adjusted block, with or without that itself."""
        return cls(
            block.problem,
            block.state,
            block.cofactors.normal.structure,
            block.convergence,
            block.vtpv,
            block.redundancy,
            block.sigma0,
            block.v,
            block.cofactors.r,
            block.cofactors.point_deviations,
            block.warnings,
            block.of_control,
            block.robust,
            block if keep else None,
        )

    def whole(self) -> AdjustedBlock:
        """Return the whole adjustment, made anew where it was let go of."""
        if self.kept is not None:
            return self.kept
        equations = equations_at(self.problem, self.structure, self.state)
        found = Minimum(self.state, *equations, self.convergence)
        return evaluate(self.problem, found, robust=self.robust)
