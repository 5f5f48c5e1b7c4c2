"""Points in clusters: every point once, and of the photos' matrix what the dense formula says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.solve import pointclusters
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.pointclusters import point_sets
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.reliability import compute_cofactors
from anaplot.bundle.solve.structure import make_structure


def _twice_measured(scene):
    """Some rays again in another model, two of them of one photo and point."""
    rows = list(scene.block.image_points)
    again = [replace(row, x=row.x + 0.004, model=None) for row in rows[::5]]
    return scene.with_rows([*rows, *again])


@pytest.mark.parametrize("twice", [False, True])
@pytest.mark.parametrize("most", [1, 7, 256])
def test_normal_equations_and_cofactors_are_those_of_the_dense_formula(
    monkeypatch: pytest.MonkeyPatch, most: int, twice: bool
) -> None:
    monkeypatch.setattr(pointclusters, "_MOST_POINTS", most)
    monkeypatch.setattr(pointclusters, "_OWN_COST", 1e3)
    scene = aerial(2, 4, noise_um=5.0, control_sigma=0.05, turned=True, tilt=0.05)
    scene = _twice_measured(scene) if twice else scene
    problem = make_problem(scene.block)
    state = scene.start(problem)
    structure = make_structure(problem, state.centres)
    linear = linearise(problem, state)
    assert len(structure.clusters) > 1
    assert any(cluster.twice for cluster in structure.clusters) == twice
    n, m, p = len(problem.photos), len(problem.photo), len(problem.points)
    design = np.zeros((2 * m, 6 * n + 3 * p))
    for ray in range(m):
        photo, point = problem.photo[ray], problem.point[ray]
        design[2 * ray : 2 * ray + 2, 6 * photo : 6 * photo + 6] = linear.a[ray]
        at = 6 * n + 3 * point
        design[2 * ray : 2 * ray + 2, at : at + 3] = linear.b[ray]
    whole = design.T @ design
    index = 6 * n + np.arange(3 * p)
    whole[index, index] += linear.point_weight.sum(axis=0).ravel()
    for damping in (0.0, 0.3):
        normal = NormalEquations(problem, structure, linear, damping)
        damped = whole + damping * np.diag(np.diag(whole))
        left, side = damped[: 6 * n, : 6 * n], damped[: 6 * n, 6 * n :]
        reduced = left - side @ np.linalg.solve(damped[6 * n :, 6 * n :], side.T)
        shown = np.zeros((n, 6, n, 6))
        pattern = structure.pattern
        shown[pattern.rows, :, pattern.columns] = normal.blocks
        shown[pattern.columns, :, pattern.rows] = normal.blocks.transpose(0, 2, 1)
        np.testing.assert_allclose(
            shown.reshape(6 * n, 6 * n), reduced, rtol=0.0, atol=1e-11 * np.abs(whole).max()
        )
    normal = NormalEquations(problem, structure, linear)
    cofactors = compute_cofactors(normal, normal.factor())
    r = 1.0 - np.einsum("ij,jk,ik->i", design, np.linalg.inv(whole), design)
    np.testing.assert_allclose(cofactors.r.ravel(), r, atol=1e-7)
    for point in (0, p // 2, p - 1):
        rays, q = cofactors.point_rays(point)
        np.testing.assert_allclose(np.diag(q), cofactors.r[rays].ravel(), atol=1e-9)


def test_every_ray_stands_in_one_set() -> None:
    scene = _twice_measured(aerial(3, 6))
    problem = make_problem(scene.block)
    sets = point_sets(problem, np.array([scene.centres[name] for name in problem.photos]))
    rays = np.concatenate([one.rays for one in sets])
    assert np.array_equal(np.sort(rays), np.arange(len(problem.photo)))
    assert sum(one.points for one in sets) == len(problem.points)
    for one in sets:
        assert np.array_equal(one.photos[one.photo], problem.photo[one.rays])
        places = one.photo * one.points + one.point
        assert len(np.unique(places)) == len(places)
