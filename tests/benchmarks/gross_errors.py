"""Time of the strategies for gross errors on 50 photos with 20 planted errors.

    python tests/benchmarks/gross_errors.py [seed]

Each is a ratio to the adjustment of the same block from its measurements alone, and to one linear
search, in one run; the whole of a strategy holds its passes, with a new adjustment after each.

    python tests/benchmarks/gross_errors.py sizes [largest side, default 50]

Regular blocks of 25 points a photo with one error in 500 rays, each in a process of its own:
processor time in units (one Cholesky factor of a 2000 x 2000 matrix, in the same run) of `baarda`
and `search` on the adjusted block, their exponents, and the peak of the memory.
"""

from __future__ import annotations

import resource
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from math import log
from time import perf_counter, process_time

import numpy as np
from bundle_speed import regular_block, unit

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.strategies import STRATEGIES, find_gross_errors
from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.residuals import block_residuals
from anaplot.photogrammetry.block import Block
from anaplot.planning.blockplan import BlockPlan, plan_block

ERRORS, SIZE_UM = 20, 90.0
SIDES, STRATEGIES_OF_SIZES = (10, 20, 50, 100), ("baarda", "search")


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


def one_size(side: int, strategy: str) -> None:
    """Print what a strategy takes on a regular block."""
    problem, state = regular_block(side)
    rng = np.random.default_rng(3)
    xy, count = problem.xy.copy(), max(len(problem.photo) // 500, 1)
    rays, axes = rng.choice(len(problem.photo), count, replace=False), rng.integers(0, 2, count)
    size = rng.uniform(20.0, 200.0, count) * rng.choice((-1.0, 1.0), count)
    xy[rays, axes] += size * problem.sigma_xy[rays, axes]
    rows = list(problem.block.image_points)
    for ray in rays.tolist():
        row = int(problem.source[ray])
        rows[row] = replace(rows[row], x=float(xy[ray, 0]), y=float(xy[ray, 1]))
    changed = replace(problem.block, image_points=tuple(rows))
    one = unit()
    adjusted = adjust_bundle(replace(problem, xy=xy, block=changed), state)
    start = process_time()
    found = block_gross_errors(adjusted, strategy, SearchSettings())
    took = process_time() - start
    one = min(one, unit())
    right = {divmod(row, 2) for row in found.findings.rows} & set(
        zip(rays.tolist(), axes.tolist(), strict=True)
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{strategy:<8} {side * side:6d} photos {len(problem.photo):8d} rays {count:5d} errors "
        f"{took / one:9.1f} units {peak:7.0f} MB  right {len(right):5d}  "
        f"others {len(found.findings.rows) - len(right):5d}  passes {len(found.passes)}"
    )


def sizes(largest: int = 50) -> int:
    """Print the table of sizes, each row by a process of its own; 0."""
    for strategy in STRATEGIES_OF_SIZES:
        measured = []
        for side in (side for side in SIDES if side <= largest):
            run = subprocess.run(
                [sys.executable, __file__, "size", str(side), strategy],
                capture_output=True,
                text=True,
                check=True,
            )
            print(run.stdout, end="", flush=True)
            measured.append((side, float(run.stdout.split(" units")[0].split()[-1])))
        for (n0, t0), (n1, t1) in pairwise(measured):
            growth = log(t1 / t0) / log(n1 / n0) / 2.0
            print(f"    from {n0**2} to {n1**2} photos: exponent {growth:.2f}")
    return 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["size"]:
        one_size(int(sys.argv[2]), sys.argv[3])
    elif sys.argv[1:2] == ["sizes"]:
        sys.exit(sizes(*map(int, sys.argv[2:])))
    else:
        sys.exit(main(*map(int, sys.argv[1:])))
