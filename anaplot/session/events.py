"""What an operator does, as frozen events: the only thing that changes a session's state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

__all__ = [
    "EVENT_KINDS",
    "Axis",
    "Event",
    "ModelAccepted",
    "ModelChosen",
    "PlannedPoint",
    "PointAdded",
    "PointMeasured",
    "Resumed",
    "Role",
    "RowSwitched",
    "Suspended",
    "Undone",
]

Axis = Literal["x", "y"]
Role = Literal["tie", "new"]


@dataclass(frozen=True, slots=True)
class PlannedPoint:
    """A point to be measured in a model and where the plates are driven for it.

    Attributes
    ----------
    point
        Name.
    role
        "tie" when its model coordinates are known from the preceding model, else "new".
    xl, yl, xr, yr
        Approximate image coordinates in the left and the right photo [mm].
    """

    point: str
    role: Role
    xl: float
    yl: float
    xr: float
    yr: float


@dataclass(frozen=True, slots=True)
class ModelChosen:
    """Two consecutive photos were laid into the instrument.

    Attributes
    ----------
    strip, left, right
        Names.
    plan
        The points to measure, in order.
    """

    kind: ClassVar[str] = "model-chosen"
    strip: str
    left: str
    right: str
    plan: tuple[PlannedPoint, ...]


@dataclass(frozen=True, slots=True)
class PointAdded:
    """A point beyond the plan was added to the current model."""

    kind: ClassVar[str] = "point-added"
    planned: PlannedPoint


@dataclass(frozen=True, slots=True)
class PointMeasured:
    """A point was recorded; measuring it again replaces the coordinates, never the history.

    Attributes
    ----------
    left, right, point
        Names.
    xl, yl, xr, yr
        Image coordinates [mm].
    switch
        What recorded it: a footswitch's name, or "key".
    """

    kind: ClassVar[str] = "point-measured"
    left: str
    right: str
    point: str
    xl: float
    yl: float
    xr: float
    yr: float
    switch: str


@dataclass(frozen=True, slots=True)
class RowSwitched:
    """A point (axis None) or one of its rows was switched off or on again."""

    kind: ClassVar[str] = "row-switched"
    point: str
    axis: Axis | None
    on: bool


@dataclass(frozen=True, slots=True)
class ModelAccepted:
    """The operator accepted the current model."""

    kind: ClassVar[str] = "model-accepted"
    left: str
    right: str


@dataclass(frozen=True, slots=True)
class Undone:
    """The last event that was no undo, suspension or resumption was taken back."""

    kind: ClassVar[str] = "undone"


@dataclass(frozen=True, slots=True)
class Suspended:
    """Work was interrupted; nothing is recorded until it is resumed."""

    kind: ClassVar[str] = "suspended"


@dataclass(frozen=True, slots=True)
class Resumed:
    """Work goes on."""

    kind: ClassVar[str] = "resumed"


Event = (
    ModelChosen
    | PointAdded
    | PointMeasured
    | RowSwitched
    | ModelAccepted
    | Undone
    | Suspended
    | Resumed
)

EVENT_KINDS: dict[str, type[Event]] = {
    cls.kind: cls
    for cls in (
        ModelChosen,
        PointAdded,
        PointMeasured,
        RowSwitched,
        ModelAccepted,
        Undone,
        Suspended,
        Resumed,
    )
}
