"""What is measured now, and what a record means: fiducials, points in both photos, or in one.

A model in the instrument is in one of these modes. A mode says which names there are, where the
plates go for one, and which event a record there is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from anaplot.aliases import Axis, Side
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.platetransformation import Placement, PlateTransformation
from anaplot.photogrammetry.readings import Position
from anaplot.planning.fiducialplan import expected_fiducials, predicted_fiducial
from anaplot.planning.modelplan import predicted_right
from anaplot.session.events import (
    OFFERED,
    Event,
    FiducialMeasured,
    FiducialSwitched,
    MonoMeasured,
    PlannedPoint,
    PointAdded,
    PointMeasured,
    PointRenamed,
    Role,
    RowSwitched,
)
from anaplot.session.innerstate import InnerState
from anaplot.session.modelstate import ModelState
from anaplot.session.plates import ReadOut, image_of, plate_of, plates_of
from anaplot.session.state import SessionState
from anaplot.session.tiecheck import Known
from anaplot.session.transfer import Transfer, transfer

__all__ = ["Fiducials", "Mode", "Pairs", "Singles", "mode_of"]


def mode_of(state: SessionState, known: Known) -> Mode | None:
    """Return what is measured in a session's present state; None between models.

    Parameters
    ----------
    state
        The session's state.
    known
        What is known from elsewhere; what follows from it only points ask for.
    """
    model = state.current
    if model is None:
        return None
    if model.open_inner is not None:
        return Fiducials(state, model, model.open_inner)
    return Singles(state, model, known) if model.mono else Pairs(state, model, known)


@dataclass(frozen=True, slots=True)
class Fiducials:
    """The fiducials of one photo as it lies in its carriage."""

    state: SessionState
    model: ModelState
    inner: InnerState
    unit: ClassVar[str] = "fiducial"

    @property
    def side(self) -> Side | None:
        """The carriage."""
        return self.inner.side

    @property
    def pending(self) -> tuple[str, ...]:
        """Fiducials not measured yet."""
        return self.inner.pending

    def has(self, name: str) -> bool:
        """Whether the camera has a fiducial."""
        return name in self.inner.fiducials

    def missing(self, name: str) -> str:
        """Return what is said of a fiducial that there is not."""
        return f"{self.inner.name} has no fiducial {name}"

    def place(self, name: str, middle: Position, *, known: bool) -> Position:
        """Return where the plates go for a fiducial; another plate waits at its centre.

        Once a photo was oriented in a carriage, the next one there is looked for where it lay.
        """
        del known
        calibration = self.state.block.camera_of(self.inner.photo).calibration
        assert calibration is not None
        expected = expected_fiducials(calibration)
        placed = self._nominal(self.inner.side, middle)
        names = [*expected, ""]
        places = placed.to_plate(np.array([*expected.values(), (0.0, 0.0)]))
        nominal = {one: (x, y) for one, (x, y) in zip(names, places.tolist(), strict=True)}
        nominal.setdefault(name, nominal[""])
        measured = {m.fiducial: (m.x, m.y) for m in self.inner.used}
        x, y = predicted_fiducial(expected, nominal, measured, name)
        if self.model.mono:
            return Position(x, y, x, y)
        other: Side = "right" if self.inner.side == "left" else "left"
        waiting = self._nominal(other, middle).to_plate(np.zeros((1, 2)))
        ((waiting_x, waiting_y),) = waiting.tolist()
        if self.inner.side == "left":
            return Position(x, y, waiting_x, waiting_y)
        return Position(waiting_x, waiting_y, x, y)

    def stands(self, name: str, middle: Position) -> Position | None:
        """Return where the carriages stood for a fiducial that is measured, or None."""
        m = self.inner.measurement(name)
        if m is None:
            return None
        if self.model.mono:
            return Position(m.x, m.y, m.x, m.y)
        at = self.place(name, middle, known=False)
        if self.inner.side == "left":
            return Position(m.x, m.y, at.xr, at.yr)
        return Position(at.xl, at.yl, m.x, m.y)

    def _nominal(self, side: Side, middle: Position) -> PlateTransformation:
        """Return how a photo is thought to lie in a carriage before anything is measured in it."""
        for model in reversed(self.state.models):
            inner = model.inner_of(side)
            if inner is not None and inner.accepted is not None:
                try:
                    return inner.accepted.placement().transformation()
                except (NotComputableError, ValueError):
                    continue  # so odd that nothing follows from it for the next photo
        x, y = (middle.xl, middle.yl) if side == "left" else (middle.xr, middle.yr)
        return Placement(x, y).transformation()

    def additions(self, name: str) -> tuple[Event, ...]:
        """Return none: the camera has the fiducials that it has."""
        del name
        return ()

    def measurement(self, name: str, at: Position, switch: str) -> Event:
        """Return the fiducial's measurement on its plate."""
        side = self.inner.side
        x, y = (at.xl, at.yl) if side == "left" else (at.xr, at.yr)
        return FiducialMeasured(self.inner.photo, side, name, x, y, switch)

    def switch(self, name: str, axis: Axis | None, on: bool) -> Event:
        """Return the event that switches a fiducial's row."""
        return FiducialSwitched(self.inner.photo, name, axis, on)


