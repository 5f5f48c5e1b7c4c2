"""The inner orientation of one photo in one carriage, as far as it was measured."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from anaplot.aliases import Axis, Side
from anaplot.photogrammetry.platetransformation import PlateTransformation
from anaplot.session.copied import copied
from anaplot.session.refusal import EventRefusedError

__all__ = ["InnerState", "MeasuredFiducial"]

_AXES: tuple[Axis, Axis] = ("x", "y")


@dataclass(frozen=True, slots=True)
class MeasuredFiducial:
    """A fiducial's latest measurement: plate coordinates [mm], and how often it was recorded."""

    fiducial: str
    x: float
    y: float
    times: int


@dataclass(frozen=True, slots=True)
class InnerState:
    """Fiducials of a photo as it lies in its carriage.

    Attributes
    ----------
    photo, side
        The photo, and the carriage in which it lies.
    fiducials
        Names of its camera's fiducials, in the order of the certificate.
    rows
        Whether x and y can be switched by themselves; where only distances are calibrated, a
        fiducial counts as a whole.
    measured
        Measurements, in the order of the certificate.
    off
        Rows (fiducial, axis) switched off.
    accepted
        The accepted transformation plate -> image, or None.
    """

    photo: str
    side: Side
    fiducials: tuple[str, ...]
    rows: bool = True
    measured: tuple[MeasuredFiducial, ...] = ()
    off: frozenset[tuple[str, Axis]] = frozenset()
    accepted: PlateTransformation | None = None

    @property
    def name(self) -> str:
        """'photo 101 (left)'."""
        return f"photo {self.photo} ({self.side})"

    @property
    def pending(self) -> tuple[str, ...]:
        """The fiducials not measured yet, but for those that are left out."""
        done = {m.fiducial for m in self.measured}
        return tuple(n for n in self.fiducials if n not in done and not self.is_off(n))

    def measurement(self, fiducial: str) -> MeasuredFiducial | None:
        """Return the latest measurement of a fiducial, or None."""
        return next((m for m in self.measured if m.fiducial == fiducial), None)

    def is_off(self, fiducial: str) -> bool:
        """Whether both rows of the fiducial are switched off."""
        return all((fiducial, axis) in self.off for axis in _AXES)

    @property
    def used(self) -> tuple[MeasuredFiducial, ...]:
        """The measurements that are not switched off altogether."""
        return tuple(m for m in self.measured if not self.is_off(m.fiducial))

    def with_measurement(self, fiducial: str, x: float, y: float) -> InnerState:
        """Return the state after a fiducial was recorded at plate coordinates [mm].

        Raises
        ------
        EventRefusedError
            The camera has no such fiducial, or a coordinate is not finite.
        """
        if fiducial not in self.fiducials:
            raise EventRefusedError(f"{self.name}: its camera has no fiducial {fiducial}")
        if not (isfinite(x) and isfinite(y)):
            raise EventRefusedError(f"fiducial {fiducial}: ({x:g}, {y:g}) is no place on a plate")
        old = self.measurement(fiducial)
        new = MeasuredFiducial(fiducial, x, y, 1 if old is None else old.times + 1)
        by_name = {m.fiducial: m for m in self.measured} | {fiducial: new}
        measured = tuple(by_name[name] for name in self.fiducials if name in by_name)
        # measured anew it is believed again, as a point is
        off = frozenset(key for key in self.off if key[0] != fiducial)
        return copied(self, measured=measured, off=off)

    def with_switch(self, fiducial: str, axis: Axis | None, on: bool) -> InnerState:
        """Return the state after a fiducial, or one of its rows, was switched.

        Raises
        ------
        EventRefusedError
            The camera has no such fiducial, one row is to be switched of what is not measured, or
            of what has no rows of its own.
        """
        known = fiducial in self.fiducials
        if not known or (axis is not None and self.measurement(fiducial) is None):
            raise EventRefusedError(f"fiducial {fiducial} of {self.name} is not measured")
        if axis is not None and not self.rows:
            raise EventRefusedError(
                f"fiducial {fiducial}: where only distances are calibrated, it is switched as a "
                "whole"
            )
        rows = {(fiducial, one) for one in _AXES if axis in (None, one)}
        return copied(self, off=self.off - rows if on else self.off | rows)

    def with_acceptance(self, transformation: PlateTransformation) -> InnerState:
        """Return the state after the transformation was accepted.

        Raises
        ------
        EventRefusedError
            No fiducial is measured.
        """
        if not self.used:
            raise EventRefusedError(f"{self.name}: no fiducial is measured")
        return copied(self, accepted=transformation)
