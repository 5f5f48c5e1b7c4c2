"""Weak networks with mismatches, and an independent dense adjustment that tells where they end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from bundleblocks import Scene, make_scene
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.block import Photo
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix


def short_base(
    seed: int,
    *,
    photos: int = 19,
    points: int = 90,
    base: float = 1.0,
    near: float = 8.0,
    far: float = 60.0,
    c: float = 50.0,
    half: float = 12.0,
    mismatches: float = 0.02,
    tilt: float = 0.05,
    noise_um: float = 5.0,
    stated: tuple[float, float] | None = (0.05, 0.01),
) -> Scene:
    """Photos next to each other on a short base, every point in three or more of them.

    Parameters
    ----------
    base, near, far
        Length of the row of photos, and depths of the points [m].
    half
        Half the format [mm].
    mismatches
        Share of the rays that belong to some other place in the image.
    stated
        Errors of stated orientations [m, rad]; None: none are stated.
    """
    rng = np.random.default_rng(seed)
    stations = {}
    for k in range(photos):
        at = np.array([base * k / (photos - 1), 0.0, 0.0]) + rng.normal(size=3) * 0.02 * base
        stations[f"{k + 1:02d}"] = (at, rotation_matrix(*(rng.normal(size=3) * tilt)))
    at = {}
    for k in range(points):
        depth = 1.0 / rng.uniform(1.0 / far, 1.0 / near)
        x, y = rng.uniform(-half, half, 2) / c * depth
        at[f"p{k + 1}"] = np.array([x + base * rng.uniform(), y, -depth])
    # a point is followed through some photos in a row
    first = {name: int(rng.integers(0, photos - 3)) for name in at}
    last = {name: k + int(rng.integers(3, 9)) for name, k in first.items()}

    def sees(photo: str, point: str, xy: np.ndarray) -> bool:
        k = int(photo) - 1
        return first[point] <= k < last[point] and bool(np.abs(xy).max() <= 1.3 * half)

    scene = make_scene(stations, at, c=c, sees=sees, noise_um=noise_um, sigma_um=5.0, seed=seed)
    counts: dict[str, int] = {}
    for row in scene.block.image_points:
        counts[row.point] = counts.get(row.point, 0) + 1
    rows = [row for row in scene.block.image_points if counts[row.point] >= 3]
    wrong = rng.choice(len(rows), round(mismatches * len(rows)), replace=False)
    for k in wrong.tolist():
        x, y = (rng.normal(size=2) * 0.3 + (rows[k].x, rows[k].y)).tolist()
        rows[k] = replace(rows[k], x=x, y=y)
    block = replace(scene.block, image_points=tuple(rows))
    if stated is not None:
        shift, turn = stated
        block = replace(
            block,
            photos=tuple(
                Photo(
                    p.id,
                    p.camera,
                    position=tuple((scene.centres[p.id] + rng.normal(size=3) * shift).tolist()),
                    rotation=rotation_angles(
                        scene.rotations[p.id] @ rotation_matrix(*(rng.normal(size=3) * turn))
                    ),
                )
                for p in block.photos
            ),
        )
    scene.block = block
    return scene


def dense_minimum(
    problem: Problem, start: BlockState, evaluations: int = 2000
) -> tuple[float, BlockState]:
    """v'Pv at the end of scipy's trust region, and where: nothing of the room's own is used.

    A free datum is what the trust region makes of it: it stays near the start.
    """
    n, p = len(start.centres), len(start.points)
    known = problem.known - start.origin
    rows = np.isfinite(problem.known_sigma)

    def unpack(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        photos, points = x[: 6 * n].reshape(n, 6), x[6 * n :].reshape(p, 3)
        turned = Rotation.from_rotvec(photos[:, 3:]).as_matrix() @ start.rotations
        at = np.where(problem.fixed, known, start.points + points)
        return start.centres + photos[:, :3], turned, at

    def residuals(x: np.ndarray) -> np.ndarray:
        centres, turned, at = unpack(x)
        u = np.einsum(
            "nji,nj->ni", turned[problem.photo], at[problem.point] - centres[problem.photo]
        )
        seen = -problem.c[problem.photo, None] * u[:, :2] / u[:, 2:]
        return np.concatenate(
            (
                ((seen - problem.xy) / problem.sigma[:, None]).ravel(),
                ((at - known)[rows] / problem.known_sigma[rows]),
            )
        )

    def jacobian(x: np.ndarray) -> np.ndarray:
        photos = x[: 6 * n].reshape(n, 6)
        centres, turned, at = unpack(x)
        m = len(problem.photo)
        r = turned[problem.photo]
        away = at[problem.point] - centres[problem.photo]
        u = np.einsum("nji,nj->ni", r, away)
        c = problem.c[problem.photo] / problem.sigma
        by_u = np.zeros((m, 2, 3))
        by_u[:, 0, 0] = by_u[:, 1, 1] = -c / u[:, 2]
        by_u[:, 0, 2] = c * u[:, 0] / u[:, 2] ** 2
        by_u[:, 1, 2] = c * u[:, 1] / u[:, 2] ** 2
        by_at = by_u @ r.transpose(0, 2, 1)
        # left Jacobian of the rotation vector
        cross = np.zeros((m, 3, 3))
        cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -away[:, 2], away[:, 1], -away[:, 0]
        cross -= cross.transpose(0, 2, 1)
        left = np.array([_left_jacobian(v) for v in photos[:, 3:]])
        by_turn = by_at @ cross @ left[problem.photo]
        out = np.zeros((2 * m + int(rows.sum()), 6 * n + 3 * p))
        for axis in range(2):
            for k in range(3):
                at_row = 2 * np.arange(m) + axis
                out[at_row, 6 * problem.photo + k] = -by_at[:, axis, k]
                out[at_row, 6 * problem.photo + 3 + k] = by_turn[:, axis, k]
                free = ~problem.fixed[problem.point, k]
                out[at_row, 6 * n + 3 * problem.point + k] = by_at[:, axis, k] * free
        which = np.argwhere(rows)
        out[2 * m + np.arange(len(which)), 6 * n + 3 * which[:, 0] + which[:, 1]] = (
            1.0 / problem.known_sigma[rows]
        )
        return out

    x0 = np.zeros(6 * n + 3 * p)
    found = least_squares(
        residuals, x0, jacobian, method="lm", x_scale="jac", ftol=1e-15, xtol=1e-15, gtol=1e-12,
        max_nfev=evaluations,
    )  # fmt: skip
    centres, turned, at = unpack(found.x)
    return 2.0 * float(found.cost), replace(start, centres=centres, rotations=turned, points=at)


def _left_jacobian(v: np.ndarray) -> np.ndarray:
    angle = float(np.linalg.norm(v))
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    if angle < 1e-6:
        return np.eye(3) + 0.5 * k + k @ k / 6.0
    return (
        np.eye(3)
        + (1.0 - np.cos(angle)) / angle**2 * k
        + (angle - np.sin(angle)) / angle**3 * k @ k
    )
