"""Odds over sets of gross errors of any size: which sets explain the misclosures, and how surely.

The odds over single errors and pairs, continued: errors are normal, 20 standard deviations wide
(wider in rows where an error far beyond that must be, else many small ones would explain it better)
and independent; k errors are a tenth as probable as k - 1, and all sets of k rows equally so. With
S the suspected rows, R_SS = R[S, S] and G the diagonal matrix of their widths squared, minus twice
the log of a set's posterior is, up to a constant,

    J(S) = log det(I + G R_SS) - e_S' (R_SS + G^-1)^-1 e_S + 2 log C(n, k) + 2 k log 10.

Beside a fixed price for every rejected row (v'Pv + c^2 k) this knows that an error of a hundred
sigmas in a row that hardly shows any is a worse explanation than one of ten in a row that does.

The sets are visited by a Markov chain that jumps to a neighbour (one row more, one less, one
exchanged), drawn by how much better it is; the time it would wait weighs a set (Zanella 2020,
informed proposals, in continuous time). The chain's generator has a fixed seed, so that the same
misclosures always get the same answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import lgamma, log

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS, NONE_PRIOR
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.watch import Watch

__all__ = ["SetOdds", "set_odds"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

STEPS = 2000
"""Sets visited unless told otherwise."""

_SETTLING = 0.1  # share of the visits that is not weighed
_KEPT = 1_000_000  # rates of sets visited before that are kept for the next visit


@dataclass(frozen=True, slots=True, eq=False)
class SetOdds:
    """What the chain found.

    Attributes
    ----------
    best
        The most probable set visited, ascending.
    objective
        J of it; 0 for the empty set.
    rows
        (n,) posterior probability that row i holds a gross error.
    sure
        Rows for which that is more than one half, ascending: the choice with the fewest expected
        mistakes, wrong and missed counted alike.
    visited
        Number of different sets.
    """

    best: tuple[int, ...]
    objective: float
    rows: Array
    sure: tuple[int, ...]
    visited: int


def set_odds(
    system: ResidualSystem,
    *,
    start: tuple[int, ...] = (),
    suspects: Bools | None = None,
    most: int | None = None,
    steps: int = STEPS,
    seed: int = 0,
    widths: Array | None = None,
    watch: Watch | None = None,
) -> SetOdds:
    """Weigh sets of gross errors against each other; sigma known.

    Parameters
    ----------
    system
        All rows.
    start
        Rows of the set to start with, as found by another strategy.
    suspects
        (n,) rows that may hold errors; None: all.
    most
        Largest set; None: half of the redundancy (more errors than that have other
        explanations as good).
    steps
        Number of jumps.
    seed
        Of the chain's generator.
    widths
        (n,) standard deviation of each row's error beforehand, in a-priori sigmas; None: 20.
    watch
        Told how far it is; asked whether to end with what has been visited.

    Raises
    ------
    ValueError
        No jumps.
    """
    if steps < 1:
        raise ValueError(f"{steps} jumps are none")
    chain = _Chain(system, suspects, most, widths)
    rng = np.random.default_rng(seed)
    held = list(dict.fromkeys(start))[: chain.most]
    time = np.zeros(len(chain.e))
    total = 0.0
    best: tuple[int, ...] = ()
    least = np.inf
    visited: set[frozenset[int]] = set()
    seen = Watch() if watch is None else watch
    for step in range(steps):
        if seen.stopped and total > 0.0:
            break
        seen("weighing sets of errors", step / steps)
        visited.add(frozenset(held))
        objective, rates = chain.ways(held)
        if objective < least:
            best, least = tuple(held), objective
        if not rates[-1] > 0.0:
            time[held] += 1.0
            total += 1.0
            break
        if step >= int(_SETTLING * steps):
            time[held] += 1.0 / rates[-1]
            total += 1.0 / rates[-1]
        chain.jump(held, int(np.searchsorted(rates, rng.random() * rates[-1], side="right")))
    rows = time / total
    sure = tuple(np.flatnonzero(rows > 0.5).tolist())
    return SetOdds(tuple(sorted(best)), float(least), rows, sure, len(visited))


class _Chain:
    """J of a set and of all its neighbours."""

    def __init__(
        self,
        system: ResidualSystem,
        suspects: Bools | None,
        most: int | None,
        widths: Array | None,
    ) -> None:
        self._system = system
        self.e = np.asarray(system.e, dtype=float)
        n = len(self.e)
        self._g = np.square(np.full(n, ERROR_PRIOR_SIGMAS) if widths is None else widths)
        self._own = np.asarray(system.r, dtype=float) + 1.0 / self._g
        self._barred = np.zeros(n, dtype=bool) if suspects is None else ~np.asarray(suspects)
        free = n - int(self._barred.sum())
        room = system.redundancy // 2 if most is None else most
        self.most = max(min(room, free), 0)
        self._known: dict[tuple[int, ...], tuple[float, Array]] = {}
        self._room = _KEPT
        further = -2.0 * log(1.0 - NONE_PRIOR)
        self._price = np.array(
            [
                2.0 * (lgamma(free + 1) - lgamma(k + 1) - lgamma(free - k + 1)) + further * k
                for k in range(self.most + 1)
            ]
        )

    def ways(self, held: list[int]) -> tuple[float, Array]:
        """Return J and the running sums of the rates of jumping to the set's neighbours."""
        key = tuple(held)
        known = self._known.get(key)
        if known is not None:
            return known
        objective, change = self.neighbours(held)
        # Barker's balance of half the change, since J is minus twice a log
        rates = 1.0 / (1.0 + np.exp(np.minimum(0.5 * change, 700.0)))
        found = objective, np.cumsum(np.where(np.isfinite(change), rates, 0.0))
        self._room -= len(change)
        if self._room > 0:
            self._known[key] = found
        return found

    def neighbours(self, held: list[int]) -> tuple[float, Array]:
        """Return J and (n + k + k n,) its changes: a row more, one less, one for another."""
        n, k, g = len(self.e), len(held), self._g
        e, own = self.e, self._own
        value = 0.0
        less, instead = np.zeros(0), np.zeros((0, n))
        if k:
            part = np.ascontiguousarray(self._system.columns(np.array(held)).T)
            own_g = g[held]
            block = part[:, held] + np.diag(1.0 / own_g)
            inverse = np.linalg.inv(block)
            z = inverse @ e[held]
            by = inverse @ part
            scaled = own_g[:, None] * block
            value = float(np.linalg.slogdet(scaled)[1] - e[held] @ z + self._price[k])
            e = e - z @ part
            own = own - np.einsum("kn,kn->n", part, by)
            d = np.diag(inverse)
            back = z / d
            less = back * z + np.log(d / own_g) + self._price[k - 1] - self._price[k]
            own_then = own + by * by / d[:, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                instead = np.log(g * own_then) - (e + by * back[:, None]) ** 2 / own_then
            instead += (back * z + np.log(d / own_g))[:, None]
            instead[:, held] = np.inf
            instead[:, self._barred] = np.inf
        if k < self.most:
            with np.errstate(divide="ignore", invalid="ignore"):
                more = np.log(g * own) - e * e / own + self._price[k + 1] - self._price[k]
            more[held] = np.inf
            more[self._barred] = np.inf
        else:
            more = np.full(n, np.inf)
        return value, np.concatenate([more, less, instead.ravel()])

    def jump(self, held: list[int], number: int) -> None:
        """Turn the set into one of its neighbours."""
        n, k = len(self.e), len(held)
        if number < n:
            held.append(number)
        elif number < n + k:
            del held[number - n]
        else:
            at, row = divmod(number - n - k, n)
            held[at] = row
