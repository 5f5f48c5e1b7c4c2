"""G = J N^-1 J' between some rows of a block, as a product with vectors: no column is ever held."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array, Index
from anaplot.bundle.errors.laterresiduals import AllRows
from anaplot.bundle.solve.linearised import Unknowns
from anaplot.bundle.solve.reliability import Cofactors

__all__ = ["NotSolvedError", "RowCoupling"]

_STEPS = 300
_SOLVED = 1e-13  # of the length of the right-hand side
_TAKEN = 1e-11  # what may be left of it where rounding, or too many steps, end it
_NOTHING_NEW = 1e-14  # of a product, that is left of it beside those before


class NotSolvedError(ArithmeticError):
    """What comes in and goes is not found by steps: places touch too much, or nothing checks it."""


class RowCoupling:
    """G_DD of rows D of a block without conditions, offsets and given priors.

    A product takes the rays of the points of D alone, and one solution of the photos.

    Parameters
    ----------
    block
        All rows.
    cofactors
        With the equations of N, linearised where the rows are, whichever of these are in them.
    rows
        (k,) D, ascending; no rows of additional parameters.
    """

    def __init__(self, block: AllRows, cofactors: Cofactors, rows: Index) -> None:
        self._block, self._count = block, len(rows)
        self._normal, self._factor = cofactors.normal, cofactors.factor
        problem, linear = block.problem, block.linear
        first, second, _, _ = block.rows.starts
        image = rows[rows < first]
        ground = block.rows.ground[rows[(rows >= first) & (rows < second)] - first]
        priors = block.rows.priors[rows[rows >= second] - second]
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
        rays = np.flatnonzero(at[problem.point] >= 0)
        self._ray_photo, self._ray_point = problem.photo[rays], at[problem.point[rays]]
        self._of_photos = _summing(self._ray_photo, len(problem.photos))
        self._of_points = _summing(self._ray_point, len(self._points))
        self._root, self._z = self._normal.inverse_root[self._points], self._normal.z[rays]
        # rows of D in the order image, ground, priors: which of them have photos, and points
        self._with_photo = np.concatenate(
            (np.arange(len(image)), len(image) + len(ground) + np.arange(len(priors)))
        )
        self._with_point = np.arange(len(image) + len(ground))
        self._shared = np.zeros((len(image), 0))
        if len(self._normal.corner):
            columns = self._normal.border_columns(problem.additional_group[ray])
            self._columns, self._shared = columns, linear.h[ray, axis]

    def times(self, v: Array) -> Array:
        """Return G_DD v."""
        photos, y, shared = self._reduced(v)
        x, s = self._factor.solve(photos[:, :, None], shared[:, None])
        x, s = x[:, :, 0], s[:, 0]
        y -= self._of_points @ np.einsum("mij,mi->mj", self._z, x[self._ray_photo])
        if len(shared):
            y -= self._normal.t[self._points] @ s
        return self._seen(x, self._unscaled(y), s)

    def _reduced(self, v: Array) -> tuple[Array, Array, Array]:
        """A_D' v with the points of D eliminated: of photos and shared, and (p, 3) y of points."""
        photos, points, shared = self._sides(v)
        y = np.einsum("pij,pj->pi", self._root, points)
        photos -= self._of_photos @ np.einsum("mij,mj->mi", self._z, y[self._ray_point])
        if len(shared):
            shared -= np.einsum("pig,pi->g", self._normal.t[self._points], y)
        return photos, y, shared

    def _unscaled(self, y: Array) -> Array:
        """(p, 3) changes of the points of D, of y."""
        return np.asarray(np.einsum("pji,pj->pi", self._root, y))

    def _seen(self, photos: Array, mine: Array, shared: Array) -> Array:
        """(k,) A_D times changes of photos, of the points of D and of shared parameters."""
        out = np.zeros(self._count)
        out[self._with_photo] += np.einsum("kd,kd->k", self._of_photo, photos[self._photo])
        out[self._with_point] += np.einsum("kd,kd->k", self._of_point, mine[self._point])
        if len(shared):
            out[: len(self._shared)] += np.einsum("kq,kq->k", self._shared, shared[self._columns])
        return out

    def moved(self, v: Array) -> Unknowns:
        """Return N^-1 A_D' v: changes of photos (n, d), points (p, 3) and border (g,)."""
        # of the other points nothing is to be eliminated
        photos, y, shared = self._reduced(v)
        none = np.zeros((len(self._block.problem.points), 3))
        x, points, s = self._normal.solution(self._factor, (photos, none, shared))
        points[self._points] += self._unscaled(y)
        return x, points, s

    def seen(self, unknowns: Unknowns) -> Array:
        """Return (k,) A_D times such changes."""
        photos, points, shared = unknowns
        return self._seen(photos, points[self._points], shared)

    def solved(self, sign: Array, right: Array, nearly: csr_array) -> Array:
        """Return (k,) (S + G_DD)^-1 right by GMRES (Saad and Schultz 1986).

        Places hardly touch: with what they are by themselves taken first it takes a few steps.

        Parameters
        ----------
        sign
            (k,) the diagonal of S: 1 or -1.
        right
            (k,).
        nearly
            (k, k) inverses of parts of S + G_DD that hardly touch.

        Raises
        ------
        NotSolvedError
            It is singular, or takes too many steps.
        """
        size = float(np.linalg.norm(right))
        if size == 0.0:
            return np.zeros(len(right))
        along, products = [right / size], np.zeros((_STEPS + 1, _STEPS))
        for step in range(_STEPS):
            of = nearly @ along[step]
            new = sign * of + self.times(of)
            whole = float(np.linalg.norm(new))
            for _ in range(2):  # twice is enough for rounding
                for k, one in enumerate(along):
                    share = float(one @ new)
                    products[k, step] += share
                    new -= share * one
            length = products[step + 1, step] = float(np.linalg.norm(new))
            system = products[: step + 2, : step + 1]
            goal = np.zeros(step + 2)
            goal[0] = size
            found = np.linalg.lstsq(system, goal, rcond=None)[0]
            left = float(np.linalg.norm(system @ found - goal)) / size
            if left <= _SOLVED or length <= _NOTHING_NEW * whole:
                break
            along.append(new / length)
        if not left <= _TAKEN:
            raise NotSolvedError(f"{len(right)} rows: {left:.0e} is left after {step + 1} steps")
        z: Array = nearly @ (np.array(along[: len(found)]).T @ found)
        return z

    def _sides(self, v: Array) -> tuple[Array, Array, Array]:
        """A_D' v of photos (n, d), of the points of D (p, 3) and of shared parameters (g,)."""
        problem = self._block.problem
        photos = np.zeros((len(problem.photos), problem.per_photo))
        points = np.zeros((len(self._points), 3))
        shared = np.zeros(len(self._normal.corner))
        np.add.at(photos, self._photo, self._of_photo * v[self._with_photo, None])
        np.add.at(points, self._point, self._of_point * v[self._with_point, None])
        if len(shared):
            np.add.at(shared, self._columns, self._shared * v[: len(self._shared), None])
        return photos, points, shared


def _summing(of: Index, count: int) -> csr_array:
    """(count, m) what sums rows that belong to some of `count`: of (m,)."""
    return csr_array((np.ones(len(of)), (of, np.arange(len(of)))), shape=(count, len(of)))
