"""A part of a block that grows from two photos in any attitude.

The seed is an edge of the view graph: two photos that have many points in common, and show them at
an angle. Oriented relative to each other, they place their points; photos that see most of these
are resected next.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice

import numpy as np

from anaplot.aliases import Array, Bools, Index, Progress
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.relative import RelativeOrientation, orientations
from anaplot.bundle.start.subblock import SubBlock, median_miss
from anaplot.bundle.start.viewgraph import ViewGraph, view_graph

__all__ = ["PAIRS", "PHOTOS", "grown_from_seed", "rays_of_common_points", "spread"]

PAIRS, PHOTOS = "orienting pairs", "orienting photos"
"""What is said of the progress."""

_FEWEST = 6  # common points of a seed
_SEEDS = 4  # pairs from which a part grows, at most
_STRONGEST, _OTHERS = 6, 6  # pairs that are oriented to find them, at most
_ANGLE = 0.04  # at which a seed shows its points [rad]
_CLEAR = 2.5  # times their noise by which rays of a good seed miss each other
_ORIENTATIONS = 3  # of a seed that are tried
_WORSE = 10.0  # times the rays of one that is none miss each other, than those of the best
_NEARLY = 0.9  # of the photos: a part that reaches so many is taken
_GROWN = 4.0  # sigmas by which rays of a part grown from a good seed miss, in the median
_DRIFT = 0.001  # share of c that they may miss by more than that: errors add up along a chain


def grown_from_seed(
    problem: Problem,
    rays: Array,
    by_photo: list[Index],
    among: Bools | None = None,
    *,
    graph: ViewGraph | None = None,
    progress: Progress | None = None,
) -> SubBlock | None:
    """Return what grows from two photos, of several parts the one with most photos.

    Parameters
    ----------
    problem
        The bundle.
    rays
        (m, 3) rays of unit length in image axes.
    by_photo
        The rays of each photo.
    among
        (photos,) which have no place yet: of these is the seed, and these count. The part grows
        over their neighbours as well, so that it can be joined to where those are.
    graph
        The view graph, where it is known.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    SubBlock or None
        None where no photo has six points in common with another.
    """
    among = np.ones(len(problem.photos), dtype=bool) if among is None else among
    n = int(among.sum())
    fits = max(_GROWN * float(np.median(problem.sigma)), _DRIFT * float(np.median(problem.c)))
    best: SubBlock | None = None
    best_score = (-1, 0.0)
    graph = view_graph(problem) if graph is None else graph
    beyond = ~graph.with_neighbours(among)
    pairs = _varied(graph.strongest(_FEWEST, among))
    reached = np.zeros(len(problem.photos), dtype=bool)
    for count, (pair, possible) in enumerate(_seeds(problem, rays, by_photo, pairs, reached)):
        if progress is not None:
            progress(PAIRS, count / _SEEDS)
        for found in possible:
            part = SubBlock.empty(problem)
            part.centres[pair] = np.zeros(3), found.base
            part.rotations[pair] = np.eye(3), found.rotation
            part.place(problem, rays)
            spread(problem, part, rays, by_photo, beyond, progress)
            error = median_miss(part.residuals(problem))
            score = (int((part.oriented & among).sum()), -error)
            if score > best_score:
                best, best_score = part, score
            if error < fits and score[0] >= _NEARLY * n:
                return part
            if error < fits and 2 * score[0] > n:
                # this is how the pair is oriented: what it does not reach, another may
                reached |= part.oriented
                break
        if best is not None and best_score[0] == n and count >= 1:
            break
    return best


def _varied(pairs: Index) -> Index:
    """Return the pairs with most common points, and some of the others with more than most have.

    Where the strongest ones are neighbours of a narrow field, all show their points at no angle;
    two that are farther apart have fewer of them, and better ones.
    """
    others = np.linspace(_STRONGEST, max(len(pairs) // 2, _STRONGEST), _OTHERS).astype(np.intp)
    chosen = np.unique(np.concatenate((np.arange(_STRONGEST), others)))
    return np.asarray(pairs[chosen[chosen < len(pairs)]])


def _seeds(
    problem: Problem, rays: Array, by_photo: list[Index], pairs: Index, reached: Bools
) -> Iterator[tuple[Index, Iterator[RelativeOrientation]]]:
    """Yield pairs of photos with possible orientations, the best seeds first.

    Of pairs with most common points those that show them at an angle, and whose rays meet as their
    noise lets them; where there are too few, those that come nearest to it: rays that miss each
    other have gross errors, a lens, or a wrong orientation, as of a narrow field. None with both
    photos among those that, by then, are `reached`.
    """
    poor: list[tuple[bool, float, Index, Iterator[RelativeOrientation]]] = []
    good = 0
    for pair in pairs:
        if reached[pair].all():
            continue
        one, other = rays_of_common_points(problem, by_photo, pair)
        both = np.concatenate((one, other))
        noise = float(np.mean(problem.sigma[both] / problem.c[problem.photo[both]]))
        every = _orientations(rays[one], rays[other], noise)
        best = next(every, None)
        if best is None:
            continue
        found: Iterator[RelativeOrientation] = chain((best,), every)
        flat, unclear = best.angle < _ANGLE, best.error > _CLEAR * noise
        if flat or unclear:
            poor.append((unclear, -best.angle if flat else -_ANGLE, pair, found))
            continue
        yield pair, found
        good += 1
        if good == _SEEDS:
            return
    poor.sort(key=lambda seed: seed[:2])
    for _, _, pair, found in poor[: _SEEDS - good]:
        yield pair, found


def _orientations(one: Array, other: Array, noise: float) -> Iterator[RelativeOrientation]:
    """Yield possible orientations of two bundles, the best first; none far worse than that."""
    every = orientations(one, other, noise)
    best = next(every, None)
    if best is None:
        return
    yield best
    reach = _WORSE * max(best.error, noise)
    yield from islice((each for each in every if each.error <= reach), _ORIENTATIONS - 1)


def rays_of_common_points(
    problem: Problem, by_photo: list[Index], pair: Index
) -> tuple[Index, Index]:
    """Return the rays of the points that both photos have, point by point; the first of each."""
    one, other = by_photo[pair[0]], by_photo[pair[1]]
    _, at, there = np.intersect1d(problem.point[one], problem.point[other], return_indices=True)
    return one[at], other[there]


def spread(
    problem: Problem,
    part: SubBlock,
    rays: Array,
    by_photo: list[Index],
    beyond: Bools,
    progress: Progress | None,
) -> None:
    """Add photos and points until nothing more can be added; all points from all rays.

    First those that see half as many points as the one that sees most: one at the edge of what is
    there would be badly determined, and sees more of it a little later.
    """
    tried: dict[int, tuple[int, int]] = {}
    while True:
        if progress is not None:
            progress(PHOTOS, float(part.oriented.mean()))
        added = 0
        for fewest, share in ((_FEWEST, 0.5), (_FEWEST, 0.0), (5, 0.0), (4, 0.0)):
            added = part.add_photos(
                problem,
                by_photo,
                fewest,
                but=beyond,
                of_most=share,
                tried=tried,
                progress=progress,
            )
            if added:
                break
        placed = part.place(problem, rays)
        if not added and not placed:
            break
