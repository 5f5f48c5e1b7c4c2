"""What is wrong with the numbering of a whole block, as `block_accidents` finds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from anaplot.session.accidents import Accident
    from anaplot.session.photoaccidents import PhotoAccident

__all__ = ["MOST_MEASUREMENTS", "NO_ACCIDENTS", "BlockAccidents", "FiledAccident"]

MOST_MEASUREMENTS = 1500
"""Points of models in a strip that is compared: every coordinate is an error of its own there."""


@dataclass(frozen=True, slots=True)
class FiledAccident:
    """What is wrong with a point, in which strip, and the last model of it that has the point."""

    strip: str
    model: str
    accident: Accident


@dataclass(frozen=True, slots=True)
class BlockAccidents:
    """What is wrong with points of a block.

    Attributes
    ----------
    found
        One for a point of a strip, strip after strip.
    unchecked
        Strips with more than `MOST_MEASUREMENTS`, in which nothing was looked for.
    photos
        What is wrong with photographs.
    """

    found: tuple[FiledAccident, ...] = ()
    unchecked: tuple[str, ...] = ()
    photos: tuple[PhotoAccident, ...] = ()

    @property
    def certain(self) -> tuple[FiledAccident, ...]:
        """Those of which it is certain that the point is the wrong one."""
        return tuple(one for one in self.found if one.accident.certain)


NO_ACCIDENTS = BlockAccidents()
