"""R between some rows of a block, as a product with vectors: no column is ever held."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.residuals import BlockResiduals, designed

__all__ = ["RowCoupling"]

_STEPS = 300
_SOLVED = 1e-13  # of the length of the right-hand side


class RowCoupling:
    """R_SS of rows S of a block without conditions, offsets and given priors.

    A product takes the rays of the points of S alone, and one solution of the photos.

    Parameters
    ----------
    system
        All rows.
    rows
        (k,) S, ascending; no rows of additional parameters.
    """

    def __init__(self, system: BlockResiduals, rows: Index) -> None:
        self._system, self._rows = system, rows
        problem, linear = system.problem, system.cofactors.normal.linear
        first, second, _, _ = system.rows.starts
        image = rows[rows < first]
        ground = system.rows.ground[rows[(rows >= first) & (rows < second)] - first]
        priors = system.rows.priors[rows[rows >= second] - second]
        ray, axis = np.divmod(image, 2)
        self._photo = np.concatenate((problem.photo[ray], priors[:, 0]))
        self._of_photo = np.concatenate((linear.a[ray, axis], linear.photo_rows[tuple(priors.T)]))
        kind, point, coordinate = ground.T
        of_ground = np.zeros((len(ground), 3))
        of_ground[np.arange(len(ground)), coordinate] = np.sqrt(
            linear.point_weight[kind, point, coordinate]
        )
        self._points, self._point = np.unique(
            np.concatenate((problem.point[ray], point)), return_inverse=True
        )
        self._of_point = np.concatenate((linear.b[ray, axis], of_ground))
        at = np.full(len(problem.points), -1)
        at[self._points] = np.arange(len(self._points))
        self._rays = np.flatnonzero(at[problem.point] >= 0)
        self._ray_point = at[problem.point[self._rays]]
        # rows of S in the order image, ground, priors: which of them have photos, and points
        self._with_photo = np.concatenate(
            (np.arange(len(image)), len(image) + len(ground) + np.arange(len(priors)))
        )
        self._with_point = np.arange(len(image) + len(ground))
        self._shared = np.zeros((len(image), 0))
        if len(system.cofactors.normal.corner):
            columns = system.cofactors.normal.border_columns(problem.additional_group[ray])
            self._columns, self._shared = columns, linear.h[ray, axis]

    def times(self, v: Array) -> Array:
        """Return R_SS v."""
        normal, problem = self._system.cofactors.normal, self._system.problem
        photos, points, shared = self._sides(v)
        root, z = normal.inverse_root[self._points], normal.z[self._rays]
        y = np.einsum("pij,pj->pi", root, points)
        np.subtract.at(
            photos, problem.photo[self._rays], np.einsum("mij,mj->mi", z, y[self._ray_point])
        )
        if len(shared):
            shared -= np.einsum("pig,pi->g", normal.t[self._points], y)
        x, s = self._system.cofactors.factor.solve(photos[:, :, None], shared[:, None])
        x, s = x[:, :, 0], s[:, 0]
        np.subtract.at(y, self._ray_point, np.einsum("mij,mi->mj", z, x[problem.photo[self._rays]]))
        if len(shared):
            y -= normal.t[self._points] @ s
        moved = np.einsum("pji,pj->pi", root, y)
        out = v.copy()
        out[self._with_photo] -= np.einsum("kd,kd->k", self._of_photo, x[self._photo])
        out[self._with_point] -= np.einsum("kd,kd->k", self._of_point, moved[self._point])
        if len(shared):
            out[: len(self._shared)] -= np.einsum("kq,kq->k", self._shared, s[self._columns])
        return out

    def beside(self, v: Array) -> Array:
        """Return (n,) -R v of the rows that are not in S."""
        normal = self._system.cofactors.normal
        photos, mine, shared = self._sides(v)
        points = np.zeros((len(self._system.problem.points), 3))
        points[self._points] = mine
        factor = self._system.cofactors.factor
        found = normal.solve(factor, photos[:, :, None], points[:, :, None], shared[:, None])
        return designed(self._system, *found)[:, 0]

    def solved(self, right: Array, nearly: csr_array) -> Array:
        """Return (k,) R_SS^-1 right.

        Parameters
        ----------
        right
            (k,).
        nearly
            (k, k) inverses of parts of R_SS that hardly touch.
        """
        z, left = np.zeros(len(right)), right.copy()
        step = nearly @ left
        along, size = step, float(left @ step)
        enough = _SOLVED * float(np.linalg.norm(right))
        for _ in range(_STEPS):
            if float(np.linalg.norm(left)) <= enough:
                break
            product = self.times(along)
            length = size / float(along @ product)
            z += length * along
            left -= length * product
            step = nearly @ left
            before, size = size, float(left @ step)
            along = step + size / before * along
        return z

    def _sides(self, v: Array) -> tuple[Array, Array, Array]:
        """A_S' v of photos (n, d), of the points of S (p, 3) and of shared parameters (g,)."""
        system = self._system
        photos = np.zeros((len(system.problem.photos), system.problem.per_photo))
        points = np.zeros((len(self._points), 3))
        shared = np.zeros(len(system.cofactors.normal.corner))
        np.add.at(photos, self._photo, self._of_photo * v[self._with_photo, None])
        np.add.at(points, self._point, self._of_point * v[self._with_point, None])
        if len(shared):
            np.add.at(shared, self._columns, self._shared * v[: len(self._shared), None])
        return photos, points, shared
