"""Random strips with known truth, for the tests of this room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anaplot.orientation.model import orient
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Camera, Precision, TestSettings
from anaplot.photogrammetry.rotation import rotation_matrix

PAPER = Precision(5.0, "paper")
PROPAGATED = Precision(5.0, "propagated")
EXACT = Precision(5.0, "exact")
TAU = TestSettings("tau", 0.001, 0.80)
BAARDA = TestSettings("baarda", 0.001, 0.80)


@dataclass(frozen=True)
class Flight:
    """True centres, rotations, ground points and image coordinates of a strip."""

    cameras: list[Camera]
    centres: np.ndarray
    rotations: list[np.ndarray]
    ground: dict[str, np.ndarray]
    images: list[dict[str, tuple[float, float]]]


def project(camera, centre, rotation, point):
    p = rotation.T @ (point - centre)
    return tuple((-camera.c * p[:2] / p[2]).tolist())


def fly(
    seed, photos=3, *, tilt=10.0, kappa=60.0, relief=0.1, noise=0.0, same_camera=False, length=None
):
    """Fly a strip along +x or -x: 13 points a model, tilts and relative kappa up to the given.

    Points are named after the photo under which they lie: "1a" ... "1e", between photos "1m".
    """
    rng = np.random.default_rng(seed)
    c = float(rng.uniform(80.0, 300.0))
    cameras = [
        Camera(str(k), c if same_camera else c * float(rng.uniform(0.8, 1.25)))
        for k in range(photos)
    ]
    b = float(rng.choice([-1, 1])) * (length or c * float(rng.uniform(0.35, 0.7)))
    d = c * float(rng.uniform(0.4, 0.7))
    centres, rotations, turned = [np.zeros(3)], [np.eye(3)], 0.0
    for _ in range(1, photos):
        step = [rng.uniform(0.85, 1.15), rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1)]
        centres.append(centres[-1] + b * np.array(step))
        turned += float(rng.uniform(-kappa, kappa))
        angles = np.radians([*rng.uniform(-tilt, tilt, 2), turned])
        rotations.append(rotation_matrix(*angles.tolist()))
    ground = {}
    for k in range(photos):
        x0 = float(centres[k][0])
        # a triangular doubling of the corners: twins 4 % of the base towards the middle
        places = {"a": (0, d), "b": (0.04, d), "c": (0, 0), "d": (0, -d), "e": (0.04, -d)}
        if k + 1 < photos:
            places |= {"ma": (0.5, d), "mb": (0.5, 0), "mc": (0.5, -d)}
        for name, (x, y) in places.items():
            z = -c * (1.0 + relief * float(rng.uniform(-1, 1)))
            ground[f"{k}{name}"] = np.array([x0 + b * x, y, z])
    images = []
    for k in range(photos):
        seen = {}
        for name, point in ground.items():
            if abs(int(name[0]) - k) <= 1:
                x, y = project(cameras[k], centres[k], rotations[k], point)
                e = noise * rng.standard_normal(2)
                seen[name] = (x + float(e[0]), y + float(e[1]))
        images.append(seen)
    return Flight(cameras, np.array(centres), rotations, ground, images)


def pair_of(flight, k, preceding=None, *, points=None, right=None, **kw):
    """Model k/k+1 of a flight; its points are those under and between its photos."""
    if points is None:
        points = [p for p in flight.images[k] if p[0] in (str(k), str(k + 1))]
        points = [p for p in points if not p.startswith(f"{k + 1}m")]
    left = flight.images[k]
    return stereopair(
        (str(k), str(k + 1)),
        {p: left[p] for p in points},
        flight.images[k + 1] if right is None else right,
        (flight.cameras[k], flight.cameras[k + 1]),
        preceding=preceding,
        **kw,
    )


def bridge_flight(flight, precision=PAPER, test=TAU, base=None):
    models = []
    for k in range(len(flight.images) - 1):
        pair = pair_of(flight, k, models[-1] if models else None, base=base)
        models.append(orient(pair, precision, test))
    return models
