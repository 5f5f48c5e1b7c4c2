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
    places = grid((0.0, 90.0), (-100.0, 100.0), 3)
    old = {r.key: r.redn for r in solve(plan).table}
    tried = {}
    reach = max((x for label, x, _ in plan.points if label in plan.ties), default=-1.0)
    for x, y in {*places, *((x, y) for _, x, y in plan.points)}:
        for tie in (False, True)[: 1 + (x <= reach)]:
            ties = (*plan.ties, "z") if tie else plan.ties
            wider = solve(replace(plan, points=(*plan.points, ("z", x, y)), ties=ties))
            new = {r.key: r.redn for r in wider.table}
            assert all(new[key] >= old[key] - 1e-9 for key in old)
            tried[x, y, tie] = min(new[key] for key in old)
    advice = advise(plan, places)
    best = advice[0]
    assert best.before == pytest.approx(min(old.values()))
    assert best.after == pytest.approx(max(tried.values()))
    assert {(a.x, a.y, a.tie) for a in advice} == set(tried)
    for one in advice:
        assert one.after == pytest.approx(tried[one.x, one.y, one.tie])


@pytest.mark.parametrize(("name", "tie", "no_tie"), [("9/3", 0.287, 0.273), ("13/5", 0.594, 0.590)])
def test_a_double_of_the_middle_tie_helps_most_as_a_tie(name, tie, no_tie):
    advice = advise(from_pattern(pattern(name), *GEOMETRY), grid((0.0, 90.0), (-100.0, 100.0)))
    assert (advice[0].doubles, advice[0].tie) == ("2", True)
    assert advice[0].after == pytest.approx(tie, abs=5e-4)
    best = next(a for a in advice if not a.tie)
    assert best.after == pytest.approx(no_tie, abs=5e-4)
    if name == "9/3":
        one = next(a for a in advice if (a.x, a.y, a.tie) == (0.0, 50.0, True))
        assert one.after == pytest.approx(0.278, abs=5e-4)


def test_a_first_model_gets_no_tie():
    advice = advise(from_pattern(pattern("9"), *GEOMETRY), grid((0.0, 90.0), (-100.0, 100.0)))
    assert not any(a.tie for a in advice)
