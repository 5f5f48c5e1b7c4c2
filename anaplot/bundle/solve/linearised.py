"""A bundle linearised at a state: whitened derivatives and misclosures of every observation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.conditions import ConditionEquations
from anaplot.bundle.solve.givenequations import GivenEquations, given_equations, prior_rounding
from anaplot.bundle.solve.imaging import BlockState, Imaged, imaged, imaged_with_derivatives
from anaplot.bundle.solve.offsetequations import OffsetEquations, best_offsets
from anaplot.bundle.solve.problem import Problem
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.collinearity import turns
from anaplot.photogrammetry.rotation import angle_derivatives, rotation_angles, wrapped

__all__ = [
    "BesideRays",
    "Linearised",
    "Unknowns",
    "beside_misclosures",
    "beside_rays",
    "counted_misclosures",
    "effect",
    "effects",
    "image_misclosures",
    "linearise",
    "move",
    "objective",
    "point_rows",
    "rounding",
]

Unknowns = tuple[Array, Array, Array]  # of photos (n, d), of points (p, 3), shared (g,)

_AT_ONCE = 8192  # rays that are looked at together: their arrays stay near the processor


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Whitened derivatives and misclosures at a state: rows are divided by their sigmas.

    Attributes
    ----------
    a
        (m, 2, d) with respect to the ray's photo.
    b
        (m, 2, 3) with respect to its point; columns of coordinates free of error are zero.
    h
        (m, 2, q) with respect to the additional parameters of its group; q = 0 when they are
        photo-invariant or none.
    e
        (m, 2) computed minus observed.
    point_weight, point_e
        (2, points, 3) weights of control and of the points' priors, and their whitened misclosures.
    photo_rows, photo_e
        (photos, 6, d) rows of the priors of every photo (zero where there is none) and (photos, 6)
        their misclosures; offsets that photos share are the best ones.
    own_e, shared_e
        Misclosures of the priors on additional parameters.
    own_weight, shared_weight
        Their weights.
    depth
        (m,) distance of the point in front of the photo [m].
    conditions
        Of the conditions between points; None without.
    given
        Of the prior that an earlier adjustment leaves; None without.
    offsets
        What the photos' priors have in common, eliminated; None without.
    """

    a: Array
    b: Array
    h: Array
    e: Array
    point_weight: Array
    point_e: Array
    photo_rows: Array
    photo_e: Array
    own_weight: Array
    own_e: Array
    shared_weight: Array
    shared_e: Array
    depth: Array
    conditions: ConditionEquations | None = None
    given: GivenEquations | None = None
    offsets: OffsetEquations | None = None

    @property
    def vtpv(self) -> float:
        """Weighted sum of squares of all misclosures."""
        return sum(float(np.vdot(e, e)) for e in self.misclosures)

    @property
    def misclosures(self) -> tuple[Array, ...]:
        """Of every kind of observation."""
        others = (self.conditions, self.given, self.offsets)
        more = tuple(of.e for of in others if of is not None)
        return (self.e, self.point_e, self.photo_e, self.own_e, self.shared_e, *more)


class BesideRays(NamedTuple):
    """What holds photos and points beside the rays; its parts are those of `Linearised`."""

    point_weight: Array
    photo_rows: Array
    given: GivenEquations | None
    offsets: OffsetEquations | None


def _angles(rotations: Array) -> Array:
    return np.array([rotation_angles(r) for r in rotations]).reshape(-1, 3)


def _photo_misclosures(problem: Problem, state: BlockState) -> tuple[Array, OffsetEquations | None]:
    """(photos, 6) whitened misclosures of what is stated of photos, and their best offsets."""
    off = state.centres - (problem.position - state.origin)
    if problem.lever_arm is not None:
        off += _arms(problem.lever_arm, state)
    if problem.offsets is not None:
        stated, sigma = problem.rotation, problem.prior_sigma
        offsets, out = best_offsets(problem.offsets, off, state.rotations, stated, sigma)
        return out, offsets
    photo = np.zeros((len(problem.photos), 6))
    with_position = np.isfinite(problem.position_sigma)
    if with_position.any():
        photo[:, :3] = np.where(with_position, off / problem.position_sigma, 0.0)
    with_rotation = np.isfinite(problem.rotation_sigma).any(axis=1)
    if with_rotation.any():
        found = _angles(state.rotations[with_rotation])
        off = wrapped(found - problem.rotation[with_rotation])
        sigma = problem.rotation_sigma[with_rotation]
        photo[with_rotation, 3:] = np.where(np.isfinite(sigma), off / sigma, 0.0)
    return photo, None


