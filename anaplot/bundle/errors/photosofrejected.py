"""Photos that lose many of their rays: something is wrong with the photo, or its place.

Errors that hit rays by chance spread over the photos. If rays are rejected with the rate p of all
other photos, one of n rays loses k or more with the probability of the binomial distribution; where
that is less than the significance shared by all photos (Bonferroni), chance does not explain it.

Any three rays of a photo fit some place of it. Where the rays left check each other by less than
one ray, those that were rejected may be the right ones.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

import numpy as np
from scipy.special import bdtrc

from anaplot.aliases import Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.placedagain import hardly_checked

__all__ = [
    "HardlyChecked",
    "PhotoLoss",
    "beyond_chance",
    "hardly_checked_photos",
    "losses_of_photos",
]

_FEWEST = 3  # rays: two are what one interchange of names costs
_SIGNIFICANCE = 0.001  # that any photo of a block is named where all is chance


class PhotoLoss(NamedTuple):
    """A photo that loses more rays than chance explains.

    Attributes
    ----------
    photo
        Its name.
    lost, rays
        Rays of which x or y is rejected, or whose points are left out, of how many.
    others_lost, others
        The same of all other photos.
    """

    photo: str
    lost: int
    rays: int
    others_lost: int
    others: int

    @property
    def sentence(self) -> str:
        """What is said of it."""
        return (
            f"photo {self.photo} loses {self.lost} of its {self.rays} rays, all others "
            f"{self.others_lost} of {self.others}: more than chance; measure it anew, or look what "
            "sets it apart"
        )


class HardlyChecked(NamedTuple):
    """A photo that has lost rays until nothing tells whether these or the others are wrong.

    Attributes
    ----------
    photo
        Its name.
    lost, rays
        Rays of which x or y is rejected, or whose points are left out, of how many.
    """

    photo: str
    lost: int
    rays: int

    @property
    def sentence(self) -> str:
        """What is said of it."""
        out = f"{self.lost} of its {self.rays} rays are out"
        if not self.lost:
            out = "rays of its points in other photos are out"
        return (
            f"less than one ray checks where photo {self.photo} is: {out}, and those left may fit "
            "another place as well; measure more points in it"
        )


def losses_of_photos(
    problem: Problem, rejected: Iterable[ObservationName], left_out: Iterable[str] = ()
) -> list[PhotoLoss]:
    """Return the photos of a bundle that lose more rays than chance explains, the worst first.

    Parameters
    ----------
    problem
        The bundle.
    rejected
        What is rejected of it; other things than image coordinates do not count.
    left_out
        The photos of rays that are out with their points, and none of the bundle's: one each.
    """
    lost, rays = _counted(problem, rejected, left_out)
    return [
        PhotoLoss(
            problem.photos[k],
            int(lost[k]),
            int(rays[k]),
            int(lost.sum() - lost[k]),
            int(rays.sum() - rays[k]),
        )
        for k in beyond_chance(lost, rays).tolist()
    ]


def hardly_checked_photos(
    problem: Problem,
    state: BlockState,
    rejected: Collection[ObservationName],
    left_out: Iterable[str] = (),
) -> list[HardlyChecked]:
    """Return the photos that lose rays and of whose others less than one checks the place.

    Those as well whose points lose rays of other photos: with good ones gone there a wrong place
    of the photo itself looks right.

    Parameters
    ----------
    problem, rejected, left_out
        As for `losses_of_photos`; the bundle lacks what is rejected.
    state
        Its solution.
    """
    lost, rays = _counted(problem, rejected, left_out)
    counts = np.ones(len(problem.photo), dtype=bool)
    if problem.rejected is not None:
        counts &= ~problem.rejected.any(axis=1)
    gone = {name[2] for name in rejected if name[0] == "image"}
    points = np.array([point in gone for point in problem.points], dtype=bool)
    touched = np.bincount(problem.photo, points[problem.point], len(problem.photos)) > 0
    asked = ((lost > 0) | touched) & hardly_checked(problem, counts, state)
    return [
        HardlyChecked(problem.photos[k], int(lost[k]), int(rays[k]))
        for k in np.flatnonzero(asked).tolist()
    ]


def _counted(
    problem: Problem, rejected: Iterable[ObservationName], left_out: Iterable[str]
) -> tuple[Index, Index]:
    """(photos,) rays lost, and of how many."""
    rays = np.bincount(problem.photo, minlength=len(problem.photos))
    number = {name: k for k, name in enumerate(problem.photos)}
    gone = {name[1:4] for name in rejected if name[0] == "image"}
    lost = np.zeros(len(rays), dtype=np.intp)
    for photo, *_ in gone:
        if photo in number:
            lost[number[photo]] += 1
    lost = np.minimum(lost, rays)
    for photo in left_out:
        if photo in number:
            lost[number[photo]] += 1
            rays[number[photo]] += 1
    return lost, rays


def beyond_chance(lost: Index, rays: Index) -> Index:
    """Return which photos lose more of their rays than the rate of the others explains.

    Parameters
    ----------
    lost, rays
        (n,) rays lost, of how many.

    Returns
    -------
    (k,) integers
        The one that loses the largest share first.
    """
    others = rays.sum() - rays
    # one more than counted: no rate is known to be nothing
    rate = np.minimum((lost.sum() - lost + 1.0) / np.maximum(others, 1), 1.0)
    chance = bdtrc(np.maximum(lost - 1, 0), rays, rate)
    named = (lost >= _FEWEST) & (chance < _SIGNIFICANCE / max(len(rays), 1))
    found = np.flatnonzero(named)
    order: Index = found[np.argsort(-(lost[found] / rays[found]), kind="stable")]
    return order
