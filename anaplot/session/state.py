"""The state of a session: a pure fold over its events."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Self

from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.platetransformation import TRANSFORMATIONS, PlateTransformation
from anaplot.session.events import (
    Axis,
    Event,
    FiducialMeasured,
    FiducialSwitched,
    InnerAccepted,
    ModelAccepted,
    ModelChosen,
    PlannedPoint,
    PointAdded,
    PointMeasured,
    Resumed,
    RowSwitched,
    Side,
    Suspended,
    Undone,
)
from anaplot.session.innerstate import InnerState
from anaplot.session.refusal import EventRefusedError

__all__ = ["EventRefusedError", "Measured", "ModelState", "SessionState", "apply", "fold", "start"]

_HISTORY = 1000  # undo reaches back this many events


@dataclass(frozen=True, slots=True)
class Measured:
    """A point's latest measurement in a model.

    Attributes
    ----------
    point
        Name.
    xl, yl, xr, yr
        Image coordinates [mm].
    times
        How often it was recorded in this model.
    """

    point: str
    xl: float
    yl: float
    xr: float
    yr: float
    times: int


@dataclass(frozen=True, slots=True)
class ModelState:
    """A model as far as it was measured.

    Attributes
    ----------
    strip, left, right
        Names.
    plan
        The points to measure, in order; added points at the end.
    measured
        Measurements, in the order of the plan.
    off
        Rows (point, axis) switched off.
    inner
        Inner orientations of its photos, left first; none where the cameras have no fiducials.
    """

    strip: str
    left: str
    right: str
    plan: tuple[PlannedPoint, ...]
    measured: tuple[Measured, ...] = ()
    off: frozenset[tuple[str, Axis]] = frozenset()
    inner: tuple[InnerState, ...] = ()

    @property
    def photos(self) -> tuple[str, str]:
        """(left, right)."""
        return self.left, self.right

    @property
    def name(self) -> str:
        """'left/right'."""
        return f"{self.left}/{self.right}"

    def planned(self, point: str) -> PlannedPoint | None:
        """Return the planned point of that name, or None."""
        return next((p for p in self.plan if p.point == point), None)

    def measurement(self, point: str) -> Measured | None:
        """Return the latest measurement of a point, or None."""
        return next((m for m in self.measured if m.point == point), None)

    def axes(self, point: str) -> tuple[Axis, ...]:
        """Return the rows that a point of this model has: y, and x when it is a tie."""
        planned = self.planned(point)
        return ("y", "x") if planned is not None and planned.role == "tie" else ("y",)

    def is_off(self, point: str) -> bool:
        """Whether every row of the point is switched off."""
        return all((point, axis) in self.off for axis in self.axes(point))

    @property
    def used(self) -> tuple[Measured, ...]:
        """The measurements that are not switched off altogether."""
        return tuple(m for m in self.measured if not self.is_off(m.point))

    @property
    def open_inner(self) -> InnerState | None:
        """The inner orientation to be done first, or None when points can be measured."""
        return next((i for i in self.inner if i.accepted is None), None)

    def inner_of(self, side: Side) -> InnerState | None:
        """Return the inner orientation in a carriage; None where the camera has no fiducials."""
        return next((i for i in self.inner if i.side == side), None)

    @property
    def pending(self) -> tuple[PlannedPoint, ...]:
        """The planned points not measured yet."""
        done = {m.point for m in self.measured}
        return tuple(p for p in self.plan if p.point not in done)


@dataclass(frozen=True, slots=True)
class SessionState:
    """Everything a session has come to.

    Attributes
    ----------
    block
        What was declared; its image points play no part here.
    models
        The accepted models, in the order of their acceptance.
    current
        The model in the instrument, or None.
    suspended
        Whether work is interrupted.
    """

    block: Block
    models: tuple[ModelState, ...] = ()
    current: ModelState | None = None
    suspended: bool = False
    _history: tuple[tuple[tuple[ModelState, ...], ModelState | None], ...] = field(
        default=(), repr=False, compare=False
    )

    @property
    def may_undo(self) -> bool:
        """Whether there is anything to take back."""
        return bool(self._history)

    def accepted(self, left: str, right: str) -> ModelState | None:
        """Return the accepted model of two photos, or None."""
        return next((m for m in self.models if m.photos == (left, right)), None)

    def preceding(self, strip: str, left: str) -> ModelState | None:
        """Return the accepted model of a strip whose right photo is `left`, or None."""
        return next((m for m in self.models if m.strip == strip and m.right == left), None)

    def _remembered(self) -> Self:
        history = (*self._history, (self.models, self.current))[-_HISTORY:]
        return replace(self, _history=history)


def start(block: Block) -> SessionState:
    """Return the state before any event."""
    return SessionState(replace(block, image_points=(), control=()))


def fold(state: SessionState, events: Iterable[Event]) -> SessionState:
    """Apply events one after another.

    Raises
    ------
    EventRefusedError
        At the first event that cannot happen.
    """
    for event in events:
        state = apply(state, event)
    return state


def apply(state: SessionState, event: Event) -> SessionState:
    """Return the state after an event.

    Raises
    ------
    EventRefusedError
        When the event cannot happen in this state; says why.
    """
    if isinstance(event, Resumed):
        if not state.suspended:
            raise EventRefusedError("work is not suspended")
        return replace(state, suspended=False)
    if state.suspended:
        raise EventRefusedError("work is suspended: resume first")
    match event:
        case Suspended():
            return replace(state, suspended=True)
        case Undone():
            return _undone(state)
        case ModelChosen():
            return replace(state._remembered(), current=_chosen(state, event))
        case FiducialMeasured() | FiducialSwitched() | InnerAccepted():
            return _with_current(state, _inner(state, event))
        case PointAdded():
            return _with_current(state, _added(state, event.planned))
        case PointMeasured():
            return _with_current(state, _measured(state, event))
        case RowSwitched():
            return _with_current(state, _switched(_current(state), event))
        case ModelAccepted():
            return _accepted(state, event)


def _current(state: SessionState) -> ModelState:
    if state.current is None:
        raise EventRefusedError("no model is in the instrument")
    return state.current


def _with_current(state: SessionState, model: ModelState) -> SessionState:
    return replace(state._remembered(), current=model)


def _undone(state: SessionState) -> SessionState:
    if not state._history:
        raise EventRefusedError("there is nothing to undo")
    *history, (models, current) = state._history
    return replace(state, models=models, current=current, _history=tuple(history))


def _chosen(state: SessionState, event: ModelChosen) -> ModelState:
    model = f"model {event.left}/{event.right}"
    if state.current is not None:
        raise EventRefusedError(f"{model}: accept model {state.current.name} first")
    strip = next((s for s in state.block.strips if s.id == event.strip), None)
    if strip is None or (event.left, event.right) not in strip.models():
        raise EventRefusedError(f"{model} is not a model of strip {event.strip}")
    if state.accepted(event.left, event.right) is not None:
        raise EventRefusedError(f"{model} is accepted already")
    preceding = state.preceding(strip.id, event.left)
    if preceding is None and strip.photos[0] != event.left:
        raise EventRefusedError(f"{model}: the model before it is not accepted yet")
    names = [p.point for p in event.plan]
    if len(set(names)) != len(names):
        raise EventRefusedError(f"{model}: a point is planned twice")
    for p in event.plan:
        _check_role(model, p, preceding)
    return ModelState(
        event.strip, event.left, event.right, event.plan, inner=_inners(state.block, event)
    )


def _inners(block: Block, event: ModelChosen) -> tuple[InnerState, ...]:
    """Every photo lies anew in its carriage, also the left one that was the right one before."""
    out = []
    sides: tuple[tuple[str, Side], ...] = ((event.left, "left"), (event.right, "right"))
    for photo, side in sides:
        calibration = block.camera_of(photo).calibration
        names = () if calibration is None else calibration.fiducial_names()
        if calibration is not None and names:
            out.append(InnerState(photo, side, names, rows=not calibration.distances))
    return tuple(out)


def _inner(
    state: SessionState, event: FiducialMeasured | FiducialSwitched | InnerAccepted
) -> ModelState:
    model = _current(state)
    if event.photo not in model.photos:
        raise EventRefusedError(f"photo {event.photo}: model {model.name} is in the instrument")
    side: Side = "left" if event.photo == model.left else "right"
    if not isinstance(event, FiducialSwitched) and event.side != side:
        raise EventRefusedError(f"photo {event.photo} lies on the {side}, not on the {event.side}")
    inner = model.inner_of(side)
    if inner is None:
        raise EventRefusedError(f"photo {event.photo}: its camera has no fiducials")
    if inner.accepted is not None:
        raise EventRefusedError(f"the inner orientation of {inner.name} is accepted already")
    first = model.open_inner
    if first is not None and first != inner:
        raise EventRefusedError(f"{inner.name}: the inner orientation of {first.name} comes first")
    match event:
        case FiducialMeasured():
            after = inner.with_measurement(event.fiducial, event.x, event.y)
        case FiducialSwitched():
            after = inner.with_switch(event.fiducial, event.axis, event.on)
        case InnerAccepted():
            after = inner.with_acceptance(_transformation(inner, event))
    return replace(model, inner=tuple(after if i == inner else i for i in model.inner))


def _transformation(inner: InnerState, event: InnerAccepted) -> PlateTransformation:
    name = next((n for n in TRANSFORMATIONS if n == event.transformation), None)
    if name is None:
        raise EventRefusedError(f"{inner.name}: there is no transformation {event.transformation}")
    try:
        return PlateTransformation(name, event.frame, event.numerator, event.denominator)
    except ValueError as error:
        raise EventRefusedError(f"{inner.name}: {error}") from None


def _oriented(state: SessionState) -> ModelState:
    """Return the current model, whose photos are ready for points."""
    model = _current(state)
    if model.open_inner is not None:
        raise EventRefusedError(f"{model.open_inner.name}: inner orientation comes first")
    return model


def _check_role(model: str, planned: PlannedPoint, preceding: ModelState | None) -> None:
    known = preceding is not None and any(m.point == planned.point for m in preceding.used)
    if (planned.role == "tie") != known:
        raise EventRefusedError(
            f"{model}: point {planned.point} is planned as {planned.role}, but "
            + ("is" if known else "is not")
            + " a point of the preceding model"
        )


def _added(state: SessionState, planned: PlannedPoint) -> ModelState:
    model = _oriented(state)
    if model.planned(planned.point) is not None:
        raise EventRefusedError(f"point {planned.point} is in model {model.name} already")
    _check_role(f"model {model.name}", planned, state.preceding(model.strip, model.left))
    return replace(model, plan=(*model.plan, planned))


def _measured(state: SessionState, event: PointMeasured) -> ModelState:
    model = _current(state)
    if (event.left, event.right) != model.photos:
        raise EventRefusedError(
            f"point {event.point} of {event.left}/{event.right}: {model.name} is in the instrument"
        )
    _oriented(state)
    if model.planned(event.point) is None:
        raise EventRefusedError(f"point {event.point} is not in the plan of model {model.name}")
    for photo, x, y in ((event.left, event.xl, event.yl), (event.right, event.xr, event.yr)):
        reach_x, reach_y = state.block.camera_of(photo).reach()
        if not (isfinite(x) and isfinite(y)) or abs(x) > reach_x or abs(y) > reach_y:
            raise EventRefusedError(
                f"point {event.point}: ({x:.3f}, {y:.3f}) lies outside photo {photo}"
            )
    old = model.measurement(event.point)
    new = Measured(
        event.point, event.xl, event.yl, event.xr, event.yr, 1 if old is None else old.times + 1
    )
    by_name = {m.point: m for m in model.measured} | {event.point: new}
    measured = tuple(by_name[p.point] for p in model.plan if p.point in by_name)
    # a point measured anew is believed again until its rows say otherwise
    off = frozenset(key for key in model.off if key[0] != event.point)
    return replace(model, measured=measured, off=off)


def _switched(model: ModelState, event: RowSwitched) -> ModelState:
    if model.measurement(event.point) is None:
        raise EventRefusedError(f"point {event.point} is not measured in model {model.name}")
    axes = model.axes(event.point)
    if event.axis is not None and event.axis not in axes:
        raise EventRefusedError(f"point {event.point} is no tie: it has no x row")
    rows = {(event.point, axis) for axis in axes if event.axis in (None, axis)}
    return replace(model, off=model.off - rows if event.on else model.off | rows)


def _accepted(state: SessionState, event: ModelAccepted) -> SessionState:
    model = _current(state)
    if (event.left, event.right) != model.photos:
        raise EventRefusedError(f"model {model.name} is in the instrument")
    _oriented(state)
    return replace(state._remembered(), models=(*state.models, model), current=None)
