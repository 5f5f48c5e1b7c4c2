"""Search for the set of gross errors that explains the misclosures best: add, drop, swap.

The objective is v'Pv of the rows that remain plus c^2 for each rejected one, c the two-sided
critical value of alpha. A change of one row then obeys the w-test exactly: a row goes out when its
w exceeds c, comes back when the w of its error estimate falls below c, and two rows are exchanged
when that lowers v'Pv. With normal noise the penalty makes a row without error that is tested alone
go out with probability alpha.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import Step
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.ties import EQUAL, UNSURE, surest

__all__ = ["largest", "search"]

Array = NDArray[np.float64]

_STARTS = 12
_MOST_STEPS = 10_000


def largest(size: Array, state: Elimination) -> int | None:
    """Return the row to choose by its size given S; None when all sizes are NaN.

    Parameters
    ----------
    size
        (n,) abs(w) of the rows, or what stands for it; NaN: not to be chosen.
    state
        S.

    Returns
    -------
    int or None
        The row of the largest size, of equal ones the first. Where its w is known badly and others
        cannot be told apart from it, the one of them with the largest redundancy number.
    """
    row = _first(size)
    return None if row is None else _surest(np.isfinite(size), state, row)


def _first(size: Array) -> int | None:
    """Return the index of the largest value, of equal ones the first; None when all are NaN."""
    if not np.isfinite(size).any():
        return None
    return int(np.argmax(size >= np.nanmax(size) * (1.0 - EQUAL)))


def _surest(allowed: NDArray[np.bool_], state: Elimination, row: int) -> int:
    """Return the row, or the partner that is to be chosen in its place."""
    r = state.r
    if r[row] >= UNSURE:
        return row
    size = np.where(allowed, np.abs(state.w), np.nan)
    chosen = surest(size[None], r[None], state.column(row)[None], np.array([row], dtype=np.intp))
    return int(chosen[0])


def search(
    system: ResidualSystem, critical: float, suspects: NDArray[np.bool_], most: int
) -> tuple[Elimination, list[Step]]:
    """Search from no rejection, from the most conspicuous rows and pairs; the best set wins.

    Parameters
    ----------
    system
        All rows.
    critical
        c, the square of which a rejection costs.
    suspects
        (n,) rows that may be rejected.
    most
        Largest number rejected.

    Returns
    -------
    Elimination
        The best set. Of sets that are equally good the smaller, then the one found first.
    list of Step
        How it was reached from no rejection.
    """
    root = Elimination(system)
    if most < 1:
        return root, []
    best, steps = _descend(root.copy(), (), critical, suspects, most)
    score = _objective(best, critical)
    if not best.rows:
        return best, steps
    size = np.where(suspects, np.abs(root.w), np.nan)
    order = [k for k in np.argsort(-np.nan_to_num(size, nan=-1.0)).tolist() if size[k] > 0.0]
    starts: list[tuple[int, ...]] = [(k,) for k in order[1:_STARTS]]
    if most > 1:
        starts += _pairs(root, order[: 4 * _STARTS])
    seen = {frozenset(best.rows)}
    for start in starts:
        other, taken = _descend(root.copy(), start, critical, suspects, most)
        if frozenset(other.rows) in seen:
            continue
        seen.add(frozenset(other.rows))
        found = _objective(other, critical)
        if found < score - EQUAL * max(1.0, system.vtpv):
            best, steps, score = other, taken, found
    return best, steps


def _objective(state: Elimination, critical: float) -> float:
    return state.vtpv + critical**2 * len(state.rows)


def _pairs(root: Elimination, rows: list[int]) -> list[tuple[int, ...]]:
    """Return the pairs that lower v'Pv most, of the rows given; all of them are compared."""
    if len(rows) < 2:
        return []
    index = np.array(rows, dtype=np.intp)
    matrix = root.system.columns(index)[index]
    e = np.asarray(root.system.e, dtype=float)[index]
    r = np.diag(matrix)
    a, b = np.triu_indices(len(rows), 1)
    c = matrix[a, b]
    determinant = r[a] * r[b] - c * c
    good = determinant > 1e-6 * r[a] * r[b]
    gain = np.full(len(a), -1.0)
    np.divide(
        e[a] ** 2 * r[b] - 2.0 * e[a] * e[b] * c + e[b] ** 2 * r[a],
        determinant,
        out=gain,
        where=good,
    )
    chosen = np.argsort(-gain, kind="stable")[:_STARTS]
    return [(rows[a[k]], rows[b[k]]) for k in chosen.tolist() if gain[k] > 0.0]


def _descend(
    state: Elimination,
    start: Iterable[int],
    critical: float,
    suspects: NDArray[np.bool_],
    most: int,
) -> tuple[Elimination, list[Step]]:
    """Take the start out, then the best of add, drop and swap until nothing lowers the objective.

    The objective falls with every step, so that no set comes twice.
    """
    steps: list[Step] = []
    for first in start:
        before = _objective(state, critical)
        row = _surest(suspects, state, first)
        try:
            state.add(row)
        except NotSeparableError:
            continue
        after = _objective(state, critical)
        steps.append(Step("add", (row,), after - before, 0.0, before, after))
    for _ in range(_MOST_STEPS):
        step = _best_step(state, critical, suspects, most)
        if step is None:
            break
        steps.append(step)
    return state, steps


def _returns(state: Elimination) -> tuple[list[float], Array]:
    own, w = state.returns()
    return own.tolist(), np.abs(w).T


def _instead(state: Elimination, row: int, other: int, suspects: NDArray[np.bool_]) -> int:
    """Return what is to go out for a row of S, another or what is chosen in its place.

    The row itself where that cannot be told apart from the other, and is known better.
    """
    if state.r[other] >= UNSURE:  # no less when the row is back
        return other
    without = state.copy()
    try:
        without.drop(row)
    except NotSeparableError:
        return other
    return _surest(suspects, without, other)


def _best_step(
    state: Elimination, critical: float, suspects: NDArray[np.bool_], most: int
) -> Step | None:
    """Do the step that lowers the objective most."""
    before = _objective(state, critical)
    cost = critical**2
    margin = EQUAL * max(1.0, state.system.vtpv)
    change = -margin
    rows: tuple[int, ...] = ()
    action: Literal["add", "drop", "swap"] | None = None
    w = np.where(suspects, np.abs(state.w), np.nan)
    add = largest(w, state) if len(state.rows) < most else None
    if add is not None and cost - w[add] ** 2 < change:
        change, rows, action = cost - float(w[add]) ** 2, (add,), "add"
    for row, own, then in zip(state.rows, *_returns(state), strict=True):
        if own - cost < change:
            change, rows, action = own - cost, (row,), "drop"
        size = np.where(suspects, then, np.nan)
        while (other := _first(size)) is not None and own - size[other] ** 2 < change:
            chosen = _instead(state, row, other, suspects)
            if chosen != row:
                if own - size[chosen] ** 2 < change:
                    change, rows, action = own - float(size[chosen]) ** 2, (chosen, row), "swap"
                break
            size[other] = np.nan
    try:
        if action == "add":
            state.add(rows[0])
        elif action == "drop":
            state.drop(rows[0])
        elif action == "swap":
            state.swap(rows[1], rows[0])
        else:
            return None
    except NotSeparableError:
        return None
    return Step(action, rows, change, 0.0, before, _objective(state, critical))
