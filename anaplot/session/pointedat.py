"""How often everything was pointed at in a session; an undo takes none of it back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from anaplot.aliases import Side
from anaplot.session.events import (
    Event,
    FiducialMeasured,
    MonoMeasured,
    PhotoName,
    PointMeasured,
    PointRepeated,
)
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState

__all__ = ["Target", "Targets", "pointed_at", "unusual", "with_unusual"]


class Target(NamedTuple):
    """What is pointed at.

    Attributes
    ----------
    left, right
        The model in the instrument.
    name
        Of the point or fiducial.
    side
        In which of the photos; None for a point in both together.
    fiducial
        Whether it is a fiducial.
    """

    left: PhotoName
    right: PhotoName
    name: str
    side: Side | None
    fiducial: bool


Targets = Mapping[Target, int]
"""How often what was pointed at."""


def pointed_at(event: Event, current: ModelState | None) -> Target | None:
    """Return what was pointed at in an event, or None.

    Parameters
    ----------
    event
        What happened.
    current
        The model in the instrument after it.
    """
    match event:
        case PointMeasured():
            return Target(event.left, event.right, event.point, None, False)
        case MonoMeasured():
            return Target(event.left, event.right, event.point, event.side, False)
        case PointRepeated():
            alone = event.fiducial or len(event.places) == 1
            side = event.places[0].side if alone else None
            return Target(event.left, event.right, event.name, side, event.fiducial)
        case FiducialMeasured() if current is not None:
            left, right = current.photos
            return Target(left, right, event.fiducial, event.side, True)
    return None


def unusual(state: SessionState, targets: Targets) -> list[tuple[Target, int]]:
    """Return what was pointed at more often or less than a state makes one believe, sorted.

    Parameters
    ----------
    state
        To which the events led.
    targets
        How often what was pointed at in them.
    """
    usual = dict(_usual(state))
    found = [(t, n) for t, n in targets.items() if n != usual.get(t, 0)]
    found += [(t, 0) for t, n in usual.items() if n and t not in targets]
    return sorted(found, key=lambda one: (*one[0][:3], one[0].side or "", one[0].fiducial))


def with_unusual(state: SessionState, said: Iterable[tuple[Target, int]]) -> dict[Target, int]:
    """Return how often what was pointed at: as a state makes one believe, but for what is said."""
    counts = {**dict(_usual(state)), **dict(said)}
    return {target: count for target, count in counts.items() if count}


def _usual(state: SessionState) -> Iterator[tuple[Target, int]]:
    current = () if state.current is None else (state.current,)
    for model in (*state.models, *current):
        left, right = model.photos
        sides: tuple[Side | None, ...] = ("left", "right") if model.mono else (None,)
        for m in model.measured:
            for side in sides:
                yield Target(left, right, m.point, side, False), m.times
        for inner in model.inner:
            for fiducial in inner.measured:
                yield Target(left, right, fiducial.fiducial, inner.side, True), 1
