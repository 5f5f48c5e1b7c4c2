"""What is seen in the eyepieces, and the handwheels of a real simulated plotter behind a line."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stationbench import WAIT, settled

from anaplot.errors import InputError
from anaplot.planning.synthetic import synthetic_strip
from anaplot.plotter.device.hand import Hand
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position
from anaplot.session.plates import ReadOut
from anaplot.simulation.stereo import StereoGround

TRUTH = synthetic_strip(3, seed=1).truth
LEFT, RIGHT = TRUTH["101"], TRUTH["102"]
COMMON = [name for name in LEFT if name in RIGHT]
FIELDS = (5.0, 1.0, 0.2, 0.05)


def ground(left="101", right="102") -> StereoGround:
    return StereoGround(left, right, LEFT, RIGHT)


def beside(point: str, dx=0.0, dy=0.0, px=0.0, py=0.0) -> Position:
    """Marks beside a point, with so much parallax left."""
    (xl, yl), (xr, yr) = LEFT[point], RIGHT[point]
    return Position(xl + dx, yl + dy, xr + dx - px, yr + dy - py)


def alike(pair, reach: int = 12) -> float:
    """Correlation of the patches near the mark."""
    rows, columns = pair.left.shape
    part = (
        slice(rows // 2 - reach, rows // 2 + reach),
        slice(columns // 2 - reach, columns // 2 + reach),
    )
    return float(np.corrcoef(pair.left[part].ravel(), pair.right[part].ravel())[0, 1])


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("point", COMMON)
def test_the_patches_are_alike_when_parallax_is_cleared(field, point):
    # away from the signal itself, so that the ground is compared
    cleared = ground().look(beside(point, dx=0.3 * field), 50, 44, field)
    assert alike(cleared) > 0.9


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize(("px", "py"), [(1.0, 0.0), (0.0, 1.0), (-0.7, 0.7)])
def test_parallax_makes_them_differ(field, px, py):
    likeness = []
    for point in COMMON:
        step = 0.25 * field
        at = beside(point, dx=0.3 * field, px=px * step, py=py * step)
        likeness.append(alike(ground().look(at, 50, 44, field)))
    assert max(likeness) < 0.85
    assert np.mean(likeness) < 0.5


@pytest.mark.parametrize(
    ("columns", "field", "cells"), [(50, 1.0, 5), (100, 1.0, 10), (40, 2.0, 2)]
)
def test_a_tenth_of_a_millimetre_moves_the_picture_by_as_many_cells(columns, field, cells):
    eyes = ground()
    point = COMMON[0]
    here = eyes.look(beside(point), columns, 44, field)
    right = eyes.look(beside(point, dx=0.1), columns, 44, field)
    above = eyes.look(beside(point, dy=0.1), columns, 44, field)
    # the mark goes to the right: the picture goes to the left
    np.testing.assert_allclose(right.left[:, :-cells], here.left[:, cells:], atol=1e-6)
    np.testing.assert_allclose(right.right[:, :-cells], here.right[:, cells:], atol=1e-6)
    # rows count downwards: the picture goes down
    np.testing.assert_allclose(above.left[cells:], here.left[:-cells], atol=1e-6)
    # px moves the right mark alone, against x
    parallax = eyes.look(beside(point, px=0.1), columns, 44, field)
    np.testing.assert_array_equal(parallax.left, here.left)
    np.testing.assert_allclose(parallax.right[:, cells:], here.right[:, :-cells], atol=1e-6)


def test_what_the_marks_lack_is_told_with_its_sign():
    pair = ground().look(beside("101-1", dx=0.02, dy=-0.03, px=0.1, py=-0.05), 50, 44, 1.0)
    assert pair.nearest == "101-1"
    assert (pair.x, pair.y) == pytest.approx((-0.02, 0.03))
    assert (pair.px, pair.py) == pytest.approx((-0.1, 0.05))
    left = next(mark for mark in pair.left_marks if mark.point == "101-1")
    right = next(mark for mark in pair.right_marks if mark.point == "101-1")
    assert (left.column, left.row) == pytest.approx((24.5 - 1.0, 21.5 - 1.5))
    assert (right.column, right.row) == pytest.approx((left.column + 5.0, left.row + 2.5))
    # the signal is where the mark says
    assert pair.left[round(left.row), round(left.column)] > 0.9
    assert pair.right[round(right.row), round(right.column)] > 0.9


def test_the_names_of_the_photographs_alone_decide_what_the_ground_looks_like():
    at = beside(COMMON[0])
    first = ground().look(at, 40, 40, 1.0)
    again = ground().look(at, 40, 40, 1.0)
    np.testing.assert_array_equal(first.left, again.left)
    np.testing.assert_array_equal(first.right, again.right)
    other = ground("201", "202").look(at, 40, 40, 1.0)
    assert abs(np.corrcoef(first.left.ravel(), other.left.ravel())[0, 1]) < 0.5
    few = StereoGround("101", "102", {"7": (50.0, 50.0)}, {"7": (-40.0, 50.0)})
    far = Position(0.0, 0.0, 0.0, 0.0)
    np.testing.assert_array_equal(
        few.look(far, 40, 40, 1.0).left, ground().look(far, 40, 40, 1.0).left
    )


def test_a_wider_field_shows_the_same_ground():
    likeness = []
    for point in COMMON:
        narrow = ground().look(beside(point, dx=0.2), 48, 48, 1.0)
        wide = ground().look(beside(point, dx=0.2), 48, 48, 2.0)
        coarser = narrow.left.reshape(24, 2, 24, 2).mean(axis=(1, 3))
        likeness.append(np.corrcoef(wide.left[12:36, 12:36].ravel(), coarser.ravel())[0, 1])
    # some of the waves are the same, others are too short for the wider field
    assert np.mean(likeness) > 0.3


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_common_points_are_enough(count):
    names = COMMON[:count]
    eyes = StereoGround(
        "101", "102", {n: LEFT[n] for n in names}, {n: RIGHT[n] for n in names} | {"lone": (0, 0)}
    )
    at = beside(COMMON[0], dx=0.1)
    pair = eyes.look(at, 50, 44, 1.0)
    assert pair.nearest == (names[0] if names else None)
    assert np.isfinite(pair.left).all()
    assert np.isfinite(pair.right).all()
    if names:
        assert alike(pair) > 0.9
    else:
        assert (pair.x, pair.y, pair.px, pair.py) == (0.0, 0.0, 0.0, 0.0)


coordinate = st.floats(-150.0, 150.0)
place = st.tuples(coordinate, coordinate)


@given(st.lists(st.tuples(place, place), max_size=80), place, place, st.floats(0.01, 100.0))
def test_whatever_the_points_the_map_is_exact_at_them_and_the_picture_is_one(pairs, here, there, f):
    # points that coincide in one photograph cannot all be right: those are left out
    pairs = list({(round(r[0], 2), round(r[1], 2)): (p, r) for p, r in pairs}.values())
    left = {str(i): p for i, (p, _) in enumerate(pairs)}
    right = {str(i): r for i, (_, r) in enumerate(pairs)}
    eyes = StereoGround("a", "b", left, right)
    for name, (x, y) in right.items():
        near = [n for n, r in right.items() if n != name and np.hypot(r[0] - x, r[1] - y) < 0.01]
        if not near:
            found = eyes.in_left(np.array([[x, y]]))[0]
            np.testing.assert_allclose(found, left[name], atol=1e-3)
    pair = eyes.look(Position(*here, *there), 14, 12, f)
    for patch in (pair.left, pair.right):
        assert patch.shape == (12, 14)
        assert (patch >= 0.0).all()
        assert (patch <= 1.0 + 1e-9).all()
    assert (pair.nearest is None) == (not pairs)


@pytest.mark.parametrize(
    ("columns", "rows", "field"), [(0, 5, 1.0), (5, 0, 1.0), (5000, 5, 1.0), (5, 5, 0.0)]
)
def test_patches_have_bounds(columns, rows, field):
    with pytest.raises(ValueError, match=r"a patch has|a field is"):
        ground().look(beside(COMMON[0]), columns, rows, field)
    with pytest.raises(ValueError, match="a field is"):
        ground().look(beside(COMMON[0]), 5, 5, float("nan"))


def test_a_hand_called_off_does_not_touch_the_mark_any_more():
    plotter = SimulatedPlotter(load_profile("simulated"), TRUTH, noise_um=0.0)
    plotter.lay("101", "102")
    near = beside("101-1", dx=0.05)
    plotter.hand_to(near)
    plotter.set_hand(Hand(follow=False))
    plotter.advance(10.0)
    assert plotter.positions() == near
    plotter.set_hand(Hand())
    plotter.hand_to(near)
    plotter.advance(10.0)
    assert plotter.positions() == beside("101-1")
    assert plotter.points_of("102", "right") == RIGHT
    with pytest.raises(InputError, match="no photograph 999"):
        plotter.points_of("999")


# -- at a station ------------------------------------------------------------------------------


def reads(station, wanted: ReadOut) -> None:
    """Wait until the read-out is this one, to the last digit that the line carries."""
    deadline = time.monotonic() + WAIT
    pause = threading.Event()
    while True:
        read = station.readout()
        if (
            read is not None
            and max(
                abs(read.xl - wanted.xl),
                abs(read.yl - wanted.yl),
                abs(read.xr - wanted.xr),
                abs(read.yr - wanted.yr),
            )
            < 1e-7
        ):
            return
        assert time.monotonic() < deadline, (read, wanted)
        pause.wait(0.01)


def test_turning_the_handwheels_changes_the_readout_by_exactly_that(bench):
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    start = station.readout()
    assert start is not None
    watch.controls.turn(dx=0.1, dy=-0.25)
    reads(station, ReadOut(start.xl + 0.1, start.yl - 0.25, start.xr + 0.1, start.yr - 0.25))
    watch.controls.turn(dpx=0.037, dpy=-0.002)
    after = ReadOut(start.xl + 0.1, start.yl - 0.25, start.xr + 0.063, start.yr - 0.248)
    reads(station, after)
    now = station.readout()
    assert now is not None
    assert now.px - start.px == pytest.approx(0.037, abs=1e-7)
    assert now.py - start.py == pytest.approx(-0.002, abs=1e-7)


def test_the_eyepieces_follow_the_wheels(bench):
    station, watch = bench.open()
    assert watch.controls.stereo(50, 44, 1.0) is None  # nothing is laid
    station.next_model()
    settled(watch)
    pair = watch.controls.stereo(50, 44, 1.0)
    assert pair is not None
    assert pair is watch.controls.stereo(50, 44, 1.0)
    assert pair.nearest is not None
    # what the hand leaves is its noise
    assert max(abs(pair.px), abs(pair.py)) < 0.03
    watch.controls.turn(pair.x, pair.y, pair.px + 0.2, pair.py)
    turned = watch.controls.stereo(50, 44, 1.0)
    assert turned is not None
    assert (turned.x, turned.y, turned.px, turned.py) == pytest.approx((0, 0, -0.2, 0), abs=1e-9)
    watch.controls.turn(dpx=-0.2)
    cleared = watch.controls.stereo(50, 44, 1.0)
    assert cleared is not None
    assert alike(cleared) > 0.9 > alike(turned)


def test_without_the_hand_the_mark_stays_where_the_plates_were_driven(bench):
    station, watch = bench.open()
    assert watch.controls.hand
    watch.controls.set_hand(False)
    assert not watch.controls.hand
    watch.heard("the mark is yours")
    station.next_model()
    watch.until(lambda _: station.desk.drive_target is None)
    first = station.snapshot().target
    planned = bench.candidates
    model = station.state.current
    assert model is not None
    assert first is not None
    assert station.standing
    station.record()
    recorded = watch.until(lambda p: any(v.times for v in p.points))
    measured = station.state.current.used[0]
    assert measured.point == first
    assert (measured.xl, measured.yl) == pytest.approx(planned[model.left][first], abs=0.002)
    assert (measured.xr, measured.yr) == pytest.approx(planned[model.right][first], abs=0.002)
    # the hand is back from the next drive on
    watch.controls.set_hand(True)
    watch.until(lambda _: station.desk.drive_target is None)
    pending = next(v.point for v in recorded.points if not v.times)
    station.drive(pending)
    settled(watch)
    pair = watch.controls.stereo(50, 44, 1.0)
    assert pair is not None
    assert pair.nearest == pending
    assert max(abs(pair.x), abs(pair.y), abs(pair.px), abs(pair.py)) < 0.03


def test_whoever_turns_takes_over_from_the_hand(bench):
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    assert station.instrument is not None
    simulator = station.instrument.simulator
    station._desk = replace(
        station.desk, setting="the simulated operator"
    )  # as between the arrival and the mark
    watch.controls.turn(dx=0.5)
    assert station.standing
    before = simulator.positions()
    station.record()
    watch.until(lambda p: any(v.times for v in p.points))
    measured = station.state.current.used[0]
    assert measured.xl == pytest.approx(before.xl, abs=0.001)


def test_what_cannot_be_turned_is_refused(bench):
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    before = station.instrument.simulator.positions()
    with pytest.raises(InputError, match="end of their travel"):
        watch.controls.turn(dx=400.0)
    with pytest.raises(InputError, match="end of their travel"):
        watch.controls.turn(dpx=-400.0)
    assert station.instrument.simulator.positions() == before
    station._desk = replace(station.desk, drive_target=before)
    with pytest.raises(InputError, match="under way"):
        watch.controls.turn(dx=0.1)
    station._desk = replace(station.desk, drive_target=None)
    watch.controls._operator = object()
    for command in (lambda: watch.controls.turn(dx=0.1), lambda: watch.controls.set_hand(False)):
        with pytest.raises(InputError, match="stop him first"):
            command()
    watch.controls._operator = None
    station.close()
    with pytest.raises(InputError, match="closed"):
        watch.controls.turn(dx=0.1)


def test_without_a_simulated_plotter_there_is_nothing_to_see_or_turn(bench):
    _, watch = bench.open(plotter=False)
    assert watch.controls is None


def test_the_simulated_operator_uses_his_hand_whatever_the_switch_says(bench):
    station, watch = bench.open()
    watch.controls.set_hand(False)
    station.instrument.set_pedal(True)
    assert station.instrument.simulator.hand.follow
    station.instrument.set_pedal(False)
    assert not station.instrument.simulator.hand.follow
    assert not watch.controls.hand
