"""What inner orientation returns: rows that carry everything said of one measured coordinate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from anaplot.adjustment.reliability import HARD_TO_TELL, AppliedTest
from anaplot.aliases import Array, Axis
from anaplot.photogrammetry.platetransformation import Placement, PlateTransformation

__all__ = [
    "HARD_TO_TELL",
    "AppliedTest",
    "DistanceRow",
    "InnerOrientation",
    "InnerPartner",
    "InnerRow",
]


_INSEPARABLE = 1.0 - 1e-4


class InnerRow(NamedTuple):
    """One coordinate of one measured fiducial.

    Attributes
    ----------
    fiducial, axis
        Name, and "x" or "y" along the image's axes.
    r
        Redundancy number r_i.
    residual
        Residual [um in the image], adjusted minus measured: - r_i times an error of the row.
    expected
        Its expected standard deviation [um]; None when sigma does not exist.
    w
        Standardized residual; None when the row cannot be tested.
    flagged
        Whether w exceeds the critical value.
    mdb
        Smallest detectable error [um], for the a-priori sigma0; None when it cannot be tested.
    probability
        Posterior probability that this row holds the one gross error.
    """

    fiducial: str
    axis: Axis
    r: float
    residual: float
    expected: float | None
    w: float | None
    flagged: bool
    mdb: float | None
    probability: float

    @property
    def key(self) -> tuple[str, Axis]:
        """(fiducial, axis), the row's identity."""
        return self.fiducial, self.axis


class DistanceRow(NamedTuple):
    """A calibrated distance: `difference_um` is the transformed minus the calibrated one [um]."""

    first: str
    second: str
    mm: float
    difference_um: float


class InnerPartner(NamedTuple):
    """Two rows whose residuals are correlated by 0.9 or more: hard to tell apart."""

    first: tuple[str, Axis]
    second: tuple[str, Axis]
    correlation: float


@dataclass(frozen=True, slots=True, eq=False)
class InnerOrientation:
    """The inner orientation of one photograph.

    Attributes
    ----------
    camera
        Name of the camera.
    transformation
        Plate to image (the camera's fiducial system), and back.
    placement
        How the photograph lies on the plate.
    sigma0_um
        Estimated sigma0 [um]; None without redundancy.
    apriori_um
        A-priori sigma0 [um] of a measured plate coordinate.
    redundancy, iterations
        Counts.
    test
        The test that flags rows.
    rows
        x and y of every fiducial in use, in the order of the certificate; rows switched off are
        left out.
    partners
        Rows hard to tell apart.
    distances
        Where only distances are known, each of those in use.
    unmeasured
        Fiducials of the certificate that are not measured.
    none
        Posterior probability that no row holds a gross error.
    power
        Power that the test really has against errors of the size `mdb`; None where there is no
        test.
    overall
        Critical value of sigma0_um by the test of the whole adjustment, same alpha (chi-square of
        the redundancy); None without redundancy.
    exchanged
        Two fiducials whose exchange would make a bad fit good: measured in the wrong order?
    remarks
        Sentences on how the transformation was chosen.
    q_vv
        (m, m) cofactors of the residuals, in the order of the m rows.
    """

    camera: str
    transformation: PlateTransformation
    placement: Placement
    sigma0_um: float | None
    apriori_um: float
    redundancy: int
    iterations: int
    test: AppliedTest
    rows: tuple[InnerRow, ...]
    partners: tuple[InnerPartner, ...]
    distances: tuple[DistanceRow, ...]
    unmeasured: tuple[str, ...]
    none: float
    power: float | None
    overall: float | None
    exchanged: tuple[str, str] | None
    remarks: tuple[str, ...]
    q_vv: Array = field(repr=False)

    @property
    def kind(self) -> str:
        """Name of the transformation."""
        return self.transformation.kind

    @property
    def flagged(self) -> tuple[InnerRow, ...]:
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
