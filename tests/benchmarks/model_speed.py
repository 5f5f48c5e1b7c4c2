"""Time of one model as a multiple of one small least-squares solution, measured in one run.

    python tests/benchmarks/model_speed.py [rounds]

One later model of the 13-point, 5-tie pattern from nothing (solution, Q_vv, table), with and
without diagnosis, against one numpy.linalg.lstsq of an 18 x 6 system. Short bursts of calls
alternate, so that whatever else the machine does falls on all of them; medians are compared.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from statistics import median
from time import perf_counter

import numpy as np

from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import orient
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.photogrammetry.rotation import rotation_matrix

B, D, C = 92.0, 100.0, 152.4
AT_MOST, AT_MOST_DIAGNOSED = 20.0, 30.0
BURST = 10  # calls; a single call of lstsq among longer ones would be measured with cold caches


def tilted_pair() -> Stereopair:
    """Return a later model with tilts of some degrees, relief and noise of 5 um."""
    rng = np.random.default_rng(1983)
    p = pattern("13/5")
    places = p.positions(B, D, (4.0, 4.0))
    xy = np.array([places[label] for label in p.labels])
    ground = np.column_stack((xy, -C * (1.0 + 0.05 * rng.uniform(-1.0, 1.0, len(xy)))))
    rotation = rotation_matrix(*np.radians([2.0, -1.5, 5.0]).tolist())
    seen = (ground - [B, 2.0, -1.0]) @ rotation
    noise = 0.005 * rng.standard_normal((2, len(xy), 2))
    ties = {label: tuple(ground[p.labels.index(label)].tolist()) for label in p.ties}
    return Stereopair(
        left="101",
        right="102",
        points=p.labels,
        xl=-C * ground[:, :2] / ground[:, 2:] + noise[0],
        xr=-C * seen[:, :2] / seen[:, 2:] + noise[1],
        c_left=C,
        c_right=C,
        ties=ties,
        preceding_bx=B,
    )


def measured(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the median time [s] of each call; bursts of calls alternate."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = perf_counter()
            for _ in range(BURST):
                call()
            times[name].append((perf_counter() - start) / BURST)
    return {name: median(values) for name, values in times.items()}


def main(rounds: int = 300) -> int:
    """Print the multiples; 0 when both stay within their limits."""
    pair, precision, test = tilted_pair(), Precision(5.0, "propagated"), TestSettings()
    rng = np.random.default_rng(6)
    matrix, right = rng.normal(size=(18, 6)), rng.normal(size=18)
    solution = orient(pair, precision, test)
    calls: dict[str, Callable[[], object]] = {
        "lstsq 18 x 6": lambda: np.linalg.lstsq(matrix, right, rcond=None),
        "model": lambda: orient(pair, precision, test),
        "model and diagnosis": lambda: diagnose(orient(pair, precision, test)),
    }
    measured(calls, 10)
    times = measured(calls, rounds)
    unit = times["lstsq 18 x 6"]
    limits = {"model": AT_MOST, "model and diagnosis": AT_MOST_DIAGNOSED}
    print(
        f"{len(pair.points)} points, {len(solution.ties)} ties, {len(solution.table)} rows, "
        f"{solution.iterations} iterations; medians of {rounds} alternating bursts"
    )
    kept = True
    for name, time in times.items():
        limit = limits.get(name)
        said = "" if limit is None else f"   at most {limit:.0f}"
        print(f"{name:<22}{time * 1e6:9.1f} us{time / unit:8.1f} x{said}")
        kept = kept and (limit is None or time <= limit * unit)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:2])))
