"""What the operator is told during an inner orientation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from innerscene import InnerScene
from sessionscene import Scene

from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.refinement import Refinement
from anaplot.session.events import FiducialSwitched, ModelAccepted, Suspended, Undone
from anaplot.session.innerwork import solve_inner
from anaplot.session.models import solve
from anaplot.session.state import SessionState, apply, start
from anaplot.session.workflow import Outlook, outlook

SCENE = InnerScene()


def work(view: Outlook):
    assert view.inner is not None
    return view.inner


def measured(state: SessionState, names: str, wrong: str = "", dx: float = 0.2) -> SessionState:
    for name in names:
        state = apply(state, SCENE.fiducial(state, name, dx=dx if name == wrong else 0.0))
    return state


def test_a_model_just_laid() -> None:
    view = outlook(SCENE.chosen())
    assert view.expected == "measure fiducial 1 of photo 101 (left): 8 of 8 to go"
    assert (view.next_point, view.solution, view.diagnosis) == ("1", None, None)
    assert not view.may_accept
    assert (work(view).solution, work(view).problem, work(view).advice) == (None, "", ())


def test_the_table_appears_with_the_third_fiducial() -> None:
    state = SCENE.chosen()
    kinds = []
    for k, name in enumerate("12345678", 1):
        state = measured(state, name)
        view = outlook(state)
        solution = work(view).solution
        assert (solution is None) == (k < 3) == (view.problem != "")
        assert view.may_accept == (k >= 3)
        if solution is not None:
            kinds.append(solution.kind)
            assert len(solution.rows) == 2 * k
    assert kinds == ["helmert", "affine", *["bilinear"] * 4]
    assert outlook(state).expected == "accept the inner orientation of photo 101 (left)"
    assert outlook(state).next_point is None
    assert work(outlook(state)).advice == ("nothing is flagged",)


def test_right_follows_left_and_then_the_points() -> None:
    state = SCENE.accepted(SCENE.fiducials(SCENE.chosen()))
    view = outlook(state)
    assert view.expected == "measure fiducial 1 of photo 102 (right): 8 of 8 to go"
    state = SCENE.accepted(SCENE.fiducials(state))
    view = outlook(state)
    assert state.current is not None
    assert view.inner is None
    assert view.next_point == state.current.plan[0].point


@pytest.mark.parametrize("wrong", "12345678")
def test_a_wrong_fiducial_is_to_be_measured_again(wrong: str) -> None:
    state = measured(SCENE.chosen(), "12345678", wrong)
    view = outlook(state)
    assert view.next_point == wrong
    assert view.expected == (
        f"remeasure fiducial {wrong}, or switch it off, or accept the inner orientation"
    )
    assert work(view).suspects[0] == (wrong, "x")
    assert work(view).advice[0].startswith(f"remeasure {wrong} (x)")
    repaired = measured(state, wrong)
    assert outlook(repaired).expected.startswith("accept")
    for axis in ("x", None):
        off = apply(state, FiducialSwitched("101", wrong, axis, False))
        assert outlook(off).expected.startswith("accept")
        assert work(outlook(off)).suspects == ()
        said = f"switched off: {wrong} x" + (f", {wrong} y" if axis is None else "")
        assert work(outlook(off)).advice[-1] == said


def test_a_flagged_fiducial_while_others_are_pending() -> None:
    # seven of eight: the test can tell already
    view = outlook(measured(SCENE.chosen(), "1234567", "5", dx=0.5))
    assert view.next_point == "8"
    assert view.expected.startswith("remeasure fiducial 5, or measure fiducial 8 of photo 101")


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_among_four_fiducials_each_is_measured_again_in_turn(kind) -> None:
    marks = SCENE.calibration.fiducials[:4]
    camera = replace(SCENE.camera, calibration=replace(SCENE.calibration, fiducials=marks))
    state = start(replace(SCENE.block, cameras=(camera,), test=TestSettings(kind=kind)))
    state = apply(state, SCENE.choice(state, 0))
    state = measured(state, "1234", "3")
    seen = []
    for _ in range(4):
        view = outlook(state)
        assert "not known" in work(view).advice[0]
        assert all(axis is None for _, axis in work(view).suspects)
        assert view.next_point is not None
        seen.append(view.next_point)
        # still wrong, so that nothing is settled by it
        state = measured(state, view.next_point, "3")
    assert seen == ["1", "2", "3", "4"]
    assert outlook(measured(state, "3")).expected.startswith("accept")


def test_exchanged_fiducials_are_both_named() -> None:
    state = SCENE.chosen()
    first, second = SCENE.fiducial(state, "1"), SCENE.fiducial(state, "5")
    state = measured(state, "234678")
    state = apply(state, replace(first, x=second.x, y=second.y))
    state = apply(state, replace(second, x=first.x, y=first.y))
    view = outlook(state)
    assert set(work(view).suspects) == {("1", None), ("5", None)}
    assert "exchanged" in work(view).advice[0]


def test_exchanged_so_that_nothing_fits() -> None:
    state = SCENE.chosen()
    first, second = SCENE.fiducial(state, "5"), SCENE.fiducial(state, "7")
    state = measured(state, "123468")
    state = apply(state, replace(first, x=second.x, y=second.y))
    state = apply(state, replace(second, x=first.x, y=first.y))
    view = outlook(state)
    assert "5 and 7 seem to be exchanged" in view.problem
    assert view.expected.startswith("re-measure fiducials of photo 101 (left)")
    assert not view.may_accept


def test_fiducials_that_determine_nothing() -> None:
    state = SCENE.chosen()
    for name in "12345678":
        state = apply(state, replace(SCENE.fiducial(state, name), x=1.0, y=2.0))
    view = outlook(state)
    assert "measured at the same place" in view.problem
    assert "its inner orientation is not determined" in view.expected
    assert not view.may_accept
    assert view.next_point is None


def test_while_suspended() -> None:
    view = outlook(apply(SCENE.fiducials(SCENE.chosen()), Suspended()))
    assert view.expected == "work is suspended: resume"
    assert not view.may_accept


def test_the_same_measurements_have_the_same_result_object() -> None:
    state = measured(SCENE.chosen(), "12345")
    solution = work(outlook(state)).solution
    again = apply(measured(state, "6"), Undone())
    assert work(outlook(again)).solution is solution


def test_what_is_accepted_leads_from_the_plate_to_the_truth() -> None:
    state = SCENE.oriented(SCENE.chosen())
    assert state.current is not None
    places = np.array([(x, y) for x in (-90.0, 0.0, 90.0) for y in (-90.0, 0.0, 90.0)])
    refinement = Refinement.of(SCENE.calibration)
    for inner in state.current.inner:
        placement = SCENE.placements[inner.photo, inner.side]
        plate = placement.to_plate(refinement.distort(places))
        assert inner.accepted is not None
        found = refinement.refine(inner.accepted.to_image(plate))
        # pointing noise of 3 um in eight fiducials
        assert np.abs(found - places).max() < 0.010
        redundancy = solve_inner(state.block, inner).redundancy
        assert redundancy == 8


def test_models_are_those_of_the_same_points_without_plates() -> None:
    plain, with_plates = Scene(), SCENE
    plain.block = replace(plain.block, test=SCENE.block.test)
    plain.start = start(plain.block)
    state = plain.whole(plain.chosen(1))
    other = with_plates.whole(with_plates.chosen(1))
    assert state.current is not None
    assert other.current is not None
    assert solve(state, state.current).table == solve(other, other.current).table
    assert apply(other, ModelAccepted("102", "103")).models[-1].inner == other.current.inner
