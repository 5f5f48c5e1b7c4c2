"""Points of a sub-block: which are intersected, and from which rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.start.absolute import to_ground
from anaplot.bundle.start.subblock import (
    SubBlock,
    common_similarity,
    intersect_rays,
    unit_rays,
)
from anaplot.photogrammetry.collinearity import turns
from anaplot.photogrammetry.similarity import Similarity


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


def on_a_line(seed=3):
    """Two parts that share points on a line, the second in a system of its own."""
    rng = np.random.default_rng(seed)
    away = Similarity(0.3, turns(np.array([[0.4, -0.7, 0.2]]))[0], np.array([5.0, -8.0, 20.0]))
    line = np.array([[90.0, 0.0, 0.0]]) * np.arange(4)[:, None] + rng.normal(0.0, 0.05, (4, 3))
    up = np.tile(np.eye(3), (2, 1, 1))
    centres = np.array([[0.0, -70.0, 150.0], [90.0, -70.0, 150.0]])
    beyond = centres + np.array([0.0, 140.0, 0.0])
    nothing = np.full((2, 3), np.nan)
    one = SubBlock(
        np.concatenate((centres, nothing)), np.concatenate((up, up * np.nan)), line.copy()
    )
    other = SubBlock(
        np.concatenate((nothing, beyond)),
        np.concatenate((up * np.nan, up)),
        line + rng.normal(0.0, 0.05, (4, 3)),
    )
    other.transform(away)
    return one, other, beyond


def test_a_point_far_away_tells_nothing_of_a_turn_about_the_others() -> None:
    one, other, truth = on_a_line()
    # wrong rays that nearly meet, in either part elsewhere
    one.points[3], other.points[3] = [30.0, -5e5, 9e5], [4e4, 1e5, -3e5]
    assert not one.join(other)
    assert one.join(other, hinged=True)
    np.testing.assert_allclose(one.centres[2:], truth, atol=2.0)


def test_parts_of_another_shape_are_not_joined() -> None:
    rng = np.random.default_rng(4)
    shape = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 80.0, 5.0], [90.0, 70.0, -4.0]])
    near = shape + rng.normal(0.0, 0.5, shape.shape)
    moved = Similarity(2.0, turns(np.array([[0.1, 0.2, 2.0]]))[0], np.array([1e5, 2e5, 300.0]))
    found = common_similarity(near, moved.apply(shape))
    assert found is not None
    np.testing.assert_allclose(found[0].scale, 2.0, rtol=0.05)
    # a triangle is laid onto any other one
    assert common_similarity(shape[:3], shape[:3] * [1.0, 5.0, 1.0]) is None


@pytest.mark.parametrize("seed", range(4))
def test_control_on_a_line_of_flat_ground_is_seen_from_above(seed: int) -> None:
    scene = aerial(1, 6, tilt=0.02)
    problem = make_problem(scene.block)
    state = scene.start(problem)
    part = SubBlock(
        state.centres + state.origin, state.rotations.copy(), state.points + state.origin
    )
    truth = part.centres.copy()
    # flat ground, bent by the noise of the part: control in full on one edge, heights on the other
    rng = np.random.default_rng(seed)
    part.points[:, 2] = 0.0
    edge = np.argsort(part.points[:, 1])
    part.points[edge[:4], 1] = part.points[edge[0], 1]
    known = np.full(part.points.shape, np.nan)
    known[edge[:4]] = part.points[edge[:4]]
    known[edge[-6:], 2] = 0.0
    problem = replace(problem, known=known, known_sigma=np.where(np.isnan(known), np.nan, 0.05))
    part.points[edge[-6:], 2] += rng.normal(0.0, 0.5, 6)
    part.points += rng.normal(0.0, 0.001, part.points.shape)
    part.transform(Similarity(0.1, turns(np.array([[0.01, 0.02, 1.0]]))[0], np.zeros(3)))
    assert to_ground(problem, part)
    np.testing.assert_allclose(part.centres, truth, atol=0.02 * truth[:, 2].mean())
