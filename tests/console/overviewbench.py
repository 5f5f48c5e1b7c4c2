"""Statuses of blocks, as a station keeps them, for the console's overview."""

from __future__ import annotations

from consolefake import picture

from anaplot.station.blockstatus import BlockStatus, ModelStanding, ModelStatus, StripStatus
from anaplot.station.blockstep import NextStep
from anaplot.station.blockview import BlockView, FlaggedCoordinate, SuspectedPoint, SuspectedRay
from anaplot.station.coverage import Coverage
from anaplot.station.snapshot import Snapshot

FOLDER = "survey"


def accepted(left: str, right: str, state: ModelStanding = "accepted", **changes) -> ModelStatus:
    return ModelStatus(left, right, state, **{"sigma0_um": 4.87, "redundancy": 12, **changes})


def view(*, sure: bool = False, aside: tuple[str, ...] = ()) -> BlockView:
    rays = (SuspectedRay("102", "101/102", 0.999), SuspectedRay("103", "102/103", 0.001))
    flagged = (FlaggedCoordinate("102", "101/102", "y", 9.1, 0.4),)
    suspects = (SuspectedPoint("102-2", flagged, rays, "102/103", True),) if sure else ()
    return BlockView(
        "103/104", 3, False, sigma0=0.97, sigma0_um=4.86, redundancy=40, photos=4, points=28,
        rays=70, datum="free", suspects=suspects, aside=aside,
    )  # fmt: skip


def status(models: tuple[ModelStatus, ...], step: NextStep, **changes) -> BlockStatus:
    found = {
        "recomputed": (),
        "block": None,
        "coverage": Coverage(0, 0, 0),
        "next": step,
        **changes,
    }
    return BlockStatus((StripStatus("1", models),), **found)


MODELS = (
    accepted("101", "102"),
    accepted("102", "103", off=2, ties=5),
    ModelStatus("103", "104", "open"),
    ModelStatus("104", "105", "open"),
)
BETWEEN = status(MODELS, NextStep("measure", f"anaplot open {FOLDER}", "103/104"), block=view())


def between(found: BlockStatus = BETWEEN, serial: int = 1, **changes) -> Snapshot:
    """A snapshot between two models: nothing is in work."""
    done = tuple((m.left, m.right) for m in found.models if m.done)
    nothing = {
        "strip": "", "left": "", "right": "", "model_number": 0, "model_count": 0, "points": (),
        "target": None, "next_point": None, "solution": None, "diagnosis": None, "problem": "",
        "expected": "lay photos 103 and 104: next model", "may_accept": False,
    }  # fmt: skip
    return picture(serial=serial, **{**nothing, "accepted": done, "status": found, **changes})
