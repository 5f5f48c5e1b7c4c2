"""A model as far as it was measured, in both photos at once or in one after the other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

from anaplot.aliases import Axis, Side
from anaplot.session.copied import copied
from anaplot.session.events import PlannedPoint
from anaplot.session.innerstate import InnerState

__all__ = ["Measured", "ModelState", "Sighting"]


@dataclass(frozen=True, slots=True)
class Measured:
    """A point's latest measurement in a model.

    Attributes
    ----------
    point
        Name.
    xl, yl, xr, yr
        Image coordinates [mm].
    times
        How often it was recorded in this model.
    """

    point: str
    xl: float
    yl: float
    xr: float
    yr: float
    times: int


@dataclass(frozen=True, slots=True)
class Sighting:
    """A point's latest measurement in one photo of a model: image coordinates [mm].

    `times` counts how often it was recorded there; one that was taken over counts as once.
    """

    point: str
    side: Side
    x: float
    y: float
    times: int


@dataclass(frozen=True, slots=True)
class ModelState:
    """A model as far as it was measured.

    Attributes
    ----------
    strip, left, right
        Names.
    plan
        The points to measure, in order; added points at the end.
    measured
        Measurements, in the order of the plan.
    off
        Rows (point, axis) switched off.
    inner
        Inner orientations of its photos, left first; none where the cameras have no fiducials.
    mono
        Whether it is measured in a mono comparator, one photo after the other.
    seen
        What was measured in the photos of a mono model: the left one first, in the order of the
        plan. `measured` follows from it: a point counts when it was measured in both.
    laid
        Which photo lies in the comparator; None when nobody knows, or the model is no mono one.
    laying
        The how many-th photo of the session that is; where both photos lie in the instrument, the
        how many-th model.
    """

    strip: str
    left: str
    right: str
    plan: tuple[PlannedPoint, ...]
    measured: tuple[Measured, ...] = ()
    off: frozenset[tuple[str, Axis]] = frozenset()
    inner: tuple[InnerState, ...] = ()
    mono: bool = False
    seen: tuple[Sighting, ...] = ()
    laid: Side | None = None
    laying: int = 0

    @property
    def photos(self) -> tuple[str, str]:
        """(left, right)."""
        return self.left, self.right

    @property
    def name(self) -> str:
        """'left/right'."""
        return f"{self.left}/{self.right}"

    def planned(self, point: str) -> PlannedPoint | None:
        """Return the planned point of that name, or None."""
        for planned in self.plan:  # no generator: asked for several times with every event
            if planned.point == point:
                return planned
        return None

    def measurement(self, point: str) -> Measured | None:
        """Return the latest measurement of a point, or None."""
        for measured in self.measured:
            if measured.point == point:
                return measured
        return None

    def place_of(self, side: Side, point: str) -> tuple[float, float] | None:
        """Return where a point was measured last in one photo [mm], or None.

        In a mono model also while it is measured in that photo only.
        """
        if self.mono:
            seen = self.sighting(side, point)
            return None if seen is None else (seen.x, seen.y)
        m = self.measurement(point)
        if m is None:
            return None
        return (m.xl, m.yl) if side == "left" else (m.xr, m.yr)

    def fiducial_place(self, side: Side, fiducial: str) -> tuple[float, float] | None:
        """Return where a fiducial was measured last on the plate in a carriage [mm], or None."""
        inner = self.inner_of(side)
        m = None if inner is None else inner.measurement(fiducial)
        return None if m is None else (m.x, m.y)

    def axes(self, point: str) -> tuple[Axis, ...]:
        """Return the rows that a point of this model has: y, and x when it is a tie."""
        planned = self.planned(point)
        return ("y", "x") if planned is not None and planned.role == "tie" else ("y",)

    def is_off(self, point: str) -> bool:
        """Whether every row of the point is switched off."""
        return all((point, axis) in self.off for axis in self.axes(point))

    @property
    def used(self) -> tuple[Measured, ...]:
        """The measurements that are not switched off altogether."""
        if not self.off:
            return self.measured
        return tuple(m for m in self.measured if not self.is_off(m.point))

    @property
    def carriages(self) -> tuple[Side, ...]:
        """Sides of the photos that lie in the instrument: both, or in a mono comparator one."""
        if not self.mono:
            return "left", "right"
        return () if self.laid is None else (self.laid,)

    @property
    def open_inner(self) -> InnerState | None:
        """The inner orientation to be done first, or None when points can be measured.

        In a mono comparator only that of the photo in it.
        """
        if not self.inner:
            return None
        there = self.carriages
        return next((i for i in self.inner if i.side in there and i.accepted is None), None)

    def inner_of(self, side: Side) -> InnerState | None:
        """Return the inner orientation in a carriage; None where the camera has no fiducials."""
        return next((i for i in self.inner if i.side == side), None)

    @property
    def pending(self) -> tuple[PlannedPoint, ...]:
        """The planned points not measured yet, but for those that are left out."""
        done = {m.point for m in self.measured} | self._left_out
        return tuple(p for p in self.plan if p.point not in done)

    @property
    def _left_out(self) -> set[str]:
        """Points that were switched off, instead of measured or after it."""
        return {p.point for p in self.plan if self.is_off(p.point)} if self.off else set()

    def photo(self, side: Side) -> str:
        """Return the name of a side's photo."""
        return self.left if side == "left" else self.right

    def sighting(self, side: Side, point: str) -> Sighting | None:
        """Return a mono model's latest measurement of a point in one photo, or None."""
        return next((s for s in self.seen if (s.side, s.point) == (side, point)), None)

    def pending_in(self, side: Side) -> tuple[PlannedPoint, ...]:
        """Return the planned points of a mono model not measured yet in one photo."""
        done = {s.point for s in self.seen if s.side == side} | self._left_out
        return tuple(p for p in self.plan if p.point not in done)

    def with_sighting(self, sighting: Sighting) -> Self:
        """Return the mono model after a point was measured in one photo."""
        found = {(s.side, s.point): s for s in self.seen}
        found[sighting.side, sighting.point] = sighting
        # a point measured anew is believed again until its rows say otherwise
        off = frozenset(key for key in self.off if key[0] != sighting.point)
        return copied(self, off=off).with_sightings(found.values())

    def with_sightings(self, sightings: Iterable[Sighting]) -> Self:
        """Return the mono model with these as all that was measured in its photos."""
        found = {(s.side, s.point): s for s in sightings}
        sides: tuple[Side, Side] = ("left", "right")
        seen = tuple(
            found[side, p.point] for side in sides for p in self.plan if (side, p.point) in found
        )
        pairs = [(found.get(("left", p.point)), found.get(("right", p.point))) for p in self.plan]
        measured = tuple(
            Measured(a.point, a.x, a.y, b.x, b.y, a.times + b.times - 1)
            for a, b in pairs
            if a is not None and b is not None
        )
        return copied(self, seen=seen, measured=measured)
