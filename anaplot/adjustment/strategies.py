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
search
    The best set of rejected rows, found by adding, dropping and swapping rows.
odds
    The most probable set of errors, weighed against its neighbours, beginning with the search's.

In all of them but the last two, which do it by themselves, a rejected row comes back when the
standardized estimate of its error falls below the critical value. Of rows that are hard to tell
apart the likelier one goes (`partners`): of those that cannot be told apart at all that with the
largest redundancy number. What is weak by itself goes with the whole of its measurement, last of
all. None rejects more rows than half of the redundancy.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from math import sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import (
    AtEnd,
    Findings,
    HardToTell,
    Kind,
    ModelValues,
    Rejection,
    SearchSettings,
    Step,
)
from anaplot.adjustment.left import Left, remaining, spread
from anaplot.adjustment.pairodds import MOST_ROWS_OF_PAIRS, pair_odds, pair_odds_of
from anaplot.adjustment.partners import WEAK, Proposals
from anaplot.adjustment.reliability import (
    ERROR_PRIOR_SIGMAS,
    HARD_TO_TELL,
    Odds,
    error_odds,
)
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.reweighting import SETTLED, Reweighting, reweight
from anaplot.adjustment.search import search
from anaplot.adjustment.setodds import set_odds
from anaplot.adjustment.significance import TESTABLE, critical_normal, critical_tau
from anaplot.adjustment.stepwise import (
    MODEL_TOLERANCE,
    NO_SIGMA,
    ModelRule,
    bring_back,
    rule_of,
    stepwise,
)
from anaplot.adjustment.watch import Watch

__all__ = [
    "MOST_ROWS_OF_PAIRS",
    "STRATEGIES",
    "deciding_critical",
    "find_gross_errors",
    "findings_at",
    "pair_odds",
    "sigma_of",
]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

STRATEGIES = ("baarda", "tau", "rms", "modified", "huber", "danish", "search", "odds")
"""Names of all strategies."""

_EQUAL_R = 1e-6  # relative difference of redundancy numbers that is none
_FAR = 5.0  # widths of the prior of an error beyond which an error is not of it


def sigma_of(strategy: str) -> Kind:
    """Return by which sigma a strategy tests, and its odds are weighed."""
    return "tau" if strategy in ("tau", "rms") else "baarda"


def deciding_critical(strategy: str, alpha: float, redundancy: int) -> float | None:
    """Return the critical value of a strategy at a redundancy; None where there is none."""
    if sigma_of(strategy) == "tau":
        return critical_tau(alpha, redundancy)
    return critical_normal(alpha)


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
        system = Left(system, left_out)
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
    if strategy == "search":
        state, steps = search(system, critical, allowed, most, seen)
    elif strategy == "odds":
        state, steps, sure = _by_odds(system, critical, allowed, most, seen)
        if state.rows:
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
        state, steps = stepwise(system, rule, allowed, most, seen, together=strategy == "rms")
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
        system = Left(system, left_out)
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


def _by_odds(
    system: ResidualSystem, critical: float, suspects: Bools, most: int, watch: Watch
) -> tuple[Elimination, list[Step], int]:
    """Return the most probable set, how it was reached, and how many of its rows are sure."""
    state, steps = search(system, critical, suspects, most, watch)
    # what went as a whole measurement is no choice between single rows
    whole = {
        row for rows in Proposals(system.names).together(state).values() if rows[1:] for row in rows
    }
    rest = Left(system, whole) if whole else system
    odds = set_odds(
        rest,
        start=tuple(row for row in state.rows if row not in whole),
        suspects=suspects & (np.asarray(rest.r) >= WEAK),
        most=most - len(whole),
        widths=_widths(state),
        watch=watch,
    )
    best = {*odds.best, *whole}
    for row in [row for row in state.rows if row not in best]:
        before = state.vtpv
        state.drop(row)
        steps.append(Step("drop", (row,), None, None, before, state.vtpv))
    for row in [row for row in odds.best if row not in state.rows]:
        before = state.vtpv
        try:
            state.add(row)
        except NotSeparableError:
            continue
        steps.append(Step("add", (row,), None, None, before, state.vtpv))
    sure = {*odds.sure, *whole}
    return state, steps, len(sure & set(state.rows))


def _widths(state: Elimination) -> Array:
    """(n,) widths of the prior of each row's error, beginning with the set that is out.

    An error far beyond the usual width is one in its row, unless a partner explains it by a
    smaller one.
    """
    all_in = Elimination(state.system)
    r = all_in.r
    widths = np.full(len(r), ERROR_PRIOR_SIGMAS)
    for row, error in zip(state.rows, np.abs(state.estimates()[0]).tolist(), strict=True):
        if error <= _FAR * ERROR_PRIOR_SIGMAS:
            continue
        near = np.abs(np.nan_to_num(all_in.correlations(row))) >= HARD_TO_TELL
        if not (near & (r > r[row] * (1.0 + _EQUAL_R))).any():
            widths[row] = max(widths[row], error)
    return widths


def _robust(
    system: ResidualSystem,
    method: Literal["huber", "danish"],
    alpha: float,
    suspects: Bools,
    most: int,
    watch: Watch,
) -> tuple[Elimination, list[Step], Reweighting]:
    state, critical = Elimination(system), critical_normal(alpha)
    robust = reweight(system, method, suspects)
    rows = tuple(np.flatnonzero(robust.weights < 1.0).tolist())
    steps = [
        Step("reweight", rows, change, SETTLED, robust.sums[k], robust.sums[k + 1])
        for k, change in enumerate(robust.changes)
    ]
    size = np.where(suspects, np.abs(robust.misclosures), 0.0)
    proposals = Proposals(system.names)
    for first in np.argsort(-size, kind="stable").tolist():
        if size[first] <= critical or len(state.rows) >= most:
            break
        if not state.testable(first):
            continue
        rejected = proposals.instead(first, suspects, suspects, state)
        if not rejected or len(state.rows) + len(rejected) > most:
            continue
        before = state.vtpv
        for row in rejected:
            state.add(row)
        steps.append(Step("reject", rejected, float(size[first]), critical, before, state.vtpv))
    steps += bring_back(state, rule_of(method, alpha), watch)
    return state, steps, robust


def _findings(
    state: Elimination,
    strategy: str,
    steps: list[Step],
    settings: SearchSettings,
    *,
    weights: Array | None,
    values: ModelValues | None,
    remarks: tuple[str, ...],
    rows: NDArray[np.intp],
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
    at_end = AtEnd(w, at_end_r, sqrt(state.vtpv / f) if f > 0 else None, f, state.vtpv, weights)
    rejected, partners = _retrace(state, steps, settings.partner, estimated)
    size = np.full(len(e), np.nan)
    size[testable] = np.abs(e[testable]) / np.sqrt(r[testable])
    kind = sigma_of(strategy)
    ratio: Array | None = size
    if kind == "tau":
        s0 = sqrt(system.vtpv / system.redundancy) if system.redundancy > 0 else 0.0
        ratio = size / s0 if s0 > NO_SIGMA else None
    single = error_odds(r[rows], None if ratio is None else ratio[rows], system.redundancy, kind)
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
    steps: list[Step],
    limit: float,
    estimated: dict[int, tuple[float, float]],
) -> tuple[tuple[Rejection, ...], tuple[HardToTell, ...]]:
    """Find the step that took out each row, and how the residuals were correlated just before."""
    last: dict[int, tuple[int, Step]] = {}
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
