"""Results of an adjusted bundle, one row for each photo, point and observation."""

from __future__ import annotations

from typing import NamedTuple

from anaplot.adjustment.tested import Observation
from anaplot.bundle.solve.laidoffsets import OffsetKind, OffsetUnit
from anaplot.bundle.solve.observations import ObservationName

__all__ = [
    "Indicators",
    "OffsetRow",
    "ParameterRow",
    "PhotoRow",
    "PointRow",
    "RayRow",
]


class RayRow(NamedTuple):
    """One measured image point.

    Attributes
    ----------
    row
        Its row in block.image_points.
    photo, point, model
        Names.
    xy
        Its two observations [um].
    """

    row: int
    photo: str
    point: str
    model: str | None
    xy: tuple[Observation[ObservationName], Observation[ObservationName]]

    @property
    def flagged(self) -> bool:
        """Whether x or y exceeds the critical value."""
        return any(one.flagged for one in self.xy)


class PhotoRow(NamedTuple):
    """An adjusted orientation: position [m], angles [rad] and their standard deviations."""

    photo: str
    position: tuple[float, float, float]
    angles: tuple[float, float, float]
    s_position: tuple[float | None, float | None, float | None]
    s_angles: tuple[float | None, float | None, float | None]


class PointRow(NamedTuple):
    """An adjusted point [m], its standard deviations and its number of rays."""

    point: str
    xyz: tuple[float, float, float]
    s_xyz: tuple[float | None, float | None, float | None]
    rays: int


class ParameterRow(NamedTuple):
    """An additional parameter [mm] and its standard deviation.

    Of a lens also the coefficient and its standard deviation, in the sense of
    `anaplot.photogrammetry.lens`: corrections of c, x0, y0 in mm, the others without a unit. None
    for sets that are no lens.
    """

    group: str
    name: str
    value: float
    s: float | None
    coefficient: float | None = None
    s_coefficient: float | None = None


class OffsetRow(NamedTuple):
    """What stated positions or angles of several photos have in common.

    Attributes
    ----------
    kind
        "shift", "drift" or "boresight".
    group
        The strip or camera, or "block".
    axis
        X, Y, Z, or of a boresight omega, phi, kappa.
    unit
        "m", "m/s", without times "m/photo", or "rad".
    value, s
        What is stated minus what is, and its standard deviation.
    since
        The time [s] from which a drift is counted; None without times, or no drift.
    """

    kind: OffsetKind
    group: str
    axis: str
    unit: OffsetUnit
    value: float
    s: float | None
    since: float | None = None


class Indicators(NamedTuple):
    """Global indicators of reliability and accuracy (Gruen 1978, eq. 25 and 26).

    RI: means of the redundancy numbers of x, y and both; None when there are no rays.
    AI: mean standard deviations of the points [m] for the a-priori sigma0.
    """

    ri_x: float
    ri_y: float
    ri: float
    ai_x: float
    ai_y: float
    ai_z: float
    ai: float
