"""How long a block takes to open whose journal is long.

Run it as `python tests/benchmarks/journal_opening.py [strips photos]`. Journals of 1000 and of
10 000 points of flown strips are written, with the line's traffic and a table after every point,
and read and opened as the console does it: for the first time, when image_points.csv is written
too, again, and with a simulated plotter. Every stage has a process of its own, in which nothing is
remembered of another one. Processor time of the thread that opens, beside that of parsing all
lines with `json.loads`; the first ratio is 10 when every point costs the same. The memory is the
process's, with what the block takes that is adjusted in the background by then.
"""

from __future__ import annotations

import gc
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from syntheticblocks import SyntheticBlock, synthetic_block

from anaplot.exchange.blockfolder import read_block, write_control, write_new_block
from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import Journal
from anaplot.exchange.journalread import scan_journal
from anaplot.photogrammetry.block import Strip
from anaplot.session.events import (
    EVENT_KINDS,
    Event,
    ModelAccepted,
    ModelChosen,
    PlannedPoint,
    PointMeasured,
)
from anaplot.session.state import apply, start
from anaplot.simulation.instrument import SimulationSetup
from anaplot.station.header import session_header
from anaplot.station.restored import Folding, Past, Snapshots
from anaplot.station.station import Station

POINTS = 20  # a model, at most
Seen = dict[str, tuple[float, float]]
Noise = Callable[[tuple[float, float]], tuple[float, float]]
TRAFFIC = {"items": [["in", "main", "P +012.3456 -034.5678 +012.0000 -034.5000\n", 12345.6]] * 8}
TABLE = {"rows": [["101-1", "y", 0.1234567890123, 1.234567890123, 0.987654321, 1.2345678]] * 18}


def model(
    flown: SyntheticBlock, strip: Strip, photos: tuple[str, str], before: Seen, noise: Noise
) -> tuple[list[Event], Seen]:
    """Return what happens in a model, and where its points lie in its right photo."""
    left, right = photos
    common = [p for p in flown.truth[left] if p in flown.truth[right]]
    points = [p for p in common if p in flown.ground][:POINTS]
    there = {p: noise(flown.truth[right][p]) for p in points}
    places = {p: (*(before.get(p) or noise(flown.truth[left][p])), *there[p]) for p in points}
    plan = tuple(
        PlannedPoint(p, "tie" if p in before else "new", *place) for p, place in places.items()
    )
    measured = [PointMeasured(left, right, p, *place, "1") for p, place in places.items()]
    return [ModelChosen(strip.id, left, right, plan), *measured, ModelAccepted(left, right)], there


def write(folder: Path, strips: int, photos: int) -> int:
    """Write a block with the journal of a day; return how many points were measured."""
    random = np.random.default_rng(1)

    def noise(xy: tuple[float, float]) -> tuple[float, float]:
        x, y = (np.array(xy) + random.normal(0.0, 0.005, 2)).round(4).tolist()
        return x, y

    flown = synthetic_block(strips, photos, seed=1)
    write_new_block(folder, replace(flown.block, image_points=(), control=()))
    write_control(folder, flown.block.control)
    block = read_block(folder)
    count = 0
    with Journal.open(folder, session_header(block, "", None, ""))[0] as journal:
        state = start(block)
        snapshots = Snapshots(journal, block, Past(0, 0, state, frozenset()))
        for strip in block.strips:
            seen: Seen = {}
            for pair in strip.models():
                events, seen = model(flown, strip, pair, seen, noise)
                for event in events:
                    records = [("traffic", TRAFFIC), (event.kind, event_to_payload(event))]
                    journal.append_many([*records, ("table", TABLE)], durable=False)
                    state = apply(state, event)
                    snapshots.happened([event], state)
                count += len(events) - 2
    return count


def loads(folder: Path) -> None:
    """Parse every line, and nothing else."""
    for path in sorted((folder / "sessions").glob("*.jsonl")):
        with path.open("rb") as file:
            for line in file:
                json.loads(line)


def replayed(folder: Path) -> None:
    """Make the state of all events, without a snapshot."""
    folding = Folding(start(read_block(folder)))
    scan_journal(folder, lambda kind: kind in EVENT_KINDS, folding.take)
    folding.check()


def opened(folder: Path, *, simulate: bool = False) -> None:
    """Open the block as the console does."""
    photos = read_block(folder).photos if simulate else ()
    plotter = SimulationSetup({photo.id: {} for photo in photos}) if simulate else None
    Station(folder, plotter=plotter, candidates={}).close()


STAGES: dict[str, Callable[[Path], object]] = {
    "json.loads": loads,
    "files alone": read_block,
    "all events": replayed,
    "written": opened,  # for the first time, image_points.csv too
    "opened": opened,
    "simulated": partial(opened, simulate=True),
}


def measured(what: str, folder: Path) -> tuple[float, float]:
    """Return the seconds of a stage in this thread, and the largest memory [MB] of the process."""
    gc.set_threshold(100_000)  # as the program has it
    begin = time.thread_time()
    STAGES[what](folder)
    taken = time.thread_time() - begin
    return taken, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def alone(work: Callable[..., Any], *arguments: object) -> Any:
    """Return what a function returns in a process of its own: nothing is remembered there."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def main() -> None:
    """Print times, ratios and memory."""
    sizes = [(2, 26), (13, 40)]
    if len(sys.argv) > 2:
        sizes[1] = int(sys.argv[1]), int(sys.argv[2])
    with tempfile.TemporaryDirectory() as name:
        days, counts = [], []
        for strips, photos in sizes:
            folder = Path(name) / f"{strips}-{photos}"
            counts.append(alone(write, folder, strips, photos))
            days.append({what: alone(measured, what, folder) for what in STAGES})
    short, long = days
    for what, (seconds, megabytes) in long.items():
        print(
            f"{what:11} {counts[0]} points {1e3 * short[what][0]:7.1f} ms, {counts[1]} points "
            f"{1e3 * seconds:8.1f} ms, ratio {seconds / short[what][0]:5.1f}, "
            f"{seconds / long['json.loads'][0]:5.2f} times json.loads, {megabytes:5.0f} MB"
        )


if __name__ == "__main__":
    sys.exit(main())
