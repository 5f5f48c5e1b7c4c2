"""Blocks of strips with gross errors put into them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.bundle.adjust import adjust_problem
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.photogrammetry.block import Block
from anaplot.planning.blockplan import BlockPlan, plan_block


def planned(
    seed: int, *, strips: int = 2, photos: int = 7, sigma: float = 0.05, sidelap: float = 0.30
) -> Block:
    """A block of strips over flat ground, with noise of its a-priori size."""
    made = plan_block(BlockPlan(strips, photos, 0.60, sidelap, control_m=sigma)).block
    rng = np.random.default_rng(seed)
    rows = tuple(
        replace(row, x=row.x + rng.normal() * 0.005, y=row.y + rng.normal() * 0.005)
        for row in made.image_points
    )
    control = tuple(
        replace(c, xyz=tuple(None if v is None else v + rng.normal() * sigma for v in c.xyz))
        for c in made.control
    )
    return replace(made, image_points=rows, control=control)


def weak() -> tuple[Problem, BlockState]:
    """Three strips with a side lap of 30 %, and their minimum."""
    problem = make_problem(planned(1, strips=3))
    return problem, adjust_problem(problem).state


def interchanged(block: Block, photo: str, one: str, other: str) -> Block:
    """The block with two points taken for each other in a photo."""
    at = {row.point: k for k, row in enumerate(block.image_points) if row.photo == photo}
    rows = list(block.image_points)
    first, second = rows[at[one]], rows[at[other]]
    rows[at[one]] = replace(first, x=second.x, y=second.y)
    rows[at[other]] = replace(second, x=first.x, y=first.y)
    return replace(block, image_points=tuple(rows))


def moved(block: Block, point: str, axis: int, by: float) -> Block:
    """The block with a control coordinate off by some metres."""
    control = tuple(
        replace(c, xyz=tuple(v + by if k == axis else v for k, v in enumerate(c.xyz)))
        if c.point == point
        else c
        for c in block.control
    )
    return replace(block, control=control)


def mismatched(block: Block, count: int, seed: int) -> tuple[Block, set[tuple[str, str]]]:
    """The block with rays measured beside any other point of their photo, and which they are."""
    rng = np.random.default_rng(seed)
    rows = list(block.image_points)
    wrong = set()
    for k in rng.choice(len(rows), count, replace=False).tolist():
        others = [r for r in block.image_points if r.photo == rows[k].photo and r is not rows[k]]
        place = others[int(rng.integers(len(others)))]
        x, y = rng.normal(size=2) * 0.3 + (place.x, place.y)
        rows[k] = replace(rows[k], x=float(x), y=float(y))
        wrong.add((rows[k].photo, rows[k].point))
    return replace(block, image_points=tuple(rows)), wrong
