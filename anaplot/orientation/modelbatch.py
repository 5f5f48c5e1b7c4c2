"""Models that have nothing to do with each other, oriented at once from a single start.

The conditions, their weights and the iteration are those of a single model (`conditionequations`,
`solver`), with an axis of models before them. What is found counts only where it is beyond doubt,
as nearly always; what needs damping, another start or a point left out is a model for `orient`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.leastsquares import CONDITION_LIMIT
from anaplot.aliases import Array, Bools
from anaplot.orientation.conditionequations import Q_Y, tie_cofactor
from anaplot.orientation.solver import CONVERGED, FEW_ITERATIONS, LARGEST_TURN, looks_right
from anaplot.photogrammetry.block import TieVariance
from anaplot.photogrammetry.collinearity import turns
from anaplot.photogrammetry.conditions import coefficients_of_many, products_of_many
from anaplot.photogrammetry.intersection import Intersection, intersect

__all__ = ["ModelBatch", "OrientedModels", "orient_at_once"]

_SURELY = 0.1 * CONDITION_LIMIT  # condition number below which nobody asks whether there is rank
_CHECKED = 2  # redundancy: below, nothing says that rows agree
_DUST = 1e-14  # added to a diagonal of ones, so that what has no rank can be told afterwards


@dataclass(frozen=True, slots=True, eq=False)
class ModelBatch:
    """The measurements of m models, of n points at most.

    Attributes
    ----------
    left, right
        (m, 3, n) rays of the points in the image systems; zeros where a model has no more points.
    y, x
        (m, n) which rows count: of points, and of ties.
    ties
        (m, 3, n) ties' model coordinates [mm] from the left projection centre; zeros where x is
        not.
    rotation
        (m, 3, 3) rotations of the left photos.
    first
        (m,) which are first models of a strip.
    base
        (m,) of a first model the magnitude of bx, else the bx of the preceding one [mm].
    """

    left: Array
    right: Array
    y: Bools
    x: Bools
    ties: Array
    rotation: Array
    first: Bools
    base: Array


class OrientedModels(NamedTuple):
    """What was found of m models.

    Attributes
    ----------
    sure
        (m,) where it is beyond doubt; nothing else is worth anything elsewhere.
    base
        (m, 3) from the left to the right projection centre [mm].
    rotation
        (m, 3, 3) rotations of the right photos.
    points
        (m, 3, n) model coordinates [mm] from the left projection centre.
    """

    sure: Bools
    base: Array
    rotation: Array
    points: Array


class _Unknowns(NamedTuple):
    """(m,) bx, beta_y, beta_z, and (m, 3, 3) rotations of the right photos."""

    bx: Array
    beta_y: Array
    beta_z: Array
    rotation: Array

    def where(self, taken: Bools, other: _Unknowns) -> _Unknowns:
        """Return these, and the others' where they are taken."""
        return _Unknowns(
            np.where(taken, other.bx, self.bx),
            np.where(taken, other.beta_y, self.beta_y),
            np.where(taken, other.beta_z, self.beta_z),
            np.where(taken[:, None, None], other.rotation, self.rotation),
        )


def orient_at_once(
    batch: ModelBatch, tie_variance: TieVariance, apriori_mm: float
) -> OrientedModels:
    """Orient models from the tilts of the left photo and the kappa of a plane similarity.

    Parameters
    ----------
    batch
        The measurements.
    tie_variance
        Cofactor of x rows, see `tie_cofactor`.
    apriori_mm
        A-priori sigma0 [mm].
    """
    with np.errstate(all="ignore"):
        return _Conditions(batch, tie_variance).oriented(apriori_mm)


