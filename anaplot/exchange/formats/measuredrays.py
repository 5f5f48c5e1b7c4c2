"""Rays as other programs measured them become image points: checked, and through the lens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.exchange.formats.door import Note
from anaplot.photogrammetry.block import Camera, ImagePoint, Use
from anaplot.photogrammetry.measuredimage import ideal_rays, mm_of_pixels

__all__ = [
    "TWICE",
    "MeasuredRay",
    "enlarged",
    "image_points_of",
    "kept_names",
    "magnified",
    "measured_anew",
]

TWICE = "a second time in the photo"
"""Why a ray does not count whose point stands in its photo already."""

_BESIDE = 0.5  # px that a coordinate may lie outside the image, as in image_points.csv
_MOVED = 1e-6  # px by which a ray has been measured anew
_EXAMPLES = 4


class MeasuredRay(NamedTuple):
    """A ray of another program's file.

    Attributes
    ----------
    photo, point
        Names.
    x, y
        Where it was measured: pixels of a camera that has them (origin at the upper left corner of
        the upper left pixel, y down), else mm about the principal point, y up. NaN: nowhere; such
        a ray is left out, and whoever made it tells why.
    sigma_um, use, reason
        As `ImagePoint` has them.
    """

    photo: str
    point: str
    x: float
    y: float
    sigma_um: float | None = None
    use: Use = "xy"
    reason: str | None = None


def image_points_of(
    rays: Sequence[MeasuredRay], camera_of: Mapping[str, Camera], *, pixels: bool
) -> tuple[tuple[ImagePoint, ...], tuple[Note, ...]]:
    """Return image points in the order of the rays, and what was done to some of them.

    Parameters
    ----------
    rays
        What was measured.
    camera_of
        The camera of every photo.
    pixels
        Whether x, y are pixels; every camera has pixels then.

    Returns
    -------
    points
        Of a point that stands more than once in a photo the first ray that is kept counts; a
        further one is a ray of its own that does not, its name with ~2. Rays outside the image, and
        those where the lens images nothing, are left out: a block cannot hold them.
    notes
        How many of each.
    """
    ideal, outside, unseen, lost = _ideal(rays, camera_of, pixels=pixels)
    names = _numbered(rays, outside | unseen | lost)
    doubled = [
        name is not None and name != ray.point for name, ray in zip(names, rays, strict=True)
    ]
    made = [
        ImagePoint(
            ray.photo,
            name,
            x,
            y,
            ray.sigma_um,
            None,
            "off" if again else ray.use,
            TWICE if again else ray.reason,
            (ray.x, ray.y) if pixels or camera_of[ray.photo].lens is not None else None,
        )
        for ray, name, again, (x, y) in zip(rays, names, doubled, ideal.tolist(), strict=True)
        if name is not None
    ]
    notes = [
        Note("dropped", int(mask.sum()), text, _some(rays, mask))
        for mask, text in (
            (outside, "rays outside their image"),
            (unseen, "rays where their lens images nothing"),
        )
        if mask.any()
    ]
    twice = np.array(doubled, dtype=bool)
    if twice.any():
        text = "rays of a point that is in the photo already: kept with ~2, and do not count"
        notes.append(Note("doubled", int(twice.sum()), text, _some(rays, twice)))
    return tuple(made), tuple(notes)


def kept_names(
    rays: Sequence[MeasuredRay], camera_of: Mapping[str, Camera], *, pixels: bool
) -> list[str | None]:
    """Return what `image_points_of` calls each ray's point, or None where it leaves the ray out.

    By them the rays of a source are found again among the image points that were made of them.
    """
    _, outside, unseen, lost = _ideal(rays, camera_of, pixels=pixels)
    return _numbered(rays, outside | unseen | lost)


def measured_anew(row: ImagePoint, x: float, y: float) -> bool:
    """Return whether a ray is no more where its source has it [px]."""
    if row.measured is None:
        return False
    return max(abs(row.measured[0] - x), abs(row.measured[1] - y)) > _MOVED


def enlarged(sigma_um: float, magnification: float) -> float | None:
    """Return the sigma [um] of a ray that was corrected; None for one that stands nowhere."""
    return float(f"{sigma_um * magnification:.6g}") if np.isfinite(magnification) else None


def magnified(magnification: Array, camera: str) -> list[Note]:
    """Return what is told of (n,) magnifications of corrected rays of a camera."""
    seen = magnification[np.isfinite(magnification)]
    if not seen.size:
        return []
    text = (
        f"sigmas of rays of {camera}: times {seen.min():.3g} to {seen.max():.3g}, as the correction"
        " magnifies there; that it does so more along the radius than across is not held"
    )
    return [Note("changed", int(seen.size), text)]


def _ideal(
    rays: Sequence[MeasuredRay], camera_of: Mapping[str, Camera], *, pixels: bool
) -> tuple[Array, Bools, Bools, Bools]:
    """Return (n, 2) ideal coordinates, and who is outside, who is unseen, who stands nowhere."""
    places = np.array([(ray.x, ray.y) for ray in rays], dtype=np.float64).reshape(-1, 2)
    lost: Bools = np.isnan(places[:, 0] + places[:, 1])
    ideal = np.zeros_like(places)
    outside: Bools = np.zeros(len(rays), dtype=bool)
    by_camera: dict[str, list[int]] = {}
    known: dict[str, Camera] = {}
    for k, ray in enumerate(rays):
        camera = camera_of[ray.photo]
        known[camera.id] = camera
        by_camera.setdefault(camera.id, []).append(k)
    for name, rows in by_camera.items():
        camera = known[name]
        mine = places[rows]
        if pixels and camera.pixels is not None:
            low, high = -_BESIDE, np.array(camera.pixels) + _BESIDE
            outside[rows] = ((mine < low) | (mine > high)).any(axis=1)
        else:
            outside[rows] = (np.abs(mine) > camera.reach()).any(axis=1)
        good = np.array(rows)[~outside[rows] & ~lost[rows]]
        mine = places[good]
        ideal[good] = ideal_rays(camera, mm_of_pixels(camera, mine) if pixels else mine)
    outside &= ~lost
    unseen: Bools = ~(np.isfinite(ideal[:, 0]) & np.isfinite(ideal[:, 1]))
    return ideal, outside, unseen, lost


def _numbered(rays: Sequence[MeasuredRay], left_out: Bools) -> list[str | None]:
    """Return names that stand once in every photo; None for what is left out."""
    taken = {(ray.photo, ray.point) for ray in rays}
    times: dict[tuple[str, str], int] = {}
    names: list[str | None] = []
    for ray, out in zip(rays, left_out.tolist(), strict=True):
        if out:
            names.append(None)
            continue
        key, name = (ray.photo, ray.point), ray.point
        number = times.get(key, 0)
        if number:
            while (ray.photo, name) in taken:
                number += 1
                name = f"{ray.point}~{number}"
            taken.add((ray.photo, name))
        times[key] = max(number, 1)
        names.append(name)
    return names


def _some(rays: Sequence[MeasuredRay], mask: Bools) -> tuple[str, ...]:
    return tuple(f"{rays[k].photo}: {rays[k].point}" for k in np.flatnonzero(mask)[:_EXAMPLES])
