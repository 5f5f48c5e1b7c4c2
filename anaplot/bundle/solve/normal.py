"""Normal equations of the photos: every point eliminated as soon as its rays are known.

With A, B, H the whitened derivatives of a ray with respect to its photo, its point and the
additional parameters that belong to several photos, V = sum B'B + prior = L L' of a point,
Z = A'B L^-T and T = L^-1 sum B'H, the points leave

    N_pq = sum A'A - Z_p Z_q',   N_pg = sum A'H - Z_p T,   N_gg = sum H'H - T'T.

Points are taken in groups of equal numbers of rays, all points of a group at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.conditions import ConditionEquations
from anaplot.bundle.solve.conditionupdate import ConditionUpdate
from anaplot.bundle.solve.factor import Factor
from anaplot.bundle.solve.imaging import BlockState, imaged, imaged_with_derivatives
from anaplot.bundle.solve.pointroots import PointError, inverse_roots
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Piece, Structure
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.collinearity import turns
from anaplot.photogrammetry.rotation import rotation_angles, rotation_axes

__all__ = [
    "Linearised",
    "NormalEquations",
    "PointError",
    "Unknowns",
    "effect",
    "image_misclosures",
    "linearise",
    "move",
    "objective",
    "rounding",
]

_PORTION = 300_000_000  # bytes of the largest array while right-hand sides are solved for
Unknowns = tuple[Array, Array, Array]  # of photos (n, d), of points (p, 3), shared (g,)


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Whitened derivatives and misclosures at a state: rows are divided by their sigmas.

    Attributes
    ----------
    a
        (m, 2, d) with respect to the ray's photo.
    b
        (m, 2, 3) with respect to its point; columns of coordinates free of error are zero.
    h
        (m, 2, q) with respect to the additional parameters of its group; q = 0 when they are
        photo-invariant or none.
    e
        (m, 2) computed minus observed.
    point_weight, point_e
        (points, 3) weights of control and its whitened misclosure.
    photo_rows, photo_e
        (photos, 6, d) rows of the priors of every photo (zero where there is none) and (photos, 6)
        their misclosures.
    own_e, shared_e
        Misclosures of the priors on additional parameters.
    own_weight, shared_weight
        Their weights.
    depth
        (m,) distance of the point in front of the photo [m].
    conditions
        Of the conditions between points; None without.
    """

    a: Array
    b: Array
    h: Array
    e: Array
    point_weight: Array
    point_e: Array
    photo_rows: Array
    photo_e: Array
    own_weight: Array
    own_e: Array
    shared_weight: Array
    shared_e: Array
    depth: Array
    conditions: ConditionEquations | None = None

    @property
    def vtpv(self) -> float:
        """Weighted sum of squares of all misclosures."""
        return sum(float(np.vdot(e, e)) for e in self.misclosures)

    @property
    def misclosures(self) -> tuple[Array, ...]:
        """Of every kind of observation."""
        of = self.conditions
        more = () if of is None else (of.e,)
        return (self.e, self.point_e, self.photo_e, self.own_e, self.shared_e, *more)


def _angles(rotations: Array) -> Array:
    return np.array([rotation_angles(r) for r in rotations]).reshape(-1, 3)


def _wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _prior_misclosures(problem: Problem, state: BlockState) -> tuple[Array, Array, Array, Array]:
    """Whitened misclosures of control, photo priors, own and shared additional parameters."""
    point = np.where(
        np.isfinite(problem.known_sigma),
        (state.points - (problem.known - state.origin)) / problem.known_sigma,
        0.0,
    )
    photo = np.zeros((len(problem.photos), 6))
    with_position = np.isfinite(problem.position_sigma)
    if with_position.any():
        off = (state.centres - (problem.position - state.origin)) / problem.position_sigma
        photo[:, :3] = np.where(with_position, off, 0.0)
    with_rotation = np.isfinite(problem.rotation_sigma).any(axis=1)
    if with_rotation.any():
        found = _angles(state.rotations[with_rotation])
        off = _wrapped(found - problem.rotation[with_rotation])
        sigma = problem.rotation_sigma[with_rotation]
        photo[with_rotation, 3:] = np.where(np.isfinite(sigma), off / sigma, 0.0)
    own, shared = np.zeros_like(state.own), np.zeros_like(state.shared)
    if len(problem.additional_sigma):
        own = state.own / problem.additional_sigma if state.own.size else own
        if shared.size:
            shared = state.shared / np.tile(
                problem.additional_sigma, len(problem.additional_groups)
            )
    return point, photo, own, shared


