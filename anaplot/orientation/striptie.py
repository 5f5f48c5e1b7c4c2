"""Two systems with common points: the similarity between them, its discrepancies, and transfer.

A strip and its neighbour, or a strip and the ground. The errors of the points are correlated, for
they share orientations; the adjustment takes them as `stripgeometry` has them, so that bent strips
are neither believed too much nor accused. Redundancy numbers are the diagonal of Q_vv P, which sums
to the redundancy; w is that of correlated observations (Baarda 1968): (P v)_i over its standard
deviation. Points nearly on one line leave the turn about it open; then both systems are taken to
be level, as strips are that begin with a near-vertical photo, within `LEVEL_DEG`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import radians, sqrt
from typing import NamedTuple, Protocol

import numpy as np

from anaplot.adjustment import lapack
from anaplot.adjustment.leastsquares import RankDefectError, adjust
from anaplot.adjustment.tested import AppliedTest
from anaplot.aliases import Array
from anaplot.errors import NotComputableError
from anaplot.orientation.stripgeometry import Located, widened
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
_STEPS = 20
_SMALL = 1e-6  # of a standard deviation
_GROSS = 0.02  # of the extent: farther than inclinations of level systems and relief may move
_LOOSE = 0.2  # of LEVEL_DEG: points that know the inclination no better do not determine it
_SURE = 28.0  # T of three rows that chance exceeds once in 280 000: a table has many, every record
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
        Whether a w exceeds the critical value, or it is too far off to take part.
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
    gross
        Points so far off that they took no part.
    count
        Number of errors of what it places: those of this system, then those of the other, then two
        inclinations.
    """

    similarity: Similarity
    points: tuple[TiePoint, ...]
    redundancy: int
    sigma0: float | None
    test: AppliedTest
    level: bool
    count: int
    _other: System = field(repr=False)
    gross: tuple[str, ...]
    _known: _Adjusted = field(repr=False)

    def carried(self, xyz: Array) -> Array:
        """Return (n, 3) places of the other system in this one, if both are level."""
        return self._known.similarity.apply(xyz)

    def placed(self, names: Iterable[str] | None = None) -> dict[str, Located]:
        """Return points of the other system in this one by the similarity, if both are level.

        Their errors are the larger, the farther both systems are bent against each other; what the
        discrepancies say of that is for `improved`.

        Parameters
        ----------
        names
            Which; None: all.
        """
        now, other = self._known.similarity, self._other
        wanted = list(other.points if names is None else names)
        xyz = now.apply(np.array([other.points[n].xyz for n in wanted]).reshape(-1, 3))
        effects = similarity_effects(xyz - self._known.middle)
        first = self.count - other.count - 2
        out = {}
        for name, at, effect in zip(wanted, xyz, effects, strict=True):
            errors = effect @ self._known.moved
            own = other.points[name].errors
            errors[:, first : first + own.shape[1]] += now.scale * now.rotation @ own
            out[name] = Located(at, errors)
        return out

    @property
    def probable(self) -> Array:
        """(count,) errors of least squares that explain the discrepancies, in mm."""
        return self._known.probable

    def probably_placed(self, names: list[str]) -> tuple[Array, Array]:
        """Return (n, 3) points as `placed` does, and (n, 3) what the `probable` errors do to them.

        What each error does to each of them is not written out.
        """
        now, other = self._known.similarity, self._other
        first = self.count - other.count - 2
        theirs = self.probable[first : first + other.count]
        xyz = self.carried(np.array([other.points[n].xyz for n in names]).reshape(-1, 3))
        own = [other.points[n].errors for n in names]
        off = np.array([errors @ theirs[: errors.shape[1]] for errors in own]).reshape(-1, 3)
        off = now.scale * off @ now.rotation.T
        off += similarity_effects(xyz - self._known.middle) @ self._known.probably_moved
        return xyz, off

    def improved(self, values: Array, errors: Array) -> tuple[Array, Array]:
        """Take from values what the discrepancies of the common points say of their errors.

        The best linear prediction: the errors that both systems most probably have are those of
        least squares that explain the discrepancies.

        Parameters
        ----------
        values, errors
            (n,) computed from points of either system, and (n, e) their errors; the first errors
            are those that `count` counts, others may follow.

        Returns
        -------
        ndarray, ndarray
            Both as they are then.
        """
        known = errors[:, : self.count]
        out = errors.copy()
        out[:, : self.count] -= self._known.seen(known)
        return values - known @ self.probable, out

    @property
    def suspects(self) -> tuple[str, ...]:
        """The flagged point that is most probably wrong, and those hard to tell from it."""
        return self._worst(0.0)

    @property
    def surely_wrong(self) -> str | None:
        """The point that is wrong beyond what chance does at one of all records of a day."""
        found = self._worst(_SURE) if self.checkable else ()
        return found[0] if len(found) == 1 else None

    def _worst(self, least: float) -> tuple[str, ...]:
        flagged = [p for p in self.points if p.flagged and (p.size or 0.0) > least]
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
    start, gross = _level_start(
        names, *(np.array([system.points[n].xyz for n in names]) for system in (other, this))
    )
    names = [name for name in names if name not in gross]
    shared = _Common(this, other, names, sigma0_mm)
    known = _Adjusted(shared, shared.rows(start, level=True), level=True)
    adjusted = known
    if len(names) > FEWEST:
        try:
            alone = _Adjusted(shared, known.rows.of_points(), level=False)
            adjusted = alone if alone.inclination < _LOOSE * radians(LEVEL_DEG) else known
        except NotComputableError:
            pass  # points so near one line that nothing can be tested without level systems
    redundancy = adjusted.redundancy
    applied = AppliedTest.of(test, redundancy + models[1])
    total = redundancy + models[1]
    sigma0 = sqrt((adjusted.vtpv + models[0]) / total) if total > 0 else None
    rows = adjusted.tested(applied, applied.factor(sigma0))
    at = adjusted.similarity.apply(np.array([other.points[name].xyz for name in common]))
    gaps = (at - np.array([this.points[name].xyz for name in common])).tolist()
    points = []
    for name, (x, y, z) in zip(common, gaps, strict=True):
        unused = TiePoint(name, (x, y, z), None, (None, None, None), None, name in gross)
        row = rows.get(name, unused)
        points.append(row._replace(difference=(x, y, z)))
    return StripTie(
        adjusted.similarity,
        tuple(points),
        redundancy,
        sqrt(adjusted.vtpv / redundancy) if redundancy > 0 else None,
        applied,
        adjusted.level,
        shared.own_count + shared.other_count + 2,
        other,
        gross,
        known,
    )


