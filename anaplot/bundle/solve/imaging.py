"""Where the points of a bundle are seen: collinearity and additional parameters together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.collinearity import Projection, project, project_with_derivatives
from anaplot.photogrammetry.lens import LENS_PARAMETERS, lens_fold, lens_places, through_lens

__all__ = [
    "BlockState",
    "Imaged",
    "RobustPlace",
    "imaged",
    "imaged_places",
    "imaged_with_derivatives",
    "seen_places",
    "with_additional",
    "without_additional",
]


@dataclass(frozen=True, slots=True, eq=False)
class BlockState:
    """Values of the unknowns.

    Attributes
    ----------
    centres, rotations
        (photos, 3) projection centres [m] relative to `origin`, (photos, 3, 3) image to ground.
    points
        (points, 3) [m] relative to `origin`.
    own
        (photos, q) photo-invariant additional parameters.
    shared
        (g,) additional parameters of several photos.
    origin
        (3,) [m], so that the numbers stay small. A given coordinate is compared with an unknown by
        taking the origin from the given one: added to the unknown, it would cost the digits that
        it is there to keep.
    """

    centres: Array
    rotations: Array
    points: Array
    own: Array
    shared: Array
    origin: Array


class RobustPlace(NamedTuple):
    """Where robust steps begin, or have ended.

    Attributes
    ----------
    state
        The state.
    settled
        Whether more such steps would hardly move anything.
    """

    state: BlockState
    settled: bool = False


def with_additional(problem: Problem, state: BlockState) -> BlockState:
    """Return the state of the bundle without additional parameters for the one that has some."""
    given, own = problem.additional_given, problem.photo_invariant
    return replace(
        state,
        own=given if own else np.zeros((len(problem.photos), 0)),
        shared=np.zeros(0) if own else given.ravel(),
    )


def without_additional(state: BlockState) -> BlockState:
    """Return a state for the bundle without additional parameters."""
    return replace(state, own=state.own[:, :0], shared=state.shared[:0])


class Imaged(NamedTuple):
    """Image coordinates of rays and their derivatives.

    Attributes
    ----------
    xy
        (n, 2) image coordinates [mm], additional parameters included.
    depth
        (n,) distance of the point in front of the photo [m].
    photo
        (n, 2, 6) derivatives by the projection centre [mm/m] and a small rotation [mm/rad].
    point
        (n, 2, 3) derivatives by the point [mm/m].
    parameter
        (n, 2, q) derivatives by the additional parameters of the ray's group.
    """

    xy: Array
    depth: Array
    photo: Array
    point: Array
    parameter: Array


def _values(problem: Problem, state: BlockState, rays: Index | slice) -> Array:
    """(n, q) additional parameters of the rays' groups."""
    if problem.photo_invariant:
        return np.asarray(state.own[problem.photo[rays]])
    by_group = state.shared.reshape(len(problem.additional_groups), problem.basis.shape[2])
    return np.asarray(by_group[problem.additional_group[rays]])


def _lens(problem: Problem, state: BlockState, rays: Index | slice) -> Array:
    """(n, 10) parameters of the lens of every ray: what its camera states, and corrections."""
    photo, units = problem.photo[rays], problem.lens_units
    out = np.zeros((len(photo), len(LENS_PARAMETERS)))
    if units is not None:
        values = units[problem.additional_group[rays]] * _values(problem, state, rays)
        out[:, _unknown(problem)] = values
    if problem.stated_lens is not None:
        out += problem.stated_lens[photo]
    else:
        out[:, 0] += problem.c[photo]
    if problem.lens_held is not None:
        out += problem.lens_held[problem.additional_group[rays]]
    return out


def _through_lens(problem: Problem) -> bool:
    """Whether a lens is between ideal and measured coordinates: stated, or to be found."""
    return problem.stated_lens is not None or problem.lens_units is not None


def _unknown(problem: Problem) -> list[int]:
    """Which parameters of the lens are unknown."""
    return [] if problem.additional is None else list(problem.additional.set.columns)


def _shifted(problem: Problem, state: BlockState, xy: Array, rays: Index | slice) -> Array:
    """(n, 2) image coordinates with what linear parameters do to them."""
    if problem.basis.shape[2]:
        xy = xy + np.einsum("mij,mj->mi", problem.basis[rays], _values(problem, state, rays))
    return xy if problem.image_shift is None else xy + problem.image_shift[rays]


