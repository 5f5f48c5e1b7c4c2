"""A strip on its control: similarity, then conformal polynomials along the strip.

The measurements stay as they are: model coordinates of the bridged strip are transformed as a
whole. Degree 1 is the spatial similarity. Degree 2 and 3 add, with u along the strip's axis and v
across it, both scaled to half the strip's length, (a_k + i b_k) (u + iv)^k in plan, which keeps
angles (Schut 1961), and c_k u^k + t_k u^(k-1) v in height: bend and twist.

The errors of a strip's models add up and bend it. What lays it best as a whole is an adjustment by
weights as if every point had the errors of a single model; but the test takes the covariance that
these errors have at the control (`stripgeometry`). It compares every coordinate with what all
others let one expect, the bend included, so that no control is accused for that.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Literal

import numpy as np

from anaplot.adjustment.correlatedrows import correlated_units, residual_weight
from anaplot.adjustment.leastsquares import Adjustment, adjust
from anaplot.adjustment.tested import Tested, examine
from anaplot.aliases import Array, Bools
from anaplot.errors import NotComputableError
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.stripgeometry import StripGeometry, extended, widened
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.photogrammetry.collinearity import turns
from anaplot.photogrammetry.exchangedpoints import likely_exchange
from anaplot.photogrammetry.similarity import (
    Similarity,
    agreeing_sets,
    fit_similarity,
    fit_to_partial,
    moved_similarity,
    robust_similarity,
    similarity_effects,
)

__all__ = ["Degree", "FittedPoint", "StripFit", "fit_models", "fit_strip", "measured_control"]

Degree = Literal[1, 2, 3]
_AXES = ("X", "Y", "Z")
_SEVEN = ("X0", "Y0", "Z0", "omega", "phi", "kappa", "scale")
_STEPS = 60
_HALVED = 12  # times at most, a step that leads uphill
_UNHELD = 0.01  # of a strip's length: a standard deviation that is none
_SMALL = 1e-6  # of a standard deviation


@dataclass(frozen=True, slots=True)
class FittedPoint:
    """A control or check point on the strip.

    Attributes
    ----------
    point
        Name.
    used
        Whether it took part.
    difference
        Transformed minus given X, Y, Z [m]; None where a coordinate is not known.
    r
        Mean redundancy number of its coordinates, each given all others; None where it took no
        part.
    w
        That of its coordinates with the largest abs(w); None where none can be tested.
    flagged
        Whether one of them is flagged.
    """

    point: str
    used: bool
    difference: tuple[float | None, float | None, float | None]
    r: float | None
    w: float | None
    flagged: bool


@dataclass(frozen=True, slots=True, eq=False)
class StripFit:
    """A strip transformed to the ground.

    Attributes
    ----------
    strip
        Name.
    degree
        Of the polynomials; 1 is the similarity alone.
    similarity
        Strip system [mm] to ground [m].
    polynomials
        Coefficients [m] by name, for u and v scaled to half the strip's length.
    tested
        The control coordinates that took part [m], each given all others, with which the strip's
        errors correlate it: r is what is left of its weight, and the residual r times what it is
        off from what the others let one expect.
    remarks
        Sentences: control points that are interchanged.
    points
        Control and check points of the strip.
    ground
        Every point of the strip with its ground coordinates [m].
    """

    strip: str
    degree: Degree
    similarity: Similarity
    polynomials: Mapping[str, float]
    tested: Tested[tuple[str, str]]
    remarks: tuple[str, ...]
    points: tuple[FittedPoint, ...]
    ground: tuple[tuple[str, float, float, float], ...]

    @property
    def rms(self) -> tuple[float | None, float | None, float | None]:
        """Root mean square of the differences of used points in X, Y, Z [m]."""
        x, y, z = (
            _rms([p.difference[k] for p in self.points if p.used]) for k in range(len(_AXES))
        )
        return x, y, z


def measured_control(block: Block, points: Collection[str]) -> tuple[ControlPoint, ...]:
    """Return the control and check points among measured points, in the order of the file."""
    return tuple(c for c in block.control if c.point in points and c.use != "off")


def fit_models(
    block: Block,
    strip: str,
    models: Sequence[ModelSolution],
    *,
    degree: Degree = 1,
    without: Collection[str] = (),
) -> StripFit:
    """Fit the models of a strip, at least one, to its control; see `fit_strip`.

    A point of two models is taken as the later one, which took it over, has it.

    Raises
    ------
    NotComputableError
        The control does not determine the transformation.
    """
    points = {p.point: (p.X, p.Y, p.Z) for model in models for p in model.points}
    control = {c.point for c in measured_control(block, points)}
    errors = _errors_of(models, control)
    # what is at infinity, or nearly, is nowhere on the ground
    far = {name for name, (*_, z) in points.items() if not isfinite(z)} | control - errors.keys()
    points = {name: at for name, at in points.items() if name not in far}
    base = sum(abs(model.base[0]) for model in models) / len(models)
    return fit_strip(block, strip, points, base, errors, degree=degree, without=without)


def _errors_of(models: Sequence[ModelSolution], names: Collection[str]) -> dict[str, Array]:
    """Return what every image coordinate of a strip's models does to some of its points."""
    geometry: StripGeometry | None = None
    errors: dict[str, Array] = {}
    for model in models:
        assert model.pair is not None  # it was oriented from one
        geometry = extended(geometry, model.pair, model)
        errors |= {name: geometry.points[name].errors for name in names if name in geometry.points}
        # those of all points of a long strip are more than memory holds
        geometry = replace(geometry, points={})
    return errors