class _Conditions:
    """The conditions of models, as `ConditionEquations` has those of one."""

    def __init__(self, batch: ModelBatch, tie_variance: TieVariance) -> None:
        self._batch, self._tie_variance = batch, tie_variance
        self._there = batch.right[:, 2] != 0.0
        self._x1 = batch.rotation @ batch.left
        plane = self._x1 * np.where(batch.y, -(Q_Y**-0.5) / self._x1[:, 2], 0.0)[:, None]
        self._plane = products_of_many(plane, batch.right)
        horizontal = batch.ties[:, (0, 2, 2)]
        horizontal[:, 2] = 1.0
        self._tied = products_of_many(np.where(batch.x[:, None], horizontal, 0.0), batch.right)

    def _normal(self, at: _Unknowns) -> Array:
        """(m, 7, 7) sums of products of derivatives and misclosures [mm^2]."""
        batch = self._batch
        factors = coefficients_of_many(*at)
        rows = factors[:, :, :9] @ self._plane
        normal: Array = rows @ rows.transpose(0, 2, 1)
        if batch.x.any():
            depth = batch.ties[:, 2] - (at.bx * at.beta_z)[:, None]
            depth *= -np.sqrt(tie_cofactor(at.bx / batch.base, self._tie_variance))[:, None]
            rows = (factors[:, :, 9:] @ self._tied) / np.where(batch.x, depth, 1.0)[:, None]
            normal += rows @ rows.transpose(0, 2, 1)
        # a first model holds bx
        normal[batch.first, 0] = normal[batch.first, :, 0] = 0.0
        normal[batch.first, 0, 0] = 1.0
        return normal

    def oriented(self, apriori_mm: float) -> OrientedModels:
        """Iterate, and say of which models the outcome is beyond doubt."""
        batch = self._batch
        at = self._start()
        normal = self._normal(at)
        going: Bools = np.asarray(np.isfinite(normal).all(axis=(1, 2)))
        converged = np.zeros_like(going)
        for _ in range(FEW_ITERATIONS):
            step = _solved(np.where(going[:, None, None], normal, np.eye(7)))
            longest = np.abs(step).max(axis=1)
            step *= np.minimum(LARGEST_TURN / np.maximum(longest, LARGEST_TURN), 1.0)[:, None]
            trial = _Unknowns(
                at.bx * (1.0 + step[:, 0]),
                at.beta_y + step[:, 1],
                at.beta_z + step[:, 2],
                turns(step[:, 3:]) @ at.rotation,
            )
            of_trial = self._normal(trial)
            room = normal[:, 6, 6] * (1.0 + 4.0 * longest) + 1e-24
            better = going & (of_trial[:, 6, 6] <= room)
            last = going & (longest < CONVERGED)
            at = at.where(better, trial)
            normal = np.where(better[:, None, None], of_trial, normal)
            converged |= last
            going = better & ~last
            if not going.any():
                break
        meet = self._meet(at)
        count = self._there.sum(axis=1)
        front = (meet.in_front & self._there).sum(axis=1) / count
        # a base of the wrong sign fits as well: the points tell which it is
        behind = ((meet.left < 0.0) & (meet.right < 0.0) & self._there).sum(axis=1) / count
        mirror = np.where(batch.first & (behind > front), -1.0, 1.0)
        bx, share = at.bx * mirror, np.where(mirror < 0.0, behind, front)
        freedom = batch.y.sum(axis=1) + batch.x.sum(axis=1) - np.where(batch.first, 5, 6)
        sure = converged & (freedom >= _CHECKED) & (_condition(normal, converged) < _SURELY)
        axis, other = batch.rotation[:, :, 2], at.rotation[:, :, 2]
        across = np.linalg.norm(np.cross(axis, other), axis=1)
        sure &= looks_right(
            square=normal[:, 6, 6] / (freedom * apriori_mm**2),
            growth=np.where(batch.first, np.inf, np.abs(bx / batch.base)),
            in_front=share,
            tilt=np.arctan2(across, np.einsum("mi,mi->m", axis, other)),
            slope=np.maximum(np.abs(at.beta_y), np.abs(at.beta_z)),
        )
        base = bx[:, None] * np.stack((np.ones_like(bx), at.beta_y, at.beta_z), axis=1)
        points = np.moveaxis(meet.points, 0, 1) * mirror[:, None, None]
        return OrientedModels(sure, base, at.rotation, points)

    def _meet(self, at: _Unknowns) -> Intersection:
        """Return where rays meet, (3, m, n), as seen from the left projection centres."""
        bx = at.bx[:, None]
        base = bx, bx * at.beta_y[:, None], bx * at.beta_z[:, None]
        x2 = at.rotation @ self._batch.right
        return intersect(base, np.moveaxis(self._x1, 1, 0), np.moveaxis(x2, 1, 0))

    def _start(self) -> _Unknowns:
        """Tilts of the left photos, kappa from plane similarities, bx from the ties."""
        batch = self._batch
        kappa = self._similar_kappa()
        turned = np.zeros((len(kappa), 3, 3))
        turned[:, 0, 0] = turned[:, 1, 1] = np.cos(kappa)
        turned[:, 1, 0] = np.sin(kappa)
        turned[:, 0, 1] = -turned[:, 1, 0]
        turned[:, 2, 2] = 1.0
        rotation = batch.rotation @ turned
        level = np.zeros(len(kappa))
        bx = np.where(batch.first, np.abs(batch.base), self._bx_of_ties(rotation))
        return _Unknowns(bx, level, level, rotation)

    def _similar_kappa(self) -> Array:
        """(m,) relative kappa of the plane similarities between the photos' points."""
        count = self._there.sum(axis=1)
        left, right = self._batch.left[:, :2], self._batch.right[:, :2]
        (xx, xy), (yx, yy) = (right @ left.transpose(0, 2, 1)).transpose(1, 2, 0)
        (lx, ly), (rx, ry) = left.sum(axis=2).T, right.sum(axis=2).T
        kappa: Array = np.arctan2(
            xy - yx - (rx * ly - ry * lx) / count, xx + yy - (rx * lx + ry * ly) / count
        )
        return kappa

    def _bx_of_ties(self, rotation: Array) -> Array:
        """(m,) median bx that the ties ask for at by = bz = 0; NaN where there is none."""
        batch = self._batch
        x2 = rotation @ batch.right
        asked = batch.ties[:, 0] - batch.ties[:, 2] * x2[:, 0] / x2[:, 2]
        usable = batch.x & np.isfinite(asked)
        asked = np.sort(np.where(usable, asked, np.inf), axis=1)
        count = usable.sum(axis=1)
        pair = np.stack((count - 1, count)).clip(0) // 2
        middle = asked[np.arange(len(asked)), pair].mean(axis=0)
        bx: Array = np.where(np.isfinite(middle) & (middle != 0.0), middle, np.nan)
        return bx


def _scaled(normal: Array) -> tuple[Array, Array]:
    """(m, 6, 6) normal equations with a diagonal of ones, and (m, 6) their factors."""
    scale = 1.0 / np.sqrt(np.einsum("mii->mi", normal)[:, :6])
    scale = np.where(np.isfinite(scale), scale, 1.0)
    return normal[:, :6, :6] * scale[:, :, None] * scale[:, None], scale


def _solved(normal: Array) -> Array:
    """(m, 6) corrections."""
    matrix, scale = _scaled(normal)
    matrix += _DUST * np.eye(6)
    step: Array = np.linalg.solve(matrix, (-scale * normal[:, :6, 6])[:, :, None])[:, :, 0] * scale
    return step


def _condition(normal: Array, these: Bools) -> Array:
    """(m,) condition numbers of the designs, columns scaled to unit length; 1 of no others."""
    values = np.linalg.eigvalsh(_scaled(np.where(these[:, None, None], normal, np.eye(7)))[0])
    condition: Array = np.sqrt(values[:, -1] / np.maximum(values[:, 0], 1e-300))
    return condition
