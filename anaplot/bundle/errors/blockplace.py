"""Where a block lies while it is cleaned, and what its equations there are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from anaplot.bundle.solve.gaussnewton import Convergence, Minimum, equations_at
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.solve.structure import Structure

__all__ = ["BlockPlace"]


@dataclass(frozen=True, eq=False)
class BlockPlace:
    """Where a block lies, and of a minimum what its equations are made of.

    Attributes
    ----------
    state
        Where it lies.
    reduced, structure, convergence
        The bundle whose minimum that is, the structure of its equations, and how it was found; None
        where the place was given.
    """

    state: BlockState
    reduced: Problem | None = None
    structure: Structure | None = None
    convergence: Convergence | None = None

    @classmethod
    def of(cls, found: Minimum) -> BlockPlace:
        """Return the place of a minimum."""
        normal = found.normal
        place = cls(found.state, normal.problem, normal.structure, found.convergence)
        vars(place)["found"] = found
        return place

    @cached_property
    def found(self) -> Minimum | None:
        """The minimum, its equations made anew where they were let go; None: it was given."""
        if self.reduced is None or self.structure is None or self.convergence is None:
            return None
        equations = equations_at(self.reduced, self.structure, self.state)
        return Minimum(self.state, *equations, self.convergence)

    @cached_property
    def cofactors(self) -> Cofactors | None:
        """Those of the minimum, in the datum of the solution; None where it was given."""
        if self.found is None:
            return None
        return compute_cofactors(self.found.normal, self.found.factor)

    def let_go(self) -> None:
        """Let go of what is as large as the block: it can be made anew."""
        for name in ("found", "cofactors"):
            vars(self).pop(name, None)