def fit_strip(
    block: Block,
    strip: str,
    points: Mapping[str, tuple[float, float, float]],
    base: float,
    errors: Mapping[str, Array] | None = None,
    *,
    degree: Degree = 1,
    without: Collection[str] = (),
) -> StripFit:
    """Fit a strip to its control.

    Parameters
    ----------
    block
        Its control, precision and test.
    strip
        Its name.
    points
        Model coordinates [mm] in the strip system by point.
    base
        Base of its models at photo scale [mm]: heights are worse by c / base.
    errors
        (3, e) what independent errors, each of one sigma0, do to its control points: the first e of
        all that the strip has. None: every point errs by itself, as one of a single model does.
    degree
        Of the polynomials.
    without
        Control points that are compared and do not take part.

    Raises
    ------
    NotComputableError
        The control does not determine the transformation.
    """
    control = measured_control(block, points)
    source = np.array([points[c.point] for c in control]).reshape(-1, 3)
    target = np.array([[np.nan if v is None else v for v in c.xyz] for c in control]).reshape(-1, 3)
    used = np.array([c.use == "control" and c.point not in without for c in control], dtype=bool)
    known = np.isfinite(target) & used[:, None]
    count = int(known.sum())
    names = _SEVEN + tuple(
        f"{what}{k}" for k in range(2, degree + 1) for what in ("a", "b", "c", "t")
    )
    if count < len(names):
        raise NotComputableError(
            f"strip {strip}: {count} control coordinates are measured, degree {degree} needs "
            f"{len(names)}"
        )
    starts = _starts(strip, source[used], target[used])
    everything = np.array(list(points.values()))
    row_names = [(c.point, axis) for c in control for axis in _AXES]
    keys = [row_names[k] for k in np.flatnonzero(known.ravel()).tolist()]
    whole = known.all(axis=1)
    named = [control[k].point for k in np.flatnonzero(whole).tolist()]
    exchanged = _exchanged(named, source[whole], target[whole])
    failure: NotComputableError | None = None
    for start in starts:
        shape = _Shape(start, everything, degree)
        sigma = _sigmas(block, strip, control, base, start.scale)[known]
        try:
            now, free, adjusted, settled = _iterated(
                start, shape, source, target, known, sigma, names
            )
        except NotComputableError as error:
            failure = failure or error
            continue
        # first: what nothing holds turns on without end, or not, as the last digits have it
        _check_held(strip, shape, now, free, adjusted, points)
        if settled:
            break
        failure = failure or NotComputableError("the fit to the control does not converge")
    else:
        why = exchanged or f"{failure}{_disagreeing(named, source[whole], target[whole])}"
        raise NotComputableError(f"strip {strip}: {why}") from failure
    transformed = shape.lay(now, free, source)
    covariance = np.diag(sigma**2)
    if errors is not None:
        moved = _moved([errors[c.point] for c in control], shape.by_strip(now, free, source))
        bending = 1e-3 * block.precision.image_um * moved[known]
        covariance = bending @ bending.T + np.diag(_given_sigmas(block, control)[known] ** 2)
    units = correlated_units(covariance)
    weight = residual_weight(covariance, shape.effects(now, free, source)[known])
    weighted = weight @ (transformed - target)[known]
    tested = examine(
        keys,
        ["m"] * count,
        units**2 * weighted,
        np.maximum(units**2 * weight.diagonal(), 0.0),
        units,
        # by rounding below zero, where nothing is left
        vtpv=max(float((transformed - target)[known] @ weighted), 0.0),
        redundancy=count - len(names),
        test=block.test,
        rounding=1e-9,
    )
    ground = shape.lay(now, free, everything)
    return StripFit(
        strip=strip,
        degree=degree,
        similarity=now,
        polynomials=dict(zip(names[len(_SEVEN) :], free.tolist(), strict=True)),
        tested=tested,
        remarks=() if exchanged is None else (exchanged,),
        points=_points(control, used.tolist(), transformed - target, tested),
        ground=tuple((name, *at) for name, at in zip(points, ground.tolist(), strict=True)),
    )


