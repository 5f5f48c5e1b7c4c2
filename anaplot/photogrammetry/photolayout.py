"""How photographs lie to each other, roughly, from the points that they have in common.

No orientation is needed for it, and no order of the photographs: what is compared are plane
similarities of the photographs' coordinates, as on a table where prints are laid out.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Complex, Index
from anaplot.photogrammetry.imagepoint import ImagePoint
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.rotation import wrapped

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
    size = np.vdot(za, za).real + np.vdot(zb, zb).real
    angle, mirrored, misfit, spread = _fitted(
        np.array(float(len(a))), np.vdot(zb, za), np.vdot(zb.conj(), za), size
    )
    return Overlap(len(a), float(angle), bool(mirrored), float(misfit), float(spread))


def _fitted(
    points: Array, turn: Complex, mirror: Complex, size: Array
) -> tuple[Array, Bools, Array, Array]:
    """Return angles, reflections, misfits and spreads of overlaps, as in `Overlap`.

    Parameters
    ----------
    points
        Their numbers of points.
    turn, mirror, size
        Sums of the products of the second photograph's reduced coordinates, conjugated for a turn,
        with the first one's; and of the squares of both.
    """
    left_turn = np.maximum(size - 2.0 * np.abs(turn), 0.0)
    left_mirror = np.maximum(size - 2.0 * np.abs(mirror), 0.0)
    mirrored = left_mirror < _MIRRORED**2 * left_turn
    best = np.where(mirrored, mirror, turn)
    misfit = np.sqrt(np.minimum(left_turn, left_mirror) / points)
    return np.arctan2(best.imag, best.real), mirrored, misfit, np.sqrt(size / (2.0 * points))


def laid_out(image_points: Iterable[ImagePoint]) -> dict[str, PhotoPlace]:
    """Return how photographs lie to each other, those that hang together with the most others.

    Overlaps of convergent photographs do not fit a plane similarity, and are left out.

    Parameters
    ----------
    image_points
        Their image points; what is off does not count.
    """
    columns = columns_of(image_points)
    rows = columns.with_use("xy", "x", "y")
    if not len(rows):
        return {}
    photos, points = columns.photo.of_rows(rows), columns.point.of_rows(rows)
    photo, point, names = photos.index, points.index, photos.values
    # of a point that a photograph has twice the first
    once = np.unique(point * len(names) + photo, return_index=True)[1]
    photo, point = photo[once], point[once]
    at = columns.xy[rows[once]].view(np.complex128)[:, 0]
    count = np.bincount(photo)
    total = np.stack((np.bincount(photo, at.real), np.bincount(photo, at.imag)), axis=1)
    middle = (total / count[:, None]).view(np.complex128)[:, 0]
    at = at - middle[photo]
    spread = np.bincount(photo, np.abs(at)) / count
    overlaps = _overlaps(names, photo, point, at)
    if overlaps is None:
        return {}
    return {names[k]: place for k, place in _placed(overlaps, middle, spread).items()}


class _Overlaps(NamedTuple):
    """Overlaps of pairs of photographs; complex numbers are coordinates x + iy [mm].

    Attributes
    ----------
    first, second
        Numbers of the photographs.
    points, angle, mirrored, misfit
        As in `Overlap`.
    means
        (2, n) means of the common points in either photograph, from the mean of all its points.
    """

    first: Index
    second: Index
    points: Array
    angle: Array
    mirrored: Bools
    misfit: Array
    means: Complex

    def of(self, these: Bools | Index) -> _Overlaps:
        """Return some of them."""
        return _Overlaps(
            self.first[these],
            self.second[these],
            self.points[these],
            self.angle[these],
            self.mirrored[these],
            self.misfit[these],
            self.means[:, these],
        )


def _overlaps(names: tuple[str, ...], photo: Index, point: Index, at: Complex) -> _Overlaps | None:
    """Return the overlaps that say something; None where no two photographs have enough in common.

    Parameters
    ----------
    names
        Of the photographs.
    photo, point, at
        (m,) photograph, point and coordinates of every ray, from the mean of its photograph.
    """
    from scipy.sparse import csr_matrix, triu  # loaded with the first photos

    rank = np.empty(len(names), dtype=np.intp)
    rank[np.argsort(np.array(names, dtype=object), kind="stable")] = np.arange(len(names))
    order = np.lexsort((rank[photo], point))
    first_of = np.searchsorted(point[order], np.arange(int(point.max()) + 1))
    order = order[np.arange(len(order)) - first_of[point[order]] < _MOST_RAYS]
    # photographs in the order of their names: of a pair the first is the one with the lower row
    photo, point, at = rank[photo[order]], point[order], at[order]
    shape = (len(names), len(first_of))

    def rays(values: Array | Complex) -> csr_matrix:
        return csr_matrix((values, (photo, point)), shape=shape)

    once, there, square = rays(np.ones(len(at))), rays(at), rays(np.abs(at) ** 2)
    common = triu(once @ once.T, 1).tocoo()
    enough = common.data >= _FEWEST
    if not enough.any():
        return None  # SciPy takes no elements of a product as another kind of matrix
    i, j, n = common.row[enough], common.col[enough], common.data[enough]

    def of_pairs(product: csr_matrix) -> tuple[Array, Array]:
        """Return the elements (i, j) and (j, i) of a product."""
        return np.asarray(product[i, j]).ravel(), np.asarray(product[j, i]).ravel()

    sums = np.stack(of_pairs(there @ once.T))
    size = np.sum(of_pairs(square @ once.T), axis=0) - (np.abs(sums) ** 2).sum(axis=0) / n
    turn = of_pairs(there @ there.conj().T)[0] - sums[0] * sums[1].conj() / n
    mirror = of_pairs(there @ there.T)[0] - sums[0] * sums[1] / n
    angle, mirrored, misfit, spread = _fitted(n, turn, mirror, np.maximum(size, 0.0))
    back = np.argsort(rank)
    found = _Overlaps(back[i], back[j], n, angle, mirrored, misfit, sums / n)
    return found.of(misfit <= LOOSE * spread)


def _placed(overlaps: _Overlaps, middle: Complex, spread: Array) -> dict[int, PhotoPlace]:
    """Return photographs among the others, by their numbers.

    Parameters
    ----------
    overlaps
        Those that say something.
    middle, spread
        (photos,) mean of the points of each photograph, and their mean distance from it.
    """
    angle, flip = _along_tree(overlaps)
    if not angle:
        return {}
    photos = np.array(list(angle))
    n = len(photos)
    names = np.full(len(middle), -1)
    names[photos] = np.arange(n)
    sign = np.array([-1.0 if flip[photo] else 1.0 for photo in angle])
    # points on a line fit mirrored as well: what contradicts the others says nothing
    overlaps = overlaps.of(names[overlaps.first] >= 0)
    i, j = names[overlaps.first], names[overlaps.second]
    agrees = overlaps.mirrored == (sign[i] != sign[j])
    seen, against = (
        np.bincount(i, points, n) + np.bincount(j, points, n)
        for points in (overlaps.points, np.where(agrees, 0.0, overlaps.points))
    )
    i, j, overlaps = i[agrees], j[agrees], overlaps.of(agrees)
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import splu

    weight = overlaps.points
    # the graph's Laplacian, the first photo held
    laplace = coo_matrix(
        (
            np.concatenate([weight, weight, -weight, -weight]),
            (np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])),
        ),
        shape=(n, n),
    ).tocsc()[1:, 1:]
    factor = splu(laplace, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})

    def solved(difference: Array) -> Array:
        """Return values at the photos from their differences j - i along the edges."""
        right = np.bincount(j, weight * difference, n) - np.bincount(i, weight * difference, n)
        return np.concatenate([[0.0], factor.solve(right[1:])])

    start = np.array(list(angle.values()))
    misclosure = sign[i] * overlaps.angle - (start[j] - start[i])
    turned = start + solved(wrapped(misclosure))
    mean = overlaps.means + middle[photos[np.stack([i, j])]]

    def among(mean: Complex, k: Index) -> Complex:
        """Return means of image coordinates of photographs as they lie among the others."""
        out: Complex = (mean.real + 1j * sign[k] * mean.imag) * np.exp(1j * turned[k])
        return out

    shift = among(mean[0], i) - among(mean[1], j)
    usual = np.count_nonzero(sign < 0.0) > n / 2
    columns = (
        solved(shift.real),
        solved(shift.imag),
        turned,
        (sign < 0.0) != usual,
        spread[photos],
        against / seen,
    )
    places = map(PhotoPlace, *(column.tolist() for column in columns))
    return dict(zip(photos.tolist(), places, strict=True))


def _along_tree(overlaps: _Overlaps) -> tuple[dict[int, float], dict[int, bool]]:
    """Return angles and reflections along the strongest overlaps, in the largest component."""
    beside: dict[int, list[tuple[int, float, bool]]] = defaultdict(list)
    root: dict[int, int] = {}

    def root_of(photo: int) -> int:
        while root.setdefault(photo, photo) != photo:
            root[photo] = root[root[photo]]
            photo = root[photo]
        return photo

    strong = overlaps.of(np.lexsort((overlaps.misfit, -overlaps.points)))
    apart = len(np.union1d(strong.first, strong.second))
    for first, second, turn, mirrored in zip(
        strong.first.tolist(),
        strong.second.tolist(),
        strong.angle.tolist(),
        strong.mirrored.tolist(),
        strict=True,
    ):
        a, b = root_of(first), root_of(second)
        if a != b:
            root[a] = b
            apart -= 1
            beside[first].append((second, turn, mirrored))
            beside[second].append((first, turn if mirrored else -turn, mirrored))
            if apart == 1:
                break
    largest: tuple[dict[int, float], dict[int, bool]] = ({}, {})
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
