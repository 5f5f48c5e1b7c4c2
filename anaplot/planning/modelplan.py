"""Which points to measure in a model, and where the plates are driven for them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import count
from math import hypot
from typing import NamedTuple

from anaplot.orientation.ownpattern import OwnPattern, PointPattern
from anaplot.photogrammetry.block import Block, Camera

__all__ = [
    "EDGE",
    "Candidates",
    "PlannedPosition",
    "plan_positions",
    "predicted_right",
    "standard_base",
    "standard_d",
    "ties_among",
]

Candidates = Mapping[str, Mapping[str, tuple[float, float]]]
"""Approximate image coordinates [mm] of known points, by photo and point."""

_NAME = 80  # characters of a photo's name that go into the names of its points
EDGE = 3.0
"""Millimetres at the edge of a photo where nothing is asked for."""
_FEWEST_TIES = 3
_TWIN = (4.0, 4.0)  # mm between the two points of a doubled position


class PlannedPosition(NamedTuple):
    """A point to measure: name and approximate image coordinates [mm] in both photos."""

    point: str
    xl: float
    yl: float
    xr: float
    yr: float


def plan_positions(
    block: Block,
    photos: tuple[str, str],
    pattern: PointPattern,
    *,
    nominal_base: float | None,
    preceding: Mapping[str, tuple[float, float]],
    candidates: Candidates | None,
    avoid: Collection[str] = (),
) -> tuple[PlannedPosition, ...]:
    """Choose the points of a model.

    Points of the preceding model come first where the pattern wants ties. Among known candidates
    (points pricked or measured before) the nearest to each standard position is taken; without
    candidates, new points are named after the photo they lie under.

    Parameters
    ----------
    block
        For the cameras.
    photos
        Names of the left and the right photo.
    pattern
        The point pattern.
    nominal_base
        Base at photo scale [mm], with the sign of the flight along x; None when not known.
    preceding
        Points of the preceding model: their coordinates [mm] in its right photo, now the left.
    candidates
        Known points, or None when there are none to choose from.
    avoid
        Names that other points have: no new point gets one of them.
    """
    left, right = photos
    camera = block.camera_of(left)
    common = _common(candidates, left, right)
    base = _base(nominal_base, camera, common)
    d = standard_d(camera)
    twin = (min(_TWIN[0], 0.05 * abs(base)), min(_TWIN[1], 0.05 * d))
    wanted = pattern.positions(abs(base), d, twin)
    if base < 0.0:
        wanted = {label: (-x, y) for label, (x, y) in wanted.items()}
    near = 0.45 * min(abs(base), d)
    taken: dict[str, PlannedPosition] = {}
    known = {name: xy for name, xy in preceding.items() if not common or name in common}
    if not common:
        known = _seen_by_both(known, base, block.camera_of(right))
    for label, name in ties_among(known, pattern, wanted, d).items():
        xl, yl = known[name]
        # where a point is marked counts more than where it was measured: that may have been wrong
        place = common[name] if common else (xl, yl, xl - base, yl)
        taken[label] = PlannedPosition(name, *place)
    # a pattern of one's own says itself which points are measured again
    apart = set(preceding) if isinstance(pattern, OwnPattern) else set[str]()
    for label in pattern.labels:
        x, y = wanted[label]
        if label in taken:
            continue
        if candidates is None:
            used = {p.point for p in taken.values()} | preceding.keys() | set(avoid)
            name = _free_name(_new_name(pattern, label, left, right), used)
            taken[label] = PlannedPosition(name, x, y, x - base, y)
            continue
        used = {p.point for p in taken.values()} | apart
        free = {name: xy for name, xy in common.items() if name not in used}
        found = _nearest((x, y), {name: xy[:2] for name, xy in free.items()}, near)
        if found is not None:
            taken[label] = PlannedPosition(found, *free[found])
    positions = [taken[label] for label in pattern.labels if label in taken]
    # ties first also where some are missing: they bring the scale
    return tuple(sorted(positions, key=lambda p: p.point not in preceding))


def _seen_by_both(
    known: dict[str, tuple[float, float]], base: float, camera: Camera
) -> dict[str, tuple[float, float]]:
    """Return the points that the right photo has as well, as far as the base tells.

    All where too few are left: the base may be another than it is taken for.
    """
    if camera.format is None:
        return known
    reach = camera.reach()[0] - EDGE
    inside = {name: (x, y) for name, (x, y) in known.items() if abs(x - base) <= reach}
    return inside if len(inside) >= _FEWEST_TIES else known


def predicted_right(
    measured: Sequence[tuple[float, float, float, float]], xl: float, yl: float
) -> tuple[float, float] | None:
    """Predict where a point of the left photo lies in the right one, from points measured so far.

    Parameters
    ----------
    measured
        xl, yl, xr, yr [mm] of at least three points, not all in one place.
    xl, yl
        Where it lies in the left photo [mm].

    Returns
    -------
    tuple of float or None
        xr, yr [mm] by a plane similarity; None while there is too little to tell.
    """
    if len(measured) < 3:
        return None
    left = [complex(m[0], m[1]) for m in measured]
    right = [complex(m[2], m[3]) for m in measured]
    n = len(measured)
    left_mean, right_mean = sum(left) / n, sum(right) / n
    spread = sum(abs(z - left_mean) ** 2 for z in left)
    if spread < 1.0:
        return None
    turned = sum(
        (z - left_mean).conjugate() * (w - right_mean) for z, w in zip(left, right, strict=True)
    )
    place = right_mean + turned / spread * (complex(xl, yl) - left_mean)
    return place.real, place.imag


def standard_d(camera: Camera) -> float:
    """Return the distance [mm] of the upper and lower standard points from the x axis."""
    return 0.66 * camera.c if camera.format is None else 0.78 * camera.reach()[1]


def standard_base(camera: Camera) -> float:
    """Return the base [mm at photo scale] where nothing is known of it."""
    return 0.4 * camera.format[0] if camera.format is not None else 0.6 * camera.c


def ties_among(
    known: Mapping[str, tuple[float, float]],
    pattern: PointPattern,
    wanted: Mapping[str, tuple[float, float]],
    d: float,
) -> dict[str, str]:
    """Return the points of the preceding model that serve as ties, by label of the pattern.

    They may lie far from their places, for terrain and tilts have moved them.

    Parameters
    ----------
    known
        Points of the preceding model: where they lie [mm] in its right photo, now the left.
    pattern
        The point pattern.
    wanted
        Where its points are to lie [mm].
    d
        Distance of the upper and lower standard points from the x axis [mm].
    """
    left = dict(known)
    found = {}
    for label in pattern.transferred:
        name = _nearest(wanted[label], left, 0.45 * d)
        if name is not None:
            found[label] = name
            del left[name]
    return found


def _common(
    candidates: Candidates | None, left: str, right: str
) -> dict[str, tuple[float, float, float, float]]:
    if candidates is None:
        return {}
    other = candidates.get(right, {})
    return {
        name: (*xy, *other[name]) for name, xy in candidates.get(left, {}).items() if name in other
    }


def _base(
    nominal: float | None,
    camera: Camera,
    common: Mapping[str, tuple[float, float, float, float]],
) -> float:
    if common:
        parallax = sorted(xl - xr for xl, _, xr, _ in common.values())
        middle = parallax[len(parallax) // 2]
        if middle != 0.0:
            return middle
    return nominal or standard_base(camera)


def _nearest(
    place: tuple[float, float], points: Mapping[str, tuple[float, float]], within: float
) -> str | None:
    best, shortest = None, within
    for name, (x, y) in points.items():
        distance = hypot(x - place[0], y - place[1])
        if distance < shortest:
            best, shortest = name, distance
    return best


def _free_name(name: str, used: Collection[str]) -> str:
    """Return the name, with a number behind it when other points have it."""
    if name not in used:
        return name
    return next(other for k in count(2) if (other := f"{name}.{k}") not in used)


def _new_name(pattern: PointPattern, label: str, left: str, right: str) -> str:
    """Name a new point after the photo under which it lies: 1, 2, 3 there, 7, 8, 9 between."""
    side, named = pattern.under(label)
    return f"{(left if side == 'left' else right)[:_NAME]}-{named}"
