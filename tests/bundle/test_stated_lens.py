"""A camera's stated lens in the bundle: what is observed is what was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial, cube

from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.live import LiveBlock
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.imaging import (
    imaged,
    imaged_places,
    imaged_with_derivatives,
    seen_places,
)
from anaplot.bundle.solve.linearised import move
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.measuredimage import ideal_rays, measured_rays
from anaplot.photogrammetry.planting import PlantedError, with_planted_errors

STRONG = BrownLens(k1=0.02, k2=-0.004, k3=1e-3, p1=4e-4, p2=-3e-4, b1=2e-4, b2=-1e-4)
"""0.2 mm 90 mm from the middle of an image with c = 150 mm."""


def through(lens: BrownLens, camera: Camera):
    stated = replace(camera, lens=lens)

    def distort(x: float, y: float):
        return measured_rays(stated, [(x, y)])[0] - (x, y)

    return stated, distort


def stating(scene, camera: Camera, lens: BrownLens):
    """The block whose files state the lens: its ideal coordinates, taken off what was measured."""
    stated = replace(camera, lens=lens)
    rows = scene.block.image_points
    ideal = ideal_rays(stated, [(row.x, row.y) for row in rows])
    rows = tuple(
        replace(row, x=float(x), y=float(y)) for row, (x, y) in zip(rows, ideal, strict=True)
    )
    return replace(scene.block, cameras=(stated,), image_points=rows)


def aerial_block(lens: BrownLens = STRONG, noise_um: float = 5.0, **options):
    camera = Camera("cam", 150.0)
    _, distort = through(lens, camera)
    scene = aerial(2, 3, per_base=2, noise_um=noise_um, relief=120.0, turned=True,
                   control_sigma=0.02, distort=distort, **options)  # fmt: skip
    return scene, stating(scene, camera, lens)


def test_observations_are_what_was_measured_and_approximate_values_see_no_lens() -> None:
    scene, block = aerial_block()
    problem = make_problem(block)
    measured = [(row.x, row.y) for row in scene.block.image_points]
    np.testing.assert_allclose(problem.xy, np.array(measured)[problem.source], atol=1e-10)
    ideal = [(row.x, row.y) for row in block.image_points]
    np.testing.assert_array_equal(problem.ideal, np.array(ideal)[problem.source])
    assert np.abs(problem.xy - problem.ideal).max() > 0.15


def test_without_a_lens_there_is_nothing_between() -> None:
    block = aerial(2, 3, noise_um=5.0).block
    plain = make_problem(block)
    assert plain.stated_lens is None
    assert plain.ideal is plain.xy
    zero = replace(block, cameras=(Camera("cam", 150.0, lens=BrownLens()),))
    assert make_problem(zero).stated_lens is None


@pytest.mark.parametrize("also", [None, "ebner", "gruen50:camera", "physical:photo", "k1,c:camera"])
def test_every_derivative_is_the_numerical_one(also: str | None) -> None:
    scene, block = aerial_block()
    cameras = (*block.cameras, Camera("other", 140.0), Camera("third", 145.0, lens=BrownLens(0.1)))
    photos = tuple(replace(p, camera=cameras[k % 3].id) for k, p in enumerate(block.photos))
    block = replace(block, cameras=cameras, photos=photos)
    also = f"physical:{also}" if also and "," in also else also
    problem = make_problem(block, additional=additional_parameters(also) if also else None)
    rng = np.random.default_rng(3)
    state = scene.start(problem)
    state = replace(
        state,
        own=rng.normal(size=state.own.shape) * 0.2,
        shared=rng.normal(size=state.shared.shape) * 0.2,
    )
    found = imaged_with_derivatives(problem, state)
    np.testing.assert_allclose(found.xy, imaged(problem, state).xy, atol=1e-12)
    few = np.array([3, 40, 17])
    np.testing.assert_array_equal(
        imaged_with_derivatives(problem, state, few).point, found.point[few]
    )
    n, p, d = len(problem.photos), len(problem.points), problem.per_photo
    q = problem.basis.shape[2]

    def slope(photos, points, shared, h: float):
        up, down = (
            imaged(problem, move(state, s * photos, s * points, s * shared)).xy for s in (h, -h)
        )
        return (up - down) / (2.0 * h)

    none = np.zeros((n, d)), np.zeros((p, 3)), np.zeros(state.shared.shape)
    for k in range(6):
        photos = none[0].copy()
        photos[:, k] = 1.0
        wanted = slope(photos, *none[1:], 1e-2 if k < 3 else 1e-5)
        np.testing.assert_allclose(found.photo[:, :, k], wanted, atol=1e-6)
    for k in range(3):
        points = none[1].copy()
        points[:, k] = 1.0
        wanted = slope(none[0], points, none[2], 1e-2)
        np.testing.assert_allclose(found.point[:, :, k], wanted, atol=1e-8)
    for k in range(q):
        photos, shared = none[0].copy(), none[2].copy()
        if problem.photo_invariant:
            photos[:, 6 + k] = 1.0
        else:
            shared.reshape(-1, q)[:, k] = 1.0
        wanted = slope(photos, none[1], shared, 1e-3)
        np.testing.assert_allclose(found.parameter[:, :, k], wanted, atol=1e-8)


def test_residuals_are_those_in_the_image_that_was_measured() -> None:
    scene, block = aerial_block()
    found = adjust_block(block)
    assert abs(found.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * found.redundancy)
    measured = {(row.photo, row.point): (row.x, row.y) for row in scene.block.image_points}
    camera, state, problem = block.cameras[0], found.state, found.problem
    for row in list(found.ray_rows())[::7]:
        photo, point = problem.photos.index(row.photo), problem.points.index(row.point)
        u = state.rotations[photo].T @ (state.points[point] - state.centres[photo])
        seen = measured_rays(camera, [(-150.0 * u[0] / u[2], -150.0 * u[1] / u[2])])[0]
        v = [one.residual for one in row.xy]
        np.testing.assert_allclose(v, 1e3 * (seen - measured[row.photo, row.point]), atol=1e-7)


@pytest.mark.parametrize("k1", [0.1, -0.05])
def test_a_convergent_network_with_a_strong_lens_is_found_from_nothing(k1: float) -> None:
    camera, lens = Camera("cam", 100.0), BrownLens(k1=k1, k2=0.02, p1=5e-4, p2=5e-4)
    _, distort = through(lens, camera)
    scene = cube("B", noise_um=2.0, sigma_um=2.0, distort=distort)
    rows = scene.block.image_points
    block = stating(scene, camera, lens)
    off = np.array([(a.x - b.x, a.y - b.y) for a, b in zip(rows, block.image_points, strict=True)])
    assert np.abs(off).max() > 0.9
    found = adjust_block(block)
    assert abs(found.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * found.redundancy)
    # and with orientations that are given
    near = adjust_bundle(found.problem, scene.start(found.problem, np.random.default_rng(1), 0.1))
    assert near.sigma0 == pytest.approx(found.sigma0, abs=1e-9)


def test_a_ray_that_is_off_has_the_residual_of_what_was_measured() -> None:
    scene, block = aerial_block()
    rows = list(block.image_points)
    at = 11
    whole = adjust_block(block)
    rows[at] = replace(rows[at], use="off")
    without = adjust_block(replace(block, image_points=tuple(rows)))
    off = without.off_rays()[at]
    # adjusted minus observed, without what the ray has pulled
    there = next(row for row in whole.ray_rows() if row.row == at)
    for v, one in zip(off, there.xy, strict=True):
        assert v == pytest.approx(one.residual / one.r, abs=0.5 * abs(one.residual) + 2.0)
    state, problem = without.state, without.problem
    photo, point = problem.photos.index(rows[at].photo), problem.points.index(rows[at].point)
    u = state.rotations[photo].T @ (state.points[point] - state.centres[photo])
    seen = measured_rays(block.cameras[0], [(-150.0 * u[0] / u[2], -150.0 * u[1] / u[2])])[0]
    measured = scene.block.image_points[at]
    np.testing.assert_allclose(off, 1e3 * (seen - (measured.x, measured.y)), atol=1e-7)


def test_a_planted_error_is_one_of_what_was_measured() -> None:
    _, block = aerial_block()
    row = block.image_points[0]
    planted = with_planted_errors(block, [PlantedError(f"{row.photo}:{row.point}", "x", 40.0)])
    before, after = make_problem(block), make_problem(planted)
    ray = int(np.flatnonzero(before.source == 0)[0])
    moved = np.zeros(before.xy.shape)
    moved[ray, 0] = 0.04
    np.testing.assert_allclose(after.xy - before.xy, moved, atol=1e-10)


def test_a_live_block_measures_again_through_the_lens() -> None:
    _, block = aerial_block()
    live = LiveBlock(block)
    before = live.update(block).adjusted.cofactors.normal.structure
    rows = list(block.image_points)
    rows[5] = replace(rows[5], x=rows[5].x + 0.02)
    changed = replace(block, image_points=tuple(rows))
    answer = live.update(changed)
    assert answer.adjusted.cofactors.normal.structure is before
    anew = adjust_block(changed)
    np.testing.assert_allclose(answer.adjusted.v, anew.v, atol=1e-6)


@pytest.mark.slow
def test_a_ray_under_a_wrong_name_is_found_where_the_lens_shows_it() -> None:
    _, block = aerial_block()
    rows = list(block.image_points)
    held = {row.point for row in rows if row.photo == rows[30].photo}
    right = rows[30].point
    wrong = next(row.point for row in rows if row.point not in held)
    rows[30] = replace(rows[30], point=wrong)
    found = block_gross_errors(replace(block, image_points=tuple(rows)), "search")
    assert [(ray.photo, ray.point, ray.meant) for ray in found.misnamed] == [
        (rows[30].photo, wrong, right)
    ]


def test_of_two_cameras_each_sees_through_its_own_lens() -> None:
    lens, camera = STRONG, Camera("cam", 150.0)
    stated, distort = through(lens, camera)
    scene = aerial(2, 3, per_base=2, noise_um=5.0, relief=120.0, control_sigma=0.02)
    other = Camera("plain", 150.0)
    mine = {p.id for p in scene.block.photos[::2]}
    photos = tuple(
        replace(p, camera="cam" if p.id in mine else "plain") for p in scene.block.photos
    )
    rows = []
    for row in scene.block.image_points:
        x, y = row.x, row.y
        if row.photo in mine:
            x, y = ideal_rays(stated, [np.add((x, y), distort(x, y))])[0].tolist()
        rows.append(replace(row, x=x, y=y))
    block = replace(scene.block, cameras=(stated, other), photos=photos, image_points=tuple(rows))
    found = adjust_block(block)
    assert abs(found.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * found.redundancy)


def test_beyond_the_fold_no_point_is_seen() -> None:
    """r - 0.4 r^3 turns at r = 0.913: what lies beyond would be imaged a second time."""
    block = aerial(2, 3, per_base=2).block
    block = replace(block, cameras=(Camera("cam", 150.0, lens=BrownLens(k1=-0.4)),))
    rows = tuple(row for row in block.image_points if np.hypot(row.x, row.y) < 0.6 * 150.0)
    problem = make_problem(replace(block, image_points=rows))
    scene = aerial(2, 3, per_base=2)
    state = scene.start(problem)
    seen_twice = 0
    for photo in range(len(problem.photos)):
        direction = project(
            np.broadcast_to(state.centres[photo], state.points.shape),
            np.broadcast_to(state.rotations[photo], (len(state.points), 3, 3)),
            np.ones(len(state.points)),
            state.points,
        ).xy
        radius = np.hypot(*direction.T)
        far = radius > np.sqrt(1.0 / 1.2)
        seen = seen_places(problem, state, photo, state.points).xy
        assert np.isnan(seen[far]).all()
        assert np.isfinite(seen[~far]).all()
        which = np.full(len(state.points), photo)
        # equal but for rounding, which differs between processors
        for other in (imaged_places, seen_places):
            again = other(problem, state, which, state.points).xy
            np.testing.assert_allclose(again, seen, rtol=0.0, atol=1e-9)
        # many would lie within the format
        seen_twice += np.count_nonzero(far & (np.abs(radius - 0.4 * radius**3) < 0.6))
    assert seen_twice > 5
