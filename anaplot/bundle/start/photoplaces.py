"""Places of a photo by three of its rays, and what other photos know of its points."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.resection import image_misses, three_point_resection
from anaplot.bundle.start.subblock import SubBlock, intersect_rays, met

__all__ = [
    "PhotoPlaces",
    "known_without",
    "places_of",
    "points_from",
    "seen_by",
    "with_points_of",
]


class PhotoPlaces(NamedTuple):
    """Places of a photo, the first where it is.

    Attributes
    ----------
    centres, rotations
        (k, 3) and (k, 3, 3).
    firm
        (n,) positions, among the photo's rays, of those whose points are known.
    misses
        (k, n) how far these miss their points [mm].
    """

    centres: Array
    rotations: Array
    firm: Index
    misses: Array


def seen_by(problem: Problem, photos: Index) -> Bools:
    """Return which points any of some photos sees."""
    seen = np.zeros(len(problem.points), dtype=bool)
    seen[problem.point[np.isin(problem.photo, photos)]] = True
    return seen


def known_without(
    problem: Problem, block: SubBlock, rays: Array, photos: Index, wanted: Bools
) -> Array:
    """Return (points, 3) wanted points as all photos but some have them; NaN where they have not.

    Parameters
    ----------
    problem, block
        The bundle, and where its photos are.
    rays
        `unit_rays` of it.
    photos
        Numbers of those that are left out.
    wanted
        (points,) which are asked for.
    """
    others = SubBlock(block.centres.copy(), block.rotations, block.points)
    others.centres[photos] = np.nan
    return intersect_rays(problem, others, rays, wanted)


def places_of(
    problem: Problem, block: SubBlock, rays: Array, photo: int, mine: Index, points: Array
) -> PhotoPlaces | None:
    """Return where a photo is and all places that three of its rays make; None: too few are known.

    Parameters
    ----------
    problem, block, rays
        As `known_without` has them.
    photo, mine
        The photo, and the numbers of its rays.
    points
        (n, 3) their points; NaN where one is not known.
    """
    firm = np.flatnonzero(np.isfinite(points[:, 0]))
    if len(firm) < 3:
        return None
    triples = firm[list(combinations(range(len(firm)), 3))]
    centres, rotations, _ = three_point_resection(rays[mine][triples], points[triples])
    centres = np.concatenate((block.centres[[photo]], centres))
    rotations = np.concatenate((block.rotations[[photo]], rotations))
    c, ideal = float(problem.c[photo]), problem.ideal[mine[firm]]
    misses = image_misses(centres, rotations, c, points[firm], ideal)
    return PhotoPlaces(centres, rotations, firm, misses)


def with_points_of(
    problem: Problem, state: BlockState, block: SubBlock, rays: Array, moved: Bools
) -> BlockState:
    """Return a state with other orientations, and points intersected anew where they can be.

    Coordinates free of error stay: no step would bring them back.
    """
    seen = intersect_rays(problem, block, rays, moved)
    new = np.isfinite(seen[:, :1]) & ~problem.fixed
    points = np.where(new, seen, state.points)
    return replace(state, centres=block.centres, rotations=block.rotations, points=points)


def points_from(
    problem: Problem, state: BlockState, rays: Array, photo: int, places: tuple[Array, Array]
) -> Array:
    """Return (k, n, 3) a photo's points intersected anew, from each of its places.

    Parameters
    ----------
    problem, state
        The bundle, and where the other photos are.
    rays
        `unit_rays` of it.
    photo, places
        The photo, and (k, 3) centres and (k, 3, 3) rotations.

    Notes
    -----
    As in `with_points_of`; the points are in ascending order.
    """
    names = np.unique(problem.point[problem.photo == photo])
    several = np.bincount(problem.point, minlength=len(problem.points))[names] > 1
    use = np.flatnonzero(np.isin(problem.point, names[several]))
    k, count = len(places[0]), int(several.sum())
    out = np.repeat(state.points[names][None], k, axis=0)
    if not count:
        return out
    # every place is a photo of its own, with points of its own
    block = SubBlock(
        np.concatenate((state.centres, places[0])),
        np.concatenate((state.rotations, places[1])),
        state.points,
    )
    beyond = np.arange(k)[:, None]
    own = problem.photo[use] == photo
    photos = np.where(own, len(state.centres) + beyond, problem.photo[use])
    points = np.searchsorted(names[several], problem.point[use]) + count * beyond
    found = met(block, np.tile(rays[use], (k, 1)), photos.ravel(), points.ravel())
    found = found.reshape(k, count, 3)
    new = np.isfinite(found[..., :1]) & ~problem.fixed[names[several]]
    out[:, several] = np.where(new, found, out[:, several])
    return out
