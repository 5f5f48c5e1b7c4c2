"""Photos of few rays that a minimum leaves at the wrong one of several places.

Three points make up to four places of a photo. Where hardly more tells which of them is right, the
rays of its neighbours give way to a wrong one: a minimum that no step leads out of, with rays that
no measurement has spoilt. From the right one all rays of the photo fit.

Most places lead back. Which of them do so is seen from the photo and its points alone. The block
is adjusted from where they settle elsewhere; from all, as they are, where that has led nowhere and
no gross error explains what is off.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from anaplot.aliases import Array, Bools, Index, Progress
from anaplot.bundle.solve.gaussnewton import Minimum, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import counted_misclosures
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.photoplaces import (
    known_without,
    places_of,
    points_from,
    seen_by,
    with_points_of,
)
from anaplot.bundle.start.robust import robust_state
from anaplot.bundle.start.settledplaces import Places, settled_places
from anaplot.bundle.start.subblock import SubBlock, rays_of_photos, unit_rays
from anaplot.errors import NotComputableError

__all__ = ["at_other_places"]

_FEW = 10  # rays of a photo that three of them may have placed wrong
_OFF = 4.0  # sigmas: farther off a ray does not fit
_BETTER = 0.5  # of what the photo's points miss where it is: what they miss elsewhere, at most
_MOST_PLACES = 100  # that are looked at
_ELSEWHERE = 0.05  # of the distance to the points: nearer places are the same
_PLACES = 20  # of one photo that are tried
_TURNED = 0.1  # of two rotations: less turned they are the same
_HOPELESS = 100.0  # of v'Pv: what is more, while the other photos stay, leads to nothing less
_FITS = 2.0  # sigma0 up to which no place is tried from which a photo settles where it is
_WRONG = 3  # rays that explain, if they are wrong, why a minimum does not fit
_MOST_RAYS = 0.5  # of all: if more are far off a robust solution, it is what is given that is wrong
_TRIES = 60  # steps from one of them
_MOST = 30  # minima that lead to nothing, at most
_LEAST = 2
_RAYS = 12_000  # in all of these
_FAR = 1e6  # sigmas: farther off is as far
_CHANCE = 0.003  # of rays that are off by chance
_MOST_SIGMA0 = 3.0  # in a-priori ones, of a block whose rays are in their places
_MUCH = 0.5  # of v'Pv: what lowers it so far tells by itself
_LOWER = 0.99  # of v'Pv: what lowers it less is the same minimum
_NEIGHBOURS = 3
_MEDIAN = 1.1774  # of the length of two normal residuals
_CUT = 1.0 / 20.0  # of the camera constant: farther off is far off


def at_other_places(problem: Problem, found: Minimum, progress: Progress | None) -> Minimum:
    """Return the minimum with photos of few rays where all of these fit.

    Parameters
    ----------
    problem
        The bundle.
    found
        A minimum of it.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    Minimum
        A lower one in which next to all rays of the block fit; the one that was given where there
        is none.
    """
    few = np.bincount(problem.photo, minlength=len(problem.photos)) <= _FEW
    asked = _asked(problem, found.state) & few
    if not asked.any():
        return found
    by_photo, given = rays_of_photos(problem), found
    allowed = most = max(_LEAST, min(_MOST, _RAYS // len(problem.photo)))
    done = np.zeros(len(problem.photos), dtype=bool)

    def lower(start: BlockState, photos: Index) -> Minimum | None:
        """Return the minimum from a state, where it is better for photos than that found so far."""
        nonlocal most
        most -= 1
        try:
            other = find_minimum(
                problem, start, found.normal.structure, tries=_TRIES, progress=progress
            )
        except (NotComputableError, np.linalg.LinAlgError):
            return None
        share = other.convergence.last / found.convergence.last
        mine = np.isin(problem.photo, photos)
        fit = (_off(problem, other.state)[mine] <= _OFF).all()
        # the minimum that there was is less by its last digits, too
        return other if share < _MUCH or (fit and share < _LOWER) else None

    # photos at wrong places hide each other's: all of them, by what the others know
    together = _all_placed(problem, found.state, np.flatnonzero(asked), by_photo)
    if together is not None:
        found = lower(together, np.flatnonzero(asked)) or found
    wild, led_back = False, np.zeros(len(problem.photos), dtype=bool)
    while most > 0:
        asked = _asked(problem, found.state) & few & ~done
        if not asked.any():
            if wild or not led_back.any() or _explained(problem, found):
                break
            wild, done = True, ~led_back
            continue
        # the one that misses most bends its neighbours
        size = np.minimum(_off(problem, found.state), _FAR) ** 2
        misses = np.bincount(problem.photo, size, len(problem.photos))
        photo = int(np.argmax(np.where(asked, misses, -1.0)))
        done[photo] = True
        for start in _other_places(problem, found, photo, by_photo[photo], wild, led_back):
            other = lower(start, np.array([photo]))
            if other is not None:
                found, wild = other, False
                done[:], led_back[:] = False, False
                most = allowed  # it cannot go on for long: it is half of what it was, or fits
            if other is not None or most <= 0:
                break
    # what gross errors pull at may be less anywhere: only where they are none the place is right
    off = _off(problem, found.state, _MOST_SIGMA0)
    return found if float(np.mean(off > _OFF)) <= _CHANCE else given


def _explained(problem: Problem, found: Minimum) -> bool:
    """Whether a minimum fits, or what does not is no photo's place.

    But a few rays, without which it would fit, or what is given, off which nearly all rays are.
    """
    if found.convergence.last <= _FITS**2 * max(problem.redundancy, 1):
        return True
    try:
        solution = robust_state(problem, found.normal.structure, found.state)
    except (NotComputableError, np.linalg.LinAlgError):
        return False
    if solution.rays_off > _MOST_RAYS * len(problem.photo):
        return True
    return int((_off(problem, solution.state, _MOST_SIGMA0) > _OFF).sum()) <= _WRONG


def _asked(problem: Problem, state: BlockState) -> Bools:
    """(photos,) which of them see a point that a ray misses."""
    missed = np.zeros(len(problem.points), dtype=bool)
    missed[problem.point[_off(problem, state) > _OFF]] = True
    rays = missed[problem.point]
    return np.asarray(np.bincount(problem.photo, rays, len(problem.photos)) > 0)


def _all_placed(
    problem: Problem, state: BlockState, photos: Index, by_photo: list[Index]
) -> BlockState | None:
    """Return a state with photos where three rays place them best by what the others know."""
    if not 1 < len(photos) <= len(problem.photos) // 2:
        return None
    rays, block = unit_rays(problem), _block(state)
    every = np.ones(len(problem.points), dtype=bool)
    known = known_without(problem, block, rays, photos, every)
    placed = _block(state)
    for photo in photos.tolist():
        mine = by_photo[photo]
        points = known[problem.point[mine]]
        centres, rotations = _places(problem, block, photo, mine, rays, points, _BETTER, [])
        if len(centres):
            placed.centres[photo], placed.rotations[photo] = centres[0], rotations[0]
    return with_points_of(problem, state, placed, rays, seen_by(problem, photos))


def _block(state: BlockState) -> SubBlock:
    """Return where everything is in a state, to be moved."""
    return SubBlock(state.centres.copy(), state.rotations.copy(), state.points)


def _off(problem: Problem, state: BlockState, most: float = np.inf) -> Array:
    """(m,) what rays are off [sigmas: the a-priori ones, or those that half of all rays say].

    But for no more than `most` of the a-priori ones.
    """
    off = np.linalg.norm(counted_misclosures(problem, state)[0], axis=1)
    return np.asarray(off / min(max(1.0, float(np.median(off)) / _MEDIAN), most))


def _other_places(
    problem: Problem, found: Minimum, photo: int, mine: Index, wild: bool, led_back: Bools
) -> Iterator[BlockState]:
    """Yield states with a photo at other places that three of its rays make, the best first.

    By points that other photos know, then also by those of one more ray, which are about there.
    Where these settle elsewhere while the other photos stay, each once; or, where they are `wild`,
    all, as they are. Of a photo that had more places `led_back` becomes true.
    """
    state = found.state
    rays, block, alone = unit_rays(problem), _block(state), np.array([photo])
    names = np.unique(problem.point[mine])
    known = known_without(problem, block, rays, alone, seen_by(problem, alone))
    known = known[problem.point[mine]]
    about = known.copy()
    for k in np.flatnonzero(~np.isfinite(known[:, 0])).tolist():
        about[k] = _along_other_ray(problem, state, rays, photo, int(problem.point[mine[k]]))
    taken, reached = [state.centres[photo]], [(state.centres[photo], state.rotations[photo])]
    near = _ELSEWHERE * float(np.linalg.norm(state.points[names].mean(axis=0) - taken[0]))
    for by, share in ((known, _BETTER), (about, np.inf)):
        at = _places(problem, block, photo, mine, rays, by, share, taken)
        if len(at[0]):
            places = Places(*at, points_from(problem, state, rays, photo, at))
            if not wild:
                places, more = settled_places(problem, state, photo, places, names)
                places = places.some(more <= _HOPELESS * found.convergence.last)
            for centre, rotation, points in zip(*places, strict=True):
                if wild or not any(_same(centre, rotation, one, near) for one in reached):
                    reached.append((centre, rotation))
                    yield _moved(state, photo, centre, rotation, names, points)
            led_back[photo] |= len(reached) < len(taken)
        if np.isfinite(about[:, 0]).sum() == np.isfinite(known[:, 0]).sum():
            return


def _moved(
    state: BlockState, photo: int, centre: Array, rotation: Array, names: Index, points: Array
) -> BlockState:
    """Return a state with a photo and its points elsewhere."""
    block = _block(state)
    block.centres[photo], block.rotations[photo] = centre, rotation
    everywhere = state.points.copy()
    everywhere[names] = points
    return replace(state, centres=block.centres, rotations=block.rotations, points=everywhere)


def _same(centre: Array, rotation: Array, other: tuple[Array, Array], near: float) -> bool:
    """Whether a photo is at a place already."""
    return (
        float(np.linalg.norm(centre - other[0])) <= near
        and float(np.linalg.norm(rotation - other[1])) <= _TURNED
    )


def _places(
    problem: Problem,
    block: SubBlock,
    photo: int,
    mine: Index,
    rays: Array,
    points: Array,
    share: float,
    taken: list[Array],
) -> tuple[Array, Array]:
    """Return centres and rotations of places that are not taken yet, the best first.

    Those of which the points miss no more than a share of what they miss where the photo is.
    """
    found = places_of(problem, block, rays, photo, mine, points)
    if found is None:
        return np.empty((0, 3)), np.empty((0, 3, 3))
    chosen: list[int] = []
    centres, rotations = found.centres[1:], found.rotations[1:]
    missed = np.minimum(found.misses, _CUT * float(problem.c[photo])).sum(axis=1)
    middle = points[found.firm].mean(axis=0)
    near = _ELSEWHERE * float(np.linalg.norm(middle - block.centres[photo]))
    for count, k in enumerate(np.argsort(missed[1:], kind="stable").tolist()):
        if not missed[1 + k] <= share * missed[0] or count >= _MOST_PLACES:
            break
        if any(float(np.linalg.norm(centres[k] - one)) <= near for one in taken):
            continue
        taken.append(centres[k])
        chosen.append(k)
        if len(taken) > _PLACES:
            break
    return centres[chosen], rotations[chosen]


def _along_other_ray(
    problem: Problem, state: BlockState, rays: Array, photo: int, point: int
) -> Array:
    """(3,) where a point of one more ray is about: as far along it as its neighbours in the image.

    NaN where there is no such ray, or no neighbour that the photo itself does not see.
    """
    nowhere = np.full(3, np.nan)
    others = np.flatnonzero((problem.point == point) & (problem.photo != photo))
    if not len(others):
        return nowhere
    ray = int(others[0])
    there = int(problem.photo[ray])
    mine = problem.point[problem.photo == photo]
    beside = (problem.photo == there) & ~np.isin(problem.point, mine)
    near = np.flatnonzero(beside & np.isfinite(state.points[problem.point, 0]))
    if not len(near):
        return nowhere
    apart = np.linalg.norm(problem.ideal[near] - problem.ideal[ray], axis=1)
    nearest = near[np.argsort(apart, kind="stable")[:_NEIGHBOURS]]
    arms = state.points[problem.point[nearest]] - state.centres[there]
    depth = float(np.median(-(arms @ state.rotations[there])[:, 2]))
    direction = rays[ray] / -rays[ray, 2]
    return np.asarray(state.centres[there] + depth * (state.rotations[there] @ direction))
