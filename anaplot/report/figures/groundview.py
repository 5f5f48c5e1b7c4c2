"""A block as it is looked at: from above, or from where its photos look."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.photochecks import photo_formats
from anaplot.drawing.frame import Frame, equal_frame
from anaplot.drawing.plot import Head
from anaplot.photogrammetry.overlap import footprints

__all__ = ["GroundView", "PointView", "ground_view", "near_ones"]

_LEVEL = 0.35  # vertical part of the mean viewing direction below which a block is looked at
_TOGETHER = 0.5  # length of the mean viewing direction above which photos look one way
_TAIL, _REACH = 0.02, 1.5  # quantile, and extents between them within which points are near
_WIDEST = 3.0  # heights above ground: a side of a photo is no longer on the ground


def near_ones(at: Array) -> Bools:
    """Return (n,) which of (n, 2) places are not so far away that nothing else would be seen."""
    if len(at) < 5:
        return np.ones(len(at), dtype=bool)
    low, high = np.quantile(at, [_TAIL, 1.0 - _TAIL], axis=0)
    room = _REACH * np.maximum(high - low, 1e-9 * np.abs(at).max())
    near = ((at >= low - room) & (at <= high + room)).all(axis=1)
    return np.asarray(near)


@dataclass(frozen=True)
class PointView:
    """The points of a block on a drawing.

    Attributes
    ----------
    at
        (p, 2) coordinates [m] along the axes of the drawing, in the order of `Problem.points`.
    axes
        Which of X, Y, Z they are.
    """

    at: Array
    axes: tuple[int, int]

    @property
    def titles(self) -> tuple[str, str]:
        """What stands along the axes."""
        first, second = ("XYZ"[k] for k in self.axes)
        return f"{first} [m]", f"{second} [m]"

    @cached_property
    def near(self) -> Bools:
        """(p,) which points are drawn."""
        return near_ones(self.at)

    def of(self, vectors: Array) -> Array:
        """Return (n, 2) components of (n, 3) vectors along the axes."""
        return vectors[:, list(self.axes)]

    def of_covariances(self, covariances: Array) -> Array:
        """Return (n, 2, 2) parts of (n, 3, 3) covariances."""
        return covariances[:, list(self.axes)][:, :, list(self.axes)]

    def frame(self, head: Head, *more: Array) -> Frame:
        """Return a frame that holds the points that are near, and (k, 2) places more."""
        return equal_frame(head.bottom, np.vstack((self.at[self.near], *more)))

    @property
    def far_note(self) -> tuple[str, ...]:
        """What is said of points that are not drawn."""
        far = int(np.count_nonzero(~self.near))
        if not far:
            return ()
        return (f"{far} points lie so far from all others that they are not drawn.",)


@dataclass(frozen=True)
class GroundView(PointView):
    """A block on a drawing.

    Attributes
    ----------
    block
        The adjusted block.
    centres
        (n, 2) projection centres [m].
    footprints
        (n, 4, 2) where the corners of the photos' formats lie at the height of their points [m];
        NaN where a corner looks past it, or the drawing does not look from above.
    """

    block: AdjustedBlock
    centres: Array
    footprints: Array

    @property
    def whole(self) -> Index:
        """Photos whose footprint lies on the ground."""
        return np.flatnonzero(np.isfinite(self.footprints).all(axis=(1, 2)))


def ground_view(block: AdjustedBlock) -> GroundView:
    """Return how a block is drawn: X to the right and Y up, of upright objects Z up."""
    state = block.state
    axes = _axes(state.rotations)
    points, centres = state.points + state.origin, state.centres + state.origin
    view = GroundView(
        points[:, list(axes)], axes, block, centres[:, list(axes)], np.empty((0, 4, 2))
    )
    return replace(view, footprints=_footprints(block) if axes == (0, 1) else _no(len(centres)))


def _no(n: int) -> Array:
    return np.full((n, 4, 2), np.nan)


def _axes(rotations: Array) -> tuple[int, int]:
    """Return the axes of the drawing: the photos' viewing directions decide."""
    mean = -rotations[:, :, 2].mean(axis=0)
    if np.linalg.norm(mean) < _TOGETHER or abs(mean[2]) > _LEVEL * np.linalg.norm(mean):
        return 0, 1
    return (0, 2) if abs(mean[1]) >= abs(mean[0]) else (1, 2)


def _footprints(block: AdjustedBlock) -> Array:
    """Return (n, 4, 2) corners of the photos at the mean height of their points [m]."""
    problem, state = block.problem, block.state
    n = len(problem.photos)
    count = np.maximum(np.bincount(problem.photo, minlength=n), 1)
    heights = state.points[problem.point, 2]
    ground = np.bincount(problem.photo, weights=heights, minlength=n) / count
    through = np.column_stack((state.centres[:, :2], ground))
    level = np.broadcast_to([0.0, 0.0, 1.0], (n, 3))
    corners = footprints(
        state.centres, state.rotations, problem.c, photo_formats(problem), through, level
    )
    reach = np.linalg.norm((corners - state.centres[:, None])[:, :, :2], axis=2)
    height = np.abs(ground - state.centres[:, 2])
    good = (reach < _WIDEST * height[:, None]).all(axis=1)
    return np.where(good[:, None, None], corners[:, :, :2] + state.origin[:2], np.nan)
