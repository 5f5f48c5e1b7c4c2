"""Two systems with common points: the similarity between them, its discrepancies, and transfer.

A strip and its neighbour, or a strip and the ground. The errors of the points are correlated, for
they share orientations; the adjustment takes them as `stripgeometry` has them, so that bent strips
are neither believed too much nor accused. Redundancy numbers are the diagonal of Q_vv P, which sums
to the redundancy; w is that of correlated observations (Baarda 1968): (P v)_i over its standard
deviation. Points nearly on one line leave the turn about it open; then both systems are taken to
be level, as strips are that begin with a near-vertical photo, within `LEVEL_DEG`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from math import radians, sqrt
from typing import NamedTuple, Protocol

import numpy as np

from anaplot.adjustment.leastsquares import RankDefectError, adjust
from anaplot.adjustment.tested import AppliedTest
from anaplot.aliases import Array
from anaplot.errors import NotComputableError
from anaplot.orientation.stripgeometry import Located
from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.collinearity import turns
from anaplot.photogrammetry.similarity import (
    Similarity,
    moved_similarity,
    similarity_effects,
)

__all__ = ["FEWEST", "LEVEL_DEG", "Placed", "StripTie", "System", "TiePoint", "tie_systems"]

LEVEL_DEG = 3.0
"""Standard deviation of the inclination between two systems where points do not determine it."""
FEWEST = 2
"""Common points from which there is a similarity; from three on it may need no level systems."""
_UNKNOWNS = ("X0", "Y0", "Z0", "omega", "phi", "kappa", "scale")
_AXES = ("X", "Y", "Z")
_STEPS = 20
_SMALL = 1e-8  # of a standard deviation
_LOOSE = 0.2  # of LEVEL_DEG: points that know the inclination no better do not determine it
_LOCATED = 3.0  # T of the worst point above the next by less than this: one or the other


class System(Protocol):
    """Points of one system, with `count` errors that they share."""

    @property
    def points(self) -> Mapping[str, Located]:
        """By name."""
        ...

    @property
    def count(self) -> int:
        """Number of errors."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Points of one system, with `count` errors that they share."""

    points: Mapping[str, Located]
    count: int


class TiePoint(NamedTuple):
    """A common point of two systems.

    Attributes
    ----------
    point
        Name.
    difference
        Transferred minus own X, Y, Z, in the unit of the system that was transferred to.
    r
        Redundancy numbers of X, Y, Z; None where it took no part.
    w
        Their tests; None where they cannot be tested.
    size
        T = (P v)' (P Q_vv P)^-1 (P v) of its three rows, in the sigma0 of the test: by how much
        v'Pv falls without the point; None where it took no part or cannot be tested.
    flagged
        Whether a w exceeds the critical value.
    """

    point: str
    difference: tuple[float, float, float]
    r: tuple[float, float, float] | None
    w: tuple[float | None, float | None, float | None]
    size: float | None
    flagged: bool

    @property
    def mean_r(self) -> float | None:
        """Mean redundancy number."""
        return None if self.r is None else sum(self.r) / 3.0

    @property
    def largest_w(self) -> float | None:
        """The w that is largest without its sign."""
        return max((w for w in self.w if w is not None), key=abs, default=None)


@dataclass(frozen=True, slots=True, eq=False)
class StripTie:
    """The similarity between two systems.

    Attributes
    ----------
    similarity
        From the other system to this one.
    points
        Common points, in this system's order.
    redundancy
        Of this adjustment alone.
    sigma0
        Of this adjustment, in a-priori ones; None without redundancy.
    test
        The test that flags, with the redundancy of the strips' models.
    level
        Whether the table needs systems that are level against each other.
    placed
        All points of the other system in this one by the similarity, if both are level. Their
        errors are those of this system, then those of the other, then two inclinations; they are
        the larger, the farther both systems are bent against each other, see `improved`.
    """

    similarity: Similarity
    points: tuple[TiePoint, ...]
    redundancy: int
    sigma0: float | None
    test: AppliedTest
    level: bool
    placed: Placed = field(repr=False)
    _noise: Array = field(repr=False)
    _seen: Array = field(repr=False)

    def improved(self, values: Array, errors: Array) -> tuple[Array, Array]:
        """Take from values what the discrepancies of the common points say of their errors.

        The best linear prediction: the errors that both systems most probably have are those of
        least squares that explain the discrepancies.

        Parameters
        ----------
        values, errors
            (n,) computed from points of either system, and (n, e) their errors; the first errors
            are those of `placed`, others may follow.

        Returns
        -------
        ndarray, ndarray
            Both as they are then.
        """
        count = len(self._noise)
        known = errors[:, :count]
        out = errors.copy()
        out[:, :count] -= (known @ self._seen.T) @ self._seen
        return values - known @ self._noise, out

    @property
    def suspects(self) -> tuple[str, ...]:
        """The flagged point that is most probably wrong, and those hard to tell from it."""
        flagged = [p for p in self.points if p.flagged and p.size is not None]
        flagged.sort(key=lambda p: -(p.size or 0.0))
        top = flagged[0].size or 0.0 if flagged else 0.0
        return tuple(p.point for p in flagged if top - (p.size or 0.0) < _LOCATED)

    @property
    def checkable(self) -> bool:
        """Whether one wrong point among them would show, and which it is."""
        return sum(p.r is not None for p in self.points) >= 4