def _arms(lever_arm: Array, state: BlockState) -> Array:
    """(photos, 3) from projection centres to antennas, in the ground's axes [m]."""
    return np.asarray(np.einsum("nij,nj->ni", state.rotations, lever_arm))


def _prior_misclosures(problem: Problem, state: BlockState) -> tuple[Array, Array, Array]:
    """Whitened misclosures: control and priors of points, of additional parameters."""
    sigmas = problem.ground_sigma
    off = (state.points - (problem.ground - state.origin)) / sigmas
    point = np.where(np.isfinite(sigmas), off, 0.0)
    own, shared = np.zeros_like(state.own), np.zeros_like(state.shared)
    if len(problem.additional_sigma):
        given, sigma = problem.additional_given, problem.additional_sigma
        own = (state.own - given) / sigma if state.own.size else own
        if shared.size:
            shared = (state.shared - given.ravel()) / sigma.ravel()
    return point, own, shared


def image_misclosures(problem: Problem, state: BlockState) -> tuple[Array, Array]:
    """Return (m, 2) computed minus observed in sigmas, also of rejected ones; (m,) depths [m]."""
    seen = imaged(problem, state)
    e = np.subtract(seen.xy, problem.xy, out=seen.xy)
    e /= problem.sigma_xy
    return e, seen.depth


def counted_misclosures(problem: Problem, state: BlockState) -> tuple[Array, Array]:
    """Return `image_misclosures` with zeros for rejected ones, as `linearise` has them."""
    e, depth = image_misclosures(problem, state)
    if problem.rejected is not None:
        e[problem.rejected] = 0.0
    return e, depth


def objective(problem: Problem, state: BlockState) -> tuple[float, Array]:
    """Return v'Pv at a state, and the depth of every ray's point [m].

    Infinite where a condition means nothing, as where its points coincide: `linearise` says which.
    """
    e, depth = counted_misclosures(problem, state)
    total = float(np.vdot(e, e))
    photo, offsets = _photo_misclosures(problem, state)
    for part in (photo, *_prior_misclosures(problem, state)):
        total += float(np.vdot(part, part))
    if offsets is not None:
        total += float(offsets.e @ offsets.e)
    try:
        conditions = _condition_equations(problem, state)
    except NotComputableError:
        return float("inf"), depth
    if conditions is not None:
        total += float(np.vdot(conditions.e, conditions.e))
    given = _given_equations(problem, state)
    if given is not None:
        total += float(np.vdot(given.e, given.e))
    return (total if total == total else float("inf")), depth


def beside_misclosures(problem: Problem, state: BlockState) -> tuple[Array, Array]:
    """Return (photos, 6) and (2, points, 3) misclosures of what is stated of photos and points.

    Whitened, as `linearise` has them.
    """
    return _photo_misclosures(problem, state)[0], _prior_misclosures(problem, state)[0]


def _condition_equations(problem: Problem, state: BlockState) -> ConditionEquations | None:
    if problem.conditions is None:
        return None
    return problem.conditions.equations(state.points, problem.fixed)


def _given_equations(problem: Problem, state: BlockState) -> GivenEquations | None:
    if problem.given is None:
        return None
    return given_equations(problem.given, state, problem.fixed, problem.per_photo)


def point_rows(problem: Problem, state: BlockState) -> tuple[Array, Array]:
    """Return (m, 2, 3) derivatives of rays with respect to their points, and (m, 2) misclosures.

    As `linearise` has them, without all the rest.
    """
    weight = 1.0 / problem.sigma_xy
    return _point_rows(problem, imaged_with_derivatives(problem, state, weight=weight), weight)


def _point_rows(problem: Problem, seen: Imaged, weight: Array) -> tuple[Array, Array]:
    """Return `point_rows` of derivatives that are weighted already."""
    b = seen.point
    if problem.fixed.any():
        b *= ~problem.fixed[problem.point][:, None, :]
    e = np.subtract(seen.xy, problem.xy, out=seen.xy)
    e *= weight
    if problem.rejected is not None:
        b[problem.rejected] = 0.0
        e[problem.rejected] = 0.0
    return b, e


