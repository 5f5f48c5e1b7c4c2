"""Every cofactor and redundancy number against the dense formula, on small blocks of all kinds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial, cube
from denseblock import dense, dense_inverse, held_inverse

from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.reliability import cofactor_column

CASES: dict[str, dict] = {
    "weighted control": {"scene": {"control_sigma": 0.05}},
    "error-free control": {"scene": {"control_sigma": 0.0}},
    "priors": {"scene": {"control_sigma": 0.1, "priors": True}},
    "ebner": {"scene": {"control_sigma": 0.05}, "additional": ("ebner", None)},
    "ebner weighted by strip": {
        "scene": {"control_sigma": 0.05},
        "additional": ("ebner:strip", 10.0),
    },
    "physical weighted by photo": {
        "scene": {"control_sigma": 0.05, "priors": True},
        "additional": ("physical:photo", 5.0),
    },
}


def adjusted(case, **options):
    scene = aerial(2, 4, per_base=1, noise_um=5.0, **case["scene"])
    rows = list(scene.block.image_points)
    # some rays twice, as measured in two models
    rows += [replace(r, model="101/102", x=r.x + 0.004) for r in rows if r.photo == "102"][:5]
    scene = scene.with_rows(rows)
    extra = case.get("additional")
    problem = make_problem(
        scene.block,
        additional=None if extra is None else additional_parameters(*extra),
        **options,
    )
    return adjust_bundle(problem, scene.start(problem, np.random.default_rng(2), 1.0, 0.001))


@pytest.mark.parametrize("name", CASES)
def test_everything_equals_the_dense_formula(name) -> None:
    block = adjusted(CASES[name])
    problem, found = block.problem, block.cofactors
    design, free = dense(block)
    q = dense_inverse(design, free)
    n, d, p, m = len(problem.photos), problem.per_photo, len(problem.points), len(problem.photo)
    r = 1.0 - np.einsum("ij,jk,ik->i", design, q, design, optimize=True)
    np.testing.assert_allclose(found.r.ravel(), r[: 2 * m], atol=1e-9)
    control = r[2 * m : 2 * m + 3 * p].reshape(p, 3)
    seen = np.isfinite(problem.known_sigma)
    np.testing.assert_allclose(found.r_ground[0][seen], control[seen], atol=1e-9)
    assert np.isnan(found.r_ground[0][~seen]).all()
    prior = r[2 * m + 3 * p :][: 6 * n].reshape(n, 6)
    present = np.isfinite(found.r_photo)
    np.testing.assert_allclose(found.r_photo[present], prior[present], atol=1e-9)
    # sum of all redundancy numbers = redundancy
    total = found.r.sum() + np.nansum(found.r_ground) + np.nansum(found.r_photo)
    total += np.nansum(found.r_own) + np.nansum(found.r_shared)
    assert total == pytest.approx(block.redundancy, abs=1e-8)
    assert block.redundancy == problem.observations - problem.unknowns
    for k in range(n):
        part = slice(k * d, (k + 1) * d)
        size = np.sqrt(np.diag(q)[part])
        np.testing.assert_allclose(
            found.photos[k] / size[:, None] / size, q[part, part] / size[:, None] / size, atol=1e-8
        )
    for k in range(p):
        part = slice(n * d + 3 * k, n * d + 3 * k + 3)
        np.testing.assert_allclose(found.points[k], q[part, part], atol=1e-10)
    g = problem.in_border
    if g:
        corner = q[n * d + 3 * p :, n * d + 3 * p :]
        np.testing.assert_allclose(found.shared, corner, atol=1e-9 * np.abs(corner).max())
    # external reliability: what an error of one sigma does to the ray's own point
    gain = q @ design[: 2 * m].T
    for ray in range(m):
        part = slice(n * d + 3 * problem.point[ray], n * d + 3 * problem.point[ray] + 3)
        np.testing.assert_allclose(
            found.response[ray], gain[part, 2 * ray : 2 * ray + 2], atol=1e-9
        )
    # residual cofactors between rays of a point, and one column of Q_vv by back-substitution
    whole = np.eye(2 * m) - design[: 2 * m] @ gain
    met: list[int] = []
    for points, rays, block_q in found.several_rays([p - 1, *range(p)]):
        met += points.tolist()
        for point, mine, own_q in zip(points.tolist(), rays, block_q, strict=True):
            index = np.stack((2 * mine, 2 * mine + 1), axis=1).ravel()
            np.testing.assert_array_equal(mine, np.flatnonzero(problem.point == point))
            np.testing.assert_allclose(own_q, whole[np.ix_(index, index)], atol=1e-9)
            np.testing.assert_allclose(found.point_rays(point)[1], own_q, atol=1e-12)
    assert met == list(range(p))
    for ray, axis in ((0, 0), (m // 2, 1)):
        column = cofactor_column(found.normal, found.factor, ray, axis)
        np.testing.assert_allclose(column.ravel(), whole[:, 2 * ray + axis], atol=1e-8)
        assert column[ray, axis] == pytest.approx(found.r[ray, axis], abs=1e-9)


def test_free_network_equals_the_pseudo_inverse_over_the_points() -> None:
    case = CASES["weighted control"]
    free, minimal = adjusted(case, datum="free"), adjusted(case, datum="minimal")
    problem = free.problem
    design, _ = dense(free)
    n, d, p = len(problem.photos), problem.per_photo, len(problem.points)
    # inner constraints over the points: border with G restricted to the points
    q = held_inverse(free, design)
    for k in range(p):
        part = slice(n * d + 3 * k, n * d + 3 * k + 3)
        np.testing.assert_allclose(free.cofactors.points[k], q[part, part], atol=1e-8)
    for k in range(n):
        part = slice(k * d, (k + 1) * d)
        np.testing.assert_allclose(
            free.cofactors.photos[k], q[part, part], atol=1e-7 * np.abs(q[part, part]).max()
        )
    m = len(problem.photo)
    gain = q @ design[: 2 * m].T
    for ray in range(0, m, 7):
        part = slice(n * d + 3 * problem.point[ray], n * d + 3 * problem.point[ray] + 3)
        np.testing.assert_allclose(
            free.cofactors.response[ray], gain[part, 2 * ray : 2 * ray + 2], atol=1e-7
        )
    # residuals and redundancy numbers know no datum
    np.testing.assert_allclose(free.cofactors.r, minimal.cofactors.r, atol=1e-9)
    np.testing.assert_allclose(free.v, minimal.v, atol=1e-6)
    assert free.redundancy == minimal.redundancy
    # and no datum has smaller variances of the points in the sum
    sums = [np.einsum("nii->", b.cofactors.points) for b in (free, minimal)]
    assert sums[0] < sums[1]
    # a minimal datum holds seven coordinates
    fixed = np.einsum("nii->ni", minimal.cofactors.points) < 1e-12
    assert fixed.sum() == 7


def test_free_network_does_not_depend_on_its_start() -> None:
    scene = cube("E", noise_um=5.0)
    problem = make_problem(replace(scene.block, control=()), datum="free")
    blocks = [
        adjust_bundle(problem, scene.start(problem, np.random.default_rng(seed), 0.1, 0.02))
        for seed in (1, 2)
    ]
    first, second = blocks
    np.testing.assert_allclose(first.v, second.v, atol=1e-6)
    np.testing.assert_allclose(first.cofactors.r, second.cofactors.r, atol=1e-8)
    distances = [
        np.linalg.norm(b.state.points[:, None] - b.state.points[None], axis=2) for b in blocks
    ]
    upper = np.triu_indices(len(distances[0]), 1)
    ratio = distances[0][upper] / distances[1][upper]
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=1e-7)
