"""What inner orientation returns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.tested import Observation, Partner, Tested, TestedInMicrometres
from anaplot.aliases import Array, Axis
from anaplot.photogrammetry.innercofactors import InnerCofactors
from anaplot.photogrammetry.platetransformation import Placement, PlateTransformation

__all__ = ["DistanceRow", "Fiducial", "InnerOrientation"]

Fiducial = tuple[str, Axis]
"""A row of an inner orientation: name and axis."""

_INSEPARABLE = 1.0 - 1e-4


class DistanceRow(NamedTuple):
    """A calibrated distance: `difference_um` is the transformed minus the calibrated one [um]."""

    first: str
    second: str
    mm: float
    difference_um: float


@dataclass(frozen=True, eq=False)
class InnerOrientation(TestedInMicrometres[Fiducial]):
    """The inner orientation of one photograph.

    Attributes
    ----------
    camera
        Name of the camera.
    transformation
        Plate to image (the camera's fiducial system), and back.
    placement
        How the photograph lies on the plate.
    apriori_um
        A-priori sigma0 [um] of a measured plate coordinate.
    iterations
        Count.
    tested
        x and y of every fiducial in use [um], in the order of the certificate; rows switched off
        are left out.
    distances
        Where only distances are known, each of those in use.
    unmeasured
        Fiducials of the certificate that are not measured.
    overall
        Critical value of sigma0_um by the test of the whole adjustment, same alpha (chi-square of
        the redundancy); None without redundancy.
    exchanged
        Two fiducials whose exchange would make a bad fit good: measured in the wrong order?
    remarks
        Sentences on how the transformation was chosen.
    cofactors
        Of the transformation; None where only distances are known.
    """

    camera: str
    transformation: PlateTransformation
    placement: Placement
    apriori_um: float
    iterations: int
    tested: Tested[Fiducial]
    distances: tuple[DistanceRow, ...]
    unmeasured: tuple[str, ...]
    overall: float | None
    exchanged: tuple[str, str] | None
    remarks: tuple[str, ...]
    cofactors: InnerCofactors | None = None

    def carried_um(self, plate: Array) -> Array | None:
        """Return how precisely points are carried into the image: (n, 2) [um], or None.

        Standard deviations of image coordinates that come from the measured fiducials, for the
        a-priori sigma; None where only distances are known.

        Parameters
        ----------
        plate
            (n, 2) plate coordinates.
        """
        if self.cofactors is None:
            return None
        variances = np.diagonal(self.cofactors.of_points(plate), axis1=1, axis2=2)
        return np.asarray(self.apriori_um * np.sqrt(np.maximum(variances, 0.0)))

    @property
    def kind(self) -> str:
        """Name of the transformation."""
        return self.transformation.kind

    @cached_property
    def rows(self) -> tuple[Observation[Fiducial], ...]:
        """The tested rows."""
        return tuple(self.tested)

    @cached_property
    def partners(self) -> tuple[Partner[Fiducial], ...]:
        """Rows hard to tell apart."""
        return self.tested.partners()

    @property
    def flagged(self) -> tuple[Observation[Fiducial], ...]:
        """Rows whose significance exceeds the critical value, the most probably wrong first."""
        found = [row for row in self.rows if row.flagged]
        return tuple(sorted(found, key=lambda row: -row.probability))

    @property
    def refused(self) -> bool:
        """Whether the adjustment as a whole contradicts the a-priori sigma0."""
        return (
            self.sigma0_um is not None
            and self.overall is not None
            and self.sigma0_um > self.overall
        )

    @property
    def locatable(self) -> bool:
        """Whether one wrong coordinate can be told from the others.

        It cannot where every testable residual is the copy of another fiducial's but for sign and
        size: among four fiducials of an affine transformation, say.
        """
        tested = {row.key for row in self.rows if row.mdb is not None}
        copies = {
            key
            for p in self.partners
            if abs(p.correlation) >= _INSEPARABLE and p.first[0] != p.second[0]
            for key in (p.first, p.second)
        }
        return self.redundancy > 1 and not tested <= copies