def linearise(problem: Problem, state: BlockState) -> Linearised:
    """Return derivatives and misclosures at a state."""
    weight = 1.0 / problem.sigma_xy
    seen = imaged_with_derivatives(problem, state, weight=weight)
    n, m = len(problem.photos), len(problem.photo)
    white = seen.parameter
    if problem.additional_still is not None:
        white *= ~problem.additional_still[problem.additional_group][:, None, :]
    a, h = seen.photo, white
    if problem.photo_invariant:
        a, h = np.concatenate((a, white), axis=2), np.empty((m, 2, 0))
    b, e = _point_rows(problem, seen, weight)
    if problem.rejected is not None:
        for part in (a, h):
            part[problem.rejected] = 0.0
    point_e, own_e, shared_e = _prior_misclosures(problem, state)
    photo_e, offsets = _photo_misclosures(problem, state)
    prior = np.zeros((len(problem.additional_groups), seen.parameter.shape[2]))
    if len(problem.additional_sigma):
        prior = problem.additional_sigma**-2.0
    return Linearised(
        a=a,
        b=b,
        h=h,
        e=e,
        point_weight=_point_weight(problem),
        point_e=point_e,
        photo_rows=_photo_rows(problem, state, offsets),
        photo_e=photo_e,
        own_weight=prior if problem.photo_invariant else np.zeros((n, 0)),
        own_e=own_e,
        shared_weight=np.zeros(0) if problem.photo_invariant else prior.ravel(),
        shared_e=shared_e,
        depth=seen.depth,
        conditions=_condition_equations(problem, state),
        given=_given_equations(problem, state),
        offsets=offsets,
    )


def beside_rays(problem: Problem, state: BlockState) -> BesideRays:
    """Return what holds photos and points at a state beside the rays, as `linearise` has it."""
    offsets = _photo_misclosures(problem, state)[1]
    rows = _photo_rows(problem, state, offsets)
    return BesideRays(_point_weight(problem), rows, _given_equations(problem, state), offsets)


def _point_weight(problem: Problem) -> Array:
    """(2, points, 3) weights of control and of the points' priors."""
    return np.asarray(np.nan_to_num(problem.ground_sigma**-2.0))


def _photo_rows(problem: Problem, state: BlockState, offsets: OffsetEquations | None) -> Array:
    """(photos, 6, d) whitened rows of the priors of photos; zero where there is none."""
    rows = np.zeros((len(problem.photos), 6, problem.per_photo))
    with_position = np.isfinite(problem.position_sigma)
    for axis in range(3):
        rows[:, axis, axis] = np.where(
            with_position[:, axis], 1.0 / problem.position_sigma[:, axis], 0.0
        )
    if problem.lever_arm is not None:
        # a small rotation t takes the arm a to a + t x a
        turned = np.cross(_arms(problem.lever_arm, state)[:, None, :], np.eye(3))
        rows[:, :3, 3:6] = np.diagonal(rows[:, :3, :3], axis1=1, axis2=2)[:, :, None] * turned
    seen_by = _boresighted(offsets, state)
    for k in np.nonzero(np.isfinite(problem.rotation_sigma).any(axis=1))[0]:
        weighted = angle_derivatives(seen_by[k]) / problem.rotation_sigma[k][:, None]
        rows[k, 3:, 3:6] = np.where(np.isfinite(weighted), weighted, 0.0)
    return rows


def _boresighted(offsets: OffsetEquations | None, state: BlockState) -> Array:
    """(photos, 3, 3) rotations whose angles are stated."""
    return state.rotations if offsets is None else offsets.boresighted(state.rotations)


def effect(problem: Problem, linear: Linearised, unknowns: Unknowns) -> Linearised:
    """Return what changes of the unknowns do to every observation, in place of the misclosures."""
    photos, points, shared = unknowns
    columns = photos[:, :, None], points[:, :, None], shared[:, None]
    return _effect(linear, unknowns, _of_rays(problem, linear, columns)[0])


