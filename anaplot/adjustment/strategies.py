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
standardized estimate of its error falls below the critical value. Of rows that cannot be told apart
but by rounding (`ties`) that with the largest redundancy number is rejected.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import suppress
from math import log, sqrt
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import (
    AtEnd,
    Findings,
    HardToTell,
    ModelValues,
    PairOdds,
    Rejection,
    SearchSettings,
    Step,
)
from anaplot.adjustment.left import Left
from anaplot.adjustment.reliability import (
    ERROR_PRIOR_SIGMAS,
    HARD_TO_TELL,
    NONE_PRIOR,
    Odds,
    beyond_model,
    error_odds,
)
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.reweighting import SETTLED, Reweighting, reweight
from anaplot.adjustment.search import largest, search
from anaplot.adjustment.setodds import set_odds
from anaplot.adjustment.significance import TESTABLE, critical_normal, critical_tau

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

MOST_ROWS_OF_PAIRS = 3000
"""Largest number of rows whose pairs are weighed."""


Kind = Literal["tau", "baarda"]
"""Whether a test takes sigma as estimated or as known a priori."""

_FAR = 5.0  # widths of the prior of an error beyond which an error is not of it
_NO_SIGMA = 1e-12  # sigma0 in a-priori sigmas below which residuals are rounding


def sigma_of(strategy: str) -> Kind:
    """Return by which sigma a strategy tests, and its odds are weighed."""
    return "tau" if strategy in ("tau", "rms") else "baarda"


def deciding_critical(strategy: str, alpha: float, redundancy: int) -> float | None:
    """Return the critical value of a strategy at a redundancy; None where there is none."""
    if sigma_of(strategy) == "tau":
        return critical_tau(alpha, redundancy)
    return critical_normal(alpha)


class _Test(NamedTuple):
    """Sizes of all rows given S (a rejected one: of its error estimate), and their limits."""

    size: Array
    limit: Array


_Rule = Callable[[Elimination], _Test]