def _iterated(
    start: Similarity,
    shape: _Shape,
    source: Array,
    target: Array,
    known: Bools,
    sigma: Array,
    names: tuple[str, ...],
) -> tuple[Similarity, Array, Adjustment, bool]:
    """Return similarity, coefficients of the polynomials, last adjustment, whether they settled.

    A step that would increase the sum of squares is halved until it does not.
    """

    def misclosures(at: Similarity, free: Array) -> Array:
        return np.asarray((shape.lay(at, free, source) - target)[known] / sigma)

    now, free = start, np.zeros(len(names) - len(_SEVEN))
    off = misclosures(now, free)
    for _ in range(_STEPS):
        design = shape.effects(now, free, source)[known]
        adjusted = adjust(design / sigma[:, None], off, np.ones(len(sigma)), unknowns=names)
        step, square = adjusted.x, float(off @ off)
        deviations = np.sqrt(np.diag(adjusted.q_xx)) * max(1.0, adjusted.sigma0 or 0.0)
        if float(np.abs(step / deviations).max()) < _SMALL:
            moved = moved_similarity(now, shape.middle, step)
            return moved, free + step[len(_SEVEN) :], adjusted, True
        for _ in range(_HALVED):
            moved, bent = moved_similarity(now, shape.middle, step), free + step[len(_SEVEN) :]
            off = misclosures(moved, bent)
            if float(off @ off) <= square:
                break
            step = 0.5 * step
        now, free = moved, bent
    return now, free, adjusted, False


def _check_held(
    strip: str,
    shape: _Shape,
    now: Similarity,
    free: Array,
    adjusted: Adjustment,
    points: Mapping[str, tuple[float, float, float]],
) -> None:
    """Raise where next to nothing holds a part of the strip: it would turn about a line of control.

    What noise puts beside that line holds it, and means nothing.
    """
    effects = shape.effects(now, free, np.array(list(points.values())))
    variances = np.einsum("nip,pq,niq->ni", effects, adjusted.q_xx, effects)
    worst = np.sqrt(np.maximum(variances.max(axis=1), 0.0))
    k = int(np.argmax(worst))
    if worst[k] > _UNHELD * shape.length:
        raise NotComputableError(
            f"strip {strip}: not determined: by its control point {list(points)[k]} is known to "
            f"{worst[k]:.0f} m only; does the control lie on one line?"
        )


