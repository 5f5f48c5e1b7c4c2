"""Gross errors of a block: a strategy on the linearised block, adjusted anew, until it stands.

Every pass sees all observations, linearised where the block lies without those that the pass
before rejected: a rejected one can come back, and its estimated error is what it is off from all
the others. A single coordinate is rejected alone; the other coordinate of its ray stays.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import Findings, SearchSettings
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.strategies import (
    MOST_ROWS_OF_PAIRS,
    STRATEGIES,
    find_gross_errors,
    findings_at,
    pair_odds,
    sigma_of,
)
from anaplot.bundle.adjust import evaluate
from anaplot.bundle.adjusted import AdjustedBlock
from anaplot.bundle.datum import anchor, check_datum
from anaplot.bundle.factor import NotPositiveError
from anaplot.bundle.minimum import Found, NoConvergenceError, find_minimum
from anaplot.bundle.normal import NormalEquations, PointError, State, Structure, linearise
from anaplot.bundle.openmovement import undetermined
from anaplot.bundle.problem import Problem, make_problem
from anaplot.bundle.rescue import Fitting, adjust_what_fits, minimum_of_what_fits
from anaplot.bundle.residuals import BlockResiduals, ObservationName, Unit, block_residuals
from anaplot.bundle.robust import robust_state
from anaplot.bundle.snooping import PAPER_TOLERANCE, classify, estimate_models
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = [
    "MOST_ROWS_OF_COLUMNS",
    "BlockFindings",
    "Refused",
    "RejectedObservation",
    "block_gross_errors",
    "model_values",
    "without",
]

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

_MOST_PASSES = 30  # that ended in a minimum
_MOST_REFUSED = 100
_MOST_WILD = 5  # proposed sets without which there is no minimum either
MOST_ROWS_OF_COLUMNS = 20_000
"""Observations of a block in which columns of R are held for a good part of them."""

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
    begun
        Adjusted with all of them but those held; where that has no solution, with all that fit.
        The search has looked at the others as well.
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
    held
        Rows that were rejected before and that it did not look at.
    kept_out
        Rows rejected because no solution was found with them, whatever else was left out.
    """

    block: AdjustedBlock
    begun: Fitting
    system: BlockResiduals = field(repr=False)
    passes: tuple[Findings, ...] = field(repr=False)
    refused: tuple[Refused, ...]
    remarks: tuple[str, ...]
    settings: SearchSettings
    held: frozenset[int] = frozenset()
    kept_out: frozenset[int] = frozenset()

    @property
    def first(self) -> AdjustedBlock | None:
        """Adjusted with all observations but those held; None where that has no solution."""
        return None if self.begun.left_out else self.begun.block

    @property
    def findings(self) -> Findings:
        """The findings that hold."""
        return self.passes[-1]

    @property
    def rejected(self) -> tuple[RejectedObservation, ...]:
        """What is left out, in the order in which it went; what was kept out has the order 0."""
        found, system = self.findings, self.system
        weights = found.at_end.weights
        out = self._kept_out_rows()
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

    def _kept_out_rows(self) -> list[RejectedObservation]:
        """Return what was kept out, its errors estimated without all that is rejected."""
        if not self.kept_out:
            return []
        state = Elimination(self.system)
        for row in sorted(self.held | self.kept_out | set(self.findings.rows)):
            with suppress(NotSeparableError):
                state.add(row)
        error, sigma = state.estimates()
        known = dict(zip(state.rows, zip(error.tolist(), sigma.tolist(), strict=True), strict=True))
        out = []
        for row in sorted(self.kept_out):
            unit, size, deviation = float(self.system.sigma[row]), None, None
            if row in known:
                size, deviation = known[row]
            out.append(
                RejectedObservation(
                    self.system.names[row],
                    0,
                    None,
                    None,
                    None if size is None else size * unit,
                    None if deviation is None else deviation * unit,
                    self.system.units[row],
                    None if size is None or deviation is None else size / deviation,
                    None if deviation is None else deviation**-2,
                    float(self.system.r[row]),
                    None,
                )
            )
        return out

    @property
    def untestable(self) -> tuple[ObservationName, ...]:
        """What nothing checks, with all observations in."""
        out = self.held | self.kept_out
        return tuple(self.system.names[k] for k in self.findings.untestable if k not in out)

    @property
    def came_back(self) -> tuple[ObservationName, ...]:
        """What some pass or step rejected and is in at the end."""
        rows = dict.fromkeys(row for found in self.passes for row in found.taken_out)
        kept = {*self.findings.rows, *self.kept_out}
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


