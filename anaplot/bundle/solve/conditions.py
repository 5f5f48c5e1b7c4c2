"""Conditions between points as observations: misclosures and derivatives at a state.

Points on a line or a plane and equal distances share something unknown (four, three and one
parameters), which stays out of the unknowns: the rows of such a condition are replaced by their
contrasts, orthonormal combinations that no value of those parameters changes. Contrasts of
uncorrelated rows of one variance are uncorrelated and of that variance, and the adjustment with
them is that with the parameters (Gruen 1978, section B: straight lines, surfaces, angles and
distances beside the image coordinates).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_diag, csc_array, csr_array

from anaplot.adjustment.residualsystem import diagonal
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.conditionscale import ScaleOfConditions, parted
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.objectconditions import ObjectCondition

__all__ = [
    "MOST_CONDITION_ROWS",
    "ConditionEquations",
    "ConditionRow",
    "Conditions",
    "LaidOut",
    "lay_out_conditions",
]


MOST_CONDITION_ROWS = 2000
"""Rows of all conditions of a block: each brings one more solution of the normal equations."""

_FIRM = 1e-10  # of the extent of its points, or rad: the sigma of what is free of error
_APART = 1e-9  # of the block's extent: points that are closer are one
_THIN = 1e-3  # width over length: points on a line determine no plane
_RANK = 1e-9
_HELD = 1e-3  # redundancy number of what is held by something else as firmly
_DEPENDENT = 1e-8  # eigenvalue, of a unit diagonal, of conditions that depend on each other
_EPS = float(np.finfo(np.float64).eps)

# how many parameters the rows of an axis share at most
_SHARED = {"across": 2, "up": 2, "normal": 3, "length": 1}


class ConditionRow(NamedTuple):
    """What is tested by itself: a distance, an angle, the place of one point on a line or plane.

    Attributes
    ----------
    id
        Of the condition.
    what
        The point, or the points with a blank between them.
    axis
        "distance", "angle", "length" (of equal ones), "normal" (to a plane), "across" (horizontal)
        or "up" (at right angles to both).
    """

    id: str
    what: str
    axis: str


def _rows_of(one: ObjectCondition) -> list[tuple[str, str]]:
    if one.kind == "line":
        return [(point, axis) for point in one.points for axis in ("across", "up")]
    if one.kind == "plane":
        return [(point, "normal") for point in one.points]
    if one.kind == "equal":
        pairs = zip(one.points[::2], one.points[1::2], strict=True)
        return [(" ".join(pair), "length") for pair in pairs]
    return [(" ".join(one.points), one.kind)]


@dataclass(frozen=True, eq=False)
class ConditionEquations:
    """Conditions at a state of q contrasts of n rows.

    Attributes
    ----------
    misclosure
        (n,) value at the state minus what it should be [m, rad]; of lines, planes and equal
        distances with the parameters that fit best.
    sigma
        (n,) standard deviations [m, rad]; of rows free of error next to nothing.
    contrasts
        (n, q) orthonormal combinations of the rows that count.
    spanned
        (n, k) orthonormal, what the shared parameters do to those rows.
    derivatives
        (n, 3 p) of the misclosures with respect to the points; zeros for coordinates free of error.
    owner
        (q,) a row of the condition that each contrast belongs to.
    e
        (q,) misclosures of the contrasts in their standard deviations.
    scale
        What they say of the scale, where it is theirs to give; the contrasts then leave it out.
    """

    misclosure: Array
    sigma: Array
    contrasts: csr_array
    spanned: csr_array
    derivatives: csr_array = field(repr=False)
    owner: Index = field(repr=False)
    e: Array = field(repr=False)
    scale: ScaleOfConditions | None = None

    @cached_property
    def whitened(self) -> csr_array:
        """(q, 3 p) derivatives of the contrasts, divided by their standard deviations."""
        return csr_array(self.contrasts.T @ (diagonal(1.0 / self.sigma) @ self.derivatives))

    def contrasted(self, other: ConditionEquations) -> Array:
        """Return (q,) misclosures at another state by the contrasts of this one, in sigmas."""
        out: Array = self.contrasts.T @ (other.misclosure / other.sigma)
        return out

    def effect(self, points: Array) -> ConditionEquations:
        """Return (p, 3) changes of the points' effect in place of the misclosures."""
        return replace(self, e=self.whitened @ points.ravel())


