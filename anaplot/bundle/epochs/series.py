"""Displacements of an object's points through two or more epochs, and between any two of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.bundle.epochs.apart import Agreement
from anaplot.bundle.epochs.common import Common
from anaplot.bundle.epochs.moves import (
    Move,
    bound_coordinates,
    given_coordinates,
    undone_movements,
)

__all__ = ["EpochDifferences", "EpochSeries"]


@dataclass(frozen=True, slots=True, eq=False)
class EpochDifferences:
    """Displacements between two epochs.

    Attributes
    ----------
    epochs
        Names of the two blocks.
    joint
        Whether both were adjusted in one.
    datum
        "control", or "stable": the points named in `common` hold it.
    common
        Points that have the same coordinates in both epochs.
    partly
        (name, axes) of control that has only some common coordinates; the others are compared.
    own_parameters
        Whether each epoch had additional parameters of its own; None without any.
    points
        Names of the compared points.
    places
        (m, 3) their coordinates in the first epoch [m].
    given
        (m, 3) whether control gives the coordinate in both epochs: its difference is no movement.
    d
        (3 m,) second minus first epoch [m]: X, Y, Z of one point after the other.
    cofactors
        (3 m, 3 m) its covariance matrix [m^2] for the a-priori sigma0.
    flagged
        Observations that each epoch by itself flags.
    vtpv, redundancy
        Of the joint adjustment, or the sums of all.
    alone
        (vtpv, redundancy) of each epoch by itself; of the joint way without additional parameters.
    by_known
        Whether tests go by the a-priori sigma0 (test "baarda").
    power
        That of the first epoch's [test].
    agreement
        Of the points that hold the datum, declared stable or control of all epochs, or None; of two
        epochs out of more, None.
    only_first, only_second
        Names of points of one epoch alone.
    remarks
        Sentences for a person.
    numbers
        Of the epochs, from 1.
    expected
        (3 m,) the given movement w that displacements are tested against [m]; None: that there is
        none.
    """

    epochs: tuple[str, str]
    joint: bool
    datum: str
    common: tuple[str, ...]
    partly: tuple[tuple[str, str], ...]
    own_parameters: bool | None
    points: tuple[str, ...]
    places: Array = field(repr=False)
    given: Bools = field(repr=False)
    d: Array = field(repr=False)
    cofactors: Array = field(repr=False)
    flagged: tuple[int, int]
    vtpv: float
    redundancy: int
    alone: tuple[tuple[float, int], tuple[float, int]]
    by_known: bool
    power: float
    agreement: Agreement | None
    only_first: tuple[str, ...] = field(repr=False)
    only_second: tuple[str, ...] = field(repr=False)
    remarks: tuple[str, ...]
    numbers: tuple[int, int] = (1, 2)
    expected: Array | None = field(repr=False, default=None)

    @property
    def deviation(self) -> Array:
        """(3 m,) displacements minus the given movement [m]: zero under the null hypothesis."""
        return self.d if self.expected is None else self.d - self.expected


@dataclass(frozen=True, slots=True, eq=False)
class EpochSeries:
    """Displacements through two or more epochs, adjusted together or each by itself.

    Attributes
    ----------
    epochs
        Names of the k blocks.
    joint, datum, own_parameters
        As `EpochDifferences` has them.
    common
        Coordinates that are one in several epochs.
    points
        Names of the compared points.
    moves
        Their m movements, each from one epoch to the next that the point is in, point by point.
    places
        (m, 3) where each begins [m].
    d
        (3 m,) later minus earlier epoch [m]: X, Y, Z of one movement after the other.
    cofactors
        (3 m, 3 m) its covariance matrix [m^2] for the a-priori sigma0.
    expected
        (3 m,) the given movement [m], or None.
    flagged
        Observations that each epoch by itself flags.
    vtpv, redundancy, by_known, power, agreement
        As `EpochDifferences` has them.
    alone
        (vtpv, redundancy) of each epoch by itself.
    names
        Points of each epoch, in the order of its file.
    remarks
        Sentences for a person.
    """

    epochs: tuple[str, ...]
    joint: bool
    datum: str
    own_parameters: bool | None
    common: Common = field(repr=False)
    points: tuple[str, ...]
    moves: tuple[Move, ...] = field(repr=False)
    places: Array = field(repr=False)
    d: Array = field(repr=False)
    cofactors: Array = field(repr=False)
    expected: Array | None = field(repr=False)
    flagged: tuple[int, ...]
    vtpv: float
    redundancy: int
    alone: tuple[tuple[float, int], ...]
    by_known: bool
    power: float
    agreement: Agreement | None
    names: tuple[tuple[str, ...], ...] = field(repr=False)
    remarks: tuple[str, ...]

    @property
    def deviation(self) -> Array:
        """(3 m,) displacements minus the given movement [m]: zero under the null hypothesis."""
        return self.d if self.expected is None else self.d - self.expected

    @property
    def given(self) -> Bools:
        """(m, 3) whether control gives the coordinate in both epochs of a movement."""
        return given_coordinates(self.moves, self.common)

    @property
    def bound(self) -> Bools:
        """(m, 3) whether a difference follows from those before it: it is given, or comes back."""
        return bound_coordinates(self.moves, self.common)

    @property
    def undone(self) -> dict[tuple[int, int], list[int]]:
        """By movement and axis: what a bound difference undoes, as `undone_movements` has it."""
        return undone_movements(self.moves, self.common)

    @property
    def alone_in(self) -> tuple[tuple[str, ...], ...]:
        """Of each epoch, its points that no other one has."""
        return tuple(self._only(k, range(len(self.names))) for k in range(len(self.names)))

    def _only(self, epoch: int, among: range | tuple[int, ...]) -> tuple[str, ...]:
        others = {name for k in among if k != epoch for name in self.names[k]}
        return tuple(name for name in self.names[epoch] if name not in others)

    def between(self, first: int, second: int) -> EpochDifferences:
        """Return the displacements from one epoch to a later one, numbered from 0.

        Sums of the movements between; the variance factor is that of all epochs.
        """
        pair = (first, second)
        rows: list[int] = []
        starts: list[int] = []
        points: list[str] = []
        at: dict[str, list[int]] = {}
        for row, move in enumerate(self.moves):
            at.setdefault(move.point, []).append(row)
        both = set(self.names[first]) & set(self.names[second])
        for point in self.points:
            mine = [
                row
                for row in at[point]
                if first <= self.moves[row].first and self.moves[row].second <= second
            ]
            if point in both and not self._one(point, pair):
                points.append(point)
                starts.append(len(rows))
                rows += mine
        m = len(self.moves)
        places, d, q = self.places[rows], self.d.reshape(m, 3)[rows], self.cofactors
        expected = None if self.expected is None else self.expected.reshape(m, 3)[rows]
        if len(rows) > len(starts) or len(rows) < m:
            q = q.reshape(m, 3, m, 3)[rows][:, :, rows]
            if rows:
                q = np.add.reduceat(np.add.reduceat(q, starts, axis=0), starts, axis=2)
                d = np.add.reduceat(d, starts, axis=0)
                if expected is not None:
                    expected = np.add.reduceat(expected, starts, axis=0)
            q = q.reshape(3 * len(starts), 3 * len(starts))
        steps = [Move(name, first, second) for name in points]
        return EpochDifferences(
            epochs=(self.epochs[first], self.epochs[second]),
            joint=self.joint,
            datum=self.datum,
            common=self.common.points(pair),
            partly=self.common.lettered(pair),
            own_parameters=self.own_parameters,
            points=tuple(points),
            places=places[starts],
            given=given_coordinates(steps, self.common),
            d=d.reshape(-1),
            cofactors=q,
            flagged=(self.flagged[first], self.flagged[second]),
            vtpv=self.vtpv,
            redundancy=self.redundancy,
            alone=(self.alone[first], self.alone[second]),
            by_known=self.by_known,
            power=self.power,
            agreement=None,
            only_first=self._only(first, pair),
            only_second=self._only(second, pair),
            remarks=(),
            numbers=(first + 1, second + 1),
            expected=None if expected is None else expected.reshape(-1),
        )

    def as_two(self) -> EpochDifferences:
        """Return the displacements of a series of two epochs, with all that is said of it."""
        if len(self.epochs) != 2:
            raise ValueError(f"{len(self.epochs)} epochs are not two")
        return replace(self.between(0, 1), agreement=self.agreement, remarks=self.remarks)

    def _one(self, point: str, pair: tuple[int, int]) -> bool:
        return all(self.common.same(point, axis, *pair) for axis in range(3))
