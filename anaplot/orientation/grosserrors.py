"""Gross errors of models and strips: a strategy's rejected rows out, oriented again, and so on."""

from __future__ import annotations

from collections.abc import Container
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import Findings, SearchSettings
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.strategies import find_gross_errors, findings_at
from anaplot.errors import NotComputableError
from anaplot.orientation.model import WrongPointsError, orient
from anaplot.orientation.modelvalues import ideal_roots
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.residuals import ModelResiduals, residual_system, residuals_at
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import BridgedStrip, bridge_strip
from anaplot.photogrammetry.block import Block, Precision, Strip, TestSettings

__all__ = [
    "CleanedModel",
    "CleanedStrip",
    "RejectedRow",
    "model_gross_errors",
    "strategy_findings",
    "strip_gross_errors",
]

Key = tuple[str, str]

_MOST_PASSES = 30
_TORN = 4.0  # sigma0 from which a cleaned orientation is a second place to begin


class RejectedRow(NamedTuple):
    """A row that is left out of a model.

    Attributes
    ----------
    point, axis
        The row.
    w
        Standardized residual it has when it alone comes back, a-priori sigma; None when the other
        rows cannot test it.
    parx_um
        Parallax at the row when it alone is back [um]; None likewise.
    redn
        Its redundancy number then; None likewise.
    order
        Place among the actions that took it out, from 1; 0 for a row that the strategy did not
        reject but that pulls the orientation away, or allows none.
    statistic, critical
        What decided, see `Step`; None without such a value.
    error_um
        Estimated gross error of the row [um]; None when the other rows cannot tell.
    """

    point: str
    axis: str
    w: float | None
    parx_um: float | None
    redn: float | None
    order: int
    statistic: float | None
    critical: float | None
    error_um: float | None


@dataclass(frozen=True, slots=True, eq=False)
class CleanedModel:
    """A model without the rows that a strategy rejects.

    Attributes
    ----------
    solution
        Oriented without them.
    residuals
        All rows, linearised at that orientation.
    passes
        What the strategy found in every pass among all rows; the last holds.
    rejected
        Rows left out, in the order of their rejection.
    begun_without
        Rows that had to be left out to find an orientation at all, or one that shows which rows
        are wrong.
    refused
        Rows that it would have rejected, but without which there is no orientation, and why.
    remarks
        What limited the search.
    held
        Rows that were left out to begin with and not looked at: the strategy cannot cope with them.
    """

    solution: ModelSolution
    residuals: ModelResiduals = field(repr=False)
    passes: tuple[Findings, ...] = field(repr=False)
    rejected: tuple[RejectedRow, ...]
    begun_without: tuple[Key, ...] = ()
    refused: tuple[tuple[Key, str], ...] = ()
    remarks: tuple[str, ...] = ()
    held: frozenset[Key] = frozenset()

    @property
    def findings(self) -> Findings:
        """The findings that hold."""
        return self.passes[-1]

    @property
    def came_back(self) -> tuple[Key, ...]:
        """Rows that were left out at the beginning, in some pass or step, and are in at the end."""
        keys = self.residuals.keys
        rows = dict.fromkeys(self.begun_without)
        for found in self.passes:
            rows.update(dict.fromkeys(keys[row] for row in found.taken_out))
        out = {(row.point, row.axis) for row in self.rejected}.union(key for key, _ in self.refused)
        return tuple(key for key in rows if key not in out)

    @property
    def hard_to_tell(self) -> tuple[tuple[Key, Key, float], ...]:
        """Rejected row, kept row, and the correlation of their residuals when the first went."""
        keys = self.residuals.keys
        out = {(row.point, row.axis) for row in self.rejected}
        pairs = ((keys[a], keys[b], rho) for a, b, rho in self.findings.hard_to_tell)
        return tuple(pair for pair in pairs if pair[1] not in out)


@dataclass(frozen=True, slots=True, eq=False)
class CleanedStrip:
    """A strip bridged without the rows that a strategy rejects.

    Attributes
    ----------
    bridged
        The strip as far as it could be bridged.
    models
        What was rejected in each of its models.
    """

    bridged: BridgedStrip
    models: tuple[CleanedModel, ...]


def strategy_findings(
    solution: ModelSolution, strategy: str, settings: SearchSettings | None = None
) -> Findings:
    """Run a strategy on a model as it is oriented.

    "modified" takes its model values from the ideal model with the same points.

    Raises
    ------
    ValueError
        No such strategy.
    """
    return find_gross_errors(
        residual_system(solution),
        strategy,
        settings,
        models=ideal_roots(solution) if strategy == "modified" else None,
    )


