"""A block as a residual system: every column, misclosure and redundancy number against dense R."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial, cube

from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.residuals import block_residuals

CASES: dict[str, dict] = {
    "weighted control": {"scene": {"control_sigma": 0.05}},
    "error-free control": {"scene": {"control_sigma": 0.0}},
    "priors": {"scene": {"control_sigma": 0.1, "priors": True}},
    "free": {"scene": {"control_sigma": 0.1}, "datum": "free"},
    "minimal": {"scene": {"control_sigma": 0.1}, "datum": "minimal"},
    "ebner": {"scene": {"control_sigma": 0.05}, "additional": ("ebner", None)},
    "ebner weighted by strip": {
        "scene": {"control_sigma": 0.05},
        "additional": ("ebner:strip", 10.0),
    },
    "physical weighted by photo": {
        "scene": {"control_sigma": 0.05, "priors": True},
        "additional": ("physical:photo", 5.0),
    },
    "convergent": {"cube": "E"},
}


def adjusted(case):
    if "cube" in case:
        scene = cube(case["cube"], noise_um=5.0)
        shift = (0.05, 0.005)
    else:
        scene = aerial(2, 4, per_base=1, noise_um=5.0, **case["scene"])
        rows = list(scene.block.image_points)
        rows += [replace(r, model="101/102", x=r.x + 0.004) for r in rows if r.photo == "102"][:5]
        scene = scene.with_rows(rows)
        shift = (1.0, 0.001)
    extra = case.get("additional")
    problem = make_problem(
        scene.block,
        datum=case.get("datum", "control"),
        additional=None if extra is None else additional_parameters(*extra),
    )
    return adjust_bundle(problem, scene.start(problem, np.random.default_rng(2), *shift))


def design(system):
    """(n, u) whitened design of all rows, row by row from the derivatives."""
    problem, normal = system.problem, system.cofactors.normal
    linear = normal.linear
    n, d, p = len(problem.photos), problem.per_photo, len(problem.points)
    out = np.zeros((len(system.names), n * d + 3 * p + problem.in_border))
    for ray in range(len(problem.photo)):
        rows = slice(2 * ray, 2 * ray + 2)
        at = problem.photo[ray] * d
        out[rows, at : at + d] = linear.a[ray]
        at = n * d + 3 * problem.point[ray]
        out[rows, at : at + 3] = linear.b[ray]
        q = linear.h.shape[2]
        at = n * d + 3 * p + problem.additional_group[ray] * q
        out[rows, at : at + q] = linear.h[ray]
    first, second, third, _ = system.rows.starts
    for k, (kind, point, axis) in enumerate(system.rows.ground):
        out[first + k, n * d + 3 * point + axis] = 1.0 / problem.ground_sigma[kind, point, axis]
    for k, (photo, unknown) in enumerate(system.rows.priors):
        out[second + k, photo * d : photo * d + d] = linear.photo_rows[photo, unknown]
    for k, number in enumerate(system.rows.additional):
        if problem.photo_invariant:
            photo, index = divmod(int(number), d - 6)
            out[third + k, photo * d + 6 + index] = 1.0 / problem.additional_sigma[photo, index]
        else:
            held = problem.additional_sigma.ravel()[number]
            out[third + k, n * d + 3 * p + number] = 1.0 / held
    return out


def dense(system):
    """R by the singular value decomposition of the scaled design."""
    whole = design(system)
    size = np.linalg.norm(whole, axis=0)
    whole = whole[:, size > 0.0] / size[size > 0.0]
    u, s, _ = np.linalg.svd(whole, full_matrices=False)
    u = u[:, s > 1e-11 * s[0]]
    return np.eye(len(whole)) - u @ u.T


@pytest.mark.parametrize("name", CASES)
def test_columns_equal_the_dense_matrix(name) -> None:
    block = adjusted(CASES[name])
    system = block_residuals(block.problem, block.state, block.cofactors.normal.structure)
    n = len(system.names)
    assert n == block.problem.observations == len(system.rows.sigma) == len(system.rows.units)
    np.testing.assert_allclose(system.design().toarray(), design(system), rtol=1e-12)
    whole = dense(system)
    every = np.arange(n)[::-1]
    np.testing.assert_allclose(system.columns(every), whole[:, every], atol=2e-7)
    np.testing.assert_allclose(
        system.columns(np.array([3, n - 1])), whole[:, [3, n - 1]], atol=2e-7
    )
    np.testing.assert_allclose(system.r, np.diag(whole), atol=2e-7)
    assert system.r.sum() == pytest.approx(system.redundancy, abs=1e-6)
    # at the minimum e is minus the residual (adjusted minus observed)
    np.testing.assert_allclose(system.e[: system.rows.image], -block.v.ravel(), atol=1e-5)
    assert system.vtpv == pytest.approx(block.vtpv, rel=1e-8)
    assert system.columns(np.zeros(0, dtype=np.intp)).shape == (n, 0)


@pytest.mark.parametrize("name", CASES)
def test_away_from_the_minimum_it_is_the_linear_adjustment_there(name) -> None:
    block = adjusted(CASES[name])
    structure = block.cofactors.normal.structure
    state = replace(block.state, points=block.state.points * (1.0 + 1e-5))
    moved = block_residuals(block.problem, state, structure)
    linear = moved.cofactors.normal.linear
    first, second, third, _ = moved.rows.starts
    raw = np.zeros(len(moved.names))
    raw[:first] = -linear.e.ravel()
    raw[first:second] = -linear.point_e[tuple(moved.rows.ground.T)]
    raw[second:third] = -linear.photo_e[tuple(moved.rows.priors.T)]
    own = linear.own_e if block.problem.photo_invariant else linear.shared_e
    raw[third:] = -own.ravel()[moved.rows.additional]
    np.testing.assert_allclose(moved.e, dense(moved) @ raw, atol=2e-7 * max(1.0, abs(raw).max()))


def test_an_error_shows_in_e_with_its_own_sign() -> None:
    case = CASES["priors"]
    block = adjusted(case)
    problem, structure = block.problem, block.cofactors.normal.structure
    before = block_residuals(problem, block.state, structure)
    at = 2 * 7 + 1
    xy = problem.xy.copy()
    xy[7, 1] += 10.0 * problem.sigma[7]
    after = block_residuals(replace(problem, xy=xy), block.state, structure)
    np.testing.assert_allclose(
        after.e - before.e, 10.0 * before.columns(np.array([at]))[:, 0], atol=1e-7
    )
    first = before.rows.starts[0]
    _, point, axis = before.rows.ground[4]
    known = problem.known.copy()
    known[point, axis] += 10.0 * problem.known_sigma[point, axis]
    after = block_residuals(replace(problem, known=known), block.state, structure)
    np.testing.assert_allclose(
        after.e - before.e, 10.0 * before.columns(np.array([first + 4]))[:, 0], atol=1e-7
    )
