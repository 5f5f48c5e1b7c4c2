"""Hypotheses of a block: against dense formulas, other adjustments, and Monte Carlo."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from bundleblocks import aerial, cube
from scipy.linalg import hadamard
from wild import text_of

from anaplot.adjustment.hypothesis import critical_f, f_power, quadratic_form, sidak_alpha
from anaplot.bundle.adjust import adjust_block, adjust_bundle, adjust_problem
from anaplot.bundle.hypotheses import checktests, controltests, parametertests
from anaplot.bundle.hypotheses.blockhypotheses import block_hypotheses
from anaplot.bundle.hypotheses.checktests import check_tests
from anaplot.bundle.hypotheses.controltests import _Control, _given_up, control_tests
from anaplot.bundle.hypotheses.parametertests import parameter_tests
from anaplot.bundle.hypotheses.verdict import HypothesisSettings, VarianceFactor
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors, own_parameter_cofactors
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.block import ControlPoint, TestSettings
from anaplot.photogrammetry.posterior import CoordinateName, Posterior
from anaplot.report.hypotheses import hypotheses_document

pytestmark = pytest.mark.slow


def dense(block):
    """Whitened design of all rows and its unknowns: photos, free coordinates, shared parameters."""
    problem, linear = block.problem, block.cofactors.normal.linear
    n, d, m = len(problem.photos), problem.per_photo, len(problem.photo)
    free = np.argwhere(~problem.fixed)
    column = {(int(p), int(a)): n * d + k for k, (p, a) in enumerate(free)}
    u = n * d + len(free) + problem.in_border
    rows, e = [], []
    for ray in range(m):
        for axis in range(2):
            row = np.zeros(u)
            photo, point = problem.photo[ray], int(problem.point[ray])
            row[photo * d : photo * d + d] = linear.a[ray, axis]
            for k in range(3):
                if (point, k) in column:
                    row[column[point, k]] = linear.b[ray, axis, k]
            if problem.in_border:
                q = linear.h.shape[2]
                first = u - problem.in_border + problem.additional_group[ray] * q
                row[first : first + q] = linear.h[ray, axis]
            rows.append(row)
            e.append(linear.e[ray, axis])
    for point, axis in np.argwhere(np.isfinite(problem.known_sigma)):
        row = np.zeros(u)
        row[column[int(point), int(axis)]] = 1.0 / problem.known_sigma[point, axis]
        rows.append(row)
        e.append(linear.point_e[0, point, axis])
    for k in range(len(linear.shared_weight)):
        if linear.shared_weight[k] > 0.0:
            row = np.zeros(u)
            row[u - problem.in_border + k] = np.sqrt(linear.shared_weight[k])
            rows.append(row)
            e.append(linear.shared_e[k])
    return np.array(rows), np.array(e), column


def with_control(scene, *, given=0.0, check=(), seed=3, stated=None):
    """Disturb the control by its sigma or `given`, and make some points check points."""
    rng = np.random.default_rng(seed)
    rows = []
    for row in scene.block.control:
        spread = np.array(row.sigma) if given == 0.0 else given
        xyz = tuple((np.array(row.xyz) + rng.normal(size=3) * spread).tolist())
        rows.append(replace(row, xyz=xyz))
    for name, sigma in check:
        xyz = tuple((scene.points[name] + rng.normal(size=3) * sigma).tolist())
        rows.append(ControlPoint(name, xyz, stated or (sigma,) * 3, "check"))
    return replace(scene.block, control=tuple(rows))


@lru_cache(maxsize=1)
def small():
    """Two strips of three, noise of 5 um, control of 2 cm, four check points of 1 cm."""
    scene = aerial(2, 3, per_base=2, noise_um=5.0, control_sigma=0.02)
    held = {row.point for row in scene.block.control}
    names = [n for n in scene.points if n not in held][2::7][:4]
    return adjust_block(with_control(scene, check=[(n, 0.01) for n in names], seed=8))


@lru_cache(maxsize=1)
def calibrated():
    """The same kind of block with Ebner's parameters, and their image error planted."""
    scene = aerial(
        2, 4, per_base=2, noise_um=5.0, distort=lambda x, y: (0.012 * x * y / 90.0**2, 0.0)
    )
    return adjust_block(scene.block, additional=additional_parameters("ebner"))


# --- cofactors between unknowns -------------------------------------------------------------


def test_cofactors_between_points_are_those_of_the_whole_inverse() -> None:
    block = small()
    design, _, column = dense(block)
    q = np.linalg.inv(design.T @ design)
    wanted = [(0, 0), (7, 2), (7, 1), (12, 0)]
    index = [column[c] for c in wanted]
    found = coordinate_cofactors(block, wanted)
    np.testing.assert_allclose(found, q[np.ix_(index, index)], rtol=1e-6, atol=1e-10)
    np.testing.assert_allclose(
        coordinate_cofactors(block, [(5, 0), (5, 1), (5, 2)]), block.cofactors.points[5], rtol=1e-8
    )


