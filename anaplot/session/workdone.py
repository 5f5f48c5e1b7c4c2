"""What was done between two states of a session: for the words with which one parts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState

__all__ = ["WorkDone", "work_done"]


class WorkDone(NamedTuple):
    """How many models were accepted (or accepted again, changed), and how many points measured.

    A point counts once in each model in which it was measured, however often.
    """

    models: int
    points: int


def work_done(before: SessionState, after: SessionState) -> WorkDone:
    """Return what a session has come to since an earlier state of it; what is undone is not."""
    known = {model.photos: model for model in before.models}
    accepted = sum(known.get(model.photos) != model for model in after.models)
    measured = dict(_measured(before))
    points = sum(measured.get(key) != value for key, value in _measured(after))
    return WorkDone(accepted, points)


def _measured(state: SessionState) -> Iterator[tuple[tuple[str, str], object]]:
    """Yield each point of each model, with all that was measured of it."""
    models = {model.photos: model for model in state.models}
    waits = None if state.returned is None else state.returned.parked
    models |= {model.photos: model for model in (waits, state.current) if model is not None}
    for model in models.values():
        for point in dict.fromkeys(p.point for p in model.plan):
            found = _of(model, point)
            if found:
                yield (model.name, point), found


def _of(model: ModelState, point: str) -> tuple[object, ...]:
    seen = (s for s in (model.sighting("left", point), model.sighting("right", point)) if s)
    measured = model.measurement(point)
    return (*seen, measured) if measured is not None else tuple(seen)
