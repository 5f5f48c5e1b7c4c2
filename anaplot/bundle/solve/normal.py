"""Normal equations of the photos: every point eliminated as soon as its rays are known.

With A, B, H the whitened derivatives of a ray with respect to its photo, its point and the
additional parameters that belong to several photos, V = sum B'B + prior = L L' of a point,
Z = A'B L^-T and T = L^-1 sum B'H, the points leave

    N_pq = sum A'A - Z_p Z_q',   N_pg = sum A'H - Z_p T,   N_gg = sum H'H - T'T.

Points are inverted in groups of equal numbers of rays, all points of a group at once, and Z_p Z_q'
is summed in clusters of points near each other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_matrix

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.conditionupdate import ConditionUpdate
from anaplot.bundle.solve.eliminated import border_columns, eliminate, of_one_side
from anaplot.bundle.solve.factor import Factor
from anaplot.bundle.solve.givenequations import GivenUpdate
from anaplot.bundle.solve.linearised import Linearised, Unknowns
from anaplot.bundle.solve.offsetequations import OffsetCofactors, OffsetUpdate
from anaplot.bundle.solve.pointroots import PointError
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.rightsides import right_sides
from anaplot.bundle.solve.structure import Structure

__all__ = ["NormalEquations", "PointError"]

_AT_ONCE = 16384  # rays of photos that are laid together at a time


class NormalEquations:
    """The reduced normal equations of the photos at one state.

    Parameters
    ----------
    problem, structure, linear
        The bundle, its structure and its derivatives.
    damping
        Levenberg-Marquardt: every diagonal element grows by this fraction of itself.
    anchor
        (photos, d) weights that take the datum's defect away, or None.

    Raises
    ------
    PointError
        Points whose rays do not meet at an angle.

    Attributes
    ----------
    anchor
        As it was given.
    inverse_root
        (points, 3, 3) L^-1 of every point.
    z
        (m, d, 3) Z of every ray.
    t
        (points, 3, g) T of every point.
    blocks, border, corner
        The matrix.
    corner_scale
        (g,) diagonal of the corner before the points were eliminated.
    """

    def __init__(
        self,
        problem: Problem,
        structure: Structure,
        linear: Linearised,
        damping: float = 0.0,
        anchor: Array | None = None,
    ) -> None:
        self.problem = problem
        self.structure = structure
        self.linear = linear
        self.anchor = anchor
        self._update: ConditionUpdate | None = None
        self._given: GivenUpdate | None = None
        self._offsets: OffsetUpdate | None = None
        d, g = problem.per_photo, problem.in_border
        n = len(problem.photos)
        a, h = linear.a, linear.h
        grow = 1.0 + damping
        blocks = np.zeros((len(structure.pattern.rows), d, d))
        own = np.matmul(linear.photo_rows.transpose(0, 2, 1), linear.photo_rows)
        if linear.given is not None:
            own += linear.given.held_photos(d)
        diagonal = np.einsum("nii->ni", own)
        diagonal[:, 6:] += linear.own_weight
        if damping or anchor is not None:
            whole = diagonal + structure.by_photo @ np.einsum("mij,mij->mj", a, a)
            diagonal += (grow - 1.0 if anchor is None else (1.0 + anchor) * grow - 1.0) * whole
        self.border = np.zeros((n, d, g))
        self.corner = np.zeros((g, g))
        self.corner_scale = np.zeros(g)
        if g:
            self._border_of_rays(a.transpose(0, 2, 1), h)
            corner_diagonal = np.einsum("ii->i", self.corner)
            corner_diagonal += linear.shared_weight
            if problem.additional_still is not None:
                corner_diagonal[problem.additional_still.ravel()] = 1.0
            corner_diagonal *= grow
            self.corner_scale = corner_diagonal.copy()
        self.eliminated, of_points = eliminate(problem, structure, linear, grow)
        self.inverse_root, self.z = self.eliminated.inverse_root, self.eliminated.z
        self.t = self.eliminated.t
        if g:
            self._border_of_points()
        _add_own(own, a, of_points, structure.by_photo)
        del of_points
        blocks[structure.pattern.diagonal] = own
        structure.take(blocks, self.z)
        self.blocks = blocks

    def border_columns(self, group: Index) -> Index:
        """(rays, q) columns of the border that rays of these groups touch."""
        return border_columns(group, self.linear.h.shape[2])

    def seen(
        self, photos: Array, points: Array, shared: Array, rays: Index | slice = slice(None)
    ) -> Array:
        """Return (m, 2, k) what k changes of the unknowns, as `solve` has them, do to the rays.

        To all of them, or to some.
        """
        return self.seen_with(photos, points[self.problem.point[rays]], shared, rays)

    def seen_with(self, photos: Array, of_rays: Array, shared: Array, rays: Index | slice) -> Array:
        """Return it with the changes (m, 3, k) of the rays' own points."""
        problem, linear = self.problem, self.linear
        out: Array = np.matmul(linear.a[rays], photos[problem.photo[rays]])
        out += np.matmul(linear.b[rays], of_rays)
        if len(shared):
            columns = self.border_columns(problem.additional_group[rays])
            out += np.matmul(linear.h[rays], shared[columns])
        return out

    def _border_of_rays(self, at: Array, h: Array) -> None:
        """Add sum A'H and sum H'H."""
        problem = self.problem
        q = h.shape[2]
        for k in range(len(problem.additional_groups)):
            mine = problem.additional_group == k
            if not mine.any():
                continue
            hk = h[mine]
            flat = hk.reshape(-1, q)
            part = slice(k * q, (k + 1) * q)
            self.corner[part, part] = flat.T @ flat
            columns = np.nonzero(mine)[0]
            sums = self.structure.by_photo[:, columns]
            product = np.matmul(at[mine], hk).reshape(len(columns), -1)
            self.border[:, :, part] += (sums @ product).reshape(len(self.border), -1, q)

    def _border_of_points(self) -> None:
        """Subtract Z T and T'T."""
        d, g = self.z.shape[1], self.corner.shape[0]
        for piece, z in self.structure.by_points(self.z):
            t = self.t[piece.points]
            flat = t.reshape(-1, g)
            self.corner -= flat.T @ flat
            zt = np.matmul(z, t).reshape(-1, d * g)
            sums = self.structure.by_photo[:, piece.rays]
            self.border -= (sums @ zt).reshape(self.border.shape)

    def factor(self, progress: Callable[[float], None] | None = None) -> Factor:
        """Factorise; raises NotPositiveError."""
        return Factor(
            self.structure.pattern,
            self.blocks,
            self.border,
            self.corner,
            progress,
            self.corner_scale,
        )

    @cached_property
    def own_gradient(self) -> Unknowns:
        """`gradient` of the state of the matrix itself."""
        return self.gradient(self.linear)

    def gradient(self, other: Linearised, rows: Linearised | None = None) -> Unknowns:
        """Right-hand sides -J'e of photos (n, d), points (p, 3) and border (g,).

        Parameters
        ----------
        other
            Where the misclosures come from.
        rows
            Where the derivatives come from; None: from the state of the matrix itself.
        """
        mine = self.linear if rows is None else rows
        return right_sides(self.problem, self.structure, mine, other)

    def update(self, factor: Factor) -> ConditionUpdate | None:
        """Return what the conditions between points change of solutions; None without any.

        Raises
        ------
        NotComputableError
            Conditions free of error depend on each other or on control free of error.
        """
        conditions, equations = self.problem.conditions, self.linear.conditions
        if conditions is None or equations is None or equations.whitened.shape[0] == 0:
            return None
        if self._update is None:
            q, p = equations.whitened.shape[0], len(self.problem.points)
            photos = np.zeros((len(self.problem.photos), self.problem.per_photo, q))
            points = equations.whitened.toarray().T.reshape(p, 3, q)
            shared = np.zeros((len(self.corner), q))
            gain = self._solve(factor, photos, points, shared)
            self._update = ConditionUpdate.of(conditions, equations, gain)
        return self._update

    def step(self, factor: Factor, linear: Linearised | None = None) -> Unknowns:
        """Return the corrections (n, d), (p, 3), (g,) of one Gauss-Newton step.

        Parameters
        ----------
        factor
            That of the matrix.
        linear
            Where the misclosures come from; None for the state of the matrix itself.
        """
        out, e = self._without(factor, self.linear if linear is None else linear)
        update = self.update(factor)
        if update is not None:
            out = update.applied(out, e)
        return out[0][:, :, 0], out[1][:, :, 0], out[2][:, 0]

    def solution(self, factor: Factor, sides: Unknowns) -> Unknowns:
        """Return the corrections (n, d), (p, 3), (g,) for right-hand sides as `gradient` has them.

        Without what conditions between points ask for.
        """
        return of_one_side(lambda *one: self._solve(factor, *one), sides)

    def conditions_left(self, factor: Factor) -> Array:
        """Return (n,) misclosures of the conditions' rows after that step, in sigmas."""
        conditions, update = self.linear.conditions, self.update(factor)
        if conditions is None or update is None:
            return np.zeros(0 if conditions is None else len(conditions.sigma))
        out, e = self._without(factor, self.linear)
        left: Array = conditions.contrasts @ update.multipliers(out[1], e)[:, 0]
        return left

    def _without(self, factor: Factor, linear: Linearised) -> tuple[Unknowns, Array]:
        """Solve for a step without the conditions; also their misclosures (q, 1)."""
        own = linear is self.linear
        photos, points, shared = self.own_gradient if own else self.gradient(linear)
        out = self._solve(factor, photos[:, :, None], points[:, :, None], shared[:, None])
        update = self.update(factor)
        if update is None or linear.conditions is None:
            return out, np.zeros((0, 1))
        return out, update.equations.contrasted(linear.conditions)[:, None]

    def given_update(self, factor: Factor) -> GivenUpdate | None:
        """Return what a prior that ties unknowns together changes of solutions; None without it."""
        equations = self.linear.given
        if equations is None:
            return None
        if self._given is None:
            q = len(equations.prior)
            photos, points = equations.sides(equations.prior.rest.T)
            sides = (
                photos.reshape(len(self.problem.photos), -1, q),
                points.reshape(-1, 3, q),
                np.zeros((len(self.corner), q)),
            )
            self._given = GivenUpdate.of(equations, self._solve_free(factor, *sides))
        return self._given

    def offset_update(self, factor: Factor) -> OffsetUpdate | None:
        """Return what offsets of the photos' priors change of solutions; None without any.

        Raises
        ------
        OffsetsOpenError
            The orientations leave some of them open.
        """
        equations = self.linear.offsets
        if equations is None:
            return None
        if self._offsets is None:
            sides = equations.sides(self.linear.photo_rows)
            q = sides.shape[2]
            others = np.zeros((len(self.problem.points), 3, q)), np.zeros((len(self.corner), q))
            gain = self.eliminated.solve(factor, sides, *others)
            self._offsets = OffsetUpdate.of(equations, sides, gain)
        return self._offsets

    def offset_cofactors(self, factor: Factor) -> OffsetCofactors | None:
        """Return the cofactors of offsets of the photos' priors; None without any."""
        update = self.offset_update(factor)
        if update is None:
            return None
        later = (self.given_update(factor), self.update(factor))
        return OffsetCofactors.of(
            update, ((one.photos, one.inner) for one in later if one is not None)
        )

    def changes(self, factor: Factor) -> tuple[OffsetUpdate | GivenUpdate | ConditionUpdate, ...]:
        """Return what is added to these equations, of which G M^-1 G' goes off the inverse."""
        every = (self.offset_update(factor), self.given_update(factor), self.update(factor))
        return tuple(one for one in every if one is not None)

    def solve(
        self, factor: Factor, photos: Array, points: Array, shared: Array
    ) -> tuple[Array, Array, Array]:
        """Solve the full normal equations for k right-hand sides, with conditions and priors.

        Parameters
        ----------
        factor
            The factor of this matrix.
        photos, points, shared
            (n, d, k), (p, 3, k), (g, k).
        """
        out = self._solve(factor, photos, points, shared)
        update = self.update(factor)
        return out if update is None else update.applied(out)

    def _solve(self, factor: Factor, photos: Array, points: Array, shared: Array) -> Unknowns:
        """Solve without the conditions."""
        out = self._solve_free(factor, photos, points, shared)
        given = self.given_update(factor)
        return out if given is None else given.applied(out)

    def _solve_free(self, factor: Factor, photos: Array, points: Array, shared: Array) -> Unknowns:
        """Solve for this matrix with offsets of the photos' priors."""
        out = self.eliminated.solve(factor, photos, points, shared)
        offsets = self.offset_update(factor)
        return out if offsets is None else offsets.applied(out)