def test_cofactors_of_parameters_of_photos() -> None:
    scene = aerial(1, 3, per_base=2, noise_um=5.0)
    block = adjust_block(scene.block, additional=additional_parameters("physical:photo", 10.0))
    q = own_parameter_cofactors(block)
    for k in range(3):
        part = slice(10 * k, 10 * k + 10)
        np.testing.assert_allclose(q[part, part], block.cofactors.photos[k, 6:, 6:], rtol=1e-7)
    np.testing.assert_allclose(q, q.T)


# --- additional parameters ------------------------------------------------------------------


def test_all_parameters_are_what_leaving_them_out_costs() -> None:
    block = calibrated()
    found = parameter_tests(block)
    bare = adjust_block(block.problem.block)
    test = found.everything.estimated
    # the adjustments are not linear; the parameters are
    assert test.square == pytest.approx(bare.vtpv - block.vtpv, rel=2e-3)
    assert test.dimension == 12 == bare.redundancy - block.redundancy
    assert test.redundancy == block.redundancy
    assert test.sigma == pytest.approx(block.sigma0)
    assert found.everything.rejected
    assert found.everything.known.significance < 1e-3


def test_the_planted_parameter_is_found_and_the_others_are_not() -> None:
    found = parameter_tests(calibrated())
    rejected = [row.name for row in found.parameters if row.verdict.rejected]
    assert rejected == ["b4"]
    assert {name for _, name in found.removable} == {f"b{k}" for k in range(1, 13)} - {"b4"}
    [row] = [row for row in found.parameters if row.name == "b4"]
    assert row.value > 5 * row.s


def test_single_parameters_by_dense_formulas() -> None:
    block = calibrated()
    found = parameter_tests(block)
    design, _, _ = dense(block)
    q = np.linalg.inv(design.T @ design)[-12:, -12:]
    inverse = np.linalg.inv(q)
    n = np.diag(design.T @ design)[-12:]
    z = block.state.shared
    alpha = sidak_alpha(0.05, 12)
    for k, row in enumerate(found.parameters):
        assert row.s == pytest.approx(np.sqrt(q[k, k]), rel=1e-6)
        assert row.inflation == pytest.approx(q[k, k] * inverse[k, k], rel=1e-5)
        assert row.kept == pytest.approx(1.0 / (q[k, k] * n[k]), rel=1e-6)
        assert row.verdict.estimated.alpha == pytest.approx(alpha)
        t = z[k] / (block.sigma0 * np.sqrt(q[k, k]))
        assert row.verdict.estimated.statistic == pytest.approx(t * t, rel=1e-6)
        size = quadratic_form(np.array([row.mdb]), q[k : k + 1, k : k + 1])
        assert f_power(size, alpha, 1, block.redundancy) == pytest.approx(0.80, abs=1e-6)
        assert row.power == pytest.approx(
            f_power(0.005**2 / q[k, k], alpha, 1, block.redundancy), rel=1e-5
        )
    assert sum(c.value**2 for c in found.orthogonal) == pytest.approx(
        found.everything.known.square, rel=1e-6
    )


def with_and_without(scene, source, additional=None):
    """The block without a row of its image points, and with that row rejected."""
    rows = scene.block.image_points
    left = replace(scene.block, image_points=rows[:source] + rows[source + 1 :])
    problem = make_problem(scene.block, additional=additional)
    rejected = np.repeat((problem.source == source)[:, None], 2, axis=1)
    return (
        adjust_block(left, additional=additional),
        adjust_problem(replace(problem, rejected=rejected)),
    )


def test_a_rejected_ray_tells_nothing_of_the_parameters() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0)
    names = [row.point for row in scene.block.image_points]
    source = next(k for k, name in enumerate(names) if names.count(name) >= 4)
    blocks = with_and_without(scene, source, additional_parameters("ebner"))
    for one, other in zip(*(parameter_tests(b).parameters for b in blocks), strict=True):
        assert other.s == pytest.approx(one.s, rel=1e-6)
        assert other.kept == pytest.approx(one.kept, rel=1e-6)


