"""Points in clusters that few photos see: what they share of the photos' matrices is one product.

With the rays of a cluster's points in one array, a row for every unknown of its photos and three
columns for every point, the elimination of its points is Z Z', and what an inverse does to them is
Q Z. There is a zero wherever a photo does not see a point: the price of large products instead of
many small ones. Points are parted by where their photos are until smaller clusters cost no less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.runs import runs
from anaplot.bundle.solve.sorting import distinct

__all__ = ["Cluster", "PointSet", "point_sets"]

_MOST_POINTS = 256  # of a cluster, whatever it costs
_OWN_COST = 2e6  # of a cluster, in products of two numbers
_PLACING = 20.0  # cost of putting an element of its matrix into its place


@dataclass(frozen=True, slots=True, eq=False)
class PointSet:
    """Points near each other, and who sees them.

    Attributes
    ----------
    rays
        (r,) rays of its points.
    photos
        (f,) photos that see any of them; one that sees a point twice, as where it is measured in
        two models, stands there twice.
    photo, point
        (r,) of each ray, which of `photos` and which of its points it has.
    points
        How many points there are.
    """

    rays: Index
    photos: Index
    photo: Index
    point: Index
    points: int

    def together(self) -> tuple[Index, Index]:
        """Return the pairs of different ones of `photos` that see a point in common, both ways."""
        seen = np.zeros((len(self.photos), self.points), dtype=np.float32)
        seen[self.photo, self.point] = 1.0
        common = seen @ seen.T
        np.fill_diagonal(common, 0.0)
        first, second = np.nonzero(common)
        return first, second

    def laid_out(self, values: Array) -> Array:
        """Return (f d, 3 p) what belongs to rays and points of theirs, of (m, d, 3) of all rays."""
        out = np.zeros((len(self.photos), values.shape[1], self.points, 3))
        out[self.photo, :, self.point] = values[self.rays]
        return out.reshape(-1, 3 * self.points)

    def of_rays(self, laid: Array) -> Array:
        """Return (r, d, 3) of its rays what stands in such an array."""
        whole = laid.reshape(len(self.photos), -1, self.points, 3)
        out: Array = whole[self.photo, :, self.point]
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Points near each other, and the blocks of the photos' matrices that they have a part in.

    Attributes
    ----------
    of
        The points.
    row, column
        Of every block but those of single photos, which of its photos it belongs to.
    block
        Its number in the pattern.
    own
        (f,) numbers of the blocks of its photos themselves.
    twice
        Whether a block may stand there again, since a photo sees a point twice.
    """

    of: PointSet
    row: Index
    column: Index
    block: Index
    own: Index
    twice: bool

    def take(self, blocks: Array, values: Array, room: Array) -> None:
        """Take Z Z' off the blocks between photos; what a ray adds to its own photo is left out.

        Parameters
        ----------
        blocks
            (b, d, d) of the whole matrix.
        values
            (m, d, 3) Z of all rays.
        room
            At least (f d)^2 numbers, for the product: new memory would take as long as that.
        """
        f, d = len(self.of.photos), blocks.shape[1]
        tall = self.of.laid_out(values)
        product = room[: (f * d) ** 2].reshape(f * d, f * d)
        np.matmul(tall, tall.T, out=product)
        mine = product.reshape(f, d, f, d)[self.row, :, self.column]
        if self.twice:
            np.subtract.at(blocks, self.block, mine)
        else:
            blocks[self.block] -= mine

    def matrix_of(self, blocks: Array) -> Array:
        """Return the symmetric (f d, f d) matrix of blocks; zero where there is none."""
        f, d = len(self.of.photos), blocks.shape[1]
        mine = blocks[self.block]
        out = np.zeros((f, d, f, d))
        out[self.column, :, self.row] = mine.transpose(0, 2, 1)
        out[self.row, :, self.column] = mine
        out[np.arange(f), :, np.arange(f)] = blocks[self.own]
        return out.reshape(f * d, f * d)


def point_sets(problem: Problem, places: Array) -> list[PointSet]:
    """Return the points of a bundle in sets of which few photos see any.

    Parameters
    ----------
    problem
        The bundle.
    places
        (photos, 3) rough projection centres.
    """
    count = np.bincount(problem.point, minlength=len(problem.points))
    first = np.zeros(len(count), dtype=np.intp)
    for group in problem.groups:
        first[group.point_slice] = group.first_ray + group.rays * np.arange(group.points)
    sums = [np.bincount(problem.point, places[problem.photo, k], len(count)) for k in range(3)]
    middle = np.column_stack(sums) / np.maximum(count, 1)[:, None]

    again = _again(problem.photo * len(count) + problem.point)
    most = int(again.max(initial=0)) + 1
    seer = problem.photo * most + again

    def seers(points: Index) -> Index:
        return np.flatnonzero(np.bincount(seer[runs(first[points], count[points])]))

    def of(points: Index) -> PointSet:
        each = count[points]
        rays, mine = runs(first[points], each), seers(points)
        place = np.empty(most * len(places), dtype=np.intp)
        place[mine] = np.arange(len(mine))
        at = np.repeat(np.arange(len(points)), each)
        return PointSet(rays, mine // most, place[seer[rays]], at, len(points))

    def halves(points: Index) -> tuple[Index, Index]:
        at = middle[points]
        axis = int(np.argmax(np.ptp(at, axis=0)))
        order = points[np.argsort(at[:, axis], kind="stable")]
        half = len(points) // 2
        return order[:half], order[half:]

    def cost(points: Index) -> float:
        size = float(problem.per_photo * len(seers(points)))
        return _OWN_COST + size**2 * (3.0 * len(points) + _PLACING)

    waiting = [np.arange(len(count))] if len(count) else []
    found: list[PointSet] = []
    laid: list[tuple[Index, float]] = []
    while waiting:
        points = waiting.pop()
        if len(points) > _MOST_POINTS:
            waiting += halves(points)[::-1]
            continue
        laid.append((points, cost(points)))
        while laid:
            points, whole = laid.pop()
            if len(points) > 1 and whole > 2.0 * _OWN_COST:
                parts = [(part, cost(part)) for part in halves(points)]
                if sum(each for _, each in parts) < whole:
                    laid += parts[::-1]
                    continue
            found.append(of(points))
    return found


def _again(numbers: Index) -> Index:
    """Return how many times each number has stood before."""
    out = np.zeros(len(numbers), dtype=np.intp)
    if len(distinct(numbers)) == len(numbers):
        return out
    order = np.argsort(numbers, kind="stable")
    same = np.flatnonzero(np.diff(numbers[order]) == 0) + 1
    for k in same.tolist():  # hardly ever any
        out[order[k]] = out[order[k - 1]] + 1
    return out
