"""Blocks of several cameras, each with a lens that nobody has told, for the tests of this room."""

from __future__ import annotations

import numpy as np

from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    TestSettings,
    in_pixels,
)
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.lens import through_lens
from anaplot.photogrammetry.measuredimage import ideal_rays
from anaplot.photogrammetry.rotation import rotation_matrix

NOISE = 0.002  # mm
SIZE = (6000, 4000)
TRUTH = {
    "drone": (35.02, 0.03, -0.05, -0.06, 0.02, 0.0, 4e-4, -3e-4, 0.0, 0.0),
    "metric": (28.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "phone/7": (24.1, 0.0, 0.04, 0.08, -0.05, 0.0, 0.0, 5e-4, 1e-3, 5e-4),
}
"""What the cameras do: ideal to measured coordinates."""


def stated(name: str) -> Camera:
    """What their owner believes: round numbers, and nothing of the lens."""
    c = float(round(TRUTH[name][0]))
    return in_pixels(Camera(name, c), SIZE, 6.0, (3010.0, 1990.0))


def make_block(
    cameras: tuple[str, ...] = tuple(TRUTH), *, seed: int = 1, noise: float = NOISE, pixels=True
) -> Block:
    """Photos from two heights, some turned and tilted, over ground with relief and control."""
    rng = np.random.default_rng(seed)
    points = np.column_stack((rng.uniform(-60.0, 60.0, (45, 2)), rng.uniform(-12.0, 12.0, 45)))
    photos, rows = [], []
    k = 0
    for height in (90.0, 130.0):
        for x in (-40.0, 0.0, 40.0):
            for y in (-25.0, 25.0):
                camera = cameras[(k + k // 3) % len(cameras)]
                name, k = f"p{k:02d}", k + 1
                lean = rng.normal(size=2) * 0.15
                turned = rotation_matrix(lean[0] - y / 150.0, lean[1] + x / 150.0, k * 1.7)
                photos.append(Photo(name, camera))
                n = len(points)
                seen = project(
                    np.broadcast_to((x, y, height), (n, 3)),
                    np.broadcast_to(turned, (n, 3, 3)),
                    np.ones(n),
                    points,
                )
                xy = through_lens(seen.xy, np.array(TRUTH[camera])).xy
                xy = xy + rng.normal(size=xy.shape) * noise
                inside = (np.abs(xy) < (17.5, 11.5)).all(axis=1) & (seen.depth > 0.0)
                ideal = ideal_rays(stated(camera), xy) if pixels else xy
                rows += [
                    ImagePoint(name, f"g{p}", float(ideal[p, 0]), float(ideal[p, 1]))
                    for p in np.flatnonzero(inside).tolist()
                ]
    control = [
        ControlPoint(f"g{p}", tuple(points[p].tolist()), (0.002,) * 3) for p in range(0, 45, 4)
    ]
    own = tuple(stated(c) if pixels else Camera(c, round(TRUTH[c][0])) for c in cameras)
    return Block(
        "calibration",
        Precision(image_um=1e3 * NOISE),
        TestSettings(),
        own,
        photos=tuple(photos),
        strips=(),
        image_points=tuple(rows),
        control=tuple(control),
        in_pixels=pixels,
    )


STRONG = (20.0, 0.05, -0.08, -0.06, 0.012, -0.002, 3e-4, -2e-4, 2e-4, 1e-4)
"""A lens of 0.3 mm distortion in the corner."""


def convergent(count: int = 24, *, seed: int = 1, noise: float = 0.4e-3) -> Block:
    """Photos of one camera all round an object, rolled by quarters; it states c, nothing else."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((-1.5, -1.0, -0.3), (1.5, 1.0, 0.3), (70, 3))
    n = len(points)
    photos, rows = [], []
    for k in range(count):
        azimuth, height = 2.399963 * k, np.radians(rng.uniform(35.0, 65.0))
        z = np.array(
            [np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height)]
        )
        x = np.cross((0.0, 0.0, 1.0), z)
        x /= np.linalg.norm(x)
        rotation = np.column_stack((x, np.cross(z, x), z)) @ rotation_matrix(
            0.0, 0.0, 0.5 * np.pi * (k % 4)
        )
        centre = rng.uniform(3.2, 4.2) * z
        seen = project(
            np.broadcast_to(centre, (n, 3)),
            np.broadcast_to(rotation, (n, 3, 3)),
            np.ones(n),
            points,
        )
        xy = through_lens(seen.xy, np.array(STRONG)).xy + rng.normal(size=(n, 2)) * noise
        inside = (np.abs(xy) < (14.0, 10.0)).all(axis=1)
        photos.append(Photo(f"i{k:03d}", "cam"))
        rows += [
            ImagePoint(f"i{k:03d}", f"t{p}", float(xy[p, 0]), float(xy[p, 1]))
            for p in np.flatnonzero(inside).tolist()
        ]
    return Block(
        "convergent",
        Precision(image_um=1e3 * noise),
        TestSettings(kind="baarda"),
        (Camera("cam", 20.0, (28.0, 20.0)),),
        photos=tuple(photos),
        strips=(),
        image_points=tuple(rows),
        control=(),
    )