def find_gross_errors(
    system: ResidualSystem,
    strategy: str,
    settings: SearchSettings | None = None,
    *,
    models: Array | None = None,
    tolerance: float = 0.25,
    suspects: Bools | None = None,
    left_out: Collection[int] = (),
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
    most = max(system.redundancy - 1, 0)
    if used.most is not None:
        most = min(most, used.most)
    critical = critical_normal(used.alpha)
    weights: Array | None = None
    values: ModelValues | None = None
    remarks: list[str] = []
    if strategy == "search":
        state, steps = search(system, critical, allowed, most)
    elif strategy == "odds":
        state, steps, sure = _by_odds(system, critical, allowed, most)
        if state.rows:
            remarks.append(f"more probably in error than not: {sure} of {len(state.rows)}")
    elif strategy in ("huber", "danish"):
        kind: Literal["huber", "danish"] = "huber" if strategy == "huber" else "danish"
        # weights that turn against most of the rows have broken down
        most = min(most, system.redundancy // 2)
        state, steps, robust = _robust(system, kind, critical, allowed, most)
        weights = robust.weights
        if not robust.converged:
            remarks.append(f"the weights did not settle in {len(robust.changes)} iterations")
    else:
        rule, counts = _rule(system, strategy, used.alpha, models, tolerance)
        state, steps = _stepwise(system, rule, allowed, most, together=strategy == "rms")
        if counts is not None:
            values = counts.values()
    if len(state.rows) >= most and most < system.redundancy:
        w = np.where(allowed, np.abs(state.w), np.nan)
        if np.nanmax(w, initial=0.0) > critical:
            remarks.append(f"stopped at {most} rejected rows; there may be more errors")
    return _findings(
        state,
        strategy,
        steps,
        used,
        weights=weights,
        values=values,
        remarks=tuple(remarks),
        rows=_others(n, left_out),
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
        rows=_others(len(system.e), left_out),
    )


def _by_odds(
    system: ResidualSystem, critical: float, suspects: Bools, most: int
) -> tuple[Elimination, list[Step], int]:
    """Return the most probable set, how it was reached, and how many of its rows are sure."""
    state, steps = search(system, critical, suspects, most)
    # more errors than half of the redundancy have other explanations as good
    room = min(most, system.redundancy // 2)
    odds = set_odds(
        system,
        start=state.rows,
        suspects=suspects & Elimination(system).testable_rows,
        most=room,
        widths=_widths(state),
    )
    for row in [row for row in state.rows if row not in odds.best]:
        before = state.vtpv
        with suppress(NotSeparableError):
            state.drop(row)
            steps.append(Step("drop", (row,), None, None, before, state.vtpv))
    for row in [row for row in odds.best if row not in state.rows]:
        before = state.vtpv
        try:
            state.add(row)
        except NotSeparableError:
            continue
        steps.append(Step("add", (row,), None, None, before, state.vtpv))
    return state, steps, len(set(odds.sure) & set(state.rows))


def _widths(state: Elimination) -> Array:
    """(n,) widths of the prior of each row's error, beginning with the set that is out.

    An error far beyond the usual width is one in its row, or in one that cannot be told from it.
    """
    all_in = Elimination(state.system)
    root = np.sqrt(np.maximum(all_in.r, TESTABLE))
    widths = np.full(len(root), ERROR_PRIOR_SIGMAS)
    for row, error in zip(state.rows, np.abs(state.estimates()[0]).tolist(), strict=True):
        if error <= _FAR * ERROR_PRIOR_SIGMAS:
            continue
        near = np.abs(np.nan_to_num(all_in.correlations(row))) >= HARD_TO_TELL
        near[row] = True
        # so large it would be there to show the same
        widths[near] = np.maximum(widths[near], error * root[row] / root[near])
    return widths


def _rule(
    system: ResidualSystem,
    strategy: str,
    alpha: float,
    models: Array | None,
    tolerance: float,
) -> tuple[_Rule, _ModelRule | None]:
    if strategy == "baarda":
        return _Normal(critical_normal(alpha)), None
    if strategy == "tau":
        return _Tau(alpha), None
    if strategy == "rms":
        return _Rms(alpha), None
    if models is None:
        raise ValueError("modified snooping needs model values of sqrt(q_vv) for the rows")
    if np.shape(models) != np.shape(system.e):
        raise ValueError(f"{np.size(models)} model values for {len(system.e)} rows")
    counts = _ModelRule(alpha, np.asarray(models, dtype=float), tolerance)
    return counts, counts


def _sizes(state: Elimination) -> Array:
    """Return (n,) abs(w) given S, of a rejected row that of its error estimate; NaN: no test."""
    size = np.abs(state.w)
    if state.rows:
        error, sigma = state.estimates()
        size[list(state.rows)] = np.abs(error) / sigma
    return size


class _Normal:
    """w against the normal distribution."""

    def __init__(self, critical: float) -> None:
        self._critical = critical

    def __call__(self, state: Elimination) -> _Test:
        size = _sizes(state)
        return _Test(size, np.full(len(size), self._critical))


class _Tau:
    """w / sigma0 against Pope's tau; a rejected row is judged as if it alone were back."""

    def __init__(self, alpha: float) -> None:
        self._alpha = alpha

    def __call__(self, state: Elimination) -> _Test:
        w = _sizes(state)
        f = state.redundancy
        size = np.full(len(w), np.nan)
        sigma = sqrt(state.vtpv / f) if f > 0 else 0.0
        if sigma > _NO_SIGMA:
            size = w / sigma
        limit = np.full(len(w), _or_none(critical_tau(self._alpha, f)))
        out = list(state.rows)
        if out:
            back = np.sqrt((state.vtpv + w[out] ** 2) / (f + 1))
            size[out] = w[out] / np.maximum(back, _NO_SIGMA)
            limit[out] = _or_none(critical_tau(self._alpha, f + 1))
        return _Test(size, limit)


class _Rms:
    """abs(v) / rms(v) of all remaining rows; a rejected row as if it alone were back."""

    def __init__(self, alpha: float) -> None:
        self._alpha = alpha

    def __call__(self, state: Elimination) -> _Test:
        e = np.abs(state.e)
        out = list(state.rows)
        n, f = len(e) - len(out), state.redundancy
        rms = sqrt(state.vtpv / n) if n > 0 else 0.0
        size = np.full(len(e), np.nan)
        testable = state.testable_rows
        if rms > _NO_SIGMA:
            size[testable] = e[testable] / rms
        limit = np.full(len(e), _or_none(critical_tau(self._alpha, f)))
        if out:
            error, sigma = state.estimates()
            gain = (error / sigma) ** 2
            back = np.sqrt((state.vtpv + gain) / (n + 1))
            size[out] = np.abs(error) / sigma**2 / np.maximum(back, _NO_SIGMA)
            limit[out] = _or_none(critical_tau(self._alpha, f + 1))
        return _Test(size, limit)


class _ModelRule:
    """w by model values of sqrt(q_vv) where they leave no doubt, exact where they do."""

    def __init__(self, alpha: float, models: Array, tolerance: float) -> None:
        self._critical = critical_normal(alpha)
        self._models, self._tolerance = models, tolerance
        self._computed = self._decided = 0
        self._wrong: tuple[tuple[int, ...], tuple[int, ...], int] | None = None

    def __call__(self, state: Elimination) -> _Test:
        exact = _sizes(state)
        size = exact.copy()
        remaining = np.ones(len(size), dtype=bool)
        remaining[list(state.rows)] = False
        root = self._models
        e = np.abs(state.e)
        known = remaining & np.isfinite(root)
        nothing = known & (root <= sqrt(TESTABLE))
        known &= ~nothing
        ratio = np.zeros(len(size))
        np.divide(e, root, out=ratio, where=known)
        above = known & (ratio > self._critical * (1.0 + self._tolerance))
        below = known & (ratio < self._critical * (1.0 - self._tolerance))
        sure = above | below
        size[sure] = ratio[sure]
        size[nothing] = np.nan
        doubtful = remaining & ~sure & ~nothing
        self._computed += int(doubtful.sum())
        self._decided += int((sure | nothing).sum())
        if self._wrong is None:
            by_model, by_exact = size > self._critical, exact > self._critical
            beyond = beyond_model(state.r, root, self._tolerance)
            self._wrong = (
                tuple(np.flatnonzero(by_exact & ~by_model).tolist()),
                tuple(np.flatnonzero(by_model & ~by_exact).tolist()),
                int(beyond.sum()),
            )
        return _Test(size, np.full(len(size), self._critical))

    def values(self) -> ModelValues:
        accepted, rejected, beyond = ((), (), 0) if self._wrong is None else self._wrong
        return ModelValues(self._computed, self._decided, accepted, rejected, beyond)


def _or_none(critical: float | None) -> float:
    return np.inf if critical is None else critical


def _stepwise(
    system: ResidualSystem, rule: _Rule, suspects: Bools, most: int, *, together: bool
) -> tuple[Elimination, list[Step]]:
    """Reject and bring back by a rule until it has nothing to say or a set comes again."""
    state = Elimination(system)
    steps: list[Step] = []
    seen = {frozenset[int]()}
    refused = np.zeros(len(suspects), dtype=bool)
    stays = np.zeros(len(suspects), dtype=bool)
    while True:
        test = rule(state)
        with np.errstate(invalid="ignore"):
            back = [k for k in state.rows if test.size[k] < test.limit[k] and not stays[k]]
            bad = suspects & ~refused & (test.size > test.limit)
        bad[list(state.rows)] = False
        if back:
            row = min(back, key=lambda k: test.size[k])
            if frozenset(state.rows) - {row} in seen:
                back = []
            else:
                before = state.vtpv
                try:
                    state.drop(row)
                except NotSeparableError:
                    stays[row] = True
                else:
                    steps.append(_step("drop", row, test, before, state.vtpv))
                    seen.add(frozenset(state.rows))
                continue
        if not bad.any() or len(state.rows) >= most:
            return state, steps
        order = np.flatnonzero(bad)
        order = order[np.argsort(-test.size[order], kind="stable")]
        first = largest(np.where(bad, test.size, np.nan), state)
        rows = order.tolist() if together or first is None else [first]
        taken: list[int] = []
        before = state.vtpv
        for row in rows[: most - len(state.rows)]:
            try:
                state.add(row)
            except NotSeparableError:
                refused[row] = True
            else:
                taken.append(row)
        if taken:
            limit = float(test.limit[taken[0]])
            smallest = float(test.size[taken].min())
            steps.append(Step("reject", tuple(taken), smallest, limit, before, state.vtpv))
        if frozenset(state.rows) in seen and taken:
            return state, steps
        seen.add(frozenset(state.rows))


def _step(action: Literal["drop"], row: int, test: _Test, before: float, after: float) -> Step:
    return Step(action, (row,), float(test.size[row]), float(test.limit[row]), before, after)


def _robust(
    system: ResidualSystem,
    method: Literal["huber", "danish"],
    critical: float,
    suspects: Bools,
    most: int,
) -> tuple[Elimination, list[Step], Reweighting]:
    state = Elimination(system)
    robust = reweight(system, method, suspects)
    rows = tuple(np.flatnonzero(robust.weights < 1.0).tolist())
    steps = [
        Step("reweight", rows, change, SETTLED, robust.sums[k], robust.sums[k + 1])
        for k, change in enumerate(robust.changes)
    ]
    size = np.where(suspects, np.abs(robust.misclosures), 0.0)
    for row in np.argsort(-size, kind="stable").tolist():
        if size[row] <= critical or len(state.rows) >= most:
            break
        before = state.vtpv
        try:
            state.add(row)
        except NotSeparableError:
            continue
        steps.append(Step("reject", (row,), float(size[row]), critical, before, state.vtpv))
    rule = _Normal(critical)
    stays: set[int] = set()
    while True:
        test = rule(state)
        back = [k for k in state.rows if test.size[k] < critical and k not in stays]
        if not back:
            break
        row = min(back, key=lambda k: test.size[k])
        before = state.vtpv
        try:
            state.drop(row)
        except NotSeparableError:
            stays.add(row)
        else:
            steps.append(_step("drop", row, test, before, state.vtpv))
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
        ratio = size / s0 if s0 > _NO_SIGMA else None
    single = error_odds(r[rows], None if ratio is None else ratio[rows], system.redundancy, kind)
    return Findings(
        strategy=strategy,
        steps=tuple(steps),
        rejected=rejected,
        hard_to_tell=partners,
        untestable=tuple(np.flatnonzero(~testable).tolist()),
        at_end=at_end,
        odds=Odds(_spread(single.rows, rows, len(r)), single.none),
        pair_odds=_pair_odds(system, rows, kind) if settings.pairs else None,
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


def _others(n: int, left_out: Collection[int]) -> NDArray[np.intp]:
    """Return the rows that are not left out."""
    there = np.ones(n, dtype=bool)
    there[list(left_out)] = False
    return np.flatnonzero(there)


def _spread(values: Array, rows: NDArray[np.intp], n: int) -> Array:
    """Return (n,) the values of some rows, zero in all others."""
    out = np.zeros(n)
    out[rows] = values
    return out


def pair_odds(
    system: ResidualSystem,
    most: int = 20,
    *,
    kind: Kind = "baarda",
    left_out: Collection[int] = (),
) -> PairOdds:
    """Weigh no, one and two gross errors against each other.

    Parameters
    ----------
    system
        All rows, at most `MOST_ROWS_OF_PAIRS`.
    most
        Number of pairs returned.
    kind
        "baarda": sigma known; "tau": sigma estimated, see `sigma_of`.
    left_out
        Rows that are out for good: not weighed.

    Notes
    -----
    Errors are normal, 20 standard deviations wide, independent of each other. Prior: none 0.9, and
    each further error a tenth as probable as the number before it: one 0.9 * 0.1 and two
    0.9 * 0.01, each shared equally by all rows or pairs, before all is divided by the sum. With
    R2 = R[(i, j), (i, j)], g = 400 and q = e2' (R2 + I / g)^-1 e2, sigma known:
    log BF = -log det(I + g R2) / 2 + q / 2.

    Sigma unknown, its prior 1 / sigma and the errors 20 of the true standard deviations wide: the
    residuals of f redundancies have the density sigma^-f det^-1/2 exp(-(v'Pv - q) / 2 sigma^2),
    which integrated over sigma gives
    log BF = -log det(I + g R2) / 2 - f / 2 log(1 - q / v'Pv).
    For one row these are the factors of `error_odds`.

    Raises
    ------
    ValueError
        Too many rows.
    NotSeparableError
        The other rows do not check one that is left out.
    """
    every = len(system.e)
    if every > MOST_ROWS_OF_PAIRS:
        raise ValueError(f"odds over pairs of {every} rows: at most {MOST_ROWS_OF_PAIRS}")
    rest = Left(system, left_out) if left_out else system
    return _pair_odds(rest, _others(every, left_out), kind, most)


def _log_factors(system: ResidualSystem, determinant: Array, square: Array, kind: Kind) -> Array:
    """Return log BF from det(I + g R) and q of sets of rows; zero where sigma does not exist."""
    if kind == "baarda":
        return -0.5 * np.log(determinant) + 0.5 * square
    f, vtpv = system.redundancy, system.vtpv
    if f < 1 or vtpv <= f * _NO_SIGMA**2:
        return np.zeros(len(square))
    # q cannot come nearer to v'Pv than this but for rounding
    share = np.minimum(square / vtpv, 1.0 - 1.0 / (1.0 + ERROR_PRIOR_SIGMAS**2))
    return -0.5 * np.log(determinant) - 0.5 * f * np.log1p(-share)


def _pair_odds(
    system: ResidualSystem, rows: NDArray[np.intp], kind: Kind, most: int = 20
) -> PairOdds:
    e, r = np.asarray(system.e, dtype=float)[rows], np.asarray(system.r, dtype=float)[rows]
    every, n = len(system.e), len(rows)
    g = ERROR_PRIOR_SIGMAS**2
    further = 1.0 - NONE_PRIOR
    own = r + 1.0 / g
    single = _log_factors(system, g * own, e**2 / own, kind) + log(further / max(n, 1))
    a, b = np.triu_indices(n, 1)
    logs = np.zeros(0)
    if n > 1:
        matrix = system.columns(rows)[rows]
        c = matrix[a, b]
        determinant = np.maximum(own[a] * own[b] - c * c, 1e-300)
        square = (e[a] ** 2 * own[b] - 2.0 * e[a] * e[b] * c + e[b] ** 2 * own[a]) / determinant
        logs = _log_factors(system, g * g * determinant, square, kind)
        logs += log(further**2 / len(a))
    top = max(0.0, float(single.max(initial=0.0)), float(logs.max(initial=0.0)))
    none, one, two = np.exp(-top), np.exp(single - top), np.exp(logs - top)
    total = float(none + one.sum() + two.sum())
    one, two = one / total, two / total
    best = np.argsort(-two, kind="stable")[:most]
    marginal = one + np.bincount(a, two, n) + np.bincount(b, two, n)
    return PairOdds(
        float(none) / total,
        _spread(one, rows, every),
        rows[a[best]],
        rows[b[best]],
        two[best],
        float(two.sum()),
        _spread(marginal, rows, every),
    )
