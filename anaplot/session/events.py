"""What an operator does, as frozen events: the only thing that changes a session's state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, get_args

from anaplot.aliases import Axis, Side, SwitchedBy
from anaplot.photogrammetry.platetransformation import TransformationName

__all__ = [
    "EVENT_KINDS",
    "OFFERED",
    "DecidedRow",
    "DecisionsTakenOver",
    "Event",
    "FiducialMeasured",
    "FiducialSwitched",
    "InnerAccepted",
    "ModelAccepted",
    "ModelChosen",
    "ModelReopened",
    "MonoMeasured",
    "PhotoLaid",
    "PhotoName",
    "Place",
    "PlannedPoint",
    "PointAdded",
    "PointMeasured",
    "PointRenamed",
    "PointRepeated",
    "Reason",
    "ReasonGiven",
    "Resumed",
    "Role",
    "RowSwitched",
    "Suspended",
    "Undone",
]

Role = Literal["tie", "new", "lateral", "control"]
OFFERED: tuple[Role, ...] = ("lateral", "control")
"""Roles of points that a model is complete without."""
PhotoName = Annotated[str, "photo"]
"""A name without a slash, for a model is written left/right."""
Reason = Literal["pointing", "identification", "transfer", "instrument"]
"""Why a measurement was changed: what was wrong with the one before."""
Row3 = tuple[float, float, float]
Row4 = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class PlannedPoint:
    """A point to be measured in a model and where the plates are driven for it.

    Attributes
    ----------
    point
        Name.
    role
        "tie" when its model coordinates are known from the preceding model, else "new"; "lateral"
        and "control" are new ones beyond the pattern, which are known from another strip or on the
        ground: the model is complete without them.
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
    mono
        Whether it is measured in a mono comparator, one photo after the other: nothing is laid
        in yet then.
    """

    kind: ClassVar[str] = "model-chosen"
    strip: str
    left: PhotoName
    right: PhotoName
    plan: tuple[PlannedPoint, ...]
    mono: bool = False


@dataclass(frozen=True, slots=True)
class PhotoLaid:
    """A photo of the current model was laid into the mono comparator, in place of any other."""

    kind: ClassVar[str] = "photo-laid"
    photo: PhotoName


@dataclass(frozen=True, slots=True)
class FiducialMeasured:
    """A fiducial was recorded; measuring it again replaces the coordinates, never the history.

    Attributes
    ----------
    photo, side, fiducial
        Names, and the carriage in which the photo lies.
    x, y
        Plate coordinates [mm].
    switch
        What recorded it: a footswitch's name, or "key".
    """

    kind: ClassVar[str] = "fiducial-measured"
    photo: PhotoName
    side: Side
    fiducial: str
    x: float
    y: float
    switch: str


@dataclass(frozen=True, slots=True)
class FiducialSwitched:
    """A fiducial (axis None) or one of its coordinates was switched off or on again."""

    kind: ClassVar[str] = "fiducial-switched"
    photo: PhotoName
    fiducial: str
    axis: Axis | None
    on: bool


@dataclass(frozen=True, slots=True)
class InnerAccepted:
    """The operator accepted the inner orientation of a photo in its carriage.

    Attributes
    ----------
    photo, side
        The photo, and the carriage in which it lies.
    transformation
        Name of the transformation plate -> image.
    frame, numerator, denominator
        Its coefficients, see `anaplot.photogrammetry.platetransformation.PlateTransformation`.
        They are part of the event: coordinates that were recorded with them stay what they were.
    """

    kind: ClassVar[str] = "inner-accepted"
    photo: PhotoName
    side: Side
    transformation: TransformationName
    frame: tuple[Row3, Row3]
    numerator: tuple[Row4, Row4]
    denominator: tuple[float, float]


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
        Image coordinates [mm], refined where the camera asks for it. The plate coordinates follow
        from the recorded bytes, and these from them through the accepted inner orientations.
    switch
        What recorded it: a footswitch's name, or "key".
    """

    kind: ClassVar[str] = "point-measured"
    left: PhotoName
    right: PhotoName
    point: str
    xl: float
    yl: float
    xr: float
    yr: float
    switch: str


@dataclass(frozen=True, slots=True)
class MonoMeasured:
    """A point was recorded in the photo that lies in a mono comparator.

    Attributes
    ----------
    left, right, side, point
        Names, and which of the model's photos it is.
    x, y
        Image coordinates [mm], as those of `PointMeasured`.
    switch
        What recorded it: a footswitch's name, or "key".
    """

    kind: ClassVar[str] = "mono-measured"
    left: PhotoName
    right: PhotoName
    side: Side
    point: str
    x: float
    y: float
    switch: str


