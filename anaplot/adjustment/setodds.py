"""Odds over sets of gross errors of any number and size: which explain the misclosures best.

Errors are normal and independent, their width g (in sigmas) the same for all of a system and
learned from it; an error may also be of g times 8, 64, ... where its size says so, each of these
an eighth as probable as the one before and the first of them a fifth of that. With S the suspected
rows, R_SS = R[S, S] and G the diagonal matrix of the squared widths, minus twice the log of the
posterior of a set and its widths is, up to a constant,

    J(S) = log det(I + G R_SS) - e_S' (R_SS + G^-1)^-1 e_S + sum of prices.

Beside a fixed price for every rejected row (v'Pv + c^2 k) this knows that an error of a hundred
sigmas in a row that hardly shows any is a worse explanation than one of ten in a row that does.

How readily a row is suspected is not learned: the price of a row is that with which a row of mean
redundancy m, its errors 10 sigmas wide, goes out by itself when w exceeds the critical value,
c^2 - log(1 + 100 m). As long as little is known of the sizes of errors, the one that has to be
larger to show as much is the less probable one, as in `partners`: the price of a row of redundancy
number r is larger by log(m / r), and the more g is learned to be beyond 6 sigmas the less, by
36 / g^2. The price of a width is that of four errors of 6 sigmas seen before,
4 (log(g^2 / 36) + 36 / g^2 - 1): one error alone says little of the width of the others.

The most probable set is sought from several starts, under every width, by the best of adding,
dropping and exchanging rows. How sure its rows are is weighed by a Markov chain that jumps to a
neighbour (one row more, one less, one exchanged), drawn by how much better it is; the time it would
wait weighs a set (Zanella 2020, informed proposals, in continuous time). The chain's generator has
a fixed seed, so that the same misclosures always get the same answer.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import log
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, Index

__all__ = ["MostProbableSet", "SetOdds", "most_probable_set", "set_odds"]


STEPS = 600
"""Sets visited unless told otherwise."""

WIDTHS = tuple(6.0 * 2.0 ** (0.5 * k) for k in range(8))
"""Widths of errors [a-priori sigmas] of which the likeliest is taken."""

_USUAL = 6.0  # width expected beforehand [sigmas], by as many errors as
_SEEN_BEFORE = 4.0
_TESTED = 10.0  # width [sigmas] of an error alone whose test the price of a row agrees with
_WIDER = 8.0  # factor between a width and the next one that single errors may have
_FIRST_WIDER = log(5.0)  # log of what a wider error is less probable, beside the factor
_REACH = 3.0  # widths that an error may reach before a wider one is thought of
_MOST_LEVELS = 12
_EQUAL = 1e-7  # difference of J that is none
_MOST_DESCENT = 10_000
_SETTLING = 0.1  # share of the visits that is not weighed
_NEGLIGIBLE = 1e-12  # share of the rates that need not be known
_PORTION = 1 << 18  # exchanges looked at together
_KEPT = 1_000_000  # rates of sets visited before that are kept for the next visit


class MostProbableSet(NamedTuple):
    """The most probable set.

    Attributes
    ----------
    rows
        Its rows, ascending.
    widths
        (k,) width of the error of each of them [a-priori sigmas].
    width
        g, learned.
    objective
        J of it, with the price of g; 0 for the empty set under the expected width.
    """

    rows: tuple[int, ...]
    widths: Array
    width: float
    objective: float


@dataclass(frozen=True, slots=True, eq=False)
class SetOdds:
    """How sure sets are.

    Attributes
    ----------
    rows
        (n,) posterior probability that row i holds a gross error.
    sure
        Rows for which that is more than one half, ascending: the choice with the fewest expected
        mistakes, wrong and missed counted alike.
    """

    rows: Array
    sure: tuple[int, ...]


def most_probable_set(
    system: ResidualSystem,
    critical: float,
    *,
    starts: Iterable[Iterable[int]] = ((),),
    suspects: Bools | None = None,
    most: int | None = None,
    widths: tuple[float, ...] = WIDTHS,
    watch: Watch | None = None,
) -> MostProbableSet:
    """Return the most probable set of gross errors; sigma known.

    Parameters
    ----------
    system
        All rows.
    critical
        Critical value of w for a row alone.
    starts
        Sets to begin with, as found by other strategies.
    suspects
        (n,) rows that may hold errors; None: all.
    most
        Largest set; None: half of the redundancy (more errors than that have other
        explanations as good).
    widths
        Of which the likeliest is taken.
    watch
        Told how far it is; asked whether to end with the best so far.
    """
    sets = _Sets(system, critical, suspects, most)
    seen = Watch() if watch is None else watch
    begun = [list(dict.fromkeys(start))[: sets.most] for start in starts]
    best: tuple[float, list[int], Array, float] | None = None
    for number, width in enumerate(widths):
        if seen.stopped and best is not None:
            break
        seen("learning the sizes of errors", number / len(widths))
        known: set[frozenset[int]] = set()
        sets.take(width)
        price = _SEEN_BEFORE * (2.0 * log(width / _USUAL) + (_USUAL / width) ** 2 - 1.0)
        for at, start in enumerate(begun):
            if frozenset(start) in known:
                continue
            known.add(frozenset(start))
            held, levels = sets.descend(start, seen)
            begun[at] = held
            value = sets.objective(held, levels) + price
            if best is None or value < best[0] - _EQUAL:
                order = np.argsort(held)
                own = sets.width_of(levels)[order]
                best = value, sorted(held), own, width
    assert best is not None
    value, held, own, width = best
    return MostProbableSet(tuple(held), own, width, value)


def set_odds(
    system: ResidualSystem,
    critical: float,
    found: MostProbableSet,
    *,
    suspects: Bools | None = None,
    most: int | None = None,
    steps: int = STEPS,
    watch: Watch | None = None,
) -> SetOdds:
    """Weigh sets of gross errors against each other, under one width; sigma known.

    Parameters
    ----------
    system, critical, suspects, most
        As `most_probable_set` had them.
    found
        Where the chain begins, and the width.
    steps
        Number of jumps.
    watch
        Told how far it is; asked whether to end with what has been visited.

    Raises
    ------
    ValueError
        No jumps.
    """
    if steps < 1:
        raise ValueError(f"{steps} jumps are none")
    sets = _Sets(system, critical, suspects, most)
    sets.take(found.width)
    rng = np.random.default_rng(0)
    held = list(found.rows)[: sets.most]
    levels = sets.levels_of(found.widths[: len(held)])
    time = np.zeros(len(sets.e))
    total = 0.0
    known: dict[tuple[tuple[int, ...], tuple[int, ...]], tuple[Index, Array]] = {}
    room = _KEPT
    seen = Watch() if watch is None else watch
    for step in range(steps):
        if seen.stopped and total > 0.0:
            break
        seen("weighing sets of errors", step / steps)
        key = tuple(held), tuple(levels)
        if key in known:
            numbers, rates = known[key]
        else:
            numbers, change = sets.neighbours(held, levels, sets.negligible(len(held)))
            # Barker's balance of half the change, since J is minus twice a log
            rates = np.cumsum(1.0 / (1.0 + np.exp(np.clip(0.5 * change, -700.0, 700.0))))
            room -= len(change)
            if room > 0:
                known[key] = numbers, rates
        if not len(rates) or not rates[-1] > 1e-300:
            time[held] += 1.0
            total += 1.0
            break
        if step >= int(_SETTLING * steps):
            wait = 1.0 / rates[-1]
            time[held] += wait
            total += wait
        chosen = int(np.searchsorted(rates, rng.random() * rates[-1], side="right"))
        sets.jump(held, levels, int(numbers[chosen]))
    rows = time / total
    return SetOdds(rows, tuple(np.flatnonzero(rows > 0.5).tolist()))


class _Sets:
    """J of a set and of all its neighbours, under one width."""

    def __init__(
        self, system: ResidualSystem, critical: float, suspects: Bools | None, most: int | None
    ) -> None:
        self._system = system
        self.e = np.asarray(system.e, dtype=float)
        self._r = np.asarray(system.r, dtype=float)
        n = len(self.e)
        self._barred = np.zeros(n, dtype=bool) if suspects is None else ~np.asarray(suspects)
        free = n - int(self._barred.sum())
        room = system.redundancy // 2 if most is None else most
        self.most = max(min(room, free), 0)
        mean = float(self._r[~self._barred].mean()) if free else 0.0
        self._alone = critical**2 - log(1.0 + _TESTED**2 * mean)
        self._shown = np.log(np.maximum(self._r, 1e-12) / max(mean, 1e-12))
        known = ~self._barred & (self._r > 0.0)
        self._largest = float((np.abs(self.e[known]) / self._r[known]).max(initial=0.0))
        self.take(_USUAL)

    def take(self, width: float) -> None:
        """Take a width of errors."""
        beyond = max(self._largest / (_REACH * width), 1.0)
        levels = min(1 + int(np.ceil(log(beyond) / log(_WIDER))), _MOST_LEVELS)
        level = np.arange(levels)
        self._g = np.square(width * _WIDER**level)
        self._price = self._alone - (_USUAL / width) ** 2 * self._shown
        self._cost = 2.0 * (level * log(_WIDER) + (level > 0) * _FIRST_WIDER)

    def negligible(self, held: int) -> float:
        """By how much J of all neighbours that do not matter together exceeds that of the best.

        Of a set of so many rows.
        """
        return 2.0 * log(len(self._g) * (held + 1) * len(self.e) / _NEGLIGIBLE)

    def width_of(self, levels: list[int]) -> Array:
        """Return (k,) widths of the levels."""
        return np.asarray(np.sqrt(self._g[levels]), dtype=float)

    def levels_of(self, widths: Array) -> list[int]:
        """Return the levels nearest to some widths."""
        near = np.abs(np.log(widths)[:, None] - 0.5 * np.log(self._g))
        return [int(level) for level in near.argmin(axis=1)]

    def _fitting(self, held: list[int]) -> list[int]:
        """Return the levels nearest to the estimated errors of a set."""
        if not held:
            return []
        block = self._system.columns(np.array(held))[held] + np.diag(np.full(len(held), 1e-12))
        size = np.abs(np.linalg.solve(block, self.e[held]))
        level = np.log(np.maximum(size / (_REACH * np.sqrt(self._g[0])), 1e-9)) / log(_WIDER)
        return [int(k) for k in np.clip(np.ceil(level), 0, len(self._g) - 1)]

    def objective(self, held: list[int], levels: list[int]) -> float:
        """Return J."""
        if not held:
            return 0.0
        g = self._g[levels]
        block = self._system.columns(np.array(held))[held] + np.diag(1.0 / g)
        e = self.e[held]
        value = np.linalg.slogdet(block)[1] + np.log(g).sum() - e @ np.linalg.solve(block, e)
        return float(value + self._cost[levels].sum() + self._price[held].sum())

    def neighbours(self, held: list[int], levels: list[int], beyond: float) -> tuple[Index, Array]:
        """Return the neighbours of a set that matter, and their changes of J.

        Parameters
        ----------
        held, levels
            The set.
        beyond
            By how much a change may exceed the least one, or zero, and still matter.

        Returns
        -------
        (m,) arrays
            Numbers of the neighbours, ascending: level by level the rows one of which is more, then
            those one of which is less, then level by level the rows one of which goes for another,
            row by row what goes in its place; a row exchanged for itself changes its width. And the
            changes of J, among them all that are small enough to matter.
        """
        n, k, g = len(self.e), len(held), self._g
        level = np.arange(len(g))[:, None]
        free = ~self._barred
        free[held] = False
        e, r, less = self.e, self._r, np.zeros(0)
        if k:
            own = g[levels]
            part = np.ascontiguousarray(self._system.columns(np.array(held)).T)
            inverse = np.linalg.inv(part[:, held] + np.diag(1.0 / own))
            z = inverse @ e[held]
            by = inverse @ part
            e = e - z @ part
            r = np.maximum(r - np.einsum("kn,kn->n", part, by), 0.0)
            d = np.diag(inverse)
            back = z / d
            less = back * z + np.log(d / own) - self._cost[levels] - self._price[held]
        numbers, changes = [], []
        least = float(less.min(initial=np.inf))
        if k < self.most and free.any():
            square = e * e
            bound = np.where(free, self._least_change(square, r), np.inf)
            first = int(np.argmin(bound))
            least = min(least, float(self._changes(square[first], r[first], first).min()))
            rows = np.flatnonzero(free & (bound <= max(least, 0.0) + beyond))
            numbers.append((level * n + rows).ravel())
            changes.append(self._changes(square[rows], r[rows], rows).ravel())
        numbers.append(len(g) * n + np.arange(k))
        changes.append(less)
        if k:
            at, rows, square, then = self._exchanges(
                (by, d, back, less), e, r, free, max(least, 0.0) + beyond
            )
            number = (len(g) * n + k + (level * k + at) * n + rows).ravel()
            change = (self._changes(square, then, rows) + less[at]).ravel()
            # itself with another width
            at, rows = np.arange(k), np.array(held)
            own_by = by[at, rows]
            then = r[rows] + own_by * own_by / d
            square = np.square(e[rows] + own_by * back)
            other = level != np.array(levels)
            itself = (len(g) * n + k + (level * k + at) * n + rows)[other]
            places = np.searchsorted(number, itself)
            numbers.append(np.insert(number, places, itself))
            own_change = (self._changes(square, then, rows) + less)[other]
            changes.append(np.insert(change, places, own_change))
        return np.concatenate(numbers), np.concatenate(changes)

    def _changes(self, square: Array | float, r: Array | float, rows: Index | int) -> Array:
        """(l, m) what rows of squared e and of r given S change by going out, by their levels."""
        g, cost = self._g[:, None], self._cost[:, None]
        grown = 1.0 + g * r
        return np.asarray(np.log(grown) - square * (g / grown) + cost + self._price[rows])

    def _least_change(self, square: Array, r: Array) -> Array:
        """Less than any of `_changes`: of the largest width at the cost of the smallest."""
        widest = float(self._g[-1])
        return np.asarray(self._price - square * (widest / (1.0 + widest * r)))

    def _exchanges(
        self,
        returns: tuple[Array, Array, Array, Array],
        e: Array,
        r: Array,
        free: Bools,
        most: float,
    ) -> tuple[Index, Index, Array, Array]:
        """Return (m,) places in S, rows instead, squared e and r of these when the former is back.

        Of those whose change can be at most `most`.

        Parameters
        ----------
        returns
            (k, n) and (k,) what the rows of S do by coming back: R_SS^-1 R[S, :], the diagonal of
            R_SS^-1, errors by that diagonal, changes of J.
        e, r, free
            (n,) given S, and which rows may go instead.
        most
            The largest change that matters.
        """
        by, d, back, less = returns
        found = []
        step = max(_PORTION // len(e), 1)
        for start in range(0, len(d), step):
            mine = slice(start, start + step)
            part = by[mine]
            square = np.square(e + part * back[mine, None])
            then = r + part * part / d[mine, None]
            bound = self._least_change(square, then) + less[mine, None]
            at, rows = np.nonzero((bound <= most) & free)
            found.append((start + at, rows, square[at, rows], then[at, rows]))
        at, rows, square, then = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return at, rows, square, then

    def jump(self, held: list[int], levels: list[int], number: int) -> None:
        """Turn the set into one of its neighbours."""
        n, k, wide = len(self.e), len(held), len(self._g)
        if number < wide * n:
            level, row = divmod(number, n)
            held.append(row)
            levels.append(level)
        elif number < wide * n + k:
            del held[number - wide * n], levels[number - wide * n]
        else:
            level, rest = divmod(number - wide * n - k, k * n)
            at, row = divmod(rest, n)
            held[at], levels[at] = row, level

    def descend(self, start: list[int], watch: Watch) -> tuple[list[int], list[int]]:
        """Go to the best neighbour until there is none that is better."""
        held = list(start)
        levels = self._fitting(held)
        for _ in range(_MOST_DESCENT):
            if watch.stopped:
                break
            numbers, change = self.neighbours(held, levels, _EQUAL)
            least = float(change.min(initial=np.inf))
            if least > -_EQUAL:
                break
            self.jump(held, levels, int(numbers[np.argmax(change <= least + _EQUAL)]))
        return held, levels
