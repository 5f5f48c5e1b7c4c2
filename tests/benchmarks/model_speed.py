"""Time of one model as a multiple of one small least-squares solution, measured in one run.

    python tests/benchmarks/model_speed.py [rounds]

One later model of the 13-point, 5-tie pattern: solution, covariances, table; from coordinates by
name, as the console forms it after every record; and with what is said beyond the table. Against
one numpy.linalg.lstsq of a 23 x 6 system. Bursts of calls alternate, and of each the least
processor time counts: whatever else the machine does adds to it. The goal is that of the model
with its table.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import process_time

import numpy as np

from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import orient
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.patterns import pattern
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Camera, Precision, TestSettings, TieVariance
from anaplot.photogrammetry.rotation import rotation_matrix

B, D, C = 92.0, 100.0, 152.4
GOAL = 8.0
BURST = 10  # calls; a single call of lstsq among longer ones would be measured with cold caches

Coordinates = dict[str, tuple[float, float]]


class Strip:
    """The coordinates of two models with tilts of some degrees, relief and noise of 5 um."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(1983)
        p = pattern("13/5")
        places = p.positions(B, D, (4.0, 4.0))
        self._xy = {label: places[label] for label in p.labels}
        before = {f"0-{label}": (x - B, y) for label, (x, y) in self._xy.items()}
        before |= {label: self._xy[label] for label in p.ties}
        self._relief = {name: self._rng.uniform(-1.0, 1.0) for name in {**self._xy, **before}}
        self._centres = np.array(((-B, 0.0, 0.0), (0.0, 1.0, 1.0), (B, 3.0, 0.0)))
        tilts = ((0.0, 0.0, 0.0), (1.0, -0.5, -2.0), (3.0, -2.0, 3.0))
        self._rotations = [rotation_matrix(*np.radians(angles).tolist()) for angles in tilts]
        self.cameras = (Camera("c", C), Camera("c", C))
        self._first = self._seen(0, before), self._seen(1, before)
        self.second = self._seen(1, self._xy), self._seen(2, self._xy)

    def _seen(self, photo: int, xy: Coordinates) -> Coordinates:
        """Return what is measured in a photo."""
        ground = np.array([(*xy[name], -C * (1.0 + 0.05 * self._relief[name])) for name in xy])
        seen = (ground - self._centres[photo]) @ self._rotations[photo]
        image = -C * seen[:, :2] / seen[:, 2:] + 0.005 * self._rng.standard_normal((len(xy), 2))
        return dict(zip(xy, map(tuple, image.tolist()), strict=True))

    def preceding(self, precision: Precision) -> ModelSolution:
        """Return the first model."""
        pair = stereopair(("101", "102"), *self._first, self.cameras, preceding=None, base=B)
        return orient(pair, precision, TestSettings())

    def pair(self, preceding: ModelSolution) -> Stereopair:
        """Put together what the second model is computed from."""
        return stereopair(("102", "103"), *self.second, self.cameras, preceding=preceding)


def tilted_pair(tie_variance: TieVariance = "propagated") -> Stereopair:
    """Return the measurements of a later model."""
    strip = Strip()
    return strip.pair(strip.preceding(Precision(5.0, tie_variance)))


def measured(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the least time [s] of each call; bursts of calls alternate."""
    times = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            start = process_time()
            for _ in range(BURST):
                call()
            times[name] = min(times[name], (process_time() - start) / BURST)
    return times


def main(rounds: int = 300) -> int:
    """Print the multiples; 0 when the goal is reached."""
    strip, test = Strip(), TestSettings()
    rng = np.random.default_rng(6)
    matrix, right = rng.normal(size=(23, 6)), rng.normal(size=23)
    calls: dict[str, Callable[[], object]] = {
        "lstsq 23 x 6": lambda: np.linalg.lstsq(matrix, right, rcond=None)
    }
    tie_variances: tuple[TieVariance, ...] = ("propagated", "exact")
    for tie_variance in tie_variances:
        precision = Precision(5.0, tie_variance)
        preceding = strip.preceding(precision)
        known = strip.pair(preceding)

        def whole(preceding: ModelSolution = preceding, p: Precision = precision) -> object:
            return orient(strip.pair(preceding), p, test).table

        def with_table(known: Stereopair = known, p: Precision = precision) -> object:
            return orient(known, p, test).table

        def alone(known: Stereopair = known, p: Precision = precision) -> object:
            return orient(known, p, test)

        def diagnosed(known: Stereopair = known, p: Precision = precision) -> object:
            solution = orient(known, p, test)
            return solution.table, diagnose(solution)

        calls |= {
            f"{tie_variance}: solution and covariances": alone,
            f"{tie_variance}: with its table": with_table,
            f"{tie_variance}: from coordinates by name": whole,
            f"{tie_variance}: with table and diagnosis": diagnosed,
        }
    solution = orient(known, precision, test)
    measured(calls, 10)
    times = measured(calls, rounds)
    unit = times["lstsq 23 x 6"]
    print(
        f"{len(known.points)} points, {len(solution.ties)} ties, {len(solution.table)} rows, "
        f"{solution.iterations} iterations; least of {rounds} alternating bursts"
    )
    for name, time in times.items():
        said = f"   goal {GOAL:.0f}" if name.endswith("with its table") else ""
        print(f"{name:<40}{time * 1e6:9.1f} us{time / unit:8.1f} x{said}")
    return 0 if max(times[f"{one}: with its table"] for one in tie_variances) <= GOAL * unit else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:2])))