@dataclass(frozen=True, eq=False)
class Conditions:
    """The conditions that take part in a bundle.

    Attributes
    ----------
    conditions
        What they are.
    points
        Of each, the indices of its points.
    rejected
        (n,) rows of weight zero.
    scaling
        Whether the datum leaves the scale to them.
    """

    conditions: tuple[ObjectCondition, ...]
    points: tuple[Index, ...] = field(repr=False)
    rejected: Bools = field(repr=False)
    scaling: bool = False

    @cached_property
    def rows(self) -> tuple[ConditionRow, ...]:
        """The n rows, condition by condition."""
        return tuple(ConditionRow(one.id, *row) for one in self.conditions for row in _rows_of(one))

    @cached_property
    def of_row(self) -> Index:
        """(n,) the condition of each row."""
        counts = [len(_rows_of(one)) for one in self.conditions]
        return np.repeat(np.arange(len(counts)), counts)

    @cached_property
    def firm(self) -> Bools:
        """(n,) which rows are free of error."""
        return np.array([one.sigma == 0.0 for one in self.conditions], dtype=bool)[self.of_row]

    @property
    def angular(self) -> Bools:
        """(n,) which rows are angles [rad]; the others are lengths [m]."""
        return np.array([row.axis == "angle" for row in self.rows], dtype=bool)

    def those(self, some: Sequence[int]) -> Conditions:
        """Return some of the conditions, by ascending numbers."""
        return Conditions(
            tuple(self.conditions[k] for k in some),
            tuple(self.points[k] for k in some),
            self.rejected[np.isin(self.of_row, some)],
            self.scaling,
        )

    @property
    def every(self) -> Conditions:
        """The same with all rows."""
        return replace(self, rejected=np.zeros_like(self.rejected))

    def without(self, rows: Sequence[int]) -> Conditions:
        """Return them with these rows, and no others, of weight zero."""
        rejected = np.zeros_like(self.rejected)
        rejected[list(rows)] = True
        return replace(self, rejected=rejected)

    @cached_property
    def _free(self) -> tuple[Index, Index]:
        """Of each condition: rows that count, and parameters that they share."""
        rows = np.zeros(len(self.conditions), dtype=np.intp)
        shared = np.zeros_like(rows)
        for k in range(len(self.conditions)):
            mine = np.flatnonzero((self.of_row == k) & ~self.rejected)
            axes = [self.rows[row].axis for row in mine.tolist()]
            rows[k] = len(axes)
            shared[k] = sum(min(axes.count(axis), _SHARED.get(axis, 0)) for axis in set(axes))
        return rows, shared

    @property
    def gives_scale(self) -> bool:
        """Whether they determine the scale: distances do, where the datum leaves it to them."""
        return self.scaling and bool((self._distances & ~self.rejected).any())

    @cached_property
    def _distances(self) -> Bools:
        """(n,) which rows are distances."""
        return np.array([row.axis == "distance" for row in self.rows], dtype=bool)

    @property
    def observations(self) -> int:
        """How many observations they add: the rows that count, unless they are free of error."""
        return int((~self.rejected & ~self.firm).sum())

    @property
    def unknowns(self) -> int:
        """How many unknowns: shared parameters; what is free of error takes as many away."""
        rows, shared = self._free
        firm = np.array([one.sigma == 0.0 for one in self.conditions], dtype=bool)
        return int(np.where(firm, shared - rows, shared).sum())

    def equations(self, points: Array, fixed: Bools) -> ConditionEquations:
        """Return misclosures and derivatives.

        Parameters
        ----------
        points
            (p, 3) coordinates [m].
        fixed
            (p, 3) which of them are free of error.

        Raises
        ------
        NotComputableError
            Points that coincide, or lie on a line where a plane is asked for.
        """
        found = self._stated(points, fixed)
        return self._scaled(found, points) if self.gives_scale else found

    def scale_excess(self, points: Array, fixed: Bools) -> float:
        """Return by how much the scale that distances give is exceeded, relatively.

        With the parameters and errors of `equations`; it needs none of their combinations.
        """
        found = self._stated(points, fixed)
        along = self._along_scale(found, points)
        return float(along @ found.e / (along @ along))

    def _stated(self, points: Array, fixed: Bools) -> ConditionEquations:
        """Return the equations as if the datum had a scale."""
        extent = float(np.ptp(points, axis=0).max(initial=0.0))
        parts = []
        for k, (one, at) in enumerate(zip(self.conditions, self.points, strict=True)):
            counts = ~self.rejected[self.of_row == k]
            raw = _MISCLOSURES[one.kind](one, points[at], counts, _APART * extent)
            parts.append(_Part.of(one, raw, at, points[at], counts, fixed))
        misclosure = np.concatenate([part.misclosure for part in parts])
        sigma = np.concatenate([part.sigma for part in parts])
        contrasts = csr_array(block_diag([csr_array(part.contrasts) for part in parts]))
        spanned = csr_array(block_diag([csr_array(part.spanned) for part in parts]))
        first = np.cumsum([0, *(len(part.sigma) for part in parts)])
        entries = [
            (part.rows + start, part.columns, part.values)
            for start, part in zip(first.tolist(), parts, strict=False)
        ]
        rows, columns, values = (np.concatenate([e[k] for e in entries]) for k in range(3))
        derivatives = csr_array((values, (rows, columns)), shape=(len(misclosure), 3 * len(points)))
        # the rows of a contrast are of one condition: any of them tells which
        by_column = csc_array(contrasts)
        return ConditionEquations(
            misclosure,
            sigma,
            contrasts,
            spanned,
            derivatives,
            by_column.indices[by_column.indptr[:-1]].astype(np.intp),
            contrasts.T @ (misclosure / sigma),
        )

    def _along_scale(self, found: ConditionEquations, points: Array) -> Array:
        """Return (q,) what a relative change of scale does to the contrasts."""
        larger = (points - points.mean(axis=0)).ravel()
        # what is free of error is met: but for distances, it says the same at every scale
        tells = self._distances | ~self.firm
        effect = np.where(tells, found.derivatives @ larger, 0.0) / found.sigma
        out: Array = found.contrasts.T @ effect
        return out

    def _scaled(self, found: ConditionEquations, points: Array) -> ConditionEquations:
        """Return the contrasts that say nothing of the scale, and apart from them what does."""
        along = self._along_scale(found, points)
        combinations, others, direction = parted(along)
        return replace(
            found,
            contrasts=csr_array(found.contrasts @ combinations),
            owner=found.owner[others],
            e=combinations.T @ found.e,
            scale=ScaleOfConditions.of(found.contrasts, found.whitened, along, direction),
        )

    def check_firm(self, equations: ConditionEquations, spread: Array) -> None:
        """Complain of conditions free of error that something else free of error holds already.

        Parameters
        ----------
        equations
            Theirs, at the state of `spread`.
        spread
            (q, q) cofactors of the contrasts without the conditions, in standard deviations: by
            their scale alone they do not tell what depends, for those of conditions free of error
            are so large that rounding hides a unit matrix beside them.

        Raises
        ------
        NotComputableError
            Some are; names the conditions.
        """
        row = equations.owner
        of_contrast, firm = self.of_row[row], np.flatnonzero(self.firm[row])
        size = np.diag(spread)[firm]
        held = size < 1.0 / _HELD
        if not held.any() and len(firm):
            part = spread[np.ix_(firm, firm)] / np.sqrt(size[:, None] * size)
            if np.isfinite(part).all() and np.linalg.eigvalsh(part)[0] < _DEPENDENT:
                values, vectors = np.linalg.eigh(part)
                held = (vectors[:, values < _DEPENDENT] ** 2).sum(axis=1) > _HELD
        if held.any():
            of = of_contrast[firm[held]]
            names = dict.fromkeys(self.conditions[k].id for k in of.tolist())
            what = "depends" if len(names) == 1 else "depend"
            raise NotComputableError(
                f"{', '.join(names)}: free of error, but {what} on what is free of error already: "
                "other conditions or control"
            )

    def rounding(self, points: Array) -> float:
        """Return the squared norm of what rounding does to the misclosures, in sigmas."""
        total = 0.0
        for one, at, count in zip(
            self.conditions, self.points, np.bincount(self.of_row).tolist(), strict=True
        ):
            size = 2.0 * _EPS * float(np.abs(points[at]).max())
            if one.kind == "angle":
                size /= float(np.linalg.norm(points[at[[0, 2]]] - points[at[1]], axis=1).min())
            total += count * (size / _sigma(one, points[at])) ** 2
        return total


