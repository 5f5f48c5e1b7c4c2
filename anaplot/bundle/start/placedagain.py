"""Photos whose place nothing checks, placed again by most of their rays.

Any three rays of a photo fit some place of it. Where others of its rays are off, three that fit
are no witness against those: of all places that three of its rays make, the one counts that agrees
with most of what its neighbours see.
"""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import counted_misclosures
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.sorting import each_pair
from anaplot.bundle.start.photoplaces import (
    known_without,
    places_of,
    seen_by,
    with_points_of,
)
from anaplot.bundle.start.pointknowledge import equations_knowing
from anaplot.bundle.start.subblock import SubBlock, rays_of_photos, unit_rays

__all__ = ["hardly_checked", "placed_again"]

_UNKNOWNS = 6  # of a photo
_A_RAY = 2  # equations: what checks a place beyond its unknowns, at least
_FEW = 25  # rays of which all triples are tried; what fits of more than these is no chance
_PHOTOS = 30  # that are placed at most, and no more than half of all: the others are the witnesses


def placed_again(problem: Problem, state: BlockState, reach: Array) -> BlockState | None:
    """Return a state in which photos that nothing checks lie where most of their rays fit.

    Parameters
    ----------
    problem
        The bundle.
    state
        A robust solution.
    reach
        (m,) how far rays may be off that fit [mm].

    Returns
    -------
    State or None
        None where every photo of few rays with some that do not fit is checked by the others, where
        most photos are not, and where no place agrees with more rays.
    """
    e = counted_misclosures(problem, state)[0] * problem.sigma_xy
    fits = np.linalg.norm(e, axis=1) <= reach
    astray = np.bincount(problem.photo[~fits], minlength=len(problem.photos)) > 0
    few = np.bincount(problem.photo, minlength=len(problem.photos)) <= _FEW
    asked = astray & few
    if not asked.any():
        return None
    photos = np.flatnonzero(asked & hardly_checked(problem, fits, state))
    if not 0 < len(photos) <= len(problem.photos) // 2:
        return None
    rays, by_photo = unit_rays(problem), rays_of_photos(problem)
    block = SubBlock(state.centres.copy(), state.rotations.copy(), state.points.copy())
    moved = np.zeros(len(problem.points), dtype=bool)
    for photo in photos[:_PHOTOS].tolist():
        mine = by_photo[photo]
        if _place(problem, block, rays, photo, mine, reach[mine]):
            moved[problem.point[mine]] = True
    if not moved.any():
        return None
    return with_points_of(problem, state, block, rays, moved)


def hardly_checked(problem: Problem, fits: Bools, state: BlockState) -> Bools:
    """Return the photos of which less than one ray checks the others.

    Parameters
    ----------
    problem
        The bundle.
    fits
        (m,) rays that count.
    state
        Where points and photos are, about.

    Returns
    -------
    (photos,) booleans
        Photos of which something else than rays knows the place are not among them.
    """
    n, p = len(problem.photos), len(problem.points)
    points, photos = each_pair(problem.point[fits], problem.photo[fits])
    others = np.bincount(points, minlength=p) - 1
    # a point has three coordinates: what more is known than these is said of the photo
    said = np.clip(2 * others + equations_knowing(problem, state) - 1, 0, 2)[points]
    few: Bools = np.bincount(photos, said, n) < _UNKNOWNS + _A_RAY
    few &= ~np.isfinite(problem.position_sigma).any(axis=1)
    if problem.given is not None:
        few[problem.given.owner[~problem.given.of_point]] = False
    return few


def _place(
    problem: Problem, block: SubBlock, rays: Array, photo: int, mine: Index, reach: Array
) -> bool:
    """Place a photo where most of its rays agree with the others; whether that is elsewhere."""
    alone = np.array([photo])
    wanted = seen_by(problem, alone)
    known = known_without(problem, block, rays, alone, wanted)
    places = places_of(problem, block, rays, photo, mine, known[problem.point[mine]])
    if places is None:
        return False
    at, firm = places[:2], places.firm
    count = 2 * (places.misses <= reach[firm]).sum(axis=1)
    left = np.setdiff1d(np.arange(len(mine)), firm)
    count += (_beside(problem, block, rays, photo, mine[left], at) <= reach[left]).sum(axis=1)
    most = np.flatnonzero(count == count.max())
    if most[0] == 0:
        return False
    # measurements do not tell which of several: photos of the same points look the same way
    beside = wanted[problem.point] & (problem.photo != photo)
    view = block.rotations[problem.photo[beside], :, 2].sum(axis=0)
    best = most[np.argmax(at[1][most, :, 2] @ view)]
    block.centres[photo], block.rotations[photo] = at[0][best], at[1][best]
    return True


def _beside(
    problem: Problem, block: SubBlock, rays: Array, photo: int, mine: Index, at: tuple[Array, Array]
) -> Array:
    """(k, n) how far rays pass the one other ray of their points [mm], from k places of the photo.

    Infinite where a point has no other ray, or the rays meet behind the photos.
    """
    centres, rotations = at
    out = np.full((len(centres), len(mine)), np.inf)
    for j, ray in enumerate(mine.tolist()):
        others = np.flatnonzero((problem.point == problem.point[ray]) & (problem.photo != photo))
        if not len(others):
            continue
        # of several in one photo the first
        other = int(others[0])
        there = int(problem.photo[other])
        base = block.centres[there] - centres
        d = rotations @ rays[ray]
        d2 = block.rotations[there] @ rays[other]
        normal = np.cross(base, d2)
        with np.errstate(invalid="ignore", divide="ignore"):
            angle = np.einsum("ki,ki->k", d, normal) / np.linalg.norm(normal, axis=1)
            # on the side of the base where the rays meet before both photos
            across = np.cross(d, d2)
            ahead = np.einsum("ki,ki->k", normal, across) > 0.0
            ahead &= np.einsum("ki,ki->k", np.cross(base, d), across) > 0.0
        good = ahead & np.isfinite(angle)
        out[good, j] = np.abs(angle[good]) * float(problem.c[photo])
    return out
