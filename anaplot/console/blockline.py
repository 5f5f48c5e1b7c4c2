"""The one line that the block is worth beside the model's advice."""

from __future__ import annotations

from anaplot.station.blockview import percent, unless_wrong
from anaplot.station.snapshot import Snapshot

__all__ = ["block_line"]


def block_line(snapshot: Snapshot) -> str:
    """Return what the block holds against a point of an earlier model, or ""."""
    view = snapshot.block_view
    if view is None:
        return ""
    current = f"{snapshot.left}/{snapshot.right}" if snapshot.left else ""
    points = view.of_earlier_models(current)
    if not points:
        return ""
    accused = points[0].accused
    where = f" (model {accused.model})" if accused.model is not None else ""
    more = f", and {len(points) - 1} more" if len(points) > 1 else ""
    chance = percent(accused.probability) + unless_wrong(view.unless(points[0]))
    return f"block: point {points[0].point} in photo {accused.photo}{where}: {chance}{more}"