def effects(problem: Problem, linear: Linearised, unknowns: Unknowns) -> list[Linearised]:
    """Return the `effect` of each of k changes: photos (n, d, k), points (p, 3, k), shared (g, k).

    Whatever is large is laid out for all of them at once.
    """
    photos, points, shared = unknowns
    every = _of_rays(problem, linear, unknowns)
    return [
        _effect(linear, (photos[:, :, k], points[:, :, k], shared[:, k]), e)
        for k, e in enumerate(every)
    ]


def _of_rays(problem: Problem, linear: Linearised, unknowns: Unknowns) -> Array:
    """(k, m, 2) what k changes of the unknowns do to the rays."""
    photos, points, shared = unknowns
    m, k = len(problem.photo), photos.shape[2]
    parts = [(linear.a, photos, problem.photo), (linear.b, points, problem.point)]
    if len(shared):
        of_groups = shared.reshape(-1, linear.h.shape[2], k)
        parts.append((linear.h, of_groups, problem.additional_group))
    # a row for every unknown, so that one operation takes that of all rays
    laid = [np.ascontiguousarray(values.transpose(2, 1, 0)) for _, values, _ in parts]
    out = np.zeros((k, m, 2))
    for start in range(0, m, _AT_ONCE):
        rays = slice(start, start + _AT_ONCE)
        for (rows, _, owner), values in zip(parts, laid, strict=True):
            each, of = np.ascontiguousarray(rows[rays].transpose(1, 2, 0)), owner[rays]
            for e, own in zip(out, values, strict=True):
                mine = own.take(of, axis=1)
                for axis in range(2):
                    e[rays, axis] += np.einsum("jm,jm->m", each[axis], mine)
    return out


def _effect(linear: Linearised, unknowns: Unknowns, e: Array) -> Linearised:
    """Return an `effect` of which that on the rays is known."""
    photos, points, shared = unknowns
    photo_e, offsets = np.einsum("nij,nj->ni", linear.photo_rows, photos), linear.offsets
    if offsets is not None:
        photo_e, own = offsets.without(photo_e, np.zeros(len(offsets.e)))
        offsets = offsets.with_e(own)
    return replace(
        linear,
        e=e,
        point_e=np.sqrt(linear.point_weight) * points,
        photo_e=photo_e,
        own_e=np.sqrt(linear.own_weight) * photos[:, 6:],
        shared_e=np.sqrt(linear.shared_weight) * shared,
        conditions=None if linear.conditions is None else linear.conditions.effect(points),
        given=None if linear.given is None else linear.given.effect(photos, points),
        offsets=offsets,
    )


def rounding(problem: Problem, state: BlockState, depth: Array) -> float:
    """Return the squared norm of what rounding does to the misclosures, in a-priori sigmas.

    Parameters
    ----------
    problem, state
        The bundle, and where it is evaluated.
    depth
        (m,) of the rays there [m].
    """
    away = _largest(state.points)[problem.point]
    away += _largest(state.centres)[problem.photo]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        image = problem.c[problem.photo] * (1.0 + away / np.abs(depth))
        size = (image + _largest(problem.xy)) / np.minimum(*problem.sigma_xy.T)
        of_points = np.abs(state.points) / problem.ground_sigma
        of_photos = np.abs(state.centres) / problem.position_sigma
    total = 2.0 * float(np.vdot(size, size))
    total += float(np.nansum(of_points**2)) + float(np.nansum(of_photos**2))
    if problem.conditions is not None:
        total += problem.conditions.rounding(state.points) / float(np.finfo(np.float64).eps) ** 2
    if problem.given is not None:
        total += prior_rounding(problem.given, state)
    return total * float(np.finfo(np.float64).eps) ** 2


def _largest(values: Array) -> Array:
    """(n,) largest of abs(values) (n, k), many times as quick as along the short axis."""
    return np.asarray(reduce(np.maximum, map(np.abs, values.T)))


def move(state: BlockState, photos: Array, points: Array, shared: Array) -> BlockState:
    """Add corrections: (photos, d), (points, 3) and (g,)."""
    return BlockState(
        centres=state.centres + photos[:, :3],
        rotations=turns(photos[:, 3:6]) @ state.rotations,
        points=state.points + points,
        own=state.own + photos[:, 6:],
        shared=state.shared + shared,
        origin=state.origin,
    )
