"""A movement that is given: what displacements between epochs are tested against."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["GivenMovement"]


class GivenMovement(NamedTuple):
    """How a point is said to have moved from one epoch to the next that it is in.

    Attributes
    ----------
    point
        Name.
    first, second
        Numbers of the epochs, from 1; None: of two epochs the one and the other.
    d
        Movement in X, Y, Z [m].
    where
        File and line, or how else messages name it.
    """

    point: str
    first: int | None
    second: int | None
    d: tuple[float, float, float]
    where: str
