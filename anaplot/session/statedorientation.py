"""Where points lie by exterior orientations that are stated beforehand, as a navigation has them.

Before strips are tied, a point of another strip or of the ground can be driven to where the stated
orientations show it: roughly, with the standard deviation that follows from theirs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from math import radians
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.block import Block, ControlPoint, Photo
from anaplot.photogrammetry.collinearity import Projections, project_with_derivatives
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.session.modelstate import ModelState

__all__ = ["StatedPoint", "seen_by_stated", "stated_control", "stated_points"]

# what is believed of an orientation that is stated without standard deviations
_SHIFT = 1.0  # mm in the photo
_TURN = radians(1.0)

_Triple = tuple[float, float, float]


class StatedPoint(NamedTuple):
    """A point's place on the ground.

    Attributes
    ----------
    xyz
        (3,) coordinates [m].
    cov
        (3, 3) their covariance [m^2].
    source
        The strip, or what else it is known from.
    """

    xyz: Array
    cov: Array
    source: str


def stated_points(block: Block, models: Iterable[ModelState]) -> dict[str, StatedPoint]:
    """Return where points of models lie by the stated orientations of their photos.

    Parameters
    ----------
    block
        Its photos and cameras.
    models
        Those without a stated orientation of both photos are passed over; of several models
        that have a point the last one counts.
    """
    stated = _stated(block)
    out: dict[str, StatedPoint] = {}
    for model in models:
        if model.left in stated and model.right in stated and model.used:
            found = _intersected(block, model, stated[model.left], stated[model.right])
            names = (m.point for m in model.used)
            for name, xyz, cov in zip(names, *found, strict=True):
                if np.isfinite(xyz).all() and np.isfinite(cov).all():
                    out[name] = StatedPoint(xyz, cov, model.strip)
    return out


def stated_control(
    block: Block, control: Iterable[ControlPoint], source: str
) -> dict[str, StatedPoint]:
    """Return the control of which all coordinates are known, where anything can show it."""
    if not _stated(block):
        return {}
    return {
        c.point: StatedPoint(np.array(c.xyz, float), np.diag(np.square(block.sigma_of(c))), source)
        for c in control
        if all(value is not None for value in c.xyz)
    }


def seen_by_stated(
    block: Block, model: ModelState, points: Mapping[str, StatedPoint]
) -> Iterator[tuple[str, tuple[float, float, float, float], float, str]]:
    """Yield points in a model's photos by their stated orientations.

    Parameters
    ----------
    block
        Its photos and cameras.
    model
        The model; nothing follows unless both its photos are stated.
    points
        Points on the ground.

    Yields
    ------
    tuple
        Name, place in both photos [mm], standard deviation where it is largest [mm], and source;
        what lies behind a photo, or far outside, is left out.
    """
    stated = _stated(block)
    if not points or model.left not in stated or model.right not in stated:
        return
    xyz = np.array([p.xyz for p in points.values()])
    cov = np.array([p.cov for p in points.values()])
    sides = [
        _projected(stated[photo], block.camera_of(photo).c, xyz, cov) for photo in model.photos
    ]
    places = np.concatenate([xy for xy, _ in sides], axis=1)
    sigma = np.concatenate([s for _, s in sides], axis=1).max(axis=1)
    for (name, point), (xl, yl, xr, yr), s in zip(
        points.items(), places.tolist(), sigma.tolist(), strict=True
    ):
        if np.isfinite((xl, yl, xr, yr, s)).all():
            yield name, (xl, yl, xr, yr), s, point.source


def _stated(block: Block) -> dict[str, Photo]:
    """Return the photos whose orientation is stated, with the positions of their own centres."""
    return {
        photo.id: replace(photo, position=_centre(block.camera_of(photo.id).lever_arm, photo))
        for photo in block.photos
        if photo.position is not None and photo.rotation is not None
    }


def _centre(arm: _Triple | None, photo: Photo) -> _Triple:
    """Return the projection centre of a photo whose antenna's position is stated."""
    assert photo.position is not None
    assert photo.rotation is not None
    if arm is None:
        return photo.position
    x, y, z = (np.array(photo.position) - rotation_matrix(*photo.rotation) @ np.array(arm)).tolist()
    return x, y, z


