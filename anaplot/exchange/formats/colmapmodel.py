"""A COLMAP model as its files hold it: cameras, images with what they observe, points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.errors import InputError
from anaplot.exchange.formats.colmapcamera import MODELS, ColmapCamera
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import quoted

__all__ = ["NO_POINT", "PARTS", "ColmapImage", "ColmapModel", "Complain", "checked", "made_camera"]

PARTS = ("cameras", "images", "points3D")
"""Files of a model, without their endings."""

NO_POINT = -1
_MAX_SIZE = 1_000_000  # px

Complain = Callable[[str], InputError]
"""Makes the error about a place in a file."""


@dataclass(frozen=True, slots=True)
class ColmapImage:
    """An image and what it observes of points.

    Attributes
    ----------
    id, camera
        COLMAP's numbers.
    name
        Its name.
    pose
        (7,) quaternion, w first, and translation, from world to camera.
    index
        (n,) which of its features have a point.
    xy
        (n, 2) where they are [px].
    point
        (n,) numbers of their points.
    """

    id: int
    camera: int
    name: str
    pose: tuple[float, ...]
    index: Index
    xy: Array
    point: Index

    @property
    def oriented(self) -> bool:
        """Whether it has a pose."""
        return all(map(math.isfinite, self.pose)) and any(self.pose[:4])


@dataclass(frozen=True, slots=True)
class ColmapModel:
    """A model.

    Attributes
    ----------
    folder
        Where its files are.
    ending
        Of their names: ".bin" or ".txt".
    cameras
        By their numbers.
    images
        In file order.
    points
        (m,) numbers of the points, in file order.
    track_points, track_images, track_index
        (t,) elements of the points' tracks: which point, in which image, which of its features.
    """

    folder: Path
    ending: str
    cameras: dict[int, ColmapCamera]
    images: tuple[ColmapImage, ...]
    points: Index
    track_points: Index
    track_images: Index
    track_index: Index

    def file(self, part: str) -> Path:
        """Return the path of one of its files."""
        return self.folder / f"{part}{self.ending}"


def made_camera(
    number: int, model: int, size: tuple[int, int], params: Iterable[float], fail: Complain
) -> ColmapCamera:
    """Return a camera; raises the error that `fail` makes for one that cannot be."""
    made = ColmapCamera(number, model, *size, tuple(params))
    if not MODELS[model].kind:
        raise fail(f"camera {number}: the model {MODELS[model].name} is not read")
    if not all(1 <= side <= _MAX_SIZE for side in size):
        raise fail(f"camera {number}: images of {size[0]} x {size[1]} px")
    if not all(map(math.isfinite, made.params)):
        raise fail(f"camera {number}: a parameter that is no finite number")
    if min(made.focal) <= 0.0:
        raise fail(f"camera {number}: a focal length that is not greater than 0")
    return made


def checked(model: ColmapModel, where: Callable[[str], Complain]) -> ColmapModel:
    """Return a model whose files fit each other.

    Parameters
    ----------
    model
        What was read.
    where
        Makes errors about one of the `PARTS`.

    Raises
    ------
    InputError
        A number or name twice, a name that cannot be one, an unknown camera or point, a
        coordinate that is no finite number.
    """
    fail = where("images")
    numbers: set[int] = set()
    names: set[str] = set()
    for image in model.images:
        fault = name_fault(image.name)
        if fault is not None:
            raise fail(f"image {image.id}: the name {quoted(image.name)} {fault}")
        for what, value, seen in (("number", image.id, numbers), ("name", image.name, names)):
            if value in seen:
                raise fail(f"two images have the {what} {quoted(str(value))}")
            seen.add(value)  # type: ignore[arg-type]
        if image.camera not in model.cameras:
            raise fail(f"image {quoted(image.name)}: there is no camera {image.camera}")
        if not np.isfinite(image.xy).all():
            raise fail(f"image {quoted(image.name)}: a coordinate that is no finite number")
    known = np.sort(model.points)
    if (twice := known[1:][known[1:] == known[:-1]]).size:
        raise where("points3D")(f"two points have the number {twice[0]}")
    for image in model.images:
        at = np.searchsorted(known, image.point)
        there = known[np.minimum(at, len(known) - 1)] == image.point if len(known) else at < 0
        if not there.all():
            k = int(np.argmin(there))
            raise fail(
                f"image {quoted(image.name)}: feature {image.index[k]} is of point "
                f"{image.point[k]}, which there is none of"
            )
    return model
