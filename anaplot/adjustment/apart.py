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
nothing. What is left waits for the next sweep; the largest of all never waits, for one that cannot
go (nothing checks it by itself) nobody does, and what went too early comes back. Of rows that are
hard to tell apart another one may go than one by one. Rows that exceed their limits only as long as
the others are in would all go and all come back: where a set comes again, one step alone is taken.

Sweeps begin without what the place of linearisation was found without: what a robust solution
leaves far off, or what the pass before has rejected. There the rule decides anew in every place as
if all of its own rows were in, so that steps and statistics are those of the place; what stands at
the end of a pass stays the same in the next. On the way from a robust solution a tenth of the bound
is in doubt: what is alike off in one photo is known already, and the next pass looks again.

A sweep need not adjust anew to see what is left: the misclosures follow exactly from the adjustment
that it begins with (`WithoutRows.drafted`), only the redundancy numbers leave out what places do to
each other. The end of a pass that is no draft is always seen from an adjustment without its rows.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.doubts import Doubts
from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import SearchStep
from anaplot.adjustment.nothingbetter import no_set_better, nothing_better, surely_best
from anaplot.adjustment.partners import EQUAL
from anaplot.adjustment.places import Place, Places, plainly_rejected
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.adjustment.search import search
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.stepwise import rule_of, step_by_step
from anaplot.adjustment.watch import Watch
from anaplot.adjustment.withoutrows import RowsGiven, WithoutRows, places_without, standardized
from anaplot.aliases import Bools, Index

__all__ = [
    "ApartEnd",
    "FarOff",
    "clean_apart",
]


MOST_SWEEPS = 60
"""Sweeps after which what was found so far is kept."""

_NEGLIGIBLE = 0.1  # sigmas of doubt that count for nothing
_IN_THE_MEAN = 0.1  # of its bound that an element of R has, on the way from a robust solution


