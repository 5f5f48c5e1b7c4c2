"""What a model is computed from: two photos' measurements and the strip before it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from anaplot.aliases import Array

__all__ = ["LeftPhoto", "Stereopair", "TieErrors"]


@dataclass(frozen=True, slots=True, eq=False)
class LeftPhoto:
    """The fixed left photo in the strip system.

    Attributes
    ----------
    centre
        (3,) projection centre [mm].
    rotation
        (3, 3) rotation from image to strip system.
    """

    centre: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, slots=True, eq=False)
class TieErrors:
    """How the points of a model err, as seen from its right photo; units of sigma0^2.

    Attributes
    ----------
    points
        n names.
    covariance
        (3n, 3n) C of their coordinates [mm^2 for a sigma0 of 1 mm]; NaN where a point has none.
    with_right
        (3n, 2n) D, covariance with the coordinates of their right rays.
    """

    points: tuple[str, ...]
    covariance: Array = field(repr=False)
    with_right: Array = field(repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class Stereopair:
    """The measurements of one model.

    Attributes
    ----------
    left, right
        Names of the photos.
    points
        n names, in the order of the left photo's points.
    xl, xr
        (n, 2) image coordinates [mm] in the left and the right photo.
    c_left, c_right
        Camera constants [mm].
    fixed
        The left photo in the strip system.
    ties
        Model coordinates [mm] from the preceding model, by point; None for a strip's first model.
    preceding_bx
        bx of the preceding model [mm]; None for a first model.
    base
        Nominal magnitude of a first model's bx [mm]; None for the mean x-parallax.
    off
        Rows (point, axis) switched off by the operator.
    tie_errors
        How the preceding model's points err; None where it was not asked for.
    once
        Points whose left ray is the preceding model's right one: measured once for both.
    aside
        Every point measured in it, also those switched off altogether, with all rows off but those
        that were switched off here; None where nothing was.
    """

    left: str
    right: str
    points: tuple[str, ...]
    xl: Array
    xr: Array
    c_left: float
    c_right: float
    fixed: LeftPhoto = field(default_factory=LeftPhoto)
    ties: Mapping[str, tuple[float, float, float]] | None = None
    preceding_bx: float | None = None
    base: float | None = None
    off: frozenset[tuple[str, str]] = frozenset()
    tie_errors: TieErrors | None = None
    once: frozenset[str] = frozenset()
    aside: Stereopair | None = field(default=None, repr=False)

    @property
    def name(self) -> str:
        """'left/right'."""
        return f"{self.left}/{self.right}"
