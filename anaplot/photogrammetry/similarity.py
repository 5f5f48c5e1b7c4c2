"""Spatial similarity between two sets of points, closed form, robust, and to partial control."""

from __future__ import annotations

from itertools import combinations
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.photogrammetry.collinearity import turns

__all__ = [
    "Similarity",
    "agreeing_sets",
    "closed_form",
    "fit_similarity",
    "fit_to_partial",
    "line_of",
    "moved_similarity",
    "robust_similarity",
    "similarity_effects",
    "without_scale",
]


_ON_A_LINE = 0.02  # extent across over extent along below which points leave a rotation open

_CLOSE = 1e-10  # step after which a similarity is refined
_SAMPLES = 200  # triples that are tried of more points
_ALL_TRIPLES = 12  # points of which all triples are tried, where that is done rarely
_AT_ONCE = 16384  # distances that stay at hand while they are used


class Similarity(NamedTuple):
    """target = scale * rotation @ source + shift."""

    scale: float
    rotation: Array
    shift: Array

    def apply(self, points: Array) -> Array:
        """Transform (n, 3) points."""
        out: Array = self.scale * points @ self.rotation.T + self.shift
        return out


def closed_form(source: Array, target: Array) -> tuple[Array, Array, Array]:
    """Return the similarities of batches of (k, n, 3) points (Umeyama 1991).

    Parameters
    ----------
    source, target
        (k, n, 3) points before and after.

    Returns
    -------
    arrays
        (k,) scales, (k, 3, 3) rotations and (k, 3) shifts.
    """
    a, b = source.mean(axis=1), target.mean(axis=1)
    s, t = source - a[:, None], target - b[:, None]
    left, singular, right = np.linalg.svd(np.matmul(t.transpose(0, 2, 1), s))
    sign = np.sign(np.linalg.det(np.matmul(left, right)))
    singular[:, 2] *= sign
    left[:, :, 2] *= sign[:, None]
    rotation = np.matmul(left, right)
    size = np.einsum("kni,kni->k", s, s)
    scale = singular.sum(axis=1) / np.where(size > 0.0, size, 1.0)
    shift = b - scale[:, None] * np.einsum("kij,kj->ki", rotation, a)
    return scale, rotation, shift


def fit_similarity(source: Array, target: Array) -> Similarity:
    """Return the least-squares similarity of (n, 3) points, n >= 3."""
    scale, rotation, shift = closed_form(source[None], target[None])
    return Similarity(float(scale[0]), rotation[0], shift[0])


def line_of(points: Array) -> Array | None:
    """(3,) unit vector of the line on which (n, 3) points nearly lie; None where they do not."""
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    axis: Array = axes[0]
    return axis if spread[1] < _ON_A_LINE * spread[0] else None