def image_misclosures(problem: Problem, state: BlockState) -> tuple[Array, Array]:
    """Return (m, 2) computed minus observed in sigmas, also of rejected ones; (m,) depths [m]."""
    seen = imaged(problem, state)
    e = (seen.xy - problem.xy) / problem.sigma_xy
    return e, seen.depth


def objective(problem: Problem, state: BlockState) -> tuple[float, Array]:
    """Return v'Pv at a state, and the depth of every ray's point [m].

    Infinite where a condition means nothing, as where its points coincide: `linearise` says which.
    """
    e, depth = image_misclosures(problem, state)
    if problem.rejected is not None:
        e[problem.rejected] = 0.0
    total = float(np.vdot(e, e))
    for part in _prior_misclosures(problem, state):
        total += float(np.vdot(part, part))
    try:
        conditions = _condition_equations(problem, state)
    except NotComputableError:
        return float("inf"), depth
    if conditions is not None:
        total += float(np.vdot(conditions.e, conditions.e))
    return (total if total == total else float("inf")), depth


def _condition_equations(problem: Problem, state: BlockState) -> ConditionEquations | None:
    if problem.conditions is None:
        return None
    return problem.conditions.equations(state.points, problem.fixed)


def linearise(problem: Problem, state: BlockState) -> Linearised:
    """Return derivatives and misclosures at a state."""
    seen = imaged_with_derivatives(problem, state)
    weight = 1.0 / problem.sigma_xy
    n, m = len(problem.photos), len(problem.photo)
    d = problem.per_photo
    white = seen.parameter * weight[:, :, None]
    if problem.photo_invariant:
        a = np.empty((m, 2, d))
        np.multiply(seen.photo, weight[:, :, None], out=a[:, :, :6])
        a[:, :, 6:] = white
        h = np.empty((m, 2, 0))
    else:
        a, h = seen.photo * weight[:, :, None], white
    b = seen.point * weight[:, :, None]
    if problem.fixed.any():
        b *= ~problem.fixed[problem.point][:, None, :]
    e = (seen.xy - problem.xy) * weight
    if problem.rejected is not None:
        for part in (a, b, h, e):
            part[problem.rejected] = 0.0
    point_e, photo_e, own_e, shared_e = _prior_misclosures(problem, state)
    rows = np.zeros((n, 6, d))
    with_position = np.isfinite(problem.position_sigma)
    for axis in range(3):
        rows[:, axis, axis] = np.where(
            with_position[:, axis], 1.0 / problem.position_sigma[:, axis], 0.0
        )
    for k in np.nonzero(np.isfinite(problem.rotation_sigma).any(axis=1))[0]:
        omega, phi, _ = rotation_angles(state.rotations[k])
        # d angles = axes^-1 d(small rotation)
        inverse = np.linalg.pinv(rotation_axes(omega, phi), rcond=1e-9)
        weighted = inverse / problem.rotation_sigma[k][:, None]
        rows[k, 3:, 3:6] = np.where(np.isfinite(weighted), weighted, 0.0)
    prior = 1.0 / problem.additional_sigma**2 if len(problem.additional_sigma) else None
    return Linearised(
        a=a,
        b=b,
        h=h,
        e=e,
        point_weight=np.where(np.isfinite(problem.known_sigma), problem.known_sigma**-2.0, 0.0),
        point_e=point_e,
        photo_rows=rows,
        photo_e=photo_e,
        own_weight=prior if prior is not None and problem.photo_invariant else np.zeros(d - 6),
        own_e=own_e,
        shared_weight=(
            np.tile(prior, len(problem.additional_groups))
            if prior is not None and not problem.photo_invariant
            else np.zeros(problem.in_border)
        ),
        shared_e=shared_e,
        depth=seen.depth,
        conditions=_condition_equations(problem, state),
    )


def effect(problem: Problem, linear: Linearised, unknowns: Unknowns) -> Linearised:
    """Return what changes of the unknowns do to every observation, in place of the misclosures."""
    photos, points, shared = unknowns
    e = np.einsum("mij,mj->mi", linear.a, photos[problem.photo])
    e += np.einsum("mij,mj->mi", linear.b, points[problem.point])
    if len(shared):
        of_ray = shared.reshape(-1, linear.h.shape[2])[problem.additional_group]
        e += np.einsum("mij,mj->mi", linear.h, of_ray)
    return replace(
        linear,
        e=e,
        point_e=np.sqrt(linear.point_weight) * points,
        photo_e=np.einsum("nij,nj->ni", linear.photo_rows, photos),
        own_e=np.sqrt(linear.own_weight) * photos[:, 6:],
        shared_e=np.sqrt(linear.shared_weight) * shared,
        conditions=None if linear.conditions is None else linear.conditions.effect(points),
    )


