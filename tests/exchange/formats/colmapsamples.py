"""COLMAP models for the tests, written with nothing of the package's."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from anaplot.aliases import Array

NONE = 2**64 - 1
NAMES = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")


@dataclass
class SampleImage:
    """An image: pose from world to camera, and features, each with a point's number or None."""

    number: int
    camera: int
    name: str
    pose: tuple[float, ...]
    features: list[tuple[float, float, int | None]] = field(default_factory=list)


@dataclass
class Sample:
    """A model: cameras (model, width, height, parameters), images, places of points."""

    cameras: dict[int, tuple[int, int, int, tuple[float, ...]]]
    images: list[SampleImage]
    points: dict[int, tuple[float, ...]]

    def tracks(self) -> dict[int, list[tuple[int, int]]]:
        """The images and features of every point."""
        out: dict[int, list[tuple[int, int]]] = {number: [] for number in self.points}
        for image in self.images:
            for k, (_, _, point) in enumerate(image.features):
                if point is not None:
                    out[point].append((image.number, k))
        return out

    def binary(self) -> dict[str, bytes]:
        """Its binary files."""
        cameras = [struct.pack("<Q", len(self.cameras))]
        for number, (model, width, height, params) in self.cameras.items():
            head = struct.pack("<IiQQ", number, model, width, height)
            cameras.append(head + struct.pack(f"<{len(params)}d", *params))
        images = [struct.pack("<Q", len(self.images))]
        for image in self.images:
            images.append(struct.pack("<I7dI", image.number, *image.pose, image.camera))
            images.append(image.name.encode() + b"\0" + struct.pack("<Q", len(image.features)))
            for x, y, point in image.features:
                images.append(struct.pack("<2dQ", x, y, NONE if point is None else point))
        points = [struct.pack("<Q", len(self.points))]
        for number, track in self.tracks().items():
            head = struct.pack("<Q3d3Bd", number, *self.points[number], 9, 8, 7, 0.5)
            points.append(head + struct.pack("<Q", len(track)))
            points += [struct.pack("<2I", *element) for element in track]
        parts = {"cameras": cameras, "images": images, "points3D": points}
        return {f"{name}.bin": b"".join(part) for name, part in parts.items()}

    def text(self) -> dict[str, bytes]:
        """Its text files, with remarks, and a blank line for an image without features."""
        cameras = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
        for number, (model, width, height, params) in self.cameras.items():
            shown = " ".join(map(repr, params))
            cameras.append(f"{number} {NAMES[model]} {width} {height} {shown}")
        images = ["# two lines an image", "#   X Y POINT3D_ID"]
        for image in self.images:
            pose = " ".join(map(repr, image.pose))
            images.append(f"{image.number} {pose} {image.camera} {image.name}")
            images.append(
                " ".join(f"{x!r} {y!r} {-1 if p is None else p}" for x, y, p in image.features)
            )
        points = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]"]
        for number, track in self.tracks().items():
            place = " ".join(map(repr, self.points[number]))
            shown = " ".join(f"{image} {index}" for image, index in track)
            points.append(f"{number} {place} 9 8 7 0.5 {shown}")
        parts = {"cameras": cameras, "images": images, "points3D": points}
        return {f"{name}.txt": "\n".join([*part, ""]).encode() for name, part in parts.items()}

    def write(self, folder: Path, *, text: bool = False) -> Path:
        """Write its files into a folder, and return it."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in (self.text() if text else self.binary()).items():
            (folder / name).write_bytes(data)
        return folder


def to_camera(pose: tuple[float, ...]) -> Array:
    """Return the (3, 3) rotation of a pose, from world to camera."""
    w, x, y, z = np.array(pose[:4]) / np.linalg.norm(pose[:4])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    out: Array = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return out


def projected(camera: tuple[int, int, int, tuple[float, ...]], pose: tuple[float, ...], xyz: Array):  # type: ignore[no-untyped-def]
    """Return where (n, 3) points are seen [px], for the first five models."""
    model, _, _, p = camera
    fx, fy, cx, cy, *more = (p[0], *p) if model in (0, 2, 3) else p
    k1, k2, p1, p2 = (*more, 0.0, 0.0, 0.0, 0.0)[:4]
    inside = xyz @ to_camera(pose).T + pose[4:]
    x, y = inside[:, 0] / inside[:, 2], inside[:, 1] / inside[:, 2]
    r2 = x * x + y * y
    factor = 1 + k1 * r2 + k2 * r2 * r2
    u = x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * factor + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
    return np.stack((fx * u + cx, fy * v + cy), axis=1)


def sample(photos: int = 6, points: int = 40, noise: float = 0.3, seed: int = 5) -> Sample:
    """Return convergent photos of three cameras around a ball of points; some tracks twice.

    Names have slashes, numbers have gaps, points are seen in some of the photos only.
    """
    rng = np.random.default_rng(seed)
    cameras = {
        3: (3, 2000, 1500, (1500.0, 1004.0, 745.0, -0.08, 0.02)),
        7: (4, 2000, 1500, (1510.0, 1490.0, 998.0, 752.0, -0.05, 0.01, 0.001, -0.0007)),
        12: (1, 1600, 1200, (1300.0, 1320.0, 800.5, 600.25)),
    }
    xyz = np.array((2000.0, -500.0, 30.0)) + rng.normal(0.0, 0.8, (points, 3))
    numbers = np.cumsum(rng.integers(1, 9, points)).tolist()
    out = Sample(cameras, [], dict(zip(numbers, map(tuple, xyz.tolist()), strict=True)))
    for k in range(photos):
        angle = 0.5 * k
        axis = np.array([0.15 * np.sin(2.0 * k), np.sin(angle / 2), 0.1])
        quaternion = np.array([np.cos(angle / 2), *axis])
        quaternion /= np.linalg.norm(quaternion)
        turned = to_camera((*quaternion, 0, 0, 0))
        shift = -turned @ (2000.0, -500.0, 30.0) + (0.1 * k, -0.2, 8.0)
        name = f"day-{1 + k % 2}/IMG_{k:03d}.jpg"
        pose = (*quaternion.tolist(), *shift.tolist())
        image = SampleImage(5 + 4 * k, (3, 7, 12)[k % 3], name, pose)
        seen = projected(cameras[image.camera], pose, xyz) + rng.normal(0, noise, (points, 2))
        for j, (x, y) in enumerate(seen.tolist()):
            image.features.append((x + 31.0, y, None))
            if (j + k) % 5:
                image.features.append((x, y, numbers[j]))
                if (j + 3 * k) % 20 == 1:
                    image.features.append((x + 2.5, y - 1.5, numbers[j]))  # the track once more
        out.images.append(image)
    return out
