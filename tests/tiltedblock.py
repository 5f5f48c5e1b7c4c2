"""A block of tilted photos through a lens, as computer vision writes it: formulas of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WIDTH, HEIGHT = 4000, 3000
FX, FY, CX, CY = 3120.5, 3118.0, 2012.25, 1487.5
K1, K2, P1, P2 = -0.08, 0.03, 0.0006, -0.0004


@dataclass(frozen=True)
class TiltedBlock:
    """What was photographed, and where it was measured.

    Attributes
    ----------
    names
        Of the photos.
    rotations, centres
        (n, 3, 3) from world to camera (x right, y down, z forwards), (n, 3) [m].
    points
        (m, 3) [m]; named 1 to m.
    pixels
        photo index, point index and px from the upper left corner of the upper left pixel.
    """

    names: tuple[str, ...]
    rotations: np.ndarray
    centres: np.ndarray
    points: np.ndarray
    pixels: tuple[tuple[int, int, float, float], ...]


def opencv_pixels(
    rotation: np.ndarray, centre: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (m, 2) pixels by the formulas of OPENCV, and (m,) depths."""
    x, y, z = rotation @ (points - centre).T
    u, v = x / z, y / z
    r2 = u * u + v * v
    radial = 1 + K1 * r2 + K2 * r2 * r2
    du = u * radial + 2 * P1 * u * v + P2 * (r2 + 2 * u * u)
    dv = v * radial + P1 * (r2 + 2 * v * v) + 2 * P2 * u * v
    return np.column_stack((FX * du + CX, FY * dv + CY)), z


def tilted_block(noise_px: float = 0.4, seed: int = 5, origin: float = 0.0) -> TiltedBlock:
    """Return a block of six photos, 15 degrees off the vertical and more, and some 40 points."""
    random = np.random.default_rng(seed)
    points = random.uniform((-60, -45, -8), (60, 45, 12), (40, 3)) + origin
    names, rotations, centres, pixels = [], [], [], []
    for k, (east, north) in enumerate(
        [(-35, -20), (0, -25), (35, -18), (-32, 22), (3, 26), (38, 20)]
    ):
        centre = np.array([east, north, 95.0 + 3 * k]) + origin
        forwards = np.array([-0.28 * east, -0.35 * north, -95.0]) / 95.0
        z = forwards / np.linalg.norm(forwards)
        right = np.array([np.cos(0.4 * k), np.sin(0.4 * k), 0.0])
        y = np.cross(z, right)
        y /= np.linalg.norm(y)
        rotation = np.array([np.cross(y, z), y, z])
        names.append(f"flight {k % 2}/DSC_{k:02d}.jpg")
        rotations.append(rotation)
        centres.append(centre)
        px, depth = opencv_pixels(rotation, centre, points)
        px += random.normal(0.0, noise_px, px.shape)
        inside = (depth > 0) & (px > 20).all(axis=1) & (px < (WIDTH - 20, HEIGHT - 20)).all(axis=1)
        pixels += [(k, int(j), float(px[j, 0]), float(px[j, 1])) for j in np.flatnonzero(inside)]
    seen = np.bincount([j for _, j, _, _ in pixels], minlength=len(points))
    kept = np.flatnonzero(seen >= 2)
    number = {int(j): at for at, j in enumerate(kept)}
    return TiltedBlock(
        tuple(names),
        np.array(rotations),
        np.array(centres),
        points[kept],
        tuple((k, number[j], x, y) for k, j, x, y in pixels if j in number),
    )
