"""Offsets of counters from pointings: two have to agree, in every carriage that matters."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.plotter.readings import Position
from anaplot.session.referencing import KnownPlace, Referencing, asked_for, in_words
from anaplot.session.tolerances import tolerance_of_offsets_mm

ZERO = Position(0.0, 0.0, 0.0, 0.0)
TOLERANCE = 0.05
BOTH = ("left", "right")
POINT = KnownPlace("7", "point 7", {"left": (10.0, 20.0), "right": (-80.0, 21.0)})
MARK = KnownPlace("1", "fiducial 1 of photo 101 (left)", {"left": (-106.0, 106.0)})

offsets = st.floats(-200.0, 200.0)
errors = st.floats(-0.02, 0.02)


def counted(reference: KnownPlace, x: float, y: float, e: float = 0.0) -> Position:
    """What counters say that are off by (x, y), with an error of pointing."""
    left = reference.places.get("left", (0.0, 0.0))
    right = reference.places.get("right", (0.0, 0.0))
    return Position(left[0] - x + e, left[1] - y - e, right[0] - x + e, right[1] - y - e)


@given(offsets, offsets, errors, errors)
def test_two_pointings_give_the_offset(x: float, y: float, e: float, f: float) -> None:
    once = Referencing().pointed(POINT, counted(POINT, x, y, e), TOLERANCE)
    assert once.open_sides(BOTH) == BOTH
    assert once.agreed == {}
    twice = once.pointed(POINT, counted(POINT, x, y, f), TOLERANCE)
    assert twice.open_sides(BOTH) == ()
    shift = twice.shift(ZERO, TOLERANCE, mono=False)
    if shift is None:
        assert max(abs(x), abs(y)) <= TOLERANCE / 2.0 + 0.02 + 1e-9
    else:
        assert shift.xl == pytest.approx(x - (e + f) / 2.0, abs=1e-9)
        assert shift.yr == pytest.approx(y + (e + f) / 2.0, abs=1e-9)


@given(offsets, offsets, st.floats(0.051, 5.0))
def test_two_that_disagree_are_refused(x: float, y: float, gap: float) -> None:
    once = Referencing().pointed(POINT, counted(POINT, x, y), TOLERANCE)
    with pytest.raises(InputError, match=r"point 7 \(left\) is .* mm from where the first"):
        once.pointed(POINT, counted(POINT, x, y, gap), TOLERANCE)


def test_a_fiducial_speaks_for_its_carriage_alone() -> None:
    state = Referencing()
    for _ in range(2):
        state = state.pointed(MARK, counted(MARK, 3.0, 4.0), TOLERANCE)
    assert state.open_sides(BOTH) == ("right",)
    assert state.proposed(BOTH, (MARK, POINT)) == POINT
    assert state.proposed(("left",), (MARK, POINT)) is None
    was = Position(9.0, 9.0, 1.0, 2.0)
    # nothing is known of the right one: it counts as before
    assert state.shift(was, TOLERANCE, mono=False) == Position(3.0, 4.0, 1.0, 2.0)
    assert state.shift(was, TOLERANCE, mono=True) == Position(3.0, 4.0, 3.0, 4.0)


def test_counters_that_agree_with_what_they_were_moved_by_are_left_alone() -> None:
    state = Referencing()
    for error in (0.01, -0.01):
        state = state.pointed(POINT, counted(POINT, 3.0, 4.0, error), TOLERANCE)
    assert state.shift(Position(3.02, 4.0, 3.0, 4.02), TOLERANCE, mono=False) is None
    assert state.shift(Position(3.03, 4.0, 3.0, 4.0), TOLERANCE, mono=False) is not None


def test_the_second_pointing_is_to_be_elsewhere() -> None:
    other = KnownPlace("8", "point 8", {"left": (5.0, 5.0), "right": (6.0, 6.0)})
    once = Referencing().pointed(POINT, counted(POINT, 3.0, 4.0), TOLERANCE)
    assert once.proposed(BOTH, (POINT, other)) == other
    assert asked_for(once, other, BOTH).endswith("set the mark on point 8, too, and press R")
    # there again where nothing else can say the same, or where it is chosen
    assert once.proposed(BOTH, (POINT,)) == POINT
    assert asked_for(once, POINT, BOTH).endswith(f"{POINT.title} again and press R")
    assert replace(once, chosen=POINT.name).proposed(BOTH, (POINT, other)) == POINT
    # a fiducial of the other carriage says nothing of this one
    marked = Referencing().pointed(MARK, counted(MARK, 3.0, 4.0), TOLERANCE)
    right = KnownPlace("2", "fiducial 2", {"right": (6.0, 6.0)}, "right")
    assert marked.proposed(BOTH, (right, MARK)) == MARK


def test_what_contradicts_is_left_to_others() -> None:
    known = tuple(
        KnownPlace(name, f"point {name}", {"left": (k, 5.0), "right": (k, 6.0)})
        for k, name in enumerate("789")
    )
    once = Referencing().pointed(known[0], counted(known[0], 3.0, 4.0), TOLERANCE)
    second = once.proposed(BOTH, known)
    assert second == known[1]
    with pytest.raises(InputError, match="from where the first pointing"):
        once.pointed(second, counted(second, 3.0, 4.3), TOLERANCE)
    # a third one tells which of the two it is
    anew = once.forgotten(second)
    assert (anew.once, anew.agreed) == ({}, {})
    assert anew.proposed(BOTH, known) == known[2]
    third = anew.pointed(known[2], counted(known[2], 3.0, 4.0), TOLERANCE)
    assert third.proposed(BOTH, known) == known[0]
    done = third.pointed(known[0], counted(known[0], 3.0, 4.0), TOLERANCE)
    assert done.open_sides(BOTH) == ()


def test_what_is_chosen_goes_before_what_is_proposed() -> None:
    assert Referencing().proposed(BOTH, (POINT, MARK)) == POINT
    assert Referencing(chosen="1").proposed(BOTH, (POINT, MARK)) == MARK
    assert Referencing(chosen="nowhere").proposed(BOTH, (POINT, MARK)) == POINT
    assert Referencing().proposed(BOTH, ()) is None


def test_words_and_tolerance() -> None:
    shift = Position(1.0, -2.0, 3.5, 0.0)
    assert in_words(shift, mono=False) == "x' +1.000, y' -2.000, x'' +3.500, y'' +0.000 mm"
    assert in_words(shift, mono=True) == "x +1.000, y -2.000 mm"
    assert tolerance_of_offsets_mm(5.0) == pytest.approx(0.05)
