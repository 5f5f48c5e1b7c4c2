"""Rows that do not touch are cleaned apart: many errors of a large adjustment in a few sweeps.

The rows of a large adjustment fall into places (a point with its rays and its control): what one
of them is off moves the others of its place, and hardly anything else. A sweep looks at every place
that has a conspicuous row as a small system of its own, all other rows as they are, and lets the
same rule decide there, one row after another. What the sweep rejects goes together; then all is
adjusted anew without it, exactly, and the next sweep looks again, until none changes anything. So
the end is what the rule wants of one row after another: no row that is in exceeds its limit given
those that are out, and no row that is out falls below.

What goes together must be what would go one by one. With R_ij the element of two rows of different
places, |R_ij| <= h_i h_j (`Place.lever`), so that a row j of w_j puts into the w of row i

    at most  g_i g_j |w_j|,    g = h / sqrt(r).

Rows of a place that touches (that shares a photo, or has what carries far: control, priors) and
whose largest w is larger than the one to be decided are still to come out: the sum of their bounds
is what they leave in doubt, since what is off alike in one photo adds up (R_ij is less than a tenth
of its bound in the mean, but a share of it, or the root of the squares, let too much of a photo go
at once of which half is off). A row goes where it exceeds its limit by more than that, and the
others of its place by twice as much; where the doubt is less than a tenth of a sigma it counts for
nothing. What is left waits for the next sweep; the largest of all never waits, and what went too
early comes back. Of rows that are hard to tell apart another one may go than one by one.

A sweep need not adjust anew to see what is left: the misclosures follow exactly from the adjustment
with all rows (`WithoutRows.drafted`), only the redundancy numbers leave out what places do to each
other. The end is always seen from an adjustment without the rejected rows, unless it is but a place
on the way (`draft`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.elimination import Elimination
from anaplot.adjustment.findings import SearchStep
from anaplot.adjustment.partners import EQUAL, WEAK
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.search import search
from anaplot.adjustment.significance import TESTABLE, critical_normal
from anaplot.adjustment.stepwise import rule_of, step_by_step
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, Index

__all__ = [
    "ApartEnd",
    "Place",
    "RowsGiven",
    "WithoutRows",
    "clean_apart",
    "standardized",
]


MOST_SWEEPS = 60
"""Sweeps after which what was found so far is kept."""

_NEGLIGIBLE = 0.1  # sigmas of doubt that count for nothing


class Place(NamedTuple):
    """The rows of a place, as a system in which all of them are in and all others as they are.

    Attributes
    ----------
    rows
        (k,) which rows, ascending.
    system
        Of these rows.
    lever
        (k,) h: an element of R with a row of another place is no larger than the product of both.
    """

    rows: Index
    system: DenseResiduals
    lever: Array


class RowsGiven(Protocol):
    """All rows of an adjustment, seen from what it is without some of them."""

    @property
    def e(self) -> Array:
        """(n,) misclosures left in a-priori sigmas; of a row that is out its estimated error."""
        ...

    @property
    def r(self) -> Array:
        """(n,) redundancy numbers; of a row that is out the one that it has if it comes back."""
        ...

    @property
    def vtpv(self) -> float:
        """The v'Pv of what is in."""
        ...

    def places_of(self, rows: Index) -> Index:
        """Return (k,) the places of k rows; -1 of a row that has none."""
        ...

    def places(self, numbers: Index) -> list[Place]:
        """Return places by their numbers."""
        ...

    def touching(self, numbers: Index) -> csr_array:
        """Return (k, k) what is not zero where two of k places touch, none with itself."""
        ...


class WithoutRows(Protocol):
    """What an adjustment is without some of its rows."""

    def adjusted(self, out: Sequence[int]) -> RowsGiven:
        """Return all rows, adjusted anew without some."""
        ...

    def drafted(self, out: Sequence[int]) -> RowsGiven:
        """Return all rows: misclosures as `adjusted`, redundancy numbers by the place alone."""
        ...


class ApartEnd(NamedTuple):
    """Where the sweeps ended.

    Attributes
    ----------
    given
        All rows, without those that are out.
    rows
        Which were rejected, ascending.
    steps
        How it came to that; of a sweep the largest first.
    remarks
        What limited it.
    """

    given: RowsGiven
    rows: tuple[int, ...]
    steps: list[SearchStep]
    remarks: tuple[str, ...]


def clean_apart(
    without: WithoutRows,
    suspects: Bools,
    most: int,
    alpha: float,
    watch: Watch,
    *,
    held: Collection[int] = (),
    draft: bool = False,
    best: bool = False,
) -> ApartEnd:
    """Reject by w-tests, place by place, until no row that is in or out is beyond its limit.

    Parameters
    ----------
    without
        Adjusts without some rows.
    suspects
        (n,) rows that may be rejected.
    most
        Largest number of rows rejected.
    alpha
        Two-sided significance of one row.
    watch
        Told how far it is; asked whether to stop.
    held
        Rows that are out for good.
    draft
        Whether what is found is but the next place to linearise at.
    best
        Whether the best set of every place is searched for, see `search`, not only the end of
        rejecting one after another.
    """
    return _Sweeps(without, suspects, most, alpha, watch, sorted(held), draft, best).run()


