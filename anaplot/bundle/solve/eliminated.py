"""The points of a bundle, each eliminated as soon as its rays are known; solutions go through them.

See `normal` for L, Z and T. What this makes of the photos' equations is not formed here: solutions
take the factor of equations that have been formed, there or nearby.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.factor import Factor
from anaplot.bundle.solve.linearised import Linearised, Unknowns
from anaplot.bundle.solve.pointroots import PointError, inverse_roots
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure

__all__ = ["EliminatedPoints", "border_columns", "eliminate", "of_one_side"]

_PORTION = 300_000_000  # bytes of the largest array while right-hand sides are solved for


@dataclass(frozen=True, slots=True, eq=False)
class EliminatedPoints:
    """All points of a bundle, eliminated.

    Attributes
    ----------
    problem, structure
        The bundle, and who is seen where.
    inverse_root
        (points, 3, 3) L^-1 of every point.
    z
        (m, d, 3) Z of every ray.
    t
        (points, 3, g) T of every point.
    """

    problem: Problem
    structure: Structure
    inverse_root: Array
    z: Array
    t: Array

    def solve(self, factor: Factor, photos: Array, points: Array, shared: Array) -> Unknowns:
        """Solve the normal equations for k right-hand sides, in portions.

        Parameters
        ----------
        factor
            Of the photos' equations without the points.
        photos, points, shared
            (n, d, k), (p, 3, k), (g, k).
        """
        count = photos.shape[2]
        # the largest array has a value per ray, unknown of its photo, and right-hand side
        step = max(1, _PORTION // (8 * self.z.shape[0] * self.z.shape[1]))
        if count <= step:
            return self._portion(factor, photos, points, shared)
        found = []
        for k in range(0, count, step):
            mine = slice(k, k + step)
            sides = photos[:, :, mine], points[:, :, mine], shared[:, mine]
            found.append(self._portion(factor, *sides))
        x, p, s = (np.concatenate([part[k] for part in found], axis=-1) for k in range(3))
        return x, p, s

    def solution(self, factor: Factor, sides: Unknowns) -> Unknowns:
        """Return the corrections (n, d), (p, 3), (g,) for right-hand sides of these shapes."""
        return of_one_side(lambda *one: self.solve(factor, *one), sides)

    def _portion(self, factor: Factor, photos: Array, points: Array, shared: Array) -> Unknowns:
        (m, d, _), k = self.z.shape, photos.shape[2]
        y = np.matmul(self.inverse_root, points)
        right = photos
        if y.any():
            zy = np.empty((m, d * k))
            for piece, z in self.structure.by_points(self.z):
                np.matmul(z, y[piece.points], out=zy[piece.rays].reshape(len(z), -1, k))
            right = photos - (self.structure.by_photo @ zy).reshape(photos.shape)
        corner = shared - np.einsum("pig,pik->gk", self.t, y) if len(shared) else shared
        x, s = factor.solve(right, corner)
        for piece, z in self.structure.by_points(self.z):
            # Z' x of all rays of a point at once
            moved = x.take(self.problem.photo[piece.rays], axis=0).reshape(len(z), -1, k)
            y[piece.points] -= np.matmul(z.transpose(0, 2, 1), moved)
        if len(shared):
            y -= np.matmul(self.t, s)
        return x, np.matmul(self.inverse_root.transpose(0, 2, 1), y), s


def eliminate(
    problem: Problem, structure: Structure, linear: Linearised, grow: float = 1.0
) -> tuple[EliminatedPoints, Array]:
    """Return the points of a bundle, eliminated, and (m, 2, 3) B L^-T of the rays.

    Parameters
    ----------
    problem, structure, linear
        The bundle, its structure and its derivatives.
    grow
        Factor of the diagonal.

    Raises
    ------
    PointError
        Points whose rays do not meet at an angle.
    """
    a, b, h = linear.a, linear.b, linear.h
    m, g, q = len(problem.photo), problem.in_border, h.shape[2]
    at = a.transpose(0, 2, 1)
    weight = linear.point_weight.sum(axis=0)
    if linear.given is not None:
        weight = weight + linear.given.held_points(weight.shape)
    out = EliminatedPoints(
        problem,
        structure,
        np.empty((len(problem.points), 3, 3)),
        np.empty((m, problem.per_photo, 3)),
        np.zeros((len(problem.points), 3, g)),
    )
    of_points = np.empty((m, 2, 3))
    for piece in structure.pieces:
        k, count = piece.group.rays, piece.stop - piece.start
        rays, points = piece.rays, piece.points
        stacked = b[rays].reshape(count, 2 * k, 3)
        try:
            root = inverse_roots(stacked, weight[points], grow, problem.fixed[points])
        except PointError as error:
            raise PointError(error.points + points.start) from None
        out.inverse_root[points] = root
        scaled = of_points[rays]
        np.matmul(stacked, root.transpose(0, 2, 1), out=scaled.reshape(count, 2 * k, 3))
        np.matmul(at[rays], scaled, out=out.z[rays])
        if not g:
            continue
        each = np.matmul(scaled.transpose(0, 2, 1), h[rays]).reshape(count, k, 3, q)
        group = problem.additional_group[rays].reshape(count, k)
        t = out.t[points]
        if g == q:
            t += each.sum(axis=1)
        else:
            for ray in range(k):
                columns = border_columns(group[:, ray], q)
                t[np.arange(count)[:, None, None], np.arange(3)[:, None], columns[:, None, :]] += (
                    each[:, ray]
                )
    return out, of_points


def of_one_side(solve: Callable[[Array, Array, Array], Unknowns], sides: Unknowns) -> Unknowns:
    """Return what is solved for by right-hand sides (n, d), (p, 3), (g,).

    Parameters
    ----------
    solve
        Takes k of them, (n, d, k), (p, 3, k), (g, k), and returns as many.
    sides
        One, as what is returned.
    """
    photos, points, shared = solve(*(side[..., None] for side in sides))
    return photos[..., 0], points[..., 0], shared[..., 0]


def border_columns(group: Index, q: int) -> Index:
    """(rays, q) columns of the border that rays of these groups touch, with q parameters each."""
    out: Index = group[:, None] * q + np.arange(q)
    return out