@dataclass(frozen=True, slots=True)
class _Points:
    """The points of a model."""

    state: SessionState
    model: ModelState
    known: Known
    unit: ClassVar[str] = "point"

    @property
    def side(self) -> Side | None:
        """None: points are pointed at in whatever lies there."""
        return None

    @property
    def _transfer(self) -> Transfer:
        return transfer(self.state, self.known)

    def has(self, name: str) -> bool:
        """Whether the model has a point."""
        return self._planned(name) is not None

    def missing(self, name: str) -> str:
        """Return what is said of a point that there is not."""
        return f"point {name} is not in model {self.model.name}"

    def additions(self, name: str) -> tuple[Event, ...]:
        """Return the event that takes a point into the model that was only offered, or none."""
        offer = None if self.model.planned(name) else self._transfer.offer(name)
        return () if offer is None else (PointAdded(offer.planned),)

    def _planned(self, name: str) -> PlannedPoint | None:
        if planned := self.model.planned(name):
            return planned
        offer = self._transfer.offer(name)
        return None if offer is None else offer.planned

    def switch(self, name: str, axis: Axis | None, on: bool) -> Event:
        """Return the event that switches a point's row."""
        return RowSwitched(name, axis, on)

    def renamed(self, point: str, name: str, side: Side | None) -> Event:
        """Return the event that gives what was measured as a point another name."""
        left, right = self.model.photos
        planned = self.model.planned(name)
        role = self._role(name) if planned is None else planned.role
        return PointRenamed(left, right, point, name, side, role)

    def _images(self, name: str, *, known: bool) -> tuple[float, float, float, float]:
        """Return where a point is expected in both photos [mm]."""
        planned = self._planned(name)
        assert planned is not None
        if planned.role in OFFERED and (there := self._transfer.places.get(name)):
            return there[0]  # better with every point
        xr, yr = planned.xr, planned.yr
        if not known and planned.role not in OFFERED:
            seen = [(m.xl, m.yl, m.xr, m.yr) for m in self.model.used if m.point != name]
            xr, yr = predicted_right(seen, planned.xl, planned.yl) or (xr, yr)
        return planned.xl, planned.yl, xr, yr

    def _role(self, name: str) -> Role:
        before = self.state.preceding(self.model.strip, self.model.left)
        if before is not None and any(m.point == name for m in before.used):
            return "tie"
        return self._transfer.marks.get(name) or "new"


@dataclass(frozen=True, slots=True)
class Pairs(_Points):
    """The points of a model, in both photos at once."""

    @property
    def pending(self) -> tuple[str, ...]:
        """Points of the plan not measured yet."""
        return tuple(p.point for p in self.model.pending)

    def place(self, name: str, middle: Position, *, known: bool) -> Position:
        """Return where the plates go for a point."""
        del middle
        return plate_of(*self._images(name, known=known), plates_of(self.state))

    def stands(self, name: str, middle: Position) -> Position | None:
        """Return where the carriages stood for a point that is measured, or None."""
        del middle
        m = self.model.measurement(name)
        return None if m is None else plate_of(m.xl, m.yl, m.xr, m.yr, plates_of(self.state))

    def measurement(self, name: str, at: Position, switch: str) -> Event:
        """Return the point's measurement in both photos."""
        read = image_of(at, plates_of(self.state))
        return PointMeasured(
            self.model.left, self.model.right, name, read.xl, read.yl, read.xr, read.yr, switch
        )

    def added(self, name: str, here: ReadOut) -> PlannedPoint:
        """Return a point beyond the plan, where the plates stand."""
        role = self._role(name)
        return PlannedPoint(name, role, here.xl, here.yl, here.xr, here.yr)


@dataclass(frozen=True, slots=True)
class Singles(_Points):
    """The points of a model in a mono comparator, in the one photo that lies there."""

    @property
    def pending(self) -> tuple[str, ...]:
        """Points of the plan not measured yet in the photo that lies there."""
        there = self.model.carriages
        return tuple(p.point for side in there for p in self.model.pending_in(side))

    def place(self, name: str, middle: Position, *, known: bool) -> Position:
        """Return where the plate goes for a point."""
        del middle
        place = self._images(name, known=known)
        one = place[2:] if self.model.laid == "right" else place[:2]
        return plate_of(*one, *one, plates_of(self.state))

    def stands(self, name: str, middle: Position) -> Position | None:
        """Return where the plate stood for a point measured in the photo that lies there."""
        del middle
        laid = self.model.laid
        seen = None if laid is None else self.model.sighting(laid, name)
        if seen is None:
            return None
        return plate_of(seen.x, seen.y, seen.x, seen.y, plates_of(self.state))

    def measurement(self, name: str, at: Position, switch: str) -> Event:
        """Return the point's measurement in the photo that lies there."""
        model, read = self.model, image_of(at, plates_of(self.state))
        laid = model.laid or "left"
        return MonoMeasured(model.left, model.right, laid, name, read.xl, read.yl, switch)

    def added(self, name: str, here: ReadOut) -> PlannedPoint:
        """Return a point beyond the plan, where the plate stands.

        Its place in the other photo follows from the points measured in both.
        """
        right = self.model.laid == "right"
        both = [(m.xl, m.yl, m.xr, m.yr) for m in self.model.used]
        pairs = [(m[2], m[3], m[0], m[1]) if right else m for m in both]
        other = predicted_right(pairs, here.xl, here.yl)
        if other is None:
            parallax = sorted(p.xl - p.xr for p in self.model.plan)
            base = parallax[len(parallax) // 2] if parallax else 0.0
            other = (here.xl + base if right else here.xl - base, here.yl)
        role = self._role(name)
        if right:
            return PlannedPoint(name, role, *other, here.xl, here.yl)
        return PlannedPoint(name, role, here.xl, here.yl, *other)


Mode = Fiducials | Pairs | Singles