def test_a_correlated_set_in_pairs_and_taken_apart() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0)
    block = adjust_block(scene.block, additional=additional_parameters("physical", 200.0))
    found = parameter_tests(block)
    names = [{first[1], second[1]} for first, second, *_ in found.pairs]
    assert {"k1", "k2"} in names
    assert {"k2", "k3"} in names
    q, z = block.cofactors.shared, block.state.shared
    labels = block.problem.additional.set.names
    alpha = sidak_alpha(0.05, len(found.pairs))
    for pair in found.pairs:
        mine = [labels.index(pair.first[1]), labels.index(pair.second[1])]
        part = q[np.ix_(mine, mine)]
        assert pair.correlation == pytest.approx(part[0, 1] / np.sqrt(part[0, 0] * part[1, 1]))
        square = z[mine] @ np.linalg.solve(part, z[mine])
        assert pair.verdict.known.square == pytest.approx(square, rel=1e-6)
        assert pair.verdict.known.dimension == 2
        assert pair.verdict.known.alpha == pytest.approx(alpha)
    [radial] = [s for s in found.sets if ("block", "k1") in s.members]
    assert {"k1", "k2", "k3"} <= {name for _, name in radial.members}
    for parts in (radial.sequential, radial.principal):
        assert sum(p.value**2 for p in parts) == pytest.approx(
            radial.verdict.known.square, rel=1e-6
        )
    # the middle one is explained best by its neighbours
    assert radial.sequential[0].parameter[1] == "k2"
    assert any("weighted" in remark for remark in found.remarks)


@pytest.mark.parametrize("scope", ["strip", "photo"])
def test_groups_of_parameters(scope, monkeypatch) -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0)
    block = adjust_block(scene.block, additional=additional_parameters(f"ebner:{scope}", 10.0))
    found = parameter_tests(block)
    count = 2 if scope == "strip" else 8
    assert len(found.groups) == count
    assert len(found.parameters) == 12 * count
    assert found.everything.known.dimension == 12 * count
    assert found.everything.rejected is False
    for group in found.groups:
        assert group.verdict.known.dimension == 12
        assert group.verdict.known.square <= found.everything.known.square * (1 + 1e-9)
    if scope == "photo":
        monkeypatch.setattr(parametertests, "_JOINT", 50)
        apart = parameter_tests(block)
        assert apart.everything is None
        assert apart.removable is None
        assert any("photo by photo" in remark for remark in apart.remarks)
        for one, other in zip(found.groups, apart.groups, strict=True):
            assert one.verdict.known.square == pytest.approx(other.verdict.known.square, rel=1e-6)


def test_a_set_that_repeats_itself_is_tested_one_by_one() -> None:
    block = calibrated()
    shared = block.cofactors.shared.copy()
    shared[1] = shared[0] * 0.999999999999
    shared[:, 1] = shared[:, 0]
    shared[1, 1] = shared[0, 0]
    poor = replace(block, cofactors=replace(block.cofactors, shared=shared))
    found = parameter_tests(poor)
    assert found.everything is None
    assert found.removable is None
    assert found.sets == ()
    assert all(row.inflation is None for row in found.parameters)
    assert any("repeat each other" in remark for remark in found.remarks)
    assert len(found.parameters) == 12


def test_without_parameters_there_is_no_test() -> None:
    assert parameter_tests(small()) is None


# --- check points ---------------------------------------------------------------------------


def test_check_points_by_dense_formulas() -> None:
    block = small()
    found = check_tests(block)
    design, _, column = dense(block)
    q = np.linalg.inv(design.T @ design)
    rows = [r for r in block.problem.block.control if r.use == "check"]
    at = {name: k for k, name in enumerate(block.problem.points)}
    index = [column[at[r.point], axis] for r in rows for axis in range(3)]
    covariance = q[np.ix_(index, index)] + np.eye(len(index)) * 0.01**2
    d = np.concatenate([block.state.points[at[r.point]] + block.state.origin - r.xyz for r in rows])
    every = found.groups[0]
    assert every.axes == "XYZ"
    assert every.coordinates == 12
    assert every.rms == pytest.approx(np.sqrt(np.mean(d**2)))
    assert every.expected == pytest.approx(np.sqrt(np.trace(covariance) / 12), rel=1e-6)
    square = d @ np.linalg.solve(covariance, d)
    assert every.verdict.known.square == pytest.approx(square, rel=1e-6)
    assert every.verdict.estimated.statistic == pytest.approx(
        square / 12 / block.sigma0**2, rel=1e-6
    )
    assert [g.axes for g in found.groups] == ["XYZ", "XY", "X", "Y", "Z"]
    plan = [k for k in range(12) if k % 3 < 2]
    assert found.groups[1].verdict.known.square == pytest.approx(
        d[plan] @ np.linalg.solve(covariance[np.ix_(plan, plan)], d[plan]), rel=1e-6
    )
    for k, row in enumerate(found.coordinates):
        assert row.s == pytest.approx(np.sqrt(covariance[k, k]), rel=1e-6)
        assert np.hypot(row.s_block, row.s_given) == pytest.approx(row.s)
        assert row.s_given == pytest.approx(0.01)
        assert row.verdict.estimated.alpha == pytest.approx(sidak_alpha(0.05, 12))
    third = slice(6, 9)
    assert found.points[2].verdict.known.square == pytest.approx(
        d[third] @ np.linalg.solve(covariance[third, third], d[third]), rel=1e-6
    )
    mine = found.parts[4:6]
    assert [(one.part, one.coordinates) for one in mine] == [("plan", 2), ("height", 1)]
    for one, members in zip(mine, ([6, 7], [8]), strict=True):
        part = covariance[np.ix_(members, members)]
        assert one.s == pytest.approx(np.sqrt(np.trace(part)), rel=1e-6)
        assert one.verdict.known.square == pytest.approx(
            d[members] @ np.linalg.solve(part, d[members]), rel=1e-6
        )
        assert one.verdict.known.alpha == pytest.approx(sidak_alpha(0.05, 8))
    assert mine[0].difference == pytest.approx(np.hypot(d[6], d[7]))
    assert mine[1].difference == pytest.approx(d[8])
    table = hypotheses_document(block_hypotheses(block)).to_dict()["plan_and_height"]
    told = next(one for one in table if one["point"] == mine[0].point)
    assert (told["use"], told["plan"], told["height"]) == ("check", *(p.difference for p in mine))
    assert told["P_height"] == mine[1].verdict.decisive.significance
    # a deformation term by generalised least squares
    height = [2, 5, 8, 11]
    p = np.linalg.inv(covariance[np.ix_(height, height)])
    [shift] = [r for r in found.deformations if (r.axis, r.term) == ("Z", "shift")]
    assert shift.size == pytest.approx((p @ d[height]).sum() / p.sum(), rel=1e-5)
    assert shift.s == pytest.approx(p.sum() ** -0.5, rel=1e-6)
    assert {r.term for r in found.deformations} == {
        "shift",
        "slope along X",
        "slope along Y",
        "bowl",
    }