def tie_systems(
    this: System,
    other: System,
    sigma0_mm: float,
    test: TestSettings,
    *,
    without: Collection[str] = (),
    models: tuple[float, int] = (0.0, 0),
) -> StripTie:
    """Determine the similarity from one system to another by their common points.

    Parameters
    ----------
    this, other
        The system that is transferred to, and the one that is transferred.
    sigma0_mm
        A-priori sigma0 of an image coordinate [mm]: the size of the systems' errors.
    test
        The test that flags.
    without
        Common points that are compared and take no part.
    models
        v'Pv and redundancy of the strips' models: a sigma0 that is estimated comes from them, too.

    Raises
    ------
    NotComputableError
        Fewer than two common points, or points that do not determine it.
    """
    common = [name for name in this.points if name in other.points]
    names = [name for name in common if name not in without]
    if len(names) < FEWEST:
        raise NotComputableError(f"{len(names)} common points, {FEWEST} are needed")
    known = _Adjusted(this, other, names, sigma0_mm, level=True)
    adjusted = known
    if len(names) > FEWEST:
        try:
            alone = _Adjusted(this, other, names, sigma0_mm, level=False)
            adjusted = alone if alone.inclination < _LOOSE * radians(LEVEL_DEG) else known
        except NotComputableError:
            pass  # points so near one line that nothing can be tested without level systems
    redundancy = adjusted.redundancy
    applied = AppliedTest.of(test, redundancy + models[1])
    total = redundancy + models[1]
    sigma0 = sqrt((adjusted.vtpv + models[0]) / total) if total > 0 else None
    rows = adjusted.tested(applied, applied.factor(sigma0))
    points = []
    for name in common:
        at = adjusted.similarity.apply(other.points[name].xyz[None])[0] - this.points[name].xyz
        x, y, z = at.tolist()
        points.append(rows.get(name, TiePoint(name, (0, 0, 0), None, (None,) * 3, None, False)))
        points[-1] = points[-1]._replace(difference=(x, y, z))
    return StripTie(
        adjusted.similarity,
        tuple(points),
        redundancy,
        sqrt(adjusted.vtpv / redundancy) if redundancy > 0 else None,
        applied,
        adjusted.level,
        known.placed(),
        *known.explained(),
    )