class _Common:
    """The common points of two systems, with the covariances of their errors."""

    def __init__(self, this: System, other: System, names: list[str], sigma0: float) -> None:
        self.names, self.sigma0 = names, sigma0
        self.own_count, self.other_count = this.count, other.count
        self.target = np.array([this.points[n].xyz for n in names])
        self.source = np.array([other.points[n].xyz for n in names])
        self._own = _errors_of(this, names, this.count)
        # a strip that goes on far beyond these points has errors that none of them has
        far = max(other.points[n].errors.shape[1] for n in names)
        self._other = _errors_of(other, names, far)
        rows = 3 * len(names)
        own, others = (e.reshape(rows, -1) for e in (self._own, self._other))
        self._c_own, self._c_other = own @ own.T, others @ others.T
        self.tilt = radians(LEVEL_DEG) / sigma0

    def rows(self, now: Similarity, *, level: bool) -> _Rows:
        """Return the whitened rows at a similarity, with two inclinations of level systems."""
        n = 3 * len(self.names)
        at = now.apply(self.source)
        middle = at.mean(axis=0)
        rows = np.zeros((n + 2 * level, 8), order="F")
        rows[:n, :7] = similarity_effects(at - middle).reshape(-1, 7)
        rows[:n, 7] = (at - self.target).ravel() / self.sigma0
        root = np.asarray(np.linalg.cholesky(self._covariance(now)))
        if level:
            rows[n, 3] = rows[n + 1, 4] = 1.0
            rows[n:, 7] = np.array([-now.rotation[1, 2], now.rotation[0, 2]]) / self.sigma0
            points, root = root, self.tilt * np.eye(n + 2)
            root[:n, :n] = points
        # a transpose is in LAPACK's order as it is
        return _Rows(now, middle, root, lapack.dtrtrs(root.T, rows, lower=0, trans=1)[0])

    def _covariance(self, now: Similarity) -> Array:
        """Return that of the points' misclosures, in units of sigma0, for a similarity."""
        n = len(self.names)
        turn = now.scale * now.rotation
        half = np.matmul(turn, self._c_other.reshape(n, 3, 3 * n)).reshape(3 * n, 3 * n)
        points: Array = np.matmul(turn, half.T.reshape(n, 3, 3 * n)).reshape(3 * n, 3 * n)
        points += self._c_own
        # points free of error on both sides have no covariance
        points.flat[:: 3 * n + 1] += 1e-9 * np.trace(points) / (3 * n)
        return points

    def by_errors(self, rows: Array, now: Similarity) -> Array:
        """Return (k, e): what every error does to (k, rows) sums of misclosures of level systems.

        There are many more errors than rows: what each does to each row is never written out.
        """
        n, k = len(self.names), len(rows)
        points = rows[:, :-2]
        turned = (points.reshape(k, n, 3) @ (now.scale * now.rotation)).reshape(k, 3 * n)
        own, other = self._own.reshape(3 * n, -1), self._other.reshape(3 * n, -1)
        theirs = widened(turned @ other, self.other_count)
        return np.concatenate((-(points @ own), theirs, self.tilt * rows[:, -2:]), axis=1)

    def by_rows(self, errors: Array, now: Similarity) -> Array:
        """Return (k, rows): what the misclosures of level systems have of (k, e) errors."""
        n, k = len(self.names), len(errors)
        own, other = self._own.reshape(3 * n, -1), self._other.reshape(3 * n, -1)
        first, second = errors[:, : self.own_count], errors[:, self.own_count : -2]
        turned = (second[:, : other.shape[1]] @ other.T).reshape(k, n, 3) @ (
            now.scale * now.rotation
        ).T
        points = turned.reshape(k, 3 * n) - first @ own.T
        return np.concatenate((points, self.tilt * errors[:, -2:]), axis=1)


