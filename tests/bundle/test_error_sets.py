"""Tests of sets of observations, and functions of coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conditionblocks import dense_adjustment, every_kind, flat_scene, with_conditions

from anaplot.adjustment.hypothesis import f_noncentrality
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.hypotheses.coordinatefunctions import CoordinateFunction, evaluate_functions
from anaplot.bundle.hypotheses.errorsets import ErrorSet, error_set_tests, set_statistic
from anaplot.bundle.hypotheses.verdict import VarianceFactor
from anaplot.bundle.solve.residuals import BlockResiduals, residuals_of
from anaplot.errors import InputError
from anaplot.photogrammetry.block import TestSettings

POINT = [("image", photo, "p6", None, axis)
         for photo in ("101", "102", "103", "201", "202", "203") for axis in "xy"]  # fmt: skip


@pytest.fixture(scope="module")
def adjusted():
    scene = flat_scene()
    return with_conditions(scene, every_kind(scene))


def photo_rows(block, photo):
    return [name for name in block.observations.names if name[:2] == ("image", photo)]


def test_a_set_of_one_is_the_test_of_that_observation(adjusted) -> None:
    for at in (0, 7, adjusted.observations.image, len(adjusted.tested) - 1):
        row = adjusted.tested.rows(np.array([at]))[0]
        (found,) = error_set_tests(adjusted, [ErrorSet("one", (row.key,))])
        assert found.dimension == 1
        # T = w^2 for the a-priori sigma0
        assert found.square == pytest.approx((row.w * adjusted.sigma0) ** 2, rel=1e-6)
        assert found.errors[0].estimated == pytest.approx(-row.residual / row.r, rel=1e-6)
        known = f_noncentrality(0.001, 0.80, 1)
        assert found.worst_sigmas / np.sqrt(found.noncentrality / known) == pytest.approx(
            row.mdb / adjusted.observations.sigma[at], rel=1e-6
        )


def test_conditions_free_of_error_are_tested_as_by_themselves_and_beside_others() -> None:
    scene = flat_scene()
    block = with_conditions(scene, every_kind(scene, firm=(0, 1, 2)))
    rows = [row for row in block.condition_rows() if row.use]
    firm = [row for row in rows if row.key[1] in {one.id for one in every_kind(scene)[:3]}]
    for row in firm:
        (found,) = error_set_tests(block, [ErrorSet("one", (row.key,))])
        assert found.dimension == 1
        assert found.square == pytest.approx((row.w * block.sigma0) ** 2, rel=1e-6)
        known = f_noncentrality(0.001, 0.80, 1)
        assert abs(found.errors[0].worst) == pytest.approx(
            row.mdb * np.sqrt(found.noncentrality / known), rel=1e-6
        )
    # all rows of a plane: as many directions as it has conditions
    plane = [row.key for row in firm if row.axis == "normal"]
    (found,) = error_set_tests(block, [ErrorSet("plane", tuple(plane))])
    assert (found.dimension, found.undetectable) == (2, 3)
    # beside rays, what giving up both saves, against tiny sigmas in place of none
    wanted = (firm[0].key, *POINT[:3])
    tight = [replace(one, sigma=1e-4) if k < 3 else one for k, one in enumerate(every_kind(scene))]
    other = with_conditions(scene, tight)
    for shares in (None, (2.0, 1.0, -1.0, 0.5)):
        (found,) = error_set_tests(block, [ErrorSet("both", wanted, shares)])
        (limit,) = error_set_tests(other, [ErrorSet("both", wanted, shares)])
        assert (found.dimension, found.undetectable) == (limit.dimension, 0)
        assert found.square == pytest.approx(limit.square, rel=1e-3)


@pytest.mark.parametrize("shares", [None, "related"])
def test_the_statistic_is_what_giving_up_the_set_saves(adjusted, shares) -> None:
    # T = v'Pv with the set less v'Pv with its errors as unknowns: from an own dense adjustment
    white, _, q = dense_adjustment(adjusted)
    names = list(adjusted.observations.names)
    rows = [names.index(name) for name in photo_rows(adjusted, "102")[:7]]
    system = residuals_of(adjusted)
    shared = None if shares is None else np.array([1.0, -1.0, 0.5, 0.0, 2.0, 1.0, 0.0])
    found = set_statistic(system, np.array(rows), shared)
    r = np.eye(len(white)) - white @ q @ white.T
    directions = np.eye(len(white))[:, rows]
    if shared is not None:
        directions = directions @ (shared / system.sigma[rows])[:, None]
    image, fourth = system.rows.image, system.rows.starts[3]
    linear = adjusted.cofactors.normal.linear
    e = np.concatenate(
        (system.e[:image], -linear.point_e[0].ravel(), -linear.photo_e.ravel(), system.e[fourth:])
    )
    design = r @ directions
    saved = e @ design @ np.linalg.pinv(design.T @ design, rcond=1e-9) @ design.T @ e
    assert found.square == pytest.approx(saved, rel=1e-5)
    assert len(found.values) + found.undetectable == directions.shape[1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["baarda", "tau"])
@pytest.mark.parametrize("which", ["point", "photo", "related"])
def test_size_and_power_are_those_of_theory(adjusted, kind, which) -> None:
    alpha, power, runs = 0.05, 0.80, 1500
    test = TestSettings(kind, alpha, power)
    block = replace(
        adjusted,
        problem=replace(adjusted.problem, block=replace(adjusted.problem.block, test=test)),
    )
    chosen = POINT if which != "photo" else photo_rows(block, "102")
    shares = tuple(float(k % 3 - 1) for k in range(len(chosen))) if which == "related" else None
    (asked,) = error_set_tests(block, [ErrorSet("set", tuple(chosen), shares)])
    system = residuals_of(block)
    rows = np.array([list(system.names).index(error.name) for error in asked.errors])
    whole = system.columns(np.arange(len(system.e)))
    worst = np.array([error.worst for error in asked.errors]) / system.sigma[rows]
    assert np.linalg.norm(worst) == pytest.approx(asked.worst_sigmas)
    # eq. 17 and 18: what the error changes, and its noncentrality
    change = whole[:, rows] @ worst
    assert change @ change == pytest.approx(asked.noncentrality, rel=1e-6)
    rng = np.random.default_rng(11)
    given = None if shares is None else np.array(shares)
    counts = np.zeros(2)
    for _ in range(runs):
        noise = whole @ rng.normal(size=len(whole))
        for k, e in enumerate((noise, noise + change)):
            found = set_statistic(replace(system, e=e), rows, given)
            variance = VarianceFactor(float(e @ e), block.redundancy, kind == "baarda")
            left = variance.without(found.square, asked.dimension)
            counts[k] += left.test(found.square, asked.dimension, alpha).rejected
    for share, wanted in zip(counts / runs, (alpha, power), strict=True):
        assert abs(share - wanted) < 4.0 * np.sqrt(wanted * (1.0 - wanted) / runs)


def test_columns_are_kept_for_one_set_only(adjusted, monkeypatch) -> None:
    held = []
    columns = BlockResiduals.columns

    def counted(self, rows):
        found = columns(self, rows)
        held.append(len(self._known))
        return found

    monkeypatch.setattr(BlockResiduals, "columns", counted)
    sets = [ErrorSet(p, tuple(photo_rows(adjusted, p))) for p in ("101", "102", "103")]
    error_set_tests(adjusted, sets)
    assert held == [len(one.observations) for one in sets]


def test_a_wrong_photo_is_found_by_its_set_and_not_by_others() -> None:
    scene = flat_scene()
    # what no orientation takes up: every other ray of a photo
    rows, k = [], 0
    for row in scene.block.image_points:
        if row.photo == "202":
            k += 1
            row = replace(row, y=row.y + 0.03 * (-1) ** k)
        rows.append(row)
    block = adjust_block(scene.with_rows(rows).block)
    sets = [ErrorSet(p, tuple(photo_rows(block, p))) for p in block.problem.photos]
    found = {one.name: one for one in error_set_tests(block, sets)}
    assert found["202"].rejected
    best = max(found.values(), key=lambda one: one.square / one.dimension)
    assert best.name == "202"
    # a photo's own six unknowns take up six directions of its errors
    assert all(one.undetectable >= 6 for one in found.values())


def test_the_worst_error_moves_the_points_as_foreseen(adjusted) -> None:
    (found,) = error_set_tests(adjusted, [ErrorSet("p6", tuple(POINT))])
    by_name = {error.name: error.worst for error in found.errors}
    small = 0.02
    rows = []
    for row in adjusted.problem.block.image_points:
        if row.point == "p6":
            x, y = (1e-3 * small * by_name["image", row.photo, "p6", None, axis] for axis in "xy")
            row = replace(row, x=row.x + x, y=row.y + y)
        rows.append(row)
    scene = flat_scene().with_rows(rows)
    moved = with_conditions(scene, adjusted.problem.block.conditions)
    place = adjusted.problem.points.index(found.moved)
    change = moved.state.points + moved.state.origin
    change = change - adjusted.state.points - adjusted.state.origin
    np.testing.assert_allclose(change[place] / small, found.moved_m, rtol=0.03, atol=3e-3)


def test_rejected_observations_take_no_part_in_a_set(adjusted) -> None:
    rows = list(adjusted.problem.block.image_points)
    at = next(k for k, row in enumerate(rows) if (row.photo, row.point) == ("102", "p6"))
    rows[at] = replace(rows[at], y=rows[at].y + 0.5)
    block = replace(adjusted.problem.block, image_points=tuple(rows))
    cleaned = block_gross_errors(block, "baarda").block
    (found,) = error_set_tests(cleaned, [ErrorSet("p6", tuple(POINT))])
    assert len(found.errors) == len(POINT) - 1
    assert not found.rejected


@pytest.mark.parametrize(
    ("one", "what"),
    [
        (
            ErrorSet("s", (("image", "101", "no", None, "x"),)),
            "set s: no observation image 101 no x",
        ),
        (ErrorSet("s", (POINT[0],), (0.0,)), "set s: its shares are all zero"),
    ],
)
def test_a_set_that_is_none_is_refused(adjusted, one, what) -> None:
    with pytest.raises(InputError, match=what):
        error_set_tests(adjusted, [one])


def test_functions_of_coordinates_equal_the_dense_propagation(adjusted) -> None:
    functions = (
        CoordinateFunction("distance", ("p2", "p9")),
        CoordinateFunction("height", ("p6", "p11")),
        CoordinateFunction("centre", ("p5", "p6", "p9", "p10")),
    )
    found = evaluate_functions(adjusted, functions)
    assert [one.axis for one in found] == ["", "", "X", "Y", "Z"]
    white, _, q = dense_adjustment(adjusted)
    problem = adjusted.problem
    start = problem.per_photo * len(problem.photos)
    at = adjusted.state.points + adjusted.state.origin
    place = {name: k for k, name in enumerate(problem.points)}
    image = adjusted.observations.image
    for one in found:
        gradient = np.zeros(len(q))
        points = [place[name] for name in one.function.points]
        if one.function.kind == "centre":
            axis = "XYZ".index(one.axis)
            for k in points:
                gradient[start + 3 * k + axis] = 1.0 / len(points)
            value = at[points, axis].mean()
        else:
            step = at[points[1]] - at[points[0]]
            along = step / np.linalg.norm(step) if one.function.kind == "distance" else [0, 0, 1]
            for k, sign in zip(points, (-1.0, 1.0), strict=True):
                gradient[start + 3 * k : start + 3 * k + 3] = sign * np.asarray(along)
            value = step @ along
        assert one.value == pytest.approx(value, rel=1e-9)
        assert one.s == pytest.approx(adjusted.sigma * np.sqrt(gradient @ q @ gradient), rel=1e-6)
        # external reliability: of every image coordinate and condition
        moved = np.abs(white @ q @ gradient)
        tested = adjusted.tested
        mdb = tested.mdb / adjusted.observations.sigma
        fourth = adjusted.observations.starts[3]
        effects = np.concatenate(
            (moved[:image] * mdb[:image], moved[len(moved) - len(mdb) + fourth :] * mdb[fourth:])
        )
        assert one.effect >= np.nanmax(effects) * (1.0 - 1e-6)
        if one.observation[0] != "control":
            assert one.effect == pytest.approx(np.nanmax(effects), rel=1e-6)


def test_functions_need_points_and_the_datum_of_control(adjusted) -> None:
    wrong = CoordinateFunction("distance", ("p2", "q9"))
    with pytest.raises(InputError, match="distance p2 q9: no adjusted point 'q9'"):
        evaluate_functions(adjusted, [wrong])
    free = adjust_block(flat_scene().block, datum="free")
    with pytest.raises(InputError, match="datum of control"):
        evaluate_functions(free, [CoordinateFunction("height", ("p2", "p9"))])
