"""Points of known coordinates tell how a file means its rotations: rays see them where they lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.block import Camera, ImagePoint
from anaplot.photogrammetry.collinearity import project

__all__ = ["Sight", "meant_order"]

XYZ = tuple[float, float, float]

_FEWEST = 3  # rays of known points
_NEAR = 0.05  # of the camera constant: what approximate orientations may miss by
_CLEAR = 2.0  # times as far by any other order


class Sight(NamedTuple):
    """What is seen of known points.

    Attributes
    ----------
    rays
        Image points; those that count, of known points in photos with a position, are looked at.
    camera_of
        The camera of every photo.
    positions
        Projection centres [m] by photo.
    points
        Known points [m].
    """

    rays: Sequence[ImagePoint]
    camera_of: Mapping[str, Camera]
    positions: Mapping[str, XYZ]
    points: Mapping[str, XYZ]


def meant_order(
    sight: Sight,
    rotations: Mapping[str, Mapping[str, Array]],
    *,
    stated: str | None,
    usual: str,
) -> tuple[str, str | None]:
    """Return which of several orders is meant.

    Parameters
    ----------
    sight
        Rays of known points.
    rotations
        (3, 3) rotations from image to ground by photo, for every order.
    stated
        The order that somebody states: it counts, whatever the points say.
    usual
        The order where nothing tells.

    Returns
    -------
    order
        One of `rotations`.
    why
        What the known points say, for people; None where they do not contradict what is stated.
    """
    rows = [
        row
        for row in sight.rays
        if row.use == "xy" and row.photo in sight.positions and row.point in sight.points
    ]
    if len(rows) < _FEWEST:
        return stated or usual, None if stated else "no known points tell it"
    c = np.array([sight.camera_of[row.photo].c for row in rows])
    missed = {order: _missed(sight, rows, c, turned) for order, turned in rotations.items()}
    best, second, *_ = sorted(missed, key=lambda order: missed[order])
    fits = missed[best] <= _NEAR * float(np.median(c))
    clear = fits and missed[second] > _CLEAR * missed[best]
    values = ", ".join(f"{order} {miss:.4g} mm" for order, miss in missed.items())
    said = f"{len(rows)} rays of known points miss by (median) {values}"
    if stated is not None:
        return stated, f"as stated, although {said}" if clear and best != stated else None
    return (best, said) if clear else (usual, f"not told by what is known: {said}")


def _missed(
    sight: Sight, rows: Sequence[ImagePoint], c: Array, turned: Mapping[str, Array]
) -> float:
    """Return the median distance [mm] of rays from where points lie; behind a photo it is inf."""
    with np.errstate(all="ignore"):  # coordinates of a file may be beyond all measure
        seen = project(
            np.array([sight.positions[row.photo] for row in rows]),
            np.array([turned[row.photo] for row in rows]),
            c,
            np.array([sight.points[row.point] for row in rows]),
        )
        away = np.hypot(*(seen.xy - [(row.x, row.y) for row in rows]).T)
    return float(np.median(np.where((seen.depth > 0.0) & np.isfinite(away), away, np.inf)))
