"""Sections of a block whose pixels have no size: lengths in images are in px there."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.drawing.drawing import Drawing
from anaplot.photogrammetry.block import Block
from anaplot.report.html.parts import (
    Captioned,
    Definitions,
    Facts,
    HtmlBlock,
    Section,
    with_blocks,
)
from anaplot.report.lengthunits import in_px, without_pixel_size

__all__ = ["sections_with_lengths_of"]


def sections_with_lengths_of(block: Block, sections: Iterable[Section]) -> tuple[Section, ...]:
    """Return sections that name the unit that lengths in the block's images have."""
    return with_blocks(sections, _block) if without_pixel_size(block) else tuple(sections)


def _block(block: HtmlBlock) -> HtmlBlock:
    if isinstance(block, Captioned):
        return Captioned(in_px(block.table), block.caption)
    if isinstance(block, Facts):
        return Facts(tuple((word, in_px(line)) for word, line in block.items))
    if isinstance(block, Drawing | Definitions | Section):
        return block
    return in_px(block)
