"""Rays as other programs measured them become image points: checked, and through the lens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.exchange.formats.door import Note
from anaplot.photogrammetry.block import Camera, ImagePoint, Use
from anaplot.photogrammetry.imagepoints import ImagePoints
from anaplot.photogrammetry.measuredimage import ideal_rays, mm_of_pixels, rows_by_camera
from anaplot.photogrammetry.pointcolumns import (
    Coded,
    PointColumns,
    paired,
    sigma_column,
    stand_again,
)

__all__ = [
    "TWICE",
    "MeasuredRay",
    "RayColumns",
    "enlarged",
    "image_points_of",
    "kept_names",
    "magnified",
    "measured_anew",
    "own_sigmas",
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


@dataclass(frozen=True, slots=True, eq=False)
class RayColumns:
    """Rays of another program's file by columns, as `PointColumns` has image points.

    But for xy: (n, 2) as `MeasuredRay` has x and y.
    """

    photo: Coded[str]
    point: Coded[str]
    xy: Array
    sigma_um: Array | None
    use: Coded[Use]
    reason: Coded[str | None]

    def __len__(self) -> int:
        return len(self.photo)

    @classmethod
    def of(cls, rays: Sequence[MeasuredRay]) -> RayColumns:
        """Return rays by columns."""
        every: list[Any] = list(zip(*rays, strict=True)) or [()] * len(MeasuredRay._fields)
        photo, point, x, y, sigma, use, reason = every
        return cls(
            Coded.of(photo),
            Coded.of(point),
            paired(x, y),
            sigma_column(sigma),
            Coded.of(use),
            Coded.of(reason),
        )


def image_points_of(
    rays: Sequence[MeasuredRay] | RayColumns,
    camera_of: Mapping[str, Camera],
    *,
    pixels: bool,
    sigma_um: Mapping[str, float] | None = None,
) -> tuple[ImagePoints, tuple[Note, ...]]:
    """Return image points in the order of the rays, and what was done to some of them.

    Parameters
    ----------
    rays
        What was measured.
    camera_of
        The camera of every photo.
    pixels
        Whether x, y are pixels; every camera has pixels then.
    sigma_um
        Standard deviations of rays that state none, by photo, where it is not the block's.

    Returns
    -------
    points
        Of a point that stands more than once in a photo the first ray that is kept counts; a
        further one is a ray of its own that does not, its name with ~2. Rays outside the image, and
        those where the lens images nothing, are left out: a block cannot hold them.
    notes
        How many of each.
    """
    rays = rays if isinstance(rays, RayColumns) else RayColumns.of(rays)
    ideal, outside, unseen, lost = _ideal(rays, camera_of, pixels=pixels)
    left_out = outside | unseen | lost
    renamed = _renamed(rays, left_out)
    twice: Bools = np.zeros(len(rays), dtype=bool)
    twice[list(renamed)] = True
    sigma = rays.sigma_um
    if sigma_um:
        own = np.array([sigma_um.get(photo, np.nan) for photo in rays.photo.values])
        own = own[rays.photo.index]
        sigma = own if sigma is None else np.where(np.isnan(sigma), own, sigma)
    measured: Array | None = rays.xy
    if not pixels:
        through = [camera_of[photo].lens is not None for photo in rays.photo.values]
        seen = np.array(through, dtype=bool)[rays.photo.index]
        measured = np.where(seen[:, None], rays.xy, np.nan) if seen.any() else None
    columns = PointColumns(
        rays.photo,
        rays.point.put(renamed),
        ideal,
        sigma,
        Coded.same(None, len(rays)),
        rays.use.put(dict.fromkeys(renamed, "off")),
        rays.reason.put(dict.fromkeys(renamed, TWICE)),
        measured,
    )
    if renamed or left_out.any():
        columns = columns.of(np.flatnonzero(~left_out))
    notes = [
        Note("dropped", int(mask.sum()), text, _some(rays, mask))
        for mask, text in (
            (outside, "rays outside their image"),
            (unseen, "rays where their lens images nothing"),
        )
        if mask.any()
    ]
    if twice.any():
        text = "rays of a point that is in the photo already: kept with ~2, and do not count"
        notes.append(Note("doubled", int(twice.sum()), text, _some(rays, twice)))
    return ImagePoints(columns=columns), tuple(notes)


def own_sigmas(
    camera_of: Mapping[str, Camera], sigma_px: float, image_um: float
) -> dict[str, float]:
    """Return a standard deviation in um, by photo, where it is not that of the block."""
    own = {photo: sigma_px * (camera.pixel_um or 1.0) for photo, camera in camera_of.items()}
    return {photo: sigma for photo, sigma in own.items() if sigma != image_um}


def kept_names(
    rays: Sequence[MeasuredRay] | RayColumns, camera_of: Mapping[str, Camera]
) -> list[str | None]:
    """Return what `image_points_of` calls each ray's point, or None where it leaves the ray out.

    By them the rays of a source [px] are found again among the image points that were made of them.
    """
    rays = rays if isinstance(rays, RayColumns) else RayColumns.of(rays)
    _, outside, unseen, lost = _ideal(rays, camera_of, pixels=True)
    left_out = outside | unseen | lost
    names: list[str | None] = list(rays.point.listed())
    for k, name in _renamed(rays, left_out).items():
        names[k] = name
    for k in np.flatnonzero(left_out).tolist():
        names[k] = None
    return names


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
    rays: RayColumns, camera_of: Mapping[str, Camera], *, pixels: bool
) -> tuple[Array, Bools, Bools, Bools]:
    """Return (n, 2) ideal coordinates, and who is outside, who is unseen, who stands nowhere."""
    places = rays.xy
    lost: Bools = np.isnan(places[:, 0] + places[:, 1])
    ideal = np.zeros_like(places)
    outside: Bools = np.zeros(len(rays), dtype=bool)
    for camera, rows in rows_by_camera(rays.photo, camera_of):
        mine = places[rows]
        if pixels and camera.pixels is not None:
            low, high = -_BESIDE, np.array(camera.pixels) + _BESIDE
            outside[rows] = ((mine < low) | (mine > high)).any(axis=1)
        else:
            outside[rows] = (np.abs(mine) > camera.reach()).any(axis=1)
        good = rows[~outside[rows] & ~lost[rows]]
        mine = places[good]
        ideal[good] = ideal_rays(camera, mm_of_pixels(camera, mine) if pixels else mine)
    outside &= ~lost
    unseen: Bools = ~(np.isfinite(ideal[:, 0]) & np.isfinite(ideal[:, 1]))
    return ideal, outside, unseen, lost


def _renamed(rays: RayColumns, left_out: Bools) -> dict[int, str]:
    """Return names of rays whose point stands in its photo already, so that none stands twice."""
    again = np.flatnonzero(stand_again(rays.photo, rays.point) & ~left_out).tolist()
    if not again:
        return {}
    # a name that is made has the mark: others cannot be in its way
    marked = np.array(["~" in name for name in rays.point.values], dtype=bool)
    taken = {
        (rays.photo.at(k), rays.point.at(k))
        for k in np.flatnonzero(marked[rays.point.index]).tolist()
    }
    times: dict[tuple[str, str], int] = {}
    names: dict[int, str] = {}
    for k in again:
        photo, point = key = rays.photo.at(k), rays.point.at(k)
        name, number = point, times.get(key, 0)
        if number:
            while (photo, name) in taken or name == point:
                number += 1
                name = f"{point}~{number}"
            taken.add((photo, name))
            names[k] = name
        times[key] = max(number, 1)
    return names


def _some(rays: RayColumns, mask: Bools) -> tuple[str, ...]:
    some = np.flatnonzero(mask)[:_EXAMPLES].tolist()
    return tuple(f"{rays.photo.at(k)}: {rays.point.at(k)}" for k in some)