class FarOff(NamedTuple):
    """What goes at a place to begin with.

    Attributes
    ----------
    rows
        (k,) its rows.
    steps
        How some of them go, the largest first; their numbers count within the place.
    """

    rows: Index
    steps: list[SearchStep]

    def gone(self, step: SearchStep) -> list[int]:
        """Return which of all rows go by one of the steps."""
        gone: list[int] = self.rows[list(step.rows)].tolist()
        return gone


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
    begin: Sequence[FarOff] | None = None,
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
    begin
        What goes at places to begin with, the largest first; None: what the place of linearisation
        was found without.
    """
    sweeps = _Sweeps(without, suspects, most, alpha, watch, sorted(held), draft, best)
    return sweeps.run(begin)


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
    def robust(self) -> bool:
        """Whether it is on the way from a robust solution: it is known what is far off."""
        return self.draft and bool(self.without.begun)

    @property
    def critical(self) -> float:
        """Critical value of w."""
        return critical_normal(self.alpha)

    def run(self, begin: Sequence[FarOff] | None) -> ApartEnd:
        """Go on until nothing changes or a set recurs."""
        steps: list[SearchStep] = []
        remarks: tuple[str, ...] = ()
        far = self._changes(0.0, frozenset(), exchange=False)
        far.take(((there.steps, there.rows) for there in begin or ()), self.most)
        out, number = self._begun() if begin is None else far.out, 1
        # of what the place was found without all is known there
        exact = begin is None and bool(out) and not self.draft
        given = self._given(out, number, exact=exact)
        if begin is not None:
            steps = far.up_to(given.vtpv)
        elif out:
            begun = self._sweep(given, out, anew=True, share=_IN_THE_MEAN if self.robust else 1.0)
            steps, number = begun.steps, 2
            if begun.out != out:
                out, exact = begun.out, False
                del given  # as large as a block
                given = self._given(out, number, exact=False)
        seen = {out}
        while not self.watch.stopped:
            share = _IN_THE_MEAN if self.robust else 1.0
            found = self._sweep(given, out, share=share)
            if not found.steps:
                found = self._exchanged(given, out)
            number += 1
            if found.steps and found.out in seen:
                # rows that go only as long as the others are in: one after the other
                found = found.first_alone(out, seen)
            if not (found.steps or exact or self.draft):
                # sets that were left for redundancy numbers by the places alone may be right
                exact, seen = True, {out}
                del given
                given = self._given(out, number, exact=True)
                continue
            if not found.steps:
                break
            if len(seen) > MOST_SWEEPS:
                remarks = (f"the rejected observations did not settle in {MOST_SWEEPS} sweeps",)
                break
            objective = self._objective(given, out)
            del given
            given = self._given(found.out, number, exact=exact)
            if found.exchange and not self._objective(given, found.out) < objective:
                given = self._given(out, number, exact=exact)
                break
            steps += found.steps
            out = found.out
            seen.add(out)
        if not (exact or self.draft):
            given = self._given(out, number, exact=True)
        return ApartEnd(given, tuple(sorted(out)), steps, remarks)

    def _begun(self) -> frozenset[int]:
        """Return what is out to begin with: what may go of what the place was found without."""
        rows = np.array(sorted(self.without.begun), dtype=np.intp)
        if len(rows) > self.most:
            return frozenset()
        return frozenset(rows[self.suspects[rows]].tolist()).difference(self.held)

    def _given(self, out: frozenset[int], number: int, *, exact: bool) -> RowsGiven:
        self.watch(f"sweep {number}, {len(out)} rejected", 0.0)
        rows = sorted(out.union(self.held))
        return self.without.adjusted(rows) if exact else self.without.drafted(rows)

    def _places(self, given: RowsGiven, numbers: Index) -> Iterator[Places]:
        """Yield places in which what is held does not come back."""
        return places_without(given, numbers, self.held)

    def _objective(self, given: RowsGiven, out: frozenset[int]) -> float:
        return given.vtpv + self.critical**2 * len(out)

    def _changes(self, value: float, out: frozenset[int], *, exchange: bool) -> _Changes:
        return _Changes(out, value, self.critical**2 if self.best else None, exchange)

    def _sweep(
        self, given: RowsGiven, out: frozenset[int], *, anew: bool = False, share: float = 1.0
    ) -> _Changes:
        """Let the rule decide in every place with a conspicuous row.

        With `anew` also in every place with a row that is out, as if all of its own were in.
        `share`: of what may be in doubt that is.
        """
        gone = np.array(sorted(out), dtype=np.intp)
        size = standardized(given, [*out, *self.held])
        with np.errstate(invalid="ignore"):
            bad = np.flatnonzero(size > self.critical if len(out) < self.most else ())
            back = gone[size[gone] < self.critical]
        bad = bad[self.suspects[bad] & ~np.isin(bad, [*out, *self.held])]
        stands = frozenset[int]()
        if anew:
            stands = self._standing(given, gone, np.union1d(bad, back))
            back = gone
        rows = np.union1d(bad, back)
        numbers, at = np.unique(given.places_of(rows), return_inverse=True)
        largest, first = np.where(np.isin(rows, bad), size[rows], 0.0), np.zeros(len(numbers))
        np.maximum.at(first, at, np.nan_to_num(size[rows]))
        reach, touching = given.reach(numbers) * np.sqrt(share), given.touching(numbers)
        kept = frozenset[int]() if anew else out
        new = ~np.isin(numbers, given.places_of(gone))
        done = _FirstSteps(len(numbers))
        while True:
            top = np.zeros(len(numbers))
            np.maximum.at(top, at, largest)
            doubts = Doubts(top, reach, touching)
            # what the largest row of a place leaves in doubt, its rows do
            waits = new & doubts.blocks(self.critical, _NEGLIGIBLE)
            decided: list[tuple[float, list[SearchStep], Index]] = []
            value, asked = given.vtpv, ~waits
            if not anew:  # else what all places are worth together is to be known
                asked &= done.may_do_more(doubts)
            for places in self._places(given, numbers[asked]):
                value += float(np.sum(places.vtpv - given.vtpv)) if anew else 0.0
                which = np.searchsorted(numbers, places.numbers)
                for k, steps, mine in self._decided(places, kept, which, doubts, stands, done):
                    decided.append((float(first[k]), steps, mine))
            # what nothing leaves in doubt and stays all the same cannot go: nobody waits for it
            stays = np.zeros(len(numbers), dtype=bool)
            if not decided:
                stays = ~waits & (top > 0.0)
                stays &= doubts.of_all(np.where(stays, top, np.nan)) <= _NEGLIGIBLE
            if not stays.any():
                break
            largest[stays[at] & (largest >= top[at])] = 0.0
        changes = self._changes(value, kept, exchange=False)
        decided.sort(key=lambda one: -one[0])
        changes.take(((steps, mine) for _, steps, mine in decided), self.most)
        return changes

    def _decided(
        self,
        places: Places,
        out: frozenset[int],
        which: Index,
        doubts: Doubts,
        stands: frozenset[int],
        done: _FirstSteps,
    ) -> Iterator[tuple[int, list[SearchStep], Index]]:
        """Yield the steps of the rule in places, which they are, and their rows.

        Of the places of `stands` these rows are out at the end, whatever the rule says.
        `done` takes notice of what the rule does first in places where nothing comes of it.
        """
        suspects = self.suspects[places.rows]
        some = np.any(np.isin(places.rows, np.array(sorted(out), dtype=np.intp)), axis=1)
        plain = plainly_rejected(places, suspects, self.critical)
        for at, k in enumerate(which.tolist()):
            told = None if some[at] else plain[at]
            rule = self._by_rule(places.place(at), out, suspects[at]) if told is None else told
            steps, first = _certain(rule, places, at, out, k, doubts)
            if not steps:
                done.note(k, first)
            if stands and stands.intersection(places.rows[at].tolist()):
                steps += _to_stand(places.place(at), stands, steps)
            if steps:
                yield k, steps, places.rows[at]

    def _by_rule(self, place: Place, out: frozenset[int], suspects: Bools) -> Iterator[SearchStep]:
        """Yield the steps of the rule in a place, one after another."""
        state, rule = _begun(place, out), rule_of("baarda", self.alpha)
        most = len(state.rows) + self.most - len(out)
        return step_by_step(state, rule, suspects, most, Watch(), together=False)

    def _exchanged(self, given: RowsGiven, out: frozenset[int]) -> _Changes:
        """Search for the best set of every place."""
        changes, cost = self._changes(given.vtpv, out, exchange=True), self.critical**2
        if not (self.best and out):
            return changes
        rows = np.array(sorted(out), dtype=np.intp)
        numbers = np.unique(given.places_of(rows))
        gone = np.zeros(len(self.suspects), dtype=bool)
        gone[rows] = True
        for places in self._places(given, numbers):
            sure = surely_best(places, gone[places.rows], self.critical)
            for at in np.flatnonzero(~sure).tolist():
                self._exchange(places.place(at), out, changes, cost)
        return changes

    def _exchange(self, place: Place, out: frozenset[int], changes: _Changes, cost: float) -> None:
        """Exchange the rows of a place that are out for better ones, where there are any."""
        mine = tuple(i for i, row in enumerate(place.rows.tolist()) if row in out)
        nothing = nothing_better if len(mine) in (1, 2) else no_set_better
        if nothing(place.system, mine, self.critical):
            return
        most = len(mine) + self.most - changes.count
        suspects = self.suspects[place.rows]
        other, _ = search(place.system, self.critical, suspects, most, Watch(), mine)
        state = _begun(place, out)
        less = state.vtpv - other.vtpv + cost * (len(mine) - len(other.rows))
        if less > EQUAL * max(1.0, place.system.vtpv):
            for step in _exchange(state, mine, other.rows):
                changes.add(step, place.rows)

    def _standing(self, given: RowsGiven, out: Index, changing: Index) -> frozenset[int]:
        """Return the rows that are out of places where nothing changes, but on the way to others.

        Of rows that are hard to tell apart the same stay out as in the pass before.
        """
        if self.draft:
            return frozenset()
        places = given.places_of(out)
        return frozenset(out[~np.isin(places, given.places_of(changing))].tolist())


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
        self._out, self.exchange = set(out), exchange
        self.steps: list[SearchStep] = []
        self._value, self._cost = value, cost

    @property
    def out(self) -> frozenset[int]:
        """What is rejected after all steps."""
        return frozenset(self._out)

    @property
    def count(self) -> int:
        """How many rows that are."""
        return len(self._out)

    def add(self, step: SearchStep, rows: Index) -> None:
        """Take up a step in a place of these rows."""
        mine = rows[list(step.rows)].tolist()
        before, count = self._value, self.count
        (self._out.difference_update if step.action == "drop" else self._out.update)(mine)
        self._value = before + step.after - step.before
        step = step._replace(rows=tuple(mine), before=before, after=self._value)
        if self._cost is not None:
            first = before + self._cost * count
            last = self._value + self._cost * self.count
            step = SearchStep(
                "drop" if step.action == "drop" else "add",
                step.rows,
                last - first,
                0.0,
                first,
                last,
            )
        self.steps.append(step)

    def take(self, decided: Iterable[tuple[list[SearchStep], Index]], most: int) -> None:
        """Take up the steps of one place after another, as long as no more than `most` are out."""
        for steps, rows in decided:
            for step in steps:
                if step.action != "drop" and self.count + len(step.rows) > most:
                    break
                self.add(step, rows)

    def up_to(self, value: float) -> list[SearchStep]:
        """Return the steps, told so that they end with this v'Pv."""
        above = value - self._value
        return [
            step._replace(before=step.before + above, after=step.after + above)
            for step in self.steps
        ]

    def first_alone(self, out: frozenset[int], seen: Collection[frozenset[int]]) -> _Changes:
        """Return the first step that leads from `out` to a set not seen yet; none: no such step."""
        alone = _Changes(out, self._value, self._cost, self.exchange)
        for step in () if self.exchange else self.steps:
            mine = frozenset(step.rows)
            there = out - mine if step.action == "drop" else out | mine
            if there not in seen:
                before = self.steps[0].before
                after = before + step.after - step.before
                alone._out, alone.steps = set(there), [step._replace(before=before, after=after)]
                break
        return alone


