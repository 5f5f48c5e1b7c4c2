"""Exact cofactors and redundancy numbers of every observation of a bundle.

Nothing of the size of the block is inverted. With Q_c the part of the inverse of the reduced
normal equations that belongs to the photos (and the shared parameters) of one point, V = L L' its
own equations, Z those with its photos times L^-T, and S = B L^-T, all follows point by point:

    cov(photo, point) = -Q_c Z L^-1,    Q_point = L^-T U L^-1 with U = I + Z' Q_c Z,
    q_ll(ray) = A Q_c A' - A Q_c Z S' - S Z' Q_c A' + S U S'.

All is whitened (observations divided by their a-priori sigmas), so that r = 1 - diag(q_ll).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array, Index
from anaplot.bundle.solve.factor import Factor, SelectedInverse
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.offsetequations import OffsetCofactors
from anaplot.bundle.solve.problem import Problem

__all__ = ["Cofactors", "DatumChange", "cofactor_column", "compute_cofactors"]


_PORTION = 60_000_000  # bytes of the largest array while something is added to the equations
_ROUNDING = 1e-11  # variance after a change of datum over what it is the difference of


@dataclass(frozen=True, slots=True, eq=False)
class DatumChange:
    """From the datum the equations were solved in to the one that is reported.

    Attributes
    ----------
    null_photos, null_points
        (n, d, k) and (p, 3, k): what the changes of datum do to the unknowns (G): seven, or those
        that priors leave open.
    held_photos, held_points
        The combinations D held to zero, of the same shapes.
    variance
        (k,) of what the combinations are held to: zeros, but for a scale that distances give.
    by_conditions
        (n,) what an error of one standard deviation in each row of the conditions changes that
        scale by; empty where they give none.
    """

    null_photos: Array
    null_points: Array
    held_photos: Array
    held_points: Array
    variance: Array = field(default_factory=lambda: np.zeros(7))
    by_conditions: Array = field(default_factory=lambda: np.zeros(0))

    def of_points(self, photos: Array, points: Array) -> Array:
        """Return (p, 3, k) changes of points in this datum, from k changes of all unknowns.

        Parameters
        ----------
        photos, points
            (n, d, k) and (p, 3, k) in the datum of the solution.
        """
        return self.of_changes(photos, points)[1]

    def of_changes(self, photos: Array, points: Array) -> tuple[Array, Array]:
        """Return k changes of photos and points, (n, d, k) and (p, 3, k), in this datum."""
        moved = np.linalg.solve(self.defect, self.held(photos, points))
        return photos - self.null_photos @ moved, points - self.null_points @ moved

    def of_gradients(self, photos: Array, points: Array) -> tuple[Array, Array, Array]:
        """Return gradients of k functions of unknowns in this datum by those of the solution.

        Parameters
        ----------
        photos, points
            (n, d, k) and (p, 3, k).

        Returns
        -------
        (n, d, k), (p, 3, k) and (k, 7) arrays
            The last by what the combinations are held to.
        """
        along = np.einsum("nik,nil->kl", photos, self.null_photos)
        along += np.einsum("nik,nil->kl", points, self.null_points)
        moves = along @ np.linalg.inv(self.defect)
        return photos - self.held_photos @ moves.T, points - self.held_points @ moves.T, moves

    def held(self, photos: Array, points: Array) -> Array:
        """Return (d, k) what the held combinations make of k changes of the unknowns."""
        out: Array = np.einsum("nil,nik->lk", self.held_photos, photos)
        out += np.einsum("nil,nik->lk", self.held_points, points)
        return out

    def of_functions(self, points: Array) -> tuple[Array, Array]:
        """Return functions of the points as they are in this datum, which holds no photo.

        Parameters
        ----------
        points
            (p, 3, k) gradients of k functions.

        Returns
        -------
        (p, 3, k) and (k, 7) arrays
            Gradients by changes in the datum of the solution, and by what the combinations are held
            to.
        """
        none = np.zeros((*self.null_photos.shape[:2], points.shape[2]))
        _, out, moves = self.of_gradients(none, points)
        return out, moves

    @property
    def gives_scale(self) -> bool:
        """Whether distances give the scale: lengths mean something in this datum."""
        return len(self.by_conditions) > 0

    @property
    def defect(self) -> Array:
        """(k, k) D'G."""
        return self.held(self.null_photos, self.null_points)


