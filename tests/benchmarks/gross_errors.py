"""Time of the strategies for gross errors on 50 photos with 20 planted errors.

    python tests/benchmarks/gross_errors.py [seed]

Each is a ratio to the adjustment of the same block from its measurements alone, and to one linear
search, in one run; the whole of a strategy holds its passes, with a new adjustment after each.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from time import perf_counter

import numpy as np

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.strategies import STRATEGIES, find_gross_errors
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.residuals import block_residuals
from anaplot.photogrammetry.block import Block
from anaplot.planning.blockplan import BlockPlan, plan_block

ERRORS, SIZE_UM = 20, 90.0


def spoiled(seed: int) -> tuple[Block, set[tuple[int, int]]]:
    """Return the block with noise and errors, and where they are: row of the file, axis."""
    made = plan_block(BlockPlan(5, 10, 0.60, 0.60, 3, control_m=0.05))
    rng = np.random.default_rng(seed)
    rows = list(made.block.image_points)
    xy = np.array([(row.x, row.y) for row in rows]) + rng.normal(size=(len(rows), 2)) * 0.005
    r = made.evaluated().cofactors.r
    places = np.argwhere(r > 0.2)
    chosen = places[rng.choice(len(places), ERRORS, replace=False)]
    for k, axis in chosen.tolist():
        xy[k, axis] += SIZE_UM / 1000.0 * rng.choice((-1.0, 1.0))
    rows = [replace(row, x=x, y=y) for row, (x, y) in zip(rows, xy.tolist(), strict=True)]
    return replace(made.block, image_points=tuple(rows)), {(k, a) for k, a in chosen.tolist()}


def main(seed: int = 1) -> int:
    """Print times, ratios and what was found; 0 when the search misses at most a tenth."""
    block, planted = spoiled(seed)
    start = perf_counter()
    adjusted = adjust_block(block)
    whole = perf_counter() - start
    n = adjusted.problem.observations
    print(f"{len(block.photos)} photos, {n} observations, {len(planted)} errors of {SIZE_UM:g} um")
    print(f"adjusted                 {1e3 * whole:9.1f} ms")
    start = perf_counter()
    system = block_residuals(adjusted.problem, adjusted.state, adjusted.cofactors.normal.structure)
    laid = perf_counter() - start
    start = perf_counter()
    linear = find_gross_errors(system, "search", SearchSettings())
    once = perf_counter() - start
    print(f"seen from its residuals  {1e3 * laid:9.1f} ms   {laid / whole:6.2f} adjustments")
    print(
        f"one linear search        {1e3 * once:9.1f} ms   {once / whole:6.2f} adjustments, "
        f"{len(linear.steps)} steps"
    )
    missed = len(planted)
    print("strategy          ms  adjustments   right   wrong  passes")
    for strategy in STRATEGIES:
        start = perf_counter()
        found = block_gross_errors(adjusted, strategy, SearchSettings())
        took = perf_counter() - start
        source = adjusted.problem.source
        got = {
            (int(source[row // 2]), row % 2)
            for row in found.findings.rows
            if row < found.system.rows.image
        }
        right = len(got & planted)
        if strategy == "search":
            missed = len(planted) - right
        print(
            f"{strategy:<10} {1e3 * took:9.1f} {took / whole:12.2f} {right:7d} "
            f"{len(found.findings.rows) - right:7d} {len(found.passes):7d}"
        )
    return 0 if missed <= ERRORS // 10 else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
