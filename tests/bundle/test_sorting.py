"""Whole numbers are put in order as NumPy's slower ways do it."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.bundle.solve.sorting import distinct, each_pair, order_of


@pytest.mark.parametrize("below", [1, 7, 1 << 16, (1 << 16) + 1, 1 << 33])
def test_equal_numbers_keep_their_order(below: int) -> None:
    numbers = np.random.default_rng(1).integers(0, below, 2000)
    assert order_of(numbers, below).tolist() == np.argsort(numbers, kind="stable").tolist()


def test_every_number_is_found_once_and_ascending() -> None:
    numbers = np.random.default_rng(2).integers(-50, 50, 300)
    assert distinct(numbers).tolist() == sorted(set(numbers.tolist()))
    assert distinct(numbers[:0]).tolist() == []


def test_every_pair_is_found_once() -> None:
    first, second = np.random.default_rng(3).integers(0, 20, (2, 300))
    found = list(zip(*(each.tolist() for each in each_pair(first, second)), strict=True))
    assert found == sorted(set(zip(first.tolist(), second.tolist(), strict=True)))
