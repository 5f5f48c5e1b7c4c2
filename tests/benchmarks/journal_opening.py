"""How long a block takes to open whose journal is long.

Run it as `python tests/benchmarks/journal_opening.py`. Journals of 1000 and of 10 000 points are
written, with the line's traffic and a table after every point, and read and opened as the console
does it. The ratio is of one run on one machine: 10 when every point costs the same.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from anaplot.exchange.blockfolder import read_block, write_new_block
from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import Journal, read_journal
from anaplot.photogrammetry.block import Photo
from anaplot.session.events import (
    EVENT_KINDS,
    Event,
    ModelAccepted,
    ModelChosen,
    PlannedPoint,
    PointMeasured,
)
from anaplot.session.state import apply, start
from anaplot.simulation.demo import Demo
from anaplot.station.header import session_header
from anaplot.station.restored import Past, Snapshots, restored
from anaplot.station.station import Station

POINTS = 13  # a model
TIES = 5
_TRAFFIC = {"items": [["in", "main", "P +012.3456 -034.5678 +012.0000 -034.5000\n", 12345.6]] * 8}
_TABLE = {"rows": [["101-1", "y", 0.1234567890123, 1.234567890123, 0.987654321, 1.2345678]] * 18}


def model(k: int, ties: list[str], random: np.random.Generator) -> Iterator[Event]:
    """Yield what happens in the k-th model."""
    left, right = str(k), str(k + 1)
    names = [*ties, *(f"{k}-{i}" for i in range(POINTS - len(ties)))]
    places = [tuple(float(v) for v in random.uniform(-80.0, 80.0, 4).round(3)) for _ in names]
    plan = [
        PlannedPoint(name, "tie" if name in ties else "new", *place)
        for name, place in zip(names, places, strict=True)
    ]
    yield ModelChosen("1", left, right, tuple(plan))
    for name, (xl, yl, xr, yr) in zip(names, places, strict=True):
        yield PointMeasured(left, right, name, xl, yl, xr, yr, "1")
    yield ModelAccepted(left, right)


def write(folder: Path, points: int) -> None:
    """Write a block with the journal of a day."""
    models = -(-points // POINTS)
    random = np.random.default_rng(1)
    some = Demo.make(1, 1).strip.block
    photos = [str(k) for k in range(1, models + 2)]
    camera = some.cameras[0].id
    block = replace(
        some,
        photos=tuple(Photo(id=photo, camera=camera) for photo in photos),
        strips=(replace(some.strips[0], id="1", photos=tuple(photos)),),
        image_points=(),
        control=(),
    )
    write_new_block(folder, block)
    ties: list[str] = []
    block = read_block(folder)
    with Journal.open(folder, session_header(block, "", None, ""))[0] as journal:
        state = start(block)
        snapshots = Snapshots(journal, block, Past((), 0, state, frozenset()))
        for k in range(1, models + 1):
            for event in model(k, ties, random):
                records = [("traffic", _TRAFFIC), (event.kind, event_to_payload(event))]
                journal.append_many([*records, ("table", _TABLE)], durable=False)
                state = apply(state, event)
                snapshots.happened([event], state)
            ties = [f"{k}-{i}" for i in range(TIES)]


def measured(folder: Path) -> dict[str, float]:
    """Return the seconds of what opening consists of, and of opening."""
    times = {}
    begin = time.perf_counter()
    block = read_block(folder)
    times["block"] = time.perf_counter() - begin
    begin = time.perf_counter()
    records = read_journal(folder, keep=lambda kind: kind in EVENT_KINDS).records
    times["lines"] = time.perf_counter() - begin
    begin = time.perf_counter()
    restored(block, records)
    times["events"] = time.perf_counter() - begin
    for what in ("opened", "again"):
        begin = time.perf_counter()
        station = Station(folder)
        times[what] = time.perf_counter() - begin
        station.close()
    return times


def main() -> None:
    """Print times and ratios."""
    with tempfile.TemporaryDirectory() as name:
        days = []
        for points in (1_000, 10_000):
            folder = Path(name) / str(points)
            write(folder, points)
            days.append(measured(folder))
    short, long = days
    for what, seconds in long.items():
        print(
            f"{what:8} 1000 points {1e3 * short[what]:7.1f} ms, 10 000 points "
            f"{1e3 * seconds:7.1f} ms, ratio {seconds / short[what]:5.1f}"
        )


if __name__ == "__main__":
    sys.exit(main())
