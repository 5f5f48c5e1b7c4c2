"""What the operator may command, as values: console, simulated operator and tests send the same."""

from __future__ import annotations

from dataclasses import dataclass

from anaplot.aliases import Axis, Side
from anaplot.session.events import Reason

__all__ = [
    "Accept",
    "AddPoint",
    "Command",
    "Drive",
    "GiveReason",
    "KeepCounters",
    "NextModel",
    "OtherPhoto",
    "PointAgain",
    "RecordPoint",
    "Reference",
    "Rename",
    "Resume",
    "ReturnTo",
    "Stop",
    "Suspend",
    "Switch",
    "TakeOver",
    "TurnWheels",
    "Undo",
]


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive the plates to a point of the current model; without a drive, name it as next.

    During an inner orientation it is a fiducial, and while the counters lack their reference,
    what they are to be referred to.
    """

    point: str


@dataclass(frozen=True, slots=True)
class Stop:
    """Stop a drive."""


@dataclass(frozen=True, slots=True)
class RecordPoint:
    """Record the point or fiducial at which the plates stand, with the next position coming in."""


@dataclass(frozen=True, slots=True)
class PointAgain:
    """Point again at something measured, each time with the mark moved away first.

    The pointings tell the precision of pointing; the measurement stays what it is.

    Attributes
    ----------
    point
        Point or fiducial; None for the one under the mark, if it is measured, else the one
        measured last.
    times
        How often.
    """

    point: str | None = None
    times: int = 5


@dataclass(frozen=True, slots=True)
class Switch:
    """Switch a row, or all of a point or fiducial (axis None), off or on."""

    point: str
    axis: Axis | None
    on: bool


@dataclass(frozen=True, slots=True)
class Rename:
    """Give what was measured as one point of the current model another name.

    Where the model has that name already, the two are exchanged. `side`: in which photo alone; None
    for both.
    """

    point: str
    name: str
    side: Side | None = None


@dataclass(frozen=True, slots=True)
class Undo:
    """Take the last event back."""


@dataclass(frozen=True, slots=True)
class GiveReason:
    """Say why the latest change of a measurement was made."""

    reason: Reason


@dataclass(frozen=True, slots=True)
class Accept:
    """Accept the inner orientation in work, else the model."""


@dataclass(frozen=True, slots=True)
class NextModel:
    """Choose the next model: the right photo becomes left, ties are driven to first.

    In a mono comparator first of all the photo that is to be laid in now.
    """


@dataclass(frozen=True, slots=True)
class ReturnTo:
    """Return to an accepted model: its photos are laid in anew, a model in work waits.

    `point` is what is to be measured again there, `photo` in which photo; "" where that is open.
    """

    left: str
    right: str
    point: str = ""
    photo: str = ""


@dataclass(frozen=True, slots=True)
class OtherPhoto:
    """Take it that the other photo of the model was laid into the mono comparator."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Take it that the mark is set on something measured, of counters without reference.

    `point` is the measured point, or fiducial; None for the one that was proposed.
    """

    point: str | None = None


@dataclass(frozen=True, slots=True)
class KeepCounters:
    """Take the counters as they are: the operator knows that they kept their origin, or set it."""


@dataclass(frozen=True, slots=True)
class AddPoint:
    """Add a point beyond the plan, where the plates stand now."""

    name: str


@dataclass(frozen=True, slots=True)
class Suspend:
    """Interrupt the work."""


@dataclass(frozen=True, slots=True)
class Resume:
    """Go on with it."""


@dataclass(frozen=True, slots=True)
class TurnWheels:
    """Move plates that stand by hand; whoever does sets the mark, too."""


@dataclass(frozen=True, slots=True)
class TakeOver:
    """Take it that the instrument does not set the mark any more: somebody else does."""


Command = (
    Drive
    | Stop
    | RecordPoint
    | PointAgain
    | Switch
    | Rename
    | Undo
    | GiveReason
    | Accept
    | NextModel
    | ReturnTo
    | OtherPhoto
    | Reference
    | KeepCounters
    | AddPoint
    | Suspend
    | Resume
    | TurnWheels
    | TakeOver
)