class LaidOut(NamedTuple):
    """Conditions whose points were found.

    Attributes
    ----------
    conditions
        Those that take part; None where none does.
    compared
        Those that are compared only, or off.
    left_out
        Ids of those that cannot take part, and why.
    """

    conditions: Conditions | None
    compared: Conditions | None
    left_out: list[tuple[str, str]]


def lay_out_conditions(
    conditions: Sequence[ObjectCondition],
    points: Sequence[str],
    fixed: Bools,
    *,
    with_scale: bool,
    scaling: bool = False,
) -> LaidOut:
    """Find the points of conditions.

    Parameters
    ----------
    conditions
        Of a block.
    points
        Names of the p points that are determined.
    fixed
        (p, 3) which coordinates are free of error.
    with_scale
        Whether lengths take part; in a datum without scale only what is of shape alone does:
        angles, and lines, planes and equal distances free of error.
    scaling
        Whether distances give a datum without scale the one that it lacks.

    Raises
    ------
    InputError
        A condition free of error between coordinates free of error; too many rows.
    """
    index = {name: k for k, name in enumerate(points)} if conditions else {}
    used, compared, left = [], [], []
    scaling = scaling and any(
        one.kind == "distance"
        and one.use == "control"
        and all(name in index for name in one.points)
        for one in conditions
    )
    with_scale = with_scale or scaling
    for one in conditions:
        missing = next((name for name in one.points if name not in index), None)
        if missing is not None:
            left.append((one.id, f"names point {missing}, which is not determined by the images"))
            continue
        if one.use != "control" or not (with_scale or _of_shape(one)):
            compared.append(one)
            continue
        if one.sigma == 0.0 and fixed[[index[name] for name in one.points]].all():
            raise InputError(f"{one.id}: free of error, and so is the control of all its points")
        used.append(one)
    return LaidOut(_conditions(used, index, scaling), _conditions(compared, index), left)