@dataclass(frozen=True, slots=True)
class _Sweeps:
    """What all sweeps have in common."""

    without: WithoutRows
    suspects: Bools
    most: int
    alpha: float
    watch: Watch
    held: list[int]
    draft: bool
    best: bool

    @property
    def critical(self) -> float:
        """Critical value of w."""
        return critical_normal(self.alpha)

    def run(self) -> ApartEnd:
        """Go on until nothing changes or a set recurs."""
        steps: list[SearchStep] = []
        remarks: tuple[str, ...] = ()
        out, exact = frozenset[int](), False
        given, seen = self._given(out, 1, exact=exact), {out}
        while not self.watch.stopped:
            found = self._sweep(given, out) or self._exchanged(given, out)
            if found is None and not (exact or self.draft):
                exact = True
                given = self._given(out, len(seen) + 1, exact=True)
                continue
            if found is None or found.out in seen:
                break
            if len(seen) > MOST_SWEEPS:
                remarks = (f"the rejected observations did not settle in {MOST_SWEEPS} sweeps",)
                break
            objective = self._objective(given, out)
            del given  # as large as a block
            given = self._given(found.out, len(seen) + 1, exact=exact)
            if found.exchange and not self._objective(given, found.out) < objective:
                given = self._given(out, len(seen) + 1, exact=exact)
                break
            steps += found.steps
            out = found.out
            seen.add(out)
        if not (exact or self.draft):
            given = self._given(out, len(seen) + 1, exact=True)
        return ApartEnd(given, tuple(sorted(out)), steps, remarks)

    def _given(self, out: frozenset[int], number: int, *, exact: bool) -> RowsGiven:
        self.watch(f"sweep {number}, {len(out)} rejected", 0.0)
        rows = sorted(out.union(self.held))
        return self.without.adjusted(rows) if exact else self.without.drafted(rows)

    def _objective(self, given: RowsGiven, out: frozenset[int]) -> float:
        return given.vtpv + self.critical**2 * len(out)

    def _changes(self, given: RowsGiven, out: frozenset[int], *, exchange: bool) -> _Changes:
        return _Changes(out, given.vtpv, self.critical**2 if self.best else None, exchange)

    def _sweep(self, given: RowsGiven, out: frozenset[int]) -> _Changes | None:
        """Let the rule decide in every place with a conspicuous row; None where nothing changes."""
        size = standardized(given, [*out, *self.held])
        bad, back = self.suspects.copy(), np.zeros(len(size), dtype=bool)
        bad[[*out, *self.held]], back[[*out]] = False, True
        with np.errstate(invalid="ignore"):
            bad &= (size > self.critical) & (len(out) < self.most)
            back &= size < self.critical
        rows = np.flatnonzero(bad | back)
        numbers, at = np.unique(given.places_of(rows), return_inverse=True)
        top = np.zeros(len(numbers))
        np.maximum.at(top, at, np.where(bad[rows], size[rows], 0.0))
        places = given.places(numbers)
        doubts = _Doubts(
            top, np.array([_reach(place) for place in places]), given.touching(numbers)
        )
        changes = self._changes(given, out, exchange=False)
        for k in np.argsort(-top, kind="stable").tolist():
            for step in self._decided(places[k], out, self.most - len(changes.out), k, doubts):
                changes.add(step, places[k].rows)
        return changes if changes.steps else None

    def _decided(
        self, place: Place, out: frozenset[int], room: int, k: int, doubts: _Doubts
    ) -> Iterator[SearchStep]:
        """Yield the steps of the rule in a place that nothing elsewhere leaves in doubt."""
        state = _begun(place, out)
        suspects, size = self.suspects[place.rows], np.abs(state.w)
        most, rule = len(state.rows) + room, rule_of("baarda", self.alpha)
        steps = step_by_step(state, rule, suspects, most, Watch(), together=False)
        for number, step in enumerate(steps):
            statistic, limit = step.statistic or 0.0, step.critical or 0.0
            doubt = doubts.of(k, statistic)
            if doubt > _NEGLIGIBLE:
                if number or abs(statistic - limit) <= doubt:
                    return
                if step.action == "reject" and statistic - _rival(place, size, step) <= 2.0 * doubt:
                    return
            yield step

    def _exchanged(self, given: RowsGiven, out: frozenset[int]) -> _Changes | None:
        """Search for the best set of every place; None where all have it."""
        if not (self.best and out):
            return None
        changes, cost = self._changes(given, out, exchange=True), self.critical**2
        rows = np.array(sorted(out), dtype=np.intp)
        for place in given.places(np.unique(given.places_of(rows))):
            state = _begun(place, out)
            if _nothing_better(place.system, state.rows, self.critical):
                continue
            mine, suspects = state.rows, self.suspects[place.rows]
            most = len(mine) + self.most - len(changes.out)
            other, _ = search(place.system, self.critical, suspects, most, Watch(), mine)
            less = state.vtpv - other.vtpv + cost * (len(mine) - len(other.rows))
            if less <= EQUAL * max(1.0, place.system.vtpv):
                continue
            for row in (*mine, *other.rows):
                if (row in mine) != (row in other.rows):
                    before = state.vtpv
                    (state.drop if row in mine else state.add)(row)
                    action: Literal["add", "drop"] = "drop" if row in mine else "add"
                    step = SearchStep(action, (row,), None, None, before, state.vtpv)
                    changes.add(step, place.rows)
        return changes if changes.steps else None


