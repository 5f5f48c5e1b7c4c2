"""How photographs lie to each other, roughly, from the points that they have in common.

No orientation is needed for it, and no order of the photographs: what is compared are plane
similarities of the photographs' coordinates, as on a table where prints are laid out.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import atan2, pi
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.block import ImagePoint

__all__ = ["LOOSE", "Overlap", "PhotoPlace", "laid_out", "overlap"]

LOOSE = 0.35
"""Misfit of an overlap, times the spread of its points, above which it says nothing."""

_FEWEST = 4  # common points: fewer say nothing of a turn
_MOST_RAYS = 30  # of a point: in more photos, not every pair of them is looked at
_MIRRORED = 0.5  # times the misfit of a turn: a reflection that fits as well as that is one


class Overlap(NamedTuple):
    """How a second photograph lies to a first one.

    Attributes
    ----------
    points
        Common points.
    angle
        By which the second one is turned against the first [rad].
    mirrored
        Whether one of them is mirrored.
    misfit
        Root mean square of what a turn and a shift leave [mm]: relief, and wrong points.
    spread
        Root mean square distance of the points from their mean [mm].
    """

    points: int
    angle: float
    mirrored: bool
    misfit: float
    spread: float

    @property
    def loose(self) -> bool:
        """Whether the photographs do not lie like prints on a table: convergent, or nonsense."""
        return self.misfit > LOOSE * self.spread


@dataclass(frozen=True, slots=True)
class PhotoPlace:
    """A photograph among the others.

    Attributes
    ----------
    x, y
        Of its principal point [mm at photo scale].
    angle
        By which it is turned [rad].
    mirrored
        Whether it is, against most others.
    spread
        Mean distance of its points from their mean [mm].
    contradicted
        Share of the points in its overlaps, 0 to 1, that have it the other way round.
    """

    x: float
    y: float
    angle: float
    mirrored: bool
    spread: float
    contradicted: float


def overlap(first: Array, second: Array) -> Overlap:
    """Return how a second photograph lies to a first one.

    Parameters
    ----------
    first, second
        (n, 2) image coordinates of the same points [mm].
    """
    a, b = first - first.mean(axis=0), second - second.mean(axis=0)
    # in complex numbers a turn is a factor, a reflection is a conjugate
    za, zb = a @ np.array([1.0, 1.0j]), b @ np.array([1.0, 1.0j])
    turn, mirror = np.vdot(zb, za), np.vdot(zb.conj(), za)
    size = float(np.vdot(za, za).real + np.vdot(zb, zb).real)
    left_turn = max(size - 2.0 * abs(turn), 0.0)
    left_mirror = max(size - 2.0 * abs(mirror), 0.0)
    mirrored = left_mirror < _MIRRORED**2 * left_turn
    best = mirror if mirrored else turn
    misfit = (min(left_turn, left_mirror) / len(a)) ** 0.5
    spread = (size / (2.0 * len(a))) ** 0.5
    return Overlap(len(a), atan2(best.imag, best.real), mirrored, misfit, spread)


def laid_out(image_points: Iterable[ImagePoint]) -> dict[str, PhotoPlace]:
    """Return how photographs lie to each other, those that hang together with the most others.

    Overlaps of convergent photographs do not fit a plane similarity, and are left out.

    Parameters
    ----------
    image_points
        Their image points; what is off does not count.
    """
    places: dict[str, dict[str, tuple[float, float]]] = defaultdict(dict)
    photos_of: dict[str, list[str]] = defaultdict(list)
    for row in image_points:
        if row.use != "off" and row.point not in places[row.photo]:
            places[row.photo][row.point] = (row.x, row.y)
            photos_of[row.point].append(row.photo)
    common: dict[tuple[str, str], list[str]] = defaultdict(list)
    for point, photos in photos_of.items():
        near = sorted(photos)[:_MOST_RAYS]
        for k, first in enumerate(near):
            for second in near[k + 1 :]:
                common[first, second].append(point)
    pairs = {
        (i, j): (_of(places[i], points), _of(places[j], points))
        for (i, j), points in common.items()
        if len(points) >= _FEWEST
    }
    return _placed(pairs, {photo: _spread(here) for photo, here in places.items()})


def _spread(places: Mapping[str, tuple[float, float]]) -> float:
    at = np.array(list(places.values()))
    return float(np.hypot(*(at - at.mean(axis=0)).T).mean())


def _of(places: Mapping[str, tuple[float, float]], points: list[str]) -> Array:
    return np.array([places[p] for p in points])


def _placed(
    pairs: Mapping[tuple[str, str], tuple[Array, Array]], spread: Mapping[str, float]
) -> dict[str, PhotoPlace]:
    every = {key: overlap(*both) for key, both in pairs.items()}
    overlaps = {key: one for key, one in every.items() if not one.loose}
    angle, flip = _along_tree(overlaps)
    names = {photo: k for k, photo in enumerate(angle)}
    # points on a line fit mirrored as well: what contradicts the others says nothing
    edges = []
    seen: dict[str, int] = defaultdict(int)
    against: dict[str, int] = defaultdict(int)
    for (first, second), one in overlaps.items():
        if first not in names:
            continue
        agrees = one.mirrored == (flip[first] != flip[second])
        if agrees:
            edges.append((first, second))
        for photo in (first, second):
            seen[photo] += one.points
            against[photo] += 0 if agrees else one.points
    if not edges:
        return {}
    from scipy.sparse import coo_matrix  # loaded with the first photos that overlap
    from scipy.sparse.linalg import spsolve

    i, j = (np.array([names[key[end]] for key in edges]) for end in (0, 1))
    weight = np.array([float(overlaps[key].points) for key in edges])
    n = len(names)
    # the graph's Laplacian, the first photo held
    laplace = coo_matrix(
        (
            np.concatenate([weight, weight, -weight, -weight]),
            (np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])),
        ),
        shape=(n, n),
    ).tocsc()[1:, 1:]

    def solved(difference: Array) -> Array:
        """Return values at the photos from their differences j - i along the edges."""
        right = np.zeros(n)
        np.add.at(right, j, weight * difference)
        np.add.at(right, i, -weight * difference)
        out = np.zeros(n)
        if n > 1:
            out[1:] = spsolve(laplace, right[1:])
        return out

    start = np.array(list(angle.values()))
    sign = np.array([-1.0 if flip[photo] else 1.0 for photo in names])
    found = np.array([sign[names[key[0]]] * overlaps[key].angle for key in edges])
    misclosure = found - (start[j] - start[i])
    turned = start + solved((misclosure + pi) % (2.0 * pi) - pi)
    shifts = np.array(
        [
            _turned(pairs[key][0], turned[a], sign[a]) - _turned(pairs[key][1], turned[b], sign[b])
            for key, a, b in zip(edges, i, j, strict=True)
        ]
    )
    x, y = solved(shifts[:, 0]), solved(shifts[:, 1])
    usual = np.count_nonzero(sign < 0.0) > len(sign) / 2
    return {
        photo: PhotoPlace(
            float(x[k]),
            float(y[k]),
            float(turned[k]),
            bool((sign[k] < 0.0) != usual),
            spread[photo],
            against[photo] / seen[photo],
        )
        for photo, k in names.items()
    }


def _turned(places: Array, angle: float, sign: float) -> Array:
    """Return the mean of image coordinates of a photo as it lies among the others."""
    x, y = places.mean(axis=0)
    z = complex(x, sign * y) * np.exp(1j * angle)
    return np.array([z.real, z.imag])


def _along_tree(
    overlaps: Mapping[tuple[str, str], Overlap],
) -> tuple[dict[str, float], dict[str, bool]]:
    """Return angles and reflections along the strongest overlaps, in the largest component."""
    beside: dict[str, list[tuple[str, float, bool]]] = defaultdict(list)
    root: dict[str, str] = {}

    def root_of(photo: str) -> str:
        while root.setdefault(photo, photo) != photo:
            root[photo] = root[root[photo]]
            photo = root[photo]
        return photo

    strong = sorted(overlaps.items(), key=lambda item: (-item[1].points, item[1].misfit))
    for (first, second), one in strong:
        a, b = root_of(first), root_of(second)
        if a != b:
            root[a] = b
            back = one.angle if one.mirrored else -one.angle
            beside[first].append((second, one.angle, one.mirrored))
            beside[second].append((first, back, one.mirrored))
    largest: tuple[dict[str, float], dict[str, bool]] = ({}, {})
    left = dict.fromkeys(beside)
    while left:
        start = next(iter(left))
        angle, flip = {start: 0.0}, {start: False}
        waiting = [start]
        while waiting:
            photo = waiting.pop()
            for other, turn, mirrored in beside[photo]:
                if other not in angle:
                    angle[other] = angle[photo] + (-turn if flip[photo] else turn)
                    flip[other] = flip[photo] != mirrored
                    waiting.append(other)
        for photo in angle:
            del left[photo]
        if len(angle) > len(largest[0]):
            largest = angle, flip
    return largest
