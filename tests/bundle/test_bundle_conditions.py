"""Conditions between points: derivatives, the sparse against an own dense adjustment, tests."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from bundleblocks import make_scene
from conditionblocks import (
    condition,
    dense_adjustment,
    every_kind,
    flat_scene,
    with_conditions,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.controllast import clean_control_last
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.hypotheses.controltests import control_tests
from anaplot.bundle.solve.comparedconditions import compared_conditions
from anaplot.bundle.solve.conditions import Conditions
from anaplot.bundle.solve.externalreliability import external_reliability
from anaplot.bundle.solve.factor import Factor
from anaplot.bundle.solve.linearised import move, objective
from anaplot.bundle.solve.photosides import solve_photos
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.residuals import block_residuals
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.objectconditions import ObjectCondition, condition_fault

KINDS = {
    "distance": (2, 3.0),
    "angle": (3, 1.0),
    "line": (5, None),
    "plane": (6, None),
    "equal": (6, None),
}


def laid(kind, count, value, sigma=0.1):
    names = tuple(f"p{k}" for k in range(count))
    one = ObjectCondition(kind, names, value, sigma)
    rows = {"line": 2 * count, "plane": count, "equal": count // 2}.get(kind, 1)
    return Conditions((one,), (np.arange(count),), np.zeros(rows, dtype=bool))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("upright", [False, True])
def test_analytic_derivatives_equal_numerical_ones(kind, upright) -> None:
    count, value = KINDS[kind]
    rng = np.random.default_rng(3)
    points = rng.normal(size=(count, 3))
    if kind in ("line", "plane"):
        # nearly on it: elsewhere the deviations are not linear in their parameters
        along = np.array((0.0, 0.0, 1.0)) if upright else np.array((0.6, 0.7, 0.2))
        keep = np.outer(along, along) / (along @ along)
        points = 4.0 * points @ (keep if kind == "line" else np.eye(3) - keep)
        points += 1e-7 * rng.normal(size=points.shape)
    of = laid(kind, count, value)
    fixed = np.zeros((count, 3), dtype=bool)
    fixed[0, 1] = True
    there = of.equations(points, fixed)
    numerical = np.zeros(there.whitened.shape)
    step = 1e-5
    for column in np.flatnonzero(~fixed.ravel()).tolist():
        ends = []
        for sign in (1.0, -1.0):
            moved = points.ravel().copy()
            moved[column] += sign * step
            ends.append(there.contrasted(of.equations(moved.reshape(-1, 3), fixed)))
        numerical[:, column] = (ends[0] - ends[1]) / (2.0 * step)
    size = np.abs(numerical).max()
    np.testing.assert_allclose(there.whitened.toarray(), numerical, atol=2e-6 * size)
    # contrasts are orthonormal, and no parameter changes them
    gram = (there.contrasts.T @ there.contrasts).toarray()
    np.testing.assert_allclose(gram, np.eye(len(gram)), atol=1e-12)
    assert np.abs((there.contrasts.T @ there.spanned).toarray()).max(initial=0.0) < 1e-12


CASES = {
    "weighted": {},
    "free of error": {"firm": (0, 1, 2, 3, 4, 5)},
    "both": {"firm": (1, 3)},
    "error-free control": {"scene": {"control_sigma": 0.0}, "firm": (0, 2)},
    "parameters of all photos": {"additional": ("ebner", 5.0), "firm": (5,)},
    "parameters of each photo": {"additional": ("physical:photo", 5.0), "scene": {"priors": True}},
}


@pytest.fixture(scope="module")
def adjusted():
    kept = {}

    def of(name):
        if name not in kept:
            case = CASES[name]
            scene = flat_scene(**case.get("scene", {}))
            conditions = every_kind(scene, case.get("firm", ()))
            kept[name] = with_conditions(scene, conditions, case.get("additional"))
        return kept[name]

    return of


@pytest.mark.parametrize("name", CASES)
def test_everything_equals_an_own_dense_adjustment(name, adjusted) -> None:
    block = adjusted(name)
    problem, found = block.problem, block.cofactors
    white, _, q = dense_adjustment(block)
    n, d, p, m = len(problem.photos), problem.per_photo, len(problem.points), len(problem.photo)
    r = 1.0 - np.einsum("ij,jk,ik->i", white, q, white, optimize=True)
    np.testing.assert_allclose(found.r.ravel(), r[: 2 * m], atol=1e-8)
    control = r[2 * m : 2 * m + 3 * p].reshape(p, 3)
    seen = np.isfinite(problem.known_sigma)
    np.testing.assert_allclose(found.r_ground[0][seen], control[seen], atol=1e-8)
    firm = problem.conditions.firm
    np.testing.assert_allclose(
        found.r_conditions[~firm], r[len(r) - int((~firm).sum()) :], atol=1e-8
    )
    assert found.r_conditions[firm].max(initial=0.0) < 1e-6
    # the sum of all redundancy numbers is the redundancy
    assert block.tested.r.sum() == pytest.approx(block.redundancy, abs=1e-6)
    assert block.redundancy == problem.observations - problem.unknowns
    for k in range(p):
        part = slice(n * d + 3 * k, n * d + 3 * k + 3)
        np.testing.assert_allclose(found.points[k], q[part, part], atol=1e-9)
    for k in range(n):
        part = slice(k * d, (k + 1) * d)
        size = np.sqrt(np.diag(q)[part])
        np.testing.assert_allclose(
            found.photos[k] / size[:, None] / size, q[part, part] / size[:, None] / size, atol=1e-7
        )
    start, g = n * d + 3 * p, problem.in_border
    if g:
        corner = q[start : start + g, start : start + g]
        np.testing.assert_allclose(found.shared, corner, atol=1e-8 * np.abs(corner).max())
    gain = q[:, : start + g] @ white[: 2 * m, : start + g].T
    for ray in range(m):
        part = slice(n * d + 3 * problem.point[ray], n * d + 3 * problem.point[ray] + 3)
        np.testing.assert_allclose(
            found.response[ray], gain[part, 2 * ray : 2 * ray + 2], atol=1e-8
        )


@pytest.mark.parametrize("name", CASES)
def test_the_residual_system_equals_the_dense_one(name, adjusted) -> None:
    block = adjusted(name)
    problem = block.problem
    white, _, q = dense_adjustment(block)
    system = block_residuals(problem, block.state, block.cofactors.normal.structure)
    image = system.rows.image
    whole = system.columns(np.arange(len(system.names)))
    np.testing.assert_allclose(whole, whole.T, atol=1e-8)
    firm = np.zeros(len(whole), dtype=bool)
    firm[system.rows.starts[3] :] = problem.conditions.firm
    weighted = np.flatnonzero(~firm[system.rows.starts[3] :]) + system.rows.starts[3]
    dense_rows = [*range(image), *range(len(white) - len(weighted), len(white))]
    mine = [*range(image), *weighted.tolist()]
    r = np.eye(len(white)) - white @ q @ white.T
    np.testing.assert_allclose(
        whole[np.ix_(mine, mine)], r[np.ix_(dense_rows, dense_rows)], atol=1e-8
    )
    np.testing.assert_allclose(np.diag(whole), system.r, atol=1e-9)
    # at the minimum the misclosures left are the residuals
    assert system.vtpv == pytest.approx(block.vtpv, rel=1e-6)
    v = block.tested.residual / system.sigma
    np.testing.assert_allclose(-system.e[weighted], v[weighted], atol=1e-5)
    # the design takes away all that R does
    design = system.design().toarray()
    assert np.abs(whole @ design).max() < 1e-5 * np.abs(design).max()


def test_the_minimum_is_that_of_the_dense_sum_of_squares(adjusted) -> None:
    block = adjusted("weighted")
    white, _, _ = dense_adjustment(block)
    # a step in any direction of the unknowns brings nothing: A'Pv = 0
    tested, rows = block.tested, block.observations
    v = tested.residual / rows.sigma
    image, fourth = rows.image, rows.starts[3]
    linear = block.cofactors.normal.linear
    e = np.concatenate((v[:image], linear.point_e[0].ravel(), linear.photo_e.ravel(), v[fourth:]))
    gradient = white.T @ e
    size = np.linalg.norm(white, axis=0) * np.linalg.norm(e)
    assert np.abs(gradient / np.where(size > 0.0, size, 1.0)).max() < 1e-6


def test_right_hand_sides_are_solved_for_in_portions_with_the_same_result(
    adjusted, monkeypatch
) -> None:
    block = adjusted("parameters of all photos")
    normal, factor = block.cofactors.normal, block.cofactors.factor
    sides = normal.update(factor).gain
    whole = normal.solve(factor, *sides)
    widths = []
    solve = Factor.solve

    def counted(self, right, corner):
        widths.append(right.shape[-1])
        return solve(self, right, corner)

    monkeypatch.setattr(Factor, "solve", counted)
    monkeypatch.setattr("anaplot.bundle.solve.eliminated._PORTION", 16 * normal.z[:, :, 0].size)
    parts = normal.solve(factor, *sides)
    assert max(widths) == 2
    assert sum(widths) == sides[0].shape[-1]
    for one, other in zip(parts, whole, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * np.abs(other).max())


def test_some_rays_change_as_all_unknowns_do(adjusted) -> None:
    cofactors = adjusted("weighted").cofactors
    normal, factor = cofactors.normal, cofactors.factor
    problem, rays = normal.problem, np.arange(7)
    photos = np.random.default_rng(2).normal(size=(len(problem.photos), problem.per_photo, 3))
    others = np.zeros((len(problem.points), 3, 3)), np.zeros((len(normal.corner), 3))
    whole = normal.solve(factor, photos, *others)
    x, seen = solve_photos(normal, factor, photos, rays)
    np.testing.assert_allclose(x, whole[0], rtol=1e-12)
    np.testing.assert_allclose(seen, normal.seen(*whole, rays), rtol=1e-12)


def test_a_condition_free_of_error_is_met(adjusted) -> None:
    block = adjusted("free of error")
    equations = block.problem.conditions.equations(block.state.points, block.problem.fixed)
    assert np.abs(equations.misclosure).max() < 1e-9
    deviations = np.sqrt(np.einsum("nii->ni", block.cofactors.points)).max()
    assert deviations > 1e-3


@pytest.mark.parametrize("number", range(6))
def test_what_is_free_of_error_is_the_limit_of_ever_smaller_sigmas(number) -> None:
    scene = flat_scene()
    firm, tight = (
        with_conditions(scene, [replace(every_kind(scene)[number], sigma=sigma)])
        for sigma in (0.0, 1e-3 if number != 3 else 1e-6)
    )
    for one, other in zip(firm.condition_rows(), tight.condition_rows(), strict=True):
        assert one.w == pytest.approx(other.w, rel=1e-2)
        assert one.mdb == pytest.approx(other.mdb, rel=1e-2)
        assert one.r < 1e-9
        assert one.effect is None
    assert firm.redundancy == tight.redundancy
    assert firm.problem.observations < tight.problem.observations
    np.testing.assert_allclose(firm.state.points, tight.state.points, atol=1e-3)


@pytest.mark.slow
@given(
    st.lists(st.sampled_from(range(6)), min_size=1, max_size=6, unique=True),
    st.sets(st.sampled_from(range(6))),
    st.sampled_from([0.0, 0.05]),
)
@settings(max_examples=12, deadline=None)
def test_the_redundancy_numbers_sum_up_to_the_redundancy(used, firm, control) -> None:
    scene = flat_scene(control_sigma=control)
    block = with_conditions(scene, [every_kind(scene, firm)[k] for k in used])
    assert block.tested.r.sum() == pytest.approx(block.redundancy, abs=1e-6)
    assert (block.tested.r >= -1e-12).all()
    assert (block.tested.r <= 1.0 + 1e-12).all()


@pytest.mark.parametrize("number", range(6))
def test_an_error_of_the_detectable_size_moves_the_points_as_foreseen(number) -> None:
    scene = flat_scene()
    conditions = list(every_kind(scene))
    block = with_conditions(scene, conditions)
    found = external_reliability(block)
    rows, effects = block.condition_rows(), found.conditions
    assert len(rows) == len(effects)
    at = next(k for k, row in enumerate(rows) if row.key[1] == conditions[number].id)
    if conditions[number].value is None:
        # w of a line or plane belongs to a point: of this one only the size is to be told
        assert np.linalg.norm(effects[at].effect_m) > 0.0
        return
    small = 0.01
    wrong = list(conditions)
    wrong[number] = replace(wrong[number], value=wrong[number].value + small * rows[at].mdb)
    moved = with_conditions(scene, wrong)
    place = block.problem.points.index(effects[at].point)
    change = moved.state.points + moved.state.origin - block.state.points - block.state.origin
    np.testing.assert_allclose(change[place] / small, effects[at].effect_m, rtol=2e-2, atol=1e-4)
    assert np.argmax(np.linalg.norm(change, axis=1)) == place


@pytest.mark.slow
def test_strategies_name_a_wrong_condition() -> None:
    scene = flat_scene()
    conditions = list(every_kind(scene))
    row = with_conditions(scene, conditions).condition_rows()[-1]
    conditions[5] = replace(conditions[5], value=conditions[5].value + 3.0 * row.mdb)
    block = replace(scene.block, conditions=tuple(conditions))
    wrong = ("condition", conditions[5].id, "p9 p14", "distance")
    for strategy in ("baarda", "odds", "l1"):
        cleaned = block_gross_errors(block, strategy)
        assert [one.name for one in cleaned.rejected] == [wrong]
        again = cleaned.block
        assert again.redundancy == adjust_block(block).redundancy - 1
        gone = next(one for one in again.condition_rows() if one.key == wrong)
        assert not gone.use
        assert gone.w is None
        # what is left out is measured from the others: about the error, with the other sign
        assert gone.residual == pytest.approx(-3.0 * row.mdb, rel=0.3)


def test_a_point_off_its_plane_is_named_and_the_others_stay() -> None:
    scene = flat_scene(control_sigma=0.05)
    points = "p1 p4 p6 p7 p10 p11 p13 p16"
    plane = condition(scene, "plane", points, 0.02)
    good = adjust_block(replace(scene.block, conditions=(plane,)))
    assert not any(one.flagged for one in good.condition_rows())
    # the others lie in the plane, this one above it: it is photographed where it is
    lifted = {**scene.points, "p10": scene.points["p10"] + (0.0, 0.0, 3.0)}
    seen = {(row.photo, row.point) for row in scene.block.image_points}
    made = make_scene(
        {name: (scene.centres[name], scene.rotations[name]) for name in scene.centres},
        lifted,
        control=scene.block.control,
        sees=lambda photo, point, _: (photo, point) in seen,
        noise_um=5.0,
    )
    block = replace(made.block, conditions=(plane,))
    cleaned = block_gross_errors(block, "baarda")
    assert [one.name for one in cleaned.rejected] == [("condition", plane.id, "p10", "normal")]
    rows = cleaned.block.condition_rows()
    assert [row.key[2] for row in rows if row.use] == [n for n in points.split() if n != "p10"]
    assert not any(row.flagged for row in rows)


@pytest.mark.slow
def test_control_last_brings_conditions_in_with_the_control() -> None:
    scene = flat_scene()
    conditions = list(every_kind(scene))
    conditions[0] = replace(conditions[0], value=conditions[0].value + 2.0)
    found = clean_control_last(replace(scene.block, conditions=tuple(conditions)), "baarda")
    assert found.images.block.problem.conditions is None
    assert ("condition", conditions[0].id, "p2 p7", "distance") in [
        one.name for one in found.control.rejected
    ]


def test_what_is_compared_changes_nothing() -> None:
    scene = flat_scene()
    alone = adjust_block(scene.block)
    checks = (
        condition(scene, "distance", "p2 p7", 0.02, off=0.5, use="check"),
        condition(scene, "plane", "p1 p6 p10 p11 p15", 0.08, use="check"),
        condition(scene, "angle", "p2 p6 p9", 1e-4, use="off"),
    )
    block = adjust_block(replace(scene.block, conditions=checks))
    np.testing.assert_array_equal(block.state.points, alone.state.points)
    assert block.redundancy == alone.redundancy
    rows = compared_conditions(block)
    assert [row.use for row in rows] == ["check"] * 6 + ["off"]
    # what one more observation would have had: the same standard deviation
    taken = adjust_block(replace(scene.block, conditions=(replace(checks[0], use="control"),)))
    expected = taken.condition_rows()[0]
    s = 0.02 / sqrt(expected.r) * alone.sigma
    assert rows[0].s == pytest.approx(s, rel=5e-3)
    assert rows[0].difference == pytest.approx(expected.residual / expected.r, rel=5e-3)
    assert rows[-1].s is None
    assert rows[-1].w is None


@pytest.mark.parametrize("use", ["check", "off"])
@pytest.mark.parametrize(("kind", "points"), [("plane", "p5 p6 p7 p8"), ("distance", "p2 p17")])
def test_a_condition_that_means_nothing_is_compared_without_numbers(kind, points, use) -> None:
    scene = _with_twin() if kind == "distance" else flat_scene(noise_um=0.0)
    bad = replace(
        condition(scene, kind, points, 0.02, use=use), value=1.0 if kind == "distance" else None
    )
    good = condition(scene, "distance", "p2 p7", 0.02, use="check")
    block = adjust_block(replace(scene.block, conditions=(bad, good)))
    *without, last = compared_conditions(block)
    assert {row.row.id for row in without} == {bad.id}
    assert all(row.difference is row.s is row.w is None for row in without)
    (alone,) = compared_conditions(adjust_block(replace(scene.block, conditions=(good,))))
    assert last == alone


def test_a_free_network_takes_what_is_of_shape_alone_and_compares_lengths() -> None:
    scene = flat_scene()
    conditions = [
        replace(one, use="check") if one.kind == "distance" else one
        for one in every_kind(scene, firm=(1,))
    ]
    block = adjust_block(replace(scene.block, conditions=tuple(conditions)), datum="free")
    assert {row.key[-1] for row in block.condition_rows()} == {"across", "up", "angle"}
    compared = compared_conditions(block)
    assert {row.row.axis for row in compared} == {"distance", "normal", "length"}
    assert all(row.s is None for row in compared)
    assert block.tested.r.sum() == pytest.approx(block.redundancy, abs=1e-6)


def test_a_point_that_the_images_do_not_determine_leaves_its_condition_out() -> None:
    scene = flat_scene()
    one = replace(every_kind(scene)[0], points=("p2", "nowhere"))
    problem = make_problem(replace(scene.block, conditions=(one,)))
    assert problem.conditions is None
    assert [(out.kind, out.name) for out in problem.left_out] == [("condition", one.id)]


@pytest.mark.parametrize(
    ("kind", "points", "sigma", "what"),
    [
        ("plane", "p5 p6 p7 p8", 0.1, "lie on a line"),
        ("angle", "p5 p6 p7", 0.001, "lie on one line"),
        ("distance", "p2 p17", 0.01, "coincide"),
    ],
)
def test_degenerate_conditions_are_named(kind, points, sigma, what) -> None:
    scene = flat_scene(noise_um=0.0) if kind != "distance" else _with_twin()
    one = condition(scene, kind, points, sigma, off=-1.0 if kind == "angle" else 0.0)
    one = replace(one, where="conditions.csv:4", value=1.0 if one.value is not None else None)
    with pytest.raises(NotComputableError, match=rf"conditions\.csv:4.*{what}"):
        adjust_block(replace(scene.block, conditions=(one,)))


@pytest.mark.parametrize(
    ("kind", "points"), [("distance", "p6 p7"), ("plane", "p1 p6 p10 p11 p15")]
)
def test_a_trial_step_into_a_state_without_meaning_is_damped(kind, points, monkeypatch) -> None:
    scene = flat_scene()
    conditions = [condition(scene, kind, points, 0.05)]
    expected = with_conditions(scene, conditions)
    names = points.split()
    met = []

    def astray(state, *corrections):
        found = move(state, *corrections)
        if met:
            return found
        at = [expected.problem.points.index(name) for name in names]
        places = found.points.copy()
        places[at] = places[at[0]] + 0.5 * np.arange(len(at))[:, None] * (kind == "plane")
        met.append(replace(found, points=places))
        return met[0]

    monkeypatch.setattr("anaplot.bundle.solve.gaussnewton.move", astray)
    found = with_conditions(scene, conditions)
    assert objective(found.problem, met[0])[0] == float("inf")
    np.testing.assert_allclose(found.state.points, expected.state.points, atol=1e-5)


def _with_twin():
    """A point p17 with the rays of p2."""
    scene = flat_scene()
    rows = scene.block.image_points
    twins = tuple(replace(row, point="p17") for row in rows if row.point == "p2")
    scene.points["p17"] = scene.points["p2"]
    return scene.with_rows((*rows, *twins))


def test_conditions_free_of_error_that_depend_on_each_other_are_named() -> None:
    scene = flat_scene()
    one = condition(scene, "distance", "p2 p7", 0.0)
    with pytest.raises(NotComputableError, match=r"distance p2 p7.*free of error already"):
        adjust_block(replace(scene.block, conditions=(one, replace(one, points=("p7", "p2")))))
    firm = flat_scene(control_sigma=0.0)
    held = [c.point for c in firm.block.control][:2]
    both = condition(firm, "distance", " ".join(held), 0.0)
    with pytest.raises(InputError, match="free of error"):
        adjust_block(replace(firm.block, conditions=(both,)))


@pytest.mark.parametrize(
    ("kind", "points", "sigma", "axis"),
    [
        ("distance", "p1 p6", 0.001, "X"),
        ("distance", "p1 p6", 0.0, "X"),
        ("plane", "p1 p2 p5 p6 p10", 0.02, "Z"),
        ("plane", "p1 p2 p5 p6 p10", 0.0, "Z"),
    ],
)
def test_control_free_of_error_is_given_up_in_its_conditions_too(
    kind, points, sigma, axis, monkeypatch
) -> None:
    scene = flat_scene(control_sigma=0.0)
    off = 0.05 if kind == "distance" else 0.0
    tied = (condition(scene, kind, points, sigma, off=off),)
    block = adjust_block(replace(scene.block, conditions=tied))
    (found,) = (
        one for one in control_tests(block).coordinates if (one.point, one.axis) == ("p1", axis)
    )
    # against an adjustment in which the coordinate is unknown
    at = "XYZ".index(axis)
    rows = []
    for row in scene.block.control:
        if row.point == "p1":
            given = row.xyz[at]
            row = replace(row, xyz=tuple(None if k == at else v for k, v in enumerate(row.xyz)))
        rows.append(row)
    without = adjust_block(replace(scene.block, conditions=tied, control=tuple(rows)))
    place = without.problem.points.index("p1")
    adjusted = (without.state.points + without.state.origin)[place, at]
    assert found.difference == pytest.approx(adjusted - given, rel=1e-2, abs=2e-4)
    assert found.s == pytest.approx(sqrt(without.cofactors.points[place, at, at]), rel=1e-3)
    saved = block.vtpv - without.vtpv
    assert found.verdict.known.square == pytest.approx(saved, rel=1e-2, abs=1e-3)
    # one by one the same
    together = control_tests(block)
    monkeypatch.setattr("anaplot.bundle.hypotheses.controltests._MOST", 0)
    for one, other in zip(control_tests(block).points, together.points, strict=True):
        assert one.conditions == other.conditions
        square = other.verdict.known.square
        assert one.verdict.known.square == pytest.approx(square, rel=1e-6)


@pytest.mark.parametrize(
    "dependent",
    [
        ("distance p6 p7", "distance p7 p10", "distance p6 p10", "angle p7 p6 p10"),
        ("distance p6 p7", "distance p7 p6"),
        ("line p5 p6 p7 p8", "line p8 p7 p6 p5"),
    ],
)
@pytest.mark.parametrize("sigma_um", [5.0, 4000.0])
def test_how_well_the_photographs_know_points_does_not_hide_dependence(dependent, sigma_um) -> None:
    # with 4 mm points are known to a hundredth of what the conditions extend over
    scene = flat_scene(sigma_um=sigma_um, control_sigma=0.0)
    conditions = [condition(scene, *one.split(" ", 1), 0.0) for one in dependent]
    good = condition(scene, "distance", "p11 p14", 0.0)
    with pytest.raises(NotComputableError, match="depend on what is free of error") as caught:
        with_conditions(scene, [*conditions, good])
    named = str(caught.value).split(": free of error")[0].split(", ")
    assert named == [one.id for one in conditions]
    # one less, and there is a solution that meets them all
    block = with_conditions(scene, [*conditions[1:], good])
    equations = block.problem.conditions.equations(block.state.points, block.problem.fixed)
    assert np.abs(equations.misclosure).max() < 1e-8


@pytest.mark.parametrize(
    ("kind", "points", "value", "what"),
    [
        ("distance", "1 2 3", 5.0, "3 points"),
        ("distance", "1 1", 5.0, "point 1 twice"),
        ("distance", "1 2", None, "no value"),
        ("distance", "1 2", 0.0, "distance of 0"),
        ("angle", "1 2", 1.0, "2 points"),
        ("angle", "1 2 3", 3.2, "between 0 and pi"),
        ("line", "1 2", None, "at least 3"),
        ("plane", "1 2 3", None, "at least 4"),
        ("plane", "1 2 3 4", 1.0, "a value"),
        ("equal", "1 2", None, "2 points"),
        ("equal", "1 2 3 4 5", None, "5 points"),
        ("equal", "1 2 2 1", None, "same distance"),
        ("line", "1 2 3", None, None),
        ("equal", "1 2 2 3", None, None),
    ],
)
def test_what_no_coordinates_can_make_a_condition(kind, points, value, what) -> None:
    fault = condition_fault(kind, tuple(points.split()), value)
    assert fault is None if what is None else what in str(fault)
