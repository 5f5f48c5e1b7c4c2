"""Models of a mono comparator: one photo after the other, by the rules of the fold."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sessionscene import Scene

from anaplot.aliases import Side
from anaplot.session.events import (
    Event,
    ModelAccepted,
    MonoMeasured,
    PhotoLaid,
    PlannedPoint,
    PointAdded,
    RowSwitched,
    Undone,
)
from anaplot.session.models import solve
from anaplot.session.nextstep import remeasured_side
from anaplot.session.state import EventRefusedError, ModelState, SessionState, apply, fold
from anaplot.session.workflow import outlook

SCENE = Scene(4)


def current(state: SessionState) -> ModelState:
    assert state.current is not None
    return state.current


def chosen(state: SessionState, model: int = 0) -> SessionState:
    return apply(state, replace(SCENE.choice(state, model), mono=True))


def seen(state: SessionState, point: str, side: Side, dy: float = 0.0) -> MonoMeasured:
    """The event that records a point in one photo."""
    model = current(state)
    x, y = SCENE.noisy[model.photos, model.photo(side), point]
    return MonoMeasured(model.left, model.right, side, point, x, y + dy, "key")


def laid(state: SessionState, side: Side) -> SessionState:
    return apply(state, PhotoLaid(current(state).photo(side)))


def passed(state: SessionState, side: Side) -> SessionState:
    """The state with every pending point of the photo that lies there measured."""
    for planned in current(state).pending_in(side):
        state = apply(state, seen(state, planned.point, side))
    return state


def whole(state: SessionState) -> SessionState:
    if current(state).laid is None:
        state = laid(state, "left")
    return passed(laid(passed(state, "left"), "right"), "right")


def test_a_point_counts_when_both_photos_have_it() -> None:
    state = laid(chosen(SCENE.start), "left")
    names = [p.point for p in current(state).plan]
    state = passed(state, "left")
    assert current(state).measured == ()
    assert current(state).pending_in("left") == ()
    assert len(current(state).pending) == len(names)
    state = apply(laid(state, "right"), seen(state, names[4], "right"))
    [measured] = current(state).measured
    assert (measured.point, measured.times) == (names[4], 1)
    left, right = (current(state).sighting(side, names[4]) for side in ("left", "right"))
    assert left is not None
    assert right is not None
    assert (measured.xl, measured.yl, measured.xr, measured.yr) == (
        left.x,
        left.y,
        right.x,
        right.y,
    )


def test_the_same_coordinates_give_the_same_model_as_a_stereo_plotter() -> None:
    stereo = SCENE.whole(apply(SCENE.start, SCENE.choice(SCENE.start, 0)))
    mono = whole(chosen(SCENE.start))
    assert solve(mono, current(mono)).table == solve(stereo, current(stereo)).table


def test_what_the_model_before_measured_is_taken_over() -> None:
    state = apply(whole(chosen(SCENE.start)), ModelAccepted("101", "102"))
    before = {m.point: (m.xr, m.yr) for m in state.models[0].used}
    state = chosen(state, 1)
    model = current(state)
    ties = [p.point for p in model.plan if p.role == "tie"]
    assert {s.point: (s.x, s.y) for s in model.seen} == {name: before[name] for name in ties}
    # it was laid in last, and lies there
    assert model.laid == "left"
    assert "photo 102" in outlook(state).expected
    # another photo in between, and it has to be laid in again
    other = apply(SCENE.start, replace(SCENE.choice(SCENE.start, 0), mono=True))
    other = apply(laid(whole(other), "left"), ModelAccepted("101", "102"))
    assert current(chosen(other, 1)).laid is None
    assert outlook(chosen(other, 1)).next_photo == "left"


def test_a_tie_added_later_is_taken_over_too() -> None:
    state = apply(whole(chosen(SCENE.start)), ModelAccepted("101", "102"))
    choice = SCENE.choice(state, 1)
    [*rest, last] = [p for p in choice.plan if p.role == "tie"]
    plan = tuple(p for p in choice.plan if p != last)
    state = apply(state, replace(choice, plan=plan, mono=True))
    assert len(current(state).seen) == len(rest)
    state = apply(state, PointAdded(last))
    assert current(state).sighting("left", last.point) is not None


def test_the_order_of_the_work() -> None:
    state = chosen(SCENE.start)
    assert outlook(state).next_photo == "left"
    assert outlook(state).expected.startswith("lay photo 101 into the comparator: 13 points")
    state = laid(state, "left")
    view = outlook(state)
    assert (view.next_photo, view.next_point) == (None, current(state).plan[0].point)
    state = passed(state, "left")
    assert (outlook(state).next_photo, outlook(state).next_point) == ("right", None)
    assert not outlook(state).may_accept
    state = passed(laid(state, "right"), "right")
    view = outlook(state)
    assert (view.next_photo, view.next_point, view.may_accept) == (None, None, True)
    wrong = current(state).plan[2].point
    state = apply(state, seen(state, wrong, "right", dy=0.5))
    assert outlook(state).next_photo == "left"  # measured less often there
    assert remeasured_side(current(state), wrong) == "left"
    state = laid(state, "left")
    assert outlook(state).next_point == wrong
    switched = apply(state, RowSwitched(wrong, None, False))
    assert outlook(switched).next_photo is None
    again = apply(state, seen(state, wrong, "left"))
    assert remeasured_side(current(again), wrong) == "left"  # nothing has to be changed


def test_what_cannot_happen_is_refused() -> None:
    state = chosen(SCENE.start)
    point = current(state).plan[0].point
    with pytest.raises(EventRefusedError, match="photo 101 does not lie in the comparator"):
        apply(state, seen(state, point, "left"))
    with pytest.raises(EventRefusedError, match="photo 103 is not in model"):
        apply(state, PhotoLaid("103"))
    state = laid(state, "left")
    with pytest.raises(EventRefusedError, match="photo 102 does not lie in the comparator"):
        apply(state, seen(state, point, "right"))
    with pytest.raises(EventRefusedError, match="lies outside photo 101"):
        apply(state, replace(seen(state, point, "left"), x=500.0))
    with pytest.raises(EventRefusedError, match="not in the plan"):
        apply(state, replace(seen(state, point, "left"), point="nowhere"))
    with pytest.raises(EventRefusedError, match="102/103"):
        apply(state, replace(seen(state, point, "left"), left="102", right="103"))
    with pytest.raises(EventRefusedError, match="one photo after the other"):
        apply(state, SCENE.measurement(state, point))
    stereo = apply(SCENE.start, SCENE.choice(SCENE.start, 0))
    for event in (PhotoLaid("101"), seen(stereo, point, "left")):
        with pytest.raises(EventRefusedError, match="holds both photos"):
            apply(stereo, event)


@dataclass(frozen=True)
class Draft:
    """What is to happen, made into an event for whatever state it meets."""

    kind: int
    number: int
    side: Side

    def event(self, state: SessionState) -> Event:
        model = state.current
        if model is None:
            return replace(SCENE.choice(state, min(len(state.models), 2)), mono=True)
        point = model.plan[self.number % len(model.plan)].point
        match self.kind:
            case 0:
                return Undone()
            case 1:
                return PhotoLaid(model.photo(self.side))
            case 2:
                return RowSwitched(point, None, self.number % 2 == 0)
            case 3:
                return ModelAccepted(model.left, model.right)
            case 4:
                name = f"extra{self.number % 3}"
                return PointAdded(PlannedPoint(name, "new", 1.0, 2.0, -90.0, 2.0))
            case _ if point.startswith("extra"):
                y = self.number * 0.1
                return MonoMeasured(model.left, model.right, self.side, point, 1.0, y, "key")
            case _:
                return seen(state, point, self.side)


@pytest.mark.slow
@given(
    st.lists(
        st.builds(
            Draft, st.integers(0, 12), st.integers(0, 40), st.sampled_from(["left", "right"])
        ),
        max_size=150,
    )
)
@settings(max_examples=150)
def test_what_holds_in_every_state(steps: list[Draft]) -> None:
    state = SCENE.start
    events: list[Event] = []
    layings = 0
    for step in steps:
        event = step.event(state)
        try:
            state = apply(state, event)
        except EventRefusedError:
            continue
        events.append(event)
        layings += isinstance(event, PhotoLaid)
        assert state.layings == layings
        model = state.current
        if model is None:
            continue
        # what lies there is what was laid in last, or nobody knows
        assert model.laid is None or model.laying == layings
        if model.laid is not None:
            last = [e for e in events if isinstance(e, PhotoLaid)][-1]
            assert model.photo(model.laid) == last.photo
        both = {s.point for s in model.seen if s.side == "left"} & {
            s.point for s in model.seen if s.side == "right"
        }
        assert [m.point for m in model.measured] == [p.point for p in model.plan if p.point in both]
        assert {point for point, _ in model.off} <= {p.point for p in model.plan}
        outlook(state)
    assert fold(SCENE.start, events) == state
    while state.may_undo:
        state = apply(state, Undone())
    assert replace(state, layings=0) == SCENE.start