def _begun(place: Place, out: frozenset[int]) -> Elimination:
    """Return a place without those of its rows that are out."""
    state = Elimination(place.system)
    for i, row in enumerate(place.rows.tolist()):
        if row in out:
            state.add(i)
    return state


def _exchange(state: Elimination, rows: Sequence[int], instead: Sequence[int]) -> list[SearchStep]:
    """Exchange the rows that are out for others, and return the steps."""
    steps = []
    for row in (*rows, *instead):
        if (row in rows) != (row in instead):
            before = state.vtpv
            action: Literal["add", "drop"] = "drop" if row in rows else "add"
            (state.drop if row in rows else state.add)(row)
            steps.append(SearchStep(action, (row,), None, None, before, state.vtpv))
    return steps


def _to_stand(place: Place, stands: frozenset[int], steps: list[SearchStep]) -> list[SearchStep]:
    """Return the exchange of what these steps reject in a place for what is to be out."""
    mine = tuple(i for i, row in enumerate(place.rows.tolist()) if row in stands)
    if all(step.action == "reject" for step in steps) and {
        row for step in steps for row in step.rows
    } == set(mine):
        return []
    state = Elimination(place.system)
    for step in steps:
        for row in step.rows:
            (state.drop if step.action == "drop" else state.add)(row)
    try:
        return _exchange(state, state.rows, mine)
    except NotSeparableError:
        return []