def test_many_check_points_are_tested_one_by_one(monkeypatch) -> None:
    block = small()
    found = check_tests(block)
    monkeypatch.setattr(checktests, "_MOST", 5)
    apart = check_tests(block)
    assert apart.groups == ()
    assert "one by one" in apart.remarks[0]
    for one, other in zip(found.points, apart.points, strict=True):
        assert one.verdict.known.square == pytest.approx(other.verdict.known.square, rel=1e-7)


def test_a_wrong_check_coordinate_is_found() -> None:
    block = small()
    rows = list(block.problem.block.control)
    k = next(k for k, r in enumerate(rows) if r.use == "check")
    x, y, z = rows[k].xyz
    rows[k] = replace(rows[k], xyz=(x + 1.0, y, z), sigma=(0.01, None, 0.0))
    found = check_tests(adjust_block(replace(block.problem.block, control=tuple(rows))))
    assert found.groups[0].verdict.rejected
    assert [(c.point, c.axis) for c in found.coordinates if c.verdict.rejected] == [
        (rows[k].point, "X")
    ]
    mine = [c for c in found.coordinates if c.point == rows[k].point]
    assert [c.s_given for c in mine] == pytest.approx([0.01, 0.05, 0.0], abs=1e-12)


def test_check_points_with_single_coordinates_and_none() -> None:
    block = small()
    rows = [
        replace(r, xyz=(None, None, r.xyz[2])) if r.use == "check" else r
        for r in block.problem.block.control
    ]
    rows.append(ControlPoint("nowhere", (0.0, 0.0, 0.0), use="check"))
    found = check_tests(adjust_block(replace(block.problem.block, control=tuple(rows))))
    assert [g.axes for g in found.groups] == ["Z"]
    assert found.remarks == ("check points that are not in the adjustment: nowhere",)
    assert len(found.coordinates) == 4
    bare = [r for r in rows if r.use == "control"]
    assert check_tests(adjust_block(replace(block.problem.block, control=tuple(bare)))) is None
    # another datum does not lie in the system of the check points
    assert check_tests(adjust_block(block.problem.block, datum="free")) is None


def test_check_coordinates_free_of_error_at_points_free_of_error_are_named() -> None:
    scene = aerial(2, 3, per_base=2, noise_um=5.0, control_sigma=0.02)
    held = {row.point for row in scene.block.control}
    firm, other = [name for name in scene.points if name not in held][2:9:6]
    names = tuple(CoordinateName("point", firm, axis) for axis in "XYZ")
    given = Posterior(names, np.array(scene.points[firm]), np.zeros((3, 3)))
    checks = [
        ControlPoint(name, tuple(scene.points[name].tolist()), (0.0, 0.01, 0.0), "check")
        for name in (firm, other)
    ]
    block = replace(scene.block, control=(*scene.block.control, *checks), given=given)
    found = check_tests(adjust_block(block))
    assert found.remarks == (
        "check coordinates free of error at points free of error are not tested: "
        f"X of {firm}, Z of {firm}",
    )
    tested = [(c.point, c.axis) for c in found.coordinates]
    assert tested == [(firm, "Y"), *((other, axis) for axis in "XYZ")]


