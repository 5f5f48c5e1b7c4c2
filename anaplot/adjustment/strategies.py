"""Strategies for gross errors, chosen by name, on anything that can be seen as residuals.

baarda
    The largest w beyond its critical value is rejected, one row a step (Baarda 1968).
tau
    The same with the estimated sigma and Pope's critical value for the redundancy of the step.
rms
    abs(v) / rms(v) against that critical value, all beyond it at once (the Bayesian paper, eq. 4).
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

from collections.abc import Collection
from contextlib import suppress
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
from anaplot.adjustment.leastabsolute import least_absolute_residuals
from anaplot.adjustment.leftout import ReducedSystem, remaining, spread
from anaplot.adjustment.modelvalues import MODEL_TOLERANCE
from anaplot.adjustment.pairodds import MOST_ROWS_OF_PAIRS, pair_odds, pair_odds_of
from anaplot.adjustment.partners import WEAK, Proposals
from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.reweighting import SETTLED, Reweighting, reweight
from anaplot.adjustment.search import search
from anaplot.adjustment.setodds import MostProbableSet, most_probable_set, set_odds
from anaplot.adjustment.significance import TESTABLE, critical_normal
from anaplot.adjustment.stepwise import (
    NO_SIGMA,
    ModelRule,
    bring_back,
    rule_of,
    stepwise,
)
from anaplot.adjustment.tested import Odds, critical_value, error_odds, sigma0_known
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, Index, TestKind

__all__ = [
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
    tolerance: float = MODEL_TOLERANCE,
    suspects: Bools | None = None,
    left_out: Collection[int] = (),
    watch: Watch | None = None,
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
    tolerance
        k_q, the share by which an exact value may differ from its model value.
    suspects
        (n,) rows that may be rejected; None: all.
    left_out
        Rows that are out for good: neither tested nor weighed.
    watch
        Told how far it is; where it asks for the end, the best so far is returned.

    Raises
    ------
    ValueError
        No such strategy; "modified" without model values; too many rows for odds over pairs.
    NotSeparableError
        The other rows do not check one that is left out.
    """
    if strategy not in STRATEGIES:
        raise ValueError(f"no strategy {strategy!r}; there are {', '.join(STRATEGIES)}")
    used = SearchSettings() if settings is None else settings
    if left_out:
        system = ReducedSystem(system, left_out)
    n = len(system.e)
    if used.pairs and n > MOST_ROWS_OF_PAIRS:
        raise ValueError(f"odds over pairs of {n} rows: at most {MOST_ROWS_OF_PAIRS}")
    allowed = np.ones(n, dtype=bool) if suspects is None else np.asarray(suspects, dtype=bool)
    most = used.room(system.redundancy)
    seen = Watch() if watch is None else watch
    critical = critical_normal(used.alpha)
    rule = rule_of(strategy, used.alpha)
    weights: Array | None = None
    counts: ModelRule | None = None
    remarks: list[str] = []
    if strategy == "l1":
        state, steps = _by_least_absolute(system, used.alpha, allowed, most, seen, remarks)
    elif strategy == "search":
        start, _ = _by_least_absolute(system, used.alpha, allowed, most, seen, remarks)
        state, steps = search(system, critical, allowed, most, seen, start.rows)
    elif strategy == "odds":
        state, steps, weighed = _by_odds(system, used.alpha, allowed, most, seen, remarks)
        if state.rows:
            sure = len(set(weighed.sure(seen)).intersection(state.rows))
            remarks.append(f"more probably in error than not: {sure} of {len(state.rows)}")
    elif strategy in ("huber", "danish"):
        kind: Literal["huber", "danish"] = "huber" if strategy == "huber" else "danish"
        state, steps, robust = _robust(system, kind, used.alpha, allowed, most, seen)
        weights = robust.weights
        if not robust.converged:
            remarks.append(f"the weights did not settle in {len(robust.changes)} iterations")
    else:
        if strategy == "modified":
            if models is None:
                raise ValueError("modified snooping needs model values of sqrt(q_vv) for the rows")
            rule = counts = ModelRule(used.alpha, np.asarray(models, dtype=float), tolerance, n)
        state, steps = stepwise(
            Elimination(system), rule, allowed, most, seen, together=strategy == "rms"
        )
    if len(state.rows) >= most:
        w = np.where(allowed, np.abs(state.w), np.nan)
        if np.nanmax(w, initial=0.0) > critical:
            remarks.append(
                f"stopped at {most} rejected rows"
                + (", half of the redundancy" if used.most is None or most < used.most else "")
                + "; there may be more errors"
            )
    return _findings(
        state,
        strategy,
        steps,
        used,
        weights=weights,
        values=None if counts is None else counts.values(),
        remarks=tuple(remarks),
        rows=remaining(n, left_out),
    )