class _End(NamedTuple):
    """A model without the rows that were proposed, and without those it has no orientation with.

    `passes[-1]` proposed them, among `residuals`.
    """

    solution: ModelSolution
    out: tuple[Key, ...]
    residuals: ModelResiduals
    passes: tuple[Findings, ...]
    refused: tuple[tuple[Key, str], ...]
    settled: bool
    score: float
    held: frozenset[Key]


def model_gross_errors(
    pair: Stereopair,
    precision: Precision,
    test: TestSettings,
    strategy: str,
    settings: SearchSettings | None = None,
) -> CleanedModel:
    """Orient a model, reject, orient again, and look at all rows again until the set repeats.

    Parameters
    ----------
    pair, precision, test
        As `orient` has them; rows that are off stay off and are not reported.
    strategy, settings
        As `find_gross_errors` has them; None: the significance of the test.

    Raises
    ------
    NotComputableError
        The model cannot be oriented even so.
    ValueError
        No such strategy.

    Notes
    -----
    Where the orientation with all rows is torn (sigma0 above 4 a-priori sigmas), the one that the
    search ends with is a second place to begin. Where rows had to be left out to begin with, it is
    also tried what the strategy finds among the others alone: not every strategy can cope with
    errors so large. The best end counts: least v'Pv plus c^2 for every row that is out. Sets that
    come again without end are decided likewise.
    """
    used = SearchSettings(alpha=test.alpha, power=test.power) if settings is None else settings
    search = _Search(pair, precision, test, strategy, used)
    begun, wild = _oriented(pair, precision, test, frozenset())
    starts: list[tuple[_Search, ModelSolution, tuple[Key, ...] | None]] = [(search, begun, wild)]
    sigma0 = begun.sigma0_um
    if strategy != "search" and sigma0 is not None and sigma0 > _TORN * begun.apriori_um:
        with suppress(NotComputableError):
            clean = replace(search, strategy="search").run(begun, wild)
            starts.append((search, clean.solution, None))
    if wild:
        starts.append((replace(search, held=frozenset(wild)), begun, ()))
    ends: list[_End] = []
    failures: list[NotComputableError | NotSeparableError] = []
    for one, start, without in starts:
        try:
            ends.append(one.run(start, without))
        except (NotComputableError, NotSeparableError) as error:
            failures.append(error)
    if not ends:
        raise failures[0]
    end = min(ends, key=lambda one: round(one.score, 6))
    remarks = list(end.passes[-1].remarks)
    if not end.settled:
        remarks.append(
            f"the rejected rows did not settle in {len(end.passes) - 1} passes: the best of the "
            "sets is kept"
        )
    return CleanedModel(
        end.solution,
        end.residuals,
        end.passes,
        _rejected(end.residuals, end.passes[-1], end.out),
        wild,
        end.refused,
        tuple(remarks),
        end.held,
    )


@dataclass(frozen=True, slots=True)
class _Search:
    """Passes over a model, all with the same strategy."""

    pair: Stereopair
    precision: Precision
    test: TestSettings
    strategy: str
    settings: SearchSettings
    held: frozenset[Key] = frozenset()  # rows that are out and not looked at

    def run(self, start: ModelSolution, wild: tuple[Key, ...] | None) -> _End:
        """Go on from an orientation: the one without `wild` and what is held, or (None) any.

        Raises
        ------
        NotComputableError
            The model cannot be oriented without any of the sets that were proposed.
        """
        at = None if wild is None else self.held
        oriented = {} if wild is None else {self.held: (start, (*sorted(self.held), *wild))}
        proposals: dict[frozenset[Key], tuple[ModelResiduals, Findings]] = {}
        passes: list[Findings] = []
        barred: dict[Key, str] = {}
        solution = start
        while True:
            residuals = residuals_at(self.pair, self.precision, solution)
            found = self._pass(solution, residuals, barred)
            passes.append(found)
            keys = residuals.keys
            proposed = frozenset(keys[row] for row in found.rows) | self.held
            known = proposed in oriented and proposed in proposals
            proposals[proposed] = (residuals, found)
            if proposed == at:
                return self._end(
                    *oriented[proposed], residuals, found, passes[:-1], barred, settled=True
                )
            if known or len(passes) >= _MOST_PASSES:
                ends = [
                    self._end(*oriented[one], *self._there(oriented[one][0], *by), passes, barred)
                    for one, by in proposals.items()
                    if one in oriented
                ]
                if not ends:
                    raise NotComputableError(next(iter(barred.values())))
                return min(ends, key=lambda end: end.score)
            try:
                if proposed not in oriented:
                    oriented[proposed] = _oriented(self.pair, self.precision, self.test, proposed)
            except NotComputableError as error:
                # what was checked least of all is what the orientation cannot do without
                least = min(found.rejected, key=lambda row: row.redundancy_number, default=None)
                if least is None:
                    raise
                barred[keys[least.row]] = str(error)
                continue
            at, solution = proposed, oriented[proposed][0]

    def _pass(
        self, solution: ModelSolution, residuals: ModelResiduals, barred: Container[Key]
    ) -> Findings:
        keys = residuals.keys
        return find_gross_errors(
            residuals.system,
            self.strategy,
            self.settings,
            models=ideal_roots(solution, keys) if self.strategy == "modified" else None,
            suspects=np.array([key not in barred for key in keys]),
            left_out=[row for row, key in enumerate(keys) if key in self.held],
        )

    def _there(
        self, solution: ModelSolution, residuals: ModelResiduals, found: Findings
    ) -> tuple[ModelResiduals, Findings]:
        """Say of a set, proposed elsewhere, what is true of it at the orientation without it."""
        there = residuals_at(self.pair, self.precision, solution)
        if there.keys != residuals.keys:
            return residuals, found  # a tie that has lost its depth
        held = [row for row, key in enumerate(there.keys) if key in self.held]
        return there, findings_at(found, there.system, self.settings, left_out=held)

    def _end(
        self,
        solution: ModelSolution,
        out: tuple[Key, ...],
        residuals: ModelResiduals,
        found: Findings,
        before: list[Findings],
        barred: dict[Key, str],
        *,
        settled: bool = False,
    ) -> _End:
        left = residual_system(solution).vtpv
        score = left + critical_normal(self.settings.alpha) ** 2 * len(out)
        refused = tuple(barred.items())
        passes = (*before, found)
        return _End(solution, out, residuals, passes, refused, settled, score, self.held)


