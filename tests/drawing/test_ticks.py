from __future__ import annotations

from math import floor, isclose, log10

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from anaplot.drawing.ticks import covering, round_down, ticks, written

numbers = st.floats(min_value=-1e7, max_value=1e7, allow_nan=False)


def is_round(step: float) -> bool:
    digit = step / 10.0 ** floor(log10(step) + 1e-9)
    return any(isclose(digit, one, rel_tol=1e-6) for one in (1.0, 2.0, 5.0))


@given(numbers, st.floats(min_value=1e-4, max_value=1e8), st.integers(min_value=3, max_value=12))
def test_ticks_are_round_and_within(low: float, size: float, most: int) -> None:
    high = low + size
    found = ticks(low, high, most)
    assert is_round(found.step)
    assert len(found.values) <= most
    room = 1e-6 * size
    assert all(low - room <= value <= high + room for value in found.values)
    assert all(abs(value / found.step - round(value / found.step)) < 1e-3 for value in found.values)
    # nothing is left out between the first and the last, and no tick fits beyond them
    if found.values:
        assert found.values[0] - found.step < low + room
        assert found.values[-1] + found.step > high - room


@given(numbers, st.floats(min_value=0.0, max_value=1e8), st.integers(min_value=3, max_value=12))
def test_covering_ticks_enclose(low: float, size: float, most: int) -> None:
    assume(size == 0.0 or size > 1e-4)
    found = covering(low, low + size, most)
    assert is_round(found.step)
    assert 2 <= len(found.values) <= most
    room = 1e-6 * max(size, found.step)
    assert found.values[0] <= low + room
    assert found.values[-1] >= low + size - room


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (0.0, 1.0, ("0.0", "0.2", "0.4", "0.6", "0.8", "1.0")),
        (-3.0, 3.0, ("−3", "−2", "−1", "0", "1", "2", "3")),
        (9000.0, 11000.0, ("9 000", "9 500", "10 000", "10 500", "11 000")),
    ],
)
def test_labels(low: float, high: float, labels: tuple[str, ...]) -> None:
    assert ticks(low, high).labels == labels


@pytest.mark.parametrize("ends", [(0.0, 0.0), (1.0, 0.0), (0.0, float("nan")), (0.0, float("inf"))])
def test_no_axis(ends: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="no axis"):
        ticks(*ends)


def test_numbers_too_large_for_their_axis() -> None:
    with pytest.raises(ValueError, match="too fine"):
        ticks(1e9, 1e9 + 1e-6)


@given(st.floats(min_value=1e-9, max_value=1e12))
def test_rounding_down(value: float) -> None:
    found = round_down(value)
    assert is_round(found)
    assert found <= value * (1 + 1e-8)
    assert value < 2.5 * found * (1 + 1e-8)


def test_no_minus_before_nought() -> None:
    assert written(-0.001, 2) == "0.00"
    assert written(-12345.6, 1) == "−12 345.6"


@given(st.floats(-1e8, 1e8), st.floats(1e-2, 1e3))
def test_what_long_numbers_are_more_than_a_round_one(low: float, size: float) -> None:
    found = ticks(low, low + size)
    assume(found.values)
    base, rest = found.less()
    assert base / (1000.0 * found.step) == pytest.approx(round(base / (1000.0 * found.step)))
    assert 0.0 <= rest.values[0] < 1000.0 * found.step * (1.0 + 1e-9)
    for value, more in zip(found.values, rest.values, strict=True):
        assert base + more == pytest.approx(value, rel=1e-12, abs=1e-9)
