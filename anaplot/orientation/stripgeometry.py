"""A strip as far as it is oriented: photos and points in its system, and how both err together.

Every image coordinate that was measured is one error of its own, of the a-priori sigma0. What each
of them does to every photo and point of the strip follows model by model, to first order: ties
hand the errors of a model on to the next. So the covariance of anything that is computed from
several points, of one model or of many, is exact to first order, and two strips that are compared
need no rule of thumb for how strips bend.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.orientation.conditionequations import ModelUnknowns
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.tieerrors import MovedModel, moved_by_errors
from anaplot.photogrammetry.collinearity import project_with_derivatives
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.similarity import similarity_effects

__all__ = ["Located", "Pose", "StripGeometry", "extended", "imaged", "in_photo", "widened"]


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """A point in a system.

    Attributes
    ----------
    xyz
        (3,) coordinates.
    errors
        (3, e) effects of independent errors, each of the size of one sigma0: of the first e of its
        system, those that came later have none.
    """

    xyz: Array
    errors: Array = field(repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A photo in its strip's system.

    Attributes
    ----------
    c
        Camera constant [mm].
    centre, rotation
        (3,) projection centre [mm] and (3, 3) rotation from image to strip system.
    errors
        (6, e) likewise, on the centre [mm] and on a turn about the strip's axes [rad].
    """

    c: float
    centre: Array
    rotation: Array
    errors: Array = field(repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class StripGeometry:
    """A strip up to some model of it.

    Attributes
    ----------
    photos
        By name.
    points
        By name; one of several models as the last of them has it.
    base
        bx [mm] of the last model.
    count
        Number of errors: four a point and model, less what was measured once for two models.
    vtpv, redundancy
        Sums over its models, in units of the a-priori sigma0.
    """

    photos: Mapping[str, Pose]
    points: Mapping[str, Located]
    base: float
    count: int
    vtpv: float
    redundancy: int
    _last: MovedModel = field(repr=False)
    _rows: Mapping[str, int] = field(repr=False)

    def rays_of(self, point: str) -> Index | None:
        """Return (2,) which errors a point's xr, yr have in the last model; None: it is not in."""
        row = self._rows.get(point)
        return None if row is None else self._last.columns[row, 2:]

    def as_ties(self, points: Sequence[str]) -> Array:
        """Return (n, 3, e) effects on points as the last model's right photo sees them [mm].

        They are 0 for points that are not in that model.
        """
        out = np.zeros((len(points), 3, self.count))
        there = [k for k, name in enumerate(points) if name in self._rows]
        rows = np.array([self._rows[points[k]] for k in there], dtype=np.intp)
        out[there] = self._last.points(rows)
        return out


def widened(errors: Array, count: int) -> Array:
    """Return effects (n, e) as (n, count): those of errors that came later are 0."""
    out = np.zeros((len(errors), count))
    out[:, : errors.shape[1]] = errors
    return out


def extended(
    before: StripGeometry | None, pair: Stereopair, solution: ModelSolution
) -> StripGeometry:
    """Return a strip with one model more.

    Parameters
    ----------
    before
        The strip up to the model before; None for its first model.
    pair, solution
        The model: what was measured, and how it was oriented.
    """
    n = len(pair.points)
    columns, count = _columns(before, pair)
    ties = np.zeros((n, 3, 0)) if before is None else before.as_ties(pair.points)
    rotation = rotation_matrix(*solution.rotation)
    base = np.array(solution.base)
    state = ModelUnknowns(base[0], base[1] / base[0], base[2] / base[0], rotation)
    moved = moved_by_errors(
        pair, solution.tie_variance, state, columns, count, ties, solution.exact
    )
    left = _left(before, pair, count)
    centre = left.centre + base
    # the left photo carries the model with it
    moved_base = base[:, None] * moved.unknowns[0]
    moved_base[1:] += base[0] * moved.unknowns[1:3]
    turn = left.errors[3:] + moved.unknowns[3:]
    shift = similarity_effects(base[None])[0, :, :6] @ left.errors + moved_base
    right = Pose(pair.c_right, centre, rotation, np.concatenate((shift, turn)))
    xyz = np.array([p[1:] for p in solution.points]).reshape(-1, 3)
    with np.errstate(invalid="ignore"):  # of points at infinity, which are not taken
        errors = moved.carried_by(rotation, xyz - centre, right.errors)
    good = np.isfinite(xyz).all(axis=1) & np.isfinite(errors).all(axis=(1, 2))
    kept = [(k, name) for k, name in enumerate(pair.points) if good[k]]
    photos: dict[str, Pose] = {}
    points: dict[str, Located] = {}
    if before is not None:
        photos, points = dict(before.photos), dict(before.points)
    photos |= {pair.left: left, pair.right: right}
    points |= {name: Located(xyz[k], errors[k]) for k, name in kept}
    f, sigma0 = solution.redundancy, solution.tested.sigma0
    vtpv = 0.0 if sigma0 is None else f * sigma0**2
    return StripGeometry(
        photos,
        points,
        float(base[0]),
        count,
        vtpv + (0.0 if before is None else before.vtpv),
        f + (0 if before is None else before.redundancy),
        moved,
        {name: k for k, name in kept},
    )


def _columns(before: StripGeometry | None, pair: Stereopair) -> tuple[Index, int]:
    """Return which error each coordinate has, (n, 4), and how many there are by now."""
    count = 0 if before is None else before.count
    columns = np.empty((len(pair.points), 4), dtype=np.intp)
    for k, name in enumerate(pair.points):
        once = before.rays_of(name) if before is not None and name in pair.once else None
        fresh = 4 if once is None else 2
        columns[k, 4 - fresh :] = np.arange(count, count + fresh)
        if once is not None:
            columns[k, :2] = once
        count += fresh
    return columns, count


def _left(before: StripGeometry | None, pair: Stereopair, count: int) -> Pose:
    known = None if before is None else before.photos.get(pair.left)
    if known is None:
        return Pose(pair.c_left, pair.fixed.centre, pair.fixed.rotation, np.zeros((6, count)))
    return Pose(known.c, known.centre, known.rotation, widened(known.errors, count))


def in_photo(
    pose: Pose, points: list[Located], count: int, free: Array | None
) -> tuple[Array, Array]:
    """Return where points lie in a photo of their system, and how that errs.

    Parameters
    ----------
    pose
        The photo.
    points
        The points.
    count
        Number of errors that both share.
    free
        (6, 6) further errors of the photo alone, or None.

    Returns
    -------
    Array
        (n, 2) image coordinates [mm]; NaN behind the photo.
    Array
        (n, 2, count + 6) effects of the errors on them [mm].
    """
    n, width = len(points), count + 6
    xyz = np.array([p.xyz for p in points]).reshape(-1, 3)
    at = np.array([widened(p.errors, width) for p in points]).reshape(n, 3, width)
    own = widened(pose.errors, width)
    if free is not None:
        own[:, count:] = free
    return imaged(pose, own, xyz, at)


def imaged(pose: Pose, own: Array, xyz: Array, errors: Array) -> tuple[Array, Array]:
    """Return what `in_photo` does, of arrays.

    Parameters
    ----------
    pose
        The photo; its errors are not looked at.
    own
        (6, e) effects of errors on it.
    xyz, errors
        (n, 3) points and (n, 3, e) effects of the same errors on them.
    """
    n = len(xyz)
    seen = project_with_derivatives(
        np.broadcast_to(pose.centre, (n, 3)),
        np.broadcast_to(pose.rotation, (n, 3, 3)),
        np.full(n, pose.c),
        xyz,
    )
    moved = seen.photo @ own + np.einsum("nab,nbe->nae", seen.point, errors)
    return np.where(seen.depth[:, None] > 0.0, seen.xy, np.nan), moved
