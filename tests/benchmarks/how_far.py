"""How far one machine goes: operations and memory of the equations of one block, and their times.

What the elimination costs follows from its fronts, so it is counted for blocks of any size; with
MEASURED sides the same is done as well, each side in a process of its own.

Run by hand: OMP_NUM_THREADS=1 python tests/benchmarks/how_far.py [sides, default 50,100]
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from typing import NamedTuple

import numpy as np
from bundle_speed import regular_block

from anaplot.bundle.solve.dissection import Dissection, dissect
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.reliability import compute_cofactors
from anaplot.bundle.solve.structure import make_structure

COUNTED = (100, 250, 316, 500, 1000)
REACHES = {2: "60/60", 4: "80/80"}  # photos so many bases apart share a point
D = 6  # unknowns of a photo
GIGA = 1e9


class Cost(NamedTuple):
    """Of an elimination: operations of factor and selected inverse, and of the inverse's diagonal
    blocks by solving for their columns; bytes, in all and at once; rows of the largest front.
    """

    factor: float
    inverse: float
    by_columns: float
    stored: float
    factor_peak: float
    inverse_peak: float
    largest: int


def regular_pattern(side: int, reach: int) -> Dissection:
    """Return the elimination order of a regular block's photos, without its rays."""
    at = np.arange(side)
    j, i = (grid.ravel() for grid in np.meshgrid(at, at, indexing="ij"))
    steps = [(a, b) for b in range(-reach, reach + 1) for a in range(-reach, reach + 1)]
    near = np.array([(i + a, j + b) for a, b in steps])  # (neighbours, 2, n)
    inside = ((near >= 0) & (near < side)).all(axis=1)
    counts = inside.sum(axis=0)
    indptr = np.concatenate(([0], np.cumsum(counts)))
    neighbour = (near[:, 1] * side + near[:, 0]).T[inside.T]
    return dissect(np.column_stack([i, j]).astype(float), indptr, neighbour)


def cost(dissection: Dissection) -> Cost:
    """Count what `factor.py` does: the factor of every front, its update, its part of the inverse.

    A multiplication and an addition are two operations.
    """
    fronts = dissection.fronts
    p = np.array([D * (f.last - f.first) for f in fronts], dtype=float)
    b = np.array([D * len(f.border) for f in fronts], dtype=float)
    factor = (p**3 / 3 + p**2 * b + p * b**2).sum()
    # G of L21; the inverse of a triangle and its square; Q_BB G; G' Q_BB G
    inverse = (p**2 * b + 2 * p**3 / 3 + 2 * p * b**2 + 2 * p**2 * b).sum()
    # a column is solved for in the fronts from its photo's to the root, down and up again
    beneath = p.copy()
    for k, front in enumerate(fronts):
        if front.parent >= 0:
            beneath[front.parent] += beneath[k]
    by_columns = (beneath * 2 * (p**2 + 2 * p * b)).sum()
    stored = 8 * (p**2 + p * b)
    so_far = np.cumsum(stored)
    waiting, most = 0.0, 0.0
    kept = np.zeros(len(fronts))
    below: list[list[int]] = [[] for _ in fronts]
    for k, front in enumerate(fronts):
        if front.parent >= 0:
            below[front.parent].append(k)
        mine = 8 * b[k] ** 2
        most = max(most, so_far[k] + stored[k] + waiting + mine)
        waiting += mine - sum(kept[child] for child in below[k])
        kept[k] = mine
    held, at_once = 0.0, 0.0
    left = np.array([len(children) for children in below])
    whole = 8 * (p + b) ** 2
    for k in range(len(fronts) - 1, -1, -1):
        at_once = max(at_once, held + whole[k])
        up = fronts[k].parent
        if up >= 0:
            left[up] -= 1
            if left[up] == 0:
                held -= whole[up]
        if left[k]:
            held += whole[k]
    return Cost(
        float(factor),
        float(inverse),
        float(by_columns),
        float(stored.sum()),
        float(most),
        float(stored.sum() + at_once),
        int((p + b).max()),
    )


def unit(size: int = 2000) -> float:
    """Seconds of processor time of one Cholesky factor."""
    rng = np.random.default_rng(0)
    a = rng.normal(size=(size, size))
    a = a @ a.T + size * np.eye(size)
    took = []
    for _ in range(5):
        start = time.process_time()
        np.linalg.cholesky(a)
        took.append(time.process_time() - start)
    return min(took)


def measured(side: int) -> None:
    """Print what the equations of a block take, in processor time, and the process's memory."""
    problem, state = regular_block(side)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / GIGA
    times = [time.process_time()]
    structure = make_structure(problem, state.centres)
    times.append(time.process_time())
    normal = NormalEquations(problem, structure, linearise(problem, state))
    times.append(time.process_time())
    factor = normal.factor()
    times.append(time.process_time())
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / GIGA
    compute_cofactors(normal, factor)
    times.append(time.process_time())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / GIGA
    one = unit()
    names = ("order and pattern", "equations", "factor", "inverse and all r")
    split = ", ".join(f"{n} {t / one:.0f}" for n, t in zip(names, np.diff(times), strict=True))
    print(
        f"{side * side:8d} photos, {len(problem.photo)} rays: {split} units of {one:.3f} s; peak "
        f"{before:.2f} GB with the rays, {after:.2f} with the factor, {peak:.2f} at the end",
        flush=True,
    )


def main() -> None:
    """Print what is measured, then what is counted."""
    if len(sys.argv) > 2 and sys.argv[1] == "--one":
        measured(int(sys.argv[2]))
        return
    sides = sys.argv[1] if len(sys.argv) > 1 else "50,100"
    for side in sides.split(","):
        # each in a process of its own, while this one is small: a peak of memory is never an
        # earlier one's, nor that of the process that starts it
        subprocess.run([sys.executable, __file__, "--one", side], check=True, env=dict(os.environ))
    print("                   10^12 operations            GB                          rows of the")
    print(
        "         photos    factor  inverse  by columns  factor  at once  inverse    largest front"
    )
    for reach, overlap in REACHES.items():
        for side in COUNTED if reach == 2 else COUNTED[:3]:
            of = cost(regular_pattern(side, reach))
            print(
                f"{overlap} {side * side:9d} {of.factor / 1e12:9.2f} {of.inverse / 1e12:8.2f} "
                f"{of.by_columns / 1e12:11.1f} {of.stored / GIGA:7.1f} "
                f"{of.factor_peak / GIGA:8.1f} {of.inverse_peak / GIGA:8.1f} {of.largest:14d}",
                flush=True,
            )


if __name__ == "__main__":
    main()