class _Adjusted:
    """The adjusted similarity; its rows are X, Y, Z of every point, and two inclinations if any."""

    def __init__(
        self, this: System, other: System, names: list[str], sigma0: float, *, level: bool
    ) -> None:
        self._this, self._other, self._names, self.level = this, other, names, level
        own = np.array([this.points[n].errors for n in names])
        others = np.array([other.points[n].errors for n in names])
        source = np.array([other.points[n].xyz for n in names])
        target = np.array([this.points[n].xyz for n in names])
        self._sigma0 = sigma0
        self._tilt = radians(LEVEL_DEG) / sigma0
        self.similarity = _level_start(source, target)
        n = 3 * len(names)
        for _ in range(_STEPS):
            now = self.similarity
            at = now.apply(source)
            self._middle = at.mean(axis=0)
            design = similarity_effects(at - self._middle).reshape(n, 7)
            value = (at - target).ravel() / sigma0
            turned = now.scale * np.einsum("ab,kbe->kae", now.rotation, others)
            errors = np.concatenate((-own, turned), axis=2).reshape(n, -1)
            if self.level:
                design = np.concatenate((design, np.eye(7)[3:5]))
                inclined = np.array([-now.rotation[1, 2], now.rotation[0, 2]]) / sigma0
                value = np.concatenate((value, inclined))
            self._errors = np.zeros((len(value), errors.shape[1] + 2))
            self._errors[:n, :-2] = errors
            self._errors[n:, -2:] = self._tilt * np.eye(2)[: len(value) - n]
            covariance = self._errors @ self._errors.T
            # points free of error on both sides have no covariance
            covariance[np.diag_indices_from(covariance)] += 1e-9 * np.trace(covariance) / n
            self._root = np.linalg.cholesky(covariance)
            white = np.linalg.solve(self._root, np.column_stack((design, value)))
            try:
                self._solved = adjust(
                    white[:, :7], white[:, 7], np.ones(len(value)), unknowns=_UNKNOWNS
                )
            except RankDefectError as error:
                raise NotComputableError(f"the common points: {error}") from error
            self.similarity = moved_similarity(now, self._middle, self._solved.x * sigma0)
            q_xx = np.sqrt(np.diag(self._solved.q_xx))
            if float(np.abs(self._solved.x / q_xx).max()) < _SMALL:
                self.inclination = float(q_xx[3:5].max()) * sigma0
                return
        raise NotComputableError("the similarity of the common points does not converge")

    @property
    def redundancy(self) -> int:
        return self._solved.redundancy

    @property
    def vtpv(self) -> float:
        return self._solved.vtpv

    def tested(self, test: AppliedTest, factor: float | None) -> dict[str, TiePoint]:
        """Return the tested points; differences are not filled in."""
        unwhitened = np.linalg.solve(self._root.T, np.eye(len(self._root)))
        residual = unwhitened @ self._solved.w  # P v
        cofactor = unwhitened @ self._solved.q_vv @ unwhitened.T  # P Q_vv P
        influence = self._root @ self._solved.q_vv @ unwhitened.T
        r = np.einsum("ii->i", influence)
        variance = np.einsum("ii->i", cofactor)
        weight = np.einsum("ij,ij->i", unwhitened, unwhitened)
        out = {}
        for k, name in enumerate(self._names):
            rows = slice(3 * k, 3 * k + 3)
            # what is left of the weight tells whether a row is tested at all
            testable = (variance[rows] > 1e-9 * weight[rows]) & (factor is not None)
            w: list[float | None] = [
                float(value / (sqrt(var) * factor)) if good and factor else None
                for value, var, good in zip(
                    residual[rows], variance[rows], testable.tolist(), strict=True
                )
            ]
            size = None
            if factor and testable.any():
                inverse = np.linalg.pinv(cofactor[rows, rows], rcond=1e-6, hermitian=True)
                size = float(residual[rows] @ inverse @ residual[rows]) / factor**2
            flagged = test.critical is not None and any(
                value is not None and abs(value) > test.critical for value in w
            )
            rx, ry, rz = r[rows].tolist()
            out[name] = TiePoint(name, (0, 0, 0), (rx, ry, rz), (w[0], w[1], w[2]), size, flagged)
        return out

    def explained(self) -> tuple[Array, Array]:
        """Return the errors [mm] that explain the residuals, and what of errors residuals see."""
        white = np.linalg.solve(self._root, self._errors)
        seen = white - self._projected(white)
        return self._sigma0 * self._solved.w @ seen, seen

    def _projected(self, white: Array) -> Array:
        design = np.linalg.solve(self._root, self._design_at())
        out: Array = design @ (self._solved.q_xx @ (design.T @ white))
        return out

    def placed(self) -> Placed:
        """Return all points of the other system in this one."""
        solved, now = self._solved, self.similarity
        white = np.linalg.solve(self._root, self._errors)
        design = np.linalg.solve(self._root, self._design_at())
        unknowns = -solved.q_xx @ (design.T @ white)
        names = list(self._other.points)
        xyz = now.apply(np.array([self._other.points[n].xyz for n in names]).reshape(-1, 3))
        effects = similarity_effects(xyz - self._middle)
        own, others = self._this.count, self._other.count
        points = {}
        for name, at, effect in zip(names, xyz, effects, strict=True):
            errors = effect @ unknowns
            errors[:, own : own + others] += (
                now.scale * now.rotation @ self._other.points[name].errors
            )
            points[name] = Located(at, errors)
        return Placed(points, own + others + 2)

    def _design_at(self) -> Array:
        at = self.similarity.apply(np.array([self._other.points[n].xyz for n in self._names]))
        design = similarity_effects(at - self._middle).reshape(-1, 7)
        return np.concatenate((design, np.eye(7)[3:5])) if self.level else design


def _level_start(source: Array, target: Array) -> Similarity:
    """Return the similarity of level systems on which most pairs of points agree in plan."""
    one, two = (values[:, :2] @ np.array([1.0, 1j]) for values in (source, target))
    i, j = np.triu_indices(len(one), 1)
    apart = np.abs(one[j] - one[i])
    good = apart > 0.2 * float(apart.max(initial=0.0))
    if not good.any():
        raise NotComputableError("the common points lie in one place")
    i, j = i[good], j[good]
    factor = (two[j] - two[i]) / (one[j] - one[i])
    shift = two[i] - factor * one[i]
    gap = np.sort(np.abs(factor[:, None] * one + shift[:, None] - two), axis=1)
    # two points always agree
    best = int(np.argmin(gap[:, min(len(one) - 1, max(len(one) // 2, 2))]))
    if not abs(factor[best]) > 0.0:
        raise NotComputableError("the common points lie in one place")
    scale, turn = float(abs(factor[best])), float(np.angle(factor[best]))
    height = float(np.median(target[:, 2] - scale * source[:, 2]))
    rotation = turns(np.array([[0.0, 0.0, turn]]))[0]
    plan = shift[best]
    return Similarity(scale, rotation, np.array([plan.real, plan.imag, height]))
