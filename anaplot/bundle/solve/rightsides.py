"""Right-hand sides of the normal equations."""

from __future__ import annotations

import numpy as np

from anaplot.bundle.solve.eliminated import border_columns
from anaplot.bundle.solve.linearised import Linearised, Unknowns
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure

__all__ = ["right_sides"]


def right_sides(
    problem: Problem, structure: Structure, rows: Linearised, other: Linearised
) -> Unknowns:
    """Return -J'e of photos (n, d), points (p, 3) and border (g,).

    Parameters
    ----------
    problem, structure
        The bundle, and who is seen where.
    rows, other
        Where the derivatives and where the misclosures come from.
    """
    ae = np.einsum("mij,mi->mj", rows.a, other.e)
    photos = -(structure.by_photo @ ae)
    photo_e = other.photo_e
    if rows.offsets is not None and other.offsets is not None:
        photo_e = rows.offsets.without(photo_e, other.offsets.e)[0]
    photos -= np.einsum("nij,ni->nj", rows.photo_rows, photo_e)
    photos[:, 6:] -= np.sqrt(rows.own_weight) * other.own_e
    be = np.einsum("mij,mi->mj", rows.b, other.e)
    points = np.empty((len(problem.points), 3))
    for group in problem.groups:
        its_be = be[group.ray_slice].reshape(group.points, group.rays, 3)
        points[group.point_slice] = -its_be.sum(axis=1)
    points -= (np.sqrt(rows.point_weight) * other.point_e).sum(axis=0)
    shared = -np.sqrt(rows.shared_weight) * other.shared_e
    if len(shared):
        he = np.einsum("mij,mi->mj", rows.h, other.e)
        columns = border_columns(problem.additional_group, he.shape[1])
        shared -= np.bincount(columns.ravel(), he.ravel(), minlength=len(shared))
    if rows.given is not None and other.given is not None:
        at_photos, at_points = rows.given.sides(rows.given.prior.weight @ other.given.misclosure)
        photos -= at_photos.reshape(photos.shape)
        points -= at_points.reshape(points.shape)
    return photos, points, shared
