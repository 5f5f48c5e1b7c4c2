"""What one oriented model returns: rows that carry everything said of one pseudo-observation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.reliability import AppliedTest
from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array, Axis
from anaplot.orientation.tieerrors import ExactStatistics
from anaplot.photogrammetry.block import TieVariance

__all__ = [
    "AppliedTest",
    "Diagnosis",
    "ModelPoint",
    "ModelSolution",
    "Partner",
    "RowDiagnosis",
    "TableRow",
    "Transfer",
]


class TableRow(NamedTuple):
    """One pseudo-observation of the model: y of a point, or x of a tie.

    Attributes
    ----------
    point, axis
        Name of the point, "y" or "x".
    r
        Redundancy number r_i.
    residual
        Parallax left at the point [um].
    expected
        Its expected standard deviation [um]; None when sigma does not exist.
    w
        Standardized residual; None when the row cannot be tested.
    flagged
        Whether w exceeds the critical value.
    """

    point: str
    axis: Axis
    r: float
    residual: float
    expected: float | None
    w: float | None
    flagged: bool

    @property
    def key(self) -> tuple[str, str]:
        """(point, axis), the row's identity."""
        return self.point, self.axis


class ModelPoint(NamedTuple):
    """A point's model coordinates [mm] in the strip system."""

    point: str
    X: float
    Y: float
    Z: float


@dataclass(frozen=True, slots=True, eq=False)
class ModelSolution:
    """One oriented model.

    Attributes
    ----------
    left, right
        Names of the photos.
    centre
        Projection centre of the left photo [mm] in the strip system.
    base
        bx, by, bz [mm] in the strip system.
    rotation
        omega, phi, kappa [rad] of the right photo in the strip system.
    sigma0_um
        Estimated sigma0 [um]; None without redundancy.
    redundancy, iterations
        Counts.
    test
        The test that flags rows.
    table
        One row per pseudo-observation: all y, then all x, in the order of the left photo's points.
    points
        Model coordinates of every point of the model.
    ties
        Names of the tie points used.
    condition
        Condition number of the design matrix, columns scaled to unit length.
    apriori_um
        A-priori sigma0 [um].
    tie_variance
        "paper", "propagated" or "exact".
    outliers
        Points without which all others agree, where they pull the orientation so far away that
        the table alone would mislead.
    remarks
        Sentences for the operator (badly spread points, no check at all, ...).
    q_l
        (n,) a-priori cofactors of the rows.
    q_vv
        (n, n) cofactors of the residuals, image units, in the order of the table.
    q_gg
        (u, u) cofactors of the unknowns in the order of `unknowns`.
    unknowns
        Names of the unknowns.
    exact
        What `tie_variance` "exact" adds; None otherwise. `q_vv` is then S, and sigma0 by v'S+v.
    """

    left: str
    right: str
    centre: tuple[float, float, float]
    base: tuple[float, float, float]
    rotation: tuple[float, float, float]
    sigma0_um: float | None
    redundancy: int
    iterations: int
    test: AppliedTest
    table: tuple[TableRow, ...]
    points: tuple[ModelPoint, ...]
    ties: tuple[str, ...]
    condition: float
    apriori_um: float
    tie_variance: TieVariance
    outliers: tuple[str, ...]
    remarks: tuple[str, ...]
    q_l: Array = field(repr=False)
    q_vv: Array = field(repr=False)
    q_gg: Array = field(repr=False)
    unknowns: tuple[str, ...]
    exact: ExactStatistics | None = field(default=None, repr=False)

    @property
    def name(self) -> str:
        """'left/right'."""
        return f"{self.left}/{self.right}"

    @property
    def influence(self) -> Array:
        """(n, n) Q_vv P: column i is what a unit error in row i does to every parallax."""
        return self.q_vv / self.q_l if self.exact is None else self.exact.influence

    @property
    def apparent_q_l(self) -> Array:
        """(n,) cofactors with which a row's residual has r times the row's variance.

        Those of the rows, but for "exact": q_vv / r, NaN where a row cannot be tested.
        """
        if self.exact is None:
            return self.q_l
        r = np.array([row.r for row in self.table])
        return np.diag(self.q_vv) / np.where(r >= TESTABLE, r, np.nan)

    @property
    def flagged(self) -> tuple[TableRow, ...]:
        """The rows whose significance exceeds the critical value."""
        return tuple(row for row in self.table if row.flagged)


class Transfer(NamedTuple):
    """A critical transfer: an error in `source` shows at least as large in `target`.

    `value` is the element (target, source) of Q_vv P in image units; rows are (point, axis).
    """

    source: tuple[str, str]
    target: tuple[str, str]
    value: float


class Partner(NamedTuple):
    """Two rows whose residuals are correlated by 0.9 or more: hard to tell apart."""

    first: tuple[str, str]
    second: tuple[str, str]
    correlation: float


class RowDiagnosis(NamedTuple):
    """What else is known of one row.

    Attributes
    ----------
    point, axis
        The row.
    mdb
        Smallest detectable error [um]; None when the row cannot be tested.
    probability
        Posterior probability that this row holds the one gross error.
    effect
        External reliability: largest effect of an undetected error of size `mdb` on any
        function of the unknowns, in standard deviations of that function; None when the row
        cannot be tested.
    """

    point: str
    axis: Axis
    mdb: float | None
    probability: float
    effect: float | None = None


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What the operator is told beyond the table.

    Attributes
    ----------
    rows
        In the order of the table.
    none
        Posterior probability that no row holds a gross error.
    transfers, partners
        Critical transfers, and rows hard to tell apart.
    advice
        Sentences: what to do next, the most useful first.
    suspects
        (point, axis) of flagged rows, the most probable first; under "exact" also of rows that
        are not flagged but may be why others are.
    power
        Power that the applied test really has against errors of the size `mdb`; under "tau"
        with few redundancies less than was asked. None where there is no test.
    """

    rows: tuple[RowDiagnosis, ...]
    none: float
    transfers: tuple[Transfer, ...]
    partners: tuple[Partner, ...]
    advice: tuple[str, ...]
    suspects: tuple[tuple[str, Axis], ...]
    power: float | None = None