def _missing(problem: Problem, reduced: Problem) -> frozenset[int]:
    """Return the rows that a smaller bundle lacks: image coordinates, control and priors."""
    rejected = reduced.rejected
    rows: set[int] = set() if rejected is None else set(np.flatnonzero(rejected).tolist())
    start = 2 * len(problem.photo)
    for sigma, left in (
        (problem.known_sigma, reduced.known_sigma),
        (problem.prior_sigma, reduced.prior_sigma),
    ):
        observed = np.isfinite(sigma)
        rows.update((start + np.flatnonzero(np.isnan(left[observed]))).tolist())
        start += int(observed.sum())
    return frozenset(rows)


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
    block: Block | Problem | AdjustedBlock,
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
        The block, or the bundle made of it (also with another datum or additional parameters), or
        its adjustment; image coordinates rejected there are looked at anew.
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
        Odds over pairs, re-weighting or odds of too many observations.
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
    if isinstance(block, AdjustedBlock):
        problem = block.problem
    else:
        problem = make_problem(block) if isinstance(block, Block) else block
    every = replace(problem, rejected=None)
    test = problem.test
    used = SearchSettings(alpha=test.alpha, power=test.power) if settings is None else settings
    n = every.observations
    for asked, what, most in (
        (used.pairs, "odds over pairs", MOST_ROWS_OF_PAIRS),
        (strategy in ("huber", "danish", "odds"), strategy, MOST_ROWS_OF_COLUMNS),
    ):
        if asked and n > most:
            raise InputError(
                f"block {problem.block.name}: {what} of {n} observations: at most {most}"
            )
    begun = (
        Fitting(block, (), "")
        if isinstance(block, AdjustedBlock)
        else adjust_what_fits(problem, progress=progress)
    )
    first = begun.block
    held = frozenset[int]()
    if control_only and problem.rejected is not None:
        held = frozenset(np.flatnonzero(problem.rejected).tolist())
    search = _Search(
        every, first.cofactors.normal.structure, strategy, used, progress, held, control_only
    )
    # the first adjustment is the minimum without what is held, unless it lacks something else
    complete = not begun.left_out and (problem.rejected is None or control_only)
    end = search.best_end(first, held if complete else None)
    findings = end.passes[-1]
    if used.pairs:
        odds = pair_odds(end.system, kind=sigma_of(strategy), left_out=end.held)
        findings = replace(findings, pair_odds=odds)
    cleaned = first
    if end.found is not None:
        cleaned = evaluate(without(end.system, frozenset(findings.rows) | end.held), end.found)
    return BlockFindings(
        cleaned,
        begun,
        end.system,
        (*end.passes[:-1], findings),
        end.refused,
        (*findings.remarks, *end.remarks),
        used,
        held,
        end.held - held,
    )