def rounding(problem: Problem, state: BlockState, depth: Array) -> float:
    """Return the squared norm of what rounding does to the misclosures, in a-priori sigmas.

    Parameters
    ----------
    problem, state
        The bundle, and where it is evaluated.
    depth
        (m,) of the rays there [m].
    """
    away = np.abs(state.points).max(axis=1)[problem.point]
    away = away + np.abs(state.centres).max(axis=1)[problem.photo]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        image = problem.c[problem.photo] * (1.0 + away / np.abs(depth))
        size = (image + np.abs(problem.xy).max(axis=1)) / problem.sigma_xy.min(axis=1)
        of_points = np.abs(state.points) / problem.known_sigma
        of_photos = np.abs(state.centres) / problem.position_sigma
    total = 2.0 * float(np.vdot(size, size))
    total += float(np.nansum(of_points**2)) + float(np.nansum(of_photos**2))
    if problem.conditions is not None:
        total += problem.conditions.rounding(state.points) / float(np.finfo(np.float64).eps) ** 2
    return total * float(np.finfo(np.float64).eps) ** 2


def move(
    problem: Problem, state: BlockState, photos: Array, points: Array, shared: Array
) -> BlockState:
    """Add corrections: (photos, d), (points, 3) and (g,)."""
    return BlockState(
        centres=state.centres + photos[:, :3],
        rotations=turns(photos[:, 3:6]) @ state.rotations,
        points=state.points + points,
        own=state.own + photos[:, 6:],
        shared=state.shared + shared,
        origin=state.origin,
    )


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
        self._update: ConditionUpdate | None = None
        d, g = problem.per_photo, problem.in_border
        n, m = len(problem.photos), len(problem.photo)
        a, b, h = linear.a, linear.b, linear.h
        q = h.shape[2]
        grow = 1.0 + damping
        blocks = np.zeros((len(structure.pattern.rows), d * d))
        at = a.transpose(0, 2, 1)
        photo_own = structure.by_photo @ np.matmul(at, a).reshape(m, d * d)
        own = photo_own.reshape(n, d, d)
        own += np.matmul(linear.photo_rows.transpose(0, 2, 1), linear.photo_rows)
        diagonal = np.einsum("nii->ni", own)
        diagonal[:, 6:] += linear.own_weight
        if anchor is not None:
            diagonal += anchor * diagonal
        diagonal *= grow
        blocks[structure.pattern.diagonal] = own.reshape(n, d * d)
        self.border = np.zeros((n, d, g))
        self.corner = np.zeros((g, g))
        self.corner_scale = np.zeros(g)
        self.z = np.empty((m, d, 3))
        self.inverse_root = np.empty((len(problem.points), 3, 3))
        self.t = np.zeros((len(problem.points), 3, g))
        if g:
            self._border_of_rays(at, h)
            corner_diagonal = np.einsum("ii->i", self.corner)
            corner_diagonal += linear.shared_weight
            corner_diagonal *= grow
            self.corner_scale = corner_diagonal.copy()
        for piece in structure.pieces:
            k, count = piece.group.rays, piece.stop - piece.start
            rays, points = piece.rays, piece.points
            bp = b[rays]
            stacked = bp.reshape(count, 2 * k, 3)
            fixed = problem.fixed[points]
            try:
                root = inverse_roots(stacked, linear.point_weight[points], grow, fixed)
            except PointError as error:
                raise PointError(error.points + points.start) from None
            self.inverse_root[points] = root
            scaled = np.matmul(bp.reshape(count, 2 * k, 3), root.transpose(0, 2, 1)).reshape(
                count * k, 2, 3
            )
            z = np.matmul(at[rays], scaled)
            self.z[rays] = z
            tall = z.reshape(count, k * d, 3)
            product = np.matmul(tall, tall.transpose(0, 2, 1))
            which, i, j = piece.pairs
            picked = product.reshape(count, k, d, k, d)[which, i, :, j, :]
            blocks -= piece.sums @ picked.reshape(len(which), d * d)
            if g:
                self._border_of_points(piece, scaled, z, h, q)
        self.blocks = blocks.reshape(-1, d, d)

    def border_columns(self, group: Index) -> Index:
        """(rays, q) columns of the border that rays of these groups touch."""
        q = self.linear.h.shape[2]
        out: Index = group[:, None] * q + np.arange(q)
        return out

    def seen(
        self, photos: Array, points: Array, shared: Array, rays: Index | slice = slice(None)
    ) -> Array:
        """Return (m, 2, k) what k changes of the unknowns, as `solve` has them, do to the rays.

        To all of them, or to some.
        """
        problem, linear = self.problem, self.linear
        out: Array = np.matmul(linear.a[rays], photos[problem.photo[rays]])
        out += np.matmul(linear.b[rays], points[problem.point[rays]])
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

    def _border_of_points(self, piece: Piece, scaled: Array, z: Array, h: Array, q: int) -> None:
        """Subtract Z T and T'T."""
        problem = self.problem
        count, k = piece.stop - piece.start, piece.group.rays
        d, g = z.shape[1], self.corner.shape[0]
        each = np.matmul(scaled.transpose(0, 2, 1), h[piece.rays]).reshape(count, k, 3, q)
        group = problem.additional_group[piece.rays].reshape(count, k)
        t = self.t[piece.points]
        if g == q:
            t += each.sum(axis=1)
        else:
            for ray in range(k):
                columns = self.border_columns(group[:, ray])
                t[np.arange(count)[:, None, None], np.arange(3)[:, None], columns[:, None, :]] += (
                    each[:, ray]
                )
        flat = t.reshape(-1, g)
        self.corner -= flat.T @ flat
        zt = np.matmul(z.reshape(count, k * d, 3), t).reshape(count * k, d * g)
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

    def gradient(self, other: Linearised) -> Unknowns:
        """Right-hand sides -J'e of photos (n, d), points (p, 3) and border (g,).

        Parameters
        ----------
        other
            Where the misclosures come from.
        """
        problem, mine = self.problem, self.linear
        ae = np.einsum("mij,mi->mj", mine.a, other.e)
        photos = -(self.structure.by_photo @ ae)
        photos -= np.einsum("nij,ni->nj", mine.photo_rows, other.photo_e)
        photos[:, 6:] -= np.sqrt(mine.own_weight) * other.own_e
        be = np.einsum("mij,mi->mj", mine.b, other.e)
        points = np.empty((len(problem.points), 3))
        for group in problem.groups:
            mine_be = be[group.ray_slice].reshape(group.points, group.rays, 3)
            points[group.point_slice] = -mine_be.sum(axis=1)
        points -= np.sqrt(mine.point_weight) * other.point_e
        shared = -np.sqrt(mine.shared_weight) * other.shared_e
        if len(shared):
            he = np.einsum("mij,mi->mj", mine.h, other.e)
            columns = self.border_columns(problem.additional_group)
            shared -= np.bincount(columns.ravel(), he.ravel(), minlength=len(shared))
        return photos, points, shared

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

    def solve(
        self, factor: Factor, photos: Array, points: Array, shared: Array
    ) -> tuple[Array, Array, Array]:
        """Solve the full normal equations for k right-hand sides, with the conditions.

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
        """Solve without the conditions, in portions."""
        count = photos.shape[2]
        # the largest array has a value per ray, unknown of its photo, and right-hand side
        step = max(1, _PORTION // (8 * self.z.shape[0] * self.z.shape[1]))
        if count <= step:
            return self._solve_portion(factor, photos, points, shared)
        found = []
        for k in range(0, count, step):
            mine = slice(k, k + step)
            sides = photos[:, :, mine], points[:, :, mine], shared[:, mine]
            found.append(self._solve_portion(factor, *sides))
        x, p, s = (np.concatenate([part[k] for part in found], axis=-1) for k in range(3))
        return x, p, s

    def _solve_portion(
        self, factor: Factor, photos: Array, points: Array, shared: Array
    ) -> Unknowns:
        problem = self.problem
        k = photos.shape[2]
        m, d = self.z.shape[:2]
        y = np.matmul(self.inverse_root, points)
        zy = np.matmul(self.z, y[problem.point]).reshape(m, d * k)
        right = photos - (self.structure.by_photo @ zy).reshape(photos.shape)
        corner = shared - np.einsum("pig,pik->gk", self.t, y) if len(shared) else shared
        x, s = factor.solve(right, corner)
        back = np.matmul(self.z.transpose(0, 2, 1), x[problem.photo])
        for group in problem.groups:
            rays = back[group.ray_slice].reshape(group.points, group.rays, 3, k)
            y[group.point_slice] -= rays.sum(axis=1)
        if len(shared):
            y -= np.matmul(self.t, s)
        return x, np.matmul(self.inverse_root.transpose(0, 2, 1), y), s
