"""The datum: what control and priors determine, and inner or minimal constraints in their place."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import qr
from scipy.sparse.csgraph import connected_components

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.conditionscale import ScaleOfConditions
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import BesideRays, beside_rays
from anaplot.bundle.solve.offsetequations import best_offsets
from anaplot.bundle.solve.problem import SEVEN, Problem, listed
from anaplot.bundle.solve.reliability import DatumChange
from anaplot.bundle.solve.sorting import distinct
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.similarity import (
    Similarity,
    fit_similarity,
    fit_to_partial,
    similarity_effects,
    without_scale,
)

__all__ = [
    "Anchor",
    "OpenDatumError",
    "anchor",
    "check_datum",
    "components",
    "datum_change",
    "null_space",
    "on_control",
    "priors_hold",
    "relocate",
    "rescaled",
    "scale_of",
    "with_priors_kept",
]


_NAMES = (
    "the shift in X",
    "the shift in Y",
    "the shift in Z",
    "the rotation about X",
    "the rotation about Y",
    "the rotation about Z",
    "the scale",
)
_SCALINGS = 2  # misclosures are linear in the scale: the second time is for rounding
_SCALE = 0.01  # by which approximate values differ from control that they were laid onto
_LOOSE = 0.1  # of the extent, or rad: standard deviation with which priors hold no datum
_NOTHING = 1e-9  # m or rad: what a movement does to something that has no part in it
_OPEN = 1e-5  # the same of a movement that priors leave open, or hold by the rounding of a line
_RANK = 1e-7  # singular value over the largest, in the block's own measure


class OpenDatumError(NotComputableError):
    """Control and priors do not say where the block, or a part of it, lies."""


class Anchor(NamedTuple):
    """Unknowns that take the datum's defect away while the equations are solved.

    Attributes
    ----------
    weights
        (n, d) weights relative to the diagonal of the normal equations.
    unknowns
        (photo, index) of the seven, or of as many as are open.
    """

    weights: Array
    unknowns: tuple[tuple[int, int], ...]


def components(problem: Problem) -> Index:
    """Return the part of the block (numbered from 0) that each photo belongs to.

    Photos hang together through points with at least one unknown coordinate.
    """
    n, p = len(problem.photos), len(problem.points)
    free = ~np.asarray(problem.fixed.all(axis=1))[problem.point]
    graph = sparse.coo_matrix(
        (np.ones(int(free.sum())), (problem.photo[free], n + problem.point[free])),
        shape=(n + p, n + p),
    )
    labels = connected_components(graph, directed=False)[1][:n]
    return np.unique(labels, return_inverse=True)[1].astype(np.intp)


def null_space(problem: Problem, state: BlockState) -> tuple[Array, Array]:
    """Return (n, d, 7) and (p, 3, 7): effect of shift [m], rotation [rad] and scale."""
    photos = np.zeros((len(problem.photos), problem.per_photo, 7))
    photos[:, :3] = similarity_effects(state.centres)
    for axis in range(3):
        photos[:, 3 + axis, 3 + axis] = 1.0
    return photos, similarity_effects(state.points)


def check_datum(problem: Problem, state: BlockState) -> None:
    """Raise NotComputableError when a part of the block hangs in the air; names its photos.

    What control and priors leave open is an OpenDatumError.
    """
    beside = beside_rays(problem, state)
    labels = components(problem)
    count = int(labels.max()) + 1
    point_part = np.empty(len(problem.points), dtype=np.intp)
    point_part[problem.point] = labels[problem.photo]
    for part in range(count):
        mine = np.nonzero(labels == part)[0]
        where = "" if count == 1 else _named_part(problem, mine, count)
        if problem.datum != "control":
            if count > 1:
                raise NotComputableError(
                    f"block {problem.block.name}: it falls into {count} parts without common "
                    f"points, a free datum needs one; {where}"
                )
            return
        # coordinates of fixed points belong to every part that sees them
        seen = distinct(problem.point[labels[problem.photo] == part])
        known = _held(problem, state, beside, mine, seen)
        weak = known.singular < _RANK * max(1.0, float(known.singular[0]))
        if weak.any():
            held = known.coordinates
            share = np.abs(known.right[weak]).max(axis=0)
            what = [name for name, s in zip(_NAMES, share, strict=True) if s > 0.3 * share.max()]
            count_control = int(held.any(axis=1).sum())
            scales = any(
                one.kind == "distance" and one.use == "control" for one in problem.block.conditions
            )
            some_priors = bool(np.isfinite(problem.expected_sigma[seen]).any())
            hint = (
                "there is no control and no prior orientation: adjust --datum free needs "
                "none" + (" and takes the scale from the distances" if scales else "")
                if known.rows == 0
                else "there is no control, and what photos state is only known but for the unknown "
                f"{_unknown_offsets(problem)}"
                if beside.offsets is not None and count_control == 0
                else f"{count_control} control points{' or priors of points' * some_priors}"
                + " or given ones" * (beside.given is not None)
                + (f" ({listed([problem.points[k] for k in seen[held.any(axis=1)]])})"
                   if count_control else "")
                + " do not suffice"
                + (" (distances give a free datum its scale, and no other)" if scales else "")
            )  # fmt: skip
            raise OpenDatumError(
                f"block {problem.block.name}: not determined: {', '.join(what)}; {hint}"
                + (f"; {where}" if where else "")
            )


def _unknown_offsets(problem: Problem) -> str:
    """Return which kinds of offsets there are."""
    names = () if problem.offsets is None else problem.offsets.names
    return ", ".join(kind for kind in dict.fromkeys(name.kind for name in names))


class _Held(NamedTuple):
    """How well each movement of a part of a block is held: shift, rotation and scale.

    Attributes
    ----------
    singular, right
        (7,) and (7, 7) of the movements, which stand in the rows of `right`.
    movements
        (7, 7) what the columns of `null_space` are made up of for them: shifts over the extent,
        rotations and scale about the middle of the part.
    coordinates
        (k, 3) which coordinates of its points are held.
    rows
        How much is stated.
    """

    singular: Array
    right: Array
    movements: Array
    coordinates: Bools
    rows: int


def _held(
    problem: Problem, state: BlockState, others: BesideRays, mine: Index, seen: Index
) -> _Held:
    """Return how control, priors and given coordinates hold some photos and points."""
    photo_null, point_null = null_space(problem, state)
    held = problem.fixed[seen] | (others.point_weight[:, seen] > 0.0).any(axis=0)
    rows = others.photo_rows[mine]
    moved = np.matmul(rows, photo_null[mine])
    left, of_offsets = _beside_offsets(others, moved, mine)
    if others.given is not None:
        held |= others.given.held_points(state.points.shape)[seen] > 0.0
        given = others.given.photo_rows(problem.per_photo)[mine]
        rows = np.concatenate((rows, given), axis=1)
        beside = np.matmul(given, photo_null[mine])
        moved, left = (np.concatenate((part, beside), axis=1) for part in (moved, left))
    present = np.any(rows != 0.0, axis=2)
    # in the block's own measure: metres over its extent, rotations in radians
    extent = float(np.ptp(state.centres[mine], axis=0).max(initial=0.0))
    extent = max(extent, float(np.ptp(state.points[seen], axis=0).max(initial=0.0)), 1e-9)
    size = np.array([extent] * 3 + [1.0] * 4)
    points = point_null[seen][held]
    length = np.linalg.norm(
        np.concatenate((points, moved[present], of_offsets)) * size, axis=1, keepdims=True
    )
    stack = np.concatenate((points, left[present], of_offsets)) * size
    stack = stack / np.where(length > 0.0, length, 1.0)
    middle = state.points[seen].mean(axis=0) / extent
    # shifts refer to the middle of the part, so that they do not mix with the rotations
    base = np.eye(7)
    base[:3, 3:6] = [[0, -middle[2], middle[1]], [middle[2], 0, -middle[0]],
                     [-middle[1], middle[0], 0]]  # fmt: skip
    base[:3, 6] = -middle
    _, singular, right = np.linalg.svd(np.vstack((stack @ base, np.zeros((7, 7)))))
    return _Held(singular, right, size[:, None] * base, held, len(stack))


def _beside_offsets(others: BesideRays, moved: Array, mine: Index) -> tuple[Array, Array]:
    """Return what movements do to photos' priors beside what their offsets take up.

    Parameters
    ----------
    others
        What holds photos beside the rays.
    moved
        (k, 6, 7) what the movements do to the priors of some photos, whitened.
    mine
        (k,) which photos.

    Returns
    -------
    (k, 6, 7) and (q, 7) arrays
        What is left of it, and what the movements are for the q offsets of which something is
        known.
    """
    offsets = others.offsets
    if offsets is None:
        return moved, np.zeros((0, 7))
    every = np.zeros((len(others.photo_rows), 6, 7))
    every[mine] = moved
    own = np.zeros((len(offsets.e), 7))
    taken = offsets.fitted(every, own)[offsets.laid.weighted]
    taken[np.abs(taken).max(axis=1, initial=0.0) < _NOTHING] = 0.0
    return offsets.projected(every, own)[0][mine], taken


def _held_whole(problem: Problem, state: BlockState) -> _Held:
    everything = np.arange(len(problem.photos)), np.arange(len(problem.points))
    return _held(problem, state, beside_rays(problem, state), *everything)


def with_priors_kept(problem: Problem, state: BlockState) -> Problem:
    """Return a bundle whose priors stay observations, as a free network in what they leave open.

    Parameters
    ----------
    problem
        The bundle in the datum of its priors, without conditions between points.
    state
        Where it lies, about.
    """
    singular = _held_whole(problem, state).singular
    left_open = int((singular < _OPEN * max(1.0, float(singular[0]))).sum())
    return replace(problem, datum="free", left_open=left_open) if left_open else problem


def _open_movements(problem: Problem, state: BlockState) -> tuple[Array, Array]:
    """Return (n, d, k) and (p, 3, k): effect of the movements that nothing stated holds."""
    photos, points = null_space(problem, state)
    if problem.left_open is None:
        return photos, points
    known = _held_whole(problem, state)
    basis = known.movements @ known.right[7 - problem.left_open :].T
    return photos @ basis, points @ basis


def priors_hold(problem: Problem) -> bool:
    """Whether priors alone, of photos and points, determine shift, rotation and scale of a block.

    As they are stated, each with its a-priori standard deviation: positions of photos along a
    line leave the rotation about it open, also where the line is not quite straight.
    """
    own = _given_places(problem)
    places = np.zeros((0, 3)) if own is None else own.places
    at = np.concatenate((problem.position, problem.expected, places))
    sigmas = np.concatenate((problem.position_sigma, problem.expected_sigma, 0.0 * places + 1.0))
    stated = np.isfinite(sigmas)
    some = stated.sum(axis=1) > 0
    if not some.any():
        return False
    # a coordinate that is not stated itself lies in the middle: all that the others need of it
    middle = np.array([at[stated[:, k], k].mean() if stated[:, k].any() else 0.0 for k in range(3)])
    at = np.where(np.isfinite(at) & some[:, None], at - middle, 0.0)
    extent = max(float(np.abs(at).max()), 1e-9)
    shifts_and_turns = np.array([extent] * 3 + [1.0] * 4)
    positions = similarity_effects(at) * shifts_and_turns
    positions = np.where(stated[:, :, None], positions / sigmas[:, :, None], 0.0)
    turned = np.isfinite(problem.rotation_sigma)
    turns = np.zeros((len(turned), 3, 7))
    turns[:, range(3), range(3, 6)] = np.where(turned, 1.0 / problem.rotation_sigma, 0.0)
    n = len(turns)
    photos = np.concatenate((positions[:n], turns), axis=1)
    photos, of_offsets = _beside_stated_offsets(problem, photos)
    positions[:n], turns = photos[:, :3], photos[:, 3:]
    positions = positions[stated]
    if own is not None:
        count = places.size
        positions[-count:] = own.root @ positions[-count:]
    rows = np.vstack((positions.reshape(-1, 7), turns[turned], of_offsets))
    # the weakest combination of the seven has the standard deviation 1 / singular value
    return len(rows) >= SEVEN and float(np.linalg.svd(rows, compute_uv=False)[-1]) * _LOOSE > 1.0


def _beside_stated_offsets(problem: Problem, photos: Array) -> tuple[Array, Array]:
    """Return what the offsets leave of (n, 6, 7) movements of what photos state, and (k, 7) theirs.

    Whitened; where the photos are as they are stated.
    """
    if problem.offsets is None:
        return photos, np.zeros((0, 7))
    stated = problem.rotation
    rotations = np.array([rotation_matrix(*one) for one in np.nan_to_num(stated).tolist()])
    still = np.zeros((len(stated), 3))
    offsets = best_offsets(problem.offsets, still, rotations, stated, problem.prior_sigma)[0]
    return offsets.projected(photos, np.zeros((len(problem.offsets), 7)))


class _GivenPlaces(NamedTuple):
    """Places that are given whole, (k, 3), and (3 k, 3 k) the root of their weights."""

    places: Array
    root: Array


def _given_places(problem: Problem) -> _GivenPlaces | None:
    """Return what a prior from an earlier adjustment says of places; None where nothing."""
    given = problem.given
    if given is None:
        return None
    rows: dict[tuple[str, str], dict[int, int]] = {}
    for k, name in enumerate(given.names):
        if name.axis < 3:
            rows.setdefault((name.kind, name.owner), {})[name.axis] = k
    whole = [[of[0], of[1], of[2]] for of in rows.values() if len(of) == 3]
    if not whole:
        return None
    at = np.array(whole, dtype=np.intp)
    covariance = given.covariance[np.ix_(at.ravel(), at.ravel())]
    size = np.sqrt(np.diag(covariance))
    lower = np.linalg.cholesky(covariance / size[:, None] / size)
    return _GivenPlaces(given.value[at], np.linalg.solve(lower, np.diag(1.0 / size)))


def _named_part(problem: Problem, mine: Index, count: int) -> str:
    return (
        f"{count} disconnected parts, this one holds the photos "
        f"{listed([problem.photos[k] for k in mine])}"
    )


def anchor(problem: Problem, state: BlockState) -> Anchor:
    """Choose a photo with many rays and a coordinate of the photo farthest from it.

    Where priors leave only some movements open, the unknowns of photos that take most part in
    them, one after the other.
    """
    n, d = len(problem.photos), problem.per_photo
    if problem.left_open is not None:
        size = np.array([float(np.ptp(state.points, axis=0).max())] * 3 + [1.0] * 3)
        moved = _open_movements(problem, state)[0][:, :6] / size[:, None]
        chosen = qr(moved.reshape(6 * n, -1).T, mode="r", pivoting=True)[1][: problem.left_open]
        unknowns = tuple((int(k) // 6, int(k) % 6) for k in chosen)
        weights = np.zeros((n, d))
        weights[tuple(np.array(unknowns).T)] = 1.0
        return Anchor(weights, unknowns)
    rays = np.bincount(problem.photo, minlength=n)
    first = int(np.argmax(rays))
    away = np.abs(state.centres - state.centres[first])
    second, axis = (int(k) for k in np.unravel_index(int(np.argmax(away)), away.shape))
    weights = np.zeros((n, d))
    weights[first, :6] = 1.0
    weights[second, axis] = 1.0
    return Anchor(weights, (*((first, k) for k in range(6)), (second, axis)))


def datum_change(problem: Problem, state: BlockState, used: Anchor) -> DatumChange:
    """Return the change from the anchor to inner constraints over the points, or to minimal ones.

    Inner constraints are six where distances give the scale, and as many as priors leave movements
    open where those stay.

    Minimal: both full control points farthest apart and the height of the control point farthest
    from their line; without such control, the anchor's photo and coordinate.
    """
    null_photos, null_points = _open_movements(problem, state)
    held_photos, held_points = np.zeros_like(null_photos), np.zeros_like(null_points)
    if problem.datum == "free":
        held_points = null_points.copy()
        scale = scale_of(problem, state)
        if scale is None:
            nothing = np.zeros(null_points.shape[2])
            return DatumChange(null_photos, null_points, held_photos, held_points, nothing)
        held_points[:, :, 6] = scale.points
        variance = np.array([0.0] * 6 + [scale.variance])
        return DatumChange(null_photos, null_points, held_photos, held_points, variance, scale.rows)
    chosen = _minimal_control(problem)
    if chosen is None:
        for column, (photo, index) in enumerate(used.unknowns):
            held_photos[photo, index, column] = 1.0
    else:
        for column, (point, axis) in enumerate(chosen):
            held_points[point, axis, column] = 1.0
    return DatumChange(null_photos, null_points, held_photos, held_points)


def _minimal_control(problem: Problem) -> list[tuple[int, int]] | None:
    full = np.nonzero(np.isfinite(problem.known).all(axis=1))[0]
    heights = np.nonzero(np.isfinite(problem.known[:, 2]))[0]
    if len(full) < 2:
        return None
    at = problem.known[full][:, :2]
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    i, j = np.unravel_index(int(np.argmax(apart)), apart.shape)
    line = at[j] - at[i]
    others = [k for k in heights if k not in (full[i], full[j])]
    if not others or not line.any():
        return None
    off = problem.known[others][:, :2] - at[i]
    with np.errstate(invalid="ignore"):
        distance = np.abs(off[:, 0] * line[1] - off[:, 1] * line[0])
    if not np.isfinite(distance).any() or np.nanmax(distance) <= 1e-6 * float(line @ line):
        return None
    third = int(others[int(np.nanargmax(distance))])
    return [*((int(full[i]), k) for k in range(3)), *((int(full[j]), k) for k in range(3)),
            (third, 2)]  # fmt: skip


def scale_of(problem: Problem, state: BlockState) -> ScaleOfConditions | None:
    """Return what distances say of the scale of a free network; None where they give it none."""
    if problem.conditions is None or not problem.conditions.gives_scale:
        return None
    return problem.conditions.equations(state.points, problem.fixed).scale


def rescaled(problem: Problem, state: BlockState) -> BlockState:
    """Return a free network in the scale that distances give it, if they do."""
    conditions = problem.conditions
    if conditions is None or not conditions.gives_scale:
        return state
    for _ in range(_SCALINGS):
        middle = state.points.mean(axis=0)
        factor = 1.0 - conditions.scale_excess(state.points, problem.fixed)
        state = replace(
            state,
            centres=middle + factor * (state.centres - middle),
            points=middle + factor * (state.points - middle),
        )
    return state


def relocate(problem: Problem, start: BlockState, state: BlockState) -> BlockState:
    """Lay a solution without datum onto control, or onto the approximate points without it.

    A free solution goes onto all of them in the mean, a minimal one meets its seven coordinates.
    The scale that distances give stays. Where priors hold what they can, all stays.
    """
    if problem.left_open is not None:
        return state
    source, known = state.points, problem.known - state.origin
    chosen = _minimal_control(problem) if problem.datum == "minimal" else None
    full = np.isfinite(problem.known).all(axis=1)
    if problem.datum == "minimal" and chosen is None:
        return state
    if full.sum() >= 3:
        fitted = fit_similarity(source[full], known[full])
    else:
        fitted = fit_similarity(source, start.points + (start.origin - state.origin))
    if problem.defect < len(_NAMES):
        fitted = without_scale(fitted, source)
    if chosen is not None:
        seven = np.full_like(known, np.nan)
        for point, axis in chosen:
            seven[point, axis] = known[point, axis]
        used = np.isfinite(seven).any(axis=1)
        met = fit_to_partial(source[used], seven[used], fitted)
        if met is None:
            return state
        fitted = met
    return BlockState(
        centres=fitted.apply(state.centres),
        rotations=fitted.rotation @ state.rotations,
        points=fitted.apply(source),
        own=state.own,
        shared=state.shared,
        origin=state.origin,
    )


def on_control(problem: Problem, state: BlockState) -> bool:
    """Whether a solution without datum has the scale of control: it was laid onto it.

    Directly, or by way of approximate values; control that does not determine all of a similarity
    says nothing.
    """
    used = np.isfinite(problem.known).any(axis=1)
    if not used.any():
        return False
    still = Similarity(1.0, np.eye(3), np.zeros(3))
    with np.errstate(over="ignore", invalid="ignore"):
        fitted = fit_to_partial(state.points[used], (problem.known - state.origin)[used], still)
    return fitted is not None and abs(fitted.scale - 1.0) < _SCALE
