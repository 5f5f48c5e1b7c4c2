"""The state is a pure fold: properties over random sequences of events."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sessionscene import Scene, however_it_lies

from anaplot.session.events import (
    DecidedRow,
    DecisionsTakenOver,
    Event,
    ModelAccepted,
    ModelChosen,
    ModelReopened,
    Place,
    PlannedPoint,
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
from anaplot.session.reasons import REASONS
from anaplot.session.state import EventRefusedError, SessionState, apply, fold

SCENE = Scene(4)


@dataclass(frozen=True)
class Draft:
    """What is to happen, made into an event for whatever state it meets."""

    kind: int
    number: int
    flag: bool

    def event(self, state: SessionState) -> Event:
        models = SCENE.block.strips[0].models()
        model = models[self.number % len(models)]
        current = state.current
        point = "nowhere"
        if current is not None and current.plan:
            point = current.plan[self.number % len(current.plan)].point
            if self.flag:
                model = current.photos
        match self.kind % 16:
            case 0 | 1:
                accepted = len(state.models)
                if self.flag and current is None and accepted < len(models):
                    return SCENE.choice(state, accepted)
                return ModelChosen("1", *model, ())
            case 2 | 3 | 4 | 5 if point.startswith("extra"):
                return PointMeasured(*model, point, 1.0, 2.0, -90.0, self.number * 0.1, "key")
            case 2 | 3 | 4 | 5 if current is not None and point != "nowhere":
                return SCENE.measurement(state, point, dyr=self.number * 1e-3)
            case 6:
                axis = (None, "x", "y")[self.number % 3]
                return RowSwitched(point, axis, self.flag)
            case 7:
                name = f"extra{self.number % 3}"
                return PointAdded(PlannedPoint(name, "new", 1.0, 2.0, -90.0, 2.0))
            case 8:
                return ModelAccepted(*model)
            case 9:
                return Undone()
            case 10:
                return Suspended() if self.flag else Resumed()
            case 11 if self.flag:
                return ReasonGiven(REASONS[self.number % 4])
            case 11:
                return Resumed()
            case 12 if state.models:
                return ModelReopened(*state.models[self.number % len(state.models)].photos)
            case 13:
                sides = ("left", "right")
                places = tuple(
                    Place(photo, side, 1.0, self.number * 0.1)
                    for photo, side in zip(model, sides, strict=True)
                )
                return PointRepeated(*model, point, False, places, self.flag, "key")
            case 14 if state.models:
                there = state.models[self.number % len(state.models)]
                of = (
                    there.measured[self.number % len(there.measured)].point
                    if there.measured
                    else "-"
                )
                return DecisionsTakenOver((DecidedRow(*there.photos, of, "y", self.flag, "tau"),))
            case 15 if current is not None and current.plan:
                names = [p.point for p in current.plan] + ["extra0", "extra4"]
                name = names[self.number * 7 % len(names)]
                side = (None, "left", "right", None)[self.number % 4]
                before = state.preceding(current.strip, current.left)
                ties = () if before is None else tuple(m.point for m in before.used)
                role = "tie" if name in ties else "new"
                return PointRenamed(*model, point, name, side, role)
            case _:
                return PointMeasured(*model, point, 500.0, 0.0, 0.0, 0.0, "pedal")


drafts = st.lists(
    st.builds(
        Draft, st.integers(0, 15), st.integers(0, 40), st.integers(0, 4).map(lambda n: n > 0)
    ),
    max_size=120,
)


def played(steps: list[Draft]) -> tuple[list[Event], list[SessionState]]:
    """Return the events that were accepted, and the state before each and after the last."""
    state = SCENE.start
    events: list[Event] = []
    states = [state]
    for step in steps:
        event = step.event(state)
        try:
            after = apply(state, event)
        except EventRefusedError:
            continue
        events.append(event)
        states.append(after)
        state = after
    return events, states


@pytest.mark.slow
@given(drafts)
@settings(max_examples=120)
def test_the_fold_of_what_was_accepted_is_the_state(steps: list[Draft]) -> None:
    events, states = played(steps)
    assert fold(SCENE.start, events) == states[-1]
    assert fold(SCENE.start, events)._history == states[-1]._history
    half = len(events) // 2
    assert fold(states[half], events[half:]) == states[-1]


@pytest.mark.slow
@given(drafts)
@settings(max_examples=120)
def test_undo_is_the_exact_inverse_and_undoing_all_gives_the_start(steps: list[Draft]) -> None:
    events, states = played(steps)
    for before, event, after in zip(states, events, states[1:], strict=False):
        if not isinstance(event, Undone | Suspended | Resumed | ReasonGiven):
            again = apply(after, Undone())
            # what was said of a change is no part of what is taken back
            again = replace(again, reasons=before.reasons)
            assert however_it_lies(again) == however_it_lies(before)
            assert len(again._history) == len(before._history)
        if isinstance(event, PointRepeated):
            assert after == before
    state = states[-1]
    if state.suspended:
        state = apply(state, Resumed())
    while state.may_undo:
        state = apply(state, Undone())
    assert however_it_lies(replace(state, reasons=())) == SCENE.start


@given(drafts)
@settings(max_examples=60)
def test_what_holds_in_every_state(steps: list[Draft]) -> None:
    _, states = played(steps)
    models = SCENE.block.strips[0].models()
    for state in states:
        # models are accepted in the order of the strip, each once
        assert tuple(m.photos for m in state.models) == models[: len(state.models)]
        if state.current is not None:
            returned = state.returned
            waits = state.current if returned is None else returned.parked
            assert waits is None or waits.photos == models[len(state.models)]
            again = state.accepted(*state.current.photos) is not None
            assert again == (returned is not None)
            names = [p.point for p in state.current.plan]
            assert len(set(names)) == len(names)
            measured = [m.point for m in state.current.measured]
            assert measured == [name for name in names if name in set(measured)]
            assert {point for point, _ in state.current.off} <= set(measured)
            assert {p.point for p in state.current.pending} == set(names) - set(measured)
        rows = [reason[:3] for reason in state.reasons]
        assert len(set(rows)) == len(rows)
        said = [reason for reason in state.reasons if reason.reason in REASONS]
        assert not said or state.last_change is not None
