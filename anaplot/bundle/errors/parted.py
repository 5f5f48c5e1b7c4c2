"""A block without some of its rows, linearised where it is, and its places for `adjustment.apart`.

The equations are laid and solved anew without the rows: one factor and its selected inverse give
all misclosures and all redundancy numbers, however many rows are out. A place is a point with its
rays, its control and its priors, or a photo with its priors. Of a point every element of
G = J N^-1 J' between its rows comes from the parts of the inverse that belong to its photos, also
of rows that are out, so that any of them can be brought back by itself.

    R = I - G,  coming back  G' = G - G_s (I + G_ss)^-1 G_s',  e' = e - G_s (I + G_ss)^-1 e_s.

Between rows of two points nothing but the photos can carry an error: with the point eliminated, a
row has A~ Q A~' of its own G by the photos, and abs(R_ij) is at most the root of the product of
both (Cauchy and Schwarz). Its root is the lever.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.doubts import Touching
from anaplot.adjustment.places import Places, inverse_among
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.errors.leftout import rows_missing, without
from anaplot.bundle.errors.rowcoupling import RowCoupling
from anaplot.bundle.solve.datum import anchor
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.solve.residuals import BlockResiduals, designed
from anaplot.bundle.solve.structure import Piece, Structure

__all__ = ["BlockParts", "BlockWithout", "can_be_parted"]

_PORTION = 60_000_000  # bytes of the largest array while places are laid out


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
        system: BlockResiduals,
        state: BlockState,
        structure: Structure,
        reduced: Problem | None = None,
        known: Callable[[], Cofactors | None] = lambda: None,
    ) -> None:
        self._system, self._state, self._structure = system, state, structure
        self._reduced, self._known = reduced, known
        # of all drafts the same: their places have all rows in
        self._reach = np.full(len(system.problem.points) + len(system.problem.photos), np.nan)

    @cached_property
    def begun(self) -> tuple[int, ...]:
        """Rows without which the state was found."""
        if self._reduced is None:
            return ()
        return tuple(rows_missing(self._system.rows, self._reduced).tolist())

    def adjusted(self, out: Sequence[int]) -> BlockWithout:
        """Return all rows, adjusted anew without some.

        Raises
        ------
        PointError, NotPositiveError
            Not all unknowns are determined without them.
        """
        if not len(out):
            return self.drafted(out)
        problem = without(self._system.rows, frozenset(out))
        if self._reduced is not None and _same_rows(problem, self._reduced):
            known = self._known()
            if known is not None:
                return _Adjusted(self._system, known, out)
        weights = anchor(problem, self._state).weights if problem.defect else None
        linear = linearise(problem, self._state)
        normal = NormalEquations(problem, self._structure, linear, 0.0, weights)
        return _Adjusted(self._system, compute_cofactors(normal, normal.factor()), out)

    def drafted(self, out: Sequence[int]) -> BlockWithout:
        """Return all rows: misclosures as `adjusted`, redundancy numbers by the place alone."""
        return _Drafted(self._system, self._system.cofactors, out, self._reach)


class BlockWithout:
    """A block without some rows; a `RowsGiven`.

    Parameters
    ----------
    system
        All rows, linearised somewhere.
    cofactors
        Where the elements between the rows of a place come from.
    out
        Rows that are left out, ascending.
    """

    def __init__(self, system: BlockResiduals, cofactors: Cofactors, out: Sequence[int]) -> None:
        self._system, self._cofactors = system, cofactors
        self._out = np.array(out, dtype=np.intp)
        self._gone = np.zeros(len(system.e), dtype=bool)
        self._gone[self._out] = True
        self.e, self.r, self.vtpv = system.e, system.r, system.vtpv

    def places_of(self, rows: Index) -> Index:
        """Return (k,) the places of rows: points, then photos; -1: none."""
        problem, (first, second, third, _) = self._system.problem, self._system.rows.starts
        place = np.full(len(rows), -1, dtype=np.intp)
        mine = rows < first
        place[mine] = problem.point[rows[mine] // 2]
        mine = (rows >= first) & (rows < second)
        place[mine] = self._system.rows.ground[rows[mine] - first, 1]
        mine = (rows >= second) & (rows < third)
        place[mine] = len(problem.points) + self._system.rows.priors[rows[mine] - second, 0]
        return place

    def touching(self, numbers: Index) -> Touching:
        """Return which photos k places have.

        One with control or priors touches every other one: it carries far.
        """
        problem = self._system.problem
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
        stated[mine] = np.isin(numbers[mine], self._system.rows.ground[:, 1])
        return Touching(seen, stated)

    def reach(self, numbers: Index) -> Array:
        """Return (k,) the `Places.reach` of places."""
        out = np.zeros(len(numbers))
        for places in self.places(numbers):
            out[np.searchsorted(numbers, places.numbers)] = places.reach
        return out

    def places(self, numbers: Index) -> Iterator[Places]:
        """Yield places by their numbers, those of as many rows together."""
        names, redundancy = self._system.names, self._system.redundancy
        for mine, rows, g, by_photos in self._laid(np.asarray(numbers)):
            matrix, e, more = self._with_all(rows, g)
            off = self._off(rows)
            matrix[off[:, :, None] | off[:, None, :]] = 0.0
            r = np.clip(np.einsum("cii->ci", matrix), 0.0, 1.0)
            lever = np.sqrt(np.maximum(by_photos, 0.0))
            yield Places(mine, rows, e, r, matrix, lever, self.vtpv + more, redundancy, names)

    def _with_all(self, rows: Index, g: Array) -> tuple[Array, Array, Array]:
        """R and e of places when all their rows come back, and what v'Pv rises by.

        (c, k, k), (c, k) and (c,) of (c, k) rows and (c, k, k) parts of G.
        """
        raise NotImplementedError

    def _off(self, rows: Index) -> Bools:
        """(c, k) image coordinates that are switched off: rows of zeros."""
        off, out = self._system.problem.off, np.zeros(rows.shape, dtype=bool)
        if off is not None:
            image = rows < self._system.rows.image
            out[image] = off.ravel()[rows[image]]
        return out

    def _laid(self, numbers: Index) -> Iterator[tuple[Index, Index, Array, Array]]:
        """Yield places of equal size: their numbers, rows, G, and of its diagonal that by photos.

        (c,), (c, k) ascending, (c, k, k) and (c, k).
        """
        problem, rows = self._system.problem, self._system.rows
        points = numbers[(numbers >= 0) & (numbers < len(problem.points))]
        ground = np.bincount(rows.ground[:, 1], minlength=len(problem.points))
        for piece in self._cofactors.normal.structure.pieces:
            mine = points[(points >= piece.points.start) & (points < piece.points.stop)]
            wide = piece.group.rays * problem.per_photo
            step = max(1, _PORTION // (8 * wide * (wide + 4 * piece.group.rays)))
            for count in np.unique(ground[mine]).tolist():
                alike = mine[ground[mine] == count]
                for start in range(0, len(alike), step):
                    part = alike[start : start + step]
                    yield part, *self._of_points(piece, part, count)
        for number in numbers[numbers >= len(problem.points)].tolist():
            yield np.array([number]), *self._of_photo(number - len(problem.points))

    def _of_photo(self, photo: int) -> tuple[Index, Array, Array]:
        cofactors, rows = self._cofactors, self._system.rows
        mine = np.flatnonzero(rows.priors[:, 0] == photo)
        design = self._system.cofactors.normal.linear.photo_rows[photo, rows.priors[mine, 1]]
        diagonal = cofactors.normal.structure.pattern.diagonal[photo]
        g = design @ cofactors.inverse.blocks[diagonal] @ design.T
        return rows.starts[1] + mine[None], g[None], np.diag(g)[None]

    def _of_points(self, piece: Piece, points: Index, count: int) -> tuple[Index, Array, Array]:
        """Rows, G and its part by photos of points of a piece with `count` rows of the ground."""
        normal, inverse = self._cofactors.normal, self._cofactors.inverse
        problem, full = normal.problem, self._system.cofactors.normal.linear
        c, k, d, g = len(points), piece.group.rays, problem.per_photo, len(normal.corner)
        at = points - piece.points.start
        rays = piece.rays.start + at[:, None] * k + np.arange(k)
        design = np.zeros((c, 2 * k + count, k, d))
        b = np.zeros((c, 2 * k + count, 3))
        for i in range(k):
            design[:, 2 * i : 2 * i + 2, i] = full.a[rays[:, i]]
        b[:, : 2 * k] = full.b[rays].reshape(c, 2 * k, 3)
        rows = np.empty((c, 2 * k + count), dtype=np.intp)
        rows[:, : 2 * k] = (2 * rays[:, :, None] + np.arange(2)).reshape(c, 2 * k)
        if count:
            ground = self._system.rows.ground
            order = np.argsort(ground[:, 1], kind="stable")
            first = np.searchsorted(ground[order, 1], points)
            mine = order[first[:, None] + np.arange(count)]
            rows[:, 2 * k :] = self._system.rows.starts[0] + mine
            kind, _, axis = np.moveaxis(ground[mine], 2, 0)
            weight = full.point_weight[kind, points[:, None], axis]
            b[np.arange(c)[:, None], 2 * k + np.arange(count), axis] = np.sqrt(weight)
        root = normal.inverse_root[points]
        z = normal.z[rays].reshape(c, k * d, 3)
        b = b @ root.transpose(0, 2, 1)
        reduced = design.reshape(c, 2 * k + count, k * d) - b @ z.transpose(0, 2, 1)
        q = normal.structure.among(problem.photo[rays], inverse.blocks)
        of_photos = reduced @ q @ reduced.transpose(0, 2, 1)
        if g:
            h = np.zeros((c, 2 * k + count, g))
            for i in range(k):
                own = full.h[rays[:, i]]
                columns = normal.border_columns(problem.additional_group[rays[:, i]])
                np.put_along_axis(
                    h[:, 2 * i : 2 * i + 2],
                    np.broadcast_to(columns[:, None], own.shape),
                    own,
                    axis=2,
                )
            h -= b @ normal.t[points]
            beside = inverse.border[problem.photo[rays]].reshape(c, k * d, g)
            cross = reduced @ beside @ h.transpose(0, 2, 1)
            of_photos += cross + cross.transpose(0, 2, 1)
            of_photos += h @ inverse.corner @ h.transpose(0, 2, 1)
        total = of_photos + b @ b.transpose(0, 2, 1)
        return rows, total, np.einsum("cii->ci", of_photos)


def _same_rows(problem: Problem, other: Problem) -> bool:
    """Whether two bundles of one block have the same image coordinates, control and priors."""
    return (
        np.array_equal(problem.newly_rejected, other.newly_rejected)
        and np.array_equal(problem.ground_sigma, other.ground_sigma, equal_nan=True)
        and np.array_equal(problem.prior_sigma, other.prior_sigma, equal_nan=True)
    )


class _Adjusted(BlockWithout):
    """Adjusted anew: the cofactors are those without the rows that are out."""

    def __init__(self, system: BlockResiduals, cofactors: Cofactors, out: Sequence[int]) -> None:
        super().__init__(system, cofactors, out)
        self.e = self._left()
        kept = self.e[~self._gone]
        self.vtpv = float(kept @ kept)
        self.r = self._redundancies()

    def _with_all(self, rows: Index, g: Array) -> tuple[Array, Array, Array]:
        gone, e, one = self._gone[rows], self.e[rows], np.eye(rows.shape[1])
        matrix, more = one - g, np.zeros(len(rows))
        some = gone.any(axis=1)
        if some.any():
            gone, g = gone[some], g[some]
            weight = inverse_among(one + g, gone)
            taken = np.einsum("cij,cj->ci", weight, np.where(gone, e[some], 0.0))
            matrix[some] += g @ weight @ g
            more[some] = np.einsum("ci,ci->c", taken, e[some])
            e[some] -= np.einsum("cij,cj->ci", g, taken)
        return matrix, e, more

    def _left(self) -> Array:
        """(n,) misclosures after one linear adjustment without what is out, of all rows."""
        normal, system = self._cofactors.normal, self._system
        linear, full = normal.linear, system.cofactors.normal.linear
        photos, points, shared = normal.step(self._cofactors.factor)
        own = system.problem.photo_invariant
        parameters = linear.own_e if own else linear.shared_e
        before = system.rows.gather(full.e, full.point_e, full.photo_e, parameters, np.zeros(0))
        moved = designed(system, photos[:, :, None], points[:, :, None], shared[:, None])
        return np.asarray(-(before + moved[:, 0]))

    def _redundancies(self) -> Array:
        """(n,) redundancy numbers; of rows that are out those that they have if they come back."""
        cofactors, rows = self._cofactors, self._system.rows
        own = self._system.problem.photo_invariant
        held = cofactors.r_own if own else cofactors.r_shared
        r = rows.gather(
            cofactors.r,
            np.nan_to_num(cofactors.r_ground),
            np.nan_to_num(cofactors.r_photo),
            np.clip(held, 0.0, 1.0),
            cofactors.r_conditions,
        )
        places = np.unique(self.places_of(self._out))
        own_g = np.zeros(len(r))
        for _, mine, g, _ in self._laid(places):
            own_g[mine] = np.einsum("kii->ki", g)
        r[self._out] = 1.0 / (1.0 + own_g[self._out])
        return np.asarray(r)


class _Drafted(BlockWithout):
    """Seen from the adjustment with all rows: z = R_SS^-1 e_S by conjugate gradients.

    Places hardly touch: with what they are by themselves taken first it takes a few steps.
    """

    def __init__(
        self, system: BlockResiduals, cofactors: Cofactors, out: Sequence[int], reach: Array
    ) -> None:
        super().__init__(system, cofactors, out)
        self._reach = reach
        if not len(out):
            return
        self.e, self.r = self.e.copy(), self.r.copy()
        parts: list[tuple[Index, Index, Array]] = []
        for _, rows, g, _ in self._laid(np.unique(self.places_of(self._out))):
            gone, matrix = self._gone[rows], np.eye(rows.shape[1]) - g
            inverse = inverse_among(matrix, gone)
            taken = np.einsum("cij,cij->ci", matrix @ inverse, matrix)
            error = np.where(gone, np.einsum("cii->ci", inverse), 1.0)
            self.r[rows] = np.where(gone, 1.0 / error, np.maximum(self.r[rows] - taken, 0.0))
            place, i, j = np.nonzero(gone[:, :, None] & gone[:, None, :])
            at = np.searchsorted(self._out, rows)
            parts.append((at[place, i], at[place, j], inverse[place, i, j]))
        row, column, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        coupling = RowCoupling(system, self._out)
        e = system.e[self._out]
        count = len(self._out)
        z = coupling.solved(e, csr_array((values, (row, column)), shape=(count, count)))
        self.e += coupling.beside(z)
        self.e[self._out] = z
        self.vtpv = system.vtpv - float(z @ e)

    def reach(self, numbers: Index) -> Array:
        """Return (k,) the `Places.reach` of places, each found once."""
        missing = numbers[np.isnan(self._reach[numbers])]
        if len(missing):
            self._reach[missing] = super().reach(missing)
        return np.asarray(self._reach[numbers])

    def _with_all(self, rows: Index, g: Array) -> tuple[Array, Array, Array]:
        gone, matrix, e = self._gone[rows], np.eye(rows.shape[1]) - g, self.e[rows]
        z = np.where(gone, e, 0.0)
        back = np.einsum("cij,cj->ci", matrix, z)
        return matrix, np.where(gone, 0.0, e) + back, np.einsum("ci,ci->c", z, back)
