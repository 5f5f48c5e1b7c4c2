"""Points that make a weak photo of a block stronger (Gruen 1980, section 4).

"The perimeter photos should be stabilized, if necessary, by observing additional tie and pass
points": which ones help most is computed, not guessed. With Q the cofactors of the photos that see
a candidate, and L the whitened rows of its rays after the candidate itself is eliminated,

    r = r + diag(G L (I + L'Q L)^-1 L'G')

for every other observation, G its cofactors with those photos: exact, without another adjustment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.imaging import BlockState, imaged_places, seen_places
from anaplot.bundle.solve.photosides import solve_photos
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.lens import without_lens
from anaplot.photogrammetry.measuredimage import measured_rays
from anaplot.photogrammetry.pointcolumns import Coded

__all__ = [
    "SIZES",
    "WEAK",
    "AddedPoint",
    "ExtraPoint",
    "Measured",
    "StabilizingSet",
    "as_recorded",
    "extra_points",
    "stabilizing_sets",
    "weak_ones",
]

SIZES = (1, 2, 4)
"""Numbers of points that are put in together."""

WEAK = 0.85
"""Of the median photo's mean redundancy number: below it a photo is weak beside the others."""

_GRID = (-0.4, -0.2, 0.0, 0.2, 0.4)  # of the format: candidates
_APART = 0.025  # of the format: nearer to a measured point nothing new is measured
_BESIDE = 0.03  # of the format: there the candidate is moved towards the middle
_EDGE = 1.0 + 1e-9
_UPRIGHT = 0.7  # cosine of the largest tilt at which points are sought on level ground

Measured = Callable[[str, Array], int]
"""How often a photo's ray to a place (3,) would be measured; 0: not at all."""


class ExtraPoint(NamedTuple):
    """A point that is to be measured as well.

    Attributes
    ----------
    x, y
        Where it lies in the weak photo [mm].
    place
        Where it lies on the ground, level at the mean height of the photo's points [m].
    photos
        Photos that see it.
    """

    x: float
    y: float
    place: tuple[float, float, float]
    photos: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class StabilizingSet:
    """Points that together raise the redundancy numbers of a weak photo most.

    Attributes
    ----------
    photo
        The photo.
    points
        What to measure.
    before, after
        Mean redundancy number of its observations, with those of the new points.
    low_before, low_after
        The smallest of those that it has now.
    """

    photo: str
    points: tuple[ExtraPoint, ...]
    before: float
    after: float
    low_before: float
    low_after: float


def weak_ones(block: AdjustedBlock) -> tuple[str, ...]:
    """Return the photos with few redundant observations beside the others, the weakest first."""
    problem = block.problem
    photos = np.repeat(problem.photo, 2)
    counts = np.ones(2 * len(problem.photo))
    if problem.rejected is not None:
        counts[problem.rejected.ravel()] = 0.0
    every = np.bincount(photos, counts, len(problem.photos))
    total = np.bincount(photos, block.cofactors.r.ravel(), len(problem.photos))
    mean = total / np.maximum(every, 1.0)
    limit = WEAK * float(np.median(mean))
    weak = [(round(r, 9), name) for name, r in zip(problem.photos, mean, strict=True) if r < limit]
    return tuple(name for _, name in sorted(weak))


def as_recorded(block: AdjustedBlock) -> Measured | None:
    """Return how often rays are measured where a block's rows name their models.

    Once in every model of its strip that shows the place in both photos, else once. None where no
    row names a model: every ray is measured once.
    """
    model = columns_of(block.problem.block.image_points).model
    if all(model.values[k] is None for k in np.unique(model.index).tolist()):
        return None
    every, origin = _Photos.of(block), block.state.origin
    partners: dict[str, list[str]] = {}
    for strip in block.problem.block.strips:
        for left, right in strip.models():
            partners.setdefault(left, []).append(right)
            partners.setdefault(right, []).append(left)
    seen: dict[bytes, frozenset[str]] = {}

    def times(photo: str, place: Array) -> int:
        key = place.tobytes()
        if key not in seen:
            seen.clear()  # a place is asked for photo by photo
            seen[key] = frozenset(every.names[k] for k in every.seen(place - origin))
        return max(1, sum(other in seen[key] for other in partners.get(photo, ())))

    return times


def stabilizing_sets(
    block: AdjustedBlock, photos: Iterable[str], measured: Measured | None = None
) -> tuple[StabilizingSet, ...]:
    """Find the points whose measurement helps photos most: of each the best one, two and four.

    Parameters
    ----------
    block
        The adjusted block.
    photos
        Their names.
    measured
        How often a photo's ray is measured; None: once wherever the photo shows the place.

    Returns
    -------
    tuple of StabilizingSet
        Of one photo after another, one for each of `SIZES` that there are candidates for; none for
        a photo that does not look down, or whose candidates no other photo sees.
    """
    every = _Photos.of(block)
    return tuple(one for photo in photos for one in _sets_of(block, every, photo, measured))


