"""Stated angles of photos that look along X are hardly observations of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.start.lockedangles import locked_angles
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix

SIGMA = 1e-3


def turned(phi: float) -> Block:
    """A block whose ground is turned about Y, its photos' angles observed."""
    scene = aerial(noise_um=5.0, control_sigma=0.02)
    system = rotation_matrix(0.0, phi, 0.0)
    return replace(
        scene.block,
        photos=tuple(
            replace(
                photo,
                position=None,
                rotation=rotation_angles(system @ scene.rotations[photo.id]),
                rotation_sigma=(SIGMA, SIGMA, SIGMA),
            )
            for photo in scene.block.photos
        ),
        control=tuple(
            replace(point, xyz=tuple((system @ np.array(point.xyz, dtype=float)).tolist()))
            for point in scene.block.control
        ),
    )


@pytest.mark.parametrize("phi", [0.0, 1.0, -1.0, np.pi])
def test_angles_far_from_the_lock_are_observations(phi: float) -> None:
    assert locked_angles(make_problem(turned(phi))) is None


@pytest.mark.parametrize("phi", [1.35, -1.35, 1.57])
def test_photos_that_look_along_x_are_named(phi: float) -> None:
    block = turned(phi)
    said = locked_angles(make_problem(block))
    assert said is not None
    names = [photo.id for photo in block.photos]
    assert said.startswith(f"photos {names[0]}, {names[1]}, {names[2]} and 5 more look along X")
    one = tuple(replace(p, rotation_sigma=None) for p in block.photos[1:])
    alone = locked_angles(make_problem(replace(block, photos=(block.photos[0], *one))))
    assert alone is not None
    assert alone.startswith(f"photo {names[0]} looks along X")
    # what is only stated is no observation
    stated = tuple(replace(p, rotation_sigma=None) for p in block.photos)
    assert locked_angles(make_problem(replace(block, photos=stated))) is None


def test_an_adjustment_says_so() -> None:
    said = [text for text in adjust_block(turned(1.35)).warnings if "along X" in text]
    assert len(said) == 1
