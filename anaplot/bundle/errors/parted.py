"""A block seen without any set of its rows, linearised where it is, for `adjustment.apart`.

All is seen from an adjustment that is known, without rows B (`Basis`). Without other rows, D apart
from these, with G = J N^-1 J' of that adjustment and S = 1 for what comes in, -1 for what goes,

    (S + G_DD) z = e_D,    e' = e - G_.D z,    v'Pv grows by z' e_D.

Redundancy numbers come from places, each by itself: what places do to each other's is left out.
Where that is not good enough, the block is adjusted anew without the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.doubts import Touching
from anaplot.adjustment.places import Places, inverse_among, seen_without
from anaplot.aliases import Array, Index
from anaplot.bundle.errors.basis import Basis
from anaplot.bundle.errors.laterresiduals import AllRows, left_open
from anaplot.bundle.errors.leftout import rows_missing, without
from anaplot.bundle.errors.rowcoupling import NotSolvedError, RowCoupling
from anaplot.bundle.solve.datum import anchor, rescaled
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.gaussnewton import LEFT, change_of
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import (
    Linearised,
    Unknowns,
    effect,
    linearise,
    move,
    objective,
)
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.solve.structure import Structure

__all__ = ["BlockParts", "BlockWithout", "can_be_parted"]

_MOST_STEPS = 5  # from where a block is linearised to its minimum without other rows
_HARDLY = 0.1  # of what may be left at a minimum
_ROUNDING = 1e-12  # of v'Pv: by which it may seem to grow


def can_be_parted(problem: Problem) -> bool:
    """Whether nothing but photos and shared parameters ties the points of a block together."""
    return problem.conditions is None and problem.given is None and problem.offsets is None


class BlockParts:
    """A block whose rows are cleaned apart; a `WithoutRows`.

    Parameters
    ----------
    system
        All rows, linearised somewhere.
    state, structure
        Where that is, and the structure of its equations.
    reduced
        The bundle without some of the rows for which that was found; None: it was given.
    known
        Returns the cofactors there without them.
    """

    def __init__(
        self,
        system: AllRows,
        state: BlockState,
        structure: Structure,
        reduced: Problem | None = None,
        known: Callable[[], Cofactors | None] = lambda: None,
    ) -> None:
        self._system, self._state, self._structure = system, state, structure
        self._reduced, self._known = reduced, known
        self._last: Basis | None = None
        self._given: BlockWithout | None = None

    @cached_property
    def begun(self) -> tuple[int, ...]:
        """Rows without which the state was found."""
        if self._reduced is None:
            return ()
        return tuple(rows_missing(self._system.rows, self._reduced).tolist())

    @property
    def _basis(self) -> Basis:
        """What was adjusted last: at first without what the state was found without."""
        if self._last is None:
            known = self._known()
            if known is None:
                return self._adjusted(())
            self._last = Basis(self._system, known, np.array(self.begun, dtype=np.intp))
        return self._last

    def adjusted(self, out: Sequence[int]) -> BlockWithout:
        """Return all rows, adjusted anew without some; from there drafts are seen after that.

        Raises
        ------
        NotComputableError
            Not all unknowns are determined without them.
        """
        rows = np.array(out, dtype=np.intp)
        basis = self._basis
        if not np.array_equal(rows, np.flatnonzero(basis.gone)):
            basis = self._adjusted(out)
        self._given = BlockWithout(basis, rows)
        return self._given

    def drafted(self, out: Sequence[int]) -> BlockWithout:
        """Return all rows: misclosures as `adjusted`, redundancy numbers by the place alone.

        Where what changes cannot be found from what is adjusted already, it is adjusted anew.

        Raises
        ------
        NotComputableError
            Not all unknowns are determined without them.
        """
        rows, basis = np.array(out, dtype=np.intp), self._basis
        if self._given is not None and np.array_equal(self._given.out, rows):
            return self._given
        try:
            self._given = BlockWithout(basis, rows)
        except (NotSolvedError, np.linalg.LinAlgError):
            return self.adjusted(out)
        return self._given

    def foreseen(self, problem: Problem, out: Sequence[int]) -> tuple[BlockState, int]:
        """Return where the block lies without some rows, and how many steps lead there.

        That are those of the rows that were looked at last, by what they were seen from: of others,
        or where a step leads upwards, or where the datum hangs on where it begins, there is none.

        Parameters
        ----------
        problem
            The bundle without these rows.
        out
            Which rows, ascending.
        """
        state, given, steps = self._state, self._given, 0
        if given is None or problem.defect or not np.array_equal(given.out, out):
            return state, 0
        value, depth = objective(problem, state)
        step, behind = given.step, int((depth <= 0.0).sum())
        before, last = 0.0, False
        with suppress(NotSolvedError, np.linalg.LinAlgError):
            while True:
                trial = rescaled(problem, move(state, *step))
                linear = linearise(problem, trial)
                above = not linear.vtpv <= value * (1.0 + _ROUNDING)
                if above or int((linear.depth <= 0.0).sum()) > behind:
                    break
                before = before if steps else value - linear.vtpv
                state, value, steps = trial, linear.vtpv, steps + 1
                if last or steps == _MOST_STEPS:
                    break
                step, change = given.again(linear)
                # what is left after it, if it brings as much nearer as the one before
                last = change * change <= _HARDLY * LEFT * problem.observations * before
                before = change
        return state, steps

    def _adjusted(self, out: Sequence[int]) -> Basis:
        self._last = self._given = None  # as large as the block
        if len(out):
            problem = without(self._system.rows, frozenset(out))
            weights = anchor(problem, self._state).weights if problem.defect else None
            linear = linearise(problem, self._state)
            try:
                normal = NormalEquations(problem, self._structure, linear, 0.0, weights)
                cofactors = compute_cofactors(normal, normal.factor())
            except (PointError, NotPositiveError) as error:
                raise left_open(problem, self._structure, self._state, error) from error
        else:
            cofactors = self._system.whole.cofactors
        self._last = Basis(self._system, cofactors, np.array(out, dtype=np.intp))
        return self._last


class BlockWithout:
    """A block without some rows; a `RowsGiven`.

    Parameters
    ----------
    basis
        What it is seen from.
    out
        Rows that are left out, ascending.

    Attributes
    ----------
    out
        As it was given.
    step
        Corrections of photos, points and shared parameters in one linear adjustment without them.
    """

    def __init__(self, basis: Basis, out: Index) -> None:
        self._basis, self.out, self.step = basis, out, basis.step
        self._gone = np.zeros(len(basis.e), dtype=bool)
        self._gone[out] = True
        self.e, self.r, self.vtpv = basis.e, basis.r, basis.vtpv
        self._changed = np.flatnonzero(basis.gone != self._gone)
        if len(self._changed):
            self._change()

    def _change(self) -> None:
        """Let rows come in and go."""
        basis, changed = self._basis, self._changed
        others = np.zeros(len(self._gone), dtype=bool)
        others[changed] = True
        self.e, self.r = self.e.copy(), self.r.copy()
        parts: list[tuple[Index, Index, Array]] = []
        for laid in basis.laid(np.unique(self.places_of(changed))):
            rows, matrix = laid.rows, laid.matrix
            gone, mine = self._gone[rows], others[rows]
            inverse, back = seen_without(matrix, gone)
            taken = np.einsum("cij,cij->ci", matrix @ inverse, matrix)
            left = np.maximum(np.einsum("cii->ci", matrix) - taken, 0.0)
            self.r[rows] = np.where(gone, back, left)
            sign = np.where(gone, -1.0, 1.0)
            inverse = inverse_among(
                basis.without_own(laid) + sign[:, :, None] * np.eye(rows.shape[1]), mine
            )
            place, i, j = np.nonzero(mine[:, :, None] & mine[:, None, :])
            at = np.searchsorted(changed, rows)
            parts.append((at[place, i], at[place, j], inverse[place, i, j]))
        row, column, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        count = len(changed)
        self._nearly = csr_array((values, (row, column)), shape=(count, count))
        self._sign = np.where(basis.gone[changed], 1.0, -1.0)
        self._coupling = RowCoupling(basis.block, basis.cofactors, changed)
        e = basis.e[changed]
        z = self._coupling.solved(self._sign, e, self._nearly)
        moved = self._coupling.moved(z)
        self.step = _sum(self.step, moved)
        self.e -= basis.block.rows.gathered(effect(basis.block.problem, basis.block.linear, moved))
        self.e[changed] = self._sign * z
        self.vtpv += float(z @ e)

    def again(self, linear: Linearised) -> tuple[Unknowns, float]:
        """Return the corrections of another step, with the matrix of where it was linearised.

        Also the squared change of the whitened residuals.

        Parameters
        ----------
        linear
            Where the block has come to, without the rows that are left out.

        Raises
        ------
        NotSolvedError
            What comes in and goes is not found.
        """
        normal, factor = self._basis.cofactors.normal, self._basis.cofactors.factor
        sides = normal.gradient(linear, linear)
        step = normal.solution(factor, sides)
        if len(self._changed):
            e = -self._coupling.seen(step)
            moved = self._coupling.moved(self._coupling.solved(self._sign, e, self._nearly))
            step = _sum(step, moved)
        return step, change_of(sides, step)

    @property
    def exact(self) -> bool:
        """Whether redundancy numbers have what places do to each other."""
        return not len(self._changed)

    def back(self, row: int) -> float | None:
        """Return the redundancy number of a row that has come in, with what places do to others.

        None also where it is not found.
        """
        unit = (self._changed == row).astype(float)
        if not unit @ self._basis.gone[self._changed]:
            return None
        try:
            return float(self._coupling.solved(self._sign, unit, self._nearly) @ unit)
        except NotSolvedError:
            return None

    def places_of(self, rows: Index) -> Index:
        """Return (k,) the places of rows: points, then photos; -1: none."""
        return self._basis.places_of(rows)

    def touching(self, numbers: Index) -> Touching:
        """Return which photos k places have.

        One with control or priors touches every other one: it carries far.
        """
        block = self._basis.block
        problem = block.problem
        points, count = len(problem.points), len(problem.photos)
        at = np.full(points, -1)
        mine = numbers < points
        at[numbers[mine]] = np.flatnonzero(mine)
        rays = np.flatnonzero(at[problem.point] >= 0)
        photos = np.flatnonzero(~mine)
        row = np.concatenate((at[problem.point[rays]], photos))
        column = np.concatenate((problem.photo[rays], numbers[photos] - points))
        seen = csr_array((np.ones(len(row)), (row, column)), shape=(len(numbers), count))
        stated = ~mine
        stated[mine] = np.isin(numbers[mine], block.rows.ground[:, 1])
        return Touching(seen, stated)

    def reach(self, numbers: Index) -> Array:
        """Return (k,) the `reach_of` places."""
        return self._basis.reach(numbers)

    def places(self, numbers: Index) -> Iterator[Places]:
        """Yield places by their numbers, those of as many rows together."""
        block = self._basis.block
        for laid in self._basis.laid(np.asarray(numbers)):
            rows, matrix = laid.rows, laid.matrix
            gone, e = self._gone[rows], self.e[rows]
            z = np.where(gone, e, 0.0)
            back = np.einsum("cij,cj->ci", matrix, z)
            r = np.clip(np.einsum("cii->ci", matrix), 0.0, 1.0)
            yield Places(
                laid.numbers,
                rows,
                np.where(gone, 0.0, e) + back,
                r,
                matrix,
                laid.lever,
                self.vtpv + np.einsum("ci,ci->c", z, back),
                block.redundancy,
                block.names,
            )


def _sum(one: Unknowns, other: Unknowns) -> Unknowns:
    """Return the sum of two changes."""
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]
