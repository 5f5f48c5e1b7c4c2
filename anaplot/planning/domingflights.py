"""Which flight would tell a lens from bent heights: photos are added to an adjusted block.

The same number of photos is taken once more in different ways, of the points that the block has,
with its camera and accuracy; what is left of the bend is that of the equations with them. Nothing
is simulated: cofactors need no measurements.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import ceil, radians
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.hypotheses.doming import (
    Doming,
    LensSpread,
    bend_weights,
    equations_of,
    lens_spread,
)
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.normal import PointError
from anaplot.bundle.solve.parameternames import parameter_names
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.remade import laid_out_without_same
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block, ControlPoint, ImagePoint, Photo
from anaplot.photogrammetry.collinearity import project, turns

__all__ = ["MOST_RAYS", "DomingFlight", "FlightKind", "doming_flights"]

FlightKind = Literal["as it is", "across", "higher", "oblique", "control in the middle"]

MOST_RAYS = 200_000
"""Of a block for which flights are computed."""

_SHARE = 0.1  # of the photos that are taken once more
_FEWEST, _MOST = 3, 12
_HIGHER = 1.4  # times the distance
_OBLIQUE = 30.0  # degrees


class DomingFlight(NamedTuple):
    """A way to tell the lens from bent heights.

    Attributes
    ----------
    kind
        What is added: nothing; photos turned by 90 degrees about their axes ("across"), 1.4 times
        as far ("higher"), leant by 30 degrees about what they see ("oblique"); or one more control
        point, with the others' standard deviation.
    photos
        The photos that are taken once more.
    point
        The point that becomes control, else None.
    bend
        The calibration's part of the standard deviation of the bend [m].
    s
        Standard deviations of the parameters, in the order of the verdict's names; c, x0, y0 in mm.
    """

    kind: FlightKind
    photos: tuple[str, ...]
    point: str | None
    bend: float
    s: tuple[float, ...]


def doming_flights(found: Doming, sigma: float) -> tuple[DomingFlight, ...]:
    """Return what flights make of a verdict, the block as it is first, then the best one.

    Parameters
    ----------
    found
        The verdict on a block.
    sigma
        The factor of its standard deviations.

    Returns
    -------
    tuple of DomingFlight
        Empty for blocks of more than `MOST_RAYS` rays.
    """
    problem = found.problem
    if len(problem.photo) > MOST_RAYS:
        return ()
    again = _taken_again(problem, found.state)
    names = tuple(problem.photos[k] for k in again.tolist())

    def flight(
        kind: FlightKind, photos: tuple[str, ...], point: str | None, trial: Problem, of: LensSpread
    ) -> DomingFlight:
        units = np.array([name.factor for name in parameter_names(trial)])
        s = sigma * np.sqrt(np.diag(of.q)) * units[of.free]
        bend = sigma * float(np.sqrt(of.of_lens))
        return DomingFlight(kind, photos, point, bend, tuple(s.tolist()))

    out = [
        flight(kind, photos, point, trial, spread)
        for kind, photos, point, trial, state in _trials(found, again, names)
        if (spread := _spread(found, trial, state)) is not None
    ]
    as_it_is = flight("as it is", (), None, problem, found.spread)
    return (as_it_is, *sorted(out, key=lambda one: one.bend))


_Trial = tuple[FlightKind, tuple[str, ...], str | None, Problem, BlockState]


def _trials(found: Doming, again: Index, names: tuple[str, ...]) -> Iterator[_Trial]:
    problem, state = found.problem, found.state
    kinds: Sequence[FlightKind] = ("across", "higher", "oblique")
    for kind in kinds:
        with_photos = _with_photos(problem, state, again, kind)
        if with_photos is not None:
            yield kind, names, None, *with_photos
    middle = _middle(problem, state)
    with_control = None if middle is None else _with_control(found, middle)
    if middle is not None and with_control is not None:
        yield "control in the middle", (), problem.points[middle], *with_control


def _spread(found: Doming, problem: Problem, state: BlockState) -> LensSpread | None:
    """Return what the parameters do to the heights of the points that the block has."""
    at = {name: k for k, name in enumerate(problem.points)}
    _, own = bend_weights(found.state.points)
    if own is None:
        return None
    weights = np.zeros(len(problem.points))
    for name, weight in zip(found.problem.points, own.tolist(), strict=True):
        weights[at[name]] = weight
    try:
        return lens_spread(problem, *equations_of(problem, state), weights)
    except (NotPositiveError, PointError, np.linalg.LinAlgError):
        return None


def _taken_again(problem: Problem, state: BlockState) -> Index:
    """Return photos spread over the block."""
    n = len(problem.photos)
    count = min(n, _MOST, max(_FEWEST, ceil(_SHARE * n)))
    away = state.centres - state.centres.mean(axis=0)
    along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
    order = np.argsort(along, kind="stable")
    return np.asarray(order[((np.arange(count) + 0.5) * n / count).astype(np.intp)])


def _placed(
    kind: FlightKind, k: int, centre: Array, rotation: Array, seen: Array
) -> tuple[Array, Array]:
    """Return centre and rotation of a photo that is taken once more of a place on its axis."""
    if kind == "higher":
        return seen + _HIGHER * (centre - seen), rotation
    # about its own axis, or about its x axis to either side in turn
    axis, angle = rotation[:, 2], radians(90.0)
    if kind == "oblique":
        axis, angle = rotation[:, 0], radians(_OBLIQUE) * (1.0 if k % 2 == 0 else -1.0)
    turn = turns(angle * axis[None])[0]
    return seen + turn @ (centre - seen), turn @ rotation


def _with_photos(
    problem: Problem, state: BlockState, again: Index, kind: FlightKind
) -> tuple[Problem, BlockState] | None:
    """Return a bundle with photos that are taken once more, and its state."""
    block = problem.block
    taken = {photo.id for photo in block.photos}
    reach = _reach(problem)
    photos, rows = [], []
    centres, rotations = {}, {}
    n = len(problem.points)
    for k, photo in enumerate(again.tolist()):
        camera = block.cameras[problem.cameras[photo]]
        centre, rotation = state.centres[photo], state.rotations[photo]
        mine = problem.point[problem.photo == photo]
        depth = float(np.median((centre - state.points[mine]) @ rotation[:, 2]))
        centre, rotation = _placed(kind, k, centre, rotation, centre - depth * rotation[:, 2])
        name = f"{problem.photos[photo]} {kind}"
        while name in taken:
            name += "'"
        taken.add(name)
        seen = project(
            np.broadcast_to(centre, (n, 3)),
            np.broadcast_to(rotation, (n, 3, 3)),
            np.full(n, camera.c),
            state.points,
        )
        with np.errstate(invalid="ignore"):
            inside = (np.abs(seen.xy) <= reach[problem.cameras[photo]]).all(axis=1)
        inside &= seen.depth > 0.0
        if inside.sum() < _FEWEST:
            continue
        photos.append(Photo(name, camera.id))
        centres[name], rotations[name] = centre, rotation
        rows += [
            ImagePoint(name, problem.points[p], float(seen.xy[p, 0]), float(seen.xy[p, 1]))
            for p in np.flatnonzero(inside).tolist()
        ]
    if not photos:
        return None
    every = (*block.image_points, *rows)
    larger = replace(block, photos=(*block.photos, *photos), image_points=every)
    return _laid_out(problem, state, larger, centres, rotations)


def _with_control(found: Doming, middle: int) -> tuple[Problem, BlockState] | None:
    problem, state = found.problem, found.state
    block = problem.block
    x, y, z = (state.points[middle] + state.origin).tolist()
    name = problem.points[middle]
    others = tuple(row for row in block.control if row.point != name)
    mine = ControlPoint(name, (x, y, z))
    sigma = found.control_s or problem.given_sigma(mine)[2]
    mine = replace(mine, sigma=(sigma,) * 3)
    larger = replace(block, control=(*others, mine))
    laid = _laid_out(problem, state, larger, {}, {})
    if laid is None:
        return None
    trial, there = laid
    known = trial.known_sigma.copy()
    known[trial.points.index(name)] = sigma  # as the others weigh, whatever they state
    return replace(trial, known_sigma=known), there


def _laid_out(
    problem: Problem,
    state: BlockState,
    larger: Block,
    centres: dict[str, Array],
    rotations: dict[str, Array],
) -> tuple[Problem, BlockState] | None:
    """Return the bundle of a larger block, and its state from that of the block.

    Weights are those of the block's bundle, and what that is without is left out as well.
    """
    try:
        trial = laid_out_without_same(problem, larger, problem.undetermined)
    except NotComputableError:
        return None
    for k, name in enumerate(problem.photos):
        centres[name], rotations[name] = state.centres[k], state.rotations[k]
    at = {name: k for k, name in enumerate(problem.points)}
    if not (set(trial.photos) <= set(centres) and set(trial.points) == set(at)):
        return None
    if trial.in_border != problem.in_border:
        return None
    order = [at[name] for name in trial.points]
    there = BlockState(
        np.array([centres[name] for name in trial.photos]),
        np.array([rotations[name] for name in trial.photos]),
        state.points[order],
        np.zeros((len(trial.photos), 0)),
        state.shared,
        state.origin,
    )
    return trial, there


def _reach(problem: Problem) -> Array:
    """(cameras, 2) how far from the principal point each camera has measured [mm]."""
    out = np.zeros((len(problem.block.cameras), 2))
    np.maximum.at(out, problem.cameras[problem.photo], np.abs(problem.ideal))
    return out


def _middle(problem: Problem, state: BlockState) -> int | None:
    """Return the point nearest to the middle that is seen most often, and is no control."""
    free = ~problem.controlled[:, 2]
    rays = np.bincount(problem.point, minlength=len(problem.points))
    if not free.any():
        return None
    good = free & (rays >= min(4, int(rays[free].max())))
    away = np.linalg.norm(state.points[:, :2] - state.points[:, :2].mean(axis=0), axis=1)
    return int(np.argmin(np.where(good, away, np.inf)))