@dataclass(frozen=True, slots=True, eq=False)
class Cofactors:
    """Cofactors with the a-priori variances of the observations.

    Attributes
    ----------
    normal, factor, inverse
        What they were computed from; in the datum of the solution.
    r
        (m, 2) redundancy numbers of x and y; zero where a coordinate is rejected.
    response
        (m, 3, 2) change of the ray's own point per whitened error of x and y [m].
    points, photos
        (p, 3, 3) [m^2] and (n, d, d) cofactors in the reported datum; rows and columns of what
        the datum holds are zero.
    shared
        (g, g) of the shared additional parameters.
    photos_shared
        (n, d, g) between photos and shared additional parameters, in the reported datum.
    r_ground
        (2, p, 3) redundancy numbers of weighted control and of the points' priors; NaN where
        nothing is observed.
    r_photo
        (n, 6) of the priors of the photos; NaN where there are none.
    r_own, r_shared
        Of the priors on additional parameters; NaN without.
    r_conditions
        Of the rows of conditions between points; zero where they are rejected.
    change
        What leads to the reported datum; None where it is that of the solution.
    offsets
        Of what the photos' priors have in common, in the datum of the solution; None without.
    """

    normal: NormalEquations = field(repr=False)
    factor: Factor = field(repr=False)
    inverse: SelectedInverse = field(repr=False)
    r: Array
    response: Array
    points: Array
    photos: Array
    shared: Array
    photos_shared: Array
    r_ground: Array
    r_photo: Array
    r_own: Array
    r_shared: Array
    r_conditions: Array
    change: DatumChange | None = field(default=None, repr=False)
    offsets: OffsetCofactors | None = field(default=None, repr=False)

    @property
    def point_deviations(self) -> Array:
        """(p, 3) standard deviations of the points [m], with the a-priori sigma0."""
        # a coordinate free of error has the cofactor zero, but for rounding
        return np.asarray(np.sqrt(np.maximum(np.einsum("nii->ni", self.points), 0.0)))

    def point_rays(self, point: int) -> tuple[Index, Array]:
        """Return the rays of a point and the (2k, 2k) whitened cofactors of their residuals."""
        _, rays, q = next(self.several_rays([point]))
        return rays[0], q[0]

    def several_rays(self, points: Sequence[int]) -> Iterator[tuple[Index, Index, Array]]:
        """Yield what `point_rays` returns of several points, those with as many rays together.

        Yields
        ------
        tuple
            (p,) points, (p, k) their rays, (p, 2k, 2k) cofactors.
        """
        wanted = np.unique(np.asarray(points, dtype=np.intp))
        d = self.normal.linear.a.shape[2]
        for group in self.normal.problem.groups:
            first, k = group.first_point, group.rays
            start, end = np.searchsorted(wanted, (first, first + group.points)).tolist()
            step = max(1, _PORTION // (64 * (k * d) ** 2))
            for at in range(start, end, step):
                some = wanted[at : min(at + step, end)]
                rays = group.first_ray + (some - first)[:, None] * k + np.arange(k)
                yield some, rays, self._of_rays(some, rays)

    def several_correlations(
        self, points: Sequence[int]
    ) -> Iterator[tuple[int, tuple[Index, Array]]]:
        """Yield of points their k rays, and the (2k, 2k) correlations of the residuals.

        NaN for coordinates that nothing checks.
        """
        for some, rays, q in self.several_rays(points):
            diagonal = np.einsum("pii->pi", q)
            size = np.sqrt(np.where(diagonal > TESTABLE, diagonal, np.nan))
            rho = np.clip(q / size[:, :, None] / size[:, None, :], -1.0, 1.0)
            yield from zip(some.tolist(), zip(rays, rho, strict=True), strict=True)

    def _of_rays(self, points: Index, rays: Index) -> Array:
        """Return (p, 2k, 2k) cofactors of (p, k) rays, all that the points have."""
        problem, linear = self.normal.problem, self.normal.linear
        (p, k), d = rays.shape, linear.a.shape[2]
        every, photos = rays.ravel(), problem.photo[rays]
        q = self.normal.structure.among(photos, self.inverse.blocks)
        each = np.arange(k)
        design = np.zeros((p, k, 2, k, d))
        design[:, each, :, each] = linear.a[rays].swapaxes(0, 1)
        root = self.normal.inverse_root[points]
        turned = root.swapaxes(1, 2)
        b = linear.b[rays].reshape(p, 2 * k, 3)
        z = np.ascontiguousarray(self.normal.z[rays].reshape(p, k * d, 3).swapaxes(1, 2))
        reduced = design.reshape(p, 2 * k, k * d) - b @ (turned @ z)
        adjusted = reduced @ q @ reduced.swapaxes(1, 2)
        adjusted += b @ (turned @ root) @ b.swapaxes(1, 2)
        g = len(self.shared)
        if g:
            of_rays = np.zeros((p * k, 2, g))
            columns = self.normal.border_columns(problem.additional_group[every])
            np.put_along_axis(of_rays, np.repeat(columns[:, None], 2, 1), linear.h[every], 2)
            h = of_rays.reshape(p, 2 * k, g) - b @ turned @ self.normal.t[points]
            beside = self.inverse.border[photos].reshape(p, k * d, g)
            cross = reduced @ beside @ h.swapaxes(1, 2)
            shared = h @ self.inverse.corner @ h.swapaxes(1, 2)
            adjusted += cross + cross.swapaxes(1, 2) + shared
        for change in self.normal.changes(self.factor):
            shown = self.normal.seen(*change.gain, every).reshape(p, 2 * k, -1)
            adjusted -= shown @ change.inner @ shown.swapaxes(1, 2)
        weighted = _weighted(problem, every).reshape(p, 2 * k)
        out: Array = weighted[:, :, None] * np.eye(2 * k) - adjusted
        return out


def cofactor_column(normal: NormalEquations, factor: Factor, ray: int, axis: int) -> Array:
    """Return (m, 2): a column of Q_vv P of the image coordinates (Gruen 1980, eq. 12-17).

    One right-hand side reduced and one back-substitution; whitened, so an element is the cofactor
    of two residuals divided by the product of their a-priori sigmas.

    Parameters
    ----------
    normal, factor
        Normal equations without damping, and their factor.
    ray, axis
        The image coordinate.
    """
    problem, linear = normal.problem, normal.linear
    n, d = len(problem.photos), linear.a.shape[2]
    photos = np.zeros((n, d, 1))
    points = np.zeros((len(problem.points), 3, 1))
    shared = np.zeros((len(normal.corner), 1))
    photos[problem.photo[ray], :, 0] = linear.a[ray, axis]
    points[problem.point[ray], :, 0] = linear.b[ray, axis]
    if len(shared):
        columns = normal.border_columns(problem.additional_group[[ray]])[0]
        shared[columns, 0] = linear.h[ray, axis]
    out = -normal.seen(*normal.solve(factor, photos, points, shared))[:, :, 0]
    out[ray, axis] += _weighted(problem, np.array([ray]))[0, axis]
    return out


def _weighted(problem: Problem, rays: Index | slice) -> Array:
    """(k, 2) ones; zeros for rejected image coordinates, which have no residual to speak of."""
    if problem.rejected is None:
        return np.ones((len(problem.photo[rays]), 2))
    return np.asarray(~problem.rejected[rays], dtype=float)


def compute_cofactors(
    normal: NormalEquations,
    factor: Factor,
    change: DatumChange | None = None,
    progress: Callable[[float], None] | None = None,
) -> Cofactors:
    """Compute the cofactors of every observation and unknown.

    Parameters
    ----------
    normal, factor
        Normal equations without damping, and their factor.
    change
        Datum of the reported cofactors of unknowns; residuals do not depend on it.
    progress
        Called with the fraction done.
    """
    problem, linear = normal.problem, normal.linear
    inverse = factor.selected_inverse(progress)
    m, d, g = len(problem.photo), linear.a.shape[2], len(normal.corner)
    count = len(problem.points)
    adjusted = np.empty((m, 2))
    response = np.empty((m, 3, 2))
    q_points = np.empty((count, 3, 3))
    own = inverse.blocks[normal.structure.pattern.diagonal]
    all_qz = _photos_and_points(normal, inverse)
    for piece in normal.structure.pieces:
        k, size = piece.group.rays, piece.stop - piece.start
        rays, points = piece.rays, piece.points
        root = normal.inverse_root[points]
        turned = root.transpose(0, 2, 1)
        photo = problem.photo[rays]
        z = normal.z[rays].reshape(size, k * d, 3)
        qz = all_qz[rays].reshape(size, k * d, 3)
        a, b = linear.a[rays], linear.b[rays].reshape(size, 2 * k, 3)
        h = linear.h[rays]
        inner = np.broadcast_to(np.eye(3), (size, 3, 3))  # L' Q_point L
        if g:
            t = normal.t[points]  # 3 x g
            tt = t.transpose(0, 2, 1)
            beside = inverse.border[photo].reshape(size, k * d, g)
            qz_shared = np.matmul(beside.transpose(0, 2, 1), z) + np.matmul(inverse.corner, tt)
            qz += np.matmul(beside, tt)
            inner = inner + np.matmul(t, qz_shared)
        inner = inner + np.matmul(z.transpose(0, 2, 1), qz)
        q_points[points] = np.matmul(np.matmul(turned, inner), root)
        # of every ray, with respect to its point as L' turns it
        scaled = np.matmul(b, turned)
        back = np.matmul(scaled, inner).reshape(size * k, 2, 3)
        scaled = scaled.reshape(size * k, 2, 3)
        aqz = np.matmul(a, qz.reshape(size * k, d, 3))
        back -= aqz
        if g:
            columns = normal.border_columns(problem.additional_group[rays])
            owner = np.repeat(np.arange(size), k)
            # rows of the shared parameters that this ray depends on
            qz_h = np.matmul(h, qz_shared[owner[:, None], columns])
            back -= qz_h
            aqz += qz_h
        across = scaled.transpose(0, 2, 1)
        q_ray = np.matmul(back, across)
        q_ray -= np.matmul(scaled, aqz.transpose(0, 2, 1))
        q_ray += np.matmul(np.matmul(a, own[photo]), a.transpose(0, 2, 1))
        if g:
            beside_h = inverse.border[photo[:, None, None], np.arange(d)[:, None], columns[:, None]]
            corner_h = inverse.corner[columns[:, :, None], columns[:, None, :]]
            ht = h.transpose(0, 2, 1)
            hb = np.matmul(a, np.matmul(beside_h, ht))
            q_ray += hb + hb.transpose(0, 2, 1) + np.matmul(np.matmul(h, corner_h), ht)
        adjusted[rays] = np.einsum("mii->mi", q_ray)
        # L^-T takes it back
        back = np.matmul(back.reshape(size, 2 * k, 3), root).reshape(size * k, 2, 3)
        response[rays] = back.transpose(0, 2, 1)
    del all_qz
    corner, beside_photos = inverse.corner, inverse.border
    r_conditions = np.zeros(0 if problem.conditions is None else len(problem.conditions.rows))
    for added in normal.changes(factor):
        x, y, s = added.gain
        xw, yw, sw = (part @ added.inner for part in added.gain)
        step = max(1, _PORTION // (16 * added.inner.shape[0]))
        for first in range(0, m, step):
            part = slice(first, first + step)
            seen = normal.seen(x, y, s, part)
            adjusted[part] -= np.einsum("mij,mij->mi", seen @ added.inner, seen)
            response[part] -= np.matmul(yw[problem.point[part]], seen.transpose(0, 2, 1))
        q_points -= np.matmul(yw, y.transpose(0, 2, 1))
        own = own - np.matmul(xw, x.transpose(0, 2, 1))
        corner, beside_photos = corner - sw @ s.T, beside_photos - np.matmul(xw, s.T)
    update = normal.update(factor)
    if update is not None:
        r_conditions = np.diag(update.rows).copy()
    r = _weighted(problem, slice(None)) - adjusted
    np.clip(r, 0.0, 1.0, out=r)
    weight = linear.point_weight
    r_ground = np.where(
        weight > 0.0, np.clip(1.0 - np.einsum("nii->ni", q_points) * weight, 0.0, 1.0), np.nan
    )
    offsets = normal.offset_cofactors(factor)
    beside = np.zeros((len(own), 6))
    if offsets is not None and linear.offsets is not None:
        beside = offsets.of_rows(linear.offsets, linear.photo_rows)
    r_photo = _photo_priors(linear.photo_rows, own, beside)
    with np.errstate(invalid="ignore"):
        r_own = np.where(
            linear.own_weight > 0.0,
            1.0 - np.einsum("nii->ni", own)[:, 6:] * linear.own_weight,
            np.nan,
        )
        r_shared = np.where(
            linear.shared_weight > 0.0, 1.0 - np.diag(corner) * linear.shared_weight, np.nan
        )
    if problem.additional_still is not None:
        moving = ~problem.additional_still.ravel()
        corner = np.where(moving[:, None] & moving, corner, 0.0)
    photos = own
    if change is not None:
        photos, q_points, beside_photos, response = _changed(
            normal, factor, change, own, q_points, beside_photos, response
        )
    return Cofactors(
        normal,
        factor,
        inverse,
        r,
        response,
        q_points,
        photos,
        corner,
        beside_photos,
        r_ground,
        r_photo,
        r_own,
        r_shared,
        r_conditions,
        change,
        offsets,
    )


def _photos_and_points(normal: NormalEquations, inverse: SelectedInverse) -> Array:
    """Return (m, d, 3) of every ray the rows of its photo in Q_c Z of its point.

    Times L^-1 they are minus the covariances of photo and point, but for shared parameters.
    """
    out = np.empty_like(normal.z)
    for cluster in normal.structure.clusters:
        tall = cluster.matrix_of(inverse.blocks) @ cluster.of.laid_out(normal.z)
        out[cluster.of.rays] = cluster.of.of_rays(tall)
    return out


def _photo_priors(rows: Array, own: Array, beside: Array) -> Array:
    out = np.full(rows.shape[:2], np.nan)
    some = np.nonzero(np.any(rows != 0.0, axis=(1, 2)))[0]
    if len(some):
        q = np.einsum("nij,njk,nik->ni", rows[some], own[some], rows[some]) + beside[some]
        present = np.any(rows[some] != 0.0, axis=2)
        out[some] = np.where(present, np.clip(1.0 - q, 0.0, 1.0), np.nan)
    return out


def _changed(
    normal: NormalEquations,
    factor: Factor,
    change: DatumChange,
    photos: Array,
    points: Array,
    border: Array,
    response: Array,
) -> tuple[Array, Array, Array, Array]:
    """S Q S' with S = I - G (D'G)^-1 D', of photos, of points and of photos with the parameters.

    Also S times the response of a point to its rays. The datum moves no additional parameter:
    their rows of G are zero.
    """
    problem = normal.problem
    shared = np.zeros((len(normal.corner), change.held_points.shape[2]))
    e_photo, e_point, e_shared = normal.solve(
        factor, change.held_photos, change.held_points, shared
    )
    middle = np.linalg.inv(change.defect)
    held = change.held(e_photo, e_point) + np.diag(change.variance)
    spread = middle @ held @ middle.T

    def transformed(q: Array, null: Array, e: Array) -> Array:
        side = np.einsum("nik,kl,njl->nij", null, middle, e)
        moved = np.einsum("nik,kl,njl->nij", null, spread, null)
        out: Array = q - side - side.transpose(0, 2, 1) + moved
        # the variance of what the datum holds is zero but for the rounding of what cancels
        whole = np.einsum("nii->ni", q) + np.einsum("nii->ni", moved)
        free = np.einsum("nii->ni", out) > _ROUNDING * whole
        return np.where(free[:, :, None] & free[:, None, :], out, 0.0)

    seen = normal.seen(e_photo, e_point, e_shared)
    shift = np.einsum("nik,kl,njl->nij", change.null_points[problem.point], middle, seen)
    new_photos = transformed(photos, change.null_photos, e_photo)
    new_border = border - np.einsum("nik,kl,gl->nig", change.null_photos, middle, e_shared)
    still = np.einsum("nii->ni", new_photos) == 0.0
    return (
        new_photos,
        transformed(points, change.null_points, e_point),
        np.where(still[:, :, None], 0.0, new_border),
        response - shift,
    )
