"""The papers' rules of thumb: how reliable a block should be, and in how many photos its points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.sorting import each_pair

__all__ = ["LEAST_PHOTOS", "LEAST_RI", "RulesOfThumb", "rules_of_thumb"]

LEAST_RI = 0.6
"""Of x and of y (Gruen 1978: "at least equal or even greater than 0.6")."""
LEAST_PHOTOS = 4
"""That see a new point (Gruen 1980: "at least fourfold photo coverage")."""


class RulesOfThumb(NamedTuple):
    """How a block stands to the rules.

    Attributes
    ----------
    ri_x, ri_y
        Whether the mean redundancy number of the image coordinates x, y is at least `LEAST_RI`.
    new
        How many points are new: no control.
    in_fewer
        How many of them are measured in fewer than `LEAST_PHOTOS` photos.
    """

    ri_x: bool
    ri_y: bool
    new: int
    in_fewer: int

    @property
    def reliable(self) -> bool:
        """Whether the rule of 1978 is met."""
        return self.ri_x and self.ri_y

    @property
    def covered(self) -> bool | None:
        """Whether the rule of 1980 is met; None without a new point."""
        return self.in_fewer == 0 if self.new else None


def rules_of_thumb(block: AdjustedBlock) -> RulesOfThumb:
    """Return how an adjusted block stands to the rules (Gruen 1978, 1980).

    What is rejected counts nowhere; a photo that measures a point twice counts once.
    """
    problem, indicators = block.problem, block.indicators()
    counts = ~block.rejected.all(axis=1)
    points, _ = each_pair(problem.point[counts], problem.photo[counts])
    photos = np.bincount(points, minlength=len(problem.points))
    rows = problem.control_rows
    control = {name for name, row in rows.items() if row.use == "control"}
    new = np.array([point not in control for point in problem.points], dtype=bool)
    return RulesOfThumb(
        indicators.ri_x >= LEAST_RI,
        indicators.ri_y >= LEAST_RI,
        int(new.sum()),
        int((photos[new] < LEAST_PHOTOS).sum()),
    )
