"""Speed of the bundle, as multiples of one Cholesky factor of a 2000 x 2000 matrix.

Run by hand: python tests/benchmarks/bundle_speed.py [largest side of the block, default 50]
"""

from __future__ import annotations

import resource
import sys
import time
from dataclasses import replace
from itertools import cycle, pairwise
from math import log

import numpy as np

from anaplot.bundle.live import LiveBlock
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.reliability import compute_cofactors
from anaplot.bundle.solve.structure import make_structure
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    TestSettings,
)

BASE, HEIGHT, C = 600.0, 1000.0, 150.0


def regular_block(side: int, half: int = 2) -> tuple[Problem, BlockState]:
    """A side x side block, 60/60, with 2 half + 1 by 2 half + 1 points a photo.

    Control is at every third base.
    """
    lines = range(-half, half * (side - 1) + half + 1)
    rng = np.random.default_rng(1)
    photos = {(i, j): f"{i}-{j}" for j in range(side) for i in range(side)}
    rows, names = [], {}
    heights = rng.uniform(-20.0, 20.0, (len(lines), len(lines)))
    for (i, j), name in photos.items():
        for b in range(-half, half + 1):
            for a in range(-half, half + 1):
                x, y = half * i + a, half * j + b
                point = names.setdefault((x, y), f"p{x}_{y}")
                depth = HEIGHT - heights[x + half, y + half]
                off = rng.normal(size=2) * 5e-3
                rows.append(
                    ImagePoint(
                        name,
                        point,
                        a * BASE / half * C / depth + off[0],
                        b * BASE / half * C / depth + off[1],
                    )
                )
    control = tuple(
        ControlPoint(
            p, (x * BASE / half, y * BASE / half, heights[x + half, y + half]), (0.05, 0.05, 0.05)
        )
        for (x, y), p in names.items()
        if x % (3 * half) == 0 and y % (3 * half) == 0
    )
    block = Block(
        "regular",
        Precision(),
        TestSettings(),
        (Camera("c", C),),
        tuple(
            Photo(p, "c", (i * BASE, j * BASE, HEIGHT), (0.0, 0.0, 0.0))
            for (i, j), p in photos.items()
        ),
        (),
        tuple(rows),
        control,
    )
    problem = make_problem(block)
    where = {p: k for k, p in names.items()}
    points = np.array(
        [
            (
                where[p][0] * BASE / half,
                where[p][1] * BASE / half,
                heights[where[p][0] + half, where[p][1] + half],
            )
            for p in problem.points
        ]
    )
    centres = np.array([(i * BASE, j * BASE, HEIGHT) for i, j in photos])
    origin = points.mean(axis=0)
    state = BlockState(
        centres - origin,
        np.broadcast_to(np.eye(3), (len(centres), 3, 3)).copy(),
        points - origin,
        np.zeros((len(centres), 0)),
        np.zeros(0),
        origin,
    )
    return problem, state


def best(action, repeats: int) -> tuple[float, object]:
    """Shortest time of several runs, and the last result."""
    shortest, result = float("inf"), None
    for _ in range(repeats):
        result = None
        start = time.perf_counter()
        result = action()
        shortest = min(shortest, time.perf_counter() - start)
    return shortest, result


def unit(size: int = 2000) -> float:
    """Seconds of one Cholesky factor."""
    rng = np.random.default_rng(0)
    a = rng.normal(size=(size, size))
    a = a @ a.T + size * np.eye(size)
    return best(lambda: np.linalg.cholesky(a), 3)[0]