def _add_own(own: Array, a: Array, of_points: Array, by_photo: csr_matrix) -> None:
    """Add to (n, d, d) what its own rays give a photo: the sum of A'A - Z Z' of each.

    As A' (I - S S') A with (m, 2, 3) S = B L^-T: a weight that is far too large cancels in the
    bracket.
    """
    d = own.shape[1]
    rays, starts = by_photo.indices, by_photo.indptr
    first = 0
    while first < len(own):
        last = int(np.searchsorted(starts, starts[first] + _AT_ONCE, side="right")) - 1
        last = max(last, first + 1)
        mine = rays[starts[first] : starts[last]]
        # a row for every unknown, so that one operation takes a component of all rays
        s, t = np.ascontiguousarray(of_points[mine].transpose(1, 2, 0))
        laid = np.ascontiguousarray(a[mine].reshape(-1, d).T)
        reduced, across = np.empty_like(laid), np.einsum("jm,jm->m", s, t)
        for side, other, of in ((0, 1, s), (1, 0, t)):
            left = (1.0 - np.einsum("jm,jm->m", of, of)) * laid[:, side::2]
            left -= across * laid[:, other::2]
            reduced[:, side::2] = left
        ends = (2 * (starts[first : last + 1] - starts[first])).tolist()
        for k, (start, end) in enumerate(pairwise(ends), first):
            own[k] += laid[:, start:end] @ reduced[:, start:end].T
        first = last
