"""Regular aerial blocks before they are flown (Gruen 1980), their reliability and accuracy.

Photos at regular places over flat ground; points in the standard places: on the strips' axes, and
where strips overlap. Control stands on the perimeter at a bridging distance, heights inside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import ceil, floor, pi
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array, Axis
from anaplot.bundle.errors.snooping import ObservationClass, classify
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Camera, ControlPoint, Strip
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.idealblock import ExposureStation, IdealBlock, photograph
from anaplot.planning.plannedreliability import photo_reliability

__all__ = [
    "Accuracy",
    "BlockPlan",
    "PlannedClass",
    "WeakPhoto",
    "class_table",
    "expected_accuracy",
    "plan_block",
    "rays_measured",
    "weak_photos",
]


_REACH = 0.45  # part of the format from its middle in which points are put
_TWIN = 0.05  # bases between the two points of twin control
_MOST_PHOTOS = 2_500
_MOST_CONTROL = 10_000


@dataclass(frozen=True, slots=True)
class BlockPlan:
    """A regular block.

    Attributes
    ----------
    strips, photos
        Strips, and photos in each.
    overlap, sidelap
        Shares of the format along and across the strips.
    side
        Points per photo: 3 (x 3) or 5 (x 5).
    control
        "perimeter": full control around the block and heights inside; "corners": full control in
        the corners; "none". Around means on the outermost strips' axes from 50 % side lap (as in
        the paper), otherwise on the outermost row of points.
    bridging
        Bases between control points; what is nearest and divides the sides evenly is taken, but
        below 50 % side lap control stands at every overlap of strips.
    twin
        Whether a second full control point stands 0.05 bases beside each.
    cross_strips
        Strips flown across, spread evenly.
    c, format
        Camera constant and side of the square format [mm].
    scale
        Denominator of the photo scale.
    image_um
        A-priori sigma0 [um].
    control_m
        Standard deviation of control coordinates [m]; 0: free of error.
    stereo
        Whether a ray is measured in every model that shows it, as in a stereo instrument; else
        once, as in a comparator.
    """

    strips: int
    photos: int
    overlap: float = 0.60
    sidelap: float = 0.30
    side: Literal[3, 5] = 3
    control: Literal["perimeter", "corners", "none"] = "perimeter"
    bridging: float = 2.0
    twin: bool = False
    cross_strips: int = 0
    c: float = 150.0
    format: float = 230.0
    scale: float = 10_000.0
    image_um: float = 5.0
    control_m: float = 0.0
    stereo: bool = True

    @property
    def base(self) -> float:
        """Distance between photos of a strip [m]."""
        return (1.0 - self.overlap) * self.format * self.scale / 1000.0

    @property
    def spacing(self) -> float:
        """Distance between strips [m]."""
        return (1.0 - self.sidelap) * self.format * self.scale / 1000.0

    @property
    def across(self) -> int:
        """Photos of a cross strip."""
        return max(2, ceil((self.strips - 1) * self.spacing / self.base - 1e-9) + 1)

    @property
    def turns(self) -> bool:
        """Whether strips can turn about the one line of points that joins two of them."""
        joined = self.sidelap >= 0.50 or self.cross_strips > 0 or self.strips == 1
        return not joined and self.control != "perimeter"

    def check(self) -> None:
        """Refuse what cannot be flown, or joined.

        Raises
        ------
        InputError
            Naming what is wrong.
        """
        if self.strips < 1 or self.photos < 2:
            raise InputError("a block has at least one strip of at least two photos")
        if not 0.55 <= self.overlap <= 0.90:
            raise InputError(
                f"overlap {100 * self.overlap:g} %: models join from 55 %, and 90 % are plenty"
            )
        if not 0.10 <= self.sidelap <= 0.90:
            raise InputError(
                f"side lap {100 * self.sidelap:g} %: strips join from 10 %, and 90 % are plenty"
            )
        if self.cross_strips < 0:
            raise InputError("the number of cross strips is negative")
        if not self.bridging > _TWIN:
            raise InputError(
                f"bridging distance {self.bridging:g} bases: control is put more than {_TWIN:g} "
                "bases apart"
            )
        # the photos of a cross strip follow from the laps, which are sound here
        if self.strips * self.photos + self.cross_strips * self.across > _MOST_PHOTOS:
            raise InputError(f"more than {_MOST_PHOTOS} photos are planned")
        if self.cross_strips > self.photos:
            raise InputError(
                f"cross strips {self.cross_strips}: along {self.photos} photos there is room for "
                f"{self.photos}, one a base"
            )


class PlannedClass(NamedTuple):
    """A class of observations (1980, section 3).

    Attributes
    ----------
    kind
        Rays of the point, inner or outer, control or not, axis.
    number
        Observations in it.
    mean, low, high
        sqrt(q_vv) in units of the a-priori sigma: mean, smallest, largest.
    r
        Mean redundancy number.
    mdb_um
        Smallest detectable error of the worst testable observation [um]; None when there is none.
    untestable
        Observations that nothing checks.
    """

    kind: ObservationClass
    number: int
    mean: float
    low: float
    high: float
    r: float
    mdb_um: float | None
    untestable: int


class WeakPhoto(NamedTuple):
    """A photo, the mean of its redundancy numbers, and the weakest of its observations."""

    photo: str
    rays: int
    mean_r: float
    low_r: float
    point: str
    axis: Axis


class Accuracy(NamedTuple):
    """Expected standard deviations of the points that are not control [m]: rms and largest."""

    rms: tuple[float, float, float]
    largest: tuple[float, float, float]
    points: tuple[str, str, str]


def plan_block(
    plan: BlockPlan, extra: Mapping[str, tuple[float, float]] | None = None
) -> IdealBlock:
    """Make the block of a plan.

    Parameters
    ----------
    plan
        The plan.
    extra
        Places (X, Y) [m] of points beside the standard ones, by name.

    Raises
    ------
    InputError
        The plan is impossible.
    """
    plan.check()
    b, s = plan.base, plan.spacing
    size = plan.format * plan.scale / 1000.0
    along, across = _step(b, size), _step(s, size)
    length, width = (plan.photos - 1) * b, (plan.strips - 1) * s
    per = 2 if plan.side == 5 else 1
    xs = _line(0.0, length, along / per)
    ys = _line(-across, width + across, across / per)
    points = {f"{j:02d}-{i:02d}": (x, y) for j, y in enumerate(ys, 1) for i, x in enumerate(xs, 1)}
    points.update(extra or {})
    control = _control(plan, points, (length, width, across))
    height = plan.c * plan.scale / 1000.0
    stations: dict[str, ExposureStation] = {}
    strips = []
    # as wide as the last, or strip 1 photo 101 is strip 11 photo 01
    digits = max(2, len(str(plan.photos)), len(str(plan.across if plan.cross_strips else 0)))
    for j in range(plan.strips):
        names = tuple(f"{j + 1}{i + 1:0{digits}d}" for i in range(plan.photos))
        for i, name in enumerate(names):
            stations[name] = ExposureStation(np.array([i * b, j * s, height]), np.eye(3), "camera")
        strips.append(Strip(str(j + 1), names, (1.0 - plan.overlap) * plan.format))
    turned = rotation_matrix(0.0, 0.0, pi / 2.0)
    for k, x in enumerate(_spread(length, plan.cross_strips), 1):
        names = tuple(f"c{k}{i + 1:0{digits}d}" for i in range(plan.across))
        first = (width - (plan.across - 1) * b) / 2.0
        for i, name in enumerate(names):
            stations[name] = ExposureStation(np.array([x, first + i * b, height]), turned, "camera")
        strips.append(Strip(f"c{k}", names, (1.0 - plan.overlap) * plan.format))
    places = {name: np.array([x, y, 0.0]) for name, (x, y) in points.items()}
    return photograph(
        "planned",
        (Camera("camera", plan.c, (plan.format, plan.format)),),
        stations,
        places,
        control=control,
        strips=strips,
        models=_Models(strips, stations, places, size / 2.0) if plan.stereo else None,
        image_um=plan.image_um,
        # without control nothing else tells how long a metre is
        stated=plan.control == "none",
    )


def rays_measured(plan: BlockPlan, made: IdealBlock) -> Callable[[str, Array], int]:
    """Return what tells how often a photo's ray to a place (3,) is measured, if it is seen.

    Parameters
    ----------
    plan, made
        The plan and its block.
    """
    if not plan.stereo:
        return lambda photo, place: 1
    models = _Models(made.block.strips, made.stations, {}, plan.format * plan.scale / 2000.0)
    return lambda photo, place: len(models.of(photo, place))


class _Models:
    """The models of its strip in which a photo's point is measured."""

    def __init__(
        self,
        strips: Iterable[Strip],
        stations: Mapping[str, ExposureStation],
        points: Mapping[str, Array],
        half: float,
    ) -> None:
        self._next: dict[str, list[tuple[str, str]]] = {}
        for strip in strips:
            for model in strip.models():
                for photo in model:
                    self._next.setdefault(photo, []).append(model)
        self._stations, self._points, self._half = stations, points, half * (1.0 + 1e-12)

    def __call__(self, photo: str, point: str) -> tuple[str | None, ...]:
        return self.of(photo, self._points[point])

    def of(self, photo: str, place: Array) -> tuple[str | None, ...]:
        found = tuple(
            f"{left}/{right}"
            for left, right in self._next.get(photo, ())
            if self._in(left, place) and self._in(right, place)
        )
        return found or (None,)

    def _in(self, photo: str, place: Array) -> bool:
        off = np.abs(place - self._stations[photo].centre)[:2]
        return bool((off <= self._half).all())


