"""Control and stated positions: with which of them the photos agree, where they contradict.

A similarity lays the free network of the photos onto each of them by itself. Where it fits one, the
other is wrong as a whole; rejected one by one, the right one would go as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.upright import look_up
from anaplot.photogrammetry.exchangedpoints import ControlRemark
from anaplot.photogrammetry.similarity import Similarity, robust_similarity

__all__ = ["CLEARLY", "FEWEST", "MOST", "foreign_family", "known_control", "misfit"]

FEWEST = 4
"""Points of which it may be told whether a network, or its mirror image, fits them."""

CLEARLY = 20.0
"""Times worse than another that fits something as a whole does not."""

MOST = 0.75
"""Share of the points that fit where the others may be wrong."""

_Given = tuple[float | None, ...]


def known_control(problem: Problem, *, plan: bool) -> dict[str, _Given]:
    """Return the control of which all is known, or X and Y at least, by name."""
    return {
        row.point: row.xyz
        for row in problem.block.control
        if row.use == "control" and None not in (row.xyz[:2] if plan else row.xyz)
    }


def misfit(network: Array, ground: Array, most: float = MOST) -> float:
    """Return what most points miss by [m] after a similarity; infinite where there is none."""
    return _fitted(network, ground, most)[0]


def _fitted(network: Array, ground: Array, most: float = MOST) -> tuple[float, Similarity | None]:
    found = robust_similarity(network, ground)
    if found is None:
        return float("inf"), None
    off = np.linalg.norm(found[0].apply(network) - ground, axis=1)
    return float(np.quantile(off, most, method="higher")), found[0]


def foreign_family(problem: Problem, free: Problem, bare: BlockState) -> ControlRemark | None:
    """Return which of control and stated positions the photos do not agree with; None: with both.

    Parameters
    ----------
    problem
        The bundle.
    free, bare
        Its free network, and the solution of that.
    """
    control, stated = _in_network(problem, free)
    if min(len(control), len(stated)) < FEWEST:
        return None
    of_control = _Laid.of(free, bare, bare.points, control)
    of_positions = _Laid.of(free, bare, bare.centres, stated)
    if not max(of_control.off, of_positions.off) < np.inf:
        return None
    if of_positions.worse_than(of_control, problem.position_sigma):
        said = f"control {of_control}, and with stated positions {of_positions} only: are these"
    elif of_control.worse_than(of_positions, problem.known_sigma):
        said = f"stated positions {of_positions}, and with control {of_control} only: is that"
    else:
        return None
    return ControlRemark(
        f"the photos agree with {said} in another unit or system, with axes exchanged, of other "
        "photos or points, or less sharp than stated?"
    )


def _in_network(problem: Problem, free: Problem) -> tuple[dict[int, _Given], dict[int, _Given]]:
    """Return control points and stated positions by their numbers in the network."""
    points = {name: k for k, name in enumerate(free.points)}
    photos = {name: k for k, name in enumerate(free.photos)}
    observed = {
        name
        for name, sigma in zip(problem.photos, problem.position_sigma, strict=True)
        if np.isfinite(sigma).all()
    }
    control = known_control(problem, plan=False)
    return (
        {points[name]: xyz for name, xyz in control.items() if name in points},
        {
            photos[photo.id]: photo.position
            for photo in problem.block.photos
            if photo.position is not None and photo.id in observed and photo.id in photos
        },
    )


class _Laid(NamedTuple):
    """A network laid onto what is given by itself: by what most of it misses [m], and how it lies.

    `up`: whether photos look up there, as where axes of level positions are exchanged.
    """

    off: float
    up: bool

    @classmethod
    def of(
        cls, free: Problem, bare: BlockState, places: Array, given: Mapping[int, _Given]
    ) -> _Laid:
        ground = np.array(list(given.values()), dtype=float)
        ground -= ground.mean(axis=0)
        off, fitted = _fitted(places[list(given)], ground)
        return cls(off, fitted is not None and look_up(free, fitted.rotation @ bare.rotations))

    def __str__(self) -> str:
        return "looking up" if self.up else f"to {self.off:.2g} m"

    def worse_than(self, other: _Laid, sigma: Array) -> bool:
        """Whether this is wrong as a whole, the other one being right; `sigma`: as it is stated."""
        if self.up != other.up:
            return self.up
        known = sigma[np.isfinite(sigma)]
        usual = float(np.median(known)) if known.size else 0.0
        return self.off > CLEARLY * max(other.off, usual)
