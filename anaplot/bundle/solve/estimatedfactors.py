"""Factors of stated standard deviations, where the variances of groups were estimated."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["EstimatedFactors"]


class EstimatedFactors(NamedTuple):
    """Estimated standard deviations over stated ones; those of image coordinates are ray by ray.

    Attributes
    ----------
    control, expected, position, rotation, additional
        Of weighted control, of priors of points, on positions, on rotations and on additional
        parameters; 1 where there are none, or where they are held.
    """

    control: float = 1.0
    expected: float = 1.0
    position: float = 1.0
    rotation: float = 1.0
    additional: float = 1.0