def _step(distance: float, size: float) -> float:
    """Return the largest whole part of a distance within which points still lie in a photo."""
    return distance / ceil(distance / (_REACH * size) - 1e-9)


def _line(low: float, high: float, step: float) -> list[float]:
    return [low + k * step for k in range(round((high - low) / step) + 1)]


def _spread(length: float, count: int) -> list[float]:
    if count == 1:
        return [length / 2.0]
    return [length * k / (count - 1) for k in range(count)]


def _control(
    plan: BlockPlan, points: dict[str, tuple[float, float]], extent: tuple[float, float, float]
) -> list[ControlPoint]:
    """Put control into the points; where it falls on one, that point is control."""
    if plan.control == "none":
        return []
    length, width, across = extent
    # with little side lap control on the axes leaves the strips to turn about them
    inside = plan.sidelap >= 0.5 and plan.strips > 1
    low, high = (0.0, width) if inside else (-across, width + across)
    x_parts = y_parts = 1
    if plan.control == "perimeter":
        distance = plan.bridging * plan.base
        x_parts = max(1, floor(length / distance + 0.5))
        # strips that overlap in one line of points would turn about it
        y_parts = max(1 if inside else plan.strips, floor((high - low) / distance + 0.5))
    if (x_parts + 1) * (y_parts + 1) > _MOST_CONTROL:
        raise InputError(
            f"bridging {plan.bridging:g} bases: more than {_MOST_CONTROL} control points"
        )
    xs = [length * k / x_parts for k in range(x_parts + 1)]
    ys = [low + (high - low) * k / y_parts for k in range(y_parts + 1)]
    lattice = [(x, y, k in (0, x_parts) or m in (0, y_parts))
               for k, x in enumerate(xs) for m, y in enumerate(ys)]  # fmt: skip
    if x_parts == y_parts == 1 and plan.control == "perimeter" and plan.strips > 1:
        lattice.append((length / 2.0, (low + high) / 2.0, False))
    sigma = (plan.control_m,) * 3
    control = []
    for number, (x, y, full) in enumerate(lattice, 1):
        name = _named(points, x, y, plan.base, f"k{number:02d}")
        xyz = (x, y, 0.0) if full else (None, None, 0.0)
        control.append(ControlPoint(name, xyz, sigma))
        if plan.twin and full:
            # towards the middle, so that the same photos see it
            off = _TWIN * plan.base * (1.0 if x < length / 2.0 else -1.0)
            points[f"{name}t"] = (x + off, y)
            control.append(ControlPoint(f"{name}t", (x + off, y, 0.0), sigma))
    return control


