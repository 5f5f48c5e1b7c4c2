"""Points of a sub-block: which are intersected, and from which rays."""

from __future__ import annotations

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.start.subblock import SubBlock, intersect_rays, unit_rays


def scene_and_photos(but=0, **options):
    """A block whose photos, but for the last few, stand where they were."""
    scene = aerial(2, 5, tilt=0.15, **options)
    problem = make_problem(scene.block)
    state = scene.start(problem)
    part = SubBlock.empty(problem)
    count = len(problem.photos) - but
    part.centres[:count] = state.centres[:count] + state.origin
    part.rotations[:count] = state.rotations[:count]
    return problem, part, unit_rays(problem), state.points + state.origin


def rays_of(problem, part):
    return np.bincount(problem.point[part.oriented[problem.photo]], minlength=len(problem.points))


def test_points_that_two_photos_see_are_where_they_are() -> None:
    problem, part, rays, truth = scene_and_photos(but=4)
    found = intersect_rays(problem, part, rays)
    several = rays_of(problem, part) > 1
    assert several.any()
    assert not several.all()
    np.testing.assert_allclose(found[several], truth[several], atol=1e-6)
    assert np.isnan(found[~several]).all()


def test_of_some_points_only_those() -> None:
    problem, part, rays, truth = scene_and_photos(noise_um=5.0)
    wanted = np.zeros(len(truth), dtype=bool)
    wanted[[1, 4, 9]] = True
    found = intersect_rays(problem, part, rays, wanted)
    np.testing.assert_array_equal(np.isfinite(found[:, 0]), wanted)
    # the weights know other rays, the places differ by less than their precision
    whole = intersect_rays(problem, part, rays, np.ones(len(truth), dtype=bool))
    np.testing.assert_array_equal(whole, intersect_rays(problem, part, rays))
    np.testing.assert_allclose(found[wanted], whole[wanted], atol=0.2)
    none = intersect_rays(problem, SubBlock.empty(problem), rays)
    assert np.isnan(none).all()


def test_one_wrong_ray_of_several_loses_its_pull() -> None:
    problem, part, rays, truth = scene_and_photos()
    k = int(np.argmax(rays_of(problem, part)))
    wrong = int(np.flatnonzero(problem.point == k)[0])
    rays[wrong] = np.array([0.3, -0.2, -0.93])
    wanted = np.arange(len(truth)) == k
    np.testing.assert_allclose(intersect_rays(problem, part, rays, wanted)[k], truth[k], atol=0.05)


def test_points_with_a_place_keep_it() -> None:
    problem, part, rays, truth = scene_and_photos(noise_um=5.0)
    part.points[:3] = truth[:3] + 7.0
    assert part.place(problem, rays) == len(truth) - 3
    np.testing.assert_array_equal(part.points[:3], truth[:3] + 7.0)
    assert part.place(problem, rays) == 0
    assert part.place(problem, rays, again=True) == 0
    np.testing.assert_allclose(part.points[:3], truth[:3], atol=1.0)


@pytest.mark.parametrize("far", [1e1, 1e2, 3e3, 2e4, 1e6])
def test_rays_meet_at_any_angle_or_are_parallel(far: float) -> None:
    problem, part, rays, truth = scene_and_photos()
    k = int(np.flatnonzero(rays_of(problem, part) == 2)[0])
    mine = np.flatnonzero(problem.point == k)
    centres = part.centres[problem.photo[mine]]
    base = float(np.linalg.norm(centres[1] - centres[0]))
    place = centres[0] + far * base * np.array([0.3, -0.4, -(0.75**0.5)])
    away = place - centres
    turned = np.einsum("nji,nj->ni", part.rotations[problem.photo[mine]], away)
    rays[mine] = turned / np.linalg.norm(turned, axis=1)[:, None]
    found = intersect_rays(problem, part, rays, np.arange(len(truth)) == k)[k]
    # the smallest eigenvalue is a quarter of the square of the angle, the largest is 2
    if far > 1e5:
        assert np.isnan(found).all()
    else:
        np.testing.assert_allclose(found, place, atol=1e-14 * far**3 * base + 1e-6)
