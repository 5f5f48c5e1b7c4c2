"""The dense design and cofactors of a small block, to compare with."""

from __future__ import annotations

import numpy as np


def dense(block):
    """Design of all observations (whitened), rows of image coordinates first.

    Then control, priors of photos and of parameters, and priors of points where there are any.
    """
    problem, linear = block.problem, block.cofactors.normal.linear
    n, d, p = len(problem.photos), problem.per_photo, len(problem.points)
    m, g = len(problem.photo), problem.in_border
    u = n * d + 3 * p + g
    rows = np.zeros((2 * m, u))
    for ray in range(m):
        photo, point = problem.photo[ray], problem.point[ray]
        rows[2 * ray : 2 * ray + 2, photo * d : photo * d + d] = linear.a[ray]
        at = n * d + 3 * point
        rows[2 * ray : 2 * ray + 2, at : at + 3] = linear.b[ray]
        q = linear.h.shape[2]
        if q:
            at = n * d + 3 * p + problem.additional_group[ray] * q
            rows[2 * ray : 2 * ray + 2, at : at + q] = linear.h[ray]
    parts = [rows]
    control, expected = (np.zeros((3 * p, u)) for _ in range(2))
    for of, weight in zip((control, expected), linear.point_weight, strict=True):
        of[np.arange(3 * p), n * d + np.arange(3 * p)] = np.sqrt(weight.ravel())
    prior = np.zeros((6 * n, u))
    for k in range(n):
        prior[6 * k : 6 * k + 6, k * d : k * d + d] = linear.photo_rows[k]
    own = np.zeros((n * (d - 6), u))
    for k in range(n):
        index = np.arange(d - 6)
        own[k * (d - 6) + index, k * d + 6 + index] = np.sqrt(linear.own_weight[k])
    shared = np.zeros((g, u))
    shared[np.arange(g), n * d + 3 * p + np.arange(g)] = np.sqrt(linear.shared_weight)
    parts += [control, prior, own, shared]
    if expected.any():
        parts.append(expected)
    free = np.ones(u, dtype=bool)
    free[n * d : n * d + 3 * p] = ~problem.fixed.ravel()
    return np.vstack(parts), free


def dense_inverse(design, free):
    """Cofactors of all unknowns; zeros where they are free of error."""
    u = design.shape[1]
    scale = np.linalg.norm(design[:, free], axis=0)
    normal = (design[:, free] / scale).T @ (design[:, free] / scale)
    out = np.zeros((u, u))
    out[np.ix_(free, free)] = np.linalg.inv(normal) / scale[:, None] / scale
    return out


def held_inverse(block, design):
    """Cofactors of all unknowns in the datum that holds D'x = 0: the normal matrix bordered."""
    change = block.cofactors.change
    u = design.shape[1]
    n, d, p = len(block.problem.photos), block.problem.per_photo, len(block.problem.points)
    whole, held = np.zeros((u, 7)), np.zeros((u, 7))
    for out, photos, points in (
        (whole, change.null_photos, change.null_points),
        (held, change.held_photos, change.held_points),
    ):
        out[: n * d] = photos.reshape(n * d, 7)
        out[n * d : n * d + 3 * p] = points.reshape(3 * p, 7)
    assert np.abs(design @ whole).max() < 1e-6 * np.abs(design).max() * np.abs(whole).max()
    scale = np.linalg.norm(design, axis=0)
    normal = (design / scale).T @ (design / scale)
    border = held / scale[:, None]
    border /= np.linalg.norm(border, axis=0)
    big = np.block([[normal, border], [border.T, np.zeros((7, 7))]])
    return np.linalg.inv(big)[:-7, :-7] / scale[:, None] / scale
