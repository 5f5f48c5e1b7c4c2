"""Covariances of poses, points and calibration beside those of pycolmap, an independent program.

COLMAP's pose is from world to camera, y and z turned round; its tangent is a rotation in the axes
of the camera, in halves of an angle as Ceres' quaternions have it, and the translation. The
covariance of a point is that with all poses held. Observations have a standard deviation of 1 px.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from bundleblocks import make_scene

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.covariances import covariance_of
from anaplot.bundle.solve.unknownnames import unknowns_meant
from anaplot.photogrammetry.block import ControlPoint
from anaplot.photogrammetry.rotation import rotation_angles, rotation_axes, rotation_matrix

pycolmap = pytest.importorskip("pycolmap")

PIXEL = 0.005  # mm
FOCAL = 2400.0  # px
WIDE, HIGH = 3200, 2400
TURNED = np.diag((1.0, -1.0, -1.0))
CLOSE = 1e-9  # of the standard deviations' products


class Witness(NamedTuple):
    """Our block and COLMAP's covariance at its solution."""

    block: object
    found: object
    images: dict
    points: dict
    camera: object
    model: object


def witness(scope=None, refined=()):
    """A close-range network, tilted everywhere: control free of error, constant points there."""
    rng = np.random.default_rng(5)
    points = {f"p{k}": rng.uniform((-3, -2, -1), (3, 2, 1)) for k in range(24)}
    photos = {}
    for k in range(6):
        centre = np.array((-4.0 + 1.6 * k, rng.uniform(-2.0, 2.0), 7.0 + rng.uniform(-1.0, 1.0)))
        tilt = (0.1 * rng.normal(), -0.5 * centre[0] / 7.0, 0.9 * rng.normal())
        photos[f"im/{k}"] = (centre, rotation_matrix(*tilt))
    held = list(points)[:4]
    scene = make_scene(
        photos,
        points,
        c=FOCAL * PIXEL,
        control=[ControlPoint(n, tuple(points[n].tolist()), (0.0,) * 3) for n in held],
        noise_um=1e3 * PIXEL,
        sigma_um=1e3 * PIXEL,
        sees=lambda photo, point, xy: (int(point[1:]) + int(photo[3:])) % 5 > 0,
        seed=11,
    )
    block = adjust_block(
        scene.block, additional=None if scope is None else additional_parameters(scope)
    )
    problem, state = block.problem, block.state
    params = np.array((FOCAL, WIDE / 2, HIGH / 2))
    for row in block.parameter_rows():
        unknown, sign = {"c": (0, 1.0), "x0": (1, 1.0), "y0": (2, -1.0)}[row.name]
        params[unknown] += sign * row.coefficient / PIXEL
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model="SIMPLE_PINHOLE", width=WIDE, height=HIGH, params=params.tolist(), camera_id=1
    )
    model.add_camera_with_trivial_rig(camera)
    images, numbers = {}, {}
    for k, name in enumerate(problem.photos):
        rows = np.flatnonzero(problem.photo == k)
        seen = np.column_stack((WIDE / 2 + problem.xy[rows, 0] / PIXEL,
                                HIGH / 2 - problem.xy[rows, 1] / PIXEL))  # fmt: skip
        turn = TURNED @ state.rotations[k].T
        pose = pycolmap.Rigid3d(
            pycolmap.Rotation3d(turn), -turn @ (state.centres[k] + state.origin)
        )
        image = pycolmap.Image(name=name, keypoints=seen, camera_id=1, image_id=k + 1)
        model.add_image_with_trivial_frame(image, pose)
        images[name] = k + 1
        for at, ray in enumerate(rows.tolist()):
            numbers.setdefault(int(problem.point[ray]), []).append((k + 1, at))
    ids = {}
    for point, rays in numbers.items():
        track = pycolmap.Track()
        for image, at in rays:
            track.add_element(image, at)
        ids[problem.points[point]] = model.add_point3D(state.points[point] + state.origin, track)
    config = pycolmap.BundleAdjustmentConfig()
    for number in images.values():
        config.add_image(number)
    for name in held:
        config.add_constant_point(ids[name])
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = "c" in refined
    options.refine_principal_point = "x0" in refined
    options.refine_extra_params = False
    options.min_track_length = 2
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    found = pycolmap.estimate_ba_covariance(
        pycolmap.BACovarianceOptions(damping=0.0), model, adjuster
    )
    assert found is not None
    return Witness(block, found, images, ids, model.cameras[1], model)


