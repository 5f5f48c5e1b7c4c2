"""Points of a bundle by their number of rays, next to each other, so that many are one array."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Index

__all__ = ["Group", "groups_by_rays"]


class Group(NamedTuple):
    """Points that have the same number of rays, next to each other.

    Attributes
    ----------
    rays
        Rays of each of its points.
    first_point, points
        Its points are first_point ... first_point + points - 1.
    first_ray
        Their rays begin here.
    """

    rays: int
    first_point: int
    points: int
    first_ray: int

    @property
    def point_slice(self) -> slice:
        """Of arrays over points."""
        return slice(self.first_point, self.first_point + self.points)

    @property
    def ray_slice(self) -> slice:
        """Of arrays over rays."""
        return slice(self.first_ray, self.first_ray + self.points * self.rays)


def groups_by_rays(count: Index) -> tuple[Group, ...]:
    """Group points that are already ordered by their number of rays."""
    groups = []
    first_point = first_ray = 0
    for rays, points in zip(*np.unique(count, return_counts=True), strict=True):
        groups.append(Group(int(rays), first_point, int(points), first_ray))
        first_point += int(points)
        first_ray += int(points) * int(rays)
    return tuple(groups)
