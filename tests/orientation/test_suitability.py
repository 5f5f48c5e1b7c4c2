"""The verdict on patterns (Kratky and El-Hakim 1983)."""

import pytest

from anaplot.orientation.patterns import pattern
from anaplot.orientation.suitability import pattern_verdict


@pytest.mark.parametrize("name", ["6", "6/3", "9", "9/3", "10", "10/5"])
def test_patterns_with_critical_transfers_are_not_suitable(name):
    verdict = pattern_verdict(pattern(name))
    assert verdict.startswith(f"pattern {name} is not suitable for on-line triangulation: an error")


def test_an_error_at_a_corner_of_six_points_shows_twice_as_large_at_its_centre():
    # of the equal transfers the first is named: rounding does not say which
    assert "1 (y) shows 2.0 times as large in 2 (y)" in pattern_verdict(pattern("6"))


@pytest.mark.parametrize("name", ["10d/5", "13", "13/5", "15", "15/5"])
def test_those_the_paper_recommends_are_suitable(name):
    assert pattern_verdict(pattern(name)) == ""
