"""A part of a block whose photos are oriented in one system, and how such parts grow and join."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anaplot.aliases import Array, Bools, Index, Progress
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.resection import resect
from anaplot.photogrammetry.collinearity import project, turns
from anaplot.photogrammetry.similarity import Similarity, fit_similarity, line_of, robust_similarity

__all__ = ["RESECTING", "SubBlock", "intersect_rays", "rays_of_photos", "unit_rays"]


RESECTING = "resecting photos"
"""What is said of the progress of resections."""

_ALONG = 0.01  # share of the extent within which points on a line coincide
_ROUNDS = 6  # of weights when rays are intersected
_PARALLEL = 1e-10  # smallest over largest eigenvalue below which rays count as parallel


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
        found = robust_similarity(source, target)
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
        seen = project(
            self.centres[problem.photo],
            self.rotations[problem.photo],
            problem.c[problem.photo],
            self.points[problem.point],
        )
        size = np.linalg.norm(seen.xy - problem.ideal, axis=1)
        return np.where(seen.depth > 0.0, size, np.where(np.isfinite(size), np.inf, np.nan))


def _on_a_line(source: Array, target: Array) -> tuple[Similarity, Bools] | None:
    """Return a similarity of points on a line, anyhow turned about it; None where they differ."""
    extent = float(np.ptp(target, axis=0).max())
    if not extent > 0.0:
        return None
    similarity = fit_similarity(source, target)
    inliers = np.linalg.norm(similarity.apply(source) - target, axis=1) < _ALONG * extent
    return (similarity, inliers) if inliers.all() else None


def unit_rays(problem: Problem) -> Array:
    """Return (m, 3) rays of unit length in image axes."""
    rays = np.column_stack((problem.ideal, -problem.c[problem.photo]))
    out: Array = rays / np.linalg.norm(rays, axis=1)[:, None]
    return out


def rays_of_photos(problem: Problem) -> list[Index]:
    """Return the numbers of the rays of each photo."""
    order = np.argsort(problem.photo, kind="stable")
    ends = np.searchsorted(problem.photo[order], np.arange(1, len(problem.photos)))
    return np.split(order, ends)


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
    out[several] = _met(subblock, rays[use], photo, point)
    return out


def _met(subblock: SubBlock, rays: Array, photo: Index, point: Index) -> Array:
    """Intersect (m, 3) rays of points counted from 0; see `intersect_rays`."""
    count = int(point.max()) + 1
    direction = np.einsum("nij,nj->ni", subblock.rotations[photo], rays)
    centre = subblock.centres[photo]
    origin = np.nanmean(subblock.centres, axis=0)
    centre = centre - origin
    plane = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    toward = np.einsum("nij,nj->ni", plane, centre)
    weight = np.ones(len(rays))
    out = np.full((count, 3), np.nan)
    for _ in range(_ROUNDS):
        matrix = np.empty((count, 3, 3))
        right = np.empty((count, 3))
        for i in range(3):
            right[:, i] = np.bincount(point, weight * toward[:, i], minlength=count)
            for j in range(3):
                matrix[:, i, j] = np.bincount(point, weight * plane[:, i, j], minlength=count)
        values = np.linalg.eigvalsh(matrix)
        good = values[:, 0] > _PARALLEL * values[:, 2]
        good &= values[:, 2] > 0.0
        out[:] = np.nan
        out[good] = np.linalg.solve(matrix[good], right[good][:, :, None])[:, :, 0]
        away = out[point] - centre
        distance = np.linalg.norm(away, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            miss = np.linalg.norm(np.einsum("nij,nj->ni", plane, away), axis=1) / distance
            known = miss[np.isfinite(miss)]
            scale = max(3.0 * float(np.median(known)), 1e-9) if len(known) else 1.0
            weight = np.nan_to_num(1.0 / (1.0 + (miss / scale) ** 2), nan=1.0)
    out += origin
    return out