def _errors_of(system: System, names: list[str], count: int) -> Array:
    """Return (n, 3, count) effects on points of a system."""
    out = np.zeros((len(names), 3, count))
    for row, name in zip(out, names, strict=True):
        errors = system.points[name].errors
        row[:, : errors.shape[1]] = errors
    return out


class _Rows(NamedTuple):
    """Rows about a similarity: X, Y, Z of every point, and two inclinations if any.

    Their unknowns refer to `middle`; `root` is that of their covariance, and `white` their (rows,
    8) design and misclosures, divided by it.
    """

    similarity: Similarity
    middle: Array
    root: Array
    white: Array

    def of_points(self) -> _Rows:
        """Return them without the inclinations, which have no errors in common with points."""
        return self._replace(root=self.root[:-2, :-2], white=self.white[:-2])


class _Adjusted:
    """The adjusted similarity, from the rows about a first one."""

    def __init__(self, common: _Common, rows: _Rows, *, level: bool) -> None:
        self._common, self.level = common, level
        for _ in range(_STEPS):
            # turned so that seven rows have all that tells of the unknowns, the eighth v'Pv
            turned, factors, _, _ = lapack.dgeqrf(rows.white)
            triangle = np.triu(turned[:8])
            try:
                solved = adjust(triangle[:7, :7], triangle[:7, 7], np.ones(7), unknowns=_UNKNOWNS)
            except RankDefectError as error:
                raise NotComputableError(f"the common points: {error}") from error
            self._solved = solved
            self.similarity = moved_similarity(
                rows.similarity, rows.middle, solved.x * common.sigma0
            )
            q_xx = np.sqrt(np.diag(solved.q_xx))
            if float(np.abs(solved.x / q_xx).max()) < _SMALL:
                basis = lapack.dorgqr(turned, factors)[0]
                self.rows, self._basis = rows, basis[:, :7]
                self._closing: Array = basis[:, 7] * triangle[7, 7]
                self.inclination = float(q_xx[3:5].max()) * common.sigma0
                return
            rows = common.rows(self.similarity, level=level)
        raise NotComputableError("the similarity of the common points does not converge")

    @property
    def redundancy(self) -> int:
        return len(self._closing) - len(_UNKNOWNS)

    @property
    def vtpv(self) -> float:
        return float(self._closing @ self._closing)

    def tested(self, test: AppliedTest, factor: float | None) -> dict[str, TiePoint]:
        """Return the tested points; differences are not filled in."""
        names = self._common.names
        n = len(names)
        unwhitened = lapack.dtrtri(self.rows.root, lower=1)[0].T
        residual = (unwhitened @ self._closing)[: 3 * n].reshape(n, 3)  # P v
        # Q_vv of whitened rows is 1 - basis basis'; only what each point has of it is asked for
        taken = unwhitened @ self._basis
        r = 1.0 - np.einsum("ik,ik->i", self.rows.root @ self._basis, taken)[: 3 * n].reshape(n, 3)
        whole, part = (rows[: 3 * n].reshape(n, 3, -1) for rows in (unwhitened, taken))
        blocks = whole @ whole.transpose(0, 2, 1) - part @ part.transpose(0, 2, 1)  # P Q_vv P
        variance = np.einsum("nii->ni", blocks)
        weight = np.einsum("nij,nij->ni", whole, whole)
        # what is left of the weight tells whether a row is tested at all
        testable = variance > 1e-9 * weight
        scale = factor or np.nan
        with np.errstate(divide="ignore", invalid="ignore"):
            w = np.where(testable, residual / (np.sqrt(variance) * scale), np.nan)
        inverse = np.linalg.pinv(blocks, rcond=1e-6, hermitian=True)
        size = np.einsum("na,nab,nb->n", residual, inverse, residual) / scale**2
        critical = np.inf if test.critical is None else test.critical
        flagged = (np.abs(np.nan_to_num(w)) > critical).any(axis=1)
        out = {}
        for k, name in enumerate(names):
            x, y, z = (None if value != value else value for value in w[k].tolist())
            rx, ry, rz = r[k].tolist()
            found = float(size[k]) if testable[k].any() and factor else None
            out[name] = TiePoint(
                name, (0.0, 0.0, 0.0), (rx, ry, rz), (x, y, z), found, bool(flagged[k])
            )
        return out

    def _unwhitened(self, columns: Array) -> Array:
        """Return (k, rows) by which rows are multiplied, of (rows, k) of whitened ones."""
        solved: Array = lapack.dtrtrs(self.rows.root.T, columns, lower=0)[0]
        return solved.T

    @cached_property
    def _gain(self) -> Array:
        """(7, rows) what misclosures do to the unknowns."""
        return -self._unwhitened(self.rows.white[:, :7] @ self._solved.q_xx)

    @cached_property
    def moved(self) -> Array:
        """(7, e) what errors do to the unknowns of level systems."""
        return self._common.by_errors(self._gain, self.similarity)

    @cached_property
    def probable(self) -> Array:
        """(e,) errors [mm] of least squares that explain the residuals of level systems."""
        rows = self._unwhitened(self._closing[:, None])
        errors: Array = self._common.by_errors(rows, self.similarity)[0]
        return errors * self._common.sigma0

    @cached_property
    def probably_moved(self) -> Array:
        """(7,) what the `probable` errors do to the unknowns of level systems."""
        rows: Array = self._common.by_rows(self.probable[None], self.similarity)[0]
        return self._gain @ rows

    @cached_property
    def _residual(self) -> Array:
        """(rows, rows) what of the misclosures of level systems is left as whitened residuals."""
        residual: Array = lapack.dtrtri(self.rows.root, lower=1)[0]
        return residual + self.rows.white[:, :7] @ self._gain

    def seen(self, known: Array) -> Array:
        """Return (k, e): what the residuals of level systems see of (k, e) errors of values."""
        rows = self._common.by_rows(known, self.similarity) @ self._residual.T
        return self._common.by_errors(rows @ self._residual, self.similarity)

    @property
    def middle(self) -> Array:
        """Where the unknowns refer to."""
        return self.rows.middle


