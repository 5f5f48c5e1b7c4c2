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
    """Return what a session has come to since an earlier state of it.

    What is undone is not, and what has gone back to an earlier pointing was not measured.
    """
    known = {model.photos: model for model in before.models}
    earlier, now = dict(_measured(before)), dict(_measured(after))
    measured = [key for key, times in now.items() if times > earlier.get(key, 0)]
    back = {key[0] for key, times in earlier.items() if times > now.get(key, 0)}
    back -= {name for name, _ in measured}
    accepted = sum(
        known.get(model.photos) != model and model.name not in back for model in after.models
    )
    return WorkDone(accepted, len(measured))


def _measured(state: SessionState) -> Iterator[tuple[tuple[str, str], int]]:
    """Yield each point of each model, with how often it was measured."""
    models = {model.photos: model for model in state.models}
    waits = None if state.returned is None else state.returned.parked
    models |= {model.photos: model for model in (waits, state.current) if model is not None}
    for model in models.values():
        for point in dict.fromkeys(p.point for p in model.plan):
            times = _times(model, point)
            if times:
                yield (model.name, point), times


def _times(model: ModelState, point: str) -> int:
    if not model.mono:
        measured = model.measurement(point)
        return 0 if measured is None else measured.times
    seen = (model.sighting("left", point), model.sighting("right", point))
    return sum(one.times for one in seen if one is not None)
