"""Points that lie close together by chance, as an image matcher's do, are no accident of names."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom
from startkinds import Layout, measured

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.doublenames import double_names
from anaplot.photogrammetry.block import Block, Camera
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix

POINTS = 7000


def matched(seed: int) -> Block:
    """A drone's 20 photos of open ground: two of five points that a photo shows are found in it."""
    rng = np.random.default_rng(seed)
    x, y = (g.ravel() for g in np.meshgrid(np.arange(5) * 25.0, np.arange(4) * 30.0))
    centres = np.column_stack((x, y, np.full(len(x), 80.0))) + rng.normal(0.0, 1.5, (len(x), 3))
    turned = [
        rotation_matrix(0.0, 0.0, k) @ rotation_matrix(*rng.normal(size=3) * 0.09)
        for k in rng.choice([0.0, np.pi], len(x)).tolist()
    ]
    points = rng.uniform((-30.0, -40.0, 0.0), (130.0, 130.0, 0.0), (POINTS, 3))
    points[:, 2] = 2.0 * np.sin(points[:, 0] / 20.0) + rng.normal(0.0, 0.02, POINTS)
    cameras = (Camera("cam", 50.0),)
    layout = Layout(centres, np.array(turned), points, cameras=cameras, control=(6, 0.0), share=0.4)
    scene = measured(layout, rng)
    photos = tuple(
        replace(
            photo,
            position=tuple(scene.centres[photo.id].tolist()),
            rotation=rotation_angles(scene.rotations[photo.id]),
        )
        for photo in scene.block.photos
    )
    return replace(scene.block, photos=photos)


@pytest.mark.slow
def test_neighbours_by_chance_are_seldom_named() -> None:
    """Pairs within their accuracy were named in most of these blocks, each of them good."""
    runs = 12
    named = sum(bool(double_names(adjust_block(matched(seed)))) for seed in range(runs))
    assert named <= binom.isf(1e-3, runs, 0.05)  # significance 0.001


@pytest.mark.slow
def test_a_point_under_two_names_is_named_among_neighbours_by_chance() -> None:
    block = matched(3)
    rays = Counter(row.point for row in block.image_points)
    known = {row.point for row in block.control}
    point = next(name for name, count in rays.items() if count > 5 and name not in known)
    mine = [k for k, row in enumerate(block.image_points) if row.point == point]
    rows = [
        replace(row, point="new") if k in mine[::2] else row
        for k, row in enumerate(block.image_points)
    ]
    found = double_names(adjust_block(replace(block, image_points=tuple(rows))))
    assert {point, "new"} in [set(one.points) for one in found]