def test_check_points_all_of_which_are_missing_are_told() -> None:
    block = small().problem.block
    rows = [row for row in block.control if row.use == "control"]
    rows.append(ControlPoint("nowhere", (0.0, 0.0, 0.0), use="check"))
    adjusted = adjust_block(replace(block, control=tuple(rows)))
    found = check_tests(adjusted)
    assert found.coordinates == ()
    assert found.remarks == ("check points that are not in the adjustment: nowhere",)
    text = text_of(hypotheses_document(block_hypotheses(adjusted)))
    assert "check points that are not in the adjustment: nowhere" in text
    assert "0 of 0" not in text


# --- control --------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.02, 0.0])
def test_all_control_is_what_the_free_network_saves(sigma) -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=sigma)
    declared = with_control(scene, given=0.01)
    block = adjust_block(declared)
    free = adjust_block(declared, datum="free")
    found = control_tests(block)
    every = found.groups[0]
    assert every.what == "all"
    assert every.coordinates == 18
    assert every.conditions == 18 - 7 == block.redundancy - free.redundancy
    test = every.verdict.estimated
    assert test.square == pytest.approx(block.vtpv - free.vtpv, rel=1e-3)
    assert test.redundancy == free.redundancy
    assert test.sigma == pytest.approx(free.sigma0, rel=1e-4)
    # heights alone still hold the tilts, and by the relief the scale; plan alone all but a shift
    assert [(g.what, g.conditions) for g in found.groups[1:]] == [("plan", 9), ("heights", 5)]
    assert all(c.fixed == (sigma == 0.0) for c in found.coordinates)


@pytest.mark.parametrize("sigma", [0.02, 0.0])
def test_a_control_point_is_tested_like_a_check_point(sigma) -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=sigma)
    declared = with_control(scene, given=0.02)
    block = adjust_block(declared)
    name = declared.control[1].point
    [mine] = [p for p in control_tests(block).points if p.point == name]
    rows = [replace(r, use="check") if r.point == name else r for r in declared.control]
    other = adjust_block(replace(declared, control=tuple(rows)))
    [check] = check_tests(other).points
    assert mine.conditions == 3
    assert mine.verdict.known.square == pytest.approx(check.verdict.known.square, rel=2e-3)
    assert mine.verdict.estimated.sigma == pytest.approx(other.sigma0, rel=1e-5)
    assert mine.verdict.estimated.redundancy == other.redundancy
    # its height alone given up
    x, y, z = declared.control[1].xyz
    height = ControlPoint(name, (None, None, z), (None, None, sigma), "check")
    plan = ControlPoint(name, (x, y, None), (sigma, sigma, None))
    rows = [plan if r.point == name else r for r in declared.control]
    without = adjust_block(replace(declared, control=tuple(rows)))
    [given] = [p for p in control_tests(block).parts if p[:2] == (name, "height")]
    k = without.problem.points.index(name)
    difference = without.state.points[k][2] + without.state.origin[2] - z
    s = np.hypot(np.sqrt(without.cofactors.points[k][2, 2]), declared.sigma_of(height)[2])
    assert (given.difference, given.s) == pytest.approx((difference, s), rel=2e-3)


def test_a_control_coordinate_given_up_by_dense_formulas() -> None:
    block = small()
    design, e, _ = dense(block)
    project = np.eye(len(e)) - design @ np.linalg.inv(design.T @ design) @ design.T
    found = control_tests(block)
    first = 2 * len(block.problem.photo)
    at = np.argwhere(np.isfinite(block.problem.known_sigma))
    for row in found.coordinates:
        k = block.problem.points.index(row.point)
        i = first + [tuple(x) for x in at.tolist()].index((k, "XYZ".index(row.axis)))
        r, sigma = project[i, i], 0.02
        assert row.difference == pytest.approx(sigma * e[i] / r, rel=1e-5)
        assert row.s == pytest.approx(sigma / np.sqrt(r), rel=1e-5)
        left = block.vtpv - e[i] ** 2 / r
        wanted = e[i] ** 2 / r / (left / (block.redundancy - 1))
        assert row.verdict.estimated.statistic == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize("sigma", [0.02, 0.0])
def test_a_rejected_ray_tells_nothing_of_the_control(sigma) -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=sigma)
    point = scene.block.control[0].point
    source = next(k for k, row in enumerate(scene.block.image_points) if row.point == point)
    blocks = with_and_without(scene, source)
    for one, other in zip(*(control_tests(b).coordinates for b in blocks), strict=True):
        assert other.difference == pytest.approx(one.difference, rel=1e-5)
        assert other.s == pytest.approx(one.s, rel=1e-6)


@pytest.mark.parametrize("sigma", [0.02, 0.0])
def test_much_control_is_tested_point_by_point(sigma, monkeypatch) -> None:
    scene = aerial(2, 3, per_base=2, noise_um=5.0, control_sigma=sigma)
    block = adjust_block(with_control(scene, given=0.02))
    found = control_tests(block)
    monkeypatch.setattr(controltests, "_MOST", 5)
    apart = control_tests(block)
    assert apart.groups == ()
    assert "one by one" in apart.remarks[0]
    for one, other in zip(found.points, apart.points, strict=True):
        assert one.verdict.known.square == pytest.approx(other.verdict.known.square, rel=1e-6)
    for one, other in zip(found.coordinates, apart.coordinates, strict=True):
        assert one.difference == pytest.approx(other.difference, rel=1e-6)


