"""The state of a session: a pure fold over its events."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, Self

from anaplot.aliases import Side
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.platetransformation import TRANSFORMATIONS, PlateTransformation
from anaplot.session.copied import copied
from anaplot.session.events import (
    DecisionsTakenOver,
    Event,
    FiducialMeasured,
    FiducialSwitched,
    InnerAccepted,
    ModelAccepted,
    ModelChosen,
    ModelReopened,
    MonoMeasured,
    PhotoLaid,
    PlannedPoint,
    PointAdded,
    PointMeasured,
    PointRenamed,
    PointRepeated,
    Reason,
    ReasonGiven,
    Resumed,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.history import History
from anaplot.session.innerstate import InnerState
from anaplot.session.modelstate import Measured, ModelState
from anaplot.session.monofold import laid_in, measured_in_photo, taken_over
from anaplot.session.pointcheck import check_place
from anaplot.session.reasons import LastChange, RowReason, after_change, last_change, with_reason
from anaplot.session.refusal import EventRefusedError
from anaplot.session.renaming import renamed
from anaplot.session.repeating import check_repetition
from anaplot.session.returning import (
    AsAccepted,
    Return,
    following,
    recomputed_since,
    replaced,
    same_measurements,
)
from anaplot.session.takingover import Decided, decided

__all__ = [
    "HISTORY",
    "WHILE_SUSPENDED",
    "EventRefusedError",
    "Measured",
    "ModelState",
    "SessionState",
    "apply",
    "fold",
    "start",
]

# what was decided elsewhere waits for nobody
WHILE_SUSPENDED = Resumed | DecisionsTakenOver
_OF_NO_MEASUREMENT = (Suspended, Resumed, ReasonGiven)
HISTORY = 1000
"""Undo reaches back this many events."""


class _Moment(NamedTuple):
    """What an undo brings back."""

    models: tuple[ModelState, ...]
    current: ModelState | None
    returned: Return | None
    latest: tuple[str, str] | None
    recomputed: tuple[AsAccepted, ...]


_NOTHING_YET: History[_Moment] = History()


@dataclass(frozen=True, slots=True)
class SessionState:
    """Everything a session has come to.

    Attributes
    ----------
    block
        What was declared; its image points play no part here.
    models
        The accepted models, in the order in which they were first accepted. A model to which the
        operator returned is as it was, until it is accepted again.
    current
        The model in the instrument, or None.
    suspended
        Whether work is interrupted.
    layings
        How many photos were laid into a mono comparator, or models into another instrument (which
        counts when the first measurement in them says so). Nothing takes that back: after an undo
        it is not the photo of before that lies there.
    returned
        When the current model is one to which the operator returned, why; else None.
    latest
        The photos (left, right) of the model accepted last, or None.
    recomputed
        Accepted models before which another was accepted anew since they were accepted.
    reasons
        Why rows were switched off, where the operator said so; of rows that are on again, too.
    last_change
        The latest change of a measurement, which a reason given now is of; no part of what was
        measured, and so of what makes two states equal.
    """

    block: Block
    models: tuple[ModelState, ...] = ()
    current: ModelState | None = None
    suspended: bool = False
    layings: int = 0
    returned: Return | None = None
    latest: tuple[str, str] | None = None
    recomputed: tuple[AsAccepted, ...] = ()
    reasons: tuple[RowReason, ...] = ()
    last_change: LastChange | None = field(default=None, compare=False)
    _history: History[_Moment] = field(default=_NOTHING_YET, repr=False, compare=False)

    @property
    def may_undo(self) -> bool:
        """Whether there is anything to take back."""
        return bool(self._history)

    @property
    def undo_lays_anew(self) -> bool:
        """Whether an undo brings a model back whose photos have given way to others since."""
        if not self._history:
            return False
        model = self._history.popped()[0].current
        return model is not None and not model.mono and model.laying < self.layings

    @property
    def undo_is_full(self) -> bool:
        """Whether as many events may be taken back as are ever remembered."""
        return len(self._history) == HISTORY

    def accepted(self, left: str, right: str) -> ModelState | None:
        """Return the accepted model of two photos, or None."""
        return next((m for m in self.models if m.left == left and m.right == right), None)

    def models_with(self, model: ModelState) -> tuple[ModelState, ...]:
        """Return the accepted models and one more, in the place of its accepted version if any."""
        if self.accepted(*model.photos) is None:
            return (*self.models, model)
        return tuple(model if m.photos == model.photos else m for m in self.models)

    def preceding(self, strip: str, left: str) -> ModelState | None:
        """Return the accepted model of a strip whose right photo is `left`, or None."""
        # mostly the last one
        latest_first = reversed(self.models)
        return next((m for m in latest_first if m.strip == strip and m.right == left), None)

    @property
    def unchanged(self) -> bool:
        """Whether a model to which the operator returned says what it said."""
        model = self.current
        before = None if model is None else self.accepted(*model.photos)
        return model is not None and before is not None and same_measurements(model, before)

    def _after(self, **changes: Any) -> Self:
        """Return the state after what can be taken back."""
        now = _Moment(self.models, self.current, self.returned, self.latest, self.recomputed)
        return copied(self, _history=self._history.pushed(now, HISTORY), **changes)


def start(block: Block) -> SessionState:
    """Return the state before any event."""
    return SessionState(replace(block, image_points=(), control=(), conditions=(), priors=()))


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
    if state.suspended and not isinstance(event, WHILE_SUSPENDED):
        raise EventRefusedError("work is suspended: resume first")
    after = _happened(state, event)
    if isinstance(event, _OF_NO_MEASUREMENT):
        return after
    changed = last_change(state.current, event, after.current)
    if changed is not None:
        reasons = after_change(state.reasons, changed, state.current, after.current)
        return copied(after, last_change=changed, reasons=reasons)
    if state.last_change is None or not state.last_change.latest:
        return after
    return copied(after, last_change=copied(state.last_change, latest=False))


def _happened(state: SessionState, event: Event) -> SessionState:
    """Return what is in work and accepted after an event."""
    match event:
        case Suspended():
            return copied(state, suspended=True)
        case Resumed():
            if not state.suspended:
                raise EventRefusedError("work is not suspended")
            return copied(state, suspended=False)
        case ReasonGiven():
            return _given(state, event.reason)
        case Undone():
            return _undone(state, anew=event.anew)
        case ModelChosen():
            return state._after(current=_chosen(state, event))
        case FiducialMeasured():
            return _lying(state._after(current=_inner(state, event)))
        case FiducialSwitched() | InnerAccepted():
            return state._after(current=_inner(state, event))
        case PointAdded():
            return state._after(current=_added(state, event.planned))
        case PointMeasured():
            return _lying(_with_points(state, _measured(state, event), event.point))
        case PointRenamed():
            return _with_points(state, _renamed(state, event), event.point, event.name)
        case PointRepeated():
            check_repetition(state.block, _current(state), event)
            return state._after()
        case PhotoLaid():
            model = laid_in(_current(state), event, state.layings + 1)
            model = copied(model, inner=_laid_anew(state.block, model))
            return state._after(current=model, layings=state.layings + 1)
        case MonoMeasured():
            after = measured_in_photo(state.block, _oriented(state), event)
            return _with_points(state, after, event.point)
        case RowSwitched():
            return _with_points(state, _switched(_current(state), event), event.point)
        case DecisionsTakenOver():
            return _taken_over(state, event)
        case ModelAccepted():
            return _accepted(state, event)
        case ModelReopened():
            return _reopened(state, event)


def _given(state: SessionState, reason: Reason) -> SessionState:
    changed = state.last_change
    if changed is None:
        raise EventRefusedError("no measurement was changed yet, for which there is a reason")
    models = state.models if state.current is None else (state.current, *state.models)
    reasons = with_reason(state.reasons, changed, reason, models)
    return copied(state, last_change=copied(changed, reason=reason), reasons=reasons)


def _current(state: SessionState) -> ModelState:
    if state.current is None:
        raise EventRefusedError("no model is in the instrument")
    return state.current


def _with_points(state: SessionState, model: ModelState, *points: str) -> SessionState:
    """Return the state after something was done about points of the current model."""
    returned = state.returned
    if returned is not None and returned.point in points:
        return state._after(current=model, returned=copied(returned, point=None, photo=None))
    return state._after(current=model)


def _undone(state: SessionState, *, anew: bool) -> SessionState:
    if not state._history:
        raise EventRefusedError("there is nothing to undo")
    before, history = state._history.popped()
    current = before.current
    if current is not None and (anew or current.mono) and current.laying < state.layings:
        current = _taken_out(state, current)
    back = before._replace(current=current)
    return copied(state, **back._asdict(), _history=history)


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
    known = _points_of(preceding)
    names = [p.point for p in event.plan]
    if len(set(names)) != len(names):
        raise EventRefusedError(f"{model}: a point is planned twice")
    for p in event.plan:
        _check_role(model, p, known)
    chosen = ModelState(event.strip, event.left, event.right, event.plan, mono=event.mono)
    chosen = copied(_taken_out(state, chosen), inner=_inners(state.block, chosen))
    if not chosen.mono or preceding is None:
        return chosen
    lies = preceding.photos == state.latest and preceding.laying == state.layings
    return taken_over(chosen, preceding, lies=lies)


def _laid_anew(block: Block, model: ModelState) -> tuple[InnerState, ...]:
    """Begin anew the inner orientation of the photo just laid in."""
    fresh = {i.side: i for i in _inners(block, model)}
    return tuple(fresh[i.side] if i.side == model.laid else i for i in model.inner)


def _inners(block: Block, model: ModelState) -> tuple[InnerState, ...]:
    """Every photo lies anew in its carriage, also the left one that was the right one before."""
    out = []
    sides: tuple[tuple[str, Side], ...] = ((model.left, "left"), (model.right, "right"))
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
    if side not in model.carriages:
        raise EventRefusedError(f"photo {event.photo} does not lie in the comparator")
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
    return copied(model, inner=tuple(after if i == inner else i for i in model.inner))


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


def _points_of(model: ModelState | None) -> frozenset[str]:
    """Return the points that a model can give to the next one."""
    return frozenset() if model is None else frozenset(m.point for m in model.used)


def _check_role(model: str, planned: PlannedPoint, points: frozenset[str]) -> None:
    known = planned.point in points
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
    preceding = state.preceding(model.strip, model.left)
    _check_role(f"model {model.name}", planned, _points_of(preceding))
    after = copied(model, plan=(*model.plan, planned))
    if not model.mono or preceding is None:
        return after
    return taken_over(after, preceding, lies=False)


def _measured(state: SessionState, event: PointMeasured) -> ModelState:
    model = _current(state)
    if (event.left, event.right) != model.photos:
        raise EventRefusedError(
            f"point {event.point} of {event.left}/{event.right}: {model.name} is in the instrument"
        )
    _oriented(state)
    if model.planned(event.point) is None:
        raise EventRefusedError(f"point {event.point} is not in the plan of model {model.name}")
    if model.mono:
        raise EventRefusedError(f"model {model.name} is measured one photo after the other")
    for photo, x, y in ((event.left, event.xl, event.yl), (event.right, event.xr, event.yr)):
        check_place(state.block, photo, event.point, x, y)
    old = model.measurement(event.point)
    new = Measured(
        event.point, event.xl, event.yl, event.xr, event.yr, 1 if old is None else old.times + 1
    )
    if old is not None:
        measured = tuple([new if m is old else m for m in model.measured])
    else:
        by_name = {m.point: m for m in model.measured} | {event.point: new}
        measured = tuple(by_name[p.point] for p in model.plan if p.point in by_name)
    if not model.off:
        return copied(model, measured=measured)
    # a point measured anew is believed again until its rows say otherwise
    off = frozenset(key for key in model.off if key[0] != event.point)
    return copied(model, measured=measured, off=off)


def _renamed(state: SessionState, event: PointRenamed) -> ModelState:
    model = _oriented(state)
    preceding = state.preceding(model.strip, model.left)
    after = renamed(model, event, partial(_points_of, preceding))
    if not model.mono or preceding is None:
        return after
    return taken_over(after, preceding, lies=False)


def _switched(model: ModelState, event: RowSwitched) -> ModelState:
    axes = model.axes(event.point)
    if model.measurement(event.point) is None:
        # what is planned and cannot be measured is left out as a whole
        whole = event.axis is None or len(axes) == 1
        if not whole or model.planned(event.point) is None or model.open_inner is not None:
            raise EventRefusedError(f"point {event.point} is not measured in model {model.name}")
    if event.axis is not None and event.axis not in axes:
        raise EventRefusedError(f"point {event.point} is no tie: it has no x row")
    rows = {(event.point, axis) for axis in axes if event.axis in (None, axis)}
    return copied(model, off=model.off - rows if event.on else model.off | rows)


def _taken_over(state: SessionState, event: DecisionsTakenOver) -> SessionState:
    back = state.returned
    parked = None if back is None else back.parked
    now = Decided(state.models, state.current, parked, state.recomputed, state.reasons)
    after = decided(now, event.rows)
    return state._after(
        models=after.models,
        current=after.current,
        returned=None if back is None else copied(back, parked=after.parked),
        recomputed=after.recomputed,
        reasons=after.reasons,
    )


def _accepted(state: SessionState, event: ModelAccepted) -> SessionState:
    model = _current(state)
    if (event.left, event.right) != model.photos:
        raise EventRefusedError(f"model {model.name} is in the instrument")
    if state.returned is not None:
        return _accepted_again(state, model, state.returned)
    _oriented(state)
    return state._after(models=(*state.models, model), current=None, latest=model.photos)


def _reopened(state: SessionState, event: ModelReopened) -> SessionState:
    name = f"model {event.left}/{event.right}"
    model, current = state.accepted(event.left, event.right), state.current
    if state.returned is not None and current is not None:
        raise EventRefusedError(f"{name}: accept model {current.name} first")
    if model is None:
        raise EventRefusedError(f"{name} is not accepted yet")
    if event.point is not None and model.measurement(event.point) is None:
        raise EventRefusedError(f"point {event.point} is not measured in {name}")
    if event.photo is not None and event.photo not in model.photos:
        raise EventRefusedError(f"photo {event.photo} is not in {name}")
    returned = Return(current, event.point, event.photo)
    return state._after(current=_taken_out(state, model), returned=returned)


def _lying(state: SessionState) -> SessionState:
    """Return the state in which the photos of the current model lie in the instrument."""
    laying = _current(state).laying
    return copied(state, layings=laying) if laying > state.layings else state


def _taken_out(state: SessionState, model: ModelState) -> ModelState:
    """Return a model whose photos are to be laid in anew: how they lie is not known any more."""
    if not model.mono:
        return copied(model, inner=_inners(state.block, model), laying=state.layings + 1)
    # the photo that was laid in last lies there still
    return model if model.laying == state.layings else copied(model, laid=None)


def _accepted_again(state: SessionState, model: ModelState, returned: Return) -> SessionState:
    """Put the model into its former place; what waited comes back, its photos laid in anew."""
    models, parked, recomputed = state.models, returned.parked, state.recomputed
    latest: tuple[str, str] | None = model.photos
    changed = not state.unchanged
    laid = bool(model.carriages) if model.mono else model.laying <= state.layings
    if not changed and not laid:
        latest = state.latest  # nothing was laid in
    elif changed or model.open_inner is None:
        _oriented(state)
        state = _lying(state)
        models, parked = replaced(models, parked, model)
        if changed:
            others = tuple(known for known in recomputed if known.photos != model.photos)
            recomputed = recomputed_since(others, following(models, model), state.models)
    return state._after(
        models=models,
        current=None if parked is None else _taken_out(state, parked),
        returned=None,
        latest=latest,
        recomputed=recomputed,
    )
