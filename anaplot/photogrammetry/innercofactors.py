"""How precisely an inner orientation carries a point from the plate into the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.generalform import general_form
from anaplot.photogrammetry.planar import as_points

__all__ = ["InnerCofactors"]


@dataclass(frozen=True, eq=False)
class InnerCofactors:
    """Cofactors of an inner orientation that coordinates of fiducials determine.

    Attributes
    ----------
    frame
        (2, 3) plate to the system of the adjustment.
    terms
        (10,) coefficients of the general form there.
    q
        (10, 10) their cofactors.
    """

    frame: Array
    terms: Array
    q: Array

    def of_points(self, plate: Array) -> Array:
        """Return (n, 2, 2) cofactors of the image coordinates of (n, 2) plate coordinates.

        For measured fiducials of unit weight: times the variance of a fiducial's coordinate
        they are the covariance that all points of the photo have from them.
        """
        at = as_points(plate) @ self.frame[:, 1:].T + self.frame[:, 0]
        _, _, by_terms = general_form(self.terms, at)
        carried: Array = by_terms @ self.q @ np.swapaxes(by_terms, 1, 2)
        return carried
