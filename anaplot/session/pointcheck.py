"""Whether image coordinates can be those of a point of a photo."""

from __future__ import annotations

from math import isfinite

from anaplot.photogrammetry.block import Block
from anaplot.session.refusal import EventRefusedError

__all__ = ["check_place"]


def check_place(block: Block, photo: str, point: str, x: float, y: float) -> None:
    """Check image coordinates [mm] against the photo's format.

    Raises
    ------
    EventRefusedError
        They lie outside it, or are none.
    """
    reach_x, reach_y = block.camera_of(photo).reach()
    if not (isfinite(x) and isfinite(y)) or abs(x) > reach_x or abs(y) > reach_y:
        raise EventRefusedError(f"point {point}: ({x:.3f}, {y:.3f}) lies outside photo {photo}")
