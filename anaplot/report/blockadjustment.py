"""An adjusted block with what was asked of it: the result of `adjust`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.report.correlations import RayPair
from anaplot.report.covariance import (
    AskedCovariance,
    Names,
    any_covariance,
)

if TYPE_CHECKING:
    from anaplot.adjustment.findings import Rejection
    from anaplot.bundle.errors.controllast import ControlLast
    from anaplot.bundle.errors.grosserrors import BlockFindings
    from anaplot.bundle.hypotheses.blockhypotheses import BlockHypotheses
    from anaplot.bundle.hypotheses.chosenparameters import ChosenParameters
    from anaplot.bundle.hypotheses.components import BlockComponents
    from anaplot.bundle.hypotheses.controlpages import ControlPage
    from anaplot.bundle.hypotheses.coordinatefunctions import FunctionValue
    from anaplot.bundle.hypotheses.errorsets import ErrorSetTest
    from anaplot.bundle.hypotheses.giventests import GivenTests
    from anaplot.bundle.hypotheses.offsettests import OffsetTests
    from anaplot.bundle.hypotheses.priorknowledge import BlockPrior
    from anaplot.bundle.solve.covariances import Covariance
    from anaplot.bundle.solve.observations import ObservationName
    from anaplot.bundle.thinning.thinning import Thinning
    from anaplot.photogrammetry.posterior import Posterior
    from anaplot.report.snooping import SnoopedBlock

__all__ = ["BlockAdjustment"]


@dataclass(frozen=True, slots=True, eq=False)
class BlockAdjustment:
    """An adjusted block with what was asked of it.

    Attributes
    ----------
    block
        The adjusted block, without what is rejected or thinned out: orientations, points, tested
        observations.
    hypotheses
        Tests of additional parameters, check points and control.
    errors
        What the strategy for gross errors found, with control; None without one.
    errors_without_control
        Both steps, where control came last.
    prior_estimate
        The variance factors of image coordinates and prior knowledge.
    components
        The variance components.
    snooping
        The modified data snooping beside the exact test.
    correlations
        Pairs of a point's rays whose residuals are correlated.
    test_sets, functions
        Tests of sets of observations, and functions of coordinates, as they were asked for.
    choice
        How additional parameters were chosen, where that was left to the program.
    given
        What the observations say to a prior from an earlier adjustment; None without one.
    posterior
        What was written for the next one; None where nothing was.
    asked_covariance
        What `covariance` asked for; the method of that name gives any other.
    offsets
        What the stated positions and angles have in common; None where nothing was asked for.
    control_pages
        Control and check points, each by itself; None where nobody asked.
    thinning
        Which points went, and what the block was with them; None where none were to go.
    """

    block: AdjustedBlock
    hypotheses: BlockHypotheses = field(repr=False)
    errors: BlockFindings | None = field(default=None, repr=False)
    errors_without_control: ControlLast | None = field(default=None, repr=False)
    prior_estimate: BlockPrior | None = field(default=None, repr=False)
    components: BlockComponents | None = field(default=None, repr=False)
    snooping: SnoopedBlock | None = field(default=None, repr=False)
    correlations: tuple[RayPair, ...] | None = field(default=None, repr=False)
    test_sets: tuple[ErrorSetTest, ...] = field(default=(), repr=False)
    functions: tuple[FunctionValue, ...] = field(default=(), repr=False)
    choice: ChosenParameters | None = field(default=None, repr=False)
    given: GivenTests | None = field(default=None, repr=False)
    posterior: Posterior | None = field(default=None, repr=False)
    asked_covariance: AskedCovariance | None = field(default=None, repr=False)
    offsets: OffsetTests | None = field(default=None, repr=False)
    control_pages: tuple[ControlPage, ...] | None = field(default=None, repr=False)
    thinning: Thinning | None = field(default=None, repr=False)

    def covariance(
        self,
        points: Names = (),
        photos: Names = (),
        parameters: Names = (),
        offsets: Names = (),
    ) -> Covariance:
        """Return the covariance of any unknowns with each other.

        Parameters
        ----------
        points, photos, parameters, offsets
            Names, or True for all; text is taken apart at its commas, a list is not. One unknown
            stands behind a colon: "7:Z", "101:omega", of parameters and offsets behind their group.

        Returns
        -------
        Covariance
            In this order; m and rad, of parameters and drifts their unit.

        Raises
        ------
        InputError
            What the adjusted block does not have, nothing at all, or more than 6000 unknowns.
        NotComputableError
            omega or kappa of a photo with phi at 90 degrees.
        """
        return any_covariance(self.block, points, photos, parameters, offsets)

    @property
    def rejected(self) -> tuple[Rejection[ObservationName], ...]:
        """What the strategy rejected, in its order."""
        first = self.errors_without_control
        images = () if first is None else first.images.rejected
        return images + (() if self.errors is None else self.errors.rejected)

    @property
    def points_left_out(self) -> tuple[str, ...]:
        """Points that the search left out with all of their rays."""
        return () if self.errors is None else self.errors.points
