"""What a desk asks for: of the plotter, of the files, and to be told to whoever listens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from anaplot.aliases import Side
from anaplot.photogrammetry.readings import Position

__all__ = [
    "DriveTo",
    "Lay",
    "OfInstrument",
    "ReadAnew",
    "Refer",
    "Request",
    "SetMark",
    "Severity",
    "StopDrive",
    "TakeRecord",
    "Tell",
    "WarmUp",
    "WritePoints",
]

Severity = Literal["info", "warning", "error", "record"]


@dataclass(frozen=True, slots=True)
class Tell:
    """Tell whoever listens one line."""

    severity: Severity
    text: str


@dataclass(frozen=True, slots=True)
class DriveTo:
    """Drive the plates to a position [mm], for a fiducial in one plate, or for a point (None)."""

    position: Position
    side: Side | None = None


@dataclass(frozen=True, slots=True)
class StopDrive:
    """Stop the drive."""


@dataclass(frozen=True, slots=True)
class TakeRecord:
    """Record the next position coming in."""


@dataclass(frozen=True, slots=True)
class SetMark:
    """Set the mark on something measured, at places of the plates [mm], without recording.

    A carriage that is not named stays where it is. `side`: it is a fiducial of that plate.
    """

    places: Mapping[Side, tuple[float, float]]
    side: Side | None = None


@dataclass(frozen=True, slots=True)
class Lay:
    """Take it that photographs lie in the carriages.

    In a mono comparator it is the one of `side`, in the placement of `placed`.
    """

    left: str
    right: str
    side: Side = "left"
    placed: Side | None = None


@dataclass(frozen=True, slots=True)
class ReadAnew:
    """What was read of the counters before now does not count."""


@dataclass(frozen=True, slots=True)
class Refer:
    """Readings count again, the counters moved by a shift [mm], or as before (None)."""

    shift: Position | None


@dataclass(frozen=True, slots=True)
class WritePoints:
    """Bring image_points.csv up to the accepted models."""


@dataclass(frozen=True, slots=True)
class WarmUp:
    """Load what the first table needs, while the first points are still being measured."""


OfInstrument = DriveTo | SetMark | StopDrive | TakeRecord | Lay | Refer
Request = OfInstrument | Tell | ReadAnew | WritePoints | WarmUp
