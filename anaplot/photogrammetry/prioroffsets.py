"""What the stated positions or angles of several photos may have in common beside their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["BoresightScope", "OffsetScope", "PriorOffsets"]

OffsetScope = Literal["block", "strip"]
BoresightScope = Literal["block", "camera"]

_Three = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class PriorOffsets:
    """Which unknowns stated positions and angles share, beside the orientations themselves.

    Attributes
    ----------
    shift, drift
        Whether stated positions are off by the same [m], and by what grows with the time, all of a
        strip or all of the block; None: they are not.
    boresight
        Whether stated angles are those of an instrument that is turned against the camera, the same
        for all photos of a camera or of the block; None: they are the camera's own.
    shift_sigma, drift_sigma, boresight_sigma
        A-priori standard deviations in X, Y, Z [m; m/s, without times m a photo], and of the three
        angles [rad]; None: free.
    """

    shift: OffsetScope | None = None
    drift: OffsetScope | None = None
    boresight: BoresightScope | None = None
    shift_sigma: _Three | None = None
    drift_sigma: _Three | None = None
    boresight_sigma: _Three | None = None

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return any(one is not None for one in (self.shift, self.drift, self.boresight))
