"""A calibrated camera beside that of COLMAP's bundle adjustment: OPENCV, values and covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import make_scene

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.covariances import covariance_of
from anaplot.bundle.solve.unknownnames import unknowns_meant
from anaplot.photogrammetry.block import Camera, ControlPoint
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.lens import LENS_PARAMETERS, through_lens
from anaplot.photogrammetry.measuredimage import ideal_rays
from anaplot.photogrammetry.rotation import rotation_matrix

pycolmap = pytest.importorskip("pycolmap")

PIXEL = 0.005  # mm
FOCAL = 2400.0  # px: what is stated
WIDE, HIGH = 3200, 2400
TURNED = np.diag((1.0, -1.0, -1.0))
TRUE = np.array((12.03, 0.02, -0.03, -0.12, 0.05, 0.0, 6e-4, -4e-4, 1e-3, 0.0))
NAMES = ("c", "x0", "y0", "k1", "k2", "p1", "p2", "b1")


def photographed():
    """A close-range network through a lens that bends the corner by 0.5 mm; control fixed."""
    rng = np.random.default_rng(5)
    points = {f"p{k}": rng.uniform((-3, -2, -1), (3, 2, 1)) for k in range(40)}
    photos = {}
    for k in range(8):
        centre = np.array((-4.2 + 1.2 * k, rng.uniform(-2.0, 2.0), 7.0 + rng.uniform(-1.5, 1.5)))
        tilt = (0.2 * rng.normal(), -0.5 * centre[0] / 7.0, 0.9 * rng.normal())
        photos[f"im/{k}"] = (centre, rotation_matrix(*tilt))
    held = list(points)[:5]

    def distort(x: float, y: float):
        return through_lens(np.array([[x, y]]) / (FOCAL * PIXEL), TRUE).xy[0] - (x, y)

    scene = make_scene(
        photos,
        points,
        c=FOCAL * PIXEL,
        control=[ControlPoint(n, tuple(points[n].tolist()), (0.0,) * 3) for n in held],
        noise_um=1e3 * PIXEL,
        sigma_um=1e3 * PIXEL,
        sees=lambda photo, point, xy: np.abs(xy).max() < 8.0,
        distort=distort,
        seed=11,
    )
    return scene, held


def in_colmap(problem, state, held):
    """COLMAP's model of the same measurements, at a state and with the camera as it is stated."""
    model = pycolmap.Reconstruction()
    params = [FOCAL, FOCAL, WIDE / 2, HIGH / 2, 0.0, 0.0, 0.0, 0.0]
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="OPENCV", width=WIDE, height=HIGH, params=params, camera_id=1)
    )
    numbers: dict[int, list[tuple[int, int]]] = {}
    config = pycolmap.BundleAdjustmentConfig()
    for k, name in enumerate(problem.photos):
        rows = np.flatnonzero(problem.photo == k)
        xy = problem.xy[rows] / PIXEL
        seen = np.column_stack((WIDE / 2 + xy[:, 0], HIGH / 2 - xy[:, 1]))
        turn = TURNED @ state.rotations[k].T
        pose = pycolmap.Rigid3d(
            pycolmap.Rotation3d(turn), -turn @ (state.centres[k] + state.origin)
        )
        image = pycolmap.Image(name=name, keypoints=seen, camera_id=1, image_id=k + 1)
        model.add_image_with_trivial_frame(image, pose)
        config.add_image(k + 1)
        for at, ray in enumerate(rows.tolist()):
            numbers.setdefault(int(problem.point[ray]), []).append((k + 1, at))
    for point, rays in numbers.items():
        track = pycolmap.Track()
        for image, at in rays:
            track.add_element(image, at)
        number = model.add_point3D(state.points[point] + state.origin, track)
        if problem.points[point] in held:
            config.add_constant_point(number)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_principal_point = True
    options.refine_extra_params = True
    options.min_track_length = 2
    solver = options.ceres.solver_options
    solver.max_num_iterations = 200
    solver.function_tolerance = solver.gradient_tolerance = solver.parameter_tolerance = 1e-16
    return model, pycolmap.create_default_ceres_bundle_adjuster(options, config, model)


def colmap_params(values: dict[str, float]) -> np.ndarray:
    """f_x, f_y, c_x, c_y, k1, k2, p1, p2 of our whole values."""
    c = values["c"] / PIXEL
    return np.array(
        (c * (1.0 + values["b1"]), c, WIDE / 2 + values["x0"] / PIXEL,
         HIGH / 2 - values["y0"] / PIXEL, *(values[n] for n in ("k1", "k2", "p1", "p2")))
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("stated", [BrownLens(), BrownLens(k1=-0.1, p1=1e-3)])
def test_values_and_covariance_are_those_of_colmap(stated: BrownLens) -> None:
    scene, held = photographed()
    block = scene.block
    plain = adjust_block(
        block, additional=additional_parameters(f"physical:{','.join(NAMES)}:camera")
    )
    camera = Camera("cam", FOCAL * PIXEL, lens=stated)
    if any(stated.coefficients):
        # stated, it is taken off and put on again; what is found is the same whole lens
        rows = block.image_points
        ideal = ideal_rays(camera, [(row.x, row.y) for row in rows]).tolist()
        rows = tuple(replace(row, x=x, y=y) for row, (x, y) in zip(rows, ideal, strict=True))
        block = replace(block, cameras=(camera,), image_points=rows)
    found = adjust_block(
        block, additional=additional_parameters(f"physical:{','.join(NAMES)}:camera")
    )
    assert found.vtpv == pytest.approx(plain.vtpv, rel=1e-9)
    lens = dict(zip(LENS_PARAMETERS, camera.lens_parameters, strict=True))
    whole = {row.name: lens[row.name] + row.coefficient for row in found.parameter_rows()}
    mine = colmap_params(whole)
    model, adjuster = in_colmap(found.problem, found.state, held)
    adjuster.solve()
    theirs = np.array(model.cameras[1].params)
    covariance = pycolmap.estimate_ba_covariance(
        pycolmap.BACovarianceOptions(damping=0.0), model, adjuster
    ).get_other_params_cov(model.cameras[1].params)
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((mine - theirs) / sigma, 0.0, atol=1e-4)
    # derivatives of COLMAP's parameters by ours, numerically
    names = unknowns_meant(found.problem, ["parameters"], "x")
    order = [name.unknown for name in names]
    slopes = np.empty((8, 8))
    for k, name in enumerate(order):
        step = 1e-6
        up, down = dict(whole), dict(whole)
        up[name] += step
        down[name] -= step
        slopes[:, k] = (colmap_params(up) - colmap_params(down)) / (2.0 * step)
    own = slopes @ covariance_of(found, names).cofactors @ slopes.T
    np.testing.assert_allclose(own / np.outer(sigma, sigma),
                               covariance / np.outer(sigma, sigma), atol=1e-4)  # fmt: skip
    # and both are near the truth
    true = colmap_params(dict(zip(LENS_PARAMETERS, TRUE, strict=True)))
    assert (np.abs(theirs - true) < 4.0 * sigma).all()
