"""Who changed what: every change of a measurement, told from the events of a journal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from anaplot.aliases import Side
from anaplot.photogrammetry.block import Block
from anaplot.session.events import (
    DecidedRow,
    DecisionsTakenOver,
    Event,
    FiducialMeasured,
    FiducialSwitched,
    InnerAccepted,
    ModelAccepted,
    ModelReopened,
    MonoMeasured,
    PointAdded,
    PointMeasured,
    PointRenamed,
    PointRepeated,
    ReasonGiven,
    Resumed,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.innerstate import InnerState
from anaplot.session.innerwork import inner_outlook
from anaplot.session.models import solved_or_none
from anaplot.session.state import SessionState, apply, start

__all__ = ["AcceptedInner", "Change", "ChangeKind", "ChangeLog", "Happened", "changes"]

ChangeKind = Literal[
    "measured",
    "remeasured",
    "renamed",
    "off",
    "on",
    "added",
    "oriented",
    "accepted",
    "reopened",
    "undone",
]
XY = tuple[float, float]


class Happened(NamedTuple):
    """An event of a journal, when it was written (ISO 8601 with zone), and who was at work."""

    time: str
    who: str
    event: Event


@dataclass(frozen=True, slots=True)
class Change:
    """One change.

    Attributes
    ----------
    time, who
        When, ISO 8601 with zone, and the operator's name or "".
    what
        What was done; "undone": the latest change before it was taken back.
    model, photo, point, axis
        Where: "left/right", photo, point or fiducial, coordinate; "" where it is not one.
    old, new
        Coordinates before and after [mm]: of a point in the image, of a fiducial on the plate;
        None where there were none, or none changed. What is renamed stays where it is: both are
        its place.
    w_before, w_after
        abs(w) of the row, or the largest of the point's or fiducial's, before and after; of what is
        renamed, by the name that it has then. None while there is none, and where the row is off.
    reason
        Why: "pointing", "identification", "transfer", "instrument", a strategy for gross errors
        that `anaplot adjust --apply` had, or "" where nobody said so.
    name
        Of what was renamed, the name that it has now; else "".
    """

    time: str
    who: str
    what: ChangeKind
    model: str
    photo: str = ""
    point: str = ""
    axis: str = ""
    old: XY | None = None
    new: XY | None = None
    w_before: float | None = None
    w_after: float | None = None
    reason: str = ""
    name: str = ""


class AcceptedInner(NamedTuple):
    """An inner orientation that was accepted, and not taken back.

    Attributes
    ----------
    time, who
        When, ISO 8601 with zone, and the operator's name or "".
    model
        In which model, "left/right".
    inner
        The fiducials as they were measured then.
    """

    time: str
    who: str
    model: str
    inner: InnerState


def changes(block: Block, history: Iterable[Happened]) -> tuple[Change, ...]:
    """Return what changed, in order.

    Parameters
    ----------
    block
        As it was declared when the journal was begun.
    history
        The journal's events.

    Raises
    ------
    EventRefusedError
        An event that does not fit what happened before it.
    """
    log = ChangeLog(block)
    for happened in history:
        log.add(happened)
    return log.changes


class ChangeLog:
    """The changes, as what happened comes in.

    Parameters
    ----------
    block
        As it was declared when the journal was begun.
    """

    def __init__(self, block: Block) -> None:
        self._state = start(block)
        self._found: list[Change] = []
        self._inner: list[AcceptedInner] = []
        self._done: list[Event] = []
        self._latest = range(0)  # the changes that a reason is of

    @property
    def changes(self) -> tuple[Change, ...]:
        """What changed so far, in order."""
        return tuple(self._found)

    @property
    def block(self) -> Block:
        """As it was declared when the journal was begun."""
        return self._state.block

    @property
    def inner(self) -> tuple[AcceptedInner, ...]:
        """The inner orientations that are accepted so far, in order."""
        return tuple(self._inner)

    def add(self, happened: Happened) -> None:
        """Take notice of what happened next.

        Raises
        ------
        EventRefusedError
            It does not fit what happened before it.
        """
        time, who, event = happened
        before, state = self._state, apply(self._state, event)
        self._state = state
        if isinstance(event, Suspended | Resumed):
            return
        if isinstance(event, ReasonGiven):
            for k in self._latest:
                self._found[k] = replace(self._found[k], reason=event.reason)
            return
        undone = isinstance(event, Undone)
        what = self._done.pop() if undone else event
        if not undone:
            self._done.append(event)
        if isinstance(what, InnerAccepted):
            if undone:
                self._inner.pop()
            else:
                self._accepted(time, who, what, before)
        count = len(self._found)
        self._found += _told(time, who, what, before, state, undone=undone)
        if state.last_change is not None and state.last_change.latest:
            self._latest = range(count, len(self._found))

    def _accepted(self, time: str, who: str, event: InnerAccepted, before: SessionState) -> None:
        model = before.current
        inner = None if model is None else model.inner_of(event.side)
        assert model is not None  # else it would have been refused
        assert inner is not None
        self._inner.append(AcceptedInner(time, who, model.name, inner))


def _told(
    time: str, who: str, event: Event, before: SessionState, after: SessionState, *, undone: bool
) -> list[Change]:
    """Return the changes of one event, or of its being taken back."""
    model = before.current or after.current
    name = "" if model is None else model.name
    if isinstance(event, ModelAccepted | ModelReopened):
        name = f"{event.left}/{event.right}"

    def change(what: ChangeKind, **fields: object) -> Change:
        return Change(time, who, "undone" if undone else what, name, **fields)  # type: ignore[arg-type]

    match event:
        case PointMeasured() | MonoMeasured():
            point = event.point
            sides: tuple[Side, ...] = ("left", "right")
            if isinstance(event, MonoMeasured):
                sides = (event.side,)
            w = {"w_before": _largest(before, point), "w_after": _largest(after, point)}
            out = []
            for side in sides:
                old, new = (m and m.place_of(side, point) for m in (before.current, after.current))
                photo = event.left if side == "left" else event.right
                what: ChangeKind = "measured" if old is None else "remeasured"
                out.append(change(what, photo=photo, point=point, old=old, new=new, **w))
            return out
        case PointRenamed():
            return list(_renamed(event, before, after, change, undone=undone))
        case RowSwitched(point, axis, on):
            photo = "" if model is None else model.right
            w = {
                "w_before": _largest(before, point, axis),
                "w_after": _largest(after, point, axis),
            }
            return [change("on" if on else "off", photo=photo, point=point, axis=axis or "", **w)]
        case FiducialMeasured(photo, side, fiducial):
            old, new = (
                m and m.fiducial_place(side, fiducial) for m in (before.current, after.current)
            )
            return [
                change(
                    "measured" if old is None else "remeasured",
                    photo=photo,
                    point=fiducial,
                    old=old,
                    new=new,
                    w_before=_largest_of_fiducial(before, side, fiducial),
                    w_after=_largest_of_fiducial(after, side, fiducial),
                )
            ]
        case DecisionsTakenOver(rows):
            return [
                replace(
                    change(
                        "on" if row.on else "off",
                        photo=row.right,
                        point=row.point,
                        axis=row.axis,
                        w_before=_largest_of(before, row),
                        w_after=_largest_of(after, row),
                    ),
                    model=f"{row.left}/{row.right}",
                    reason=row.reason,
                )
                for row in rows
            ]
        case FiducialSwitched(photo, fiducial, axis, on):
            side = "left" if model is not None and photo == model.left else "right"
            return [
                change(
                    "on" if on else "off",
                    photo=photo,
                    point=fiducial,
                    axis=axis or "",
                    w_before=_largest_of_fiducial(before, side, fiducial),
                    w_after=_largest_of_fiducial(after, side, fiducial),
                )
            ]
        case InnerAccepted():
            return [change("oriented", photo=event.photo)]
        case PointAdded():
            return [change("added", point=event.planned.point)]
        case PointRepeated():
            return []  # nothing is changed by it
        case ModelAccepted():
            return [change("accepted")]
        case ModelReopened():
            return [change("reopened", point=event.point or "")]
        case _:
            return [change("undone")] if undone else []


def _renamed(
    event: PointRenamed,
    before: SessionState,
    after: SessionState,
    change: Callable[..., Change],
    *,
    undone: bool,
) -> Iterator[Change]:
    """Yield what got another name in each photo: the point itself, then what it is exchanged with.

    Taken back, it is told as it was done: with the name that it had, and the one that it got.
    """
    former = (after if undone else before).current
    assert former is not None  # it is measured there
    photos: tuple[tuple[Side, str], ...] = (("left", event.left), ("right", event.right))
    for point, name in ((event.point, event.name), (event.name, event.point)):
        first, then = (name, point) if undone else (point, name)
        w = {"w_before": _largest(before, first), "w_after": _largest(after, then)}
        for side, photo in photos:
            at = former.place_of(side, point)
            if event.side in (None, side) and at is not None:
                yield change("renamed", photo=photo, point=point, old=at, new=at, name=name, **w)


def _largest_of(state: SessionState, row: DecidedRow) -> float | None:
    """Return abs(w) of a row of an accepted model."""
    accepted = replace(state, current=state.accepted(row.left, row.right))
    return _largest(accepted, row.point, row.axis)


def _largest(state: SessionState, point: str, axis: str | None = None) -> float | None:
    """Return the largest abs(w) of a point's rows in the current model, or of one of them."""
    model = state.current
    if model is None or model.measurement(point) is None:
        return None
    solution = solved_or_none(state, model)
    if solution is None:
        return None
    sizes = [
        row.size
        for row in solution.table
        if row.point == point and axis in (None, row.axis) and row.size is not None
    ]
    return max(sizes, default=None)


def _largest_of_fiducial(state: SessionState, side: Side, fiducial: str) -> float | None:
    inner = None if state.current is None else state.current.inner_of(side)
    solution = None if inner is None else inner_outlook(state.block, inner).solution
    if solution is None:
        return None
    sizes = [row.size for row in solution.rows if row.point == fiducial and row.size is not None]
    return max(sizes, default=None)
