"""A short strip measured by the automatic operator on any profile, through any fault."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anaplot.adjustment.tested import Observation
from anaplot.exchange.blockfolder import write_new_block
from anaplot.photogrammetry.block import Block, TestSettings
from anaplot.planning.synthetic import Truth, synthetic_strip
from anaplot.plotter.device.faults import LASTING_FAULTS
from anaplot.plotter.device.hand import Offsets
from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.demo import rough
from anaplot.simulation.instrument import SimulationSetup
from anaplot.simulation.laidplates import random_placements
from anaplot.station.rebuild import session_solutions
from anaplot.station.snapshot import Snapshot
from anaplot.station.station import Station

PATTERN = "9"
TIME_SCALE = 1000.0
SECONDS = 2500.0  # simulated: how long a lasting fault lasts, longer than any line may be silent

Tables = list[tuple[str, list[Observation]]]


@dataclass(frozen=True)
class Scene:
    """A block without measurements, and what lies in its plates."""

    block: Block
    truth: Truth


def scene(models: int = 2, seed: int = 4, *, image_um: float = 5.0) -> Scene:
    """A strip whose plates already hold the noise: every pointing at a point gives the same."""
    made = synthetic_strip(
        models + 1, seed=seed, image_um=image_um, test=TestSettings(kind="baarda")
    )
    rng = np.random.default_rng(seed)
    truth = {
        photo: {
            point: (x + e, y + f)
            for (point, (x, y)), (e, f) in zip(
                points.items(),
                rng.normal(0.0, image_um / 1000.0, (len(points), 2)).tolist(),
                strict=True,
            )
        }
        for photo, points in made.truth.items()
    }
    return Scene(made.block, truth)


@dataclass
class Job:
    """What came of it."""

    tables: Tables
    notices: list[tuple[str, str]]
    injected: int


def run_job(
    folder: Path,
    made: Scene,
    profile: str,
    *,
    fault: str = "",
    pattern: str = PATTERN,
    at: tuple[int, ...] = (2, 11),
    rates: Mapping[str, float] | None = None,
    mistakes: Mapping[tuple[str, str, str], Offsets] | None = None,
    noise_um: float = 0.0,
    story: str = "",
    limit: Callable[[Snapshot], bool] | None = None,
) -> Job:
    """Measure the strip; the fault strikes whenever so many measurements have been made.

    The job ends early when `limit` says so of what the operator sees.
    """
    if not (folder / "block.toml").exists():
        write_new_block(folder, made.block)
    setup = SimulationSetup(
        made.truth,
        seed=7,
        noise_um=noise_um,
        mistakes=mistakes,
        time_scale=TIME_SCALE,
        placements=random_placements(made.block, 7),
        profile=profile,
    )
    notices: list[tuple[str, str]] = []
    open_faults = list(at) if fault else []
    lock = threading.Lock()
    injected = 0
    with Station(
        folder,
        plotter=setup,
        point_pattern=pattern,
        operator="tester",
        candidates=rough(made.truth),
        story=story,
    ) as station:
        assert station.instrument is not None
        simulator = station.instrument.simulator
        assert simulator is not None
        simulator.set_fault_rates(rates or {})
        operator = AutomaticOperator(station)

        def watch(picture: Snapshot) -> None:
            nonlocal injected
            done = len(picture.accepted) * 9 + sum(p.times for p in picture.points)
            with lock:
                while open_faults and done >= open_faults[0]:
                    open_faults.pop(0)
                    injected += 1
                    lasting = fault in LASTING_FAULTS
                    simulator.inject(fault, seconds=SECONDS if lasting else None)
            if limit is not None and limit(picture):
                operator.stop()

        station.subscribe(watch)
        station.subscribe_notices(lambda severity, text: notices.append((severity, text)))
        operator.run()
        solutions = session_solutions(station.state)
    tables = [(model.name, list(model.table)) for _, model in solutions]
    return Job(tables, notices, injected)
