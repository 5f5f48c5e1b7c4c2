"""How long a journal takes to read whole that is full of one kind of event.

Run it as `python tests/benchmarks/journal_kinds.py [events [kind ...]]`. Two models are measured;
then an operator takes breaks, returns to a model, measures a point again, switches a row off and
on, says why, takes back, corrects a name, or all of this in turn, over and over, with the line's
traffic and a table behind every event. Processor time of a thread for the fold over all events and
for opening the block, beside that of parsing all lines with `json.loads`; processes, memory and
garbage collector as in `journal_opening.py`.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain, cycle, islice
from pathlib import Path

import numpy as np
from journal_opening import TABLE, TRAFFIC, Seen, alone, measured, model
from syntheticblocks import synthetic_block

from anaplot.exchange.blockfolder import read_block, write_control, write_new_block
from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import Journal
from anaplot.session.events import (
    Event,
    ModelAccepted,
    ModelReopened,
    PointMeasured,
    PointRenamed,
    ReasonGiven,
    Resumed,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.state import fold, start
from anaplot.station.header import session_header


def _moved(point: PointMeasured) -> PointMeasured:
    return replace(point, xl=point.xl + 0.001)


def _name(point: PointMeasured, was: str, now: str) -> Event:
    return PointRenamed(point.left, point.right, was, now)


def _again(point: PointMeasured, *between: Event) -> list[Event]:
    photos = point.left, point.right
    return [ModelReopened(*photos), *between, ModelAccepted(*photos)]


# of a point in the model in work, and one of the first model, what is done over and over
KINDS: dict[str, Callable[[PointMeasured, PointMeasured], Sequence[Event]]] = {
    "pauses": lambda now, _: [Suspended(), Resumed()],
    "reopened": lambda _, first: _again(first),
    "corrected": lambda _, first: [*_again(first, _moved(first)), *_again(first, first)],
    "remeasured": lambda now, _: [_moved(now), now],
    "switched": lambda now, _: [RowSwitched(now.point, "y", on) for on in (False, True)],
    "reasons": lambda now, _: [
        RowSwitched(now.point, "y", False),
        ReasonGiven("pointing"),
        RowSwitched(now.point, "y", True),
    ],
    "undone": lambda now, _: [_moved(now), Undone()],
    "renamed": lambda now, _: [_name(now, now.point, "other"), _name(now, "other", now.point)],
}
KINDS["mixed"] = lambda now, first: [
    event for name, kind in KINDS.items() if name != "mixed" for event in kind(now, first)
]


def write(folder: Path, kind: str, count: int) -> None:
    """Write a block of two models with a journal of so many events, nearly all of a kind."""
    random = np.random.default_rng(1)

    def noise(xy: tuple[float, float]) -> tuple[float, float]:
        x, y = (np.array(xy) + random.normal(0.0, 0.005, 2)).round(4).tolist()
        return x, y

    flown = synthetic_block(1, 4, seed=1)
    write_new_block(folder, replace(flown.block, image_points=(), control=()))
    write_control(folder, flown.block.control)
    block = read_block(folder)
    begun: list[Event] = []
    seen: Seen = {}
    for pair in block.strips[0].models()[:2]:
        events, seen = model(flown, block.strips[0], pair, seen, noise)
        begun += events
    points = [event for event in begun if isinstance(event, PointMeasured)]
    round_ = KINDS[kind](points[-1], points[0])
    begun.pop()  # the second model stays in work
    if kind in ("reopened", "corrected"):
        begun.append(ModelAccepted(points[-1].left, points[-1].right))
    fold(start(block), [*begun, *round_, *round_])  # else the journal would be damaged
    every = islice(chain(begun, cycle(round_)), max(count, len(begun)))
    with Journal.open(folder, session_header(block, "", None, ""))[0] as journal:
        for event in every:
            own = (event.kind, event_to_payload(event))
            journal.append_many([("traffic", TRAFFIC), own, ("table", TABLE)], durable=False)


def main(count: int = 4000, kinds: Sequence[str] = tuple(KINDS)) -> None:
    """Print ratios and memory."""
    for kind in kinds:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "block"
            alone(write, folder, kind, count)
            loads, _ = alone(measured, "json.loads", folder)
            said = [
                f"{what} {seconds / loads:5.2f} times json.loads, {megabytes:4.0f} MB"
                for what in ("all events", "opened")
                for seconds, megabytes in [alone(measured, what, folder)]
            ]
        print(f"{kind:11} {count} events, json.loads {loads:6.2f} s: {'; '.join(said)}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]), *[sys.argv[2:]] * (len(sys.argv) > 2))
