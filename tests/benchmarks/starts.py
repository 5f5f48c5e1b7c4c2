"""Whether blocks of every kind are oriented from nothing, and what a ray of them costs.

    python tests/benchmarks/starts.py [blocks of each kind] [kind ...] [--size N] [--large]

Random blocks of fourteen kinds (tests/bundle/startkinds.py) of which nothing is known but image
coordinates and some control. Each is adjusted from nothing and from its true values: "failed" says
that no minimum was found, "wrong" that it is another one than from the truth. Time is that of the
processor, of the search for approximate values and of everything to the minimum, for each ray.
`--large` adds a ring of 10 photos, 34 photos around a solid object, 132 photos of a drone, and a
walk around a building with 1 % mismatches.
The exit code is 1 where a block failed or has a wrong minimum.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import process_time
from zlib import crc32

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "bundle"))

from bundleblocks import Scene
from startkinds import (
    KINDS,
    Layout,
    building,
    drone,
    looking_in,
    measured,
    outside,
    with_mismatches,
)

from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start import bestminimum
from anaplot.errors import NotComputableError

SAME = 1e-6  # of v'Pv


def main(given: list[str]) -> int:
    """Print failures, wrong minima and times of every kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("blocks", nargs="?", type=int, default=6)
    parser.add_argument("kinds", nargs="*", choices=[[], *KINDS])
    parser.add_argument("--size", type=int, default=1, help="times as many photos")
    parser.add_argument("--large", action="store_true")
    options = parser.parse_args(given)
    print(f"{'kind':28} {'blocks':>6} {'failed':>6} {'wrong':>6} {'ms/ray':>8} {'worst':>8}   rays")
    bad = 0
    for kind in options.kinds or KINDS:
        seeds = [crc32(kind.encode()) % 1000 + k for k in range(options.blocks)]
        scenes = [_scene(kind, seed, options.size) for seed in seeds]
        bad += _row(kind, scenes)
    if options.large:
        for name, layout in _large():
            bad += _row(name, [measured(layout, np.random.default_rng(1))])
        rng = np.random.default_rng(1)
        around = measured(building(rng, 60, 6000), rng)
        bad += _row("building, 1 % mismatches", [with_mismatches(around, rng, 0.01)])
    return 1 if bad else 0


def _scene(kind: str, seed: int, size: int) -> Scene:
    rng = np.random.default_rng(seed)
    return measured(KINDS[kind](rng, size), rng)


def _large() -> list[tuple[str, Layout]]:
    rng = np.random.default_rng(7)
    around, object_points = 2.0 * np.pi * np.arange(10) / 10, rng.uniform(-3.0, 3.0, (60, 3))
    return [
        ("ring of 10 photos", looking_in(rng, around, np.full(10, 0.35), 12.0, object_points)),
        ("34 photos from one side", outside(rng, 34, 300)),
        ("drone, 132 photos", drone(rng, 4)),
    ]


def _row(name: str, scenes: list[Scene]) -> int:
    """Print what became of blocks of one kind; returns how many went wrong."""
    failed = wrong = 0
    times, rays = [], []
    for scene in scenes:
        problem = make_problem(scene.block)
        begin = process_time()
        try:
            found = bestminimum.best_minimum(problem, None, problem)[0]
        except NotComputableError as error:
            failed += 1
            print(f"  {name}: {error}", file=sys.stderr)
            found = None
        times.append(process_time() - begin)
        rays.append(len(problem.photo))
        if found is not None:
            start = scene.start(problem)
            true = find_minimum(problem, start, make_structure(problem, start.centres))
            least = true.convergence.last
            wrong += abs(found.convergence.last - least) > SAME * max(least, 1.0)
    each = 1e3 * np.array(times) / rays
    mean = 1e3 * sum(times) / sum(rays)
    print(
        f"{name:28} {len(scenes):6} {failed:6} {wrong:6} {mean:8.3f} {each.max():8.3f}   "
        f"{min(rays)}..{max(rays)}",
        flush=True,
    )
    return failed + wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
