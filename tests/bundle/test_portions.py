"""Equations and derivatives that are made in portions are the same as in one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.solve import normal
from anaplot.bundle.solve.additional import AdditionalParameters, ebner
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.photosides import solve_photos
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.photogrammetry import collinearity


@pytest.mark.parametrize("at_once", [1, 7, 50])
def test_in_portions_as_at_once(monkeypatch, at_once: int) -> None:
    scene = aerial(2, 4, noise_um=5.0, control_sigma=0.05, tilt=0.3)
    rows = scene.block.image_points
    # one ray of much weight
    scene = scene.with_rows([replace(rows[0], sigma_um=0.05), *rows[1:]])
    problem = make_problem(scene.block)
    state = scene.start(problem, np.random.default_rng(1), 1.0, 0.01)
    structure = make_structure(problem, state.centres)
    linear = linearise(problem, state)
    whole = NormalEquations(problem, structure, linear).blocks
    monkeypatch.setattr(normal, "_AT_ONCE", at_once)
    monkeypatch.setattr(collinearity, "_AT_ONCE", at_once)
    again = linearise(problem, state)
    for one in ("a", "b", "e", "depth"):
        np.testing.assert_array_equal(getattr(again, one), getattr(linear, one))
    parts = NormalEquations(problem, structure, again).blocks
    size = np.sqrt(np.einsum("nii->ni", whole[structure.pattern.diagonal]))
    of = size[structure.pattern.rows][:, :, None] * size[structure.pattern.columns][:, None, :]
    np.testing.assert_allclose(parts / of, whole / of, atol=1e-9)
    # A'A - Z Z' ray by ray
    root = NormalEquations(problem, structure, linear).inverse_root
    own = np.zeros((len(problem.photos), 6, 6))
    for ray, photo in enumerate(problem.photo.tolist()):
        a, s = linear.a[ray], linear.b[ray] @ root[problem.point[ray]].T
        own[photo] += a.T @ (np.eye(2) - s @ s.T) @ a
    of = size[:, :, None] * size[:, None, :]
    np.testing.assert_allclose(parts[structure.pattern.diagonal] / of, own / of, atol=1e-9)


@pytest.mark.parametrize("additional", [None, AdditionalParameters(ebner, sigma_um=20.0)])
def test_some_rays_change_as_all_of_them_do(additional: AdditionalParameters | None) -> None:
    scene = aerial(2, 4, noise_um=5.0, control_sigma=0.05, tilt=0.3)
    problem = make_problem(scene.block, additional=additional)
    state = scene.start(problem, np.random.default_rng(1), 1.0, 0.01)
    structure = make_structure(problem, state.centres)
    equations = NormalEquations(problem, structure, linearise(problem, state))
    factor = equations.factor()
    photos = np.random.default_rng(2).normal(size=(len(problem.photos), problem.per_photo, 5))
    points = np.zeros((len(problem.points), 3, 5))
    whole = equations.solve(factor, photos, points, np.zeros((len(equations.corner), 5)))
    # in any order, some points in two of them
    rays = np.flatnonzero(problem.photo < 2)[::-1]
    x, seen = solve_photos(equations, factor, photos, rays)
    np.testing.assert_allclose(x, whole[0], rtol=1e-12)
    wanted = equations.seen(*whole, rays)
    np.testing.assert_allclose(seen, wanted, atol=1e-10 * np.abs(wanted).max())