def _level_start(
    names: list[str], source: Array, target: Array
) -> tuple[Similarity, tuple[str, ...]]:
    """Return the similarity of level systems on which most points agree, and those that do not."""
    one, two = (values[:, :2] @ np.array([1.0, 1j]) for values in (source, target))
    i, j = np.triu_indices(len(one), 1)
    apart = np.abs(one[j] - one[i])
    good = apart > 0.2 * float(apart.max(initial=0.0))
    if not good.any():
        raise NotComputableError("the common points lie in one place")
    i, j = i[good], j[good]
    factor = (two[j] - two[i]) / (one[j] - one[i])
    shift = two[i] - factor * one[i]
    # two points always agree
    half = min(len(one) - 1, max(len(one) // 2, 2))
    best = _least_median(factor, shift, one, two, half)
    if not abs(factor[best]) > 0.0:
        raise NotComputableError("the common points lie in one place")
    gaps = np.abs(factor[best] * one + shift[best] - two)
    middle = float(np.partition(gaps, half)[half])
    far = gaps > max(_GROSS * float(np.abs(two - two.mean()).max()), 6.0 * middle)
    gross = np.flatnonzero(far).tolist() if len(one) - int(far.sum()) >= 3 else []
    kept = [k for k in range(len(one)) if k not in gross]
    scale, turn = float(abs(factor[best])), float(np.angle(factor[best]))
    height = float(np.median((target[:, 2] - scale * source[:, 2])[kept]))
    rotation = turns(np.array([[0.0, 0.0, turn]]))[0]
    plan = shift[best]
    start = Similarity(scale, rotation, np.array([plan.real, plan.imag, height]))
    return start, tuple(names[k] for k in gross)


def _least_median(factor: Array, shift: Array, one: Array, two: Array, half: int) -> int:
    """Return which of the motions of the plane brings most of its points the nearest."""
    ones = np.ones(len(one))
    x = np.column_stack((factor.real, -factor.imag, shift.real)) @ (one.real, one.imag, ones)
    y = np.column_stack((factor.imag, factor.real, shift.imag)) @ (one.real, one.imag, ones)
    squares = np.square(x - two.real) + np.square(y - two.imag)
    # few are as good as the best of some: to count is quicker than to sort
    some = np.partition(squares[:: len(one)], half, axis=1)[:, half].min()
    good = np.flatnonzero(np.count_nonzero(squares <= some, axis=1) > half)
    middle = np.partition(squares[good], half, axis=1)[:, half]
    return int(good[np.argmin(middle)])
