"""What is said of rows that were cleaned apart: as of those cleaned as one, place by place."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterator, Sequence
from itertools import chain
from math import log, sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.apart import ApartEnd, clean_apart
from anaplot.adjustment.elimination import testable
from anaplot.adjustment.findings import (
    FinalStatistics,
    Findings,
    HardToTell,
    Rejection,
    SearchSettings,
    SearchStep,
)
from anaplot.adjustment.leftout import remaining, spread
from anaplot.adjustment.places import Places
from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS, NONE_PRIOR
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.reweighting import Reweighting
from anaplot.adjustment.robustapart import far_off
from anaplot.adjustment.significance import TESTABLE, critical_normal
from anaplot.adjustment.tested import Odds, error_odds, log_bayes_factor
from anaplot.adjustment.watch import Watch
from anaplot.adjustment.withoutrows import RowsGiven, WithoutRows, places_without, standardized
from anaplot.aliases import Array, Bools, Index

__all__ = ["APART", "Apart", "found_apart", "found_apart_at", "stopped_at"]


APART = ("baarda", "search", "huber", "danish")
"""Strategies that clean rows apart."""

_FAR_MORE = 40.0  # log of how much more probable the row that is far off is than all else


class Apart(NamedTuple):
    """How rows that do not touch are cleaned apart.

    Attributes
    ----------
    without
        Adjusts without some rows.
    draft
        Whether what is found is but the next place to linearise at, not the end.
    """

    without: WithoutRows
    draft: bool = False


def stopped_at(most: int, asked: int | None) -> str:
    """Return the remark that more rows than `most` may be wrong; `asked` for were so many."""
    why = ", half of the redundancy" if asked is None or most < asked else ""
    return f"stopped at {most} rejected rows{why}; there may be more errors"


def found_apart(
    system: ResidualSystem,
    strategy: str,
    settings: SearchSettings,
    suspects: Bools,
    left_out: Collection[int],
    watch: Watch,
    apart: Apart,
    robust: Reweighting | None = None,
) -> Findings:
    """Search for gross errors, rows that do not touch apart.

    Parameters
    ----------
    system, strategy, settings, suspects, left_out, watch, apart
        As `find_gross_errors` has them; the strategy is one of `APART`.
    robust
        What "huber" and "danish" begin with: what this leaves far off goes, and comes back.
    """
    most = settings.room(system.redundancy - len(left_out))
    going, begin = suspects, None
    if robust is not None:
        begin = far_off(apart.without, robust, settings.alpha, suspects, most, left_out)
        going = np.zeros_like(suspects)
    end = clean_apart(
        apart.without,
        going,
        most,
        settings.alpha,
        watch,
        held=left_out,
        draft=apart.draft,
        best=strategy == "search",
        begin=begin,
    )
    if robust is not None:
        remarks = (*robust.remarks, *end.remarks)
        end = end._replace(steps=[*_named_last(robust.steps), *end.steps], remarks=remarks)
    if len(end.rows) >= most:
        size = np.where(suspects, standardized(end.given, [*end.rows, *left_out]), np.nan)
        size[[*end.rows, *left_out]] = np.nan
        if np.nanmax(size, initial=0.0) > critical_normal(settings.alpha):
            end = end._replace(remarks=(*end.remarks, stopped_at(most, settings.most)))
    # of a pass that changes something nobody asks for more than what it rejects
    same = {*end.rows, *left_out} == {*apart.without.begun, *left_out}
    last = not end.rows if apart.draft else same
    weights = None if robust is None else robust.weights
    return _findings(system, strategy, settings, suspects, left_out, apart, end, weights, last=last)


def _named_last(steps: list[SearchStep]) -> list[SearchStep]:
    """Return re-weightings of which the last alone names the rows, which are the same in all.

    A hundred times tens of thousands of them would be more than all else that is told.
    """
    return [*(step._replace(rows=()) for step in steps[:-1]), *steps[-1:]]


def found_apart_at(
    findings: Findings,
    system: ResidualSystem,
    settings: SearchSettings,
    left_out: Collection[int],
    apart: Apart,
) -> Findings:
    """Say of the same rejected rows what is true of them in another linearisation."""
    rows = tuple(sorted(findings.rows))
    given = apart.without.adjusted(sorted({*rows, *left_out}))
    end = ApartEnd(given, rows, list(findings.steps), findings.remarks)
    every, weights = np.ones(len(system.names), dtype=bool), findings.at_end.weights
    strategy = findings.strategy
    return _findings(system, strategy, settings, every, left_out, apart, end, weights, last=True)


def _findings(
    system: ResidualSystem,
    strategy: str,
    settings: SearchSettings,
    allowed: Bools,
    left_out: Collection[int],
    apart: Apart,
    end: ApartEnd,
    weights: Array | None,
    *,
    last: bool,
) -> Findings:
    n = len(system.names)
    rows, f = remaining(n, left_out), system.redundancy - len(left_out)
    given = _all_in(apart.without, allowed, rows, left_out, f) if last else end.given
    size = standardized(given, () if last else end.rows)
    testable = given.r >= TESTABLE
    testable[list(left_out)] = False
    single = error_odds(ERROR_PRIOR_SIGMAS**2 * given.r[rows], size[rows], f, "baarda")
    rejected, partners = _retraced(system.names, end, left_out, settings.partner, weights)
    return Findings(
        strategy=strategy,
        steps=tuple(end.steps),
        rejected=rejected,
        hard_to_tell=partners,
        untestable=tuple(np.flatnonzero(~testable).tolist()),
        at_end=_at_end(end.given, [*end.rows], list(left_out), f - len(end.rows), weights),
        odds=Odds(spread(single.rows, rows, n), single.none),
        remarks=end.remarks,
        held=_held(system.names, end.given, left_out),
    )


def _all_in(
    without: WithoutRows, allowed: Bools, rows: Index, left_out: Collection[int], f: int
) -> RowsGiven:
    """Return all rows but those out for good.

    Redundancy numbers by the places alone are taken where exact ones would say the same: coming
    back, rows only make those of others larger.
    """
    out = sorted(left_out)
    draft = without.drafted(out)
    if draft.exact:
        return draft
    in_doubt = draft.r[rows] < TESTABLE
    # what is switched off, nothing checks
    in_doubt &= allowed[rows] | (draft.r[rows] > 0.0)
    if {*out} <= {*without.begun} and not in_doubt.any() and _outweighs(draft, rows, f):
        return draft
    return without.adjusted(out)


def _outweighs(draft: RowsGiven, rows: Index, f: int) -> bool:
    """Whether a gross error in one row is far more probable than in any other, and than none."""
    e, r = draft.e[rows], np.maximum(draft.r[rows], TESTABLE)
    # of the others no less than by their exact redundancy numbers
    logs = _log_odds(e, r, f)
    row = int(np.argmax(logs))
    exact = draft.back(int(rows[row]))
    if exact is None:
        return False
    logs[row] = -np.inf
    none = log(NONE_PRIOR / (1.0 - NONE_PRIOR) * len(rows))
    own = float(_log_odds(e[row], np.array(exact), f))
    return own - max(float(logs.max()), none) > _FAR_MORE


def _log_odds(e: Array, r: Array, f: int) -> Array:
    return log_bayes_factor(ERROR_PRIOR_SIGMAS**2 * r, e * e / r, f, "baarda")


def _held(
    names: Sequence[Hashable], given: RowsGiven, left_out: Collection[int]
) -> tuple[Rejection[Hashable], ...]:
    """Say how rows that are out for good stand, each in its place with all rows of that in."""
    rows = np.array(sorted(left_out), dtype=np.intp)
    r = given.r.copy()
    for places in given.places(np.unique(given.places_of(rows))):
        r[places.rows] = places.r
    return tuple(
        Rejection(
            row,
            names[row],
            0,
            None,
            None,
            float(given.e[row]) if given.r[row] > 0.0 else None,
            float(given.r[row] ** -0.5) if given.r[row] > 0.0 else None,
            r=float(r[row]),
        )
        for row in left_out
    )


def _at_end(
    given: RowsGiven, out: list[int], held: list[int], f: int, weights: Array | None
) -> FinalStatistics:
    w, r = standardized(given, [*out, *held]), given.r.copy()
    w[held], r[held] = np.nan, 0.0
    w *= np.sign(given.e)
    sigma0 = sqrt(given.vtpv / f) if f > 0 else None
    return FinalStatistics(w, r, sigma0, f, given.vtpv, weights)


def _retraced(
    names: Sequence[Hashable],
    end: ApartEnd,
    left_out: Collection[int],
    limit: float,
    weights: Array | None,
) -> tuple[tuple[Rejection[Hashable], ...], tuple[HardToTell, ...]]:
    """Say of each row which step took it out, and how it stood in its place just before."""
    last: dict[int, tuple[int, SearchStep]] = {}
    for number, step in enumerate(end.steps):
        if step.action in ("add", "reject"):
            last.update((row, (number, step)) for row in step.rows)
    numbers = {number: k for k, number in enumerate(sorted({last[row][0] for row in end.rows}), 1)}
    rows = np.array(end.rows, dtype=np.intp)
    when = np.full(len(end.given.e), np.inf)
    when[rows] = [last[row][0] for row in end.rows]
    found: dict[int, Rejection[Hashable]] = {}
    alike: dict[int, list[HardToTell]] = {row: [] for row in end.rows}
    of_rows = places_without(end.given, np.unique(end.given.places_of(rows)), left_out)
    for row, r, others, rho in chain.from_iterable(_before(p, when, limit) for p in of_rows):
        number, step = last[row]
        alike[row] = [HardToTell(row, k, one) for k, one in zip(others, rho, strict=True)]
        found[row] = Rejection(
            row,
            names[row],
            numbers[number],
            step.statistic,
            step.critical,
            float(end.given.e[row]),
            float(end.given.r[row] ** -0.5),
            r=r,
            weight=None if weights is None else float(weights[row]),
            partners=tuple(names[k] for k in others),
        )
    ordered = sorted(end.rows, key=lambda row: (last[row][0], last[row][1].rows.index(row)))
    return tuple(found[row] for row in ordered), tuple(
        pair for row in ordered for pair in alike[row]
    )


def _before(
    places: Places, when: Array, limit: float
) -> Iterator[tuple[int, float, list[int], list[float]]]:
    """Yield rows that went out, and how each stood in its place just before, of many places.

    That is its redundancy number, what stays in and is hard to tell apart from it, and how much it
    is correlated. (n,) `when` they went: those that stay in, never.
    """
    order = np.argsort(when[places.rows], axis=1, kind="stable")
    stays = np.isinf(when[places.rows])
    count, matrix = np.sum(~stays, axis=1), places.matrix.copy()
    for number in range(int(count.max(initial=0))):
        some = np.flatnonzero(count > number)
        row, mine, each = order[some, number], matrix[some], np.arange(len(some))
        column, r = mine[each, row], np.einsum("cii->ci", mine)
        own = r[each, row][:, None]
        checked = testable(r, places.r[some], beside=number > 0)
        checked &= checked[each, row][:, None]
        root = np.sqrt(np.where(checked, r * own, 1.0))
        rho = np.where(checked, column / root, 0.0)
        place, k = np.nonzero((np.abs(rho) >= limit) & stays[some])
        first = np.searchsorted(place, np.arange(len(some) + 1)).tolist()
        others, rho_of = places.rows[some[place], k].tolist(), rho[place, k].tolist()
        of = places.rows[some, row].tolist(), own[:, 0].tolist(), first, first[1:]
        for one, r_one, begin, end in zip(*of, strict=False):
            yield one, r_one, others[begin:end], rho_of[begin:end]
        matrix[some] = mine - column[:, :, None] * (column / own)[:, None, :]
