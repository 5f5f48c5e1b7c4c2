"""Blocks of the goals in goals.py: from their truth into a folder, by the package's own writers.

    python tests/benchmarks/goalblocks.py NAME FOLDER

All are made from fixed seeds. A mismatch is a ray to something beside its point, half a millimetre
to five away in the image.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "bundle"))

from bundle_speed import regular_block
from bundleblocks import Scene
from startkinds import drone, measured

from anaplot.exchange.blockfolder import write_block
from anaplot.exchange.formats.colmapnew import write_new
from anaplot.exchange.formats.door import AdjustedResult, Exporting, PhotoResult, PointResult
from anaplot.photogrammetry.block import Block, Strip
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix

SHIFT_M, TURN = 1.0, 0.02  # by which given orientations are wrong
MISMATCH_MM = 0.5, 5.0


def flown(side: int, half: int = 2) -> Block:
    """Return a regular block in strips of which nothing but its measurements is known."""
    block = regular_block(side, half)[0].block
    photos = tuple(replace(photo, position=None, rotation=None) for photo in block.photos)
    names = [photo.id for photo in photos]
    strips = tuple(Strip(str(j + 1), tuple(names[j * side : (j + 1) * side])) for j in range(side))
    return replace(block, photos=photos, strips=strips)


def given(scene: Scene) -> Block:
    """Return a block with values of all photos that are nearly right."""
    rng = np.random.default_rng(3)
    photos = []
    for photo in scene.block.photos:
        turned = scene.rotations[photo.id] @ rotation_matrix(*(rng.normal(size=3) * TURN).tolist())
        centre = scene.centres[photo.id] + rng.normal(size=3) * SHIFT_M
        x, y, z = centre.tolist()
        photos.append(replace(photo, position=(x, y, z), rotation=rotation_angles(turned)))
    return replace(scene.block, photos=tuple(photos))


def mismatched(block: Block, count: int) -> Block:
    """Return a block with so many mismatches."""
    rng = np.random.default_rng(4)
    rows = list(block.image_points)
    for k in rng.choice(len(rows), count, replace=False).tolist():
        off, toward = rng.uniform(*MISMATCH_MM), rng.uniform(0.0, 2.0 * np.pi)
        x, y = rows[k].x + off * np.cos(toward), rows[k].y + off * np.sin(toward)
        rows[k] = replace(rows[k], x=float(x), y=float(y))
    return replace(block, image_points=tuple(rows))


def taken_by_drone(size: int) -> Scene:
    """Return photos of a drone: 2 (3 + 2 size) (2 + size) of them, with some 460 rays each."""
    rng = np.random.default_rng(1)
    return measured(replace(drone(rng, size), share=0.62), rng)


def _colmap(folder: Path) -> None:
    """Write the true orientations and points, as COLMAP would have found them."""
    scene = taken_by_drone(22)
    photos = tuple(
        PhotoResult(
            photo.id,
            tuple(scene.centres[photo.id].tolist()),
            (None,) * 3,
            rotation_angles(scene.rotations[photo.id]),
            (None,) * 3,
            0,
            None,
            0,
        )
        for photo in scene.block.photos
    )
    nowhere = ((0.0,) * 3,) * 3
    points = tuple(
        PointResult(name, tuple(xyz.tolist()), nowhere, 0, None, 0, "new")
        for name, xyz in scene.points.items()
    )
    write_new(Exporting(scene.block, folder, adjusted=AdjustedResult(photos, points, 1.0)), folder)


def _block(make: Callable[[], Block]) -> Callable[[Path], None]:
    return lambda folder: write_block(folder, make())


MAKERS: dict[str, Callable[[Path], None]] = {
    "planned": _block(lambda: replace(flown(10), image_points=(), control=())),
    "100": _block(lambda: flown(10)),
    "400": _block(lambda: mismatched(flown(20), 20)),
    "2500": _block(lambda: flown(50)),
    "10000": _block(lambda: flown(100, 3)),
    "drone": _block(lambda: given(taken_by_drone(14))),
    "drone-errors": _block(lambda: mismatched(given(taken_by_drone(14)), 920)),
    "million": _block(lambda: mismatched(given(taken_by_drone(22)), 2000)),
    "colmap": _colmap,
}
"""What writes what is measured, by its name."""


if __name__ == "__main__":
    MAKERS[sys.argv[1]](Path(sys.argv[2]))
