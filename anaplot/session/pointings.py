"""When and by whom things were measured, and what was pointed at more than once: from a journal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeVar

from anaplot.aliases import Side
from anaplot.session.changes import Happened
from anaplot.session.events import (
    Event,
    FiducialMeasured,
    ModelAccepted,
    ModelChosen,
    ModelReopened,
    MonoMeasured,
    PhotoLaid,
    PointMeasured,
    PointRenamed,
    PointRepeated,
    ReasonGiven,
    Resumed,
    Suspended,
    Undone,
)
from anaplot.session.modelstate import ModelState
from anaplot.session.repeating import measured_at
from anaplot.session.state import SessionState, apply

__all__ = ["Pointed", "Pointings", "Run", "pointings_of"]

Named = tuple[str, str, str]
"""(left, right, point), or (photo, side, fiducial)."""
_Known = TypeVar("_Known")


class _Lies(NamedTuple):
    """What belongs to one run: one thing, as it lies in the instrument, and who points at it."""

    layings: int
    model: str
    name: str
    fiducial: bool
    side: Side
    at: tuple[tuple[float, float], ...]
    who: str


class Pointed(NamedTuple):
    """Who measured something last, and when (ISO 8601 with zone)."""

    who: str
    time: str


@dataclass(slots=True)
class Run:
    """Pointings at one thing by one person, one after the other.

    Attributes
    ----------
    model, name, fiducial
        What was pointed at.
    role
        "tie" or "new"; of a fiducial "".
    who
        The operator's name, or "".
    places
        Coordinates [mm] of each pointing, photo by photo; the measurement itself first where it is
        his.
    unmoved
        How many more there are before which the mark was not seen to move away.
    """

    model: str
    name: str
    fiducial: bool
    role: str
    who: str
    places: list[tuple[tuple[float, float], ...]]
    unmoved: int = 0


@dataclass(frozen=True, slots=True)
class Pointings:
    """What a journal says of pointings.

    Attributes
    ----------
    state
        Where the session stands.
    measured
        Of every point of a model, and of every fiducial, its latest measurement.
    runs
        What was pointed at again.
    """

    state: SessionState
    measured: dict[Named, Pointed] = field(default_factory=dict)
    runs: tuple[Run, ...] = ()


def pointings_of(start: SessionState, history: Iterable[Happened]) -> Pointings:
    """Return when and by whom things were measured, and what was pointed at again.

    Parameters
    ----------
    start
        The state before the first event.
    history
        The journal's events.

    Raises
    ------
    EventRefusedError
        An event that does not fit what happened before it.
    """
    state = start
    done: list[tuple[Happened, ModelState | None]] = []  # each with the model that was in work
    for happened in history:
        before, state = state, apply(state, happened.event)
        if isinstance(happened.event, Undone):
            done.pop()
        elif not isinstance(happened.event, Suspended | Resumed | ReasonGiven):
            # not the whole state, which holds what an undo of 1000 events would bring back
            done.append((happened, before.current))
    measured: dict[Named, Pointed] = {}
    here: dict[Named, str] = {}  # by whom, since photos were laid in
    runs: dict[_Lies, Run] = {}
    layings = 0
    for (time, who, event), model in done:
        if isinstance(event, ModelChosen | ModelReopened | ModelAccepted | PhotoLaid):
            layings += 1
            here.clear()
        if isinstance(event, PointRepeated):
            assert model is not None  # or the event would have been refused
            _repeated(runs, layings, event, model, who, here)
        elif isinstance(event, PointRenamed):
            assert model is not None
            _rename(measured, event)
            _rename(here, event)
            runs = _renamed_runs(runs, event, model)
        elif (named := _named(event)) is not None:
            measured[named] = Pointed(who, time)
            here[named] = who
    return Pointings(state, measured, tuple(runs.values()))


def _rename(found: dict[Named, _Known], event: PointRenamed) -> None:
    """Let what is known of a point be known of the name that it has now.

    In one photo alone both points keep what is known of the other photo's pointing.
    """
    if event.side is not None:
        return
    one, other = ((event.left, event.right, name) for name in (event.point, event.name))
    of_one, of_other = found.pop(one, None), found.pop(other, None)
    if of_one is not None:
        found[other] = of_one
    if of_other is not None:
        found[one] = of_other


def _renamed_runs(
    runs: dict[_Lies, Run], event: PointRenamed, model: ModelState
) -> dict[_Lies, Run]:
    """Return the runs with the names of now: pointings after it belong to those before.

    Photo by photo those in the photo have another name; what was pointed at in both photos
    together keeps its own when in one of them alone the names are exchanged.
    """
    other = {event.point: event.name, event.name: event.point}
    out: dict[_Lies, Run] = {}
    for lies, run in runs.items():
        here = event.side is None or (model.mono and lies.side == event.side)
        if here and lies.model == model.name and not lies.fiducial and lies.name in other:
            name = other[lies.name]
            planned = model.planned(name)
            role = event.role if planned is None else planned.role
            out[lies._replace(name=name)] = replace(run, name=name, role=role)
        else:
            out[lies] = run
    return out


def _named(event: Event) -> Named | None:
    match event:
        case PointMeasured() | MonoMeasured():
            return event.left, event.right, event.point
        case FiducialMeasured():
            return event.photo, event.side, event.fiducial
        case _:
            return None


def _repeated(
    runs: dict[_Lies, Run],
    layings: int,
    event: PointRepeated,
    model: ModelState,
    who: str,
    here: dict[Named, str],
) -> None:
    """Put a pointing to those at the same thing, as it lies in the instrument.

    The measurement that it repeats is one of them where the same person made it, and the photos
    were not laid in anew since.
    """
    at = measured_at(model, event)
    assert at is not None
    name = f"{event.left}/{event.right}"
    lies = _Lies(layings, name, event.name, event.fiducial, event.places[0].side, at, who)
    if lies not in runs:
        place = event.places[0]
        named = (event.left, event.right, event.name)
        if event.fiducial:
            named = (place.photo, place.side, event.name)
        planned = None if event.fiducial else model.planned(event.name)
        role = "" if planned is None else planned.role
        own = here.get(named) == who
        runs[lies] = Run(name, event.name, event.fiducial, role, who, [at] if own else [])
    if event.moved:
        runs[lies].places.append(tuple((place.x, place.y) for place in event.places))
    else:
        runs[lies].unmoved += 1