@pytest.mark.parametrize("datum", ["free", "minimal"])
@pytest.mark.parametrize("sigma", [0.02, 0.0])
def test_a_network_without_control_meets_the_same_test(datum, sigma) -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=sigma)
    declared = with_control(scene, given=0.02)
    held = control_tests(adjust_block(declared)).groups
    free = adjust_block(declared, datum=datum)
    found = control_tests(free)
    for one, other in zip(held, found.groups, strict=True):
        assert (one.what, one.conditions) == (other.what, other.conditions)
        # of a linear model they are the same number
        assert other.verdict.known.square == pytest.approx(one.verdict.known.square, rel=5e-3)
    assert found.groups[0].verdict.estimated.redundancy == free.redundancy
    # one coordinate is off, and it is named
    rows = list(declared.control)
    x, y, z = rows[2].xyz
    rows[2] = replace(rows[2], xyz=(x, y + 1.0, z))
    wrong = control_tests(adjust_block(replace(declared, control=tuple(rows)), datum=datum))
    assert wrong.groups[0].verdict.rejected
    worst = max(wrong.coordinates, key=lambda c: c.verdict.known.square)
    assert (worst.point, worst.axis) == (rows[2].point, "Y")
    assert worst.difference == pytest.approx(-1.0, abs=4 * worst.s)


def test_a_network_and_too_little_control(monkeypatch) -> None:
    scene = aerial(2, 3, per_base=2, noise_um=5.0)
    few = replace(scene.block, control=scene.block.control[:2])
    found = control_tests(adjust_block(few, datum="free"))
    # two full points: one distance more than nothing... their scale is the datum's own
    assert found.groups[0].conditions == 0
    heights = [replace(r, xyz=(None, None, r.xyz[2])) for r in scene.block.control]
    plane = control_tests(adjust_block(replace(scene.block, control=tuple(heights)), datum="free"))
    # six heights: a shift and two tilts are the datum's own, and its scale by the relief
    assert plane.groups[0].conditions == 2
    bare = adjust_block(replace(scene.block, control=()), datum="free")
    assert control_tests(bare) is None
    monkeypatch.setattr(controltests, "_MOST", 5)
    many = control_tests(adjust_block(scene.block, datum="free"))
    assert many.coordinates == ()
    assert "not tested" in many.remarks[0]


def test_heights_alone_are_no_plan_and_heights() -> None:
    scene = aerial(2, 3, noise_um=5.0, control_sigma=0.02, priors=True)
    heights = [
        replace(r, xyz=(None, None, r.xyz[2]), sigma=(None, None, 0.02))
        for r in scene.block.control
    ]
    found = control_tests(adjust_block(replace(scene.block, control=tuple(heights))))
    assert [(g.what, g.coordinates, g.conditions) for g in found.groups] == [("all", 6, 6)]


def test_what_only_control_determines_is_not_tested() -> None:
    """Two nearly normal photos of a cube: its calibration comes from the control."""
    scene = cube("A", noise_um=0.1, sigma_um=0.1)
    block = adjust_block(scene.block, additional=additional_parameters("physical:camera"))
    found = control_tests(block)
    assert found.groups[0].conditions == 10
    assert found.groups[0].verdict.rejected is False
    assert any("conditions are not tested together" in remark for remark in found.remarks)


def test_minimal_control_only_holds_the_datum() -> None:
    scene = aerial(2, 3, per_base=2, noise_um=5.0, control_sigma=0.02)
    a, b, c = scene.block.control[0], scene.block.control[2], scene.block.control[4]
    c = replace(c, xyz=(None, None, c.xyz[2]))
    found = control_tests(adjust_block(replace(scene.block, control=(a, b, c))))
    assert found.groups[0].conditions == 0
    assert found.groups[0].verdict is None
    assert all(row.verdict is None and row.difference is None for row in found.coordinates)
    assert all(one.verdict is None and one.difference is None for one in found.parts)
    assert any("checked by nothing" in remark for remark in found.remarks)


def test_a_wrong_control_point_free_of_error_is_found() -> None:
    scene = cube("B", noise_um=5.0, sigma_um=5.0)
    rows = list(scene.block.control)
    x, y, z = rows[3].xyz
    rows[3] = replace(rows[3], xyz=(x, y, z + 0.02))
    found = control_tests(adjust_block(replace(scene.block, control=tuple(rows))))
    assert found.groups[0].verdict.rejected
    worst = min(found.coordinates, key=lambda c: c.verdict.estimated.significance)
    assert (worst.point, worst.axis) == (rows[3].point, "Z")
    assert worst.fixed
    assert worst.difference == pytest.approx(-0.02, abs=4 * worst.s)
    assert any("free of error" in remark for remark in found.remarks)


