"""Time of 10 000 runs of the 13-point, 5-tie model at once, as a ratio to one call for each run.

    python tests/benchmarks/simulation.py [runs]

Each run has noise and one error of 10 sigma; stepwise rejection with known sigma. Then the
parallel efficiency of a simulation: what two processes gain, start included, of what they could.
"""

from __future__ import annotations

import sys
from time import perf_counter

import numpy as np
from model_speed import tilted_pair

from anaplot.adjustment.batch import reject_stepwise
from anaplot.orientation.model import orient
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.planning.montecarlo import simulate
from anaplot.planning.scenarios import scenarios
from anaplot.shares.local import LocalProcesses


def main(runs: int = 10_000) -> int:
    """Print both times and their ratio; 0 when both reject the same rows."""
    solution = orient(tilted_pair(), Precision(5.0, "propagated"), TestSettings())
    root = np.sqrt(solution.q_l)
    matrix = solution.q_vv / root[:, None] / root
    rng = np.random.default_rng(13)
    errors = rng.normal(size=(runs, len(matrix)))
    errors[np.arange(runs), rng.integers(len(matrix), size=runs)] += 10.0
    start = perf_counter()
    at_once = reject_stepwise(matrix, errors, "baarda", 0.001)
    middle = perf_counter()
    singly = [reject_stepwise(matrix, run[None], "baarda", 0.001)[0] for run in errors]
    end = perf_counter()
    print(f"{runs} runs at once   {(middle - start) * 1e3:9.1f} ms")
    print(f"{runs} runs one by one{(end - middle) * 1e3:9.1f} ms")
    print(f"ratio {(end - middle) / (middle - start):.1f}")
    scenario = scenarios()["size-strips"]
    start = perf_counter()
    one = simulate(scenario, seed=1)
    middle = perf_counter()
    two = simulate(scenario, seed=1, place=LocalProcesses(2))
    end = perf_counter()
    gain = (middle - start) / (end - middle)
    print(f"{scenario.name}, {scenario.runs} runs, 1 process  {middle - start:7.2f} s")
    print(f"{scenario.name}, {scenario.runs} runs, 2 processes{end - middle:7.2f} s")
    print(f"parallel efficiency on two cores {gain / 2.0:.2f}")
    if one != two:
        return 1
    return 0 if np.array_equal(at_once, np.array(singly)) else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
