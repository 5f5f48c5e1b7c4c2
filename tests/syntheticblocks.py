"""A synthetic block with control that nobody has flown: what is declared, and its truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.block import (
    Block,
    ControlPoint,
    Photo,
    Precision,
    Strip,
    TestSettings,
)
from anaplot.planning.synthetic import BASE, CAMERA, Truth
from anaplot.planning.syntheticblock import flown


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticBlock:
    """A block and its truth.

    Attributes
    ----------
    block
        As a person would declare it, with control and without measurements. The control's
        coordinates have errors of their standard deviations.
    truth
        True image coordinates [mm] by photo and point.
    ground
        (3,) true ground coordinates [m] by point.
    """

    block: Block
    truth: Truth
    ground: Mapping[str, Array] = field(repr=False)


def synthetic_block(
    strips: int = 2,
    photos: int = 5,
    *,
    seed: int,
    image_um: float = 5.0,
    control_m: float = 0.02,
    test: TestSettings | None = None,
) -> SyntheticBlock:
    """Make a block of parallel strips, every second one flown back.

    Parameters
    ----------
    strips, photos
        How many strips, and photos in each of them, at least 2: 101, 102, ..., 201, ...
    seed
        Of the generator of orientations, relief, positions and errors of the control.
    image_um, control_m
        A-priori sigma0 of the block [um], and standard deviation of the control [m].
    test
        Test settings of the block.

    Raises
    ------
    ValueError
        No strip, or fewer than two photos.
    """
    if strips < 1 or photos < 2:
        raise ValueError(f"a block has strips of at least two photos, not {strips} of {photos}")
    rng = np.random.default_rng([seed, 4])
    ids = tuple(tuple(str(100 * (s + 1) + k + 1) for k in range(photos)) for s in range(strips))
    truth, ground, control = flown(ids, CAMERA, BASE, rng)
    block = Block(
        name="synthetic",
        precision=Precision(image_um=image_um, tie_variance="exact", control_m=control_m),
        test=test or TestSettings(),
        cameras=(CAMERA,),
        photos=tuple(Photo(photo, CAMERA.id) for photo in truth),
        strips=tuple(Strip(str(s + 1), photos, BASE) for s, photos in enumerate(ids)),
        control=tuple(_control(name, ground[name], control_m, rng) for name in control),
    )
    return SyntheticBlock(block, truth, ground)


def _control(name: str, at: Array, sigma: float, rng: np.random.Generator) -> ControlPoint:
    x, y, z = (at + rng.normal(0.0, sigma, 3)).round(4).tolist()
    return ControlPoint(name, (x, y, z), (sigma, sigma, sigma))
