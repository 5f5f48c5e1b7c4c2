"""Planned patterns: as the named ones, no point harms another, the advice is the best tried."""

from dataclasses import replace

import pytest

from anaplot.orientation.patterns import PATTERNS, pattern
from anaplot.planning.patternplan import advise, from_pattern, grid, solve

GEOMETRY = (90.0, 100.0, 152.0)


@pytest.mark.parametrize("name", sorted(PATTERNS))
def test_a_planned_pattern_has_the_numbers_of_the_named_one(name):
    planned = {r.key: r.redn for r in solve(from_pattern(pattern(name), *GEOMETRY)).table}
    assert planned == pytest.approx(pattern(name).ideal_redundancy(*GEOMETRY))


@pytest.mark.parametrize("name", ["6", "6/3", "9/3", "13/5"])
def test_no_further_point_lowers_a_redundancy_number_and_the_advice_is_true(name):
    plan = from_pattern(pattern(name), *GEOMETRY)
    places = grid(90.0, 100.0, 3)
    old = {r.key: r.redn for r in solve(plan).table}
    weakest = []
    for x, y in {*places, *((x, y) for _, x, y in plan.points)}:
        wider = solve(replace(plan, points=(*plan.points, ("z", x, y))))
        new = {r.key: r.redn for r in wider.table}
        assert all(new[key] >= old[key] - 1e-9 for key in old)
        weakest.append(min(new[key] for key in old))
    best = advise(plan, places)[0]
    assert best.before == pytest.approx(min(old.values()))
    assert best.after == pytest.approx(max(weakest))
