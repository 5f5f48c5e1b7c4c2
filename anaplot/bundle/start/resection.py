"""Space resection from nothing: three points exactly, many points robustly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.photogrammetry.collinearity import project_with_derivatives, turns

__all__ = ["Resection", "image_misses", "resect", "three_point_resection"]

_SAMPLES = 80  # half of the triples that are tried
_JUDGES = 60  # points by which triples are judged at most
_FIRST = 40  # triples that are tried first, and alone
_AGREED = 0.01  # where one of them leaves half of the points within this share of c
_STEPS = 30
_LITTLE = 1e-4  # share of what is minimised: a step that brings less is the last
_STUCK = 1e5  # damping from which no step is tried
_TINY = 1e-300  # holds what no point in front of the photo determines


class Resection(NamedTuple):
    """An orientation found by resection.

    Attributes
    ----------
    centre, rotation
        Projection centre and (3, 3) rotation from image to ground.
    residual
        (n,) distances between measured and computed image points [mm].
    """

    centre: Array
    rotation: Array
    residual: Array


def three_point_resection(rays: Array, points: Array) -> tuple[Array, Array, Index]:
    """Return every orientation that agrees with three points (Grunert 1841).

    Parameters
    ----------
    rays
        (k, 3, 3) rays of unit length in image axes, three for each of k cases.
    points
        (k, 3, 3) their ground points.

    Returns
    -------
    tuple
        Centres (m, 3), rotations (m, 3, 3) and the case each belongs to.

    Notes
    -----
    The quartic in v = s3/s1 in the notation of Haralick et al. (1994), eq. (9).
    """
    a2 = ((points[:, 1] - points[:, 2]) ** 2).sum(axis=1)
    b2 = ((points[:, 0] - points[:, 2]) ** 2).sum(axis=1)
    c2 = ((points[:, 0] - points[:, 1]) ** 2).sum(axis=1)
    ca = (rays[:, 1] * rays[:, 2]).sum(axis=1)
    cb = (rays[:, 0] * rays[:, 2]).sum(axis=1)
    cg = (rays[:, 0] * rays[:, 1]).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        m = (a2 - c2) / b2
        p = (a2 + c2) / b2
        a4 = (m - 1.0) ** 2 - 4.0 * c2 / b2 * ca**2
        a3 = 4.0 * (m * (1.0 - m) * cb - (1.0 - p) * ca * cg + 2.0 * c2 / b2 * ca**2 * cb)
        a1 = 4.0 * (-m * (1.0 + m) * cb + 2.0 * a2 / b2 * cg**2 * cb - (1.0 - p) * ca * cg)
        a0 = (1.0 + m) ** 2 - 4.0 * a2 / b2 * cg**2
        second = 2.0 * (
            m**2
            - 1.0
            + 2.0 * m**2 * cb**2
            + 2.0 * (b2 - c2) / b2 * ca**2
            - 4.0 * p * ca * cb * cg
            + 2.0 * (b2 - a2) / b2 * cg**2
        )
        a4 = np.where(np.abs(a4) < 1e-14, 1e-14, a4)
        monic = np.stack((a3, second, a1, a0), axis=1) / a4[:, None]
    usable = np.nonzero(np.isfinite(monic).all(axis=1))[0]
    companion = np.zeros((len(usable), 4, 4))
    companion[:, 0, :] = -monic[usable]
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    roots = np.linalg.eigvals(companion)
    real = np.abs(roots.imag) < 1e-3 * (1.0 + np.abs(roots.real))
    real &= roots.real > 0.0
    which, _ = np.nonzero(real)
    case = usable[which]
    v = roots.real[real]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        u = ((m[case] - 1.0) * v**2 - 2.0 * m[case] * cb[case] * v + 1.0 + m[case]) / (
            2.0 * (cg[case] - v * ca[case])
        )
        s1 = np.sqrt(b2[case] / (1.0 + v**2 - 2.0 * v * cb[case]))
    good = np.isfinite(s1) & np.isfinite(u) & (u > 0.0)
    case, s1, u, v = case[good], s1[good], u[good], v[good]
    camera = rays[case] * np.stack((s1, u * s1, v * s1), axis=1)[:, :, None]
    world = points[case]
    mean_c, mean_w = camera.mean(axis=1), world.mean(axis=1)
    left, _, right = np.linalg.svd(
        np.matmul((world - mean_w[:, None]).transpose(0, 2, 1), camera - mean_c[:, None])
    )
    left[:, :, 2] *= np.sign(np.linalg.det(np.matmul(left, right)))[:, None]
    rotation = np.matmul(left, right)
    centre = mean_w - np.einsum("kij,kj->ki", rotation, mean_c)
    return centre, rotation, case


def resect(xy: Array, c: float, points: Array) -> Resection | None:
    """Orient a photo to known points of which a minority may be wrong.

    Parameters
    ----------
    xy
        (n, 2) image coordinates [mm].
    c
        Camera constant [mm].
    points
        (n, 3) ground points, n >= 4.

    Returns
    -------
    Resection or None
        None when no orientation has the points in front of the photo.
    """
    n = len(xy)
    if n < 4:
        return None
    rng = np.random.default_rng(0)
    rays = np.column_stack((xy, np.full(n, -c)))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    judges = np.arange(n) if n <= _JUDGES else rng.permutation(n)[:_JUDGES]
    if n <= 8:
        index = np.array(
            [(i, j, k) for i in range(n) for j in range(i + 1, n) for k in range(j + 1, n)]
        )
    else:
        index = _spread_triples(xy, rng)
    at = min(len(judges) - 1, max(len(judges) // 2, 3))
    for some in (index[:_FIRST], index) if len(index) > _FIRST else (index,):
        centres, rotations, _ = three_point_resection(rays[some], points[some])
        if len(centres) == 0:
            continue
        error = image_misses(centres, rotations, c, points[judges], xy[judges])
        middle = np.partition(error, at, axis=1)[:, at]
        if middle.min() < _AGREED * c:
            break
    if len(centres) == 0:
        return None
    best = [int(np.argmin(middle))]
    centres, rotations = _refine(centres[best], rotations[best], c, points[judges], xy[judges])
    if len(judges) < n:
        centres, rotations = _refine(centres, rotations, c, points, xy)
    residual = image_misses(centres, rotations, c, points, xy)[0]
    if not float(np.sort(residual)[: max(4, (3 * n) // 4)].mean()) < np.inf:
        return None
    return Resection(centres[0], rotations[0], residual)


def _spread_triples(xy: Array, rng: np.random.Generator) -> Index:
    """Triples of points, the larger triangles of many random ones."""
    index = rng.integers(0, len(xy), (6 * _SAMPLES, 3))
    p = xy[index]
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    area = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0])
    return index[np.argsort(-area)[: 2 * _SAMPLES]]


def image_misses(centres: Array, rotations: Array, c: float, points: Array, xy: Array) -> Array:
    """Return how far points are seen from where they were measured.

    Parameters
    ----------
    centres, rotations
        (k, 3) and (k, 3, 3) places of one photo.
    c
        Camera constant [mm].
    points, xy
        (n, 3) ground points and (n, 2) image coordinates [mm].

    Returns
    -------
    (k, n) floats
        Distances in the image [mm]; infinite for points behind the photo.
    """
    away = points[None] - centres[:, None]
    u = np.matmul(away, rotations)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        seen = -c * u[..., :2] / u[..., 2:]
        size = np.linalg.norm(seen - xy[None], axis=2)
    out: Array = np.where((u[..., 2] < 0.0) & np.isfinite(size), size, np.inf)
    return out


def _refine(
    centres: Array, rotations: Array, c: float, points: Array, xy: Array
) -> tuple[Array, Array]:
    """Robust damped Gauss-Newton of (k, 3) and (k, 3, 3) candidates for one photo side by side."""
    size = _capped(centres, rotations, c, points, xy)
    scale = np.maximum(2.0 * np.median(size, axis=1), 1e-6)[:, None]
    value = np.log1p((size / scale) ** 2).sum(axis=1)
    damping = np.full(len(centres), 1e-3)
    running = np.ones(len(centres), dtype=bool)
    for _ in range(_STEPS):
        at = np.flatnonzero(running)
        step = _step(centres[at], rotations[at], c, points, xy, size[at] / scale[at], damping[at])
        trial = centres[at] + step[:, :3], np.matmul(turns(step[:, 3:]), rotations[at])
        new_size = _capped(*trial, c, points, xy)
        new_value = np.log1p((new_size / scale[at]) ** 2).sum(axis=1)
        better = new_value < value[at]
        # where it brings little more, the bundle goes on
        running[at[better]] = (value[at] - new_value > _LITTLE * (1.0 + new_value))[better]
        to = at[better]
        centres[to], rotations[to] = trial[0][better], trial[1][better]
        size[to], value[to] = new_size[better], new_value[better]
        damping[at] = np.where(better, np.maximum(damping[at] * 0.1, 1e-9), damping[at] * 10.0)
        running &= damping < _STUCK
        if not running.any():
            break
    return centres, rotations


def _capped(centres: Array, rotations: Array, c: float, points: Array, xy: Array) -> Array:
    """(k, n) distances in the image [mm], a million behind the photo."""
    return np.minimum(image_misses(centres, rotations, c, points, xy), 1e6)


def _step(
    centres: Array,
    rotations: Array,
    c: float,
    points: Array,
    xy: Array,
    size: Array,
    damping: Array,
) -> Array:
    """(k, 6) step of each candidate; `size` (k, n) is what its points are off, in its scale."""
    k, n = size.shape
    seen = project_with_derivatives(
        np.repeat(centres, n, axis=0),
        np.repeat(rotations, n, axis=0),
        np.full(k * n, c),
        np.tile(points, (k, 1)),
    )
    weight = np.repeat(np.where(seen.depth > 0.0, 1.0 / (1.0 + size.ravel() ** 2), 0.0), 2)
    design = np.nan_to_num(seen.photo).reshape(k, 2 * n, 6)
    e = np.nan_to_num(seen.xy - np.tile(xy, (k, 1))).reshape(k, 2 * n)
    half = (design * weight.reshape(k, 2 * n, 1)).transpose(0, 2, 1)
    normal = np.matmul(half, design)
    right = -np.matmul(half, e[:, :, None])
    diagonal = np.einsum("kii->ki", normal)
    held = damping[:, None] * diagonal + 1e-12 * diagonal.max(axis=1, keepdims=True) + _TINY
    return np.asarray(np.linalg.solve(normal + held[:, :, None] * np.eye(6), right)[:, :, 0])
