"""One measured image point, a row for people and scripts, and many of them made at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, fields
from itertools import repeat
from operator import attrgetter
from typing import Any, Literal, cast

__all__ = ["ImagePoint", "Use", "image_points", "unchanged_ends", "use_counts"]

_STEP = 512  # rows that are compared at a time
_FILED = attrgetter("measured")

Use = Literal["xy", "x", "y", "off"]
"""Which coordinates of an image point count."""


def use_counts(use: Use, axis: str) -> bool:
    """Return whether a coordinate, "x" or "y", counts under a use."""
    return use != "off" and axis in use


@dataclass(frozen=True, slots=True)
class ImagePoint:
    """One measured image point.

    Attributes
    ----------
    photo, point
        Names.
    x, y
        Image coordinates [mm], ideal ones: where the camera has a lens, it is taken off.
    sigma_um
        A-priori standard deviation [um] of either coordinate, or None for the block's default.
    model
        "left/right" of the model that lay in the instrument, or None.
    use
        Which of its coordinates count: "xy", "x", "y" or "off".
    reason
        Why, in the words of the person who decided; or None.
    measured
        What stands in the file instead of x, y, where pixels or a lens are between: it is written
        again as it was read, and nothing is computed from it.
    """

    photo: str
    point: str
    x: float
    y: float
    sigma_um: float | None = None
    model: str | None = None
    use: Use = "xy"
    reason: str | None = None
    measured: tuple[float, float] | None = field(default=None, compare=False)

    def counts(self, axis: str) -> bool:
        """Return whether a coordinate, "x" or "y", counts."""
        return use_counts(self.use, axis)

    def use_without(self, axes: Collection[str]) -> Use:
        """Return which of its coordinates count when those of some axes do not."""
        left = "".join(axis for axis in "xy" if self.counts(axis) and axis not in axes)
        return cast("Use", left or "off")


_PUT = tuple(ImagePoint.__dict__[each.name].__set__ for each in fields(ImagePoint))


def image_points(*columns: Sequence[Any]) -> tuple[ImagePoint, ...]:
    """Return image points of whole columns, one for each attribute of `ImagePoint`, in order.

    Column by column, as making each by itself takes more than twice the time.
    """
    if len({len(column) for column in columns}) != 1:
        raise ValueError("columns of different lengths")
    rows = tuple(map(object.__new__, repeat(ImagePoint, len(columns[0]))))
    for put, column in zip(_PUT, columns, strict=True):
        deque(map(put, rows, column), maxlen=0)
    return rows


def unchanged_ends(
    old: Sequence[ImagePoint], new: Sequence[ImagePoint], *, measured: bool = False
) -> tuple[int, int]:
    """Return how many rows at the beginning, and of the others at the end, are as they were.

    Parameters
    ----------
    old, new
        The rows; the same objects are not looked into.
    measured
        Whether what stands in the file counts, which is no part of what makes rows equal.
    """
    first = _unchanged(old, new, measured)
    return first, _unchanged(old[first:][::-1], new[first:][::-1], measured)


def _unchanged(old: Sequence[ImagePoint], new: Sequence[ImagePoint], measured: bool) -> int:
    """Return how many rows at the beginning are as they were."""
    count, most = 0, min(len(old), len(new))
    for step in (_STEP, 1):
        while count < most:
            ours, theirs = new[count : count + step], old[count : count + step]
            if ours != theirs or (
                measured and list(map(_FILED, ours)) != list(map(_FILED, theirs))
            ):
                break
            count += step
    return min(count, most)