def _exchanged(names: Sequence[str], source: Array, target: Array) -> str | None:
    """Say which two control points are interchanged, of those of which all is known."""
    found = likely_exchange(
        names, source, target, "the strip", lambda fitted: fitted.rotation[2, 2] < 0.0
    )
    return None if found is None else found.text


def _disagreeing(names: Sequence[str], source: Array, target: Array) -> str:
    """Say which control points do not lie to the others as the strip has them; "": nobody knows."""
    (inside, *_) = agreeing_sets(source, target, 1) or [np.ones(len(names), dtype=bool)]
    others = [names[k] for k in np.flatnonzero(~inside).tolist()]
    if not others:
        return ""
    return (
        f"; without {', '.join(others)} the other {len(names) - len(others)} control points agree "
        "best"
    )


class _Shape:
    """The polynomials of a strip: how each of their coefficients moves points on the ground."""

    def __init__(self, similarity: Similarity, points: Array, degree: int) -> None:
        ground = similarity.apply(points)
        self.middle = ground.mean(axis=0)
        plan = ground[:, :2] - self.middle[:2]
        along = np.linalg.svd(plan, full_matrices=False)[2][0]
        self._along = along
        self._half = max(float(np.abs(plan @ along).max()), 1e-12)
        self._degree = degree

    @property
    def length(self) -> float:
        """Length of the strip [m]."""
        return 2.0 * self._half

    def _scaled(self, ground: Array) -> tuple[Array, Array]:
        """Return u and v, along and across the strip from its middle, in half its length."""
        plan, (ex, ey) = (ground[:, :2] - self.middle[:2]) / self._half, self._along
        return plan @ self._along, plan @ np.array([-ey, ex])

    def lay(self, similarity: Similarity, free: Array, points: Array) -> Array:
        """Return (n, 3) points of the strip on the ground, bent by their coefficients."""
        ground = similarity.apply(points)
        return np.asarray(ground + self.bend(ground) @ free)

    def bend(self, ground: Array) -> Array:
        """Return (n, 3, 4 (degree - 1)): effects of the coefficients a, b, c, t of each degree."""
        (ex, ey), (u, v) = self._along, self._scaled(ground)
        out = np.zeros((len(ground), 3, 4 * (self._degree - 1)))
        for k in range(2, self._degree + 1):
            power = (u + 1j * v) ** k
            at = 4 * (k - 2)
            # a: real part along, imaginary part across; b: turned by a right angle
            for column, (du, dv) in enumerate(
                ((power.real, power.imag), (-power.imag, power.real))
            ):
                out[:, 0, at + column] = ex * du - ey * dv
                out[:, 1, at + column] = ey * du + ex * dv
            out[:, 2, at + 2] = u**k
            out[:, 2, at + 3] = u ** (k - 1) * v
        return out

    def effects(self, similarity: Similarity, free: Array, points: Array) -> Array:
        """Return (n, 3, 7 + 4 (degree - 1)): how all unknowns move points of the strip."""
        ground = similarity.apply(points)
        moves = self.slopes(ground, free) @ similarity_effects(ground - self.middle)
        return np.concatenate([moves, self.bend(ground)], axis=2)

    def by_strip(self, similarity: Similarity, free: Array, points: Array) -> Array:
        """Return (n, 3, 3): how points that are laid move with their strip coordinates."""
        turned = similarity.scale * similarity.rotation
        return np.asarray(self.slopes(similarity.apply(points), free) @ turned)

    def slopes(self, ground: Array, free: Array) -> Array:
        """Return (n, 3, 3): how points that are laid move with where the similarity has them."""
        (ex, ey), (u, v) = self._along, self._scaled(ground)
        out = np.tile(np.eye(3), (len(ground), 1, 1))
        for k in range(2, self._degree + 1):
            a, b, c, t = free[4 * (k - 2) : 4 * (k - 1)] / self._half
            # conformal: plan turns and grows
            turned = (a + 1j * b) * k * (u + 1j * v) ** (k - 1)
            out[:, 0, 0] += turned.real
            out[:, 1, 1] += turned.real
            out[:, 0, 1] -= turned.imag
            out[:, 1, 0] += turned.imag
            along = c * k * u ** (k - 1) + t * (k - 1) * u ** (k - 2) * v
            across = t * u ** (k - 1)
            out[:, 2, 0] += along * ex - across * ey
            out[:, 2, 1] += along * ey + across * ex
        return out