def robust_similarity(source: Array, target: Array) -> tuple[Similarity, Bools] | None:
    """Return the similarity that most points agree on, and those points.

    Least median of squares over triples; None when there are fewer than three points or they lie
    on a line.
    """
    n = len(source)
    index = _triples(source, target)
    if not len(index):
        return None
    # three points always agree: at least one more must
    half = min(n - 1, max(n // 2, 3))
    rows = _by_triples(source, target, index)
    columns = np.vstack((source.T, np.ones(n)))
    best, least = 0, np.inf  # of squares
    step = max(1, _AT_ONCE // n)
    for first in range(0, len(index), step):
        squares = _squares(rows[first : first + step], columns, target)
        # few are better than the best before: to count is quicker than to sort
        better = np.flatnonzero(np.count_nonzero(squares < least, axis=1) > half)
        if len(better):
            middle = np.partition(squares[better], half, axis=1)[:, half]
            best = first + int(better[np.argmin(middle)])
            least = float(middle.min())
    if not least < np.inf:
        return None
    distance = np.sqrt(_squares(rows[[best]], columns, target)[0])
    limit = 6.0 * sqrt(least) + 1e-9 * float(np.ptp(target, axis=0).max() + 1e-12)
    inliers = distance <= limit
    inliers[index[best]] = True
    return fit_similarity(source[inliers], target[inliers]), inliers


def agreeing_sets(source: Array, target: Array, most: int) -> list[Bools]:
    """Return sets of points on which a similarity agrees much better than on the next one.

    Of every size from three on those triples count that leave least. The sets are ordered by what
    the first point outside is off over what the last one inside is.

    Parameters
    ----------
    source, target
        (n, 3) points before and after.
    most
        How many sets are returned at most.
    """
    n = len(source)
    index = _triples(source, target, all_up_to=_ALL_TRIPLES)
    if n < 4 or not len(index):
        return []
    columns = np.vstack((source.T, np.ones(n)))
    squares = _squares(_by_triples(source, target, index), columns, target)
    ordered = np.sort(squares, axis=1)
    rounding = (1e-12 * float(np.abs(target).max())) ** 2
    found: dict[bytes, tuple[float, Bools]] = {}
    for size in range(3, n):
        taken = 0
        for k in np.argsort(ordered[:, size - 1], kind="stable").tolist():
            inside: Bools = squares[k] <= ordered[k, size - 1]
            gap = float(ordered[k, size] / (ordered[k, size - 1] + rounding))
            key = inside.tobytes()
            if key in found or np.count_nonzero(inside) != size:
                continue
            found[key] = gap, inside
            taken += 1
            if taken == most:
                break
    best = sorted(found.values(), key=lambda one: -one[0])
    return [inside for gap, inside in best[:most] if gap > 1.0]


def _triples(source: Array, target: Array, *, all_up_to: int = 8) -> Index:
    """(k, 3) triples to try, not on a line: all of few points, some of many."""
    n = len(source)
    if n < 3 or not float(np.ptp(target, axis=0).max()) > 0.0:
        return np.empty((0, 3), dtype=np.intp)
    rng = np.random.default_rng(0)
    if n <= all_up_to:
        index = np.array(list(combinations(range(n), 3)))
    else:
        index = np.argsort(rng.random((_SAMPLES, n)), axis=1)[:, :3] if n < 400 else (
            rng.integers(0, n, (_SAMPLES, 3))
        )  # fmt: skip
    base = source[index]
    edge1, edge2 = base[:, 1] - base[:, 0], base[:, 2] - base[:, 0]
    area = np.linalg.norm(np.cross(edge1, edge2), axis=1)
    span = float(np.ptp(source, axis=0).max())
    out: Index = index[area > 1e-4 * span * span]
    return out


def _by_triples(source: Array, target: Array, index: Index) -> Array:
    """(k, 3, 4) similarities of (k, 3) triples: rotation times scale, and shift."""
    scale, rotation, shift = closed_form(source[index], target[index])
    return np.concatenate((scale[:, None, None] * rotation, shift[:, :, None]), axis=2)


def _squares(rows: Array, columns: Array, target: Array) -> Array:
    """(k, n) squared distances of (4, n) points from their targets (n, 3), by k (3, 4) motions."""
    out: Array = np.zeros((len(rows), len(target)))
    for axis in range(3):
        off = rows[:, axis] @ columns
        off -= target[:, axis]
        off *= off
        out += off
    return out


def without_scale(fitted: Similarity, source: Array) -> Similarity:
    """Return the rotation of a similarity, and the shift that takes the middle of points along."""
    shift = fitted.apply(source).mean(axis=0) - fitted.rotation @ source.mean(axis=0)
    return Similarity(1.0, fitted.rotation, shift)


def similarity_effects(at: Array) -> Array:
    """Return (n, 3, 7): effect of shift [m], rotation [rad] and scale on points (n, 3)."""
    out = np.zeros((len(at), 3, 7))
    x, y, z = at.T
    for axis in range(3):
        out[:, axis, axis] = 1.0
    out[:, 1, 3], out[:, 2, 3] = -z, y
    out[:, 0, 4], out[:, 2, 4] = z, -x
    out[:, 0, 5], out[:, 1, 5] = -y, x
    out[:, :, 6] = at
    return out


def moved_similarity(now: Similarity, middle: Array, step: Array) -> Similarity:
    """Return a similarity after shift, turn and change of scale (7,) about a place (3,)."""
    rotation = turns(step[None, 3:6])[0]
    scale = now.scale * (1.0 + float(step[6]))
    shift = middle + step[:3] + (1.0 + float(step[6])) * rotation @ (now.shift - middle)
    return Similarity(scale, rotation @ now.rotation, shift)


def fit_to_partial(
    source: Array,
    target: Array,
    start: Similarity,
    *,
    some: bool = False,
    close: float = _CLOSE,
) -> Similarity | None:
    """Refine a similarity with targets that lack coordinates (NaN).

    Gauss-Newton over scale, rotation and shift with Cauchy's weights; None when the coordinates do
    not determine the seven parameters; with `some`, those that they leave open stay as they are.
    Ends where a step turns and scales by less than `close`, and shifts by less than that share of
    the extent.
    """
    known = np.isfinite(target)
    if int(known.sum()) < 7 and not some:
        return None
    # as many coordinates as parameters fit to the last digits, which say nothing of one another
    rounding = max(1e-12 * float(np.abs(target[known]).max(initial=0.0)), 1e-12)
    now = start
    middle = source.mean(axis=0)
    for _ in range(30):
        at = now.apply(source)
        centre = now.apply(middle[None])[0]
        arm = at - centre
        rows = similarity_effects(arm)
        e = (at - target)[known]
        design = rows[known]
        size = np.abs(e)
        spread = max(1.5 * float(np.median(size)), rounding)
        weight = 1.0 / np.sqrt(1.0 + (size / (3.0 * spread)) ** 2)
        length = np.linalg.norm(design, axis=0)
        length[length == 0.0] = 1.0
        solved, _, rank, singular = np.linalg.lstsq(
            design / length * weight[:, None], -e * weight, rcond=1e-9
        )
        if not some and (rank < 7 or singular[-1] < 1e-6 * singular[0]):
            return None
        step = solved / length
        angle = float(np.linalg.norm(step[3:6]))
        if angle > 0.5:
            step *= 0.5 / angle
        rotation = turns(step[None, 3:6])[0] @ now.rotation
        scale = now.scale * float(np.exp(np.clip(step[6], -0.5, 0.5)))
        shift = centre + step[:3] - scale * rotation @ middle
        now = Similarity(scale, rotation, shift)
        extent = max(float(np.abs(arm).max()), 1e-12)
        if float(np.abs(step[3:]).max()) < close and float(np.abs(step[:3]).max()) < close * extent:
            break
    return now
