"""A bundle without some of its points, adjusted near where it lay with all of them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.solve.remade import laid_out_again, with_rejected_of, without_points
from anaplot.bundle.solve.structure import make_structure
from anaplot.photogrammetry.block import Block

__all__ = ["Thinned", "block_without", "bundle_without", "thinned_at"]


def block_without(block: Block, points: Collection[str]) -> Block:
    """Return a block with every row of some points switched off."""
    rows = tuple(
        replace(row, use="off") if row.point in points and row.use != "off" else row
        for row in block.image_points
    )
    return replace(block, image_points=rows)


def bundle_without(problem: Problem, thinner: Block) -> Problem:
    """Return a bundle of a thinner block: without what is rejected in the bundle as it was.

    Nor with points that were not determined there.
    """
    made = laid_out_again(problem, thinner)
    open_points = frozenset(made.points) - frozenset(problem.points)
    if open_points:
        made = without_points(made, open_points)
    return with_rejected_of(made, problem)


@dataclass(frozen=True, eq=False)
class Thinned:
    """A bundle without some of its points.

    Attributes
    ----------
    cofactors
        Of what is left.
    state
        Its minimum.
    rays, points
        Its rays and points among those of the whole bundle.
    r
        (m, 2) redundancy numbers of the rays of the whole bundle; zero where they are gone.
    """

    cofactors: Cofactors
    state: BlockState
    rays: Index
    points: Index
    r: Array


def thinned_at(whole: Problem, state: BlockState, alive: Bools) -> Thinned:
    """Return a bundle without some of its points, adjusted from a state of the whole one.

    Parameters
    ----------
    whole, state
        The bundle with all its points, and a state of it.
    alive
        (p,) which of its points are left.

    Raises
    ------
    NotComputableError
        What is left does not determine everything.
    """
    gone = {whole.points[k] for k in np.flatnonzero(~alive).tolist()}
    problem = bundle_without(whole, block_without(whole.block, gone))
    number = {name: k for k, name in enumerate(whole.points)}
    points = np.array([number[name] for name in problem.points], dtype=np.intp)
    place = np.full(len(whole.block.image_points), -1)
    place[whole.source] = np.arange(len(whole.source))
    rays = place[problem.source]
    there = replace(state, points=state.points[points])
    structure = make_structure(problem, there.centres)
    found = find_minimum(problem, there, structure)
    cofactors = compute_cofactors(found.normal, found.factor)
    r = np.zeros((len(whole.photo), 2))
    r[rays] = cofactors.r
    return Thinned(cofactors, found.state, rays, points, r)
