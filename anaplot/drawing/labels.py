"""Names beside points, none over another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.drawing.frame import Frame

__all__ = ["Placed", "placed"]

_DIRECTIONS = np.array(
    # where a label stands as seen from its point: right, left, above, below, corners
    [(1, 0), (-1, 0), (0, -1), (0, 1), (1, -0.8), (-1, -0.8), (1, 0.8), (-1, 0.8)],
    dtype=float,
)
_MARK = 4.0  # half of what a mark is wide
_APART = 1.5  # between two labels


class Placed(NamedTuple):
    """A label that has found room.

    Attributes
    ----------
    which
        Its number.
    x, y
        Its left and upper side.
    """

    which: int
    x: float
    y: float


def placed(
    frame: Frame,
    at: Array,
    sizes: Array,
    *,
    gap: float = 7.0,
    obstacles: Array | None = None,
    boxes: Array | None = None,
    most: int,
    towards: Array | None = None,
) -> list[Placed]:
    """Return which labels have room, the first ones first.

    Parameters
    ----------
    frame
        They stay within it.
    at
        (n, 2) places of their points in the drawing, the most important first.
    sizes
        (n, 2) widths and heights.
    gap
        Between point and label.
    obstacles
        (k, 2) places of marks that are not to be covered, besides `at`.
    boxes
        (m, 4) what else is not to be covered, other labels: left, upper, right and lower sides.
    most
        How many labels are tried.
    towards
        (n, 2) directions in which each stands rather than elsewhere; None: to the right.
    """
    marks = at if obstacles is None else np.vstack((at, obstacles))
    taken = np.hstack((marks - _MARK, marks + _MARK))
    if boxes is not None:
        taken = np.vstack((taken, boxes))
    low_side = np.array([frame.left + 2.0, frame.top + 2.0])
    high_side = np.array([frame.right - 2.0, frame.bottom - 2.0])
    found: list[Placed] = []
    for k in range(min(len(at), most)):
        half = sizes[k] / 2.0
        directions = _DIRECTIONS
        if towards is not None:
            directions = directions[np.argsort(-directions @ towards[k], kind="stable")]
        middle = at[k] + directions * (gap + half)
        low, high = middle - half, middle + half
        inside = ((low >= low_side) & (high <= high_side)).all(axis=1)
        over = (
            (taken[:, 0] < high[:, :1])
            & (taken[:, 2] > low[:, :1])
            & (taken[:, 1] < high[:, 1:])
            & (taken[:, 3] > low[:, 1:])
        ).any(axis=1)
        free = np.flatnonzero(inside & ~over)
        if len(free):
            x, y = low[free[0]].tolist()
            box = np.hstack((low[free[0]] - _APART, high[free[0]] + _APART))
            taken = np.vstack((taken, box))
            found.append(Placed(k, x, y))
    return found