class _End(NamedTuple):
    """Where a search came to its end; no minimum when nothing changed."""

    found: Found | None
    system: BlockResiduals
    passes: tuple[Findings, ...]
    refused: tuple[Refused, ...]
    remarks: tuple[str, ...]
    score: float
    held: frozenset[int]
    settled: bool

    def fits(self, problem: Problem) -> bool:
        """Whether it is no torn minimum any more."""
        return self.score <= _TORN**2 * max(problem.redundancy, 1)


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

    def best_end(self, first: AdjustedBlock, rows: frozenset[int] | None) -> _End:
        """Search from the first adjustment, and from a robust one where that is torn.

        Where no set that is found can be left out, what fits nowhere stays out for good.
        """
        ends: list[_End] = []
        failures: list[NotComputableError] = []
        reduced = first.problem

        def go_on(search: _Search, state: State, rows: frozenset[int] | None) -> None:
            try:
                ends.append(search.run(state, rows, first.vtpv))
            except NotComputableError as error:
                failures.append(error)

        state = first.state
        if first.sigma0 is not None and first.sigma0 > _TORN:
            start = first.state if first.robust is None else first.robust
            with suppress(np.linalg.LinAlgError):
                least = minimum_of_what_fits(self.problem, self.structure, start)
                if least is None:
                    start = robust_state(self.problem, self.structure, start).state
                else:
                    reduced, start = least[0], least[1].state
                state = start
                go_on(self, state, None)
        # a torn minimum is only gone on from where nothing better has come to an end
        if not any(end.settled and end.fits(self.problem) for end in ends):
            go_on(self, first.state, rows)
        kept_out = _missing(self.problem, reduced) - self.held
        if not ends and kept_out:
            go_on(replace(self, held=self.held | kept_out), state, None)
        if not ends:
            raise failures[0]
        return min(ends, key=lambda end: end.score)

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
        wild = 0
        while True:
            system, findings = self._pass(state, barred, len(passes) + 1)
            passes.append(findings)
            proposed = frozenset(findings.rows) | self.held
            if proposed == rows:
                found, score = None, vtpv + cost * len(proposed)
                if at is not None:
                    found, score = at.found, at.score
                at = _Tried(found, system, findings, score)
                break
            if proposed in tried or len(tried) >= _MOST_PASSES or len(barred) > _MOST_REFUSED:
                remarks = (
                    f"the rejected observations did not settle in {len(passes)} passes: "
                    "the best of the sets is kept",
                )
                at = min(tried.values(), key=lambda one: one.score, default=None)
                if at is not None and at.found is not None:
                    at = self._seen_at_its_end(at, at.found.state, len(passes) + 1)
                break
            try:
                found = self._minimum(without(system, proposed), state)
            except NotComputableError as error:
                wild += isinstance(error, NoConvergenceError)
                # what was checked least of all is what the block cannot do without
                least = min(findings.rejected, key=lambda row: row.redundancy_number, default=None)
                if least is None or wild > _MOST_WILD:
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
        every = (*passes[:-1], at.findings)
        settled = not remarks
        return _End(at.found, at.system, every, refused, remarks, at.score, self.held, settled)

    def _pass(
        self, state: State, barred: dict[int, Refused], number: int
    ) -> tuple[BlockResiduals, Findings]:
        system = self._residuals(state, number)
        suspects = np.ones(len(system.names), dtype=bool)
        suspects[system.starts[2] :] = False
        suspects[list(barred)] = False
        suspects[: system.image_rows] &= not self.control_only
        findings = find_gross_errors(
            system,
            self.strategy,
            replace(self.settings, pairs=False),
            models=model_values(system) if self.strategy == "modified" else None,
            tolerance=PAPER_TOLERANCE,
            suspects=suspects,
            left_out=self.held,
        )
        return system, findings

    def _residuals(self, state: State, number: int) -> BlockResiduals:
        progress = self.progress
        label = f"gross errors, pass {number}"
        try:
            return block_residuals(
                self.problem,
                state,
                self.structure,
                None if progress is None else (lambda f: progress(label, f)),
            )
        except (PointError, NotPositiveError) as error:
            raise self._open(self.problem, state, error) from error

    def _seen_at_its_end(self, tried: _Tried, state: State, number: int) -> _Tried:
        """Say of a set, proposed elsewhere, what is true of it at the minimum without it."""
        system = self._residuals(state, number)
        settings = replace(self.settings, pairs=False)
        findings = findings_at(tried.findings, system, settings, left_out=self.held)
        return tried._replace(system=system, findings=findings)

    def _minimum(self, problem: Problem, state: State) -> Found:
        linear = linearise(problem, state)
        check_datum(problem, state, linear)
        tie = anchor(problem, state) if problem.defect else None
        try:
            weights = None if tie is None else tie.weights
            NormalEquations(problem, self.structure, linear, 0.0, weights).factor()
        except (PointError, NotPositiveError) as error:
            raise self._open(problem, state, error) from error
        return find_minimum(problem, state, self.structure, progress=self.progress)

    def _open(
        self, problem: Problem, state: State, error: PointError | NotPositiveError
    ) -> NotComputableError:
        tie = anchor(problem, state) if problem.defect else None
        return undetermined(problem, self.structure, linearise(problem, state), tie, error)
