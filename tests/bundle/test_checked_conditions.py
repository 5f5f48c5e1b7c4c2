"""Conditions that check a block, and those that are free of error, as tests count them."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from conditionblocks import condition, every_kind, flat_scene

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors import bychance
from anaplot.bundle.hypotheses.conditiontests import condition_tests
from anaplot.bundle.solve.checkedrows import checked_rows
from anaplot.bundle.solve.comparedconditions import compared_conditions


def test_checks_whose_rows_depend_on_each_other_are_tested_together() -> None:
    """As v'Pv grows and redundancy with it where they are observed: rows less parameters."""
    scene = flat_scene()
    checks = (
        condition(scene, "distance", "p2 p7", 0.02, off=0.05, use="check"),
        condition(scene, "plane", "p1 p6 p10 p11 p15", 0.08, use="check"),
        condition(scene, "equal", "p1 p6 p10 p15", 0.05, use="check"),
        condition(scene, "angle", "p2 p6 p9", 1e-4, use="check"),
    )
    alone = adjust_block(replace(scene.block, conditions=checks))
    found = condition_tests(alone)
    assert found is not None
    assert len(found.single) == 1 + 5 + 2 + 1
    observed = tuple(replace(one, use="control") for one in checks)
    taken = adjust_block(replace(scene.block, conditions=observed))
    together = found.everything.known
    assert together.dimension == taken.redundancy - alone.redundancy == 1 + 2 + 1 + 1
    assert together.square == pytest.approx(taken.vtpv - alone.vtpv, rel=5e-3)


@pytest.mark.parametrize("datum", ["free", "minimal"])
def test_an_angle_is_a_check_in_a_datum_without_scale_too(datum) -> None:
    scene = flat_scene()
    length = condition(scene, "distance", "p2 p7", 0.02, use="check")
    angle = condition(scene, "angle", "p2 p6 p9", 1e-4, off=2e-4, use="check")
    conditions = (length, replace(length, use="off"), angle)
    block = adjust_block(replace(scene.block, conditions=conditions), datum=datum)
    rows = compared_conditions(block)
    assert [row.s is None for row in rows] == [True, True, False]
    observed = replace(angle, use="control")
    taken = adjust_block(replace(scene.block, conditions=(observed,)), datum=datum)
    [expected] = taken.condition_rows()
    assert rows[-1].s == pytest.approx(1e-4 / sqrt(expected.r) * block.sigma, rel=5e-3)
    found = condition_tests(block)
    assert [one.axis for one in found.single] == ["angle"]
    assert found.everything.known.square == pytest.approx(taken.vtpv - block.vtpv, rel=5e-3)


def test_what_is_free_of_error_is_counted_among_what_can_be_tested() -> None:
    scene = flat_scene()
    conditions = every_kind(scene, firm=range(6))
    block = adjust_block(replace(scene.block, conditions=conditions))
    firm = block.observations.starts[3] + np.arange(len(block.condition_rows()))
    assert np.isfinite(block.tested.w[firm]).all()
    assert block.tested.r[firm] == pytest.approx(0.0, abs=1e-6)
    first = block.observations.starts[3]
    assert checked_rows(block.tested, block.problem.conditions, first)[firm].all()
    assert block.flagged_by_chance == pytest.approx(
        block.test.alpha * np.count_nonzero(np.isfinite(block.tested.w))
    )
    assert bychance.tested_count(block) == np.count_nonzero(np.isfinite(block.tested.w))