def _sets_of(
    block: AdjustedBlock, photos: _Photos, photo: str, measured: Measured | None
) -> tuple[StabilizingSet, ...]:
    index = photos.names.index(photo)
    candidates = _candidates(block, photos, index, measured)
    if not candidates:
        return ()
    local = _Neighbourhood.of(block, index, candidates)
    best: list[tuple[int, ...]] = []
    for size in SIZES:
        if size > len(candidates):
            break
        # all sets of one and of two; beyond, two more at a time
        kept = best[-1] if size > 2 else ()
        others = [k for k in range(len(candidates)) if k not in kept]
        tried = [kept + more for more in combinations(others, size - len(kept))]
        best.append(max(tried, key=lambda chosen: round(local.mean_with(chosen), 12)))
    before, low_before = local.with_points(())
    return tuple(
        StabilizingSet(
            photo,
            tuple(candidates[k].point for k in chosen),
            before,
            after,
            low_before,
            low_after,
        )
        for chosen in best
        for after, low_after in [local.with_points(chosen)]
    )


class AddedPoint(NamedTuple):
    """A point that is planned for weak photos: its name and its place (X, Y) [m]."""

    name: str
    place: tuple[float, float]


def extra_points(sets: Sequence[StabilizingSet], size: int, near: float) -> tuple[AddedPoint, ...]:
    """Return the points of the sets of a size; one for those that are the same for several.

    A photo with fewer candidates gets its largest set.

    Parameters
    ----------
    sets
        Of all weak photos.
    size
        One of `SIZES`.
    near
        Distance up to which two points are one [m].
    """
    largest: dict[str, StabilizingSet] = {}
    for one in sets:
        if len(one.points) <= size:
            largest[one.photo] = max(
                largest.get(one.photo, one), one, key=lambda of: len(of.points)
            )
    places: list[tuple[float, float]] = []
    for one in largest.values():
        for x, y, _ in (point.place for point in one.points):
            if all(max(abs(x - u), abs(y - v)) > near for u, v in places):
                places.append((x, y))
    digits = max(2, len(str(len(places))))
    return tuple(AddedPoint(f"s{k:0{digits}d}", place) for k, place in enumerate(places, 1))


class _Candidate(NamedTuple):
    point: ExtraPoint
    photo: Index  # of every ray
    a: Array  # (k, 2, 6) whitened derivatives by the photo
    b: Array  # (k, 2, 3) and by the point


class _Photos(NamedTuple):
    """What decides which photos see a place, for all photos of a block."""

    names: tuple[str, ...]
    problem: Problem
    state: BlockState
    reach: Array  # (n, 2) largest abs(x) and abs(y) [mm]

    @classmethod
    def of(cls, block: AdjustedBlock) -> _Photos:
        problem, state = block.problem, block.state
        cameras = {camera.id: camera for camera in problem.block.cameras}
        camera_of = {one.id: cameras[one.camera] for one in problem.block.photos}
        largest = dict.fromkeys(cameras, (0.0, 0.0))
        rows = columns_of(problem.block.image_points)
        taken_by = Coded.of([camera_of[name].id for name in rows.photo.values])
        for k, key in enumerate(taken_by.values):
            ideal = rows.xy[taken_by.index[rows.photo.index] == k]
            if len(ideal):
                x, y = np.abs(measured_rays(cameras[key], ideal)).max(axis=0).tolist()
                largest[key] = x, y
        # without a format a photo shows what others of its camera show
        used = [camera_of[name] for name in problem.photos]
        reach = [largest[one.id] if one.format is None else one.reach() for one in used]
        return cls(problem.photos, problem, state, np.array(reach))

    def seen(self, place: Array) -> Index:
        """Return the photos that show a place."""
        n = len(self.names)
        places = np.broadcast_to(place, (n, 3))
        found = seen_places(self.problem, self.state, np.arange(n), places)
        with np.errstate(invalid="ignore"):
            inside = (np.abs(found.xy) <= self.reach * _EDGE).all(axis=1)
        return np.flatnonzero(inside & (found.depth > 0.0))

    def direction(self, index: int, xy: Array) -> Array:
        """Return (3,) the ray of a place (2,) in a photo's image, NaN where it images nothing."""
        lens = self.problem.stated_lens
        if lens is None:
            away = xy / self.problem.c[index]
        else:
            away = without_lens(xy[None], lens[index])[0]
        return np.asarray(self.state.rotations[index] @ np.array([*away, -1.0]))


