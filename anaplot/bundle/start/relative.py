"""Relative orientation from nothing: any convergence, any rotation.

Whatever the rotation, the best base follows in closed form: the coplanarity conditions
b . (x' x R x'') = 0 are linear in it. So a few hundred rotations spread over all of them are tried
first, and the best are refined, robustly, to the minimum near them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.photogrammetry.collinearity import turns

__all__ = ["RelativeOrientation", "orientations", "spread_rotations"]


_STARTS = 600
_REFINED = 40
_MOST_POINTS = 80
_STEPS = 30
_STILL = 1e-5  # step after which a candidate is at rest [rad]
_NEARLY = 1e-4  # the same, after which one that explains the rays is taken
_MEETING = 1e-10  # square of the sine at which rays meet
_IN_FRONT = 0.6  # share of the points that are in front of both photos
_SAME = 0.02  # by which elements of orientations differ that are the same, together
_DISTINCT = 6  # orientations that are told of
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


def orientations(first: Array, second: Array, noise: float) -> Iterator[RelativeOrientation]:
    """Yield possible relative orientations, first what explains the rays as soon as it is found.

    The others are not sought before they are asked for; they come the best first.

    Parameters
    ----------
    first, second
        (n, 3) rays of the common points in image axes, n >= 5.
    noise
        Angle by which rays miss each other by their noise alone [rad].
    """
    p = first / np.linalg.norm(first, axis=1)[:, None]
    q = second / np.linalg.norm(second, axis=1)[:, None]
    if len(p) > _MOST_POINTS:
        chosen = np.random.default_rng(0).permutation(len(p))[:_MOST_POINTS]
        p, q = p[chosen], q[chosen]
    pair = _Pair(p, q)
    starts = np.concatenate((np.eye(3)[None], spread_rotations(_STARTS - 1)))
    bases, size = _best_bases(starts, pair)
    chosen = np.argsort(size)[:_REFINED]
    chosen = np.unique(np.append(chosen, 0))
    refined = _Refined(starts[chosen], bases[chosen], pair)
    soon: list[RelativeOrientation] = []
    for _ in range(_STEPS):
        explained = refined.step(noise)
        if len(explained) and not soon:
            soon = _distinct(
                _seen_both_ways(refined.rotations[explained], refined.bases[explained], pair)
            )
            yield from soon
        if not refined.moving:
            break
    for found in _distinct(_seen_both_ways(refined.rotations, refined.bases, pair)):
        if all(_differ(found.rotation, found.base, other) for other in soon):
            yield found


class _Candidates(NamedTuple):
    """(k, 3) bases, (k, 3, 3) rotations and (k,) figures of many relative orientations."""

    base: Array
    rotation: Array
    error: Array
    in_front: Array
    angle: Array

    def one(self, k: int) -> RelativeOrientation:
        """Return one of them."""
        error, in_front, angle = (
            float(figures[k]) for figures in (self.error, self.in_front, self.angle)
        )
        return RelativeOrientation(self.base[k], self.rotation[k], error, in_front, angle)


def _seen_both_ways(rotations: Array, bases: Array, pair: _Pair) -> _Candidates:
    """Return what (k, 3, 3) and (k, 3) solutions of the conditions may be, four for each.

    The photo turned by 180 degrees about the base fits as well, and so does either with the base
    turned round: all of them but one have points behind the photos.
    """
    error = _medians(np.abs(pair.misclosures(rotations, bases)))
    half = 2.0 * bases[:, :, None] * bases[:, None, :] - np.eye(3)
    here = np.stack((rotations, half @ rotations), axis=1).reshape(-1, 3, 3)
    base = np.repeat(bases, 2, axis=0)
    pq = pair.cosines(here)
    angle = _medians(np.arccos(np.clip(pq, -1.0, 1.0)))
    bp, bq = base @ pair.first.T, pair.along_base(here, base)
    # how far along the rays they meet
    along_p, along_q = bp - pq * bq, pq * bp - bq
    good = 1.0 - pq**2 > _MEETING
    ahead = (good & (along_p > 0.0) & (along_q > 0.0)).mean(axis=1)
    back = (good & (along_p < 0.0) & (along_q < 0.0)).mean(axis=1)
    return _Candidates(
        np.stack((base, -base), axis=1).reshape(-1, 3),
        np.repeat(here, 2, axis=0),
        np.repeat(error, 4),
        np.stack((ahead, back), axis=1).ravel(),
        np.repeat(angle, 2),
    )


def _distinct(found: _Candidates) -> list[RelativeOrientation]:
    """Return orientations that differ, the best first; of those with points behind none."""
    order = np.lexsort((found.error, -np.rint(found.in_front * 10.0)))
    order = order[found.in_front[order] >= _IN_FRONT]
    chosen: list[int] = []
    while len(order) and len(chosen) < _DISTINCT:
        best = int(order[0])
        chosen.append(best)
        order = order[_differ(found.rotation[order], found.base[order], found.one(best))]
    chosen.sort(key=lambda k: found.error[k])
    return [found.one(k) for k in chosen]


def _differ(rotations: Array, bases: Array, other: RelativeOrientation) -> Bools:
    """Whether (..., 3, 3) rotations and (..., 3) bases are another orientation than that."""
    turned, moved = rotations - other.rotation, bases - other.base
    out: Bools = np.sqrt((turned**2).sum(axis=(-1, -2))) > _SAME
    out |= np.sqrt((moved**2).sum(axis=-1)) > _SAME
    return out


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


def _best_bases(rotations: Array, pair: _Pair) -> tuple[Array, Array]:
    """Return the base of smallest misclosure for each rotation, and that misclosure."""
    normals = pair.normals(rotations)
    values, vectors = np.linalg.eigh(np.matmul(normals, normals.transpose(0, 2, 1)))
    # normals shrink when all rays are parallel: the misclosure is judged against them
    return vectors[:, :, 0], values[:, 0] / np.maximum(values.sum(axis=1), 1e-12)


class _Refined:
    """Many candidates refined side by side by robust damped Gauss-Newton.

    Attributes
    ----------
    rotations, bases
        (k, 3, 3) and (k, 3).
    """

    def __init__(self, rotations: Array, bases: Array, pair: _Pair) -> None:
        self.rotations, self.bases = rotations.copy(), bases.copy()
        self._pair = pair
        self._damping = np.full(len(bases), 1e-3)
        self._at = np.arange(len(bases))  # those that have not come to rest
        self._e = pair.misclosures(rotations, bases)

    @property
    def moving(self) -> bool:
        """Whether any of them has not come to rest."""
        return len(self._at) > 0

    def step(self, noise: float) -> Index:
        """Step with all that have not come to rest.

        Returns those that nearly have, and whose rays miss each other by less than `noise` [rad]
        in the median.
        """
        at, e, pair = self._at, self._e, self._pair
        r, b = self.rotations[at], self.bases[at]
        scale = np.maximum(2.0 * _medians(np.abs(e)), 1e-9)[:, None]
        square = (e / scale) ** 2
        cost = np.log1p(square).sum(axis=1)
        normal, right = pair.equations(r, b, e, 1.0 / (1.0 + square))
        trace = np.trace(normal, axis1=1, axis2=2)[:, None, None] / 6.0
        normal += (self._damping[at][:, None, None] * trace + 1e-14) * np.eye(6)
        # the base keeps its length: its correction along itself is held
        normal[:, 3:, 3:] += trace * b[:, :, None] * b[:, None, :] * 1e3
        step = np.asarray(np.linalg.solve(normal, right)[:, :, 0], dtype=np.float64)
        trial_r = np.matmul(turns(step[:, :3]), r)
        trial_b = b + step[:, 3:]
        trial_b /= np.sqrt((trial_b**2).sum(axis=1))[:, None]
        new_e = pair.misclosures(trial_r, trial_b)
        better = np.log1p((new_e / scale) ** 2).sum(axis=1) <= cost
        to = at[better]
        self.rotations[to], self.bases[to] = trial_r[better], trial_b[better]
        e[better] = new_e[better]
        self._damping[at] = np.clip(self._damping[at] * np.where(better, 0.2, 10.0), 1e-10, 1e6)
        size = np.abs(step).max(axis=1)
        moving, nearly = size > _STILL, size <= _NEARLY
        self._at, self._e = at[moving], e[moving]
        return np.asarray(at[nearly][_medians(np.abs(e[nearly])) < noise])


class _Pair:
    """Two photos' rays of the same points, and what is linear in the rotation between them.

    Attributes
    ----------
    first, second
        (n, 3) unit rays.
    """

    def __init__(self, first: Array, second: Array) -> None:
        self.first, self.second = first, second
        (x, y, z), zero = first.T, np.zeros(len(first))
        across = np.array(((zero, -z, y), (z, zero, -x), (-y, x, zero)))
        # a row for each element of the rotation
        products = across.transpose(1, 0, 2)[:, None] * second.T[:, None]
        self._across = products.reshape(9, -1)
        self._along = (first.T[:, None] * second.T).reshape(9, -1)

    def normals(self, rotations: Array) -> Array:
        """(k, 3, n) p x R q of (k, 3, 3) rotations R."""
        out: Array = (rotations.reshape(-1, 9) @ self._across).reshape(len(rotations), 3, -1)
        return out

    def cosines(self, rotations: Array) -> Array:
        """(k, n) p . R q."""
        return np.asarray(rotations.reshape(-1, 9) @ self._along)

    def along_base(self, rotations: Array, bases: Array) -> Array:
        """(k, n) b . R q."""
        return np.asarray(np.matmul(bases[:, None], rotations)[:, 0] @ self.second.T)

    def misclosures(self, rotations: Array, bases: Array) -> Array:
        """(k, n) b . (p x R q)."""
        return np.asarray(np.matmul(bases[:, None], self.normals(rotations))[:, 0])

    def equations(
        self, rotations: Array, bases: Array, e: Array, weight: Array
    ) -> tuple[Array, Array]:
        """Return (k, 6, 6) normal equations of a turn and a step of the base, and right sides."""
        design = np.empty((len(rotations), 6, len(self.first)))
        # R q x (b x p) = b (R q . p) - p (R q . b)
        np.multiply(bases[:, :, None], self.cosines(rotations)[:, None], out=design[:, :3])
        design[:, :3] -= self.first.T * self.along_base(rotations, bases)[:, None]
        design[:, 3:] = self.normals(rotations)
        half = design * weight[:, None]
        return np.matmul(half, design.transpose(0, 2, 1)), -np.matmul(half, e[:, :, None])


def _medians(values: Array) -> Array:
    """(k,) medians of (k, n)."""
    n = values.shape[1]
    middle = np.partition(values, ((n - 1) // 2, n // 2), axis=1)
    return np.asarray((middle[:, (n - 1) // 2] + middle[:, n // 2]) / 2.0)