def _of_shape(one: ObjectCondition) -> bool:
    """Whether a condition means the same at every scale."""
    return one.kind == "angle" or (one.kind != "distance" and one.sigma == 0.0)


def _conditions(
    some: Sequence[ObjectCondition], index: Mapping[str, int], scaling: bool = False
) -> Conditions | None:
    if not some:
        return None
    at = tuple(np.array([index[name] for name in one.points], dtype=np.intp) for one in some)
    count = sum(len(_rows_of(one)) for one in some)
    if count > MOST_CONDITION_ROWS:
        raise InputError(f"{count} rows of conditions: at most {MOST_CONDITION_ROWS}")
    return Conditions(tuple(some), at, np.zeros(count, dtype=bool), scaling)


def _sigma(one: ObjectCondition, at: Array) -> float:
    if one.sigma > 0.0:
        return one.sigma
    return _FIRM * (1.0 if one.kind == "angle" else float(np.ptp(at, axis=0).max()))


class _Raw(NamedTuple):
    """Rows of a condition: misclosures, (row, point within it, (3,) derivative), parameters."""

    misclosure: Array
    derivatives: list[tuple[int, int, Array]]
    shared: Array


@dataclass(frozen=True, eq=False)
class _Part:
    """One condition's rows of the equations."""

    misclosure: Array
    sigma: Array
    contrasts: Array
    spanned: Array
    rows: Index
    columns: Index
    values: Array

    @classmethod
    def of(
        cls,
        one: ObjectCondition,
        raw: _Raw,
        at: Index,
        places: Array,
        counts: Bools,
        fixed: Bools,
    ) -> _Part:
        n = len(raw.misclosure)
        use = np.flatnonzero(counts)
        contrasts, spanned = np.eye(n)[:, use], np.zeros((n, 0))
        misclosure = raw.misclosure
        if raw.shared.shape[1] and len(use):
            left, size, _ = np.linalg.svd(raw.shared[use], full_matrices=True)
            rank = int((size > _RANK * size[0]).sum())
            spanned, contrasts = np.zeros((n, rank)), np.zeros((n, len(use) - rank))
            spanned[use], contrasts[use] = left[:, :rank], left[:, rank:]
            # rows of weight zero are measured from what the others fit
            fitted = np.linalg.lstsq(raw.shared[use], misclosure[use], rcond=_RANK)[0]
            misclosure = misclosure - raw.shared @ fitted
        rows, point, values = [], [], []
        for row, which, derivative in raw.derivatives:
            rows += [row] * 3
            point += [at[which]] * 3
            values.append(np.where(fixed[at[which]], 0.0, derivative))
        columns = 3 * np.array(point, dtype=np.intp) + np.tile(np.arange(3), len(point) // 3)
        return cls(
            misclosure,
            np.full(n, _sigma(one, places)),
            contrasts,
            spanned,
            np.array(rows, dtype=np.intp),
            columns,
            np.concatenate(values),
        )


def _difference(
    one: ObjectCondition, places: Array, first: int, second: int, least: float
) -> tuple[float, Array]:
    """Return the distance between two points, and the direction from the first to the second."""
    step = places[second] - places[first]
    length = float(np.linalg.norm(step))
    if not length > least:
        raise NotComputableError(
            f"{one.id}: points {one.points[first]} and {one.points[second]} coincide"
        )
    return length, step / length


def _distance(one: ObjectCondition, places: Array, counts: Bools, least: float) -> _Raw:
    assert one.value is not None
    length, along = _difference(one, places, 0, 1, least)
    return _Raw(np.array([length - one.value]), [(0, 0, -along), (0, 1, along)], np.zeros((1, 0)))


def _angle(one: ObjectCondition, places: Array, counts: Bools, least: float) -> _Raw:
    assert one.value is not None
    first, u = _difference(one, places, 1, 0, least)
    second, v = _difference(one, places, 1, 2, least)
    sine, cosine = float(np.linalg.norm(np.cross(u, v))), float(u @ v)
    if not sine > _APART:
        raise NotComputableError(f"{one.id}: its points lie on one line: no angle can be adjusted")
    at_first = (cosine * u - v) / (first * sine)
    at_second = (cosine * v - u) / (second * sine)
    misclosure = np.arctan2(sine, cosine) - one.value
    derivatives = [(0, 0, at_first), (0, 1, -at_first - at_second), (0, 2, at_second)]
    return _Raw(np.array([misclosure]), derivatives, np.zeros((1, 0)))


def _equal(one: ObjectCondition, places: Array, counts: Bools, least: float) -> _Raw:
    n = len(places) // 2
    found = [_difference(one, places, 2 * k, 2 * k + 1, least) for k in range(n)]
    derivatives = []
    for k, (_, along) in enumerate(found):
        derivatives += [(k, 2 * k, -along), (k, 2 * k + 1, along)]
    return _Raw(np.array([length for length, _ in found]), derivatives, np.ones((n, 1)))


def _frame(places: Array, keep: Bools, enough: int) -> tuple[Array, Array, Array]:
    """Return (n, 3) points from the middle of those kept, principal axes and their lengths."""
    some = places[keep] if int(keep.sum()) >= enough else places
    middle = some.mean(axis=0)
    away = places - middle
    # rows of zeros: three axes of two points, too
    _, lengths, axes = np.linalg.svd(np.vstack((some - middle, np.zeros((3, 3)))), False)
    # of two directions the one with its largest component positive
    largest = np.abs(axes).argmax(axis=1)
    axes = axes * np.sign(axes[np.arange(3), largest])[:, None]
    return away, axes, lengths


def _line(one: ObjectCondition, places: Array, counts: Bools, least: float) -> _Raw:
    n = len(places)
    away, axes, lengths = _frame(places, counts[::2] | counts[1::2], 2)
    if not lengths[0] > least:
        raise NotComputableError(f"{one.id}: its points coincide")
    along = axes[0]
    level = np.array((along[1], -along[0], 0.0))
    if np.hypot(level[0], level[1]) < _THIN:
        level = np.array((1.0, 0.0, 0.0)) - along[0] * along
    across = level / np.linalg.norm(level)
    up = np.cross(across, along)
    shared, derivatives = np.zeros((2 * n, 4)), []
    position = away @ along / lengths[0]
    for k, side in enumerate((across, up)):
        shared[k::2, 2 * k], shared[k::2, 2 * k + 1] = 1.0, position
        derivatives += [(2 * point + k, point, side) for point in range(n)]
    misclosure = np.stack((away @ across, away @ up), axis=1).ravel()
    return _Raw(misclosure, derivatives, shared)


def _plane(one: ObjectCondition, places: Array, counts: Bools, least: float) -> _Raw:
    n = len(places)
    away, axes, lengths = _frame(places, counts, 3)
    if not lengths[0] > least:
        raise NotComputableError(f"{one.id}: its points coincide")
    if not lengths[1] > _THIN * lengths[0]:
        raise NotComputableError(f"{one.id}: its points lie on a line: they determine no plane")
    shared = np.column_stack((np.ones(n), away @ axes[:2].T / lengths[0]))
    return _Raw(away @ axes[2], [(point, point, axes[2]) for point in range(n)], shared)


_MISCLOSURES = {
    "distance": _distance,
    "angle": _angle,
    "equal": _equal,
    "line": _line,
    "plane": _plane,
}
