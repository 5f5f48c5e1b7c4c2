"""The block of the Bayesian paper: ten photos, 25 points, and no control but prior knowledge.

Two strips of five photos over rows 2 and 4 of a grid of 5 x 5 points, 60 and 30 % overlap at
1 : 10 000; photo k sees the columns k - 1 to k + 1 and three rows. 156 image coordinates
determine 135 unknowns only because every unknown has a prior variance. The paper does not print
its coordinates: heights and tilts are drawn once, within its limits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.reliability import residual_correlations
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.aliases import Array, Index
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.linearrows import image_design

__all__ = [
    "CORNERS",
    "C_MM",
    "SIGMA_MM",
    "BayesBlock",
    "BayesFacts",
    "BayesGeometry",
    "bayes_block",
    "bayes_geometry",
    "photo_name",
    "point_name",
]

Row = tuple[str, str, str]

SIGMA_MM = 0.005
C_MM = 150.0
CORNERS = (0, 4, 20, 24)
"""The points that are control in the second step."""
_HEIGHT = 1500.0
_SPACING = (920.0, 805.0)
_RELIEF = 30.0
_TILT_DEG = 2.0
_SHAPE = 3  # of the generator: the one realisation of heights and tilts that is used
_WEAK = 1e-3
_HIDDEN = 0.01
_INSEPARABLE = 0.99


class BayesGeometry(NamedTuple):
    """Where photos and points lie, and which photo sees which point.

    Attributes
    ----------
    centres, rotations
        (10, 3) [m] and (10, 3, 3), image to ground.
    points
        (25, 3) [m], row by row.
    rays
        (78, 2) photo and point.
    """

    centres: Array
    rotations: Array
    points: Array
    rays: Index


def photo_name(photo: int) -> str:
    """Return the name of a photo: its strip, then its number in it."""
    return f"{1 + photo // 5}{photo % 5 + 1:02d}"


def point_name(point: int) -> str:
    """Return the name of a point: its row, then its column."""
    return f"{1 + point // 5}{point % 5 + 1}"


@dataclass(frozen=True, slots=True)
class BayesFacts:
    """Redundancy and rank of the block before anything is measured.

    Attributes
    ----------
    observations, unknowns
        n and u.
    rank
        Of the image coordinates alone, no priors: u less the seven of the datum.
    firm_rank
        The same without directions whose singular value, all columns scaled to unit length, is
        below 1e-3 of the largest: what the priors have to carry.
    redundancy
        Trace of R: what the image coordinates check under these priors.
    untestable
        Rows with a redundancy number below 0.01: an error of 40 sigma is more likely missed
        than found at alpha 0.001 and power 0.80.
    inseparable
        Rows, testable ones, with a partner whose residual correlates by more than 0.99.
    """

    observations: int
    unknowns: int
    rank: int
    firm_rank: int
    redundancy: float
    untestable: int
    inseparable: int


@dataclass(frozen=True, slots=True, eq=False)
class BayesBlock:
    """The linearised block under one prior variance.

    Attributes
    ----------
    rows
        (photo, point, axis) of every row.
    design
        (156, 135) derivatives of the image coordinates, in sigmas of 5 um per m and per rad.
    matrix
        (156, 156) R = I - A (A'A + Px)^-1 A'; e = R l.
    prior_variance
        Of every unknown [m^2; of angles rad^2, which leaves them free].
    """

    rows: tuple[Row, ...]
    design: Array = field(repr=False)
    matrix: Array = field(repr=False)
    prior_variance: float

    def residuals(self, errors: Array, redundancy: int | None = None) -> DenseResiduals:
        """See the block from the side of its residuals, the image coordinates in error.

        Parameters
        ----------
        errors
            (156,) errors of the image coordinates in sigmas; the prior values are the true ones,
            as in the paper.
        redundancy
            None: what the image coordinates really check, the trace of R rounded.
        """
        e = self.matrix @ errors
        r = np.maximum(np.diag(self.matrix), 0.0)
        return DenseResiduals(
            self.rows,
            e,
            r,
            # v'Pv + v_x'Px v_x: what the estimate minimises, a quadratic form with matrix R
            max(float(errors @ e), 0.0),
            round(float(r.sum())) if redundancy is None else redundancy,
            self.matrix,
        )

    def facts(self) -> BayesFacts:
        """Say what limits every search for gross errors in this block."""
        n, u = self.design.shape
        length = np.sqrt(np.einsum("ij,ij->j", self.design, self.design))
        singular = np.linalg.svd(self.design / length, compute_uv=False)
        singular = singular / singular[0]
        r = np.diag(self.matrix)
        testable = r >= _HIDDEN
        rho = np.abs(np.nan_to_num(residual_correlations(self.matrix, r)))
        np.fill_diagonal(rho, 0.0)
        rho = rho * testable[:, None] * testable
        return BayesFacts(
            n,
            u,
            int((singular > 1e-10).sum()),
            int((singular > _WEAK).sum()),
            float(r.sum()),
            int((~testable).sum()),
            int((rho.max(axis=0) > _INSEPARABLE).sum()),
        )


def bayes_block(prior_variance: float) -> BayesBlock:
    """Make the block under a prior variance of every unknown.

    Parameters
    ----------
    prior_variance
        The paper's 10 or 100 [m^2]. The number is taken for angles too [rad^2], as the paper
        seems to do: they are as good as free.

    Raises
    ------
    ValueError
        A variance that is not positive.
    """
    if not prior_variance > 0.0:
        raise ValueError(f"a prior variance of {prior_variance} m^2 is not positive")
    rows, design = _design()
    u = design.shape[1]
    # singular values of the stacked system: well conditioned whatever the units
    left = np.linalg.svd(np.vstack([design, np.eye(u) / prior_variance**0.5]), full_matrices=False)[
        0
    ][: len(rows)]
    return BayesBlock(rows, design, np.eye(len(rows)) - left @ left.T, prior_variance)


def bayes_geometry() -> BayesGeometry:
    """Return the block as it lies: two strips of five photos over 25 points."""
    rng = np.random.default_rng(_SHAPE)
    points = np.array([(_SPACING[0] * j, _SPACING[1] * i, 0.0) for i in range(5) for j in range(5)])
    points[:, 2] = rng.uniform(-_RELIEF, _RELIEF, len(points))
    centres: list[tuple[float, float, float]] = []
    rotations: list[Array] = []
    rays: list[tuple[int, int]] = []
    for strip, row in enumerate((1, 3)):
        for k in range(5):
            photo = len(centres)
            centres.append((_SPACING[0] * k, _SPACING[1] * row, _HEIGHT))
            tilts = np.radians(rng.uniform(-_TILT_DEG, _TILT_DEG, 3))
            rotations.append(rotation_matrix(*(tilts * ((k + strip) % 2)).tolist()))
            rays += [
                (photo, 5 * i + j)
                for i in range(row - 1, row + 2)
                for j in range(max(k - 1, 0), min(k + 1, 4) + 1)
            ]
    return BayesGeometry(
        np.array(centres), np.array(rotations), points, np.array(rays, dtype=np.intp)
    )


def _design() -> tuple[tuple[Row, ...], Array]:
    at = bayes_geometry()
    known = np.zeros(at.points.shape, dtype=bool)
    design = image_design(at.centres, at.rotations, C_MM, at.points, at.rays, known)
    names = tuple(
        (photo_name(f), point_name(p), axis) for f, p in at.rays.tolist() for axis in "xy"
    )
    return names, design / SIGMA_MM