def imaged(problem: Problem, state: BlockState) -> Projection:
    """Return where every ray's point is seen [mm], and how far in front of the photo [m]."""
    rays, where = (problem.photo, problem.point), (state.centres, state.rotations)
    if not _through_lens(problem):
        seen = project(*where, problem.c, state.points, rays)
        return Projection(_shifted(problem, state, seen.xy, slice(None)), seen.depth)
    seen = project(*where, np.ones(len(problem.photos)), state.points, rays)
    with np.errstate(invalid="ignore", over="ignore"):
        xy = lens_places(seen.xy, _lens(problem, state, slice(None)))
    if problem.lens_units is None:
        xy = _shifted(problem, state, xy, slice(None))
    return Projection(xy, seen.depth)


def seen_places(
    problem: Problem, state: BlockState, photos: Index | int, places: Array
) -> Projection:
    """Return where photos would see places, through the lenses that their cameras state.

    Parameters
    ----------
    problem, state
        The bundle and its unknowns.
    photos
        (n,) numbers of photos, or that of one for all.
    places
        (n, 3) one for each [m], relative to the state's origin.

    Returns
    -------
    Projection
        `xy` is NaN beyond a lens's fold: nothing is imaged a second time there.
    """
    lens = problem.stated_lens
    centres, rotations = state.centres[photos], state.rotations[photos]
    where = centres.reshape(-1, 3), rotations.reshape(-1, 3, 3)
    if lens is None:
        return project(*where, np.atleast_1d(problem.c[photos]), places)
    seen = project(*where, np.ones(len(where[0])), places)
    with np.errstate(invalid="ignore", over="ignore"):
        xy = lens_places(seen.xy, lens[photos])
    return Projection(_within_fold(seen.xy, lens[photos], xy), seen.depth)


def imaged_places(problem: Problem, state: BlockState, photos: Index, places: Array) -> Imaged:
    """Return `seen_places` with derivatives, of n photos; without additional parameters."""
    where, lens = (state.centres[photos], state.rotations[photos]), problem.stated_lens
    none = np.zeros((len(photos), 2, 0))
    if lens is None:
        seen = project_with_derivatives(*where, problem.c[photos], places)
        return Imaged(seen.xy, seen.depth, seen.photo, seen.point, none)
    seen = project_with_derivatives(*where, np.ones(len(photos)), places)
    with np.errstate(invalid="ignore", over="ignore"):
        bent = through_lens(seen.xy, lens[photos])
        by_photo = np.matmul(bent.by_direction, seen.photo)
        by_place = np.matmul(bent.by_direction, seen.point)
    xy = _within_fold(seen.xy, lens[photos], bent.xy)
    return Imaged(xy, seen.depth, by_photo, by_place, none)


def _within_fold(direction: Array, lens: Array, xy: Array) -> Array:
    """Return (n, 2) places in the image, NaN where (n, 2) directions lie beyond a lens's fold."""
    fold = [lens_fold(*radial) for radial in np.atleast_2d(lens)[:, 3:6].tolist()]
    with np.errstate(invalid="ignore", over="ignore"):
        inside = np.hypot(*direction.T) <= np.array(fold)
    return np.where(inside[:, None], xy, np.nan)


def imaged_with_derivatives(
    problem: Problem,
    state: BlockState,
    rays: Index | slice = slice(None),
    weight: Array | None = None,
) -> Imaged:
    """Return where points are seen, and derivatives by everything that is unknown.

    Parameters
    ----------
    problem, state
        The bundle and its unknowns.
    rays
        Which rays; all when left out.
    weight
        (n, 2) what the derivatives of x and y are multiplied by; None: by nothing.
    """
    units, mine = problem.lens_units, (problem.photo[rays], problem.point[rays])
    where = state.centres, state.rotations
    if not _through_lens(problem):
        seen = project_with_derivatives(*where, problem.c, state.points, mine, weight)
        xy, basis = _shifted(problem, state, seen.xy, rays), problem.basis[rays]
        return Imaged(xy, seen.depth, seen.photo, seen.point, _weighted(basis, weight))
    ones = np.ones(len(problem.photos))
    seen = project_with_derivatives(*where, ones, state.points, mine)
    with np.errstate(invalid="ignore", over="ignore"):
        lens = through_lens(seen.xy, _lens(problem, state, rays))
        by_direction = _weighted(lens.by_direction, weight)
        photos = np.matmul(by_direction, seen.photo)
        points = np.matmul(by_direction, seen.point)
    if units is None:
        xy = _shifted(problem, state, lens.xy, rays)
        return Imaged(xy, seen.depth, photos, points, _weighted(problem.basis[rays], weight))
    of_parameters = lens.by_parameter[:, :, _unknown(problem)]
    of_parameters = of_parameters * units[problem.additional_group[rays]][:, None, :]
    return Imaged(lens.xy, seen.depth, photos, points, _weighted(of_parameters, weight))


def _weighted(rows: Array, weight: Array | None) -> Array:
    """(n, 2, k) derivatives of x and y, times their weights."""
    return rows if weight is None else rows * weight[:, :, None]