@pytest.fixture(scope="module")
def plain():
    return witness()


def into_ours(seen, name):
    """Derivatives of position and small rotation by COLMAP's tangent."""
    problem, state = seen.block.problem, seen.block.state
    at = problem.photos.index(name)
    turn = TURNED @ state.rotations[at].T
    x, y, z = -turn @ (state.centres[at] + state.origin)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    half = 2.0
    return np.block([[-half * turn.T @ cross, -turn.T], [-half * turn.T, np.zeros((3, 3))]])


def turns(seen, name):
    """Derivatives of position and small rotation by position and the three angles."""
    at = seen.block.problem.photos.index(name)
    omega, phi, _ = rotation_angles(seen.block.state.rotations[at])
    return np.block([[np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), rotation_axes(omega, phi)]])


def ours(seen, *wanted):
    names = unknowns_meant(seen.block.problem, wanted, "x")
    return covariance_of(seen.block, names).cofactors


def same(found, wanted):
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        found / size[:, None] / size, wanted / size[:, None] / size, atol=CLOSE, rtol=0
    )


def test_poses_and_poses_with_each_other(plain):
    names = plain.block.problem.photos
    whole = ours(plain, "photos")
    for i, first in enumerate(names):
        here = into_ours(plain, first)
        theirs = here @ plain.found.get_cam_cov_from_world(plain.images[first]) @ here.T
        own = slice(6 * i, 6 * i + 6)
        turned = turns(plain, first)
        same(turned @ whole[own, own] @ turned.T, theirs)
    for first, second in ((0, 1), (4, 2), (5, 0)):
        pair = [(first, names[first]), (second, names[second])]
        cross = plain.found.get_cam_cross_cov_from_world(*(plain.images[n] for _, n in pair))
        theirs = into_ours(plain, pair[0][1]) @ cross @ into_ours(plain, pair[1][1]).T
        own = np.zeros(whole.shape)
        for k, name in pair:
            own[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = turns(plain, name)
        turned = own @ whole @ own.T
        a, b = (np.arange(6 * k, 6 * k + 6) for k, _ in pair)
        size = np.sqrt(np.outer(np.diag(turned)[a], np.diag(turned)[b]))
        np.testing.assert_allclose(turned[np.ix_(a, b)] / size, theirs / size, atol=CLOSE, rtol=0)
        assert np.abs(theirs / size).max() > 0.05


def test_points_with_the_poses_held(plain):
    """The covariance of points and poses, less what the poses explain: all of it takes part."""
    for name in ("p7", "p12", "p23"):
        whole = ours(plain, f"points:{name}", "photos")
        held = whole[:3, :3] - whole[:3, 3:] @ np.linalg.solve(whole[3:, 3:], whole[3:, :3])
        same(held, plain.found.get_point_cov(plain.points[name]))
    assert plain.found.get_point_cov(plain.points["p0"]) is None
    assert (ours(plain, "points:p0") == 0.0).all()


def test_calibration_and_poses():
    seen = witness("physical:c,x0,y0", ("c", "x0"))
    theirs = seen.found.get_other_params_cov(seen.camera.params)
    # y is down there, and lengths are in pixels
    turned = np.diag((1.0, 1.0, -1.0)) / PIXEL
    own = ours(seen, "parameters")
    same(turned @ own @ turned.T, theirs)
    assert np.sqrt(own[0, 0]) > 10.0 * PIXEL * 1e-2
    for name in seen.block.problem.photos:
        here, angles = into_ours(seen, name), turns(seen, name)
        pose = here @ seen.found.get_cam_cov_from_world(seen.images[name]) @ here.T
        same(angles @ ours(seen, f"photo:{name}") @ angles.T, pose)
