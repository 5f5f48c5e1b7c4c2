"""Why measurements were changed: what a reason is given for, and the reasons of rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from operator import attrgetter
from typing import Literal, NamedTuple, get_args

from anaplot.aliases import Axis, SwitchedBy
from anaplot.session.events import (
    Event,
    FiducialMeasured,
    FiducialSwitched,
    MonoMeasured,
    PointMeasured,
    PointRenamed,
    Reason,
    RowSwitched,
    Undone,
)
from anaplot.session.modelstate import ModelState
from anaplot.session.renaming import names_after

__all__ = [
    "REASONS",
    "LastChange",
    "RowReason",
    "after_change",
    "last_change",
    "reason_of",
    "with_reason",
]

REASONS: tuple[Reason, ...] = get_args(Reason)


@dataclass(frozen=True, slots=True)
class LastChange:
    """The latest change of a measurement.

    Attributes
    ----------
    what
        Measured again, renamed, switched off or on, or such a thing taken back.
    model, point, axis
        Where: "left/right", point or fiducial and the row; "" and None where it is not one.
    fiducial
        Whether it is a fiducial's.
    reason
        What the operator said of it, or None.
    latest
        Whether nothing has happened since.
    """

    what: Literal["remeasured", "renamed", "off", "on", "undone"]
    model: str
    point: str = ""
    axis: Axis | None = None
    fiducial: bool = False
    reason: Reason | None = None
    latest: bool = True


class RowReason(NamedTuple):
    """The reason for which a row of a model was switched off: an operator's, or a strategy's."""

    model: str
    point: str
    axis: Axis
    reason: Reason | SwitchedBy


_MODEL_OF = attrgetter("model")


def last_change(
    before: ModelState | None, event: Event, after: ModelState | None
) -> LastChange | None:
    """Return what an event has changed of the measurements in a model, or None.

    `before`, `after`: the model in the instrument.
    """
    model = before
    if model is None:
        return None
    name = model.name
    match event:
        case PointMeasured(point=point) if model.measurement(point) is not None:
            return LastChange("remeasured", name, point)
        case MonoMeasured(point=point, side=side) if model.sighting(side, point) is not None:
            return LastChange("remeasured", name, point)
        case PointRenamed(point=point):
            return LastChange("renamed", name, point)
        case FiducialMeasured(side=side, fiducial=point):
            inner = model.inner_of(side)
            if inner is not None and inner.measurement(point) is not None:
                return LastChange("remeasured", name, point, fiducial=True)
        case RowSwitched(point, axis, on):
            return LastChange("on" if on else "off", name, point, axis)
        case FiducialSwitched(_, point, axis, on):
            return LastChange("on" if on else "off", name, point, axis, fiducial=True)
        case Undone() if after is not None and after.photos == model.photos:
            if _measurements(after) != _measurements(model):
                return LastChange("undone", name)
        case _:
            pass
    return None


def _measurements(model: ModelState) -> tuple[object, ...]:
    inner = tuple((i.measured, i.off) for i in model.inner)
    return model.measured, model.seen, model.off, inner


def after_change(
    reasons: tuple[RowReason, ...],
    changed: LastChange,
    before: ModelState | None,
    after: ModelState | None,
) -> tuple[RowReason, ...]:
    """Return the reasons of rows after a change: what is switched off anew has its still to come.

    Those of a point that has got another name go with it.

    `before`, `after`: the model in the instrument.
    """
    if changed.model not in map(_MODEL_OF, reasons):
        return reasons  # mostly, and a long session has many
    if changed.what in ("renamed", "undone") and before is not None and after is not None:
        names = names_after(before, after)
        # both ways, so that an undo brings all of them back
        names |= {name: point for point, name in names.items() if name not in names}
        return tuple(
            r._replace(point=names.get(r.point, r.point)) if r.model == changed.model else r
            for r in reasons
        )
    if changed.what != "off" or changed.fiducial or before is None:
        return reasons
    off = before.off
    return tuple(r for r in reasons if not _concerns(changed, r) or (r.point, r.axis) in off)


def with_reason(
    reasons: tuple[RowReason, ...],
    changed: LastChange,
    reason: Reason,
    models: Iterable[ModelState],
) -> tuple[RowReason, ...]:
    """Return the reasons of rows after one was given for a change in one of the models."""
    if changed.what != "off" or changed.fiducial:
        return reasons
    model = next((m for m in models if m.name == changed.model), None)
    axes = () if model is None else model.axes(changed.point)
    given = (RowReason(changed.model, changed.point, axis, reason) for axis in axes)
    others = (r for r in reasons if not _concerns(changed, r))
    return (*others, *(r for r in given if _concerns(changed, r)))


def _concerns(changed: LastChange, row: RowReason) -> bool:
    at = (row.model, row.point) == (changed.model, changed.point)
    return at and changed.axis in (None, row.axis)


def reason_of(reasons: Iterable[RowReason], model: ModelState, point: str) -> str | None:
    """Return why rows of a point are switched off, or None."""
    said = [
        r.reason
        for r in reasons
        if (r.model, r.point) == (model.name, point) and (point, r.axis) in model.off
    ]
    return ", ".join(dict.fromkeys(said)) or None
