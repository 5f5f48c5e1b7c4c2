"""Step by step: image coordinates cleaned under prior knowledge, and only then the control.

Errors of image coordinates and of control hide behind each other. Without control the image
coordinates are checked by each other and by the priors of the orientations alone; what is clean
then judges the control (the Bayesian paper's step-by-step technique).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.watch import Watch
from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.errors.grosserrors import BlockFindings, block_gross_errors
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import priors_hold, with_priors_kept
from anaplot.bundle.solve.imaging import with_additional
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.remade import with_priors_of, with_rejected_of
from anaplot.bundle.start.approximate import laid_onto_control
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = ["ControlLast", "clean_control_last"]


@dataclass(frozen=True, slots=True, eq=False)
class ControlLast:
    """Both steps.

    Attributes
    ----------
    images
        The block without control, in the datum of its priors or as a free network, also in what
        these leave open: what is wrong in image coordinates and priors.
    control
        The block with control and conditions between points and without those image coordinates:
        what is wrong in either.
    datum
        What held the first step: "priors"; "free" where those of photos do not determine all of a
        datum; "partly free" where priors of points or given ones, which always stay, leave some of
        it open.
    """

    images: BlockFindings
    control: BlockFindings
    datum: str

    @property
    def block(self) -> AdjustedBlock:
        """Adjusted without all that is rejected."""
        return self.control.block


def clean_control_last(
    block: Block,
    strategy: str,
    settings: SearchSettings | None = None,
    *,
    additional: AdditionalParameters | None = None,
    as_given: bool = False,
    watch: Watch | None = None,
) -> ControlLast:
    """Clean the image coordinates without control, then bring the control in and clean that.

    Parameters
    ----------
    block
        The block; its control has standard deviations, as nothing free of error can be wrong.
    strategy, settings
        As `block_gross_errors` has them.
    additional
        Additional parameters, in both steps.
    as_given, watch
        As `block_gross_errors` has them.

    Raises
    ------
    InputError
        There is no weighted control.
    NotComputableError
        One of the steps cannot be computed.
    ValueError
        No such strategy.
    """
    weighted = [
        c
        for c in block.control
        if c.use == "control"
        and any(
            value is not None and s > 0.0 for value, s in zip(c.xyz, block.sigma_of(c), strict=True)
        )
    ]
    if not weighted:
        raise InputError(
            f"block {block.name}: no control with standard deviations that could be brought in"
        )
    bare = replace(
        block,
        control=tuple(replace(c, use="off") for c in block.control),
        conditions=(),
    )
    images, datum = _without_control(
        bare, strategy, settings, additional, as_given=as_given, watch=watch
    )
    free = images.block.problem
    problem = make_problem(block, additional=additional, undetermined=free.undetermined)
    problem = with_rejected_of(problem, free)
    if datum != "free":
        # a prior rejected without control stays so
        problem = with_priors_of(problem, free)
    control = block_gross_errors(
        problem, strategy, settings, control_only=True, as_given=as_given, watch=watch
    )
    return ControlLast(images, control, datum)


def _without_control(
    bare: Block,
    strategy: str,
    settings: SearchSettings | None,
    additional: AdditionalParameters | None,
    *,
    as_given: bool,
    watch: Watch | None,
) -> tuple[BlockFindings, str]:
    """Clean in the datum of the priors, or free as far as they do not hold one."""

    def cleaned(begin: Problem | AdjustedBlock, how: str) -> BlockFindings:
        try:
            return block_gross_errors(begin, strategy, settings, as_given=as_given, watch=watch)
        except NotComputableError as error:
            raise NotComputableError(f"without control, {how}: {error}") from error

    problem = make_problem(bare, additional=additional)
    if priors_hold(problem):
        return cleaned(problem, "in the datum of the priors"), "priors"
    network = cleaned(make_problem(bare, datum="free", additional=additional), "as a free network")
    if problem.given is None and not np.isfinite(problem.expected_sigma).any():
        return network, "free"
    undetermined = network.block.problem.undetermined
    problem = make_problem(bare, additional=additional, undetermined=undetermined)
    begin = _onto_priors(problem, network.block, watch)
    datum = "priors" if begin.problem.left_open is None else "partly free"
    return cleaned(begin, "held by the priors as far as they go"), datum


def _onto_priors(problem: Problem, network: AdjustedBlock, watch: Watch | None) -> AdjustedBlock:
    """Adjust a clean free network anew, with the priors and free in what they leave open.

    Parameters
    ----------
    problem
        The bundle in the datum of its priors.
    network
        The free network, without what is rejected.
    watch
        As `block_gross_errors` has it.
    """
    free = network.problem
    state = laid_onto_control(problem, free, network.state, some=True)
    if state is None:
        raise NotComputableError(
            f"without control: block {problem.block.name}: what priors know of points cannot be "
            "joined to the free network"
        )
    kept = with_rejected_of(with_priors_kept(problem, state), network.problem)
    return adjust_bundle(kept, with_additional(problem, state), progress=watch)
