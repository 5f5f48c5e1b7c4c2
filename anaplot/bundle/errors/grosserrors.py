"""Gross errors of a block: a strategy on the linearised block, adjusted anew, until it stands.

Every pass sees all observations, linearised where the block lies without those that the pass
before rejected: a rejected one can come back, and its estimated error is what it is off from all
the others. A single coordinate is rejected alone; the other coordinate of its ray stays.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.cleaning import Cleaning, CleaningEnd, SolvedWithout, best_of
from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import Findings, SearchSettings
from anaplot.adjustment.pairodds import MOST_ROWS_OF_PAIRS, pair_odds
from anaplot.adjustment.partners import WEAK
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.scale import (
    LARGEST,
    LEAST_REDUNDANCY,
    AprioriSigma,
    robust_scale,
    scale_error,
)
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.strategies import STRATEGIES, sigma_of
from anaplot.adjustment.tested import sigma0_known
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools
from anaplot.bundle.adjust import evaluate
from anaplot.bundle.errors.misfits import (
    PartialAdjustment,
    adjust_without_misfits,
    minimum_without_misfits,
)
from anaplot.bundle.errors.snooping import model_values
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import anchor, check_datum
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.gaussnewton import Minimum, NoConvergenceError, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.normal import NormalEquations, PointError, Structure, linearise
from anaplot.bundle.solve.observations import ObservationName, Unit
from anaplot.bundle.solve.openmovement import undetermined
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.residuals import BlockResiduals, block_residuals
from anaplot.bundle.start.robust import robust_state
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.pointchange import PointChange, point_change

__all__ = [
    "MOST_ROWS_OF_COLUMNS",
    "BlockFindings",
    "RefusedObservation",
    "RejectedObservation",
    "block_gross_errors",
    "without",
]


MOST_ROWS_OF_COLUMNS = 20_000
"""Observations of a block in which columns of R are held for a good part of them."""

_TORN = 4.0  # sigma0 from which a robust state is a second place to linearise at


class RefusedObservation(NamedTuple):
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
    r_rejected
        Its redundancy number when it was rejected.
    weight
        Factor of its weight at the end of a re-weighting; None without one.
    partners
        Observations that are kept and were hard to tell apart from it when it went.
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
    r_rejected: float
    weight: float | None
    partners: tuple[ObservationName, ...] = ()


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
    begun: PartialAdjustment
    system: BlockResiduals = field(repr=False)
    passes: tuple[Findings, ...] = field(repr=False)
    refused: tuple[RefusedObservation, ...]
    remarks: tuple[str, ...]
    settings: SearchSettings
    held: frozenset[int] = frozenset()
    kept_out: frozenset[int] = frozenset()

    @property
    def first(self) -> AdjustedBlock | None:
        """Adjusted with all observations but those held; None where that has no solution."""
        return None if self.begun.left_out else self.begun.block

    @property
    def point_change(self) -> PointChange | None:
        """What it did to the points [m]; None where there is no solution with all observations."""
        if self.first is None:
            return None
        place = {name: k for k, name in enumerate(self.block.problem.points)}
        names = [name for name in self.first.problem.points if name in place]
        old = [k for k, name in enumerate(self.first.problem.points) if name in place]
        new = [place[name] for name in names]
        before, after = self.first.state, self.block.state
        return point_change(
            names,
            before.points[old],
            after.points[new] + (after.origin - before.origin),
            (_deviations(self.first)[old], _deviations(self.block)[new]),
        )

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
            sigma = float(system.rows.sigma[row.row])
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
                    system.rows.units[row.row],
                    w if np.isfinite(w) else None,
                    r if np.isfinite(r) else None,
                    row.r,
                    None if weights is None else float(weights[row.row]),
                    tuple(
                        system.names[pair.kept]
                        for pair in found.hard_to_tell
                        if pair.rejected == row.row
                    ),
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
            unit, size, deviation = float(self.system.rows.sigma[row]), None, None
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
                    self.system.rows.units[row],
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


def _deviations(block: AdjustedBlock) -> Array:
    """(n, 3) standard deviations of the points [m], a-priori sigma0."""
    variances = np.einsum("nii->ni", block.cofactors.points)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def without(system: BlockResiduals, rows: frozenset[int]) -> Problem:
    """Return the bundle without some rows: image coordinates of weight zero, unknown control.

    Raises
    ------
    ValueError
        A prior on an additional parameter, which is no measurement.
    """
    problem = system.problem
    first, second, third = system.rows.starts
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    control = problem.known_sigma.copy()
    position, rotation = problem.position_sigma.copy(), problem.rotation_sigma.copy()
    for row in sorted(rows):
        if row < first:
            rejected[divmod(row, 2)] = True
        elif row < second:
            control[tuple(system.rows.control[row - first])] = np.nan
        elif row < third:
            photo, unknown = system.rows.priors[row - second].tolist()
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


def block_gross_errors(
    block: Block | Problem | AdjustedBlock,
    strategy: str,
    settings: SearchSettings | None = None,
    *,
    control_only: bool = False,
    as_given: bool = False,
    watch: Watch | None = None,
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
    as_given
        Search also where the residuals say that the a-priori sigma cannot be right.
    watch
        Told what is being done and how much of it; where it asks for the end, the best set of
        observations that was found so far is left out.

    Raises
    ------
    InputError
        Odds over pairs, re-weighting or odds of too many observations.
    ScaleError
        The a-priori sigma cannot be right, and the strategy tests by it.
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
        PartialAdjustment(block, (), "")
        if isinstance(block, AdjustedBlock)
        else adjust_without_misfits(problem, progress=watch)
    )
    first = begun.block
    held = frozenset[int]()
    if control_only and problem.rejected is not None:
        held = frozenset(np.flatnonzero(problem.rejected).tolist())
    watch = Watch() if watch is None else watch
    subject = _BlockRows(every, first.cofactors.normal.structure, watch, control_only=control_only)
    cleaning = Cleaning(
        subject,
        strategy,
        replace(used, pairs=False),
        watch,
        as_given,
    )
    # the first adjustment is the minimum without what is held, unless it lacks something else
    complete = not begun.left_out and (problem.rejected is None or control_only)
    end = _best_end(cleaning, subject, first, held, complete=complete)
    system, out = end.system, frozenset(subject.rows[name] for name in end.held)
    assert isinstance(system, BlockResiduals)
    findings = end.passes[-1]
    if used.pairs:
        odds = pair_odds(system, kind=sigma_of(strategy), left_out=out)
        findings = replace(findings, pair_odds=odds)
    cleaned, found = first, end.solved.solution.found
    if found is not None:
        cleaned = evaluate(without(system, frozenset(findings.rows) | out), found)
    return BlockFindings(
        cleaned,
        begun,
        system,
        (*end.passes[:-1], findings),
        tuple(RefusedObservation(refused.name, refused.reason) for refused in end.refused),
        (*findings.remarks, *end.remarks),
        used,
        held,
        out - held,
    )


class _BlockPlace(NamedTuple):
    """Where a block lies; the minimum that was found, None where it was given."""

    state: BlockState
    found: Minimum | None


_Names = frozenset[ObservationName]
_Solved = SolvedWithout[_BlockPlace, ObservationName]


class _BlockRows:
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
        self.apriori = AprioriSigma.image_um(f"block {block.name}", block.precision.image_um)

    def residuals(self, at: _BlockPlace, number: int) -> BlockResiduals:
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

    def without(self, out: _Names, near: _BlockPlace) -> _Solved:
        """Adjust without some rows."""
        assert self._system is not None
        problem = without(self._system, frozenset(self.rows[name] for name in out))
        found = self._minimum(problem, near.state)
        return SolvedWithout(_BlockPlace(found.state, found), found.convergence.last)

    def suspects(self, system: ResidualSystem) -> Bools:
        """Return which rows may be rejected: priors of additional parameters never."""
        assert isinstance(system, BlockResiduals)
        allowed = np.ones(len(system.names), dtype=bool)
        allowed[system.rows.starts[2] :] = False
        allowed[: system.rows.image] &= not self._control_only
        return allowed

    def model_values(self, system: ResidualSystem, at: _BlockPlace) -> Array:
        """Return model values by the classes of 1980."""
        assert isinstance(system, BlockResiduals)
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


def _check_scale_at(
    subject: _BlockRows, state: BlockState, first: AdjustedBlock, alpha: float
) -> None:
    """Complain where most residuals at a robust state are too large: no few errors make them so.

    Raises
    ------
    ScaleError
        They are; see `adjustment.scale`.
    """
    problem = subject.problem
    if problem.redundancy < LEAST_REDUNDANCY:
        return
    e = np.abs(linearise(problem, state).e.ravel())
    # about what a row of the block keeps of its error
    root = sqrt(problem.redundancy / problem.observations)
    scale = robust_scale(e / root, np.ones(len(e)))
    if scale is not None and scale > LARGEST:
        r = first.cofactors.r
        w = np.abs(first.v[r > WEAK]) / np.sqrt(r[r > WEAK])
        raise scale_error(subject.apriori, scale, float(w.max()) / critical_normal(alpha))


def _named(subject: _BlockRows, first: AdjustedBlock, rows: frozenset[int]) -> _Names:
    """Return the names of some rows; nothing is linearised for none."""
    if not rows:
        return frozenset()
    names = subject.residuals(_BlockPlace(first.state, None), 1).names
    return frozenset(names[row] for row in rows)


def _best_end(
    cleaning: Cleaning[_BlockPlace, ObservationName],
    subject: _BlockRows,
    first: AdjustedBlock,
    held: frozenset[int],
    *,
    complete: bool,
) -> CleaningEnd[_BlockPlace, ObservationName]:
    """Search from the first adjustment, and from a robust one where that is torn.

    Where no set that is found can be left out, what fits nowhere stays out for good. `held` are
    rows that stay out; `complete`: the first adjustment lacks no others.
    """
    problem, structure = subject.problem, subject.structure
    fixed = _named(subject, first, held)
    ends: list[CleaningEnd[_BlockPlace, ObservationName]] = []
    failures: list[NotComputableError] = []
    reduced = first.problem

    def go_on(state: BlockState, known: _Solved | None, out: _Names) -> None:
        try:
            ends.append(cleaning.run(_BlockPlace(state, None), known, out))
        except NotComputableError as error:
            failures.append(error)

    state = first.state
    here = _BlockPlace(state, None)
    known: _Solved | None = SolvedWithout(here, first.vtpv) if complete else None
    if first.sigma0 is not None and first.sigma0 > _TORN:
        start = first.state if first.robust is None else first.robust
        with suppress(np.linalg.LinAlgError):
            least = minimum_without_misfits(problem, structure, start)
            if least is None:
                start = robust_state(problem, structure, start).state
            else:
                reduced, start = least[0], least[1].state
            state = start
            if not cleaning.as_given and sigma0_known(sigma_of(cleaning.strategy)):
                _check_scale_at(subject, state, first, cleaning.settings.alpha)
            go_on(state, None, fixed)
    # a torn minimum is only gone on from where nothing better has come to an end
    torn = _TORN**2 * max(problem.redundancy, 1)
    if not any(end.settled and end.score <= torn for end in ends):
        go_on(first.state, known, fixed)
    kept_out = _missing(problem, reduced) - held
    if not ends and kept_out:
        go_on(state, None, fixed | _named(subject, first, kept_out))
    if not ends:
        raise failures[0]
    return best_of(ends)