# --- sizes and powers by Monte Carlo --------------------------------------------------------


def rate_is(rate: float, wanted: float, runs: int) -> bool:
    return abs(rate - wanted) < 4.0 * np.sqrt(wanted * (1.0 - wanted) / runs)


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_size_and_power_of_the_parameters(kind) -> None:
    """The whole way: noise in the image coordinates, adjustment, tests."""
    runs = 100
    rng = np.random.default_rng(31)
    scene = aerial(1, 3, per_base=2, test=TestSettings(kind=kind))
    chosen = additional_parameters("physical", 20.0)
    flat = replace(
        chosen,
        set=replace(chosen.set, names=("p1", "p2"), basis=_two(chosen.set.basis), lens=False),
    )
    flat = replace(flat, sigma_um=None)
    problem = make_problem(scene.block, additional=flat)
    q = adjust_bundle(problem, scene.start(problem)).cofactors.shared
    # large enough to be found in about half of the runs
    size = 2.4 * np.sqrt(q[0, 0])
    counts = {0.0: [0, 0], size: [0, 0]}
    wanted = {}
    for planted in counts:
        for _ in range(runs):
            xy = scene_xy(problem, scene) + rng.normal(size=problem.xy.shape) * 0.005
            xy = xy + problem.basis[:, :, 0] * planted
            block = adjust_bundle(replace(problem, xy=xy), scene.start(problem))
            found = parameter_tests(block)
            counts[planted][0] += bool(found.everything.rejected)
            counts[planted][1] += any(p.verdict.rejected for p in found.parameters)
        degrees = None if kind == "baarda" else block.redundancy
        wanted[planted] = f_power(quadratic_form(np.array([planted, 0.0]), q), 0.05, 2, degrees)
    assert wanted[0.0] == pytest.approx(0.05)
    assert 0.4 < wanted[size] < 0.8
    for planted, (together, _) in counts.items():
        assert rate_is(together / runs, wanted[planted], runs)
    assert rate_is(counts[0.0][1] / runs, 0.05, runs)


def _two(basis):
    def two(x, y, b, c):
        return basis(x, y, b, c)[:, :, 6:8]

    return two


def scene_xy(problem, scene):
    """Image coordinates without error, in the order of the problem's rays."""
    rows = scene.block.image_points
    return np.array([(rows[k].x, rows[k].y) for k in problem.source])


@pytest.mark.parametrize("sigma", [0.03, 0.0])
def test_size_of_the_tests_of_check_points_and_control(sigma) -> None:
    """Noise in image, control and check coordinates, adjustment, tests."""
    runs, alpha = 250, 0.05
    scene = aerial(1, 3, per_base=2, control_sigma=sigma)
    held = {row.point for row in scene.block.control}
    names = [n for n in scene.points if n not in held][1::5][:3]
    rng = np.random.default_rng(41)
    settings = HypothesisSettings(alpha)
    counts = np.zeros(4)
    declared = with_control(scene, given=1e-12, check=[(n, 0.0) for n in names], stated=(0.02,) * 3)
    for _ in range(runs):
        rows = []
        for row in declared.control:
            spread = 0.02 if row.use == "check" else sigma
            xyz = tuple((np.array(row.xyz) + rng.normal(size=3) * spread).tolist())
            rows.append(replace(row, xyz=xyz))
        problem = make_problem(replace(declared, control=tuple(rows)))
        xy = scene_xy(problem, scene) + rng.normal(size=problem.xy.shape) * 0.005
        block = adjust_bundle(replace(problem, xy=xy), scene.start(problem))
        check, control = check_tests(block, settings), control_tests(block, settings)
        counts += [
            check.groups[0].verdict.rejected,
            any(c.verdict.rejected for c in check.coordinates),
            control.groups[0].verdict.rejected,
            any(c.verdict.rejected for c in control.coordinates),
        ]
    rates = counts / runs
    assert rate_is(rates[0], alpha, runs)
    assert rate_is(rates[2], alpha, runs)
    # families of dependent tests keep their significance from above
    assert rates[1] < alpha + 4.0 * np.sqrt(alpha * (1 - alpha) / runs)
    assert rates[3] < alpha + 4.0 * np.sqrt(alpha * (1 - alpha) / runs)


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_detectable_errors_are_detected_with_the_power(kind) -> None:
    """An error of the stated size in a control and in a check coordinate, found in 80 of 100."""
    runs, power = 100, 0.80
    scene = aerial(1, 3, per_base=2, control_sigma=0.03, test=TestSettings(kind=kind))
    held = {row.point for row in scene.block.control}
    name = next(n for n in scene.points if n not in held)
    rng = np.random.default_rng(43)
    declared = with_control(scene, given=1e-12, check=[(name, 0.0)], stated=(0.02,) * 3)
    start = adjust_bundle(make_problem(declared), scene.start(make_problem(declared)))
    target = [(declared.control[1].point, "X"), (name, "Y")]
    sizes = [
        next(c for c in control_tests(start).coordinates if (c.point, c.axis) == target[0]),
        next(c for c in check_tests(start).coordinates if (c.point, c.axis) == target[1]),
    ]
    counts = np.zeros(2)
    for _ in range(runs):
        rows = []
        for row in declared.control:
            at = np.array(row.xyz) + rng.normal(size=3) * np.array(row.sigma)
            if row.point == target[0][0]:
                at[0] += sizes[0].mdb
            elif row.point == target[1][0]:
                at[1] += sizes[1].mdb
            rows.append(replace(row, xyz=tuple(at.tolist())))
        clean = [
            r if r.point != target[0][0] else replace(r, xyz=_moved(r, -sizes[0].mdb)) for r in rows
        ]
        for which, given in enumerate((rows, clean)):
            problem = make_problem(replace(declared, control=tuple(given)))
            noise = rng.normal(size=problem.xy.shape) * 0.005
            block = adjust_bundle(
                replace(problem, xy=scene_xy(problem, scene) + noise), scene.start(problem)
            )
            tests = (control_tests if which == 0 else check_tests)(block).coordinates
            found = next(c for c in tests if (c.point, c.axis) == target[which])
            counts[which] += bool(found.verdict.rejected)
    assert rate_is(counts[0] / runs, power, runs)
    assert rate_is(counts[1] / runs, power, runs)


