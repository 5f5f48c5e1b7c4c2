"""A synthetic strip: the true image points of photographs that were never flown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import radians

import numpy as np

from anaplot.aliases import Array
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Block, Camera, Photo, Precision, Strip, TestSettings
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.modelplan import standard_d

__all__ = ["SyntheticStrip", "Truth", "synthetic_strip", "synthetic_truth"]

Truth = Mapping[str, Mapping[str, tuple[float, float]]]

_BASE = 92.0  # [mm]
_ANGLES = (1.2, 1.2, 2.0)  # standard deviations of omega, phi, kappa [deg]; at most twice occurs
_RELIEF = 0.05  # largest height difference, as a part of c


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticStrip:
    """A strip and its truth.

    Attributes
    ----------
    block
        The block as a person would declare it, without measurements.
    truth
        True image coordinates [mm] by photo and point.
    centres
        (n, 3) projection centres [mm at photo scale].
    rotations
        (n, 3, 3) rotations from image to strip system.
    """

    block: Block
    truth: Truth
    centres: Array
    rotations: Array


def synthetic_strip(
    photos: int,
    *,
    seed: int,
    image_um: float = 5.0,
    test: TestSettings | None = None,
) -> SyntheticStrip:
    """Make a strip whose points lie near the standard positions of the 15-point pattern.

    Parameters
    ----------
    photos
        Number of photos, at least 2.
    seed
        Of the generator of orientations, relief and point positions.
    image_um
        A-priori sigma0 of the block [um].
    test
        Test settings of the block.

    Raises
    ------
    ValueError
        Fewer than two photos.
    """
    if photos < 2:
        raise ValueError(f"a strip has at least two photos, not {photos}")
    ids = tuple(str(101 + k) for k in range(photos))
    camera = Camera("rmk", 152.4, (230.0, 230.0))
    truth, centres, rotations = synthetic_truth(ids, camera, seed=seed, base=_BASE)
    block = Block(
        name="demo",
        precision=Precision(image_um=image_um, tie_variance="exact"),
        test=test or TestSettings(),
        cameras=(camera,),
        photos=tuple(Photo(photo, camera.id) for photo in ids),
        strips=(Strip("1", ids, _BASE),),
    )
    return SyntheticStrip(block, truth, centres, rotations)


def synthetic_truth(
    ids: tuple[str, ...], camera: Camera, *, seed: int, base: float
) -> tuple[Truth, Array, Array]:
    """Make the true image points of a strip of given photos.

    Parameters
    ----------
    ids
        Names of the photos in flight order.
    camera
        Their camera.
    seed
        As for `synthetic_strip`.
    base
        Base at photo scale [mm].

    Returns
    -------
    Truth, (n, 3) array, (n, 3, 3) array
        True image coordinates [mm], projection centres [mm at photo scale], rotations.
    """
    c = camera.c
    reach_x, reach_y = camera.reach()
    photos = len(ids)
    d = standard_d(camera)
    rng = np.random.default_rng([seed, 1])
    centres = np.zeros((photos, 3))
    centres[:, 0] = base * np.arange(photos)
    centres[1:] += rng.normal(0.0, 0.015 * base, (photos - 1, 3))
    angles = np.clip(rng.normal(size=(photos, 3)), -2.0, 2.0)
    angles *= np.radians(_ANGLES)
    rotations = np.array([rotation_matrix(*a) for a in angles.tolist()])
    ground = _terrain(ids, base, d, c, rng)
    truth: dict[str, dict[str, tuple[float, float]]] = {}
    for k, photo in enumerate(ids):
        seen = {}
        for point, xyz in ground.items():
            p = (xyz - centres[k]) @ rotations[k]
            x, y = (-c * p[:2] / p[2]).tolist()
            if abs(x) <= reach_x - 2.0 and abs(y) <= reach_y - 2.0:
                seen[point] = (x, y)
        truth[photo] = seen
    return truth, centres, rotations


def _terrain(
    ids: tuple[str, ...],
    base: float,
    d: float,
    c: float,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Ground points under every photo (1, 2, 3 and twins) and between photos (7, 8, 9)."""
    positions = pattern("15").positions(base, d, twin=(4.0, 4.0))
    under = ("1", "1'", "2", "3", "3'")
    between = ("7", "7'", "8", "9", "9'")
    # smooth terrain: a few waves along and across the flight
    waves = rng.normal(size=(4, 3)) * [1.0, 1.0, radians(180.0)]
    out = {}
    for k, photo in enumerate(ids):
        for label in under + (between if k + 1 < len(ids) else ()):
            x, y = positions[label]
            x, y = np.array([x + base * k, y]) + rng.uniform(-1.5, 1.5, 2)
            phase = waves[:, 0] * x / base + waves[:, 1] * y / d + waves[:, 2]
            height = _RELIEF * c * float(np.sin(phase).mean())
            scale = 1.0 - height / c
            under_x = base * k + (base / 2.0 if label in between else 0.0)
            out[f"{photo}-{label}"] = np.array(
                [under_x + (x - under_x) * scale, y * scale, height - c]
            )
    return out
