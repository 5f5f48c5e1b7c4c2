"""Units of lengths in the image."""

from __future__ import annotations

from typing import NamedTuple

from anaplot.photogrammetry.block import Block
from anaplot.report.lengthunits import without_pixel_size

__all__ = ["ImageUnits", "image_units"]


class ImageUnits(NamedTuple):
    """How lengths in images are shown.

    Attributes
    ----------
    small
        Unit of what is um in a result: "µm", or "px" where pixels have no size.
    large
        Unit of image coordinates: "mm", or "px".
    of_mm
        Image coordinates in `large` for 1 mm.
    """

    small: str
    large: str
    of_mm: float


def image_units(block: Block) -> ImageUnits:
    """Return how lengths in a block's images are shown."""
    if without_pixel_size(block):
        return ImageUnits("px", "px", 1e3)
    return ImageUnits("µm", "mm", 1.0)
