"""Cholesky factors of the points' own 3 x 3 normal equations, or which points have none."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array, Bools, Index

__all__ = ["PointError", "inverse_roots"]


_FLATTEST = 1e-12  # pivot over diagonal below which a point is not determined


class PointError(ArithmeticError):
    """The rays of points do not meet at an angle.

    Attributes
    ----------
    points
        Their indices.
    """

    def __init__(self, points: Index) -> None:
        self.points = points
        super().__init__(f"{len(points)} points are not determined")


def inverse_roots(rows: Array, weight: Array, grow: float, fixed: Bools) -> Array:
    """(n, 3, 3) inverses of the lower Cholesky factors of the points' normal equations.

    Parameters
    ----------
    rows
        (n, 2 k, 3) whitened derivatives of the rays.
    weight
        (n, 3) of control.
    grow
        Factor of the diagonal.
    fixed
        (n, 3) coordinates free of error: their rows are zero.

    Raises
    ------
    PointError
        Points whose rays do not meet at an angle.
    """
    v: Array = np.matmul(rows.transpose(0, 2, 1), rows)
    diagonal = np.einsum("nii->ni", v)
    diagonal += weight
    diagonal *= grow
    diagonal[fixed] = 1.0
    try:
        return _lower3(v, fixed)
    except PointError as error:
        doubtful = error.points
    # a ray of many times the others' weight hides them in the sums: not so in the rows themselves
    sound = np.delete(np.arange(len(v)), doubtful)
    out: Array = np.zeros_like(v)
    out[sound] = _lower3(v[sound], fixed[sound])
    for k in doubtful.tolist():
        free = ~fixed[k]
        damping = np.sqrt((grow - 1.0) / grow * diagonal[k])
        root = _root_of_rows(rows[k], np.where(free, weight[k], 1.0), damping)
        size = np.linalg.norm(rows[k].reshape(-1, 6), axis=1).repeat(2)[:, None]
        single = np.divide(rows[k], size, out=np.zeros_like(rows[k]), where=size > 0.0)
        held = np.diag((weight[k] > 0.0) * np.abs(single).max(initial=0.0))
        angle = np.linalg.svd(np.vstack((single, held))[:, free], compute_uv=False)
        if not (angle[-1] > np.sqrt(_FLATTEST) * angle[0] and np.abs(np.diag(root)).min() > 0.0):
            continue
        out[k] = np.linalg.inv(root)
        out[k, ~free] = 0.0
    bad = np.array([k for k in doubtful.tolist() if not out[k].any()], dtype=np.intp)
    if len(bad):
        raise PointError(bad)
    return out


def _root_of_rows(rows: Array, weight: Array, damping: Array) -> Array:
    """(3, 3) lower factor L of a point's equations L L', without forming them.

    Heavy rows first: Householder's triangularisation then keeps the digits of light ones.
    """
    stacked = np.vstack((rows, np.diag(np.sqrt(weight)), np.diag(damping)))
    stacked = stacked[np.argsort(-np.abs(stacked).max(axis=1), kind="stable")]
    upper = np.linalg.qr(stacked, mode="r")
    sign = np.where(np.diag(upper) < 0.0, -1.0, 1.0)
    lower: Array = (sign[:, None] * upper).T
    return lower


def _lower3(v: Array, fixed: Bools) -> Array:
    """(n, 3, 3) inverses of the lower Cholesky factors; rows of fixed coordinates are zero."""
    out = np.zeros_like(v)
    l00 = np.sqrt(v[:, 0, 0])
    l10 = v[:, 1, 0] / l00
    l20 = v[:, 2, 0] / l00
    p1 = v[:, 1, 1] - l10**2
    l11 = np.sqrt(np.maximum(p1, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        l21 = (v[:, 2, 1] - l20 * l10) / l11
        p2 = v[:, 2, 2] - l20**2 - l21**2
        l22 = np.sqrt(np.maximum(p2, 0.0))
        bad = ~((p1 > _FLATTEST * v[:, 1, 1]) & (p2 > _FLATTEST * v[:, 2, 2]))
        if bad.any():
            raise PointError(np.nonzero(bad)[0])
        out[:, 0, 0] = 1.0 / l00
        out[:, 1, 1] = 1.0 / l11
        out[:, 2, 2] = 1.0 / l22
        out[:, 1, 0] = -l10 * out[:, 0, 0] * out[:, 1, 1]
        out[:, 2, 1] = -l21 * out[:, 1, 1] * out[:, 2, 2]
        out[:, 2, 0] = -(l20 * out[:, 0, 0] + l21 * out[:, 1, 0]) * out[:, 2, 2]
    if fixed.any():
        # a fixed coordinate stands on a diagonal of 1 with nothing beside it
        point, axis = np.nonzero(fixed)
        out[point, axis, axis] = 0.0
    return out
