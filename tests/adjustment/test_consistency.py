"""Significance of the global and of the single test (Gruen 1978)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import chdtrc, chdtri, chndtrinc, chndtrix

from anaplot.adjustment.consistency import global_from_single, single_test
from anaplot.adjustment.significance import critical_normal, noncentrality


def test_the_noncentrality_of_the_paper() -> None:
    single = single_test(0.001, 0.80)
    assert single.noncentrality == pytest.approx(17.07, abs=0.01)
    assert single.critical == pytest.approx(critical_normal(0.001))
    assert single.noncentrality == pytest.approx(noncentrality(0.001, 0.80) ** 2, rel=1e-6)


@pytest.mark.parametrize(
    ("redundancy", "alpha", "critical"),
    [(39, 0.213, 1.172), (87, 0.369, 1.044), (135, 0.450, 1.011)],
)
def test_global_significance_of_the_cases_of_1978(
    redundancy: int, alpha: float, critical: float
) -> None:
    test = global_from_single(0.001, 0.80, redundancy)
    assert test.alpha == pytest.approx(alpha, abs=5e-4)
    assert test.critical == pytest.approx(critical, abs=5e-4)


@pytest.mark.slow
@given(st.floats(1e-4, 0.05), st.floats(0.5, 0.95), st.integers(1, 3000))
def test_there_and_back(alpha: float, power: float, redundancy: int) -> None:
    wide = global_from_single(alpha, power, redundancy)
    # the other way: from the global test's limit to the noncentrality, and to one observation
    size = float(chndtrinc(float(chdtri(redundancy, wide.alpha)), redundancy, 1.0 - power))
    assert size == pytest.approx(wide.noncentrality, rel=1e-5)
    square = float(chndtrix(1.0 - power, 1.0, size))
    assert float(chdtrc(1.0, square)) == pytest.approx(alpha, rel=1e-4)


def test_both_tests_find_the_same_error_as_often() -> None:
    test = global_from_single(0.001, 0.80, 20)
    rng = np.random.default_rng(1)
    v = rng.normal(size=(20000, 20))
    assert np.mean((v**2).mean(axis=1) > test.critical) == pytest.approx(test.alpha, abs=0.01)
    v[:, 0] += test.noncentrality**0.5
    assert np.mean((v**2).mean(axis=1) > test.critical) == pytest.approx(0.80, abs=0.01)
    single = single_test(0.001, 0.80)
    assert np.mean(np.abs(v[:, 0]) > single.critical) == pytest.approx(0.80, abs=0.01)


@pytest.mark.parametrize(
    ("alpha", "power", "redundancy"),
    [(0.0, 0.8, 5), (0.9, 0.8, 5), (0.001, 1.0, 5), (0.001, 0.8, 0), (float("nan"), 0.8, 5)],
)
def test_impossible_questions(alpha: float, power: float, redundancy: int) -> None:
    with pytest.raises(ValueError, match=r"significance|redundancy"):
        global_from_single(alpha, power, redundancy)
