"""A part of a block whose photos are oriented in one system, and how such parts grow and join."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anaplot.aliases import Array, Bools, Index, Progress
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.sorting import order_of
from anaplot.bundle.start.resection import resect
from anaplot.photogrammetry.collinearity import project, turns
from anaplot.photogrammetry.similarity import Similarity, fit_similarity, line_of, robust_similarity

__all__ = [
    "RESECTING",
    "SubBlock",
    "common_similarity",
    "intersect_rays",
    "median_miss",
    "met",
    "rays_of_photos",
    "unit_rays",
]


RESECTING = "resecting photos"
"""What is said of the progress of resections."""

_ALONG = 0.01  # share of the extent within which points on a line coincide
_ALIKE = 0.1  # of their extent: by how much places of two parts may differ
_ASTRAY = 20.0  # times as far from the middle as half of the places: no place of a part
_ROUNDS = 6  # of weights when rays are intersected
_PARALLEL = 1e-10  # smallest over largest eigenvalue below which rays count as parallel
_NARROW = 1e-6  # the same, from which a solution by cofactors keeps its digits
_AT_ONCE = 8192  # rays that are intersected together
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # of a symmetric matrix


@dataclass(slots=True, eq=False)
class SubBlock:
    """Photos and points in one system; NaN for what is not in it.

    Attributes
    ----------
    centres, rotations
        (photos, 3) and (photos, 3, 3).
    points
        (points, 3).
    """

    centres: Array
    rotations: Array
    points: Array

    @classmethod
    def empty(cls, problem: Problem) -> SubBlock:
        """Return a sub-block of nothing."""
        n, p = len(problem.photos), len(problem.points)
        return cls(np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan), np.full((p, 3), np.nan))

    @property
    def oriented(self) -> Bools:
        """(photos,) which photos are in it."""
        out: Bools = np.isfinite(self.centres[:, 0])
        return out

    @property
    def placed(self) -> Bools:
        """(points,) which points are in it."""
        x, y, z = np.isfinite(self.points).T
        out: Bools = x & y & z
        return out

    def transform(self, similarity: Similarity) -> None:
        """Move everything into another system."""
        self.centres = similarity.apply(self.centres)
        self.rotations = similarity.rotation @ self.rotations
        self.points = similarity.apply(self.points)

    def place(self, problem: Problem, rays: Array, *, again: bool = False) -> int:
        """Intersect the points without a place that two photos of the sub-block see.

        Returns how many are new. With `again` all that two photos see are intersected.
        """
        before = self.placed
        found = intersect_rays(problem, self, rays, None if again else ~before)
        new = np.isfinite(found[:, 0])
        self.points[new] = found[new]
        return int((new & ~before).sum())

    def add_photos(
        self,
        problem: Problem,
        by_photo: list[Index],
        fewest: int = 4,
        *,
        but: Bools | None = None,
        of_most: float = 0.0,
        tried: dict[int, tuple[int, int]] | None = None,
        progress: Progress | None = None,
    ) -> int:
        """Orient photos to points of the sub-block, those with most points first; returns how many.

        A photo is taken when most of its points agree within 2 % of the camera constant; none of
        (photos,) `but` is, and none that sees less than a share `of_most` of the points that the
        photo with most of them sees. What `tried` remembers of photos that were not taken - how
        many points they saw, and how many of these agreed - is not computed again. `progress` is
        called with what is being done and the share of the photos that are oriented.
        """
        tried = {} if tried is None else tried
        added = 0
        passed = self.oriented if but is None else self.oriented | but
        placed = self.placed
        counts = np.bincount(problem.photo[placed[problem.point]], minlength=len(problem.photos))
        left = np.where(passed, 0, counts)
        least = max(fewest, of_most * float(left.max(initial=0)))
        for photo in np.argsort(-counts, kind="stable").tolist():
            if counts[photo] < least:
                break
            if passed[photo]:
                continue
            rays = by_photo[photo]
            rays = rays[placed[problem.point[rays]]]
            names, first = np.unique(problem.point[rays], return_index=True)
            if len(names) < fewest:
                continue
            c = float(problem.c[photo])
            enough = max(fewest, 0.6 * len(names))
            before = tried.get(photo)
            if before is not None and before[0] == len(names) and before[1] < enough:
                continue
            if progress is not None:
                progress(RESECTING, (int(passed.sum()) + added) / len(counts))
            found = resect(problem.ideal[rays[first]], c, self.points[names])
            agree = 0 if found is None else int((found.residual < 0.02 * c).sum())
            if found is None or agree < enough:
                tried[photo] = len(names), agree
                continue
            self.centres[photo], self.rotations[photo] = found.centre, found.rotation
            added += 1
        return added

    def join(self, other: SubBlock, *, hinged: bool = False) -> bool:
        """Take up another subblock by the points and projection centres common to both.

        Parameters
        ----------
        other
            The other subblock, moved into this system.
        hinged
            Whether common points nearly on a line suffice (strips with little side lap over flat
            ground): noise alone would tell how the other subblock is turned about it, so both are
            made to look the same way.
        """
        mine, its = self.placed, other.placed
        points, photos = mine & its, self.oriented & other.oriented
        source = np.concatenate((other.points[points], other.centres[photos]))
        target = np.concatenate((self.points[points], self.centres[photos]))
        if len(source) < 3:
            return False
        found = common_similarity(source, target)
        if found is None and hinged:
            found = _on_a_line(source, target)
        if found is None:
            return False
        similarity, inliers = found
        if inliers.sum() < max(3, 0.5 * len(source)):
            return False
        axis = line_of(target[inliers])
        if axis is not None and not hinged:
            return False
        other.transform(similarity)
        if axis is not None:
            turn = self._looking_alike(other, axis)
            middle = target[inliers].mean(axis=0)
            other.transform(Similarity(1.0, turn, middle - turn @ middle))
        new_photos, new_points = other.oriented & ~self.oriented, its & ~mine
        self.centres[new_photos] = other.centres[new_photos]
        self.rotations[new_photos] = other.rotations[new_photos]
        self.points[new_points] = other.points[new_points]
        return True

    def _looking_alike(self, other: SubBlock, axis: Array) -> Array:
        """(3, 3) turn of another subblock about an axis after which both look the same way."""
        mine, its = (
            np.nanmean(subblock.rotations[:, :, 2], axis=0)
            - axis * (np.nanmean(subblock.rotations[:, :, 2], axis=0) @ axis)
            for subblock in (self, other)
        )
        angle = float(np.arctan2(np.cross(its, mine) @ axis, its @ mine))
        turn: Array = turns(angle * axis[None])[0]
        return turn

    def residuals(self, problem: Problem) -> Array:
        """(m,) distances of the rays from their points in the image [mm]; NaN when unknown."""
        rays = problem.photo, problem.point
        seen = project(self.centres, self.rotations, problem.c, self.points, rays)
        off = seen.xy - problem.ideal
        size = np.sqrt(np.einsum("ij,ij->i", off, off))
        return np.where(seen.depth > 0.0, size, np.where(np.isfinite(size), np.inf, np.nan))


def common_similarity(source: Array, target: Array) -> tuple[Similarity, Bools] | None:
    """Return the similarity on which most places of two parts agree, and those places.

    None where they leave it open, or do not agree: any three of them may be laid onto each other.

    Parameters
    ----------
    source, target
        (n, 3) the same places in both.
    """
    here = _near(source) & _near(target)
    found = robust_similarity(source[here], target[here])
    if found is None:
        return None
    similarity, inliers = found
    here[here] = inliers
    off = np.linalg.norm(similarity.apply(source[here]) - target[here], axis=1)
    extent = float(np.ptp(target[here], axis=0).max())
    # places that coincide in one of them, and not in the other, agree on nothing
    alike = extent > 0.0 and float(np.median(off)) <= _ALIKE * extent
    return (similarity, here) if alike else None


def _near(places: Array) -> Bools:
    """(n,) which of (n, 3) places lie where most of them do.

    A wrong ray nearly parallel to another one leaves a point far away, off the line of the others:
    it alone would tell how a part is turned about that line.
    """
    away = np.linalg.norm(places - np.median(places, axis=0), axis=1)
    near: Bools = away <= _ASTRAY * np.median(away)
    return near


def _on_a_line(source: Array, target: Array) -> tuple[Similarity, Bools] | None:
    """Return a similarity of points on a line, anyhow turned about it; None where they differ."""
    here = _near(source) & _near(target)
    source, target = source[here], target[here]
    extent = float(np.ptp(target, axis=0).max())
    if not extent > 0.0:
        return None
    similarity = fit_similarity(source, target)
    inliers = np.linalg.norm(similarity.apply(source) - target, axis=1) < _ALONG * extent
    return (similarity, here) if inliers.all() else None


def unit_rays(problem: Problem) -> Array:
    """Return (m, 3) rays of unit length in image axes."""
    rays = np.column_stack((problem.ideal, -problem.c[problem.photo]))
    rays /= np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None]
    return rays


def rays_of_photos(problem: Problem) -> list[Index]:
    """Return the numbers of the rays of each photo."""
    order = order_of(problem.photo, len(problem.photos))
    ends = np.searchsorted(problem.photo[order], np.arange(1, len(problem.photos)))
    return np.split(order, ends)


def median_miss(size: Array) -> float:
    """Return by how much rays miss in the median, of what is known of them; infinite without."""
    known = size[~np.isnan(size)]
    return float(np.median(known)) if len(known) else float("inf")


def intersect_rays(
    problem: Problem, subblock: SubBlock, rays: Array, wanted: Bools | None = None
) -> Array:
    """Return (points, 3): where the rays of the sub-block's photos meet best; NaN elsewhere.

    Weighted by Cauchy's function of the angle by which a ray misses, so that one wrong ray among
    three or more loses its pull.

    Parameters
    ----------
    rays
        (m, 3) rays of unit length in image axes.
    wanted
        (points,) those to be intersected; None: all.
    """
    out = np.full((len(problem.points), 3), np.nan)
    mine = subblock.oriented[problem.photo]
    if wanted is not None:
        mine &= wanted[problem.point]
    several = np.bincount(problem.point[mine], minlength=len(out)) > 1
    use = np.nonzero(mine & several[problem.point])[0]
    if not len(use):
        return out
    photo = problem.photo[use]
    point = (np.cumsum(several) - 1)[problem.point[use]]
    out[several] = met(subblock, rays[use], photo, point)
    return out


def met(subblock: SubBlock, rays: Array, photo: Index, point: Index) -> Array:
    """Return where rays of points meet best, side by side; see `intersect_rays`.

    Parameters
    ----------
    subblock
        The photos.
    rays, photo, point
        (m, 3) rays of unit length in image axes, (m,) their photos, and (m,) points that are
        counted from 0, in ascending order: two rays or more of each.
    """
    first = np.flatnonzero(np.diff(point, prepend=-1))
    origin = np.nanmean(subblock.centres, axis=0)
    portions = _portions(first, len(rays))
    # a row for every component, so that one operation takes that of all rays
    direction, centre = np.empty((3, len(rays))), np.empty((3, len(rays)))
    turned = np.ascontiguousarray(subblock.rotations.transpose(1, 2, 0))
    centres = np.ascontiguousarray((subblock.centres - origin).T)
    sums, miss = np.empty((9, len(first))), np.empty(len(rays))
    for k, points in portions:
        own = np.ascontiguousarray(rays[k].T)
        for out, axes in zip(direction[:, k], turned.take(photo[k], axis=2), strict=True):
            np.einsum("jn,jn->n", axes, own, out=out)
        centre[:, k] = centres.take(photo[k], axis=1)
        rows = _rows(direction[:, k], centre[:, k], np.ones(len(miss[k])))
        sums[:, points] = np.add.reduceat(rows, first[points] - k.start, axis=1)
    for _ in range(_ROUNDS - 1):
        found = _solved(sums)
        for k, _ in portions:
            away = found.take(point[k], axis=1)
            away -= centre[:, k]
            squares = np.zeros(len(miss[k]))
            for i, j in ((0, 1), (1, 2), (2, 0)):
                squares += (direction[i, k] * away[j] - direction[j, k] * away[i]) ** 2
            with np.errstate(invalid="ignore", divide="ignore"):
                np.divide(squares, np.einsum("in,in->n", away, away), out=miss[k])
        known = miss[np.isfinite(miss)]
        scale = max(3.0 * float(np.median(np.sqrt(known))), 1e-9) if len(known) else 1.0
        for k, points in portions:
            weight = 1.0 / (1.0 + miss[k] / scale**2)
            weight[np.isnan(weight)] = 1.0
            rows = _rows(direction[:, k], centre[:, k], weight)
            sums[:, points] = np.add.reduceat(rows, first[points] - k.start, axis=1)
    return np.asarray(_solved(sums).T + origin)


def _portions(first: Index, count: int) -> list[tuple[slice, slice]]:
    """Return rays in portions of whole points that stay near the processor, and which points.

    Parameters
    ----------
    first
        (n,) first rays of the points.
    count
        How many rays there are.
    """
    cuts = np.searchsorted(first, np.arange(0, count, _AT_ONCE)).tolist()
    starts = [*first.tolist(), count]
    every = pairwise(dict.fromkeys((*cuts, len(first))))
    return [(slice(starts[a], starts[b]), slice(a, b)) for a, b in every]


def _rows(direction: Array, centre: Array, weight: Array) -> Array:
    """(9, n) upper triangles of I - d d', and right sides, times the weights of n rays.

    `direction`, `centre`: (3, n) d, and where the rays begin.
    """
    rows, against = np.empty((9, len(weight))), direction * -weight
    for row, (i, j) in zip(rows, _UPPER, strict=False):
        np.multiply(against[i], direction[j], out=row)
        if i == j:
            row += weight
    np.multiply(against, np.einsum("in,in->n", direction, centre), out=rows[6:])
    rows[6:] += centre * weight
    return rows


def _solved(sums: Array) -> Array:
    """(3, n) where rays meet, of (9, n) upper triangles and right sides; NaN where parallel."""
    xx, xy, xz, yy, yz, zz, *right = sums
    # cofactors: the matrix is symmetric, and so is its inverse
    a, b, c = yy * zz - yz**2, xz * yz - xy * zz, xy * yz - xz * yy
    d, e, f = xx * zz - xz**2, xy * xz - xx * yz, xx * yy - xy**2
    size = xx * a + xy * b + xz * c
    inverse = ((a, b, c), (b, d, e), (c, e, f))
    with np.errstate(invalid="ignore", divide="ignore"):
        out = np.stack([(i * right[0] + j * right[1] + k * right[2]) / size for i, j, k in inverse])
    # the two larger eigenvalues multiply to a quarter of the trace's square at most
    narrow = np.flatnonzero(~(4.0 * size > _NARROW * (xx + yy + zz) ** 3))
    if len(narrow):
        matrix = sums[[0, 1, 2, 1, 3, 4, 2, 4, 5]][:, narrow].T.reshape(-1, 3, 3)
        values = np.linalg.eigvalsh(matrix)
        good = (values[:, 0] > _PARALLEL * values[:, 2]) & (values[:, 2] > 0.0)
        out[:, narrow] = np.nan
        there = narrow[good]
        out[:, there] = np.linalg.solve(matrix[good], sums[6:, there].T[:, :, None])[:, :, 0].T
    return out
