"""Results of an adjusted bundle, one row for each photo, point and observation."""

from __future__ import annotations

from typing import Literal, NamedTuple

__all__ = [
    "ControlRow",
    "Indicators",
    "ParameterRow",
    "PhotoRow",
    "PointRow",
    "PriorRow",
    "RayRow",
]


class RayRow(NamedTuple):
    """One measured image point; None where something does not exist.

    Attributes
    ----------
    row
        Its row in block.image_points.
    photo, point, model
        Names.
    residual
        Residuals of x and y [um], adjusted minus observed.
    r, w
        Redundancy numbers and standardized residuals.
    mdb
        Smallest detectable errors [um].
    effect_m
        What an undetected error of that size in x, and in y, does to the point: X, Y, Z [m].
    flagged
        Whether x or y exceeds the critical value.
    rejected
        Whether x, and y, have the weight zero; then v is what they are off from all the others.
    """

    row: int
    photo: str
    point: str
    model: str | None
    residual: tuple[float, float]
    r: tuple[float, float]
    w: tuple[float | None, float | None]
    mdb: tuple[float | None, float | None]
    effect_m: tuple[tuple[float, float, float] | None, tuple[float, float, float] | None]
    flagged: bool
    rejected: tuple[bool, bool] = (False, False)


class ControlRow(NamedTuple):
    """One weighted control coordinate."""

    point: str
    axis: Literal["X", "Y", "Z"]
    residual: float
    r: float
    w: float | None
    mdb: float | None
    effect_m: tuple[float, float, float] | None
    flagged: bool


class PriorRow(NamedTuple):
    """One prior of an orientation (m or rad) or of an additional parameter (mm)."""

    owner: str
    unknown: str
    residual: float
    r: float
    w: float | None
    mdb: float | None
    flagged: bool


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
