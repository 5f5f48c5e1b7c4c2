"""Search for the set of gross errors that explains the misclosures best: add, drop, swap.

The objective is v'Pv of the rows that remain plus c^2 for each rejected one, c the two-sided
critical value of alpha. A change of one row then obeys the w-test exactly: a row goes out when its
w exceeds c, comes back when the w of its error estimate falls below c, and two rows are exchanged
when that lowers v'Pv; of partners that are hard to tell apart the likelier one goes (`partners`).
With normal noise the penalty makes a row without error that is tested alone go out with probability
alpha. A row that hardly shows its own error is not rejected by itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from anaplot.adjustment.elimination import Elimination, NotSeparableError, Returns
from anaplot.adjustment.findings import SearchStep
from anaplot.adjustment.partners import EQUAL, WEAK, Proposals, likeliest
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools

__all__ = ["search"]


_Action = Literal["add", "drop", "swap"]

_STARTS = 12
_MOST_STEPS = 10_000
_PORTION = 1 << 18  # elements looked at together


def search(
    system: ResidualSystem,
    critical: float,
    suspects: Bools,
    most: int,
    watch: Watch,
    further: tuple[int, ...] = (),
) -> tuple[Elimination, list[SearchStep]]:
    """Search from no rejection, from a set of others, conspicuous rows and pairs; the best wins.

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
    watch
        Told how far it is; asked whether to end with the best so far.
    further
        A set found by other means: one more start.

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
    descent = _Descent(critical, suspects, most, Proposals(system.names), watch)
    reached = descent.run(root.copy(), ())
    assert reached is not None
    best, steps = reached
    score = _objective(best, critical)
    if not best.rows and not further:
        return best, steps
    size = np.where(suspects, np.abs(root.w), np.nan)
    order = [k for k in np.argsort(-np.nan_to_num(size, nan=-1.0)).tolist() if size[k] > 0.0]
    starts: list[tuple[int, ...]] = [further] if further else []
    starts += [(k,) for k in order[1:_STARTS]]
    if most > 1:
        starts += _pairs(root, order[: 4 * _STARTS])
    for number, start in enumerate(starts):
        if watch.stopped:
            break
        watch("searching for the best set", number / len(starts))
        reached = descent.run(root.copy(), start)
        if reached is None:
            continue
        other, taken = reached
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


@dataclass(frozen=True, slots=True)
class _Descent:
    """The best of add, drop and swap until nothing lowers the objective."""

    critical: float
    suspects: Bools
    most: int
    proposals: Proposals
    watch: Watch
    met: set[tuple[int, ...]] = field(default_factory=set)

    def run(
        self, state: Elimination, start: Iterable[int]
    ) -> tuple[Elimination, list[SearchStep]] | None:
        """Take the start out, then go on; the objective falls, so that no set comes twice.

        None where it comes to a set from which it went on before: it would end there again.
        """
        steps: list[SearchStep] = []
        for first in start:
            if not (state.testable(first) and len(state.rows) < self.most):
                continue
            beyond = float(state.w[first]) ** 2 - self.critical**2
            rows = self.proposals.instead(first, beyond, self.suspects, self.suspects, state)
            if rows and len(state.rows) + len(rows) <= self.most:
                steps.append(self._do(state, "add", rows))
        for _ in range(_MOST_STEPS):
            rows = tuple(sorted(state.rows))
            if rows in self.met:
                return None
            self.met.add(rows)
            found = None if self.watch.stopped else self._best(state)
            if found is None:
                break
            steps.append(self._do(state, *found))
        return state, steps

    def _do(self, state: Elimination, action: _Action, rows: tuple[int, ...]) -> SearchStep:
        before = _objective(state, self.critical)
        if action == "swap":
            state.swap(rows[1], rows[0])
        else:
            for row in rows:
                (state.add if action == "add" else state.drop)(row)
        after = _objective(state, self.critical)
        return SearchStep(action, rows, after - before, 0.0, before, after)

    def _best(self, state: Elimination) -> tuple[_Action, tuple[int, ...]] | None:
        """Return the step that lowers the objective most; None when none does."""
        cost = self.critical**2
        change = -EQUAL * max(1.0, state.system.vtpv)
        best: tuple[_Action, tuple[int, ...]] | None = None
        w = np.where(self.suspects, np.abs(state.w), np.nan)
        add: tuple[int, ...] = ()
        if len(state.rows) < self.most:
            limit = np.full(len(w), self.critical)
            add = self.proposals.next(w, limit, self.suspects, state)
        if add and len(state.rows) + len(add) <= self.most:
            gain = self._gain(state, "add", add)
            if gain < change:
                change, best = gain, ("add", add)
        together = self.proposals.together(state)
        returns = state.returns()
        most = self._most_instead(state, returns)
        for at, (row, root, back) in enumerate(
            zip(state.rows, returns.root.tolist(), returns.back, strict=True)
        ):
            own = root * root
            unit = together[row]
            if unit[1:]:
                gain = self._gain(state, "drop", unit) if row == unit[0] else 0.0
                if gain < change:
                    change, best = gain, ("drop", unit)
                continue
            if own - cost < change:
                change, best = own - cost, ("drop", unit)
            if not most[at] > own - change:
                continue
            other = self._instead(state, row, root, back, own - change)
            if other is not None:
                change, best = own - other[1], ("swap", (other[0], row))
        return best

    def _gain(self, state: Elimination, action: _Action, rows: tuple[int, ...]) -> float:
        """Return what adding or dropping rows changes in the objective."""
        if action == "add" and not rows[1:]:
            return self.critical**2 - float(state.w[rows[0]]) ** 2
        change = self._do(state.copy(), action, rows).statistic
        return 0.0 if change is None else change

    def _most_instead(self, state: Elimination, returns: Returns) -> Array:
        """Return (k,) the largest w^2 of any row when a row of S comes back, that row included."""
        out = np.zeros(len(returns.root))
        step = max(_PORTION // max(returns.back.shape[1], 1), 1)
        for start in range(0, len(out), step):
            mine = slice(start, start + step)
            w, r = state.given_back(returns.back[mine], returns.root[mine, None])
            size = np.where(self.suspects & (r >= WEAK), w * w, 0.0)
            out[mine] = np.nanmax(size, axis=1, initial=0.0)
        return out

    def _instead(
        self, state: Elimination, row: int, root: float, back: Array, least: float
    ) -> tuple[int, float] | None:
        """Return what explains more than a row of S when that comes back, and its w^2.

        None where nothing has a w^2 above `least`, or where the row is the likelier one of both.
        """
        w, r = state.given_back(back, root)
        size = np.nan_to_num(np.where(self.suspects & (r >= WEAK), w * w, 0.0))
        size[row] = 0.0  # less than any `least`
        while size.max() > least:
            other = int(np.argmax(size >= size.max() * (1.0 - EQUAL)))
            column = state.column(other) + back * back[other]
            allowed = np.where(self.suspects, w, np.nan)
            allowed[row] = w[row]
            at = np.array([other], dtype=np.intp)
            chosen = int(likeliest(allowed[None], r[None], column[None], at)[0])
            if chosen != row and size[chosen] > least and self._separable(state, row, chosen):
                return chosen, float(size[chosen])
            size[other] = 0.0
        return None

    def _separable(self, state: Elimination, row: int, instead: int) -> bool:
        """Whether a row can go out instead of another one."""
        trial = state.copy()
        try:
            trial.swap(row, instead)
        except NotSeparableError:
            return False
        return True