def _named(
    points: dict[str, tuple[float, float]], x: float, y: float, base: float, new: str
) -> str:
    for name, (px, py) in points.items():
        if abs(px - x) + abs(py - y) < 1e-6 * base:
            return name
    points[new] = (x, y)
    return new


def class_table(block: AdjustedBlock) -> tuple[PlannedClass, ...]:
    """Return the point-class table of 1980, exact values in place of model values."""
    mdb = block.tested.mdb[: block.observations.image].reshape(-1, 2)
    rows = []
    for kind, (rays, axis) in classify(block.problem).items():
        r = np.maximum(block.cofactors.r[rays, axis], 0.0)
        root = np.sqrt(r)
        worst = mdb[rays, axis]
        testable = np.isfinite(worst)
        rows.append(
            PlannedClass(
                kind,
                len(rays),
                float(root.mean()),
                float(root.min()),
                float(root.max()),
                float(r.mean()),
                float(worst[testable].max()) if testable.any() else None,
                int((~testable).sum()),
            )
        )
    return tuple(sorted(rows, key=lambda row: (row.kind.control, row.kind)))


def weak_photos(block: AdjustedBlock) -> tuple[WeakPhoto, ...]:
    """Return all photos, the one with the smallest mean redundancy number first."""
    photos = [
        WeakPhoto(of.name, of.rays, of.mean_r, of.low_r, of.weakest, of.axis)
        for of in photo_reliability(block)
    ]
    return tuple(sorted(photos, key=lambda photo: (round(photo.mean_r, 9), photo.photo)))


def expected_accuracy(block: AdjustedBlock) -> Accuracy | None:
    """Return the accuracy to be expected of new points; None when every point is control."""
    control = {c.point for c in block.problem.block.control if c.use == "control"}
    rows = [row for row in block.point_rows() if row.point not in control]
    if not rows:
        return None
    s = np.array([[np.nan if v is None else v for v in row.s_xyz] for row in rows])
    rms = np.sqrt((s * s).mean(axis=0)).tolist()
    worst = s.argmax(axis=0).tolist()
    return Accuracy(
        (rms[0], rms[1], rms[2]),
        (float(s[worst[0], 0]), float(s[worst[1], 1]), float(s[worst[2], 2])),
        (rows[worst[0]].point, rows[worst[1]].point, rows[worst[2]].point),
    )
