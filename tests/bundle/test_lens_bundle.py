"""Self-calibration by the lens: derivatives, recovery of a lens, weak networks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial, make_scene
from denseblock import dense, dense_inverse

from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.imaging import imaged, imaged_with_derivatives
from anaplot.bundle.solve.linearised import move
from anaplot.bundle.solve.problem import make_problem
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Camera, ControlPoint
from anaplot.photogrammetry.lens import LENS_PARAMETERS, through_lens
from anaplot.photogrammetry.rotation import rotation_matrix

pytestmark = pytest.mark.slow

# c 30 um too short, the principal point 0.106 mm off the middle, 120 um of k1 in the corner
LENS = np.array([150.03, 0.075, -0.075, 0.018, -0.004, 0.0, 3e-4, -2e-4, 1e-4, -5e-5])
CORRECTION = LENS - np.array([150.0, *[0.0] * 9])


def distorted(x: float, y: float):
    return through_lens(np.array([[x, y]]) / 150.0, LENS).xy[0] - (x, y)


def calibration_block(noise_um: float = 3.0):
    """Crosswise strips over relief with dense control determine the lens."""
    scene = aerial(3, 4, per_base=2, noise_um=noise_um, sigma_um=3.0, relief=150.0, turned=True,
                   distort=distorted, seed=5)  # fmt: skip
    control = tuple(
        ControlPoint(n, tuple(p.tolist()), (0.0,) * 3)
        for k, (n, p) in enumerate(scene.points.items())
        if k % 3 == 0
    )
    return replace(scene, block=replace(scene.block, control=control))


def flat_block(strips: int, tilt: float, seed: int = 0):
    """Near-vertical photos of flat ground; control gives no height, photos only to 1 m."""
    rng = np.random.default_rng(seed)
    length, base, height = 4, 600.0, 1000.0
    photos = {
        f"{j + 1}{i + 1:02d}": (
            np.array([i * base, j * base, height]),
            rotation_matrix(*(rng.normal(size=3) * tilt)),
        )
        for j in range(strips)
        for i in range(length)
    }
    places = rng.uniform((-base, -base), (length * base, strips * base), (30 * strips, 2))
    points = {f"p{k}": np.array([x, y, 0.0]) for k, (x, y) in enumerate(places)}
    scene = make_scene(
        photos, points, noise_um=3.0, sigma_um=3.0, seed=seed,
        sees=lambda photo, name, xy: np.abs(xy).max() < 110.0,
    )  # fmt: skip
    control = tuple(
        ControlPoint(n, (float(p[0]), float(p[1]), None), (0.05, 0.05, None))
        for k, (n, p) in enumerate(scene.points.items())
        if k % 4 == 0
    )
    held = tuple(
        replace(
            p,
            position=tuple((scene.centres[p.id] + rng.normal(size=3)).tolist()),
            position_sigma=(1.0,) * 3,
        )
        for p in scene.block.photos
    )
    scene.block = replace(scene.block, control=control, photos=held)
    return scene


@pytest.mark.parametrize("scope", ["block", "camera", "photo", "k2,x0,p1:camera", "-c,-b1:photo"])
def test_every_derivative_of_the_bundle_is_the_numerical_one(scope: str) -> None:
    scene = aerial(2, 3, per_base=1, noise_um=5.0, relief=100.0, tilt=0.1)
    cameras = (Camera("cam", 150.0), Camera("other", 140.0))
    photos = tuple(replace(p, camera=cameras[k % 2].id) for k, p in enumerate(scene.block.photos))
    block = replace(scene.block, cameras=cameras, photos=photos)
    problem = make_problem(block, additional=additional_parameters(f"physical:{scope}"))
    rng = np.random.default_rng(3)
    state = scene.start(problem)
    state = replace(
        state,
        own=rng.normal(size=state.own.shape) * 0.3,
        shared=rng.normal(size=state.shared.shape) * 0.3,
    )
    d, q = problem.per_photo, problem.basis.shape[2]
    found = imaged_with_derivatives(problem, state)
    np.testing.assert_allclose(found.xy, imaged(problem, state).xy, atol=1e-12)

    def numerical(photos, points, shared, h: float):
        up = imaged(problem, move(state, h * photos, h * points, h * shared)).xy
        down = imaged(problem, move(state, -h * photos, -h * points, -h * shared)).xy
        return (up - down) / (2.0 * h)

    def nothing():
        shape = (len(problem.photos), d), (len(problem.points), 3), state.shared.shape
        return [np.zeros(s) for s in shape]

    for k in range(6):
        photos, points, shared = nothing()
        photos[:, k] = 1.0
        wanted = numerical(photos, points, shared, 1e-2 if k < 3 else 1e-5)
        np.testing.assert_allclose(found.photo[:, :, k], wanted, atol=1e-6)
    for k in range(3):
        photos, points, shared = nothing()
        points[:, k] = 1.0
        np.testing.assert_allclose(
            found.point[:, :, k], numerical(photos, points, shared, 1e-2), atol=1e-8
        )
    for k in range(q):
        photos, points, shared = nothing()
        if problem.photo_invariant:
            photos[:, 6 + k] = 1.0
        else:
            shared.reshape(-1, q)[:, k] = 1.0
        np.testing.assert_allclose(
            found.parameter[:, :, k], numerical(photos, points, shared, 1e-3), atol=1e-8
        )


def test_a_lens_with_its_principal_point_off_the_middle_is_recovered() -> None:
    block = adjust_block(calibration_block().block, additional=additional_parameters("physical"))
    # 3 standard deviations of sqrt(chi2 / r)
    assert abs(block.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * block.redundancy)
    rows = {row.name: row for row in block.parameter_rows()}
    assert tuple(rows) == LENS_PARAMETERS
    for name, wanted in zip(LENS_PARAMETERS, CORRECTION, strict=True):
        assert abs(rows[name].coefficient - wanted) < 3.0 * rows[name].s_coefficient, name
    # a longer camera constant has a positive correction
    assert rows["c"].coefficient > 0.0
    off = np.array([row.coefficient for row in rows.values()]) - CORRECTION
    off /= block.problem.lens_units[0]
    # chi2 of ten parameters, 99.9 %
    assert off @ np.linalg.solve(block.cofactors.shared, off) < 29.6


def test_a_lens_without_noise_is_recovered_exactly() -> None:
    scene = calibration_block(noise_um=0.0)
    block = adjust_block(scene.block, additional=additional_parameters("physical"))
    assert block.sigma0 < 1e-5
    found = [row.coefficient for row in block.parameter_rows()]
    np.testing.assert_allclose(found, CORRECTION, atol=1e-7)


def test_cofactors_with_a_strong_lens_are_those_of_the_dense_inverse() -> None:
    scene = calibration_block()
    problem = make_problem(scene.block, additional=additional_parameters("physical", 500.0))
    block = adjust_bundle(problem, scene.start(problem))
    design, free = dense(block)
    q = dense_inverse(design, free)
    corner = q[-len(LENS_PARAMETERS) :, -len(LENS_PARAMETERS) :]
    np.testing.assert_allclose(
        block.cofactors.shared, corner, rtol=1e-7, atol=1e-9 * np.abs(corner).max()
    )
    m = len(problem.photo)
    r = 1.0 - np.einsum("ij,jk,ik->i", design, q, design, optimize=True)[: 2 * m]
    np.testing.assert_allclose(block.cofactors.r.ravel(), r, atol=1e-9)


@pytest.mark.parametrize("cameras", [("cam",), ("cam", "other")])
def test_the_sigma_is_the_largest_effect_in_the_image(cameras: tuple[str, ...]) -> None:
    scene = aerial(2, 3, per_base=2, relief=0.0, tilt=0.0)
    declared = tuple(Camera(name, 150.0) for name in cameras)
    photos = tuple(
        replace(p, camera=cameras[k % len(cameras)]) for k, p in enumerate(scene.block.photos)
    )
    block = replace(scene.block, cameras=declared, photos=photos)
    problem = make_problem(block, additional=additional_parameters("physical:camera", 5.0))
    state = scene.start(problem)
    before = imaged(problem, state).xy
    for k, sigma in enumerate(problem.additional_sigma[0]):
        shared = np.zeros((len(cameras), len(LENS_PARAMETERS)))
        shared[:, k] = sigma
        moved = imaged(problem, replace(state, shared=shared.ravel())).xy
        assert np.abs(moved - before).max() == pytest.approx(5e-3, rel=1e-3)


@pytest.mark.parametrize("tilt", [1e-2, 1e-3])
@pytest.mark.parametrize("sigma_um", [None, 1000.0, 20.0])
def test_weak_parameters_are_adjusted_and_their_deviations_say_so(
    tilt: float, sigma_um: float | None
) -> None:
    scene = flat_block(3, tilt)
    block = adjust_block(scene.block, additional=additional_parameters("physical", sigma_um))
    assert abs(block.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * block.redundancy)
    rows = {row.name: row for row in block.parameter_rows()}
    # the block was made without any lens
    for name in ("c", "x0", "y0"):
        assert abs(rows[name].value) < 3.5 * rows[name].s
    if sigma_um is None:
        # a metre of flying height is 150 um of c
        assert rows["c"].s > 0.02
    else:
        limits = block.problem.additional_sigma[0] * block.sigma
        assert all(row.s < 1.0001 * s for row, s in zip(rows.values(), limits, strict=True))


def along_a_line():
    """Three heights in a line: the block hardly resists a turn about it."""
    block = aerial(3, 4, per_base=2, noise_um=3.0, sigma_um=3.0, relief=3.0, tilt=0.003,
                   control_sigma=0.05).block  # fmt: skip
    control = tuple(
        row if k < 3 else replace(row, xyz=(*row.xyz[:2], None), sigma=(0.05, 0.05, None))
        for k, row in enumerate(block.control)
    )
    return replace(block, control=control)


@pytest.mark.parametrize("sigma_um", [None, 1000.0, 50.0])
def test_a_weak_movement_is_no_reason_to_refuse_parameters(sigma_um: float | None) -> None:
    block = adjust_block(along_a_line(), additional=additional_parameters("physical", sigma_um))
    assert abs(block.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * block.redundancy)
    rows = {row.name: row for row in block.parameter_rows()}
    for name in ("c", "x0", "y0"):
        assert abs(rows[name].value) < 3.5 * rows[name].s
    # millimetres of c where it is free, and what its weight leaves
    assert rows["c"].s > 1.0 if sigma_um is None else rows["c"].s < 2e-3 * sigma_um


def with_heights(block):
    """Four heights, and no positions of photos: c and the flying height do the same."""
    photos = tuple(replace(p, position_sigma=None, position=None) for p in block.photos)
    by_corner = [
        max(block.control, key=lambda row: row.xyz[0] * dx + row.xyz[1] * dy)
        for dx, dy in ((1, 1), (1, -1), (-1, 1), (-1, -1))
    ]
    control = tuple(
        replace(row, xyz=(*row.xyz[:2], 0.0), sigma=(0.05,) * 3) if row in by_corner else row
        for row in block.control
    )
    return replace(block, photos=photos, control=control)


def test_parameters_that_nothing_determines_are_refused_until_they_are_weighted() -> None:
    block = with_heights(flat_block(3, 0.0).block)
    with pytest.raises(NotComputableError, match=r"not determined: the additional parameters"):
        adjust_block(block, additional=additional_parameters("physical"))
    for sigma_um in (20.0, 1000.0):
        found = adjust_block(block, additional=additional_parameters("physical", sigma_um))
        assert abs(found.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * found.redundancy)
