"""A block of tilted photos that formats of tables are tried with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from anaplot.exchange.formats.door import Note
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    Strip,
    TestSettings,
    in_pixels,
)
from anaplot.photogrammetry.measuredimage import pixels_of_mm
from anaplot.photogrammetry.rotation import rotation_matrix

C = 152.4


def table_block(*, strips: bool = True) -> Block:
    """Two strips of three photos over large coordinates, 20 points, five of them control."""
    rng = np.random.default_rng(7)
    ground = np.array(
        [
            (2_600_000.0 + 300.0 * i, 1_200_000.0 + 420.0 * k, 0.0)
            for i in range(5)
            for k in range(4)
        ]
    )
    ground[:, 2] = 400.0 + 60.0 * rng.random(20)
    names = [str(1000 + k) for k in range(20)]
    photos, rays = [], []
    for k in range(6):
        photo = f"{101 + k}"
        position = (2_600_150.0 + 450.0 * (k % 3), 1_200_300.0 + 660.0 * (k // 3), 1950.0 + 9.0 * k)
        angles = (0.03 * (k % 2) - 0.01, 0.02 - 0.015 * (k % 3), 0.04 * k if k < 3 else 3.1)
        photos.append(Photo(photo, "camera", position, angles))
        seen = (ground - position) @ rotation_matrix(*angles)
        xy = -C * seen[:, :2] / seen[:, 2:] + 0.004 * rng.standard_normal((20, 2))
        rays += [
            ImagePoint(photo, name, *map(float, row))
            for name, row in zip(names, xy, strict=True)
            if np.abs(row).max() < 112.0
        ]
    spots = (0, 3, 16, 19, 9)
    control = [ControlPoint(names[k], tuple(map(float, ground[k]))) for k in spots]
    return Block(
        "table",
        Precision(image_um=4.0, control_m=0.05),
        TestSettings(),
        (Camera("camera", C),),
        tuple(photos),
        (Strip("1", ("101", "102", "103")), Strip("2", ("104", "105", "106"))) if strips else (),
        tuple(rays),
        tuple(control),
    )


def without_poses(block: Block) -> Block:
    """The block without approximate orientations."""
    photos = tuple(replace(photo, position=None, rotation=None) for photo in block.photos)
    return replace(block, photos=photos)


def rays_of(block: Block) -> dict[tuple[str, str], tuple[float, float]]:
    """Image coordinates by photo and point."""
    return {(row.photo, row.point): (row.x, row.y) for row in block.image_points}


def pixel_table_block() -> Block:
    """The same, measured in pixels of 12.5 um with a principal point beside the middle."""
    block = without_poses(table_block(strips=False))
    camera = in_pixels(block.cameras[0], (18500, 18400), 12.5, (9243.25, 9206.5))
    places = pixels_of_mm(camera, [(row.x, row.y) for row in block.image_points]).tolist()
    rays = tuple(
        replace(row, measured=(x, y), sigma_um=6.25 if k % 3 else 12.5)
        for k, (row, (x, y)) in enumerate(zip(block.image_points, places, strict=True))
    )
    control = tuple(replace(row, sigma=(0.02, 0.03, 0.05)) for row in block.control)
    precision = Precision(image_um=12.5)
    return replace(
        block,
        precision=precision,
        cameras=(camera,),
        image_points=rays,
        control=(replace(control[0], use="check"), *control[1:]),
        in_pixels=True,
    )


def texts(notes: Iterable[Note]) -> str:
    """What a door says of what it read or wrote, a note a line."""
    return "\n".join(f"{note.what} {note.count} {note.text}" for note in notes)


def measured_of(block: Block) -> dict[tuple[str, str], tuple[float, float]]:
    """What was measured by photo and point."""
    return {(row.photo, row.point): row.measured for row in block.image_points}
