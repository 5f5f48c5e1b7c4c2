"""Strategies for gross errors, chosen by name, on anything that can be seen as residuals.

baarda
    The largest w beyond its critical value is rejected, one row a step (Baarda 1968).
tau
    The same with the estimated sigma and Pope's critical value for the redundancy of the step.
rms
    abs(v) / rms(v) against that critical value, all beyond it at once (the Bayesian paper, eq. 4);
    of rows that are known beforehand, v'Pv is counted and neither n nor n - u.
modified
    As baarda, with model values of sqrt(q_vv), exact ones only in doubt (Gruen 1980, eq. 9-11).
huber, danish
    Re-weighting to convergence; rejected is what then lies beyond the critical value of w.
l1
    What the least absolute sum of residuals leaves beyond the critical value of w, then w-tests.
search
    The best set of rejected rows, found by adding, dropping and swapping rows; one start is l1's.
odds
    The most probable set of errors, their sizes learned from the data, beginning with l1's set.

In all of them but the last two, which do that by themselves, a rejected row comes back when the
standardized estimate of its error falls below the critical value. Of rows that are hard to tell
apart the likelier one goes (`partners`): of those that cannot be told apart at all that with the
largest redundancy number. What is weak by itself goes with the whole of its measurement, last of
all. None rejects more rows than half of the redundancy.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import (
    FinalStatistics,
    Findings,
    HardToTell,
    ModelValues,
    Rejection,
    SearchSettings,
    SearchStep,
)
from anaplot.adjustment.foundapart import APART, Apart, found_apart, found_apart_at, stopped_at
from anaplot.adjustment.leastabsolute import least_absolute_residuals
from anaplot.adjustment.leftout import ReducedSystem, remaining, spread
from anaplot.adjustment.modelvalues import MODEL_TOLERANCE
from anaplot.adjustment.pairodds import MOST_ROWS_OF_PAIRS, pair_odds, pair_odds_of
from anaplot.adjustment.partners import WEAK, Proposals
from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.reweighting import Reweighting, robust_adjustment
from anaplot.adjustment.search import search
from anaplot.adjustment.setodds import MostProbableSet, most_probable_set, set_odds
from anaplot.adjustment.significance import TESTABLE, critical_normal
from anaplot.adjustment.stepwise import (
    NO_SIGMA,
    ModelRule,
    Rule,
    beyond_limit,
    bring_back,
    reject_sizes,
    rule_of,
    stepwise,
)
from anaplot.adjustment.tested import Odds, critical_value, error_odds, sigma0_known
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, Index, TestKind
from anaplot.errors import NotComputableError

__all__ = [
    "MOST_IN_COLUMNS",
    "MOST_ROWS_OF_PAIRS",
    "STRATEGIES",
    "deciding_critical",
    "find_gross_errors",
    "findings_at",
    "most_probable_rows",
    "pair_odds",
    "reject_beyond",
    "sigma_of",
]


STRATEGIES = ("baarda", "tau", "rms", "modified", "huber", "danish", "l1", "search", "odds")
"""Names of all strategies."""

MOST_IN_COLUMNS = 500_000_000
"""Rows rejected at once times rows: columns of 4 GB, of which eight or so are held at a time."""

_ROBUST = ("huber", "danish")
_EQUAL = 1e-10  # share of v'Pv of all rows: sums that differ by less are equal


def sigma_of(strategy: str) -> TestKind:
    """Return by which sigma a strategy tests, and its odds are weighed."""
    return "tau" if strategy in ("tau", "rms") else "baarda"


def deciding_critical(strategy: str, alpha: float, redundancy: int) -> float | None:
    """Return the critical value of a strategy at a redundancy; None where there is none."""
    return critical_value(sigma_of(strategy), alpha, redundancy)


def find_gross_errors(
    system: ResidualSystem,
    strategy: str,
    settings: SearchSettings | None = None,
    *,
    models: Array | None = None,
    suspects: Bools | None = None,
    left_out: Collection[int] = (),
    measured: int | None = None,
    idle: int = 0,
    watch: Watch | None = None,
    weigh: bool = True,
    apart: Apart | None = None,
    near: Collection[int] | None = None,
) -> Findings:
    """Search for gross errors in an adjustment.

    Parameters
    ----------
    system
        The adjustment with all rows.
    strategy
        One of `STRATEGIES`.
    settings
        Significance, limits; None: the defaults.
    models
        (n,) model values of sqrt(q_vv) in a-priori sigmas for "modified"; NaN: no model value,
        the exact one is computed.
    suspects
        (n,) rows that may be rejected; None: all.
    left_out
        Rows that are out for good: neither tested nor weighed.
    measured
        How many rows, the first ones, "rms" takes its root mean square and n - u of; None: all.
    idle
        How many of these are switched off, and are no observations.
    watch
        Told how far it is; where it asks for the end, the best so far is returned.
    weigh
        Whether "odds" says how many of its rows are sure, or leaves that to `Findings.weighed`.
    apart
        How rows that do not touch are cleaned apart, by the strategies that can (`APART`); None:
        as one.
    near
        What "danish" rejected where the rows were linearised near by: they have no weight to begin
        with. Empty: begin with the weights of "huber"; None: with ones. Apart what the place was
        found without has none, if there is any.

    Raises
    ------
    ValueError
        No such strategy; "modified" without model values; too many rows for odds over pairs.
    NotSeparableError
        The other rows do not check one that is left out.
    NotComputableError
        "l1", "huber" or "danish" would reject more at once than memory holds (`MOST_IN_COLUMNS`).
    """
    if strategy not in STRATEGIES:
        raise ValueError(f"no strategy {strategy!r}; there are {', '.join(STRATEGIES)}")
    used = SearchSettings() if settings is None else settings
    n, watch = len(system.names), Watch() if watch is None else watch
    suspects = np.ones(n, dtype=bool) if suspects is None else np.asarray(suspects, dtype=bool)
    if apart is not None and strategy in APART and not used.pairs:
        robust: Reweighting | None = None
        gives_way: tuple[type[Exception], ...] = ()
        if strategy in _ROBUST:
            # where all that is far off leaves something open, it goes one after another: as one
            gives_way = (NotComputableError, NotSeparableError)
            robust = _robust_apart(system, strategy, suspects, left_out, watch, apart, near)
        with suppress(*gives_way):
            return found_apart(system, strategy, used, suspects, left_out, watch, apart, robust)
    if left_out:
        system = ReducedSystem(system, left_out)
    if used.pairs and n > MOST_ROWS_OF_PAIRS:
        raise ValueError(f"odds over pairs of {n} rows: at most {MOST_ROWS_OF_PAIRS}")
    task = _Task.of(system, used, suspects, watch)
    weighed: _Weighed | None = None
    if strategy == "l1":
        end = _by_least_absolute(task)
    elif strategy == "search":
        start = _by_least_absolute(task)
        found = search(
            system, task.critical, task.suspects, task.most, task.watch, start.state.rows
        )
        end = _End(*found, start.remarks)
    elif strategy == "odds":
        end, weighed = _by_odds(task)
    elif strategy in _ROBUST:
        end = _robust(task, _method(strategy), near)
    elif strategy == "modified":
        if models is None:
            raise ValueError("modified snooping needs model values of sqrt(q_vv) for the rows")
        counts = ModelRule(used.alpha, np.asarray(models, dtype=float), MODEL_TOLERANCE, n)
        end = _End(*task.stepwise(counts), values=counts.values())
    else:
        rule = rule_of(strategy, used.alpha, measured, idle)
        end = _End(*task.stepwise(rule, together=strategy == "rms"))
    limited = task.limited(end.state, used.most)
    rows = remaining(n, left_out)
    findings = _findings(end._replace(remarks=(*end.remarks, *limited)), strategy, used, rows)
    if weighed is None or not findings.rows:
        return findings

    def with_sure() -> tuple[str, ...]:
        sure = len(set(weighed.sure()).intersection(findings.rows))
        said = f"more probably in error than not: {sure} of {len(findings.rows)}"
        return (*end.remarks, said, *limited)

    postponed = replace(findings, weigh=with_sure)
    return postponed.weighed if weigh else postponed


def findings_at(
    findings: Findings,
    system: ResidualSystem,
    settings: SearchSettings | None = None,
    *,
    left_out: Collection[int] = (),
    apart: Apart | None = None,
) -> Findings:
    """Say of the same rejected rows what is true of them in another linearisation.

    Estimates, redundancy numbers, partners and odds are those of `system`; the steps and what
    decided in them stay as they were.

    Parameters
    ----------
    findings
        Of a linearisation of the same rows in the same order.
    system
        The rows, linearised elsewhere.
    settings, left_out, apart
        As `find_gross_errors` had them.
    """
    if apart is not None and findings.strategy in APART:
        used = SearchSettings() if settings is None else settings
        return found_apart_at(findings, system, used, left_out, apart)
    if left_out:
        system = ReducedSystem(system, left_out)
    state = Elimination(system)
    for row in findings.rows:
        with suppress(NotSeparableError):  # nothing is said of what nothing checks any more
            state.add(row)
    there = _End(
        state,
        list(findings.steps),
        findings.remarks,
        findings.at_end.weights,
        findings.model_values,
    )
    used = SearchSettings() if settings is None else settings
    found = _findings(there, findings.strategy, used, remaining(len(system.e), left_out))
    return replace(found, weigh=findings.weigh)


def most_probable_rows(
    system: ResidualSystem, settings: SearchSettings | None = None, *, sure: bool = False
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return what "odds" rejects, without findings.

    Parameters
    ----------
    system
        All rows; each of them may be rejected.
    settings
        Significance, limits; None: the defaults.
    sure
        Whether the second part is wanted, too.

    Returns
    -------
    tuple of int
        The rows rejected.
    tuple of int
        The rows that more probably than not hold an error; empty where they are not wanted.
    """
    end, weighed = _by_odds(_Task.of(system, SearchSettings() if settings is None else settings))
    return end.state.rows, weighed.sure() if sure else ()


