"""The rules of thumb of 1978 and 1980."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.rulesofthumb import LEAST_RI, RulesOfThumb, rules_of_thumb
from anaplot.planning.networkplan import CUBE_VERSIONS, cube, plan_network
from anaplot.report.astext import page_text
from anaplot.report.rules import rules_json, rules_lines


def evaluated(version: str) -> AdjustedBlock:
    return plan_network(cube(version)).evaluated()


@pytest.mark.parametrize("version", CUBE_VERSIONS)
def test_the_cube_as_1978_recommends_it(version: str) -> None:
    block = evaluated(version)
    rules = rules_of_thumb(block)
    # "definitely the arrangement E"; D is as reliable
    assert rules.reliable == (version in "DE")
    indicators = block.indicators()
    assert rules[:2] == (indicators.ri_x >= LEAST_RI, indicators.ri_y >= LEAST_RI)
    assert rules.covered == (version in "DE")
    assert (rules.new, rules.in_fewer) == (19, 0 if version in "DE" else 19)


def test_of_c_only_the_y_coordinates_are_reliable() -> None:
    assert rules_of_thumb(evaluated("C"))[:2] == (False, True)


def test_a_ray_measured_twice_is_one_photo_and_a_rejected_one_none() -> None:
    made = plan_network(cube("D"))
    rows = made.block.image_points
    new = next(row for row in rows if row.point == "2" and row.photo == "1")
    without = tuple(row for row in rows if row != new)
    twice = next(row for row in without if row.point == "2")
    again = (replace(twice, model="1/2"), replace(twice, model="2/5"))
    measured = tuple(row for row in without if row != twice)
    block = replace(made.block, image_points=(*measured, *again))
    rules = rules_of_thumb(replace(made, block=block).evaluated())
    assert (rules.new, rules.in_fewer) == (19, 1)
    full = made.evaluated()
    rejected = np.zeros(full.v.shape, dtype=bool)
    at = [p == full.problem.points.index("2") for p in full.problem.point.tolist()]
    rejected[at.index(True)] = True
    with_rejected = replace(full, problem=replace(full.problem, rejected=rejected))
    assert rules_of_thumb(with_rejected).in_fewer == 1


def test_a_check_point_is_new() -> None:
    made = plan_network(cube("A"))
    rows = (*made.block.control[1:], replace(made.block.control[0], use="check"))
    block = replace(made, block=replace(made.block, control=rows)).evaluated()
    assert rules_of_thumb(block).new == rules_of_thumb(made.evaluated()).new + 1


@pytest.mark.parametrize(
    ("rules", "said"),
    [
        (
            RulesOfThumb(True, True, 5, 0),
            [
                "rule of 1978, RI of x and of y at least 0.6: met",
                "rule of 1980, new points in 4 photos or more: met",
            ],
        ),
        (
            RulesOfThumb(False, True, 5, 2),
            [
                "rule of 1978, RI of x and of y at least 0.6: not met by x",
                "rule of 1980, new points in 4 photos or more: not met, 2 of 5 in fewer",
            ],
        ),
        (
            RulesOfThumb(False, False, 0, 0),
            ["rule of 1978, RI of x and of y at least 0.6: not met by x and y"],
        ),
    ],
)
def test_the_verdicts_in_words_and_for_programs(rules: RulesOfThumb, said: list[str]) -> None:
    assert page_text(rules_lines(rules)).splitlines() == said
    answer = rules_json(rules)
    assert answer["reliability"]["met"] is rules.reliable
    assert answer["cover"]["met"] is (None if not rules.new else rules.in_fewer == 0)
