"""A flight as OpenSfM would write it, by its own formulas: nothing here is the program's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

LON, LAT, HEIGHT = 11.6, 48.1, 500.0
CAMERA = {
    "projection_type": "brown", "width": 4000, "height": 3000, "focal_x": 0.85, "focal_y": 0.852,
    "c_x": 0.004, "c_y": -0.003, "k1": -0.08, "k2": 0.03, "k3": -0.005, "p1": 0.0004, "p2": -0.0003,
}  # fmt: skip


def seen(camera: dict[str, Any], rotation: np.ndarray, shift: np.ndarray, at: np.ndarray):
    """(n, 2) normalized coordinates of (n, 3) places."""
    x, y, z = (at @ rotation.T + shift).T
    x, y = x / z, y / z
    r2 = x * x + y * y
    k1, k2, k3, p1, p2 = (camera.get(key, 0.0) for key in ("k1", "k2", "k3", "p1", "p2"))
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    fx, fy = camera.get("focal_x", camera.get("focal")), camera.get("focal_y", camera.get("focal"))
    return np.stack((fx * u + camera.get("c_x", 0.0), fy * v + camera.get("c_y", 0.0)), axis=1)


class Flight:
    """3 x 4 tilted photos 100 m above 60 points and 6 control points.

    `noise_px`: standard deviation of what is measured.
    """

    def __init__(self, camera: dict[str, Any] = CAMERA, noise_px: float = 0.0) -> None:
        rng = np.random.default_rng(5)
        self.camera = camera
        self.points = np.column_stack((rng.uniform(-60, 90, (60, 2)), rng.uniform(-5, 8, 60)))
        self.control = np.array(
            [[-45, -45, 1.0], [75, -40, 2.5], [70, 75, -1], [-40, 70, 0], [15, 12, 5], [20, -30, 3]]
        )
        self.shots: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for row in range(3):
            for column in range(4):
                centre = np.array([-40.0 + 38 * column, -40.0 + 50 * row, 100.0 + 3 * row])
                down = Rotation.from_euler("x", 180, degrees=True)
                tilt = Rotation.from_euler(
                    "xyz", [*rng.uniform(-9, 9, 2), 180 * (row % 2)], degrees=True
                )
                rotation = (tilt * down).as_matrix()
                self.shots[f"run {row}/IMG_{column}.JPG"] = (rotation, -rotation @ centre)
        size = max(camera["width"], camera["height"])
        limit = 0.5 * np.array([camera["width"], camera["height"]]) / size
        self.rays: list[tuple[str, int, float, float]] = []
        self.control_rays: list[tuple[str, int, float, float]] = []
        for name, (rotation, shift) in self.shots.items():
            for places, rays in ((self.points, self.rays), (self.control, self.control_rays)):
                found = seen(camera, rotation, shift, places)
                found += rng.normal(0.0, noise_px / size, found.shape)
                for k in np.flatnonzero((np.abs(found) < limit).all(axis=1)):
                    rays.append((name, int(k), *found[k].tolist()))

    def reconstruction(self) -> dict[str, Any]:
        """The content of reconstruction.json, without its list."""
        shots = {}
        for name, (rotation, shift) in self.shots.items():
            shots[name] = {
                "rotation": Rotation.from_matrix(rotation).as_rotvec().tolist(),
                "translation": shift.tolist(),
                "camera": "v2 own 4000 3000 brown 0.85",
                "gps_position": (-rotation.T @ shift).tolist(),
                "gps_dop": 15.0,
            }
        points = {
            str(k): {"coordinates": at.tolist(), "color": [1.0, 2.0, 3.0]}
            for k, at in enumerate(self.points)
        }
        cameras = {"v2 own 4000 3000 brown 0.85": self.camera}
        return {"cameras": cameras, "shots": shots, "points": points}

    def tracks(self, version: int) -> str:
        """tracks.csv."""
        lines = [] if version == 0 else [f"OPENSFM_TRACKS_VERSION_v{version}"]
        for k, (name, point, x, y) in enumerate(self.rays):
            fields = [name, point, k, repr(x), repr(y), *([0.002] if version else []), 9, 8, 7]
            lines.append("\t".join(map(str, fields + [0, 0] * (version == 2))))
        return "\n".join(lines) + "\n"

    def gcp_list(self, system: str, places: np.ndarray, named: bool = True) -> str:
        """gcp_list.txt with control at places of a system."""
        lines = [system, "# a remark"]
        width, height = self.camera["width"], self.camera["height"]
        for name, k, x, y in self.control_rays:
            px, py = x * width + width / 2, y * width + height / 2
            at = " ".join(repr(v) if v == v else "NaN" for v in places[k].tolist())
            label = f" P{k} extra" if named else ""
            lines.append(f"{at} {px!r} {py!r} {name}{label}")
        return "\n".join(lines) + "\n"

    def write(
        self, folder: Path, version: int = 2, more: list[dict[str, Any]] | None = None
    ) -> None:
        """Write the model."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "reconstruction.json").write_text(
            json.dumps([*(more or []), self.reconstruction()])
        )
        (folder / "tracks.csv").write_text(self.tracks(version))
        (folder / "reference_lla.json").write_text(
            json.dumps({"latitude": LAT, "longitude": LON, "altitude": HEIGHT})
        )
