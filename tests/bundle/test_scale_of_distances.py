"""Distances as the only scale of a free network, beside a dense adjustment of their own."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from conditionblocks import condition, dense_conditions, every_kind, flat_scene, with_conditions
from denseblock import dense
from scipy.linalg import null_space
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.hypotheses.controltests import control_tests
from anaplot.bundle.hypotheses.coordinatefunctions import CoordinateFunction, evaluate_functions
from anaplot.bundle.live import LiveBlock
from anaplot.bundle.solve.comparedconditions import compared_conditions
from anaplot.bundle.solve.externalreliability import external_reliability
from anaplot.bundle.solve.problem import make_problem
from anaplot.errors import InputError, NotComputableError

BARS = ("p2 p7", "p9 p14", "p5 p12")


def bars(scene, sigmas, off=()):
    """Scale bars of some standard deviations, with errors."""
    off = (*off, 0.0, 0.0, 0.0)
    return tuple(
        condition(scene, "distance", points, sigma, off=error)
        for points, sigma, error in zip(BARS, sigmas, off, strict=False)
    )


CASES = {
    "one": lambda scene: bars(scene, [0.02]),
    "one free of error": lambda scene: bars(scene, [0.0]),
    "three": lambda scene: bars(scene, [0.02, 0.03, 0.05]),
    "one free of error and two": lambda scene: bars(scene, [0.05, 0.0, 0.03]),
    "two free of error": lambda scene: bars(scene, [0.0, 0.0]),
    "with all kinds": every_kind,
    "with all kinds, some free of error": lambda scene: every_kind(scene, firm=(0, 1, 4)),
}


def dense_free(block):
    """Own design, cofactors with inner constraints but for the scale, and redundancy numbers."""
    problem, at = block.problem, block.state.points
    images, _ = dense(block)
    rows, shared, sigma, firm = dense_conditions(block)
    u, k = images.shape[1], shared.shape[1]
    both = np.hstack((rows, shared))
    white = np.vstack((
        np.hstack((images, np.zeros((len(images), k)))), both[~firm] / sigma[~firm, None]
    ))  # fmt: skip
    inner = np.zeros((6, u + k))
    first = problem.per_photo * len(problem.photos)
    for point, place in enumerate(at):
        x, y, z = place - at.mean(axis=0)
        start = first + 3 * point
        inner[:3, start : start + 3] = np.eye(3)
        inner[3:, start : start + 3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    scale = np.linalg.norm(np.vstack((white, both[firm])), axis=0)
    held = np.vstack((inner, both[firm])) / scale
    held /= np.linalg.norm(held, axis=1, keepdims=True)
    allowed = null_space(held)
    seen = (white / scale) @ allowed
    q = allowed @ np.linalg.pinv(seen.T @ seen, rcond=1e-15) @ allowed.T / scale[:, None] / scale
    r = 1.0 - np.diag(seen @ np.linalg.pinv(seen))
    return white, q, r, firm


@pytest.mark.parametrize("name", CASES)
def test_everything_equals_an_own_dense_adjustment(name) -> None:
    scene = flat_scene()
    block = with_conditions(scene, CASES[name](scene), datum="free")
    problem, found = block.problem, block.cofactors
    white, q, r, firm = dense_free(block)
    n, p, m = len(problem.photos), len(problem.points), len(problem.photo)
    assert problem.defect == 6
    assert block.redundancy == problem.observations - problem.unknowns + 6
    assert block.tested.r.sum() == pytest.approx(block.redundancy, abs=1e-6)
    assert r.sum() - (len(r) - 2 * m - int((~firm).sum())) == pytest.approx(
        block.redundancy, abs=1e-6
    )
    # rows of lines turn with the network's residuals, which a datum feels in the second order
    tolerance = 1e-5 if name == "with all kinds" else 1e-7
    np.testing.assert_allclose(found.r.ravel(), r[: 2 * m], atol=tolerance)
    np.testing.assert_allclose(
        found.r_conditions[~firm], r[len(r) - int((~firm).sum()) :], atol=tolerance
    )
    for k in range(p):
        part = slice(6 * n + 3 * k, 6 * n + 3 * k + 3)
        np.testing.assert_allclose(found.points[k], q[part, part], atol=tolerance)
    for k in range(n):
        part = slice(6 * k, 6 * k + 6)
        size = np.sqrt(np.diag(q)[part])
        np.testing.assert_allclose(
            found.photos[k] / size[:, None] / size, q[part, part] / size[:, None] / size, atol=1e-5
        )
    gain = q @ white.T
    for ray in range(m):
        part = slice(6 * n + 3 * problem.point[ray], 6 * n + 3 * problem.point[ray] + 3)
        np.testing.assert_allclose(
            found.response[ray], gain[part, 2 * ray : 2 * ray + 2], atol=tolerance
        )


def test_one_distance_gives_the_scale_and_is_checked_by_nothing() -> None:
    scene = flat_scene()
    without = adjust_block(scene.block, datum="free")
    for sigma in (0.02, 0.0):
        (bar,) = bars(scene, [sigma], off=[37.0])
        block = adjust_block(replace(scene.block, conditions=(bar,)), datum="free")
        (row,) = block.condition_rows()
        assert row.r == pytest.approx(0.0, abs=1e-12)
        assert row.w is None
        assert row.residual == pytest.approx(0.0, abs=1e-9)
        # the photographs are none the wiser
        assert (block.redundancy, block.problem.defect) == (without.redundancy, 6)
        np.testing.assert_allclose(block.cofactors.r, without.cofactors.r, atol=1e-9)
        at = {name: block.state.points[k] for k, name in enumerate(block.problem.points)}
        assert np.linalg.norm(at["p7"] - at["p2"]) == pytest.approx(bar.value, abs=1e-9)
    assert without.problem.defect == 7


@pytest.mark.slow
def test_several_distances_check_the_scale_and_a_wrong_one_is_named() -> None:
    scene = flat_scene()
    good = bars(scene, [0.02, 0.03, 0.05])
    block = adjust_block(replace(scene.block, conditions=good), datum="free")
    rows = block.condition_rows()
    assert all(row.r > 0.05 and abs(row.w) < 3.29 for row in rows)
    wrong = bars(scene, [0.02, 0.03, 0.05], off=[0.0, 3.0 * rows[1].mdb])
    cleaned = block_gross_errors(
        make_problem(replace(scene.block, conditions=wrong), datum="free"), "baarda"
    )
    assert [one.name[1] for one in cleaned.rejected] == [wrong[1].id]
    again = cleaned.block
    assert again.redundancy == block.redundancy - 1
    without = adjust_block(replace(scene.block, conditions=(good[0], good[2])), datum="free")
    for name in ("p1", "p16"):
        mine, its = (of.state.points[of.problem.points.index(name)] for of in (again, without))
        np.testing.assert_allclose(mine + again.state.origin, its + without.state.origin, atol=1e-6)


def test_two_distances_that_disagree_accuse_each_other_alike() -> None:
    scene = flat_scene()
    pair = bars(scene, [0.02, 0.03], off=[0.0, 1.0])
    one, two = adjust_block(replace(scene.block, conditions=pair), datum="free").condition_rows()
    assert abs(one.w) == pytest.approx(abs(two.w), rel=1e-6)
    assert one.flagged
    assert two.flagged


@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_error_of_a_distance_moves_the_points_as_foreseen(number) -> None:
    scene = flat_scene()
    good = list(bars(scene, [0.05, 0.08, 0.06]))
    block = with_conditions(scene, good, datum="free")
    row, effect = block.condition_rows()[number], external_reliability(block).conditions[number]
    small = 0.01
    good[number] = replace(good[number], value=good[number].value + small * row.mdb)
    moved = with_conditions(scene, good, datum="free")
    place = block.problem.points.index(effect.point)
    # both lie on the approximate points in the mean: the scale is what has changed most
    change = moved.state.points - moved.state.points.mean(axis=0)
    change -= block.state.points - block.state.points.mean(axis=0)
    own = np.array(effect.effect_m)
    assert np.linalg.norm(change[place]) / small == pytest.approx(np.linalg.norm(own), rel=0.1)
    assert change[place] @ own > 0.95 * np.linalg.norm(change[place]) * np.linalg.norm(own)


def test_a_distance_that_is_only_compared_is_so_in_the_scale_of_the_others() -> None:
    scene = flat_scene()
    check = condition(scene, "distance", "p5 p12", 0.05, use="check")
    block = adjust_block(
        replace(scene.block, conditions=(*bars(scene, [0.02]), check)), datum="free"
    )
    (row,) = compared_conditions(block)
    # what one more observation would have had
    taken = adjust_block(
        replace(scene.block, conditions=(*bars(scene, [0.02]), replace(check, use="control"))),
        datum="free",
    ).condition_rows()[1]
    assert row.s == pytest.approx(0.05 / sqrt(taken.r) * block.sigma, rel=1e-3)
    assert row.difference == pytest.approx(taken.residual / taken.r, rel=1e-3)


def test_where_control_is_missing_it_is_said_that_distances_give_the_scale() -> None:
    scene = flat_scene()
    block = replace(scene.block, control=(), conditions=bars(scene, [0.02]))
    with pytest.raises(NotComputableError, match="takes the scale from the distances"):
        adjust_block(block)
    some = replace(block, control=scene.block.control[:1])
    with pytest.raises(NotComputableError, match="give a free datum its scale, and no other"):
        adjust_block(some)
    assert adjust_block(block, datum="free").problem.defect == 6
    assert LiveBlock(block).update(block).adjusted.problem.defect == 6


@pytest.mark.parametrize("name", CASES)
def test_the_scale_is_exceeded_by_what_the_points_were_enlarged(name) -> None:
    scene = flat_scene()
    problem = make_problem(replace(scene.block, conditions=tuple(CASES[name](scene))), datum="free")
    points = 1.001 * np.array([scene.points[one] for one in problem.points])
    conditions = problem.conditions
    excess = conditions.scale_excess(points, problem.fixed)
    # in the scale that it has now
    assert excess == pytest.approx(0.001 / 1.001, rel=1e-6)
    # and once it is gone, all contrasts are met
    again = points * (1.0 - excess)
    assert conditions.scale_excess(again, problem.fixed) == pytest.approx(0.0, abs=1e-5)


def test_a_minimal_datum_keeps_the_scale_of_its_coordinates() -> None:
    scene = flat_scene()
    block = adjust_block(replace(scene.block, conditions=bars(scene, [0.02])), datum="minimal")
    assert block.problem.defect == 7
    assert block.problem.conditions is None


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_distance_of_a_free_network_has_the_deviation_that_its_scale_leaves(number) -> None:
    scene = flat_scene()
    good = list(bars(scene, [0.05, 0.08, 0.06]))
    block = with_conditions(scene, good, datum="free")
    function = CoordinateFunction("distance", ("p1", "p16"))
    (found,) = evaluate_functions(block, [function])
    # a distance that is compared only has the same, but for its own
    check = condition(scene, "distance", "p1 p16", 1.0, use="check")
    (row,) = compared_conditions(with_conditions(scene, [*good, check], datum="free"))
    own = (row.s / block.sigma) ** 2 - 1.0
    assert found.s / block.sigma == pytest.approx(sqrt(own), rel=1e-4)
    # and what an error does to it, it does
    small, row = 0.01, block.condition_rows()[number]
    good[number] = replace(good[number], value=good[number].value + small * row.mdb)
    (moved,) = evaluate_functions(with_conditions(scene, good, datum="free"), [function])
    change = abs(moved.value - found.value) / small
    assert found.effect >= change * (1.0 - 1e-3)
    if found.observation == row.key:
        assert change == pytest.approx(found.effect, rel=1e-2)


def test_what_depends_on_the_datum_is_no_function_of_a_free_network() -> None:
    scene = flat_scene()
    block = with_conditions(scene, bars(scene, [0.05]), datum="free")
    with pytest.raises(InputError, match="not free, but for distances"):
        evaluate_functions(block, [CoordinateFunction("height", ("p1", "p16"))])


@pytest.mark.parametrize(
    ("sigmas", "wrong"), [([0.02], 0.0), ([0.02, 0.03], 0.0), ([0.02, 0.03], 2.0), ([0.02], 50.0)]
)
def test_control_tells_of_the_scale_that_distances_give(sigmas, wrong) -> None:
    scene = flat_scene()
    rows = list(scene.block.control)
    rows[0] = replace(rows[0], xyz=(*rows[0].xyz[:2], None))
    scene = replace(scene, block=replace(scene.block, control=tuple(rows)))
    block = adjust_block(
        replace(scene.block, conditions=bars(scene, sigmas, off=[wrong, wrong])),
        datum="free",
    )
    found = control_tests(block)
    free = control_tests(adjust_block(scene.block, datum="free"))
    all_of, without = found.groups[0], free.groups[0]
    assert (found.scaled, free.scaled) == (True, False)
    assert all_of.conditions == without.conditions + 1
    # the rigid movement that agrees best, by the covariances of an own dense adjustment
    names, places = block.problem.points, block.state.points
    at = [
        (names.index(row.point), axis, value, row.sigma[axis])
        for row in rows
        for axis, value in enumerate(row.xyz)
        if value is not None
    ]
    index, axes = np.array([one[:2] for one in at]).T
    given = np.array([value for *_, value, _ in at]) - block.state.origin[axes]
    first = block.problem.per_photo * len(block.problem.photos)
    pick = first + 3 * np.repeat(index, 3) + np.tile(np.arange(3), len(index))
    _, q, _, _ = dense_free(block)
    own = q[np.ix_(pick, pick)]

    def movement(x):
        turn = Rotation.from_rotvec(x[3:] * 1e-3).as_matrix()
        return turn, (places[index] @ turn.T)[np.arange(len(at)), axes] + x[axes]

    # its covariances turn along with it: at first those of no turn
    solved = np.zeros(6)
    for _ in range(3):
        turn, _ = movement(solved)
        part = np.kron(np.eye(len(at)), turn) @ own @ np.kron(np.eye(len(at)), turn).T
        mine = 3 * np.arange(len(at)) + axes
        covariance = part[np.ix_(mine, mine)] + np.diag([sigma**2 for *_, sigma in at])
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        best = least_squares(
            lambda x, root=root: root @ (movement(x)[1] - given), solved, xtol=1e-12
        )
        solved = best.x
    square = all_of.verdict.known.square
    assert square == pytest.approx(2.0 * best.cost, rel=1e-2)
    assert all_of.verdict.rejected == (wrong > 0.0)
    if wrong:
        assert square > 10.0 * without.verdict.known.square
    elif len(sigmas) == 1:
        # the same network, and one condition more
        assert square >= without.verdict.known.square * (1.0 - 1e-3)


def test_two_control_points_check_nothing_but_the_scale_of_distances() -> None:
    scene = flat_scene()
    few = replace(scene.block, control=scene.block.control[:2])
    (bar,) = bars(scene, [0.02])
    for off in (0.0, 5.0):
        conditions = (replace(bar, value=bar.value + off),)
        block = adjust_block(replace(few, conditions=conditions), datum="free")
        (group,) = (one for one in control_tests(block).groups if one.what == "all")
        assert group.conditions == 1
        assert group.verdict.rejected == (off > 0.0)