def reject_beyond(system: ResidualSystem, size: Array, settings: SearchSettings) -> tuple[int, ...]:
    """Return what is rejected by w-tests that begin with what is far off in a robust adjustment.

    Parameters
    ----------
    system
        All rows; each of them may be rejected.
    size
        (n,) absolute residuals of the robust adjustment [a-priori sigmas].
    settings
        Significance, limits.
    """
    return _go_on(_Task.of(system, settings), size)[0].rows


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What a strategy works on: the rows, the significance of one, and what it may reject.

    `suspects`: (n,) rows that may be rejected; `most`: how many of them.
    """

    system: ResidualSystem
    alpha: float
    suspects: Bools
    most: int
    watch: Watch

    @classmethod
    def of(
        cls,
        system: ResidualSystem,
        settings: SearchSettings,
        suspects: Bools | None = None,
        watch: Watch | None = None,
    ) -> _Task:
        """Return the task of a system: without suspects all rows are."""
        n = len(system.e)
        allowed = np.ones(n, dtype=bool) if suspects is None else np.asarray(suspects, dtype=bool)
        most = settings.room(system.redundancy)
        return cls(system, settings.alpha, allowed, most, Watch() if watch is None else watch)

    @property
    def critical(self) -> float:
        """Critical value of w."""
        return critical_normal(self.alpha)

    def stepwise(
        self,
        rule: Rule,
        state: Elimination | None = None,
        steps: Sequence[SearchStep] = (),
        *,
        together: bool = False,
    ) -> tuple[Elimination, list[SearchStep]]:
        """Reject and bring back by a rule; without a state all rows are in to begin with."""
        begun = Elimination(self.system) if state is None else state
        return stepwise(
            begun, rule, self.suspects, self.most, self.watch, steps=steps, together=together
        )

    def limited(self, state: Elimination, asked: int | None) -> tuple[str, ...]:
        """Return the remark that more than `most` rows may be wrong; `asked` for were so many."""
        if len(state.rows) < self.most:
            return ()
        w = np.where(self.suspects, np.abs(state.w), np.nan)
        if not np.nanmax(w, initial=0.0) > self.critical:
            return ()
        return (stopped_at(self.most, asked),)


class _End(NamedTuple):
    """Where a strategy ended, how it came there, and what limited it."""

    state: Elimination
    steps: list[SearchStep]
    remarks: tuple[str, ...] = ()
    weights: Array | None = None
    values: ModelValues | None = None


class _Weighed(NamedTuple):
    """What the odds were weighed of: `most_probable_set` of the rows that are single suspects."""

    task: _Task
    found: MostProbableSet
    whole: frozenset[int]

    def sure(self) -> tuple[int, ...]:
        """Return the rows that are more probably in error than not."""
        task = self.task
        odds = set_odds(
            task.system,
            task.critical,
            self.found,
            suspects=task.suspects,
            most=task.most,
            watch=task.watch,
        )
        return tuple(sorted({*odds.sure, *self.whole}))


def _by_odds(task: _Task) -> tuple[_End, _Weighed]:
    """Return the most probable set, how it was reached, and what it was weighed of."""
    system, cost = task.system, task.critical**2
    ends = [
        _by_least_absolute(task),
        # least absolute residuals give way to an error in a row that has a lever on many others
        _End(*task.stepwise(rule_of("baarda", task.alpha))),
    ]
    # mostly both are the same rows, and their sums differ by rounding: the first then
    first, other = (end.state.vtpv + cost * len(end.state.rows) for end in ends)
    best = ends[1] if other < first - _EQUAL * (1.0 + system.vtpv) else ends[0]
    state, steps = best.state, best.steps
    # what is weak by itself, and went with its whole measurement, is no choice between single rows
    weak = [k for k, one in zip(state.rows, state.estimates()[1], strict=True) if one**-2 < WEAK]
    together = Proposals(system.names).together(state)
    whole = frozenset(row for k in weak for row in together[k])
    rest: ResidualSystem = ReducedSystem(system, whole) if whole else system
    single = task.suspects & (np.asarray(rest.r) >= WEAK)
    of_single = replace(task, system=rest, suspects=single, most=task.most - len(whole))
    found = most_probable_set(
        rest,
        task.critical,
        starts=((), *([row for row in end.state.rows if single[row]] for end in ends)),
        suspects=single,
        most=of_single.most,
        watch=task.watch,
    )
    kept = {*found.rows, *whole}
    for row in [row for row in state.rows if row not in kept]:
        before = state.vtpv
        state.drop(row)
        steps.append(SearchStep("drop", (row,), None, None, before, state.vtpv))
    for row in [row for row in found.rows if row not in state.rows]:
        before = state.vtpv
        try:
            state.add(row)
        except NotSeparableError:
            continue
        steps.append(SearchStep("add", (row,), None, None, before, state.vtpv))
    return _End(state, steps, ends[0].remarks), _Weighed(of_single, found, whole)


def _by_least_absolute(task: _Task) -> _End:
    """Reject what the least absolute sum leaves beyond the critical value, then go on by w.

    Where it is not reached, begin with w, with a remark.
    """
    task.watch("least absolute sum", 0.0)
    try:
        size = np.abs(least_absolute_residuals(task.system))
    except ArithmeticError as error:
        return _End(*_go_on(task, np.zeros(len(task.system.e))), (f"{error}: begun with w",))
    return _End(*_go_on(task, size))


def _go_on(task: _Task, size: Array) -> tuple[Elimination, list[SearchStep]]:
    """Reject what is beyond the critical value, then reject and bring back by w."""
    state = Elimination(task.system)
    steps = _reject_beyond(task, state, size)
    return task.stepwise(rule_of("l1", task.alpha), state, steps)


def _method(strategy: str) -> Literal["huber", "danish"]:
    return "huber" if strategy == "huber" else "danish"


def _robust_apart(
    system: ResidualSystem,
    strategy: str,
    suspects: Bools,
    left_out: Collection[int],
    watch: Watch,
    apart: Apart,
    near: Collection[int] | None,
) -> Reweighting:
    """Re-weight as one what is rejected apart."""
    if strategy == "danish" and apart.without.begun:
        near = apart.without.begun  # it is known of these already, whichever pass it is
    return robust_adjustment(system, _method(strategy), suspects, watch, near, left_out)


def _robust(task: _Task, method: Literal["huber", "danish"], near: Collection[int] | None) -> _End:
    state = Elimination(task.system)
    robust = robust_adjustment(task.system, method, task.suspects, task.watch, near)
    steps = robust.steps
    steps += _reject_beyond(task, state, np.abs(robust.misclosures))
    steps += bring_back(state, task.critical, task.watch)
    return _End(state, steps, robust.remarks, robust.weights)


def _reject_beyond(task: _Task, state: Elimination, size: Array) -> list[SearchStep]:
    """Reject the suspects beyond the critical value, or their likelier partners, largest first."""
    critical, suspects, most = task.critical, task.suspects, task.most
    beyond = beyond_limit(size, critical, suspects)
    _check_memory(len(beyond[:most]), len(size))
    state.system.columns(beyond[:most])  # all of them at once
    return reject_sizes(state, size, beyond, critical, suspects, most, task.watch)


def _check_memory(rejected: int, n: int) -> None:
    if rejected * n > MOST_IN_COLUMNS:
        raise NotComputableError(
            f"{rejected} of {n} observations are to be rejected at once, whose columns take about "
            f"{8 * 8e-9 * rejected * n:.0f} GB of memory; baarda and search clean large blocks "
            "place by place"
        )


def _findings(end: _End, strategy: str, settings: SearchSettings, rows: Index) -> Findings:
    """Say what is true of a strategy's end; `rows` are those that were looked at."""
    state = end.state
    system = state.system
    r, e = np.asarray(system.r, dtype=float), np.asarray(system.e, dtype=float)
    testable = r >= TESTABLE
    error, sigma = state.estimates()
    estimated = dict(zip(state.rows, zip(error.tolist(), sigma.tolist(), strict=True), strict=True))
    w = state.w
    at_end_r = state.r
    for row, (value, deviation) in estimated.items():
        w[row], at_end_r[row] = value / deviation, deviation**-2
    f = state.redundancy
    at_end = FinalStatistics(
        w, at_end_r, sqrt(state.vtpv / f) if f > 0 else None, f, state.vtpv, end.weights
    )
    rejected, partners = _retrace(end, settings.partner, estimated)
    size = np.full(len(e), np.nan)
    size[testable] = np.abs(e[testable]) / np.sqrt(r[testable])
    kind = sigma_of(strategy)
    if not sigma0_known(kind):
        s0 = sqrt(system.vtpv / system.redundancy) if system.redundancy > 0 else 0.0
        size = size / s0 if s0 > NO_SIGMA else np.full(len(e), np.nan)
    single = error_odds(ERROR_PRIOR_SIGMAS**2 * r[rows], size[rows], system.redundancy, kind)
    return Findings(
        strategy=strategy,
        steps=tuple(end.steps),
        rejected=rejected,
        hard_to_tell=partners,
        untestable=tuple(np.flatnonzero(~testable).tolist()),
        at_end=at_end,
        odds=Odds(spread(single.rows, rows, len(r)), single.none),
        pair_odds=pair_odds_of(system, rows, kind) if settings.pairs else None,
        model_values=end.values,
        remarks=end.remarks,
    )


