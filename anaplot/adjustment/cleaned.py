"""What is left without gross errors, and what is said of these: of models and blocks alike."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, TypeVar, cast

from anaplot.adjustment.cleaning import CleaningEnd, Refused
from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import Findings, Rejection
from anaplot.adjustment.residualsystem import MeasuredSystem

__all__ = ["Cleaned"]

S = TypeVar("S")
K = TypeVar("K", bound=Hashable)
R = TypeVar("R", bound=MeasuredSystem)


@dataclass(frozen=True, eq=False)
class Cleaned(Generic[S, K, R]):
    """Something without the rows that a strategy rejects: base class.

    Attributes
    ----------
    end
        Where the search ended.
    out
        Names of all that this search has left out; of the same order in this sequence.
    """

    end: CleaningEnd[S, K, R] = field(repr=False)
    out: tuple[K, ...]

    @property
    def system(self) -> R:
        """All rows, linearised at the end."""
        return self.end.system

    @property
    def passes(self) -> tuple[Findings, ...]:
        """What the strategy found in every pass; the last holds."""
        return self.end.passes

    @property
    def findings(self) -> Findings:
        """The findings that hold."""
        return self.end.findings

    @property
    def refused(self) -> tuple[Refused[K], ...]:
        """What the strategy would reject, but without which there is no solution."""
        return self.end.refused

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences: what limited the search."""
        return (*self.findings.remarks, *self.end.remarks)

    @property
    def names(self) -> Sequence[K]:
        """Identities of all rows."""
        return cast("Sequence[K]", self.system.names)

    @cached_property
    def rejected(self) -> tuple[Rejection[K], ...]:
        """What is left out, in the order in which it went, in the units of the rows."""
        system = self.system
        known = (*self.findings.held, *self.findings.rejected)
        rejected = {one.name: one for one in cast("Sequence[Rejection[K]]", known)}
        unasked = [name for name in self.out if name not in rejected]
        at = {name: row for row, name in enumerate(self.names)} if unasked else {}
        for name in unasked:
            row = at.get(name)
            r = 0.0 if row is None else float(system.r[row])
            rejected[name] = Rejection(row, name, 0, None, None, None, None, r)
        ordered = sorted((rejected[name] for name in self.out), key=lambda one: one.order)
        if unasked:
            before = sorted(at[name] for name in self.end.held.difference(self.out))
            ordered = _estimated(system, ordered, before)
        return tuple(
            one
            if one.row is None
            else one.measured(float(system.sigma[one.row]), system.units[one.row])
            for one in ordered
        )

    @property
    def taken_back(self) -> tuple[K, ...]:
        """What some pass or step rejected and is not out at the end."""
        rows = dict.fromkeys(row for found in self.passes for row in found.taken_out)
        out = {*self.out, *self.end.held}
        return tuple(name for name in map(self.names.__getitem__, rows) if name not in out)

    @property
    def hard_to_tell(self) -> tuple[tuple[K, K, float], ...]:
        """Rejected row, kept row, and the correlation of their residuals when the first went."""
        pairs = ((self.names[a], self.names[b], rho) for a, b, rho in self.findings.hard_to_tell)
        return tuple(pair for pair in pairs if pair[1] not in self.out)


def _estimated(
    system: MeasuredSystem, rejected: list[Rejection[K]], before: list[int]
) -> list[Rejection[K]]:
    """Return rejected rows with the errors that they have without all of them, and others."""
    state = Elimination(system)
    for row in (*before, *(one.row for one in reversed(rejected))):
        if row is not None:
            with suppress(NotSeparableError):  # those that nobody asked to reject give way
                state.add(row)
    error, sigma = state.estimates()
    known = dict(zip(state.rows, zip(error.tolist(), sigma.tolist(), strict=True), strict=True))
    out = []
    for one in rejected:
        size, deviation = (None, None) if one.row is None else known.get(one.row, (None, None))
        out.append(one._replace(error=size, sigma=deviation))
    return out
