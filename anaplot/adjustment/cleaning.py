"""Gross errors of what is not linear: reject, solve again, look at all rows again, until it stands.

Every pass sees all rows, linearised where the solution lies without those that the pass before
rejected: a rejected one can come back, and its estimated error is what it is off from all others.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import eq
from typing import Generic, NamedTuple, Protocol, TypeVar, cast

import numpy as np

from anaplot.adjustment.elimination import NotSeparableError
from anaplot.adjustment.findings import Findings, SearchSettings
from anaplot.adjustment.foundapart import Apart
from anaplot.adjustment.pairodds import pair_odds
from anaplot.adjustment.residualsystem import MeasuredSystem, ResidualSystem
from anaplot.adjustment.scale import AprioriSigma, ScaleError, check_scale
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.strategies import find_gross_errors, findings_at, sigma_of
from anaplot.adjustment.tested import sigma0_known
from anaplot.adjustment.watch import Watch
from anaplot.adjustment.weightsbegin import WeightsBegin
from anaplot.adjustment.withoutrows import WithoutRows
from anaplot.aliases import Array, Bools
from anaplot.errors import NotComputableError

__all__ = [
    "Attempts",
    "Cleaning",
    "CleaningEnd",
    "Refused",
    "Relinearised",
    "SolvedWithout",
    "best_of",
]

S = TypeVar("S")
K = TypeVar("K", bound=Hashable)
R = TypeVar("R", bound=MeasuredSystem)

MOST_PASSES = 30
"""Passes after which the best set that was met is kept."""

_MOST_REFUSED = 100
_INTERRUPTED = "the search was interrupted: the best found so far is kept"
_MOST_ASTRAY = 5  # sets without which the iteration found no end either


class Refused(NamedTuple, Generic[K]):
    """A row that a strategy would reject, but without which there is no solution.

    Attributes
    ----------
    name
        The row.
    reason
        What would be left open.
    """

    name: K
    reason: str


class SolvedWithout(NamedTuple, Generic[S, K]):
    """A solution without some rows.

    Attributes
    ----------
    solution
        Where it lies.
    vtpv
        The v'Pv of the rows that it has, in a-priori sigmas.
    also
        Names of further rows that had to be left out to find it.
    """

    solution: S
    vtpv: float
    also: tuple[K, ...] = ()


class Relinearised(Protocol[S, K, R]):
    """What is cleaned: a model, a block.

    S is where it lies (a solution), K the name of a row, R the rows linearised somewhere.
    """

    @property
    def apriori(self) -> AprioriSigma:
        """The a-priori sigma that all rows are weighted by."""
        ...

    def residuals(self, at: S, number: int) -> R:
        """Return all rows, linearised at a solution.

        Parameters
        ----------
        at
            Where.
        number
            Of the pass, from 1.

        Raises
        ------
        NotComputableError
            Not all is determined there.
        """
        ...

    def without(self, out: frozenset[K], near: S) -> SolvedWithout[S, K]:
        """Solve without some rows, by their names, beginning at another solution.

        Raises
        ------
        NotComputableError
            There is no solution.
        """
        ...

    def suspects(self, system: R) -> Bools:
        """Return (n,) which rows may be rejected."""
        ...

    def model_values(self, system: R, at: S) -> Array:
        """Return (n,) model values of sqrt(q_vv), see `find_gross_errors`."""
        ...

    def apart(self, system: R, at: S) -> WithoutRows | None:
        """Return how it is seen without some rows where these are cleaned apart; None: as one."""
        ...

    def price(self, out: frozenset[K], at: S, each: float) -> float:
        """Return what rows that are out cost: of those of one cause, one row.

        Parameters
        ----------
        out
            The rows.
        at
            The solution without them.
        each
            The price of a row by itself.
        """
        ...

    def astray(self, error: NotComputableError) -> bool:
        """Whether an error of `without` means that the iteration diverged."""
        ...


class _Proposal(NamedTuple, Generic[S, K]):
    """What a pass wants out: names of all rows, what it found, and where it looked from."""

    names: Sequence[K]
    found: Findings
    place: S


@dataclass(frozen=True, slots=True, eq=False)
class CleaningEnd(Generic[S, K, R]):
    """Where the passes ended.

    Attributes
    ----------
    solved
        The solution without what is rejected; the start's where that stood.
    system
        All rows, linearised there.
    out
        Names of all that is out but what had to go in addition.
    passes
        What the strategy found in every pass; the last holds.
    refused
        What could not be left out.
    score
        v'Pv plus the price of all rows that are out, c^2 for one by itself: less is better.
    held
        Rows that were out from the beginning and not looked at.
    settled
        Whether the last pass found what the one before had.
    remarks
        Sentences: what limited the passes.
    """

    solved: SolvedWithout[S, K]
    system: R = field(repr=False)
    out: frozenset[K]
    passes: tuple[Findings, ...] = field(repr=False)
    refused: tuple[Refused[K], ...]
    score: float
    held: frozenset[K]
    settled: bool
    remarks: tuple[str, ...] = ()

    @property
    def findings(self) -> Findings:
        """The findings that hold."""
        return self.passes[-1]


@dataclass(frozen=True, slots=True)
class Cleaning(Generic[S, K, R]):
    """Passes of one strategy.

    Attributes
    ----------
    subject
        What is cleaned.
    strategy
        One of `STRATEGIES`.
    settings
        Significance and limits.
    watch
        Told how far it is; where it asks for the end, the best so far is kept.
    as_given
        Clean also where the a-priori sigma cannot be right.
    """

    subject: Relinearised[S, K, R]
    strategy: str
    settings: SearchSettings
    watch: Watch
    as_given: bool = False

    def run(
        self,
        start: S,
        known: SolvedWithout[S, K] | None,
        held: frozenset[K] = frozenset(),
    ) -> CleaningEnd[S, K, R]:
        """Go on from a solution until a set comes again.

        Parameters
        ----------
        start
            Where the first pass looks from.
        known
            The solution without `held` alone, if the start is that; None: it is any place.
        held
            Names of rows that are out and not looked at.

        Raises
        ------
        ScaleError
            The a-priori sigma cannot be right.
        NotComputableError
            There is no solution without any of the sets that were proposed, or what is held cannot
            be left out.
        """
        solved: dict[frozenset[K], SolvedWithout[S, K]] = {} if known is None else {held: known}
        proposals: dict[frozenset[K], _Proposal[S, K]] = {}
        met: set[tuple[WeightsBegin, frozenset[K]]] = set()
        passes: list[Findings] = []
        barred: dict[K, str] = {}
        at, place, astray = (None if known is None else held), start, 0
        while True:
            system = self.subject.residuals(place, len(passes) + 1)
            if not passes and known is not None:
                self._check_scale(system, None)
            begin = WeightsBegin.of_pass(self.strategy, len(passes))
            near = None if at is None else begin.without_weight(at - held)
            found = self._pass(system, place, barred, held, near, draft=not passes)
            passes.append(found)
            names = cast("Sequence[K]", system.names)  # the subject's own
            proposed = frozenset(names[row] for row in found.rows) | held
            # the same rows out are no circle where the weights began otherwise
            again = proposed in solved and (begin, proposed) in met
            met.add((begin, proposed))
            # not the rows, which are as large as the subject
            proposals[proposed] = _Proposal(names, found, place)
            if proposed == at:
                self._check_scale(system, found)
                return self._end(solved[proposed], proposed, system, passes, barred, held)
            del system  # as large as the subject, before there is another
            if again or len(passes) >= MOST_PASSES or len(barred) > _MOST_REFUSED:
                return self._best(solved, proposals, passes, barred, held, "")
            if proposed not in solved:
                try:
                    solved[proposed] = self.subject.without(proposed, place)
                except NotComputableError as error:
                    astray += self.subject.astray(error)
                    # what was checked least of all is what the solution cannot do without
                    least = min(found.rejected, key=lambda one: one.r, default=None)
                    if least is None or astray > _MOST_ASTRAY:
                        raise
                    barred[cast("K", least.name)] = str(error)
                    if not self.watch.stopped:
                        continue
            if self.watch.stopped:
                return self._best(solved, proposals, passes, barred, held, _INTERRUPTED)
            at, place = proposed, solved[proposed].solution

    @property
    def by_apriori(self) -> bool:
        """Whether the a-priori sigma matters: the strategy tests by it, and it is doubted."""
        return not self.as_given and sigma0_known(sigma_of(self.strategy))

    def _pass(
        self,
        system: R,
        place: S,
        barred: Collection[K],
        held: frozenset[K],
        near: frozenset[K] | None,
        *,
        draft: bool,
    ) -> Findings:
        suspects = self.subject.suspects(system)
        if barred:
            suspects &= np.array([name not in barred for name in system.names])
        modified = self.strategy == "modified"
        try:
            return find_gross_errors(
                system,
                self.strategy,
                replace(self.settings, pairs=False),  # those of the end are wanted alone
                models=self.subject.model_values(system, place) if modified else None,
                suspects=suspects,
                left_out=_rows(system, held),
                measured=self.subject.apriori.rows,
                idle=self.subject.apriori.idle,
                watch=self.watch,
                weigh=False,
                apart=self._apart(system, place, draft=draft),
                near=None if near is None else _rows(system, near),
            )
        except NotSeparableError as error:
            name = system.names[error.row]
            said = " ".join(map(str, filter(None, name))) if isinstance(name, tuple) else str(name)
            raise NotComputableError(
                f"{self.subject.apriori.of}: {said} cannot be left out beside what is out already: "
                "then nothing checks it"
            ) from error

    def _apart(self, system: R, place: S, *, draft: bool = False) -> Apart | None:
        without = self.subject.apart(system, place)
        return None if without is None else Apart(without, draft)

    def _check_scale(self, system: ResidualSystem, found: Findings | None) -> None:
        """Complain where the a-priori sigma cannot be right and the strategy tests by it."""
        if self.by_apriori:
            check_scale(system, found, self.settings.alpha, self.subject.apriori)

    def _best(
        self,
        solved: dict[frozenset[K], SolvedWithout[S, K]],
        proposals: dict[frozenset[K], _Proposal[S, K]],
        passes: list[Findings],
        barred: dict[K, str],
        held: frozenset[K],
        why: str,
    ) -> CleaningEnd[S, K, R]:
        """Return the best of the sets that were met, seen from its own solution."""
        known = {out: one for out, one in solved.items() if out in proposals}
        if not known:
            raise NotComputableError(
                f"{self.subject.apriori.of}: nothing that {self.strategy} rejects can be left out: "
                f"{next(iter(barred.values()))}"
            )
        # of sets that differ by rounding alone the first that was met
        out = min(known, key=lambda one: round(self._score(known[one], one), 6))
        names, found, place = proposals[out]
        system = self.subject.residuals(known[out].solution, len(passes) + 1)
        if len(system.names) != len(names) or not all(map(eq, system.names, names)):
            # a row is gone that the proposal speaks of
            system = self.subject.residuals(place, len(passes) + 1)
        else:
            apart = self._apart(system, known[out].solution)
            rows = _rows(system, held)
            found = findings_at(found, system, self.settings, left_out=rows, apart=apart)
        if len(found.rows) >= self.settings.room(system.redundancy):
            self._check_scale(system, found)
        said = why or (
            f"the rejected observations did not settle in {len(passes)} passes: the best of the "
            "sets is kept"
        )
        end = self._end(known[out], out, system, [*passes, found], barred, held)
        return replace(end, settled=False, remarks=(said,))

    def _end(
        self,
        one: SolvedWithout[S, K],
        out: frozenset[K],
        system: R,
        passes: list[Findings],
        barred: dict[K, str],
        held: frozenset[K],
    ) -> CleaningEnd[S, K, R]:
        refused = tuple(Refused(name, reason) for name, reason in barred.items())
        stopped = self.watch.stopped
        remarks = (_INTERRUPTED,) if stopped else ()
        return CleaningEnd(
            one,
            system,
            out,
            tuple(passes),
            refused,
            self._score(one, out),
            held,
            not stopped,
            remarks,
        )

    def _score(self, one: SolvedWithout[S, K], out: frozenset[K]) -> float:
        each = critical_normal(self.settings.alpha) ** 2
        return one.vtpv + self.subject.price(out.union(one.also), one.solution, each)


class Attempts(Generic[S, K, R]):
    """Passes from several places to begin at: the best end counts.

    Parameters
    ----------
    cleaning
        The passes.

    Attributes
    ----------
    cleaning
        The passes.
    ends
        Where they ended.
    """

    def __init__(self, cleaning: Cleaning[S, K, R]) -> None:
        self.ends: list[CleaningEnd[S, K, R]] = []
        self.cleaning = cleaning
        self._failures: list[NotComputableError] = []

    @property
    def ended(self) -> bool:
        """Whether the end was asked for and there is one: nothing more is tried."""
        return self.cleaning.watch.stopped and bool(self.ends)

    @property
    def doubted(self) -> bool:
        """Whether a place came to nothing because the residuals contradict the a-priori sigma."""
        return any(isinstance(error, ScaleError) for error in self._failures)

    def begin(
        self,
        start: S,
        known: SolvedWithout[S, K] | None,
        held: frozenset[K] = frozenset(),
    ) -> None:
        """Go on from a place, as `Cleaning.run` has it; where nothing comes of it, remember why."""
        if self.ended:
            return
        try:
            self.ends.append(self.cleaning.run(start, known, held))
        except NotComputableError as error:
            self._failures.append(error)

    def best(self) -> CleaningEnd[S, K, R]:
        """Return the best end, its sets weighed, with odds over pairs where they are asked for.

        Raises
        ------
        NotComputableError
            There is none: why the first of them failed.
        """
        if not self.ends:
            raise self._failures[0]
        end = best_of(self.ends)
        # of the passes before nobody asks how sure their rows are
        before = (replace(one, weigh=None) for one in end.passes[:-1])
        found = end.findings.weighed
        if self.cleaning.settings.pairs:
            kind, held = sigma_of(self.cleaning.strategy), _rows(end.system, end.held)
            found = replace(found, pair_odds=pair_odds(end.system, kind=kind, left_out=held))
        return replace(end, passes=(*before, found))


def best_of(ends: Collection[CleaningEnd[S, K, R]]) -> CleaningEnd[S, K, R]:
    """Return the end of the smallest score, of equal ones the first."""
    return min(ends, key=lambda end: round(end.score, 6))


def _rows(system: ResidualSystem, names: frozenset[K]) -> list[int]:
    """Return the rows of names; of a name that the system lacks there is none."""
    rows = []
    for name in names:
        with suppress(ValueError):
            rows.append(system.names.index(name))
    return sorted(rows)
