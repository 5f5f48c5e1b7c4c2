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

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.apart import Place
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.aliases import Array, Index
from anaplot.bundle.errors.leftout import without
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
    known
        Cofactors there without some of the rows; None: there are none yet.
    """

    def __init__(
        self,
        system: BlockResiduals,
        state: BlockState,
        structure: Structure,
        known: Cofactors | None = None,
    ) -> None:
        self._system, self._state, self._structure = system, state, structure
        self._known = known

    def adjusted(self, out: Sequence[int]) -> BlockWithout:
        """Return all rows, adjusted anew without some.

        Raises
        ------
        PointError, NotPositiveError
            Not all unknowns are determined without them.
        """
        if not len(out):
            return self.drafted(out)
        problem = without(self._system, frozenset(out))
        if self._known is not None and _same_rows(problem, self._known.normal.problem):
            return _Adjusted(self._system, self._known, out)
        weights = anchor(problem, self._state).weights if problem.defect else None
        linear = linearise(problem, self._state)
        normal = NormalEquations(problem, self._structure, linear, 0.0, weights)
        return _Adjusted(self._system, compute_cofactors(normal, normal.factor()), out)

    def drafted(self, out: Sequence[int]) -> BlockWithout:
        """Return all rows: misclosures as `adjusted`, redundancy numbers by the place alone."""
        return _Drafted(self._system, self._system.cofactors, out)


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

    def touching(self, numbers: Index) -> csr_array:
        """Return (k, k) which of k places have photos in common.

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
        far = csr_array(stated[:, None].astype(float))
        every = csr_array(np.ones((1, len(numbers))))
        both = csr_array(seen @ seen.T + far @ every + (far @ every).T)
        both.setdiag(0.0)
        both.eliminate_zeros()
        return both

    def places(self, numbers: Index) -> list[Place]:
        """Return places by their numbers."""
        found: dict[int, Place] = {}
        for mine, rows, g, by_photos in self._laid(np.asarray(numbers)):
            for k, number in enumerate(mine.tolist()):
                found[number] = self._place(rows[k], g[k], by_photos[k])
        return [found[number] for number in np.asarray(numbers).tolist()]

    def _place(self, rows: Index, g: Array, by_photos: Array) -> Place:
        matrix, e, more = self._with_all(rows, g)
        off = self._off(rows)
        matrix[off], matrix[:, off] = 0.0, 0.0
        r = np.clip(np.diag(matrix), 0.0, 1.0)
        order = np.argsort(rows)
        rows, e, r, matrix = rows[order], e[order], r[order], matrix[np.ix_(order, order)]
        names = tuple(map(self._system.names.__getitem__, rows.tolist()))
        vtpv = self.vtpv + more
        system = DenseResiduals(names, e, r, vtpv, self._system.redundancy, matrix)
        return Place(rows, system, np.sqrt(np.maximum(by_photos[order], 0.0)))

    def _with_all(self, rows: Index, g: Array) -> tuple[Array, Array, float]:
        """R and e of a place when all its rows come back, and what v'Pv rises by."""
        raise NotImplementedError

    def _off(self, rows: Index) -> Array:
        """(k,) image coordinates that are switched off: rows of zeros."""
        off, out = self._system.problem.off, np.zeros(len(rows), dtype=bool)
        if off is not None:
            image = rows < self._system.rows.image
            out[image] = off.ravel()[rows[image]]
        return out

    def _laid(self, numbers: Index) -> Iterator[tuple[Index, Index, Array, Array]]:
        """Yield places of equal size: their numbers, rows, G, and of its diagonal that by photos.

        (c,), (c, k), (c, k, k) and (c, k).
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

    def _with_all(self, rows: Index, g: Array) -> tuple[Array, Array, float]:
        gone, e = self._gone[rows], self.e[rows]
        if not gone.any():
            return np.eye(len(rows)) - g, e, 0.0
        beside = g[:, gone]
        weight = np.linalg.inv(np.eye(int(gone.sum())) + beside[gone])
        matrix = np.eye(len(rows)) - g + beside @ weight @ beside.T
        return matrix, e - beside @ (weight @ e[gone]), float(e[gone] @ weight @ e[gone])

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

    def __init__(self, system: BlockResiduals, cofactors: Cofactors, out: Sequence[int]) -> None:
        super().__init__(system, cofactors, out)
        if not len(out):
            return
        self.e, self.r = self.e.copy(), self.r.copy()
        blocks: list[tuple[Index, Array]] = []
        for _, places, g, _ in self._laid(np.unique(self.places_of(self._out))):
            for rows, own in zip(places, g, strict=True):
                gone = self._gone[rows]
                matrix = np.eye(len(rows)) - own
                inverse = np.linalg.inv(matrix[np.ix_(gone, gone)])
                taken = np.einsum("ij,jk,ik->i", matrix[:, gone], inverse, matrix[:, gone])
                self.r[rows] = np.maximum(self.r[rows] - taken, 0.0)
                self.r[rows[gone]] = 1.0 / np.diag(inverse)
                blocks.append((np.searchsorted(self._out, rows[gone]), inverse))
        coupling = RowCoupling(system, self._out)
        e = system.e[self._out]
        z = coupling.solved(e, blocks)
        self.e += coupling.beside(z)
        self.e[self._out] = z
        self.vtpv = system.vtpv - float(z @ e)

    def _with_all(self, rows: Index, g: Array) -> tuple[Array, Array, float]:
        gone, matrix = self._gone[rows], np.eye(len(rows)) - g
        z = self.e[rows][gone]
        e = np.where(gone, 0.0, self.e[rows]) + matrix[:, gone] @ z
        return matrix, e, float(z @ matrix[np.ix_(gone, gone)] @ z)
