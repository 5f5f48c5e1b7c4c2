"""A live block that is changed measurement by measurement, as a person does it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from anaplot.bundle.live import LiveAnswer, LiveBlock
from anaplot.photogrammetry.block import ImagePoint


def added(live: LiveBlock, rows: Iterable[ImagePoint]) -> LiveAnswer:
    """Adjust with more image points; one of the same photo, point and model replaces the old."""
    merged = {(r.photo, r.point, r.model): r for r in (*live.block.image_points, *rows)}
    return live.update(replace(live.block, image_points=tuple(merged.values())))


def remeasured(live: LiveBlock, old: ImagePoint, x: float, y: float, progress=None) -> LiveAnswer:
    """Adjust with other coordinates [mm] of one image point."""
    rows = list(live.block.image_points)
    at = next(k for k, r in enumerate(rows) if (r.photo, r.point) == (old.photo, old.point))
    rows[at] = replace(rows[at], x=x, y=y)
    return live.update(replace(live.block, image_points=tuple(rows)), progress=progress)


def removed(live: LiveBlock, old: ImagePoint) -> LiveAnswer:
    """Adjust without the measurements of a point in a photo."""
    rows = (r for r in live.block.image_points if (r.photo, r.point) != (old.photo, old.point))
    return live.update(replace(live.block, image_points=tuple(rows)))


def flagged(answer: LiveAnswer) -> set[tuple[str, str, str]]:
    """The photo, point and axis of each flagged row."""
    return {(photo, point, axis) for _, photo, point, axis in answer.adjusted.suspects()}