def dense_step(problem: Problem, state: BlockState):
    """The same answer from the dense formula: all q_vv by one inverse of the full matrix."""
    linear = linearise(problem, state)
    n, m, p = len(problem.photos), len(problem.photo), len(problem.points)
    design = np.zeros((2 * m, 6 * n + 3 * p))
    for ray in range(m):
        photo, point = problem.photo[ray], problem.point[ray]
        design[2 * ray : 2 * ray + 2, 6 * photo : 6 * photo + 6] = linear.a[ray]
        at = 6 * n + 3 * point
        design[2 * ray : 2 * ray + 2, at : at + 3] = linear.b[ray]
    normal = design.T @ design
    index = 6 * n + np.arange(3 * p)
    normal[index, index] += linear.point_weight.sum(axis=0).ravel()
    inverse = np.linalg.inv(normal)
    return 1.0 - np.einsum("ij,jk,ik->i", design, inverse, design, optimize=True)


def complete_step(problem: Problem, state: BlockState, structure):
    """Derivatives, equations, factor, corrections and every redundancy number."""
    times = [time.perf_counter()]
    linear = linearise(problem, state)
    times.append(time.perf_counter())
    normal = NormalEquations(problem, structure, linear)
    times.append(time.perf_counter())
    factor = normal.factor()
    times.append(time.perf_counter())
    photos, points, shared = normal.own_gradient
    normal.solve(factor, photos[:, :, None], points[:, :, None], shared[:, None])
    times.append(time.perf_counter())
    cofactors = compute_cofactors(normal, factor)
    times.append(time.perf_counter())
    return cofactors, np.diff(times)


def live_block() -> None:
    """Print what the live block needs after a re-measurement in 49 photos."""
    problem, _ = regular_block(7)
    live = LiveBlock(problem.block)
    one = unit()
    structure = live.update(problem.block).adjusted.cofactors.normal.structure
    rows = list(problem.block.image_points)
    shifts = cycle((0.001, -0.001))

    def again():
        rows[600] = replace(rows[600], x=rows[600].x + next(shifts))
        answer = live.update(replace(problem.block, image_points=tuple(rows)))
        assert answer.adjusted.cofactors.normal.structure is structure
        return answer

    took, _ = best(again, 20)
    one = min(one, unit())
    print(f"live block, 49 photos, one re-measurement: {took / one:.2f} units (to reach 1)")


def main() -> None:
    """Print the table."""
    largest = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    targets = {7: (0.4, 0.25), 20: (3.5, 2.5), 50: (40.0, 25.0), 100: (200.0, 120.0)}
    measured = []
    for side in (7, 20, 50, 100):
        if side > largest:
            break
        problem, state = regular_block(side)
        one = unit()
        laying, structure = best(
            lambda p=problem, s=state: make_structure(p, s.centres), 3 if side <= 20 else 1
        )
        repeats = {7: 20, 20: 5, 50: 2, 100: 1}[side]
        took, result = best(lambda p=problem, s=state, t=structure: complete_step(p, s, t), repeats)
        one = min(one, unit())
        cofactors, parts = result
        sum_r = cofactors.r.sum() + np.nansum(cofactors.r_ground)
        names = ("derivatives", "equations", "factor", "solution", "reliability")
        split = ", ".join(f"{n} {t / one:.2f}" for n, t in zip(names, parts, strict=True))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(
            f"{side * side:6d} photos, {problem.observations} observations: "
            f"{took / one:.2f} units ({took:.3f} s, unit {one:.3f} s; to reach {targets[side][0]}, "
            f"to aim at {targets[side][1]}); pattern once {laying / one:.2f}; "
            f"sum of r - redundancy {sum_r - problem.redundancy:.1e}; peak {peak:.2f} GiB"
        )
        print(f"        last run: {split}")
        measured.append((side * side, took / one))
        if side == 7:
            dense, r = best(lambda p=problem, s=state: dense_step(p, s), 1)
            worst = np.abs(np.asarray(r) - cofactors.r.ravel()).max()
            print(f"        dense path: {dense / took:.1f} times as long, r differs by {worst:.1e}")
    live_block()
    for (n0, t0), (n1, t1) in pairwise(measured):
        print(f"growth from {n0} to {n1} photos: exponent {log(t1 / t0) / log(n1 / n0):.2f}")


if __name__ == "__main__":
    main()