class _Changes:
    """What a sweep changes, as if places did not touch at all.

    Parameters
    ----------
    out, value
        What was rejected before, and v'Pv.
    cost
        c^2 where steps tell the objective, as those of `search` do; None: v'Pv.
    exchange
        Whether sets were exchanged for better ones, not rows tested.
    """

    def __init__(
        self, out: frozenset[int], value: float, cost: float | None, exchange: bool
    ) -> None:
        self.out, self.exchange = out, exchange
        self.steps: list[SearchStep] = []
        self._value, self._cost = value, cost

    def add(self, step: SearchStep, rows: Index) -> None:
        """Take up a step in a place of these rows."""
        mine = frozenset(rows[list(step.rows)].tolist())
        before, count = self._value, len(self.out)
        self.out = self.out - mine if step.action == "drop" else self.out | mine
        self._value = before + step.after - step.before
        step = step._replace(
            rows=tuple(rows[list(step.rows)].tolist()), before=before, after=self._value
        )
        if self._cost is not None:
            first = before + self._cost * count
            last = self._value + self._cost * len(self.out)
            step = SearchStep(
                "drop" if step.action == "drop" else "add",
                step.rows,
                last - first,
                0.0,
                first,
                last,
            )
        self.steps.append(step)


class _Doubts:
    """What conspicuous rows elsewhere leave in doubt of the w of a place.

    Parameters
    ----------
    top
        (k,) largest w of every place that may still be rejected.
    reach
        (k,) g of every place.
    touching
        (k, k) which of them touch.
    """

    def __init__(self, top: Array, reach: Array, touching: csr_array) -> None:
        self._top, self._reach, self._touching = top, reach, touching
        self._carried = reach * top

    def of(self, k: int, size: float) -> float:
        """Return the doubt of a w in place k of this size, by those that are larger."""
        others = self._touching.indices[self._touching.indptr[k] : self._touching.indptr[k + 1]]
        larger = others[self._top[others] > size]
        return float(self._reach[k] * self._carried[larger].sum())


def _begun(place: Place, out: frozenset[int]) -> Elimination:
    """Return a place without those of its rows that are out."""
    state = Elimination(place.system)
    for i, row in enumerate(place.rows.tolist()):
        if row in out:
            state.add(i)
    return state


def _reach(place: Place) -> float:
    """Return the largest g of the rows of a place that can be rejected by themselves."""
    good = place.system.r >= WEAK
    return float(np.max(place.lever[good] / np.sqrt(place.system.r[good]), initial=0.0))


def _rival(place: Place, size: Array, step: SearchStep) -> float:
    """Return the largest w of a place but of the row that goes, and of what goes for the same."""
    row, r = step.rows[0], place.system.r
    alike = np.abs(place.system.matrix[row]) >= HARD_TO_TELL * np.sqrt(r * r[row])
    return float(np.max(np.nan_to_num(np.where(alike, 0.0, size)), initial=0.0))


def _nothing_better(system: DenseResiduals, rows: Sequence[int], critical: float) -> bool:
    """Whether one row explains a place better than any other one, and than any two.

    Where all that more rows could explain is less than the cost of one, or no pair explains so much
    more.
    """
    if len(rows) != 1:
        return False
    e, r, row = system.e, system.r, rows[0]
    good = r >= TESTABLE
    gain = np.zeros(len(e))
    gain[good] = e[good] ** 2 / r[good]
    if gain[row] < gain.max():
        return False
    a, b = np.triu_indices(len(e), 1)
    c = system.matrix[a, b]
    determinant = r[a] * r[b] - c * c
    both = determinant > 1e-6 * r[a] * r[b]
    pair = (e[a] ** 2 * r[b] - 2.0 * e[a] * e[b] * c + e[b] ** 2 * r[a])[both] / determinant[both]
    return bool(np.max(pair, initial=0.0) - gain[row] < critical**2)


def standardized(given: RowsGiven, out: Collection[int]) -> Array:
    """Return (n,) abs(w), of rows that are out that of their estimated errors; NaN: no test."""
    size = np.full(len(given.r), np.nan)
    good = given.r >= TESTABLE
    good[list(out)] = given.r[list(out)] > 0.0
    root = np.sqrt(given.r[good])
    size[good] = np.abs(given.e[good]) / root
    size[list(out)] *= given.r[list(out)]
    return size
