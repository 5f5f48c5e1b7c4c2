"""Collinearity: analytic derivatives against numerical ones, and the sign conventions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from anaplot.photogrammetry.collinearity import project, project_with_derivatives, turns
from anaplot.photogrammetry.rotation import rotation_matrix


def scene(seed: int, n: int = 7):
    rng = np.random.default_rng(seed)
    rotations = np.array([rotation_matrix(*rng.uniform(-3, 3, 3)) for _ in range(n)])
    centres = rng.normal(size=(n, 3)) * 100.0
    c = rng.uniform(50.0, 200.0, n)
    xy = rng.uniform(-0.6, 0.6, (n, 2)) * c[:, None]
    rays = np.column_stack((xy, -c))
    scale = rng.uniform(0.5, 20.0, n)
    points = centres + scale[:, None] * np.einsum("nij,nj->ni", rotations, rays)
    return centres, rotations, c, points, xy, scale


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_a_point_on_a_ray_projects_onto_its_image(seed: int) -> None:
    centres, rotations, c, points, xy, scale = scene(seed)
    found = project(centres, rotations, c, points)
    np.testing.assert_allclose(found.xy, xy, atol=1e-9)
    np.testing.assert_allclose(found.depth, scale * c, rtol=1e-10)


def test_rays_have_the_photo_and_the_point_of_their_numbers() -> None:
    centres, rotations, c, points, _, _ = scene(3)
    rng = np.random.default_rng(4)
    photo, point = rng.integers(len(c), size=20_000), rng.integers(len(points), size=20_000)
    each = (centres[photo], rotations[photo], c[photo], points[point])
    for found in (project, project_with_derivatives):
        got = found(centres, rotations, c, points, (photo, point))
        for part, wanted in zip(got, found(*each), strict=True):
            np.testing.assert_array_equal(part, wanted)


@pytest.mark.parametrize("weighted", [False, True])
def test_a_point_beside_its_centre_has_no_image_and_no_warning(weighted) -> None:
    # warnings are errors here
    centres, c, weight = np.zeros((2, 3)), np.array([150.0, 150.0]), np.full((2, 2), 0.5)
    points = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]])
    rotations = np.array([np.eye(3), np.eye(3)])
    got = project_with_derivatives(
        centres, rotations, c, points, weight=weight if weighted else None
    )
    assert not np.isfinite(got.xy).any()
    assert not np.isfinite(got.point).all(axis=(1, 2)).any()
    assert not got.depth.any()


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_derivatives_equal_numerical_ones(seed: int) -> None:
    centres, rotations, c, points, _, _ = scene(seed)
    got = project_with_derivatives(centres, rotations, c, points)
    np.testing.assert_allclose(got.xy, project(centres, rotations, c, points).xy, atol=1e-9)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-4
        move = project(centres + step, rotations, c, points).xy
        back = project(centres - step, rotations, c, points).xy
        np.testing.assert_allclose(
            got.photo[:, :, axis], (move - back) / 2e-4, rtol=1e-5, atol=1e-6
        )
        move = project(centres, rotations, c, points + step).xy
        back = project(centres, rotations, c, points - step).xy
        np.testing.assert_allclose(
            got.point[:, :, axis], (move - back) / 2e-4, rtol=1e-5, atol=1e-6
        )
        move = project(centres, turns(step[None])[0] @ rotations, c, points).xy
        back = project(centres, turns(-step[None])[0] @ rotations, c, points).xy
        np.testing.assert_allclose(
            got.photo[:, :, 3 + axis], (move - back) / 2e-4, rtol=1e-5, atol=1e-4
        )


def test_many_turns_equal_single_turns() -> None:
    vectors = np.array([[0.0, 0.0, 0.0], [1e-8, 2e-8, 0.0], [0.3, -0.2, 0.9], [3.0, 0.1, 0.2]])
    np.testing.assert_allclose(
        turns(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-14
    )
