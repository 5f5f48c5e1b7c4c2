"""Who changed what: every change of a measurement, told from the events of a journal."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple

from anaplot.aliases import Side
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block
from anaplot.session.copied import copied
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
from anaplot.session.innerwork import solve_inner
from anaplot.session.models import (
    Models,
    preceding_models,
    solve_behind,
    without_redundancy,
)
from anaplot.session.modelstate import ModelState
from anaplot.session.state import HISTORY, SessionState, apply, start

__all__ = ["AcceptedInner", "Change", "ChangeKind", "ChangeLog", "Happened", "Sizes"]

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


_Size = Callable[[], float | None]


class Sizes:
    """abs(w) before and after a change: computed when one of them is asked for, and once.

    Most changes of a long journal are never looked at, and each asks for an orientation.

    Parameters
    ----------
    before, after
        Compute them; None while there is none.
    """

    __slots__ = ("_find", "_found")

    def __init__(self, before: _Size, after: _Size) -> None:
        self._find: tuple[_Size, _Size] | None = (before, after)
        self._found: tuple[float | None, float | None] = (None, None)

    @classmethod
    def known(cls, before: float | None, after: float | None) -> Sizes:
        """Return two that are computed already."""
        return cls(lambda: before, lambda: after)

    @property
    def both(self) -> tuple[float | None, float | None]:
        """(before, after)."""
        find = self._find
        if find is not None:
            self._found = find[0](), find[1]()
            self._find = None  # what they are computed from is needed no more
        return self._found

    def __eq__(self, other: object) -> bool:
        return self.both == other.both if isinstance(other, Sizes) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.both)

    def __repr__(self) -> str:
        return "Sizes({}, {})".format(*self.both)


_NO_SIZES = Sizes.known(None, None)


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
    reason
        Why: "pointing", "identification", "transfer", "instrument", a strategy for gross errors
        that `anaplot adjust --apply` had, or "" where nobody said so.
    name
        Of what was renamed, the name that it has now; else "".
    w
        abs(w) of the row, or the largest of the point's or fiducial's, before and after; of what is
        renamed, by the name that it has then. None while there is none, and where the row is off.
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
    reason: str = ""
    name: str = ""
    w: Sizes = field(default=_NO_SIZES, repr=False)

    @property
    def w_before(self) -> float | None:
        """abs(w) before it; computed when it is asked for."""
        return self.w.both[0]

    @property
    def w_after(self) -> float | None:
        """abs(w) after it; computed when it is asked for."""
        return self.w.both[1]


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
        # what an undo may take back
        self._done: deque[Event] = deque(maxlen=HISTORY)
        self._latest = range(0)  # the changes that a reason is of

    @property
    def changes(self) -> tuple[Change, ...]:
        """What changed so far, in order."""
        return tuple(self._found)

    @property
    def state(self) -> SessionState:
        """To which what happened so far has led."""
        return self._state

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
            w = _sizes(before, point, after, point)
            out = []
            for side in sides:
                old, new = (m and m.place_of(side, point) for m in (before.current, after.current))
                photo = event.left if side == "left" else event.right
                what: ChangeKind = "measured" if old is None else "remeasured"
                out.append(change(what, photo=photo, point=point, old=old, new=new, w=w))
            return out
        case PointRenamed():
            return list(_renamed(event, before, after, change, undone=undone))
        case RowSwitched(point, axis, on):
            photo = "" if model is None else model.right
            w = _sizes(before, point, after, point, axis)
            return [change("on" if on else "off", photo=photo, point=point, axis=axis or "", w=w)]
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
                    w=_fiducial_sizes(before, after, side, fiducial),
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
                        w=_sizes(
                            _with(before, row), row.point, _with(after, row), row.point, row.axis
                        ),
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
                    w=_fiducial_sizes(before, after, side, fiducial),
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
        w = _sizes(before, first, after, then)
        for side, photo in photos:
            at = former.place_of(side, point)
            if event.side in (None, side) and at is not None:
                yield change("renamed", photo=photo, point=point, old=at, new=at, name=name, w=w)


def _with(state: SessionState, row: DecidedRow) -> SessionState:
    """Return a state with the accepted model of a row as the one in work."""
    return copied(state, current=state.accepted(row.left, row.right))


def _sizes(
    before: SessionState, first: str, after: SessionState, then: str, axis: str | None = None
) -> Sizes:
    """Return abs(w) of a point's rows, or of one, in the models in work before and after.

    `first`, `then`: its names.
    """
    return Sizes(_size(before, first, axis), _size(after, then, axis))


def _size(state: SessionState, point: str, axis: str | None) -> _Size:
    """Return what computes the largest abs(w) of a point's rows in the model in work, or of one.

    Nothing more is kept than it needs: all that may be undone hangs on a state, and all accepted
    models are as many as the block's with every change.
    """
    model = state.current
    if model is None or model.measurement(point) is None:
        return _nothing
    before = preceding_models(state.models, model)
    return partial(_largest, state.block, before, model, point, axis)


def _nothing() -> None:
    """Compute no abs(w): there is none."""


def _largest(
    block: Block, before: Models, model: ModelState, point: str, axis: str | None
) -> float | None:
    """Return the largest abs(w) of a point's rows in a model, or of one of them."""
    if without_redundancy(before, model):
        return None
    try:
        solution = solve_behind(block, before, model)
    except NotComputableError:
        return None
    sizes = [
        row.size
        for row in solution.table
        if row.point == point and axis in (None, row.axis) and row.size is not None
    ]
    return max(sizes, default=None)


def _fiducial_sizes(before: SessionState, after: SessionState, side: Side, fiducial: str) -> Sizes:
    was, now = (
        partial(
            _largest_of_fiducial,
            state.block,
            None if state.current is None else state.current.inner_of(side),
            fiducial,
        )
        for state in (before, after)
    )
    return Sizes(was, now)


def _largest_of_fiducial(block: Block, inner: InnerState | None, fiducial: str) -> float | None:
    if inner is None or not inner.used:
        return None
    try:
        solution = solve_inner(block, inner)
    except NotComputableError:
        return None
    sizes = [row.size for row in solution.rows if row.point == fiducial and row.size is not None]
    return max(sizes, default=None)