class _First(NamedTuple):
    """The first step of a rule in a place.

    Attributes
    ----------
    statistic, limit
        Of the row that goes, or comes back.
    rival
        See `_rival`; NaN where it was not asked for.
    """

    statistic: float
    limit: float
    rival: float = float("nan")


class _FirstSteps:
    """What a rule does first in places of a sweep where it did nothing that was certain.

    Whatever is in doubt there, the rule is the same: it need not be asked again.
    """

    def __init__(self, count: int) -> None:
        self._nothing = np.zeros(count, dtype=bool)
        self._first = np.full((count, 3), np.nan)

    def note(self, k: int, first: _First | None) -> None:
        """Take notice of the first step in a place; None: there is none."""
        if first is None:
            self._nothing[k] = True
        else:
            self._first[k] = first

    def may_do_more(self, doubts: Doubts) -> Bools:
        """Return (k,) the places where something may come of the rule."""
        statistic, limit, rival = self._first.T
        if not (self._nothing.any() or np.isfinite(statistic).any()):
            return ~self._nothing
        doubt = doubts.of_all(statistic)
        near = (np.abs(statistic - limit) <= doubt) | (statistic - rival <= 2.0 * doubt)
        return np.asarray(~(self._nothing | ((doubt > _NEGLIGIBLE) & near)))


def _certain(
    steps: Iterable[SearchStep],
    places: Places,
    at: int,
    out: frozenset[int],
    k: int,
    doubts: Doubts,
) -> tuple[list[SearchStep], _First | None]:
    """Return those first steps of the rule in a place that nothing elsewhere leaves in doubt.

    And the first step, whether it is one of them or not.
    """
    certain: list[SearchStep] = []
    first: _First | None = None
    for step in steps:
        this = _First(step.statistic or 0.0, step.critical or 0.0)
        doubt = doubts.of(k, this.statistic)
        far = abs(this.statistic - this.limit) > doubt
        if doubt > _NEGLIGIBLE and far and step.action == "reject" and not certain:
            this = this._replace(rival=_rival(places.place(at), out, step))
        first = first or this
        if doubt > _NEGLIGIBLE and (
            certain or not far or this.statistic - this.rival <= 2.0 * doubt
        ):
            break
        certain.append(step)
    return certain, first


def _rival(place: Place, out: frozenset[int], step: SearchStep) -> float:
    """Return the largest w of a place but of the row that goes, and of what goes for the same."""
    size = np.abs(_begun(place, out).w)
    row, r = step.rows[0], place.system.r
    alike = np.abs(place.system.matrix[row]) >= HARD_TO_TELL * np.sqrt(r * r[row])
    return float(np.max(np.nan_to_num(np.where(alike, 0.0, size)), initial=0.0))
