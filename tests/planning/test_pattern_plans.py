"""Planned patterns: as the named ones, no point harms another, the advice is the best tried."""

from dataclasses import replace

import numpy as np
import pytest
from idealmodel import ideal

from anaplot.orientation.patterns import PATTERNS, pattern
from anaplot.planning.patternplan import advise_point_sets, advise_points, from_pattern, grid, solve

GEOMETRY = (90.0, 100.0, 152.0)


@pytest.mark.parametrize("name", sorted(PATTERNS))
def test_a_planned_pattern_has_the_numbers_of_the_named_one(name):
    planned = {r.key: r.r for r in solve(from_pattern(pattern(name), *GEOMETRY)).table}
    named = {row.key: row.r for row in ideal(pattern(name), *GEOMETRY).table}
    assert planned == pytest.approx(named)


@pytest.mark.parametrize("name", ["6", "6/3", "9/3", "13/5"])
def test_no_further_point_lowers_a_redundancy_number_and_the_advice_is_true(name):
    plan = from_pattern(pattern(name), *GEOMETRY)
    places = grid((0.0, 90.0), (-100.0, 100.0), 3)
    old = {r.key: r.r for r in solve(plan).table}
    tried = {}
    reach = max((x for label, x, _ in plan.points if label in plan.ties), default=-1.0)
    for x, y in {*places, *((x, y) for _, x, y in plan.points)}:
        for tie in (False, True)[: 1 + (x <= reach)]:
            ties = (*plan.ties, "z") if tie else plan.ties
            wider = solve(replace(plan, points=(*plan.points, ("z", x, y)), ties=ties))
            new = {r.key: r.r for r in wider.table}
            assert all(new[key] >= old[key] - 1e-9 for key in old)
            tried[x, y, tie] = min(new[key] for key in old)
    advice = advise_points(plan, places)
    best = advice[0]
    assert best.before == pytest.approx(min(old.values()))
    assert best.after == pytest.approx(max(tried.values()))
    assert {(a.x, a.y, a.tie) for a in advice} == set(tried)
    for one in advice:
        assert one.after == pytest.approx(tried[one.x, one.y, one.tie])


def test_no_redundancy_number_is_below_nothing():
    """Five points have none, and rounding is no number: the page said -0.000."""
    places = ((0.0, 90.0), (0.0, -90.0), (90.0, 90.0), (90.0, -90.0), (45.0, 0.0))
    plan = replace(
        from_pattern(pattern("6"), *GEOMETRY),
        points=tuple((str(k), x, y) for k, (x, y) in enumerate(places)),
    )
    wide = grid((0.0, 90.0), (-90.0, 90.0), 3)
    for advice in (advise_points(plan, wide)[0], advise_point_sets(plan, wide)[0]):
        assert advice.before == pytest.approx(0.0, abs=1e-12)
        assert not np.signbit(advice.before)


@pytest.mark.parametrize(("name", "tie", "no_tie"), [("9/3", 0.287, 0.273), ("13/5", 0.594, 0.590)])
def test_a_double_of_the_middle_tie_helps_most_as_a_tie(name, tie, no_tie):
    advice = advise_points(
        from_pattern(pattern(name), *GEOMETRY), grid((0.0, 90.0), (-100.0, 100.0))
    )
    assert (advice[0].doubles, advice[0].tie) == ("2", True)
    assert advice[0].after == pytest.approx(tie, abs=5e-4)
    best = next(a for a in advice if not a.tie)
    assert best.after == pytest.approx(no_tie, abs=5e-4)
    if name == "9/3":
        one = next(a for a in advice if (a.x, a.y, a.tie) == (0.0, 50.0, True))
        assert one.after == pytest.approx(0.278, abs=5e-4)


def test_a_first_model_gets_no_tie():
    advice = advise_points(
        from_pattern(pattern("9"), *GEOMETRY), grid((0.0, 90.0), (-100.0, 100.0))
    )
    assert not any(a.tie for a in advice)


@pytest.mark.parametrize(
    ("name", "one", "four"), [("6", 0.100, 0.400), ("9", 0.2685, 0.5667), ("13/5", 0.594, 0.692)]
)
def test_sets_help_where_single_points_do_not(name, one, four):
    """The paper's ten points are six with all corners doubled; in steps they reach .150."""
    plan = from_pattern(pattern(name), *GEOMETRY)
    places = grid((0.0, 90.0), (-100.0, 100.0))
    choice = "exact" if plan.ties else "paper"
    assert advise_points(plan, places, choice)[0].after == pytest.approx(one, abs=5e-4)
    two, best = advise_point_sets(plan, places, choice)
    assert best.after == pytest.approx(four, abs=5e-4)
    assert two.symmetric
    assert best.symmetric
    if name == "6":
        assert {place[2] for place in best.places} == {"1", "3", "4", "6"}
    for found in (two, best):
        names = [f"new{k}" for k in range(len(found.places))]
        wider = replace(
            plan,
            points=(*plan.points, *((n, x, y) for n, (x, y, _, _) in
                                    zip(names, found.places, strict=True))),
            ties=(*plan.ties, *(n for n, place in zip(names, found.places, strict=True)
                                if place[3])),
        )  # fmt: skip
        rows = {row.key: row.r for row in solve(wider, choice).table}
        there = [row.key for row in solve(plan, choice).table]
        assert found.after == pytest.approx(min(rows[key] for key in there), abs=1e-9)
    assert two.after > advise_points(plan, places, choice)[0].after


def test_by_four_steps_six_points_do_not_come_far():
    plan = from_pattern(pattern("6"), *GEOMETRY)
    for step in range(4):
        best = advise_points(plan, ())[0]
        plan = replace(plan, points=(*plan.points, (f"z{step}", best.x, best.y)))
    old = {(label, "y") for label in "123456"}
    weakest = min(row.r for row in solve(plan).table if row.key in old)
    assert weakest == pytest.approx(0.150, abs=5e-3)
