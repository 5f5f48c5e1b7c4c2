"""Relative orientation from nothing: any convergence, any rotation.

Whatever the rotation, the best base follows in closed form: the coplanarity conditions
b . (x' x R x'') = 0 are linear in it. So a few hundred rotations spread over all of them are tried
first, and the best are refined, robustly, to the minimum near them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.collinearity import turns

__all__ = ["RelativeOrientation", "orient_pair", "spread_rotations"]


_STARTS = 600
_REFINED = 40
_MOST_POINTS = 80
_SECOND_ANGLE = 1.533751168755204288118041  # root of x^4 = x + 4


class RelativeOrientation(NamedTuple):
    """The second photo relative to the first.

    Attributes
    ----------
    base
        (3,) unit vector from the first to the second projection centre, in axes of the first.
    rotation
        (3, 3) from axes of the second photo to axes of the first.
    error
        Median angle by which rays miss each other [rad].
    in_front
        Share of the points that lie in front of both photos.
    angle
        Median angle at which rays of a point meet [rad].
    """

    base: Array
    rotation: Array
    error: float
    in_front: float
    angle: float


def orient_pair(first: Array, second: Array) -> list[RelativeOrientation]:
    """Return possible relative orientations, the best first.

    Parameters
    ----------
    first, second
        (n, 3) rays of the common points in image axes, n >= 5.
    """
    p = first / np.linalg.norm(first, axis=1)[:, None]
    q = second / np.linalg.norm(second, axis=1)[:, None]
    if len(p) > _MOST_POINTS:
        chosen = np.random.default_rng(0).permutation(len(p))[:_MOST_POINTS]
        p, q = p[chosen], q[chosen]
    starts = np.concatenate((np.eye(3)[None], spread_rotations(_STARTS - 1)))
    bases, size = _best_bases(starts, p, q)
    chosen = np.argsort(size)[:_REFINED]
    chosen = np.unique(np.append(chosen, 0))
    rotations, bases = _refine(starts[chosen], bases[chosen], p, q)
    found: list[RelativeOrientation] = []
    for rotation, base in zip(rotations, bases, strict=True):
        turned = q @ rotation.T
        error = float(np.median(np.abs(np.cross(p, turned) @ base)))
        for twist in (np.eye(3), 2.0 * np.outer(base, base) - np.eye(3)):
            # the photo turned by 180 degrees about the base fits as well, with points behind it
            here = twist @ rotation
            cosine = np.einsum("ni,ni->n", p, q @ here.T)
            angle = float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
            for sign in (1.0, -1.0):
                share = _in_front(p, q @ here.T, sign * base)
                found.append(RelativeOrientation(sign * base, here, error, share, angle))
    found.sort(key=lambda o: (-round(o.in_front * 10.0), o.error))
    distinct: list[RelativeOrientation] = []
    for one in found:
        if one.in_front < 0.6:
            continue
        if all(
            np.linalg.norm(one.rotation - other.rotation) > 0.02
            or np.linalg.norm(one.base - other.base) > 0.02
            for other in distinct
        ):
            distinct.append(one)
        if len(distinct) == 6:
            break
    distinct.sort(key=lambda o: o.error)
    return distinct


def spread_rotations(count: int) -> Array:
    """Return (count, 3, 3) rotations spread evenly over all of them.

    A spiral on the unit quaternions with the angles of Alexa (2022), "Super-Fibonacci spirals",
    section 4: the same for everybody, and without the gaps of random ones.
    """
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2.0 * np.pi * s / np.sqrt(2.0), 2.0 * np.pi * s / _SECOND_ANGLE
    x, y = inner * np.sin(alpha), inner * np.cos(alpha)
    z, w = outer * np.sin(beta), outer * np.cos(beta)
    out = np.empty((count, 3, 3))
    out[:, 0] = np.stack((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)), 1)
    out[:, 1] = np.stack((2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)), 1)
    out[:, 2] = np.stack((2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)), 1)
    return out


def _best_bases(rotations: Array, p: Array, q: Array) -> tuple[Array, Array]:
    """Return the base of smallest misclosure for each rotation, and that misclosure."""
    normals = np.cross(p[None], np.matmul(q, rotations.transpose(0, 2, 1)))
    values, vectors = np.linalg.eigh(np.matmul(normals.transpose(0, 2, 1), normals))
    # normals shrink when all rays are parallel: the misclosure is judged against them
    return vectors[:, :, 0], values[:, 0] / np.maximum(values.sum(axis=1), 1e-12)


def _in_front(p: Array, q: Array, base: Array) -> float:
    """Share of the points whose rays meet in front of both photos."""
    pq = np.einsum("ni,ni->n", p, q)
    bp, bq = p @ base, q @ base
    denominator = 1.0 - pq**2
    good = denominator > 1e-10
    if not good.any():
        return 0.0
    along_p = bp - pq * bq
    along_q = pq * bp - bq
    return float(((along_p > 0.0) & (along_q > 0.0) & good).sum() / len(p))


def _refine(rotations: Array, bases: Array, p: Array, q: Array) -> tuple[Array, Array]:
    """Robust damped Gauss-Newton of all candidates side by side."""
    damping = np.full(len(bases), 1e-3)

    def misclosure(r: Array, b: Array) -> tuple[Array, Array]:
        turned = np.matmul(q, r.transpose(0, 2, 1))
        return np.einsum("kni,ki->kn", np.cross(p[None], turned), b), turned

    e, turned = misclosure(rotations, bases)
    for _ in range(30):
        scale = np.maximum(2.0 * np.median(np.abs(e), axis=1), 1e-9)[:, None]
        cost = np.log1p((e / scale) ** 2).sum(axis=1)
        weight = 1.0 / (1.0 + (e / scale) ** 2)
        to_rotation = np.cross(turned, np.cross(bases[:, None], p[None]))
        to_base = np.cross(p[None], turned)
        design = np.concatenate((to_rotation, to_base), axis=2)
        normal = np.einsum("kn,kni,knj->kij", weight, design, design)
        right = -np.einsum("kn,kni,kn->ki", weight, design, e)
        trace = np.einsum("kii->k", normal)[:, None, None] / 6.0
        normal += damping[:, None, None] * trace * np.eye(6) + 1e-14 * np.eye(6)
        # the base keeps its length: its correction along itself is held
        normal[:, 3:, 3:] += trace * bases[:, :, None] * bases[:, None, :] * 1e3
        step = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        trial_r = np.matmul(turns(step[:, :3]), rotations)
        trial_b = bases + step[:, 3:]
        trial_b /= np.linalg.norm(trial_b, axis=1)[:, None]
        new_e, new_turned = misclosure(trial_r, trial_b)
        better = np.log1p((new_e / scale) ** 2).sum(axis=1) <= cost
        rotations = np.where(better[:, None, None], trial_r, rotations)
        bases = np.where(better[:, None], trial_b, bases)
        e = np.where(better[:, None], new_e, e)
        turned = np.where(better[:, None, None], new_turned, turned)
        damping = np.clip(np.where(better, damping * 0.2, damping * 10.0), 1e-10, 1e6)
    return rotations, bases