@dataclass(frozen=True, slots=True)
class PointRenamed:
    """What was measured as one point of the current model has another name from now on.

    Where the model has that name already, the two exchange theirs.

    Attributes
    ----------
    left, right
        The model.
    point, name
        The name that it had, and the name that it has now.
    side
        In which of the photos alone; None for both.
    role
        The role of `name` in the plan, where it is new there.
    """

    kind: ClassVar[str] = "point-renamed"
    left: PhotoName
    right: PhotoName
    point: str
    name: str
    side: Side | None = None
    role: Role = "new"


@dataclass(frozen=True, slots=True)
class Place:
    """Where something was pointed at in a photo: coordinates [mm]."""

    photo: PhotoName
    side: Side
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class PointRepeated:
    """What is measured already was pointed at once more, for the precision of pointing alone.

    It changes neither the measurement nor the model.

    Attributes
    ----------
    left, right
        The model.
    name
        Of the point or fiducial.
    fiducial
        Whether it is a fiducial; its coordinates are then those of the plate, else of the image.
    places
        In the photos that were pointed at together: both, or one.
    moved
        Whether the mark is known to have been away from it since the pointing before; without
        that, the pointings are not independent.
    switch
        What recorded it: a footswitch's name, or "key".
    """

    kind: ClassVar[str] = "point-repeated"
    left: PhotoName
    right: PhotoName
    name: str
    fiducial: bool
    places: tuple[Place, ...]
    moved: bool
    switch: str


@dataclass(frozen=True, slots=True)
class RowSwitched:
    """A point (axis None) or one of its rows was switched off or on again."""

    kind: ClassVar[str] = "row-switched"
    point: str
    axis: Axis | None
    on: bool


@dataclass(frozen=True, slots=True)
class DecidedRow:
    """A row of an accepted model that was switched outside the session.

    Attributes
    ----------
    left, right, point, axis
        The model and the row.
    on
        Whether it counts now.
    reason
        The strategy for gross errors that rejected it, or "thin"; of a row that is on, whose
        rejection was taken back.
    """

    left: PhotoName
    right: PhotoName
    point: str
    axis: Axis
    on: bool
    reason: SwitchedBy


@dataclass(frozen=True, slots=True)
class DecisionsTakenOver:
    """Rows that were switched in image_points.csv, as a strategy for gross errors had it.

    Attributes
    ----------
    rows
        The rows.
    file
        Of which file they were taken: its digest, and when it was written [ns]; None where that is
        not known.
    """

    kind: ClassVar[str] = "decisions-taken-over"
    rows: tuple[DecidedRow, ...]
    file: str | None = None


@dataclass(frozen=True, slots=True)
class ModelAccepted:
    """The operator accepted the current model."""

    kind: ClassVar[str] = "model-accepted"
    left: PhotoName
    right: PhotoName


@dataclass(frozen=True, slots=True)
class ModelReopened:
    """The operator returned to an accepted model, whose photos are laid in anew.

    It stays accepted as it was until it is accepted again. A model in work waits until then.

    Attributes
    ----------
    left, right
        Names.
    point
        What is to be measured again, or None.
    photo
        In a mono comparator, in which photo, or None.
    """

    kind: ClassVar[str] = "model-reopened"
    left: PhotoName
    right: PhotoName
    point: str | None = None
    photo: PhotoName | None = None


@dataclass(frozen=True, slots=True)
class Undone:
    """The last event that was no undo, suspension or resumption was taken back.

    Attributes
    ----------
    anew
        Whether the photos of the model that comes back are to be laid in anew: others were measured
        since. Sessions of older versions believed that they lay as they had.
    """

    kind: ClassVar[str] = "undone"
    anew: bool = False


@dataclass(frozen=True, slots=True)
class ReasonGiven:
    """The operator said why he made the latest change of a measurement.

    Said again, the later reason stands. Nothing takes it back: an undo takes back the change.
    """

    kind: ClassVar[str] = "reason-given"
    reason: Reason


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
    | PhotoLaid
    | MonoMeasured
    | FiducialMeasured
    | FiducialSwitched
    | InnerAccepted
    | PointAdded
    | PointMeasured
    | PointRenamed
    | PointRepeated
    | RowSwitched
    | DecisionsTakenOver
    | ModelAccepted
    | ModelReopened
    | Undone
    | ReasonGiven
    | Suspended
    | Resumed
)

EVENT_KINDS: dict[str, type[Event]] = {cls.kind: cls for cls in get_args(Event)}
