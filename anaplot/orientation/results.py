"""What one oriented model returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.leastsquares import MadeAgain
from anaplot.adjustment.tested import Observation, Partner, Tested, TestedInMicrometres, Transfer
from anaplot.aliases import Array, Axis
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.tieerrors import ExactStatistics
from anaplot.photogrammetry.block import TieVariance

__all__ = [
    "TOO_LARGE",
    "Diagnosis",
    "Exchanged",
    "Interchange",
    "ModelPoint",
    "ModelSolution",
    "Row",
]

TOO_LARGE = 3.0
"""Times the a-priori sigma0: a test that estimates sigma0 may hide errors behind one as large."""
Row = tuple[str, Axis]
"""A pseudo-observation of a model: y of a point, or x of a tie."""
Exchanged = Literal["left", "right", "both"]
"""In which of a model's photos the records of two points are exchanged."""


class ModelPoint(NamedTuple):
    """A point's model coordinates [mm] in the strip system."""

    point: str
    X: float
    Y: float
    Z: float


@dataclass(frozen=True, eq=False)
class ModelSolution(MadeAgain, TestedInMicrometres[Row]):
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
    iterations
        Count.
    tested
        The pseudo-observations [um]: all y, then all x, in the order of the left photo's points.
        Residuals are the parallaxes left: + r times an error of the row. Q_vv is in image units.
    names
        The n points of the model.
    ties
        Names of the tie points used.
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
    unknowns
        Names of the unknowns.
    of_coordinates, of_design, of_unknowns, of_points
        Compute the (3, n) `coordinates`, `condition`, `q_gg` and `q_points`, which the table does
        not ask for.
    exact
        What `tie_variance` "exact" adds; None otherwise. Q_vv is then S, and sigma0 by v'S+v.
    off_rows
        The rows that are switched off: the parallax that they would have with this orientation,
        NaN where there is none.
    measured
        Names of all points measured, also of those switched off, in the order of the left photo.
    pair
        What it was computed from; None where that is not known.
    """

    left: str
    right: str
    centre: tuple[float, float, float]
    base: tuple[float, float, float]
    rotation: tuple[float, float, float]
    iterations: int
    tested: Tested[Row]
    names: tuple[str, ...]
    ties: tuple[str, ...]
    apriori_um: float
    tie_variance: TieVariance
    outliers: tuple[str, ...]
    remarks: tuple[str, ...]
    q_l: Array = field(repr=False)
    unknowns: tuple[str, ...]
    of_coordinates: Callable[[], Array] = field(repr=False)
    of_design: Callable[[], float] = field(repr=False)
    of_unknowns: Callable[[], Array] = field(repr=False)
    of_points: Callable[[], Array] = field(repr=False)
    exact: ExactStatistics | None = field(default=None, repr=False)
    off_rows: tuple[Observation[Row], ...] = ()
    measured: tuple[str, ...] = ()
    pair: Stereopair | None = field(default=None, repr=False)

    @property
    def name(self) -> str:
        """'left/right'."""
        return f"{self.left}/{self.right}"

    @cached_property
    def coordinates(self) -> Array:
        """(3, n) model coordinates [mm] of the model's points."""
        return self.of_coordinates()

    @cached_property
    def points(self) -> tuple[ModelPoint, ...]:
        """Model coordinates of every point of the model."""
        rows = zip(self.names, *self.coordinates.tolist(), strict=True)
        return tuple(map(ModelPoint._make, rows))

    @cached_property
    def condition(self) -> float:
        """Condition number of the design matrix, columns scaled to unit length."""
        return self.of_design()

    @cached_property
    def q_gg(self) -> Array:
        """(u, u) cofactors of the unknowns in the order of `unknowns`."""
        return self.of_unknowns()

    @cached_property
    def q_points(self) -> Array:
        """(n, 3, 3) cofactors of the model coordinates of `points` [mm^2 / mm^2].

        The left photo is held; under "exact" with what the ties bring along, else as if they were
        free of error.
        """
        return self.of_points()

    @cached_property
    def table(self) -> tuple[Observation[Row], ...]:
        """The tested rows."""
        return tuple(self.tested)

    @cached_property
    def listed(self) -> tuple[Observation[Row], ...]:
        """The tested rows and, in their places, those that are switched off."""
        if not self.off_rows:
            return self.table
        rows = {row.key: row for row in (*self.table, *self.off_rows)}
        axes: tuple[Axis, ...] = ("y", "x")
        keys = ((point, axis) for axis in axes for point in self.measured)
        return tuple(rows[key] for key in keys if key in rows)

    @property
    def q_vv(self) -> Array:
        """(n, n) cofactors of the residuals, image units, in the order of the table."""
        return self.tested.q_vv

    @property
    def flagged(self) -> tuple[Observation[Row], ...]:
        """The rows whose significance exceeds the critical value."""
        return tuple(self.tested.rows(np.flatnonzero(self.tested.flagged)))

    @property
    def unexplained(self) -> str:
        """That sigma0 is `TOO_LARGE` while no row is flagged, in words; "" where it is not."""
        sigma0 = self.sigma0_um
        if sigma0 is None or sigma0 <= TOO_LARGE * self.apriori_um or self.tested.flagged.any():
            return ""
        return f"sigma0 is {sigma0 / self.apriori_um:.0f} times its a-priori value"


class Interchange(NamedTuple):
    """Two points whose records are exchanged.

    Attributes
    ----------
    points
        The two names, in the order of the left photo.
    photo
        The photo in which they are; "" for either: only ties tell the photos apart, and where
        both are exchanged it may as well have been in the preceding model.
    exchanged
        With which of the photos exchanged all points agree; "right" also stands for "left" where
        only `photo` could tell them apart.
    """

    points: tuple[str, str]
    photo: str = ""
    exchanged: Exchanged = "right"

    @property
    def text(self) -> str:
        """One sentence."""
        first, second = self.points
        where = f" in photo {self.photo}" if self.photo else ""
        return f"{first} and {second} interchanged{where}? With the two exchanged all points agree"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What the operator is told beyond the table.

    Attributes
    ----------
    transfers, partners
        Critical and serious transfers, and rows hard to tell apart.
    advice
        Sentences: what to do next, the most useful first.
    suspects
        (point, axis) of flagged rows, the most probable first; under "exact" also of rows that
        are not flagged but may be why others are. Where two points are interchanged, their rows
        come first; where sigma0 is `TOO_LARGE`, rows without which all others agree.
    interchange
        Two points whose records are exchanged, or None.
    chances, none
        Probability of each row of the table that it holds the one gross error, and that there is
        none, as the advice weighs them: under "exact" by Sigma_F^-1, else those of the table.
    """

    transfers: tuple[Transfer[Row], ...]
    partners: tuple[Partner[Row], ...]
    advice: tuple[str, ...]
    suspects: tuple[Row, ...]
    interchange: Interchange | None = None
    chances: tuple[float, ...] = ()
    none: float = 0.0