def findings_at(
    findings: Findings,
    system: ResidualSystem,
    settings: SearchSettings | None = None,
    *,
    left_out: Collection[int] = (),
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
    settings, left_out
        As `find_gross_errors` had them.
    """
    if left_out:
        system = ReducedSystem(system, left_out)
    state = Elimination(system)
    for rejected in findings.rejected:
        with suppress(NotSeparableError):  # nothing is said of what nothing checks any more
            state.add(rejected.row)
    return _findings(
        state,
        findings.strategy,
        list(findings.steps),
        SearchSettings() if settings is None else settings,
        weights=findings.at_end.weights,
        values=findings.model_values,
        remarks=findings.remarks,
        rows=remaining(len(system.e), left_out),
    )


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
    used, watch = SearchSettings() if settings is None else settings, Watch()
    allowed = np.ones(len(system.e), dtype=bool)
    most = used.room(system.redundancy)
    state, _, weighed = _by_odds(system, used.alpha, allowed, most, watch, [])
    return state.rows, weighed.sure(watch) if sure else ()


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
    allowed = np.ones(len(system.e), dtype=bool)
    most = settings.room(system.redundancy)
    return _go_on(system, size, settings.alpha, allowed, most, Watch())[0].rows


class _Weighed(NamedTuple):
    """What the odds were weighed of: `most_probable_set` of the rows that are single suspects."""

    rest: ResidualSystem
    critical: float
    found: MostProbableSet
    suspects: Bools
    most: int
    whole: frozenset[int]

    def sure(self, watch: Watch) -> tuple[int, ...]:
        """Return the rows that are more probably in error than not."""
        odds = set_odds(
            self.rest,
            self.critical,
            self.found,
            suspects=self.suspects,
            most=self.most,
            watch=watch,
        )
        return tuple(sorted({*odds.sure, *self.whole}))


def _by_odds(
    system: ResidualSystem,
    alpha: float,
    suspects: Bools,
    most: int,
    watch: Watch,
    remarks: list[str],
) -> tuple[Elimination, list[SearchStep], _Weighed]:
    """Return the most probable set, how it was reached, and what it was weighed of."""
    critical = critical_normal(alpha)
    ends = [
        _by_least_absolute(system, alpha, suspects, most, watch, remarks),
        # least absolute residuals give way to an error in a row that has a lever on many others
        stepwise(
            Elimination(system), rule_of("baarda", alpha), suspects, most, watch, together=False
        ),
    ]
    state, steps = min(ends, key=lambda end: end[0].vtpv + critical**2 * len(end[0].rows))
    # what is weak by itself, and went with its whole measurement, is no choice between single rows
    weak = [k for k, one in zip(state.rows, state.estimates()[1], strict=True) if one**-2 < WEAK]
    together = Proposals(system.names).together(state)
    whole = frozenset(row for k in weak for row in together[k])
    rest: ResidualSystem = ReducedSystem(system, whole) if whole else system
    single = suspects & (np.asarray(rest.r) >= WEAK)
    room = most - len(whole)
    found = most_probable_set(
        rest,
        critical,
        starts=((), *([row for row in end.rows if single[row]] for end, _ in ends)),
        suspects=single,
        most=room,
        watch=watch,
    )
    best = {*found.rows, *whole}
    for row in [row for row in state.rows if row not in best]:
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
    return state, steps, _Weighed(rest, critical, found, single, room, whole)


def _by_least_absolute(
    system: ResidualSystem,
    alpha: float,
    suspects: Bools,
    most: int,
    watch: Watch,
    remarks: list[str],
) -> tuple[Elimination, list[SearchStep]]:
    """Reject what the least absolute sum leaves beyond the critical value, then go on by w.

    Where it is not reached, begin with w, with a remark.
    """
    watch("least absolute sum", 0.0)
    try:
        size = np.abs(least_absolute_residuals(system))
    except ArithmeticError as error:
        remarks.append(f"{error}: begun with w")
        size = np.zeros(len(system.e))
    return _go_on(system, size, alpha, suspects, most, watch)


def _go_on(
    system: ResidualSystem, size: Array, alpha: float, suspects: Bools, most: int, watch: Watch
) -> tuple[Elimination, list[SearchStep]]:
    """Reject what is beyond the critical value, then reject and bring back by w."""
    state = Elimination(system)
    size = np.where(suspects, size, 0.0)
    steps = _reject_beyond(state, size, critical_normal(alpha), suspects, most)
    return stepwise(state, rule_of("l1", alpha), suspects, most, watch, steps=steps, together=False)


def _robust(
    system: ResidualSystem,
    method: Literal["huber", "danish"],
    alpha: float,
    suspects: Bools,
    most: int,
    watch: Watch,
) -> tuple[Elimination, list[SearchStep], Reweighting]:
    state, critical = Elimination(system), critical_normal(alpha)
    robust = reweight(system, method, suspects)
    rows = tuple(np.flatnonzero(robust.weights < 1.0).tolist())
    steps = [
        SearchStep("reweight", rows, change, SETTLED, robust.sums[k], robust.sums[k + 1])
        for k, change in enumerate(robust.changes)
    ]
    size = np.where(suspects, np.abs(robust.misclosures), 0.0)
    steps += _reject_beyond(state, size, critical, suspects, most)
    steps += bring_back(state, rule_of(method, alpha), watch)
    return state, steps, robust


def _reject_beyond(
    state: Elimination, size: Array, critical: float, suspects: Bools, most: int
) -> list[SearchStep]:
    """Reject the rows beyond a critical value, or their likelier partners, the largest first."""
    steps: list[SearchStep] = []
    proposals = Proposals(state.system.names)
    for first in np.argsort(-size, kind="stable").tolist():
        if size[first] <= critical or len(state.rows) >= most:
            break
        if not state.testable(first):
            continue
        rejected = proposals.instead(
            first, float(state.w[first] ** 2 - critical**2), suspects, suspects, state
        )
        if not rejected or len(state.rows) + len(rejected) > most:
            continue
        before = state.vtpv
        for row in rejected:
            state.add(row)
        steps.append(
            SearchStep("reject", rejected, float(size[first]), critical, before, state.vtpv)
        )
    return steps


def _findings(
    state: Elimination,
    strategy: str,
    steps: list[SearchStep],
    settings: SearchSettings,
    *,
    weights: Array | None,
    values: ModelValues | None,
    remarks: tuple[str, ...],
    rows: Index,
) -> Findings:
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
        w, at_end_r, sqrt(state.vtpv / f) if f > 0 else None, f, state.vtpv, weights
    )
    rejected, partners = _retrace(state, steps, settings.partner, estimated)
    size = np.full(len(e), np.nan)
    size[testable] = np.abs(e[testable]) / np.sqrt(r[testable])
    kind = sigma_of(strategy)
    if not sigma0_known(kind):
        s0 = sqrt(system.vtpv / system.redundancy) if system.redundancy > 0 else 0.0
        size = size / s0 if s0 > NO_SIGMA else np.full(len(e), np.nan)
    single = error_odds(ERROR_PRIOR_SIGMAS**2 * r[rows], size[rows], system.redundancy, kind)
    return Findings(
        strategy=strategy,
        steps=tuple(steps),
        rejected=rejected,
        hard_to_tell=partners,
        untestable=tuple(np.flatnonzero(~testable).tolist()),
        at_end=at_end,
        odds=Odds(spread(single.rows, rows, len(r)), single.none),
        pair_odds=pair_odds_of(system, rows, kind) if settings.pairs else None,
        model_values=values,
        remarks=remarks,
    )


def _retrace(
    state: Elimination,
    steps: list[SearchStep],
    limit: float,
    estimated: dict[int, tuple[float, float]],
) -> tuple[tuple[Rejection, ...], tuple[HardToTell, ...]]:
    """Find the step that took out each row, and how the residuals were correlated just before."""
    last: dict[int, tuple[int, SearchStep]] = {}
    for number, step in enumerate(steps):
        if step.action in ("add", "reject"):
            last.update((row, (number, step)) for row in step.rows)
        elif step.action == "swap":
            last[step.rows[0]] = (number, step)
    names = state.system.names
    out: list[Rejection] = []
    partners: list[HardToTell] = []
    ordered = sorted(state.rows, key=lambda row: (last[row][0], last[row][1].rows.index(row)))
    numbers = sorted({last[row][0] for row in ordered})
    chosen = np.zeros(len(names), dtype=bool)
    chosen[ordered] = True
    before = Elimination(state.system)
    for row in ordered:
        number, step = last[row]
        rho = before.correlations(row)
        for other in np.flatnonzero(np.abs(np.nan_to_num(rho)) >= limit).tolist():
            if not chosen[other]:
                partners.append(HardToTell(row, other, float(rho[other])))
        value, deviation = estimated[row]
        order = numbers.index(number) + 1
        out.append(
            Rejection(
                row,
                names[row],
                order,
                step.statistic,
                step.critical,
                value,
                deviation,
                float(before.r[row]),
            )
        )
        before.add(row)
    return tuple(out), tuple(partners)
