"""A synthetic strip: the true image points of photographs that were never flown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count
from math import dist, radians

import numpy as np

from anaplot.aliases import Array
from anaplot.orientation.ownpattern import PointPattern
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Block, Camera, Photo, Precision, Strip, TestSettings
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.modelplan import standard_d

__all__ = [
    "BASE",
    "BETWEEN",
    "CAMERA",
    "RELIEF",
    "TILTS_DEG",
    "UNDER",
    "SyntheticStrip",
    "Truth",
    "further_places",
    "synthetic_strip",
    "synthetic_truth",
]

Truth = Mapping[str, Mapping[str, tuple[float, float]]]

CAMERA = Camera("rmk", 152.4, (230.0, 230.0))
"""With what is photographed where no camera is given."""
BASE = 92.0
"""Base at photo scale [mm]: 60 % of 230."""
TILTS_DEG = (1.2, 1.2, 2.0)
"""Standard deviations of omega, phi, kappa [deg]; at most twice occurs."""
RELIEF = 0.05
"""Largest height difference, as a part of c."""
UNDER = ("1", "1'", "2", "3", "3'")
BETWEEN = ("7", "7'", "8", "9", "9'")
"""Standard points under a photo, and between it and the next one."""
_SAME_PLACE = 9.0  # mm: so near a standard point is taken for one that is wanted; twins are 8 apart


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
    truth, centres, rotations = synthetic_truth(ids, CAMERA, seed=seed, base=BASE)
    block = Block(
        name="demo",
        precision=Precision(image_um=image_um, tie_variance="exact"),
        test=test or TestSettings(),
        cameras=(CAMERA,),
        photos=tuple(Photo(photo, CAMERA.id) for photo in ids),
        strips=(Strip("1", ids, BASE),),
    )
    return SyntheticStrip(block, truth, centres, rotations)


def synthetic_truth(
    ids: tuple[str, ...],
    camera: Camera,
    *,
    seed: int,
    base: float,
    wanted: PointPattern | None = None,
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
    wanted
        A point pattern that finds its points there, too.

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
    angles *= np.radians(TILTS_DEG)
    rotations = np.array([rotation_matrix(*a) for a in angles.tolist()])
    ground = _terrain(ids, base, d, c, rng, wanted)
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
    wanted: PointPattern | None,
) -> dict[str, Array]:
    """Ground points under every photo (1, 2, 3 and twins) and between photos (7, 8, 9).

    After them what a pattern wants in other places.
    """
    # smooth terrain: a few waves along and across the flight
    waves = rng.normal(size=(4, 3)) * [1.0, 1.0, radians(180.0)]

    def raised(x: float, y: float, under_x: float) -> Array:
        phase = waves[:, 0] * x / base + waves[:, 1] * y / d + waves[:, 2]
        height = RELIEF * c * float(np.sin(phase).mean())
        scale = 1.0 - height / c
        return np.array([under_x + (x - under_x) * scale, y * scale, height - c])

    out = {}
    for name, (place, under_x) in _standard_places(ids, base, d).items():
        x, y = np.array(place) + rng.uniform(-1.5, 1.5, 2)
        out[name] = raised(x, y, under_x)
    if wanted is not None:
        for name, (x, y) in further_places(wanted, ids, base, d).items():
            out[name] = raised(x, y, x)
    return out


def _standard_places(
    ids: Sequence[str], base: float, d: float
) -> dict[str, tuple[tuple[float, float], float]]:
    """Return where the standard points of a strip lie [mm at photo scale].

    Of each by name its place from below the first photo, and the x of where it is below.
    """
    positions = pattern("15").positions(base, d, twin=(4.0, 4.0))
    out = {}
    for k, photo in enumerate(ids):
        for label in UNDER + (BETWEEN if k + 1 < len(ids) else ()):
            x, y = positions[label]
            under_x = base * k + (base / 2.0 if label in BETWEEN else 0.0)
            out[f"{photo}-{label}"] = (x + base * k, y), under_x
    return out


def further_places(
    wanted: PointPattern, ids: Sequence[str], base: float, d: float
) -> dict[str, tuple[float, float]]:
    """Return where a strip needs points beside the standard ones, so that a pattern finds its own.

    Parameters
    ----------
    wanted
        The pattern.
    ids
        Names of the photos in flight order.
    base, d
        Base, and distance of the upper and lower standard points from the x axis [mm].

    Returns
    -------
    dict
        Places from below the first photo [mm at photo scale], by the names of the points.
    """
    known = {name: place for name, (place, _) in _standard_places(ids, base, d).items()}
    further: dict[str, tuple[float, float]] = {}
    before: set[str] = set()
    for k, photo in enumerate(ids[:-1]):
        here: set[str] = set()
        for label, (along, y) in wanted.positions(base, d, twin=(4.0, 4.0)).items():
            x = along + base * k
            # what is no tie is measured in one model only
            apart = here if label in wanted.transferred else here | before
            near = {
                name: away
                for name, place in known.items()
                if name not in apart and (away := dist(place, (x, y))) < _SAME_PLACE
            }
            name = min(near, key=near.__getitem__, default="")
            if not name:
                names = (f"{photo}-{label}{n}" for n in chain(("",), map(".{}".format, count(2))))
                name = next(one for one in names if one not in known)
                known[name] = further[name] = (x, y)
            here.add(name)
        before = here
    return further
