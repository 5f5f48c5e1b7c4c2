"""The rays of a COLMAP model, as measured with cameras that a block can hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.exchange.formats.colmapcamera import (
    MODELS,
    ColmapCamera,
    canvas,
    magnification,
    our_lens,
    pinhole_directions,
    pinhole_spread,
)
from anaplot.exchange.formats.colmapmodel import ColmapImage, ColmapModel
from anaplot.exchange.formats.door import Note
from anaplot.exchange.formats.measuredrays import RayColumns, enlarged, magnified
from anaplot.photogrammetry.block import Camera, Use, in_pixels
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.pointcolumns import Coded

__all__ = ["ModelRays", "rays_of"]


class ModelRays(NamedTuple):
    """What a model's images measure.

    Attributes
    ----------
    cameras
        Those that are used.
    camera_of
        By names of images.
    rays
        Of all images with a pose, image after image, in the order of the file.
    notes
        What was done to them.
    """

    cameras: tuple[Camera, ...]
    camera_of: dict[str, Camera]
    rays: RayColumns
    notes: list[Note]


def rays_of(model: ColmapModel, pixel_um: float | None, sigma_um: float) -> ModelRays:
    """Return the rays of images that have a pose.

    Parameters
    ----------
    model
        The model.
    pixel_um
        Size of a pixel, if that is known.
    sigma_um
        A-priori standard deviation; rays that are corrected get one of their own.
    """
    used = [image for image in model.images if image.oriented and len(image.point)]
    cameras: dict[int, Camera] = {}
    places: dict[int, Array] = {}
    sigmas: dict[int, Array] = {}
    notes = []
    by_camera: dict[int, list[ColmapImage]] = {}
    for image in used:
        by_camera.setdefault(image.camera, []).append(image)
    for number, mine in sorted(by_camera.items()):
        cameras[number], measured, larger, told = _camera(model.cameras[number], mine, pixel_um)
        notes += told
        ends = np.cumsum([len(image.xy) for image in mine])[:-1]
        names = [image.id for image in mine]
        places |= dict(zip(names, np.split(measured, ends), strict=True))
        if larger is not None:
            sigmas |= dict(zip(names, np.split(larger, ends), strict=True))
    rays = _columns(used, places, sigmas, sigma_um)
    camera_of = {image.name: cameras[image.camera] for image in used}
    return ModelRays(tuple(cameras.values()), camera_of, rays, notes)


def _columns(
    images: Sequence[ColmapImage],
    places: Mapping[int, Array],
    larger: Mapping[int, Array],
    sigma_um: float,
) -> RayColumns:
    """Return the rays of images: their places, and how much larger some errors are, by image."""
    counts = [len(image.point) for image in images]
    numbers = np.concatenate([np.empty(0, np.intp), *(image.point for image in images)])
    sigma = None
    if larger:
        sigma = np.concatenate(
            [
                np.array(
                    [enlarged(sigma_um, value) for value in larger[image.id].tolist()], np.float64
                )
                if image.id in larger
                else np.full(count, np.nan)
                for image, count in zip(images, counts, strict=True)
            ]
        )
    n = len(numbers)
    photo = Coded(tuple(image.name for image in images), np.repeat(np.arange(len(images)), counts))
    xy = np.concatenate([np.empty((0, 2)), *(places[image.id] for image in images)])
    uses: Coded[Use] = Coded.same("xy", n)
    point = Coded.numbered(numbers).each(str)
    return RayColumns(photo, point, xy, sigma, uses, Coded.same(None, n))


def _camera(
    of: ColmapCamera, images: Sequence[ColmapImage], pixel_um: float | None
) -> tuple[Camera, Array, Array | None, list[Note]]:
    """Return a camera, its images' rays [px], how much larger their errors are, what was done.

    The rays of all images are in one array, image after image; NaN where there is no direction.
    """
    fx, fy = of.focal
    camera = Camera(str(of.id), fy * (1.0 if pixel_um is None else pixel_um) / 1000.0)
    measured = np.concatenate([image.xy for image in images])
    size, principal = (of.width, of.height), of.principal
    lens = our_lens(of)
    notes = []
    larger: Array | None = None
    if lens is None:
        seen = pinhole_directions(of, measured)
        larger = magnification(pinhole_spread(of, measured, seen), np.diag(of.focal))
        lost = np.isnan(seen).any(axis=1)
        measured, size, principal = canvas(seen * of.focal + principal, size, principal)
        lens = BrownLens(b1=fx / fy - 1.0)
        name = MODELS[of.model].name
        text = (
            f"rays of camera {of.id}, {name}: corrected to pixels of a pinhole camera of "
            f"{size[0]} x {size[1]} px"
        )
        notes += [
            Note("changed", int((~lost).sum()), text),
            *magnified(larger, f"camera {of.id}"),
        ]
        if lost.any():
            text = f"rays of camera {of.id} where {name} images nothing within 80 degrees"
            notes.append(Note("dropped", int(lost.sum()), text))
    if any(lens.coefficients):
        camera = replace(camera, lens=lens)
    return in_pixels(camera, size, pixel_um, principal), measured, larger, notes