def _moved(row, by):
    x, y, z = row.xyz
    return (x + by, y, z)


# --- settings, variance, all together -------------------------------------------------------


def test_settings_and_variance() -> None:
    for bad in ({"alpha": 0.0}, {"alpha": 0.9}, {"power": 1.0}):
        with pytest.raises(ValueError, match="must lie"):
            HypothesisSettings(**bad)
    tau = VarianceFactor(30.0, 20, False)
    assert tau.sigma == pytest.approx(np.sqrt(1.5))
    assert tau.degrees == 20
    assert tau.without(10.0, 4) == VarianceFactor(20.0, 16, False)
    assert tau.without(10.0, 20).sigma is None
    verdict = tau.without(10.0, 20).test(3.0, 1, 0.05)
    assert verdict.estimated is None
    assert verdict.decisive is None
    assert verdict.rejected is None
    assert VarianceFactor(1e-20, 20, False).sigma is None  # rounding
    baarda = VarianceFactor(30.0, 20, True)
    assert baarda.degrees is None
    assert baarda.used == 1.0
    assert baarda.test(9.0, 1, 0.05).rejected
    limit = critical_f(0.05, 1, 20) * 1.5
    assert tau.test(limit * 1.001, 1, 0.05).rejected
    assert not tau.test(limit * 0.999, 1, 0.05).rejected


def test_without_redundancy_errors_are_detectable_by_the_known_sigma0() -> None:
    nothing = VarianceFactor(0.0, 0, False)
    assert nothing.degrees is None
    # (3.2905 + 0.8416)^2, of the normal distribution
    assert nothing.detectable(0.001, 0.8) == pytest.approx(17.0746, abs=1e-3)


def test_the_hypotheses_of_a_block() -> None:
    found = block_hypotheses(small(), HypothesisSettings(0.01))
    assert found.additional is None
    assert found.check.groups[0].verdict.known.alpha == 0.01
    assert found.control.groups[0].verdict.known.alpha == 0.01
    free = block_hypotheses(adjust_block(small().problem.block, datum="free"))
    assert (free.additional, free.check) == (None, None)
    assert free.control.against == "network"


@pytest.mark.parametrize(
    ("small", "weak"),
    [
        ((-4e-12, 5e-13, 4e-11), 0),  # of a drone block of 24 000 rays: rounding of the datum
        ((-2e-15, 1e-15, 4e-11), 1),
        ((-2e-12, 5e-13, 1e-9), 1),
        ((-2e-12, 5e-13, 1e-7), 1),
        ((1e-15, 2e-15, 1e-4), 0),
    ],
)
def test_what_rounding_leaves_of_the_datum_is_no_weak_condition(
    small: tuple[float, ...], weak: int
) -> None:
    values = np.array([*small, 0.3, 0.4, 0.5, 1.0, 2.0])
    turn = hadamard(8) / np.sqrt(8.0)  # all diagonals are equal
    control = _Control(
        [(k, 0) for k in range(8)],
        np.zeros(8, dtype=bool),
        np.ones(8),
        (turn * values) @ turn.T,
        np.ones(8),
    )
    found = _given_up(control, list(range(8)))
    assert found.weak == weak
    assert found.conditions == 5 + (small[-1] > 1e-5)
