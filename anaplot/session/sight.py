"""Points known from elsewhere as two photos see them, by the similarity to their system."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from math import isfinite
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.orientation.stripgeometry import Located, Pose, imaged, in_photo
from anaplot.orientation.striptie import StripTie, System
from anaplot.photogrammetry.collinearity import project

__all__ = ["Carried", "Close", "Place", "Poses", "Sight", "in_view"]

Place = tuple[float, float, float, float]
"""xl, yl, xr, yr [mm]."""


class Poses(NamedTuple):
    """Both photos, and (6, e) errors that only the right one has."""

    left: Pose
    right: Pose
    free: Array | None = None


class Close(NamedTuple):
    """What lies close to measured points: (m, 4) places, and how far in any coordinate [mm]."""

    measured: Array
    reach: float

    @classmethod
    def of(cls, measured: Iterable[Place], reach: float) -> Close:
        """Return what lies within reach of some places."""
        return cls(np.array(list(measured)).reshape(-1, 4), reach)

    def to(self, at: Place) -> bool:
        """Return whether a place is close to one of them."""
        return bool(self.are(np.array([at]))[0])

    def are(self, places: Array) -> Bools:
        """Return (n,) whether (n, 4) places are close to one of them; NaN is nowhere."""
        off = np.abs(places[:, None] - self.measured)
        close: Bools = np.any(np.all(off < self.reach, axis=2), axis=1)
        return close


class Sight(NamedTuple):
    """Points that one similarity places, in two photos.

    Attributes
    ----------
    source
        From where they are known.
    tie
        The similarity.
    names
        Points of its other system.
    own
        Points of this system, by name; they count more than those of the other one.
    poses
        The photos.
    sigma0
        A priori [mm].
    """

    source: str
    tie: StripTie
    names: list[str]
    own: Mapping[str, Located]
    poses: Poses
    sigma0: float

    def among(self, names: Set[str]) -> Sight:
        """Return it with some of its points only."""
        own = {p: at for p, at in self.own.items() if p in names}
        return self._replace(names=[p for p in self.names if p in names], own=own)

    def near(self, close: Close) -> list[str]:
        """Return the points that most probably lie close to others.

        That takes one sum of errors a point and photo; how certain it is, as `seen` tells, all.
        """
        probable = self.tie.probable
        names = [p for p in self.names if p not in self.own]
        xyz, off = self.tie.probably_placed(names)
        if self.own:
            of_own = [one.errors @ probable[: one.errors.shape[1]] for one in self.own.values()]
            xyz = np.concatenate((xyz, [one.xyz for one in self.own.values()]))
            off = np.concatenate((off, of_own))
        sides = []
        for pose in self.poses[:2]:
            moved = pose.errors @ probable[: pose.errors.shape[1]]
            at, errors = imaged(pose, moved[:, None], xyz, off[:, :, None])
            sides.append(at - errors[:, :, 0])
        good = close.are(np.concatenate(sides, axis=1))
        return [
            name
            for name, is_close in zip((*names, *self.own), good.tolist(), strict=True)
            if is_close
        ]

    def seen(self) -> Iterator[tuple[str, Place, float]]:
        """Yield name, place, and its standard deviation where it is largest [mm]."""
        tie, poses = self.tie, self.poses
        points = {**tie.placed(self.names), **self.own}
        if not points:
            return
        count = tie.count
        left, right = (
            in_photo(pose, list(points.values()), count, free)
            for pose, free in ((poses.left, None), (poses.right, poses.free))
        )
        values = np.concatenate((left[0], right[0]), axis=1)
        errors = np.concatenate((left[1], right[1]), axis=1)
        n = len(values)
        values, rest = tie.improved(values.ravel(), errors.reshape(4 * n, -1))
        sigma = self.sigma0 * np.sqrt(np.einsum("ke,ke->k", rest, rest)).reshape(n, 4).max(axis=1)
        for name, (xl, yl, xr, yr), s in zip(
            points, values.reshape(n, 4).tolist(), sigma.tolist(), strict=True
        ):
            if isfinite(xl + yl + xr + yr + s):
                yield name, (xl, yl, xr, yr), s


class Carried(NamedTuple):
    """The points of another system as a similarity carries them: names, and (n, 3) places."""

    names: tuple[str, ...]
    xyz: Array

    @classmethod
    def of(cls, tie: StripTie, other: System) -> Carried:
        """Return all of them."""
        places = np.array([one.xyz for one in other.points.values()]).reshape(-1, 3)
        return cls(tuple(other.points), tie.carried(places))


def in_view(carried: Carried, poses: Poses) -> list[str]:
    """Return those points that lie about in two photos."""
    xyz = carried.xyz
    n = len(xyz)
    good = np.ones(n, dtype=bool)
    for pose in poses[:2]:
        centres, turned = np.broadcast_to(pose.centre, (n, 3)), pose.rotation
        seen = project(centres, np.broadcast_to(turned, (n, 3, 3)), np.full(n, pose.c), xyz)
        # not far outside: what is known of a right photo may still be rough
        good &= (seen.depth > 0.0) & (np.abs(seen.xy) < pose.c).all(axis=1)
    return [carried.names[k] for k in np.flatnonzero(good).tolist()]