def _retrace(
    end: _End, limit: float, estimated: dict[int, tuple[float, float]]
) -> tuple[tuple[Rejection[Hashable], ...], tuple[HardToTell, ...]]:
    """Find the step that took out each row, and how the residuals were correlated just before."""
    state, weights = end.state, end.weights
    last: dict[int, tuple[int, SearchStep]] = {}
    for number, step in enumerate(end.steps):
        if step.action in ("add", "reject"):
            last.update((row, (number, step)) for row in step.rows)
        elif step.action == "swap":
            last[step.rows[0]] = (number, step)
    names = state.system.names
    out: list[Rejection[Hashable]] = []
    partners: list[HardToTell] = []
    ordered = sorted(state.rows, key=lambda row: (last[row][0], last[row][1].rows.index(row)))
    numbers = sorted({last[row][0] for row in ordered})
    chosen = np.zeros(len(names), dtype=bool)
    chosen[ordered] = True
    before = Elimination(state.system)
    for row in ordered:
        number, step = last[row]
        rho = before.correlations(row)
        alike = np.flatnonzero((np.abs(np.nan_to_num(rho)) >= limit) & ~chosen).tolist()
        partners += [HardToTell(row, other, float(rho[other])) for other in alike]
        out.append(
            Rejection(
                row,
                names[row],
                numbers.index(number) + 1,
                step.statistic,
                step.critical,
                *estimated[row],
                r=float(before.r[row]),
                weight=None if weights is None else float(weights[row]),
                partners=tuple(names[other] for other in alike),
            )
        )
        before.add(row)
    return tuple(out), tuple(partners)
