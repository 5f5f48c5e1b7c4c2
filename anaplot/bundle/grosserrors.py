"""Gross errors of a block: a strategy on the linearised block, adjusted anew, until it stands.

Every pass sees all observations, linearised where the block lies without those that the pass
before rejected: a rejected one can come back, and its estimated error is what it is off from all
the others. A single coordinate is rejected alone; the other coordinate of its ray stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.findings import Findings, SearchSettings
from anaplot.adjustment.left import Left
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.strategies import (
    MOST_ROWS_OF_PAIRS,
    STRATEGIES,
    find_gross_errors,
    pair_odds,
)
from anaplot.bundle.adjust import adjust_block, evaluate
from anaplot.bundle.adjusted import AdjustedBlock
from anaplot.bundle.datum import anchor, check_datum
from anaplot.bundle.factor import NotPositiveError
from anaplot.bundle.minimum import Found, find_minimum, robust_state, undetermined
from anaplot.bundle.normal import NormalEquations, PointError, State, Structure, linearise
from anaplot.bundle.problem import Problem
from anaplot.bundle.residuals import BlockResiduals, ObservationName, Unit, block_residuals
from anaplot.bundle.snooping import PAPER_TOLERANCE, classify, estimate_models
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = [
    "BlockFindings",
    "Refused",
    "RejectedObservation",
    "block_gross_errors",
    "model_values",
    "without",
]

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

_MOST_PASSES = 30
_TORN = 4.0  # sigma0 from which a robust state is a second place to linearise at


class Refused(NamedTuple):
    """An observation that a strategy would reject, but without which the block is not determined.

    Attributes
    ----------
    name
        The observation.
    reason
        What would be left open.
    """

    name: ObservationName
    reason: str


class RejectedObservation(NamedTuple):
    """An observation that is left out at the end.

    Attributes
    ----------
    name
        ("image", photo, point, model, axis), ("control", point, axis), ("prior", photo, unknown).
    order
        Place among the actions that took it out, from 1; what went together shares it.
    statistic, critical
        What decided then, see `Step`.
    error, sigma
        Estimated gross error of the observed value and its a-priori standard deviation.
    unit
        Of both: "um", "m" or "rad".
    w
        error / sigma: its standardized residual when it alone comes back.
    r
        Its redundancy number then.
    redundancy_number
        When it was rejected.
    weight
        Factor of its weight at the end of a re-weighting; None without one.
    """

    name: ObservationName
    order: int
    statistic: float | None
    critical: float | None
    error: float | None
    sigma: float | None
    unit: Unit
    w: float | None
    r: float | None
    redundancy_number: float
    weight: float | None


@dataclass(frozen=True, slots=True, eq=False)
class BlockFindings:
    """A block without its gross errors, and how they were found.

    Attributes
    ----------
    block
        Adjusted without the rejected observations.
    first
        Adjusted with all of them.
    system
        All observations, linearised where the block lies at the end.
    passes
        What the strategy found in every pass; the last agrees with `block`.
    refused
        What could not be left out.
    remarks
        Sentences: what limited the search.
    settings
        Significance and limits.
    """

    block: AdjustedBlock
    first: AdjustedBlock
    system: BlockResiduals = field(repr=False)
    passes: tuple[Findings, ...] = field(repr=False)
    refused: tuple[Refused, ...]
    remarks: tuple[str, ...]
    settings: SearchSettings

    @property
    def findings(self) -> Findings:
        """The findings that hold."""
        return self.passes[-1]

    @property
    def rejected(self) -> tuple[RejectedObservation, ...]:
        """What is left out, in the order in which it went."""
        found, system = self.findings, self.system
        weights = found.at_end.weights
        out = []
        for row in found.rejected:
            sigma = float(system.sigma[row.row])
            w = float(found.at_end.w[row.row])
            r = float(found.at_end.r[row.row])
            out.append(
                RejectedObservation(
                    system.names[row.row],
                    row.order,
                    row.statistic,
                    row.critical,
                    None if row.error is None else row.error * sigma,
                    None if row.sigma is None else row.sigma * sigma,
                    system.units[row.row],
                    w if np.isfinite(w) else None,
                    r if np.isfinite(r) else None,
                    row.redundancy_number,
                    None if weights is None else float(weights[row.row]),
                )
            )
        return tuple(out)

    @property
    def came_back(self) -> tuple[ObservationName, ...]:
        """What some pass or step rejected and is in at the end."""
        rows: dict[int, None] = {}
        for found in self.passes:
            for step in found.steps:
                if step.action in ("add", "reject"):
                    rows.update(dict.fromkeys(step.rows))
                elif step.action == "swap":
                    rows[step.rows[0]] = None
        kept = set(self.findings.rows)
        return tuple(self.system.names[row] for row in rows if row not in kept)


def without(system: BlockResiduals, rows: frozenset[int]) -> Problem:
    """Return the bundle without some rows: image coordinates of weight zero, unknown control.

    Raises
    ------
    ValueError
        A prior on an additional parameter, which is no measurement.
    """
    problem = system.problem
    first, second, third = system.starts
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    control = problem.known_sigma.copy()
    position, rotation = problem.position_sigma.copy(), problem.rotation_sigma.copy()
    for row in sorted(rows):
        if row < first:
            rejected[divmod(row, 2)] = True
        elif row < second:
            control[tuple(system.control[row - first])] = np.nan
        elif row < third:
            photo, unknown = system.priors[row - second].tolist()
            (position if unknown < 3 else rotation)[photo, unknown % 3] = np.nan
        else:
            raise ValueError("a prior on an additional parameter cannot be rejected")
    return replace(
        problem,
        known_sigma=control,
        position_sigma=position,
        rotation_sigma=rotation,
        rejected=rejected if rejected.any() else None,
    )


def model_values(system: BlockResiduals) -> Array:
    """Return (n,) model values of sqrt(q_vv) for modified snooping, by classes of 1980.

    Estimated from a few exact ones of every class; NaN for control and priors, which have none.
    """
    out = np.full(len(system.names), np.nan)
    image = out[: system.image_rows].reshape(-1, 2)
    models = estimate_models(system.cofactors.normal, system.cofactors.factor)
    for kind, (rays, axis) in classify(system.problem).items():
        image[rays, axis] = models[kind].root
    return out


def block_gross_errors(
    block: Block | AdjustedBlock,
    strategy: str,
    settings: SearchSettings | None = None,
    *,
    control_only: bool = False,
    progress: Progress | None = None,
) -> BlockFindings:
    """Search a block for gross errors, adjust it without them, and search again until it stands.

    Parameters
    ----------
    block
        The block, or its adjustment (also with another datum or additional parameters); image
        coordinates rejected in it are looked at anew.
    strategy
        One of `STRATEGIES`.
    settings
        Significance, limits; None: alpha and power of the block's test.
    control_only
        Suspect control and priors alone; image coordinates rejected in the block stay rejected.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    InputError
        Odds over pairs of too many observations.
    NotComputableError
        The block cannot be adjusted, with all observations or at all.
    ValueError
        No such strategy.

    Notes
    -----
    Control free of error is not observed and thus never suspected; priors on additional
    parameters take part but are not rejected. Where the adjustment with all observations is torn
    (sigma0 above 4), a robust state is a second place to begin, and the better end counts: less
    v'Pv plus c^2 for every rejected row. Sets that come again without end are decided likewise.
    """
    if strategy not in STRATEGIES:
        raise ValueError(f"no strategy {strategy!r}; there are {', '.join(STRATEGIES)}")
    first = adjust_block(block, progress=progress) if isinstance(block, Block) else block
    problem = replace(first.problem, rejected=None)
    test = problem.test
    used = SearchSettings(alpha=test.alpha, power=test.power) if settings is None else settings
    n = problem.observations
    if used.pairs and n > MOST_ROWS_OF_PAIRS:
        raise InputError(
            f"block {problem.block.name}: odds over pairs of {n} observations: "
            f"at most {MOST_ROWS_OF_PAIRS}"
        )
    held = frozenset[int]()
    if control_only and first.problem.rejected is not None:
        held = frozenset(np.flatnonzero(first.problem.rejected).tolist())
    search = _Search(
        problem, first.cofactors.normal.structure, strategy, used, progress, held, control_only
    )
    # the first adjustment is the minimum without these, if there is such a set
    rows = held if control_only or first.problem.rejected is None else None
    end = search.run(first.state, rows, first.vtpv)
    if first.sigma0 is not None and first.sigma0 > _TORN:
        try:
            start = robust_state(problem, search.structure, first.state).state
            other = search.run(start, None, first.vtpv)
        except (NotComputableError, np.linalg.LinAlgError):
            pass  # the first end stands
        else:
            end = min(end, other, key=lambda found: found.score)
    findings = end.passes[-1]
    if used.pairs:
        findings = replace(findings, pair_odds=pair_odds(end.system))
    cleaned = first
    if end.found is not None:
        cleaned = evaluate(without(end.system, frozenset(findings.rows) | held), end.found)
    return BlockFindings(
        cleaned,
        first,
        end.system,
        (*end.passes[:-1], findings),
        end.refused,
        (*findings.remarks, *end.remarks),
        used,
    )


class _End(NamedTuple):
    """Where a search came to its end; no minimum when nothing changed."""

    found: Found | None
    system: BlockResiduals
    passes: tuple[Findings, ...]
    refused: tuple[Refused, ...]
    remarks: tuple[str, ...]
    score: float


class _Tried(NamedTuple):
    """A set of rejected rows: its minimum, and what proposed it."""

    found: Found | None
    system: BlockResiduals
    findings: Findings
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """Passes over a block, all with the same strategy."""

    problem: Problem
    structure: Structure
    strategy: str
    settings: SearchSettings
    progress: Progress | None
    held: frozenset[int] = frozenset()
    control_only: bool = False

    def run(self, state: State, rows: frozenset[int] | None, vtpv: float) -> _End:
        """Go on from a state, which may be the minimum without `rows` (none) and its v'Pv.

        Raises
        ------
        NotComputableError
            The block is not determined there, or without any set that was proposed.
        """
        cost = critical_normal(self.settings.alpha) ** 2
        barred: dict[int, Refused] = {}
        tried: dict[frozenset[int], _Tried] = {}
        passes: list[Findings] = []
        remarks: tuple[str, ...] = ()
        at: _Tried | None = None
        while True:
            system, findings = self._pass(state, barred, len(passes) + 1)
            passes.append(findings)
            proposed = frozenset(findings.rows) | self.held
            if proposed == rows:
                found, score = (None, vtpv) if at is None else (at.found, at.score)
                at = _Tried(found, system, findings, score)
                break
            if proposed in tried or len(passes) >= _MOST_PASSES:
                remarks = (
                    f"the rejected observations did not settle in {len(passes)} passes: "
                    "the best of the sets is kept",
                )
                at = min(tried.values(), key=lambda one: one.score, default=None)
                break
            try:
                found = self._minimum(without(system, proposed), state)
            except NotComputableError as error:
                # what was checked least of all is what the block cannot do without
                least = min(findings.rejected, key=lambda row: row.redundancy_number, default=None)
                if least is None:
                    raise
                barred[least.row] = Refused(system.names[least.row], str(error))
                continue
            score = found.convergence.last + cost * len(proposed)
            at = tried[proposed] = _Tried(found, system, findings, score)
            rows, state = proposed, found.state
        refused = tuple(barred.values())
        if at is None:
            raise NotComputableError(
                f"block {self.problem.block.name}: nothing that {self.strategy} rejects can be "
                f"left out: {refused[-1].reason}"
            )
        return _End(at.found, at.system, (*passes[:-1], at.findings), refused, remarks, at.score)

    def _pass(
        self, state: State, barred: dict[int, Refused], number: int
    ) -> tuple[BlockResiduals, Findings]:
        progress = self.progress
        label = f"gross errors, pass {number}"
        try:
            system = block_residuals(
                self.problem,
                state,
                self.structure,
                None if progress is None else (lambda f: progress(label, f)),
            )
        except (PointError, NotPositiveError) as error:
            raise self._open(self.problem, state, error) from error
        suspects = np.ones(len(system.names), dtype=bool)
        suspects[system.starts[2] :] = False
        suspects[list(barred)] = False
        suspects[: system.image_rows] &= not self.control_only
        findings = find_gross_errors(
            Left(system, self.held) if self.held else system,
            self.strategy,
            replace(self.settings, pairs=False),
            models=model_values(system) if self.strategy == "modified" else None,
            tolerance=PAPER_TOLERANCE,
            suspects=suspects,
        )
        return system, findings

    def _minimum(self, problem: Problem, state: State) -> Found:
        linear = linearise(problem, state)
        check_datum(problem, state, linear)
        tie = anchor(problem, state) if problem.defect else None
        try:
            weights = None if tie is None else tie.weights
            NormalEquations(problem, self.structure, linear, 0.0, weights).factor()
        except (PointError, NotPositiveError) as error:
            raise self._open(problem, state, error) from error
        return find_minimum(problem, state, self.structure, progress=self.progress, explain=False)

    def _open(
        self, problem: Problem, state: State, error: PointError | NotPositiveError
    ) -> NotComputableError:
        tie = anchor(problem, state) if problem.defect else None
        return undetermined(problem, self.structure, linearise(problem, state), tie, error)
