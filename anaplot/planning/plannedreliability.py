"""Reliability of a planned point or photo: redundancy numbers and weakest observation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Axis
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.rows import RayRow

__all__ = ["PlannedReliability", "photo_reliability", "point_reliability"]


class PlannedReliability(NamedTuple):
    """A point or a photo, and the weakest of its observations.

    Attributes
    ----------
    name
        Of the point, or of the photo.
    rays
        How many rays it has.
    mean_r, low_r
        Mean and smallest redundancy number.
    weakest
        Photo of the weakest observation of a point; point of that of a photo.
    axis
        Its axis.
    mdb_um
        Its smallest detectable error [um]; None when nothing checks it.
    s_xyz
        Expected standard deviations of a point [m]; None for a photo.
    """

    name: str
    rays: int
    mean_r: float
    low_r: float
    weakest: str
    axis: Axis
    mdb_um: float | None
    s_xyz: tuple[float | None, float | None, float | None] | None


def point_reliability(block: AdjustedBlock) -> tuple[PlannedReliability, ...]:
    """Return every adjusted point, the one with the weakest observation first."""
    deviations = {row.point: row.s_xyz for row in block.point_rows()}
    of: dict[str, list[RayRow]] = {}
    for row in block.ray_rows():
        of.setdefault(row.point, []).append(row)
    return _sorted(
        _reliability(point, rows, [row.photo for row in rows], deviations[point])
        for point, rows in of.items()
    )


def photo_reliability(block: AdjustedBlock) -> tuple[PlannedReliability, ...]:
    """Return every photo, the one with the weakest observation first."""
    of: dict[str, list[RayRow]] = {}
    for row in block.ray_rows():
        of.setdefault(row.photo, []).append(row)
    return _sorted(
        _reliability(photo, rows, [row.point for row in rows], None) for photo, rows in of.items()
    )


def _reliability(
    name: str,
    rows: list[RayRow],
    others: list[str],
    s_xyz: tuple[float | None, float | None, float | None] | None,
) -> PlannedReliability:
    r = np.array([[one.r for one in row.xy] for row in rows])
    k, axis = np.unravel_index(int(r.argmin()), r.shape)
    return PlannedReliability(
        name,
        len(rows),
        float(r.mean()),
        max(float(r[k, axis]), 0.0),
        others[int(k)],
        "y" if axis else "x",
        rows[int(k)].xy[int(axis)].mdb,
        s_xyz,
    )


def _sorted(found: Iterable[PlannedReliability]) -> tuple[PlannedReliability, ...]:
    return tuple(sorted(found, key=lambda worth: round(worth.low_r, 9)))
