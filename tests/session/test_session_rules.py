"""What may happen in which state, and in which words the rest is refused."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import pytest
from sessionscene import Scene, however_it_lies

from anaplot.photogrammetry.block import ImagePoint
from anaplot.session.events import (
    Event,
    ModelAccepted,
    ModelChosen,
    PlannedPoint,
    PointAdded,
    PointMeasured,
    Resumed,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.state import EventRefusedError, SessionState, apply, fold, start


def refused(state: SessionState, event: Event, words: str) -> None:
    history = state._history
    with pytest.raises(EventRefusedError) as caught:
        apply(state, event)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2
    assert state._history is history


def test_the_start_holds_no_measurements(scene: Scene) -> None:
    block = replace(scene.block, image_points=(ImagePoint("101", "1", 0.0, 0.0),))
    state = start(block)
    assert state.block.image_points == ()
    assert (state.models, state.current, state.suspended, state.may_undo) == (
        (),
        None,
        False,
        False,
    )


# -- choosing a model ----------------------------------------------------------------------------


def test_a_model_is_chosen(scene: Scene) -> None:
    state = scene.chosen()
    model = state.current
    assert model is not None
    assert (model.strip, model.photos, model.name) == ("1", ("101", "102"), "101/102")
    assert model.pending == model.plan
    assert len(model.plan) == 13
    assert {p.role for p in model.plan} == {"new"}


@pytest.mark.parametrize(
    ("strip", "left", "right", "words"),
    [
        ("1", "101", "103", "model 101/103 is not a model of strip 1"),
        ("1", "102", "101", "model 102/101 is not a model of strip 1"),
        ("2", "101", "102", "model 101/102 is not a model of strip 2"),
        ("1", "102", "103", "model 102/103: the model before it is not accepted yet"),
    ],
)
def test_only_the_next_model_of_a_strip(
    scene: Scene, strip: str, left: str, right: str, words: str
) -> None:
    refused(scene.start, ModelChosen(strip, left, right, ()), words)


def test_one_model_at_a_time(scene: Scene) -> None:
    state = scene.chosen()
    refused(state, scene.choice(scene.start, 0), "accept model 101/102 first")


def test_an_accepted_model_is_not_chosen_again(scene: Scene) -> None:
    state = apply(scene.whole(scene.chosen()), ModelAccepted("101", "102"))
    refused(state, ModelChosen("1", "101", "102", ()), "model 101/102 is accepted already")


def test_a_point_is_planned_once(scene: Scene) -> None:
    chosen = scene.choice(scene.start, 0)
    twice = replace(chosen, plan=(*chosen.plan, chosen.plan[0]))
    refused(scene.start, twice, "a point is planned twice")


def test_planned_roles_must_be_true(scene: Scene) -> None:
    chosen = scene.choice(scene.start, 0)
    lie = replace(chosen, plan=(replace(chosen.plan[0], role="tie"), *chosen.plan[1:]))
    name = chosen.plan[0].point
    refused(
        scene.start, lie, f"point {name} is planned as tie, but is not a point of the preceding"
    )
    state = apply(scene.whole(scene.chosen()), ModelAccepted("101", "102"))
    chosen = scene.choice(state, 1)
    tie = chosen.plan[0]
    assert tie.role == "tie"
    lie = replace(chosen, plan=(replace(tie, role="new"), *chosen.plan[1:]))
    refused(
        state, lie, f"point {tie.point} is planned as new, but is a point of the preceding model"
    )


def test_a_point_switched_off_is_no_tie_of_the_next_model(scene: Scene) -> None:
    state = scene.whole(scene.chosen())
    chosen = scene.choice(apply(state, ModelAccepted("101", "102")), 1)
    tie = chosen.plan[0].point
    state = fold(state, [RowSwitched(tie, None, False), ModelAccepted("101", "102")])
    refused(state, chosen, f"point {tie} is planned as tie, but is not a point")
    again = scene.choice(state, 1)
    assert tie not in {p.point for p in again.plan if p.role == "tie"}
    assert apply(state, again).current is not None


# -- measuring -----------------------------------------------------------------------------------


def test_a_point_measured_again_replaces_coordinates_and_is_counted(scene: Scene) -> None:
    state = scene.chosen()
    assert state.current is not None
    name = state.current.plan[3].point
    first = scene.measurement(state, name)
    second = replace(first, yr=first.yr + 0.5)
    state = fold(state, [first, second])
    assert state.current is not None
    (measured,) = state.current.measured
    assert (measured.point, measured.times, measured.yr) == (name, 2, second.yr)
    assert name not in {p.point for p in state.current.pending}


def test_measurements_keep_the_order_of_the_plan(scene: Scene) -> None:
    state = scene.chosen()
    assert state.current is not None
    names = [p.point for p in state.current.plan]
    for name in reversed(names):
        state = apply(state, scene.measurement(state, name))
    assert state.current is not None
    assert [m.point for m in state.current.measured] == names


def test_measurements_that_cannot_be(scene: Scene) -> None:
    state = scene.chosen()
    assert state.current is not None
    good = scene.measurement(state, state.current.plan[0].point)
    refused(scene.start, good, "no model is in the instrument")
    refused(
        state,
        replace(good, left="102", right="103"),
        f"point {good.point} of 102/103: 101/102 is in the instrument",
    )
    refused(state, replace(good, point="nowhere"), "point nowhere is not in the plan of model")


@pytest.mark.parametrize("bad", [115.001, -115.001, nan, inf, -inf, 1e300])
@pytest.mark.parametrize(
    ("key", "photo"), [("xl", "101"), ("yl", "101"), ("xr", "102"), ("yr", "102")]
)
def test_coordinates_outside_the_photo(scene: Scene, bad: float, key: str, photo: str) -> None:
    state = scene.chosen()
    assert state.current is not None
    good = scene.measurement(state, state.current.plan[0].point)
    refused(state, replace(good, **{key: bad}), f"lies outside photo {photo}")


def test_coordinates_on_the_edge_are_inside(scene: Scene) -> None:
    state = scene.chosen()
    assert state.current is not None
    good = scene.measurement(state, state.current.plan[0].point)
    edge = replace(good, xl=115.0, yl=-115.0, xr=-115.0, yr=115.0)
    assert apply(state, edge) != state


def test_each_photo_is_judged_by_its_own_camera(scene: Scene) -> None:
    small = replace(scene.block.cameras[0], id="small", format=(100.0, 60.0))
    photos = (scene.block.photos[0], replace(scene.block.photos[1], camera="small"))
    block = replace(
        scene.block, cameras=(*scene.block.cameras, small), photos=photos + scene.block.photos[2:]
    )
    plan = (PlannedPoint("p", "new", 90.0, 100.0, 0.0, 20.0),)
    state = apply(start(block), ModelChosen("1", "101", "102", plan))
    good = PointMeasured("101", "102", "p", 90.0, 100.0, 0.0, 30.0, "pedal")
    assert apply(state, good).current is not None
    refused(state, replace(good, yr=30.1), "(0.000, 30.100) lies outside photo 102")


# -- adding, switching ---------------------------------------------------------------------------


def test_a_point_is_added_at_the_end_of_the_plan(scene: Scene) -> None:
    state = scene.chosen()
    extra = PlannedPoint("extra", "new", 10.0, 20.0, -82.0, 20.0)
    after = apply(state, PointAdded(extra))
    assert after.current is not None
    assert after.current.plan[-1] == extra
    refused(after, PointAdded(extra), "point extra is in model 101/102 already")
    refused(scene.start, PointAdded(extra), "no model is in the instrument")


def test_an_added_points_role_must_be_true(scene: Scene) -> None:
    state = scene.chosen(1)
    assert state.current is not None
    before = state.preceding("1", "102")
    assert before is not None
    planned = {p.point for p in state.current.plan}
    known = next(m.point for m in before.used if m.point not in planned)
    place = (0.0, 0.0, -92.0, 0.0)
    refused(state, PointAdded(PlannedPoint(known, "new", *place)), "is a point of the preceding")
    refused(state, PointAdded(PlannedPoint("x", "tie", *place)), "is not a point of the preceding")
    after = apply(state, PointAdded(PlannedPoint(known, "tie", *place)))
    assert after.current is not None
    assert after.current.axes(known) == ("y", "x")


def test_rows_are_switched_off_and_on(scene: Scene) -> None:
    state = scene.whole(scene.chosen(1))
    model = state.current
    assert model is not None
    tie, new = model.plan[0], model.plan[-1]
    assert (tie.role, new.role) == ("tie", "new")
    assert (model.axes(tie.point), model.axes(new.point)) == (("y", "x"), ("y",))

    one = apply(state, RowSwitched(tie.point, "x", False)).current
    assert one is not None
    assert one.off == {(tie.point, "x")}
    assert not one.is_off(tie.point)
    assert len(one.used) == len(model.used)

    whole = apply(state, RowSwitched(tie.point, None, False))
    assert whole.current is not None
    assert whole.current.off == {(tie.point, "x"), (tie.point, "y")}
    assert whole.current.is_off(tie.point)
    assert tie.point not in {m.point for m in whole.current.used}
    half = apply(whole, RowSwitched(tie.point, "y", True)).current
    assert half is not None
    assert half.off == {(tie.point, "x")}
    assert apply(whole, RowSwitched(tie.point, None, True)) == state

    alone = apply(state, RowSwitched(new.point, "y", False)).current
    assert alone is not None
    assert alone.is_off(new.point)


def test_rows_that_do_not_exist_are_not_switched(scene: Scene) -> None:
    state = scene.chosen(1)
    assert state.current is not None
    tie, new = state.current.plan[0].point, state.current.plan[-1].point
    for axis in ("x", "y"):
        refused(state, RowSwitched(tie, axis, False), f"point {tie} is not measured in model 102")
    state = scene.whole(state)
    refused(state, RowSwitched(new, "x", False), f"point {new} is no tie: it has no x row")
    refused(state, RowSwitched("nowhere", "y", False), "point nowhere is not measured")
    refused(scene.start, RowSwitched(tie, None, False), "no model is in the instrument")


def test_a_point_that_cannot_be_measured_is_left_out(scene: Scene) -> None:
    before = scene.chosen(1)
    assert before.current is not None
    tie, new = before.current.plan[0].point, before.current.plan[-1].point
    for point in (tie, new):
        state = apply(before, RowSwitched(point, None, False))
        assert state.current is not None
        assert point not in [p.point for p in state.current.pending]
        assert len(state.current.pending) == len(before.current.pending) - 1
        assert apply(state, RowSwitched(point, None, True)) == before
        # measured after all it counts
        measured = apply(state, scene.measurement(state, point)).current
        assert measured is not None
        assert measured.off == frozenset()
        whole = apply(scene.whole(state), ModelAccepted("102", "103"))
        assert point not in {m.point for m in whole.models[-1].measured}


def test_a_point_measured_again_is_believed_again(scene: Scene) -> None:
    state = scene.whole(scene.chosen(1))
    assert state.current is not None
    tie, other = (p.point for p in state.current.plan[:2])
    state = fold(state, [RowSwitched(tie, None, False), RowSwitched(other, "x", False)])
    state = apply(state, scene.measurement(state, tie))
    assert state.current is not None
    assert state.current.off == {(other, "x")}


# -- accepting -----------------------------------------------------------------------------------


def test_accepting_makes_room_for_the_next_model(scene: Scene) -> None:
    state = scene.whole(scene.chosen())
    refused(state, ModelAccepted("102", "103"), "model 101/102 is in the instrument")
    after = apply(state, ModelAccepted("101", "102"))
    assert after.current is None
    assert after.models == (state.current,)
    assert after.accepted("101", "102") is state.current
    assert after.preceding("1", "102") is state.current
    assert after.preceding("1", "101") is None
    refused(after, ModelAccepted("101", "102"), "no model is in the instrument")


# -- suspending ----------------------------------------------------------------------------------


def test_while_suspended_nothing_happens_but_resuming(scene: Scene) -> None:
    state = scene.chosen()
    assert state.current is not None
    name = state.current.plan[0].point
    measured = scene.measurement(state, name)
    suspended = apply(state, Suspended())
    assert suspended.suspended
    for event in (
        measured,
        RowSwitched(name, None, False),
        PointAdded(PlannedPoint("extra", "new", 0.0, 0.0, 0.0, 0.0)),
        ModelAccepted("101", "102"),
        ModelChosen("1", "101", "102", ()),
        Undone(),
        Suspended(),
    ):
        refused(suspended, event, "work is suspended: resume first")
    assert apply(suspended, Resumed()) == state
    refused(state, Resumed(), "work is not suspended")


def test_suspending_is_nothing_to_undo(scene: Scene) -> None:
    state = scene.chosen()
    again = fold(state, [Suspended(), Resumed(), Undone()])
    assert again == scene.start


# -- undoing -------------------------------------------------------------------------------------


def test_undo_takes_back_every_kind_of_event(scene: Scene) -> None:
    state = scene.whole(scene.chosen())
    assert state.current is not None
    name = state.current.plan[0].point
    for event in (
        scene.measurement(state, name, dyr=0.1),
        RowSwitched(name, "y", False),
        PointAdded(PlannedPoint("extra", "new", 0.0, 0.0, 0.0, 0.0)),
        ModelAccepted("101", "102"),
    ):
        assert apply(apply(state, event), Undone()) == state
    accepted = apply(state, ModelAccepted("101", "102"))
    assert fold(accepted, [scene.choice(accepted, 1), Undone()]) == accepted


def test_undo_at_the_start(scene: Scene) -> None:
    refused(scene.start, Undone(), "there is nothing to undo")


def test_undo_all_gives_the_start(scene: Scene) -> None:
    state = scene.whole(scene.chosen(1))
    count = 0
    while state.may_undo:
        state = apply(state, Undone())
        count += 1
    assert count == 13 + 1 + 1 + 13 + 1
    assert however_it_lies(state) == scene.start


def test_undo_reaches_back_a_bounded_number_of_events(scene: Scene) -> None:
    state = scene.chosen()
    assert state.current is not None
    name = state.current.plan[0].point
    event = scene.measurement(state, name)
    state = fold(state, [event] * 1100)
    assert len(state._history) == 1000
    state = fold(state, [Undone()] * 1000)
    assert state.current is not None
    assert state.current.measured[0].times == 100
    refused(state, Undone(), "there is nothing to undo")