def _starts(strip: str, source: Array, target: Array) -> list[Similarity]:
    """Return similarities to begin with: from whole points, or from plan and heights apart.

    Of whole points first that on which most of them agree, then that of all: where the others are
    far off, no step leads from the one to the other.
    """
    whole = np.isfinite(target).all(axis=1)
    robust = robust_similarity(source[whole], target[whole])
    if robust is not None:
        return [robust[0], fit_similarity(source[whole], target[whole])]
    plan = np.isfinite(target[:, :2]).all(axis=1)
    heights = np.isfinite(target[:, 2])
    one, other = (values[plan, :2] @ np.array([1.0, 1j]) for values in (source, target))
    if len(one) >= 2 and float(np.ptp(source[plan, :2], axis=0).max()) > 0.0 and heights.any():
        centred = one - one.mean()
        factor = np.vdot(centred, other - other.mean()) / np.vdot(centred, centred)
        scale, kappa = float(abs(factor)), float(np.angle(factor))
        rotation = turns(np.array([[0.0, 0.0, kappa]]))[0]
        shift = other.mean() - factor * one.mean()
        height = float(np.mean((target - scale * source)[heights, 2]))
        level = Similarity(scale, rotation, np.array([shift.real, shift.imag, height]))
        found = fit_to_partial(source, target, level)
        if found is not None:
            return [found]
    raise NotComputableError(
        f"strip {strip}: its control does not determine scale, place and inclination (two points "
        "in plan and three heights that are not on one line)"
    )


def _given_sigmas(block: Block, control: Sequence[ControlPoint]) -> Array:
    """(n, 3) standard deviations [m] of control."""
    return np.array([block.sigma_of(point) for point in control]).reshape(-1, 3)


def _sigmas(
    block: Block, strip: str, control: Sequence[ControlPoint], base: float, scale: float
) -> Array:
    """(n, 3) standard deviations [m] of control against points of a single model of a strip."""
    photos = next((one.photos for one in block.strips if one.id == strip), ())
    cameras = (block.camera_of(photo.id) for photo in block.photos if photo.id in photos)
    c = next(cameras, block.cameras[0]).c
    plan = scale * block.precision.image_um * 1e-3
    own = np.array([plan, plan, plan * c / abs(base)])
    sigmas: Array = np.hypot(_given_sigmas(block, control), own)
    return sigmas


def _moved(errors: Sequence[Array], by_strip: Array) -> Array:
    """Return (n, 3, e): what a strip's errors do to points that are laid on the ground."""
    count = max(own.shape[1] for own in errors)
    return np.array([widened(by @ own, count) for own, by in zip(errors, by_strip, strict=True)])


def _points(
    control: Sequence[ControlPoint],
    used: Sequence[bool],
    difference: Array,
    tested: Tested[tuple[str, str]],
) -> tuple[FittedPoint, ...]:
    of_point: dict[str, list[tuple[float, float | None, bool]]] = {}
    for row in tested:
        of_point.setdefault(row.point, []).append((row.r, row.w, row.flagged))
    out = []
    for point, takes_part, d in zip(control, used, difference.tolist(), strict=True):
        rows = of_point.get(point.point, [])
        x, y, z = (None if value != value else value for value in d)
        out.append(
            FittedPoint(
                point.point,
                takes_part,
                (x, y, z),
                sum(r for r, _, _ in rows) / len(rows) if rows else None,
                max((w for _, w, _ in rows if w is not None), key=abs, default=None),
                any(flagged for _, _, flagged in rows),
            )
        )
    return tuple(out)


def _rms(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None
