"""Inner orientation in the session: what may happen when, and how the rest is refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, nan

from hypothesis import given
from hypothesis import strategies as st
from innerscene import InnerScene
from sessionscene import however_it_lies
from test_session_rules import refused

from anaplot.errors import NotComputableError
from anaplot.photogrammetry.camera import FiducialDistance
from anaplot.session.events import (
    Event,
    FiducialMeasured,
    FiducialSwitched,
    ModelAccepted,
    ModelReopened,
    PlannedPoint,
    PointAdded,
    PointRenamed,
    Resumed,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.innerwork import acceptance, inner_outlook, solve_inner
from anaplot.session.state import EventRefusedError, SessionState, apply, fold, start

SCENE = InnerScene()


def inner_of(state: SessionState):
    assert state.current is not None
    inner = state.current.open_inner
    assert inner is not None
    return inner


def test_a_model_begins_with_the_inner_orientation_of_both_photos() -> None:
    state = SCENE.chosen()
    assert state.current is not None
    assert [(i.photo, i.side) for i in state.current.inner] == [("101", "left"), ("102", "right")]
    inner = inner_of(state)
    assert inner.fiducials == inner.pending == tuple("12345678")
    assert (inner.name, inner.accepted) == ("photo 101 (left)", None)


def test_a_point_gets_another_name_when_the_photos_are_oriented() -> None:
    state = apply(SCENE.chosen(1), Undone())  # the first model is accepted, nothing in work
    state = apply(state, ModelReopened("101", "102"))
    assert state.current is not None
    name = state.current.measured[0].point
    refused(state, PointRenamed("101", "102", name, "7"), "photo 101 (left): inner orientation")
    state = SCENE.oriented(state)
    after = apply(state, PointRenamed("101", "102", name, "7"))
    assert after.current is not None
    assert after.current.measurement("7") is not None


def test_a_photo_laid_anew_is_oriented_anew() -> None:
    state = SCENE.chosen(1)
    assert state.current is not None
    assert [(i.photo, i.side) for i in state.current.inner] == [("102", "left"), ("103", "right")]
    assert inner_of(state).pending == tuple("12345678")
    # what was accepted for it in the other carriage stays with the model that it belongs to
    before = state.models[0].inner_of("right")
    assert before is not None
    assert before.photo == "102"
    assert before.accepted is not None


def test_cameras_without_fiducials_ask_for_nothing() -> None:
    bare = replace(SCENE.calibration, fiducials=())
    for camera in (
        replace(SCENE.camera, calibration=None, file=None),
        replace(SCENE.camera, calibration=bare),
    ):
        state = start(replace(SCENE.block, cameras=(camera,)))
        state = apply(state, SCENE.choice(state, 0))
        assert state.current is not None
        assert state.current.inner == ()
        assert state.current.open_inner is None
        event = FiducialMeasured("101", "left", "1", 1.0, 2.0, "key")
        refused(state, event, "photo 101: its camera has no fiducials")
        assert apply(state, SCENE.measurement(state, state.current.plan[0].point)) != state


def test_only_one_photo_with_fiducials() -> None:
    bare = replace(SCENE.camera, id="bare", calibration=None, file=None)
    photos = (SCENE.block.photos[0], replace(SCENE.block.photos[1], camera="bare"))
    block = replace(
        SCENE.block, cameras=(SCENE.camera, bare), photos=photos + SCENE.block.photos[2:]
    )
    state = apply(start(block), SCENE.choice(start(block), 0))
    assert state.current is not None
    assert [i.side for i in state.current.inner] == ["left"]
    state = SCENE.accepted(SCENE.fiducials(state))
    assert state.current is not None
    assert state.current.open_inner is None


def test_points_come_after_the_inner_orientations() -> None:
    state = SCENE.chosen()
    assert state.current is not None
    point = SCENE.measurement(state, state.current.plan[0].point)
    extra = PointAdded(PlannedPoint("extra", "new", 0.0, 0.0, 0.0, 0.0))
    for name in ("photo 101 (left)", "photo 102 (right)"):
        for event in (point, extra, ModelAccepted("101", "102")):
            refused(state, event, f"{name}: inner orientation comes first")
        refused(state, RowSwitched(point.point, None, False), "is not measured in model 101/102")
        state = SCENE.accepted(SCENE.fiducials(state))
    assert apply(state, point).current is not None
    assert apply(state, extra).current is not None


def test_left_then_right() -> None:
    state = SCENE.chosen()
    event = FiducialMeasured("102", "right", "1", 1.0, 2.0, "key")
    refused(state, event, "the inner orientation of photo 101 (left) comes first")
    state = SCENE.accepted(SCENE.fiducials(state))
    assert inner_of(apply(state, event)).pending == tuple("2345678")


def test_fiducials_that_cannot_be_measured() -> None:
    state = SCENE.chosen()
    good = SCENE.fiducial(state, "3")
    refused(SCENE.start, good, "no model is in the instrument")
    refused(state, replace(good, photo="103"), "photo 103: model 101/102 is in the instrument")
    refused(state, replace(good, side="right"), "photo 101 lies on the left, not on the right")
    refused(state, replace(good, fiducial="9"), "photo 101 (left): its camera has no fiducial 9")
    for bad in (nan, inf, -inf):
        refused(state, replace(good, x=bad), "fiducial 3: (")
        refused(state, replace(good, y=bad), "is no place on a plate")
    refused(apply(state, Suspended()), good, "work is suspended: resume first")


def test_a_fiducial_measured_again_replaces_coordinates_and_is_counted() -> None:
    state = SCENE.chosen()
    first = SCENE.fiducial(state, "4")
    state = fold(state, [first, replace(first, x=first.x + 0.5), SCENE.fiducial(state, "2")])
    inner = inner_of(state)
    # in the order of the certificate, whatever was measured first
    assert [(m.fiducial, m.times) for m in inner.measured] == [("2", 1), ("4", 2)]
    assert inner.measured[1].x == first.x + 0.5
    assert inner.pending == tuple("135678")


def test_fiducials_and_their_rows_are_switched() -> None:
    state = SCENE.chosen()
    refused(state, FiducialSwitched("101", "1", "x", False), "fiducial 1 of photo 101 (left)")
    refused(state, FiducialSwitched("101", "no", None, False), "fiducial no of photo 101 (left)")
    state = SCENE.fiducials(state)
    one = apply(state, FiducialSwitched("101", "1", "x", False))
    assert inner_of(one).off == {("1", "x")}
    assert not inner_of(one).is_off("1")
    both = apply(one, FiducialSwitched("101", "1", None, False))
    assert inner_of(both).is_off("1")
    assert "1" not in {m.fiducial for m in inner_of(both).used}
    assert inner_of(apply(both, FiducialSwitched("101", "1", "y", True))).off == {("1", "x")}
    assert apply(both, FiducialSwitched("101", "1", None, True)) == state
    # measured again it is believed again
    again = apply(both, SCENE.fiducial(both, "1"))
    assert inner_of(again).off == frozenset()
    refused(state, FiducialSwitched("102", "1", None, False), "photo 101 (left) comes first")


def test_a_fiducial_that_cannot_be_measured_is_left_out() -> None:
    state = apply(SCENE.chosen(), FiducialSwitched("101", "3", None, False))
    assert inner_of(state).pending == tuple("1245678")
    assert inner_outlook(SCENE.block, inner_of(state)).agenda.remark == "7 of 7 to go"
    back = apply(state, FiducialSwitched("101", "3", None, True))
    assert back == SCENE.chosen()
    measured = apply(state, SCENE.fiducial(state, "3"))
    assert inner_of(measured).off == frozenset()
    for name in inner_of(state).pending:
        state = apply(state, SCENE.fiducial(state, name))
    assert inner_of(state).pending == ()
    assert len(solve_inner(SCENE.block, inner_of(state)).rows) == 14


def test_with_distances_only_a_fiducial_is_switched_as_a_whole() -> None:
    distances = (FiducialDistance("5", "6", 225.4), FiducialDistance("8", "7", 225.4))
    calibration = replace(SCENE.calibration, fiducials=(), distances=distances)
    camera = replace(SCENE.camera, calibration=calibration)
    state = start(replace(SCENE.block, cameras=(camera,)))
    state = apply(state, SCENE.choice(state, 0))
    assert inner_of(state).fiducials == ("5", "6", "8", "7")
    for name in ("5", "6", "7", "8"):
        state = apply(state, SCENE.fiducial(state, name))
    refused(state, FiducialSwitched("101", "5", "x", False), "it is switched as a whole")
    assert inner_of(apply(state, FiducialSwitched("101", "5", None, False))).is_off("5")
    solution = solve_inner(state.block, inner_of(state))
    assert solution.kind == "distances"


def test_accepting_an_inner_orientation() -> None:
    state = SCENE.chosen()
    measured = SCENE.fiducials(state)
    inner = inner_of(measured)
    event = acceptance(inner, solve_inner(measured.block, inner))
    refused(state, event, "photo 101 (left): no fiducial is measured")
    refused(measured, replace(event, photo="102", side="right"), "photo 101 (left) comes first")
    refused(measured, replace(event, transformation="cubic"), "there is no transformation cubic")
    folded = ((0.0, 1.0, 2.0), (0.0, 2.0, 4.0))
    refused(measured, replace(event, frame=folded), "folds the plate into a line")
    bad = (event.numerator[0], (nan, 0.0, 0.0, 0.0))
    refused(measured, replace(event, numerator=bad), "not finite")
    state = apply(measured, event)
    assert state.current is not None
    left = state.current.inner_of("left")
    assert left is not None
    assert left.accepted == solve_inner(measured.block, inner).transformation
    refused(state, event, "the inner orientation of photo 101 (left) is accepted already")
    refused(
        state,
        FiducialMeasured("101", "left", "1", 1.0, 2.0, "key"),
        "the inner orientation of photo 101 (left) is accepted already",
    )


def test_undo_works_through_it() -> None:
    states = [SCENE.start, SCENE.chosen()]
    for name in ("1", "2", "3", "4"):
        states.append(apply(states[-1], SCENE.fiducial(states[-1], name)))
    states.append(apply(states[-1], FiducialSwitched("101", "2", "y", False)))
    states.append(apply(states[-1], FiducialSwitched("101", "2", "y", True)))
    states.append(SCENE.accepted(states[-1]))
    states.append(apply(states[-1], SCENE.fiducial(states[-1], "1")))
    for before, after in zip(states[-2::-1], states[:0:-1], strict=True):
        assert however_it_lies(apply(after, Undone())) == however_it_lies(before)
    back = fold(states[-1], [Undone()] * (len(states) - 1))
    assert however_it_lies(back) == SCENE.start


def test_a_whole_strip() -> None:
    state = SCENE.whole(SCENE.chosen(2))
    assert state.current is not None
    assert state.current.pending == ()
    assert all(i.accepted is not None for m in state.models for i in m.inner)


# -- properties ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Draft:
    """What is to happen, made into an event for whatever state it meets."""

    kind: int
    number: int
    flag: bool

    def event(self, state: SessionState) -> Event:
        name = SCENE.calibration.fiducials[self.number % 8].id
        current = state.current
        if current is None:
            return SCENE.choice(state, len(state.models)) if len(state.models) < 3 else Undone()
        inner = current.open_inner
        match self.kind:
            case 0 | 1 | 2 | 3 if inner is not None:
                return SCENE.fiducial(state, name, dx=self.number * 1e-3)
            case 0 | 1 | 2 | 3:
                return SCENE.measurement(state, current.plan[self.number % 13].point)
            case 4:
                photo = current.left if self.flag else current.right
                return FiducialSwitched(photo, name, (None, "x", "y")[self.number % 3], self.flag)
            case 5 if inner is not None and len(inner.used) >= 3:
                try:
                    return acceptance(inner, solve_inner(state.block, inner))
                except NotComputableError:
                    return Undone()
            case 6:
                return Undone()
            case 7:
                return Suspended() if self.flag else Resumed()
            case 8:
                return Resumed()
            case _:
                side = "left" if self.flag else "right"
                return FiducialMeasured(current.left, side, name, 1.0, 2.0, "key")


drafts = st.lists(
    st.builds(Draft, st.integers(0, 9), st.integers(0, 40), st.booleans()), max_size=80
)


@given(drafts)
def test_the_fold_is_pure_and_undo_its_exact_inverse(steps: list[Draft]) -> None:
    state, events, states = SCENE.start, [], [SCENE.start]
    for step in steps:
        event = step.event(state)
        try:
            state = apply(state, event)
        except EventRefusedError:
            assert states[-1] == state
            continue
        events.append(event)
        states.append(state)
    assert fold(SCENE.start, events) == state
    assert fold(SCENE.start, events)._history == state._history
    for before, event, after in zip(states, events, states[1:], strict=False):
        if not isinstance(event, Undone | Suspended | Resumed):
            assert however_it_lies(apply(after, Undone())) == however_it_lies(before)
    for seen in states:
        if seen.current is None:
            continue
        # left before right, and nothing of the points before both
        accepted = [i.accepted is not None for i in seen.current.inner]
        assert accepted == sorted(accepted, reverse=True)
        assert all(accepted) or seen.current.measured == ()
        for inner in seen.current.inner:
            done = {m.fiducial for m in inner.measured}
            assert {name for name, _ in inner.off} <= done
            assert set(inner.pending) == set(inner.fiducials) - done
