"""Rows rejected and brought back one by one, or together, by a rule until it changes nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.elimination import Elimination
from anaplot.adjustment.findings import ModelValues, SearchStep
from anaplot.adjustment.modelvalues import beyond_model, decide_by_model_values
from anaplot.adjustment.partners import Proposals
from anaplot.adjustment.significance import critical_normal, critical_tau
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, Index

__all__ = [
    "NO_SIGMA",
    "ModelRule",
    "Rule",
    "beyond_limit",
    "bring_back",
    "reject_sizes",
    "rule_of",
    "step_by_step",
    "stepwise",
]


NO_SIGMA = 1e-12
"""sigma0 in a-priori sigmas below which residuals are rounding."""


class _Test(NamedTuple):
    """Sizes of all rows given S (a rejected one: of its error estimate), and their limits."""

    size: Array
    limit: Array


Rule = Callable[[Elimination], _Test]
"""Sizes and limits of all rows in a strategy, given those that are out."""


def rule_of(strategy: str, alpha: float, measured: int | None = None, idle: int = 0) -> Rule:
    """Return the rule of a strategy, w with the a-priori sigma but for "tau" and "rms".

    With `measured`, "rms" counts that many rows, the first ones, but for so many of them as are
    `idle`; the others are known beforehand.
    """
    if strategy == "tau":
        return _Tau(alpha)
    if strategy == "rms":
        return _Rms(alpha, measured, idle)
    return _Normal(critical_normal(alpha))


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
        if sigma > NO_SIGMA:
            size = w / sigma
        limit = np.full(len(w), _or_none(critical_tau(self._alpha, f)))
        out = list(state.rows)
        if out:
            back = np.sqrt((state.vtpv + w[out] ** 2) / (f + 1))
            size[out] = w[out] / np.maximum(back, NO_SIGMA)
            limit[out] = _or_none(critical_tau(self._alpha, f + 1))
        return _Test(size, limit)


class _Rms:
    """abs(v) / rms(v) of all remaining rows; a rejected row as if it alone were back.

    What is known beforehand is in v'Pv, but neither in the n nor in the n - u of the Bayesian paper
    (eq. 4); where so much of it is known that n - u is nothing, it counts like the others.
    """

    def __init__(self, alpha: float, measured: int | None, idle: int) -> None:
        self._alpha, self._measured, self._idle = alpha, measured, idle

    def __call__(self, state: Elimination) -> _Test:
        e = np.abs(state.e)
        out = list(state.rows)
        n, f = len(e) - len(out), state.redundancy
        counted = np.ones(len(out), dtype=int)
        if self._measured is not None:
            known = len(e) - self._measured - sum(row >= self._measured for row in out)
            n -= self._idle
            if f > known:
                n, f = n - known, f - known
                counted[np.array(out, dtype=int) >= self._measured] = 0
        rms = sqrt(state.vtpv / n) if n > 0 else 0.0
        size = np.full(len(e), np.nan)
        testable = state.checked_rows
        if rms > NO_SIGMA:
            size[testable] = e[testable] / rms
        limit = np.full(len(e), _or_none(critical_tau(self._alpha, f)))
        if out:
            error, sigma = state.estimates()
            gain = (error / sigma) ** 2
            back = np.sqrt((state.vtpv + gain) / (n + counted))
            size[out] = np.abs(error) / sigma**2 / np.maximum(back, NO_SIGMA)
            limit[np.array(out)[counted > 0]] = _or_none(critical_tau(self._alpha, f + 1))
        return _Test(size, limit)


class ModelRule:
    """w by model values of sqrt(q_vv) where they leave no doubt, exact where they do."""

    def __init__(self, alpha: float, models: Array, tolerance: float, rows: int) -> None:
        if np.shape(models) != (rows,):
            raise ValueError(f"{np.size(models)} model values for {rows} rows")
        self._critical = critical_normal(alpha)
        self._models, self._tolerance = models, tolerance
        self._computed = self._decided = 0
        self._wrong: tuple[tuple[int, ...], tuple[int, ...], int] | None = None

    def __call__(self, state: Elimination) -> _Test:
        """Return sizes and limits given the rows that are out."""
        exact = _sizes(state)
        size = exact.copy()
        remaining = np.ones(len(size), dtype=bool)
        remaining[list(state.rows)] = False
        root = self._models
        e = np.abs(state.e)
        by = decide_by_model_values(e, root, self._critical, self._tolerance)
        sure = remaining & (by.rejected | by.accepted)
        nothing = remaining & by.untestable
        size[sure] = e[sure] / root[sure]
        size[nothing] = np.nan
        doubtful = remaining & by.doubtful
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
        """Return what was decided without exact values, and what differs from them."""
        accepted, rejected, beyond = ((), (), 0) if self._wrong is None else self._wrong
        return ModelValues(self._computed, self._decided, accepted, rejected, beyond)


def _or_none(critical: float | None) -> float:
    return np.inf if critical is None else critical


def stepwise(
    state: Elimination,
    rule: Rule,
    suspects: Bools,
    most: int,
    watch: Watch,
    *,
    steps: Sequence[SearchStep] = (),
    together: bool,
) -> tuple[Elimination, list[SearchStep]]:
    """Reject and bring back by a rule until it changes nothing or a set recurs.

    Parameters
    ----------
    state
        Where it begins; it is changed.
    rule
        Sizes and limits given the rows that are out.
    suspects
        (n,) rows that may be rejected.
    most
        Largest number of rows rejected.
    watch
        Told how far it is; asked whether to stop.
    steps
        How the beginning was reached.
    together
        Whether all rows beyond the limit go at once, not the largest alone.
    """
    return state, [*steps, *step_by_step(state, rule, suspects, most, watch, together=together)]


def step_by_step(
    state: Elimination,
    rule: Rule,
    suspects: Bools,
    most: int,
    watch: Watch,
    *,
    together: bool,
) -> Iterator[SearchStep]:
    """Yield the steps of `stepwise`, each when it is done: what is not asked for is not computed.

    Parameters
    ----------
    state, rule, suspects, most, watch, together
        As `stepwise` has them.
    """
    proposals = Proposals(state.system.names)
    seen = {frozenset(state.rows)}
    while not watch.stopped:
        watch("rejecting", len(state.rows) / max(most, 1))
        test = rule(state)
        back = _first_back(state, test, proposals, seen)
        if back:
            yield _drop(state, back, test)
            seen.add(frozenset(state.rows))
            continue
        with np.errstate(invalid="ignore"):
            bad = suspects & (test.size > test.limit)
        bad[list(state.rows)] = False
        taken: list[int] = []
        before = state.vtpv
        while bad.any() and len(state.rows) < most:
            rows = proposals.next(np.where(bad, test.size, np.nan), test.limit, suspects, state)
            if not rows or len(state.rows) + len(rows) > most:
                break
            for row in rows:
                state.add(row)
            taken += rows
            if not together:
                break
            bad[taken] = False
            bad &= state.checked_rows  # a partner of them has gone
        if not taken:
            break
        limit = float(test.limit[taken[0]])
        smallest = float(np.nanmin(test.size[taken]))
        yield SearchStep("reject", tuple(taken), smallest, limit, before, state.vtpv)
        if frozenset(state.rows) in seen:
            break
        seen.add(frozenset(state.rows))


def beyond_limit(size: Array, critical: float, suspects: Bools) -> Index:
    """Return the suspects whose (n,) sizes are beyond a critical value, the largest first."""
    rows = np.flatnonzero(suspects & (size > critical))
    return rows[np.argsort(-size[rows], kind="stable")]


def reject_sizes(
    state: Elimination,
    size: Array,
    beyond: Index,
    critical: float,
    suspects: Bools,
    most: int,
    watch: Watch,
) -> list[SearchStep]:
    """Reject rows one after another, or their likelier partners.

    Parameters
    ----------
    state, suspects, most, watch
        As `stepwise` has them.
    size
        (n,) absolute misclosures of a robust adjustment [a-priori sigmas].
    beyond
        Which of them are `beyond_limit`, in that order.
    critical
        The limit.
    """
    steps: list[SearchStep] = []
    proposals = Proposals(state.system.names)
    for k, first in enumerate(beyond.tolist()):
        if len(state.rows) >= most or watch.stopped:
            break
        watch("rejecting", k / len(beyond))
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


def bring_back(state: Elimination, critical: float, watch: Watch) -> list[SearchStep]:
    """Bring back the rows whose w is below a critical value, the smallest first, until none is.

    Of the rows that stay in nothing is asked meanwhile: with D = R_SS^-1 and z the estimated errors
    the return of row j leaves D - D[:, j] D[j, :] / D_jj and z - D[:, j] z_j / D_jj of the others,
    and raises v'Pv by z_j^2 / D_jj.
    """
    steps: list[SearchStep] = []
    proposals = Proposals(state.system.names)
    rows, vtpv, back = list(state.rows), state.vtpv, list[int]()
    error, inverse = state.correlated_estimates()
    while rows and not watch.stopped:
        watch("bringing back", len(back) / (len(back) + len(rows)))
        sigma = np.sqrt(np.diagonal(inverse))
        size = dict(zip(rows, (np.abs(error) / sigma).tolist(), strict=True))
        units = dict.fromkeys(proposals.together_of(rows, sigma).values())
        small = [unit for unit in units if all(size[k] < critical for k in unit)]
        if not small:
            break
        unit = min(small, key=lambda unit: max(size[k] for k in unit))
        before = vtpv
        for row in unit:
            j = rows.index(row)
            share, z = inverse[j] / inverse[j, j], error[j]
            vtpv += float(z * z / inverse[j, j])
            left = np.arange(len(rows)) != j
            error = (error - share * z)[left]
            inverse = (inverse - np.outer(share, inverse[j]))[np.ix_(left, left)]
            rows.pop(j)
        back += unit
        steps.append(SearchStep("drop", unit, max(size[k] for k in unit), critical, before, vtpv))
    state.drop_all(back)
    return steps


def _first_back(
    state: Elimination,
    test: _Test,
    proposals: Proposals,
    seen: Collection[frozenset[int]],
) -> tuple[int, ...]:
    """Return the row of S with the smallest size below its limit, and what comes back with it.

    Nothing whose return leads to a set that was there before.
    """
    out = frozenset(state.rows)
    if not (test.size < test.limit)[list(out)].any():
        return ()
    together = dict.fromkeys(proposals.together(state).values())
    small = [
        rows
        for rows in together
        if all(test.size[k] < test.limit[k] for k in rows) and out.difference(rows) not in seen
    ]
    return min(small, key=lambda rows: max(test.size[list(rows)]), default=())


def _drop(state: Elimination, rows: tuple[int, ...], test: _Test) -> SearchStep:
    """Bring rows back; the largest of them decided."""
    before = state.vtpv
    largest = max(rows, key=lambda row: float(test.size[row]))
    for row in rows:
        state.drop(row)
    size, limit = float(test.size[largest]), float(test.limit[largest])
    return SearchStep("drop", rows, size, limit, before, state.vtpv)