def _seen(photo: Photo, c: float, xyz: Array) -> tuple[Projections, Array]:
    """Project points into a photo; return that and (n, 6, 6) covariances of its orientation."""
    n = len(xyz)
    assert photo.position is not None
    assert photo.rotation is not None
    seen = project_with_derivatives(
        np.broadcast_to(np.array(photo.position), (n, 3)),
        np.broadcast_to(rotation_matrix(*photo.rotation), (n, 3, 3)),
        np.full(n, c),
        xyz,
    )
    sigma = np.empty((n, 6))
    sigma[:, :3] = (
        (_SHIFT / c * np.abs(seen.depth))[:, None]
        if photo.position_sigma is None
        else photo.position_sigma
    )
    # near the vertical omega, phi and kappa turn about the ground's axes, or nearly so
    sigma[:, 3:] = _TURN if photo.rotation_sigma is None else photo.rotation_sigma
    return seen, np.einsum("ni,ij->nij", sigma**2, np.eye(6))


def _projected(photo: Photo, c: float, xyz: Array, cov: Array) -> tuple[Array, Array]:
    """Return (n, 2) places [mm] and their standard deviations; NaN where there is none."""
    seen, own = _seen(photo, c, xyz)
    total = _carried(seen.photo, own) + _carried(seen.point, cov)
    sigma = np.sqrt(np.einsum("nii->ni", total))
    there = (seen.depth > 0.0) & (np.abs(seen.xy) < 2.0 * c).all(axis=1)
    return np.where(there[:, None], seen.xy, np.nan), sigma


def _carried(derivatives: Array, cov: Array) -> Array:
    carried: Array = np.einsum("nai,nij,nbj->nab", derivatives, cov, derivatives)
    return carried


def _intersected(block: Block, model: ModelState, left: Photo, right: Photo) -> tuple[Array, Array]:
    """Return (n, 3) points where both rays of a model's points come nearest, and covariances."""
    constants = [block.camera_of(photo.id).c for photo in (left, right)]
    images = np.array([(m.xl, m.yl, m.xr, m.yr) for m in model.used])
    rays = []
    for photo, c, xy in zip((left, right), constants, (images[:, :2], images[:, 2:]), strict=True):
        assert photo.rotation is not None
        along = np.column_stack((xy, np.full(len(xy), -c)))
        rays.append(along @ rotation_matrix(*photo.rotation).T)
    a, b = rays
    step = np.array(right.position) - np.array(left.position)
    aa, bb, ab = (np.einsum("ni,ni->n", p, q) for p, q in ((a, a), (b, b), (a, b)))
    with np.errstate(divide="ignore", invalid="ignore"):
        det = aa * bb - ab**2
        s = (bb * (a @ step) - ab * (b @ step)) / det
        t = (ab * (a @ step) - aa * (b @ step)) / det
        ends = np.array(left.position) + s[:, None] * a, np.array(right.position) + t[:, None] * b
        xyz = 0.5 * (ends[0] + ends[1])
    xyz[(s <= 0.0) | (t <= 0.0)] = np.nan
    good = np.isfinite(xyz).all(axis=1)
    cov = np.full((len(xyz), 3, 3), np.nan)
    # image coordinates that stay as they are: what moves the photos moves the point
    one, other = (
        _seen(photo, c, xyz[good]) for photo, c in zip((left, right), constants, strict=True)
    )
    point = np.concatenate((one[0].point, other[0].point), axis=1)
    inverse: Array = np.linalg.pinv(point).astype(np.float64)
    shown = np.zeros((len(point), 4, 4))
    shown[:, :2, :2] = _carried(one[0].photo, one[1])
    shown[:, 2:, 2:] = _carried(other[0].photo, other[1])
    cov[good] = _carried(inverse, shown)
    return xyz, cov
