"""Points of an adjusted block by their names."""

from __future__ import annotations

from collections.abc import Sequence

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["point_numbers", "point_places"]


def point_numbers(block: AdjustedBlock, names: Sequence[str]) -> list[int]:
    """Return the numbers of points in the bundle; raises KeyError for one that takes no part."""
    at = {name: k for k, name in enumerate(block.problem.points)}
    return [at[name] for name in names]


def point_places(block: AdjustedBlock, names: Sequence[str], origin: Array | None = None) -> Array:
    """Return (m, 3) adjusted coordinates [m] of m points.

    Parameters
    ----------
    block, names
        The block, and points of it.
    origin
        (3,) [m] that coordinates are relative to; None: the ground system's. Places of two blocks
        are compared relative to the origin of one of them, or large coordinates round them.

    Raises
    ------
    KeyError
        As `point_numbers`.
    """
    from_there = block.state.origin if origin is None else block.state.origin - origin
    out: Array = block.state.points[point_numbers(block, names)] + from_there
    return out
