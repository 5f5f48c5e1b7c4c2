"""With what a block is opened, as one types it."""

from __future__ import annotations

from anaplot.photogrammetry.block import Block

__all__ = ["ways_to_open"]


def ways_to_open(block: Block) -> str:
    """Return the options that connect an instrument; without any, `open` connects none.

    Parameters
    ----------
    block
        Which may name its instrument's profile.
    """
    profile = "" if block.measuring.profile is not None else "--profile NAME "
    return f"--simulate, or {profile}--port PORT"