def strip_gross_errors(
    block: Block, strip: Strip, strategy: str, settings: SearchSettings | None = None
) -> CleanedStrip:
    """Bridge a strip; every model loses its rejected rows before the next one is tied to it.

    Raises
    ------
    ValueError
        No such strategy.
    """
    cleaned: list[CleanedModel] = []

    def form(pair: Stereopair) -> ModelSolution:
        model = model_gross_errors(pair, block.precision, block.test, strategy, settings)
        cleaned.append(model)
        return model.solution

    return CleanedStrip(bridge_strip(block, strip, form=form), tuple(cleaned))


def _rejected(
    residuals: ModelResiduals, found: Findings, out: tuple[Key, ...]
) -> tuple[RejectedRow, ...]:
    """Say of every row that is out why it went and what it shows when it alone comes back."""
    keys = residuals.keys
    known = {keys[row.row]: row for row in found.rejected}
    ordered = sorted(out, key=lambda key: known[key].order if key in known else 0)
    state = Elimination(residuals.system)
    for key in reversed(ordered):  # those that nobody asked to reject give way
        if key in keys:
            with suppress(NotSeparableError):
                state.add(keys.index(key))
    error, sigma = state.estimates()
    estimated = dict(zip(state.rows, zip(error.tolist(), sigma.tolist(), strict=True), strict=True))
    rows = []
    for key in ordered:
        because = known.get(key)
        order, statistic, critical = (
            (0, None, None)
            if because is None
            else (because.order, because.statistic, because.critical)
        )
        w = parx = redn = size = None
        at = keys.index(key) if key in keys else -1
        if at in estimated:
            value, deviation = estimated[at]
            unit = float(residuals.unit_um[at])
            w, redn, size = value / deviation, deviation**-2, value * unit
            parx = redn * size
        rows.append(RejectedRow(*key, w, parx, redn, order, statistic, critical, size))
    return tuple(rows)


def _oriented(
    pair: Stereopair, precision: Precision, test: TestSettings, rejected: frozenset[Key]
) -> tuple[ModelSolution, tuple[Key, ...]]:
    """Orient without some rows, and without those of points that allow no orientation.

    Those that are out are returned: the rejected ones first.
    """
    out = sorted(rejected)
    while True:
        try:
            solution = orient(replace(pair, off=pair.off | set(out)), precision, test)
        except WrongPointsError as error:
            new = _rows_of(pair, error.suspects[:1], out)
            if not new:
                raise
        else:
            new = _rows_of(pair, solution.outliers[:1], out)
            if not new:
                return solution, tuple(out)
        out += new


def _rows_of(pair: Stereopair, points: tuple[str, ...], out: list[Key]) -> list[Key]:
    rows = [(point, "y") for point in points]
    rows += [(point, "x") for point in points if pair.ties is not None and point in pair.ties]
    return [row for row in rows if row not in out and row not in pair.off]
