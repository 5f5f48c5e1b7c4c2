"""The regular blocks of Gruen 1980, Figures 1 and 2, as the planner makes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.planning.blockplan import BlockPlan, plan_block
from anaplot.planning.idealblock import IdealBlock

# bridging distances, in bases
CONTROL = {7: (2, 3, 6), 4: (1, 2, 3)}


def regular(n: int, side: int, distance: int, *, twin: bool = False, noise_um: float = 0.0,
            seed: int = 0) -> IdealBlock:  # fmt: skip
    """n x n photos, side x side points each (3 or 5), control at a bridging distance."""
    made = plan_block(BlockPlan(n, n, 0.60, 0.60, side, bridging=distance, twin=twin))
    noise = np.random.default_rng(seed).normal(size=(len(made.block.image_points), 2)) * noise_um
    return with_rows(
        made,
        (
            replace(row, x=row.x + dx, y=row.y + dy)
            for row, (dx, dy) in zip(made.block.image_points, noise * 1e-3, strict=True)
        ),
    )


def with_rows(made: IdealBlock, rows) -> IdealBlock:
    return replace(made, block=replace(made.block, image_points=tuple(rows)))


def classes(problem) -> dict[str, list[tuple[int, int]]]:
    """(ray, axis) of each class of Table 2."""
    # measured in two models, and so twice
    pair = problem.point * len(problem.photos) + problem.photo
    _, of_pair, times = np.unique(pair, return_inverse=True, return_counts=True)
    inner = times[of_pair] > 1
    control = np.isfinite(problem.known).any(axis=1)
    # twin rays count as one
    pairs = np.unique(np.stack((problem.point, problem.photo), axis=1), axis=0)
    rays = np.bincount(pairs[:, 0], minlength=len(problem.points))
    out: dict[str, list[tuple[int, int]]] = {}
    for ray, point in enumerate(problem.point.tolist()):
        count = rays[point]
        kind = "I" if inner[ray] else "O"
        if control[point]:
            names = (f"CR{kind}4/9",) * 2
        elif count >= 4:
            names = (f"R{kind}4/9",) * 2
        elif count == 3:
            names = ("RI3",) * 2 if inner[ray] else ("RO3(x)", "RO3(y)")
        else:
            names = ("R2(x)", "R2(y)")
        for axis in (0, 1):
            out.setdefault(names[axis], []).append((ray, axis))
    return out
