"""Some points of a large block: enough rays of every photo, where it has hundreds of them.

Where a photo lies, and that it lies firmly, these say nearly as well as all of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.pointgroups import groups_by_rays
from anaplot.bundle.solve.problem import Problem, of_rays

__all__ = ["of_points", "some_points"]

_RAYS = 64  # that a photo keeps, about
_FEWEST = 48  # that it keeps, unless it has no more
_TIMES = 4  # as many rays a photo has, at least: else little would be saved
_LARGE = 50_000  # rays of a block for which it is worth it


def some_points(problem: Problem) -> Bools | None:
    """(points,) which points say where the photos are; None where that would be most of them.

    Those of which something is known, and of the others one of so many that are seen as often.
    Rays without weight say nothing.
    """
    counts = slice(None) if problem.rejected is None else ~problem.rejected.all(axis=1)
    photo, point = problem.photo[counts], problem.point[counts]
    rays = np.bincount(photo, minlength=len(problem.photos))
    every = int(np.median(rays)) // _RAYS
    if problem.given is not None or every < _TIMES or len(photo) < _LARGE:
        return None
    place = np.arange(len(problem.points))
    known = np.isfinite(problem.known) | np.isfinite(problem.expected)
    chosen: Bools = known.any(axis=1) | (place % every == 0)
    while every > 1:
        kept = np.bincount(photo[chosen[point]], minlength=len(rays))
        few = kept < np.minimum(_FEWEST, rays)
        if not few.any():
            break
        every //= 2
        theirs = np.zeros(len(chosen), dtype=bool)
        theirs[point[few[photo]]] = True
        chosen |= theirs & (place % every == 0)
    return chosen


def of_points(problem: Problem, chosen: Bools) -> Problem:
    """Return a bundle with some of its points alone, and all of its photos.

    Parameters
    ----------
    problem
        The bundle, without conditions and without a prior that ties points together.
    chosen
        (points,) which ones.
    """
    number: Index = np.cumsum(chosen) - 1
    some = of_rays(problem, chosen[problem.point])

    def of(values: Array) -> Array:
        out: Array = values[chosen]
        return out

    return replace(
        some,
        points=tuple(name for name, one in zip(problem.points, chosen, strict=True) if one),
        point=number[some.point],
        groups=groups_by_rays(np.bincount(problem.point, minlength=len(chosen))[chosen]),
        fixed=problem.fixed[chosen],
        known=of(problem.known),
        known_sigma=of(problem.known_sigma),
        expected=of(problem.expected),
        expected_sigma=of(problem.expected_sigma),
        aside=None,
    )