def _candidates(
    block: AdjustedBlock, photos: _Photos, index: int, measured: Measured | None
) -> list[_Candidate]:
    problem, state = block.problem, block.state
    rotation, centre, reach = state.rotations[index], state.centres[index], photos.reach[index]
    if abs(rotation[2, 2]) < _UPRIGHT:
        return []
    points = state.points[np.unique(problem.point[problem.photo == index])]
    taken = seen_places(problem, state, index, points).xy
    down = float(points[:, 2].mean() - centre[2])
    weight = 1.0 / float(np.median(problem.sigma_xy))
    found = []
    for fraction in product(_GRID, _GRID):
        xy = _beside(2.0 * reach * fraction, taken, 2.0 * float(reach.min()))
        ray = photos.direction(index, xy)
        if not ray[2] * down > 0.0:
            continue
        place = centre + ray * (down / ray[2])
        seen = photos.seen(place)
        names = [photos.names[k] for k in seen]
        absolute = place + state.origin
        times = [1 if measured is None else measured(name, absolute) for name in names]
        if index not in seen or np.count_nonzero(times) < 2:
            continue
        rays = np.repeat(seen, times)
        places = np.broadcast_to(place, (len(rays), 3))
        derived = imaged_places(problem, state, rays, places)
        point = ExtraPoint(
            float(xy[0]),
            float(xy[1]),
            (float(absolute[0]), float(absolute[1]), float(absolute[2])),
            tuple(name for name, count in zip(names, times, strict=True) if count),
        )
        found.append(_Candidate(point, rays, derived.photo * weight, derived.point * weight))
    return found


def _beside(xy: Array, taken: Array, format_mm: float) -> Array:
    """Return a place [mm], moved towards the middle where a point is measured already."""
    if len(taken) and np.abs(taken - xy).max(axis=1).min() > _APART * format_mm:
        return xy
    away = float(np.linalg.norm(xy))
    direction = np.array([0.0, 1.0]) if away < _APART * format_mm else -xy / away
    return np.asarray(xy + direction * _BESIDE * format_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _Neighbourhood:
    """A photo's observations, and the photos that see its candidates.

    Attributes
    ----------
    r
        (k,) redundancy numbers of the photo's coordinates.
    rows
        Of each candidate (2 j,), where its coordinates stand in the following arrays.
    beside
        (k, m) cofactors of the photo's with the candidates' coordinates, their points eliminated.
    between
        (m, m) cofactors of those.
    alone
        (m,) the redundancy numbers that the rays of a candidate alone have.
    mine
        (m,) whether the coordinate is one of the photo.
    shared
        (m, m) beside' beside.
    """

    r: Array
    rows: tuple[Index, ...]
    beside: Array
    between: Array
    alone: Array
    mine: Bools
    shared: Array

    @classmethod
    def of(
        cls, block: AdjustedBlock, index: int, candidates: Sequence[_Candidate]
    ) -> _Neighbourhood:
        problem, normal = block.problem, block.cofactors.normal
        near = np.unique(np.concatenate([one.photo for one in candidates]))
        n, d = len(near), problem.per_photo
        photos = np.zeros((len(problem.photos), d, 6 * n))
        unknowns = np.arange(6 * n)
        photos[near[unknowns // 6], unknowns % 6, unknowns] = 1.0
        rays = np.flatnonzero(problem.photo == index)
        solved, at_rays = solve_photos(normal, block.cofactors.factor, photos, rays)
        rows, alone, mine = [], [], []
        for one in candidates:
            j = len(one.photo)
            b = one.b.reshape(2 * j, 3)
            projector = np.eye(2 * j) - b @ np.linalg.pinv(b)
            a = np.zeros((j, 2, n, 6))
            a[np.arange(j), :, np.searchsorted(near, one.photo)] = one.a
            rows.append(projector @ a.reshape(2 * j, 6 * n))
            alone.append(np.diag(projector))
            mine.append(np.repeat(one.photo == index, 2))
        whole, q = np.concatenate(rows), solved[near, :6].reshape(6 * n, 6 * n)
        beside = at_rays.reshape(2 * len(rays), 6 * n) @ whole.T
        ends = np.cumsum([len(one) for one in rows])
        return cls(
            block.cofactors.r[rays].ravel(),
            tuple(np.split(np.arange(ends[-1]), ends[:-1])),
            beside,
            whole @ q @ whole.T,
            np.concatenate(alone),
            np.concatenate(mine),
            beside.T @ beside,
        )

    def mean_with(self, chosen: Sequence[int]) -> float:
        """Return the mean redundancy number that `with_points` returns, without those it sums."""
        rows = np.concatenate([self.rows[k] for k in chosen])
        at = np.ix_(rows, rows)
        between, mine = self.between[at], self.mine[rows]
        inverse = np.linalg.inv(np.eye(len(rows)) + between)
        old = self.r.sum() + np.vdot(inverse, self.shared[at])
        new = self.alone[rows][mine].sum() - np.vdot(inverse[mine], between[mine])
        return float((old + new) / (len(self.r) + np.count_nonzero(mine)))

    def with_points(self, chosen: Sequence[int]) -> tuple[float, float]:
        """Return the photo's mean redundancy number with points, and the smallest it had."""
        if not chosen:
            return float(self.r.mean()), float(self.r.min())
        rows = np.concatenate([self.rows[k] for k in chosen])
        between, beside = self.between[np.ix_(rows, rows)], self.beside[:, rows]
        inverse = np.linalg.inv(np.eye(len(rows)) + between)
        old = self.r + ((beside @ inverse) * beside).sum(axis=1)
        # of the new ones P - P A Q' A'P with Q' the cofactors that they have changed themselves
        new = (self.alone[rows] - (inverse * between).sum(axis=1))[self.mine[rows]]
        return float(np.concatenate([old, new]).mean()), float(old.min())
