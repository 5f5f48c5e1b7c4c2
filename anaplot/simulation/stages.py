"""At which stage of a day's work a mistake shows, and at which it was found."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from anaplot.aliases import Axis
from anaplot.session.accidents import Accident
from anaplot.session.tiecheck import GROUND
from anaplot.simulation.mistakes import Planted

__all__ = ["Handled", "Stage", "earliest_stage", "stage_found", "stage_of_point"]

Stage = Literal[
    "inner orientation", "record", "model", "next model", "strip tie", "control", "block"
]
"""What told of a mistake, in the order of the work.

The table of an inner orientation; the record itself, of a point that its strip has elsewhere; the
table of the model; the next model of the strip, while that is in work; another strip; the control;
the block, when the work had gone on farther than that.
"""


class Handled(NamedTuple):
    """A row that was flagged and measured again or switched off; axis None: the whole point.

    For a fiducial `point` is its name and `photo` the photo; for a point `photo` is empty. `stage`
    is what told of it.
    """

    model: str
    point: str
    axis: Axis | None
    action: str
    photo: str = ""
    stage: Stage = "model"


def stage_of_point(point: str, accidents: Iterable[Accident]) -> Stage:
    """Return what tells that a point of the model in work is wrong.

    Parameters
    ----------
    point
        Name of a point that is to be measured again.
    accidents
        What is known to be wrong beside the model's table. They are told with the record, so that
        they come before the table.
    """
    found = next((a for a in accidents if a.certain and a.point == point), None)
    if found is None:
        return "model"
    if not found.against:
        return "record"
    return "control" if found.against == GROUND else "strip tie"


def earliest_stage(planted: Planted) -> Stage:
    """Return the earliest stage that can show a planted mistake."""
    match planted.kind:
        case "wrong fiducial":
            return "inner orientation"
        case "wrong lateral tie":
            return "strip tie"
        case "wrong control point":
            return "control"
    if planted.shows_in is None:
        return "block"
    return "model" if planted.shows_in == planted.model else "next model"


def stage_found(planted: Planted, handled: Iterable[Handled]) -> Stage | None:
    """Return at which stage a mistake was found; None where it was not.

    Parameters
    ----------
    planted
        The mistake.
    handled
        What was measured again or switched off, in the order of time.
    """
    photo = planted.photo if planted.kind == "wrong fiducial" else ""
    for h in handled:
        if (h.point, h.photo) != (planted.point, photo):
            continue
        if h.model == planted.model:
            return h.stage
        if h.model == planted.shows_in:
            return "next model" if h.stage == "model" else h.stage
    return None
