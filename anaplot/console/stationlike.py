"""What the console asks of a station and of a simulated instrument's controls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from anaplot.aliases import Axis
from anaplot.session.plates import ReadOut
from anaplot.simulation.stereo import StereoPair
from anaplot.station.snapshot import Snapshot

__all__ = ["ControlsLike", "StationLike"]


class StationLike(Protocol):
    """A station as the console sees it.

    Commands return quickly and may raise `anaplot.errors.AnaplotError`, whose text is shown.
    Both kinds of callbacks may come from any thread.
    """

    def snapshot(self) -> Snapshot:
        """Return the current snapshot."""

    def readout(self) -> ReadOut | None:
        """Return the live read-out [mm], or None while there is none."""

    def subscribe(self, callback: Callable[[Snapshot], None]) -> Callable[[], None]:
        """Call back with a new snapshot after each change; returns the end of the subscription."""

    def subscribe_notices(self, callback: Callable[[str, str], None]) -> Callable[[], None]:
        """Call back with (severity, one line); severity: info, warning, error or record."""

    def drive(self, point: str) -> None:
        """Drive the plates to a point of the current model."""

    def stop(self) -> None:
        """Stop a drive."""

    def record(self) -> None:
        """Record the point at which the plates stand."""

    def switch(self, point: str, axis: Axis | None, on: bool) -> None:
        """Switch a row, or the whole point (axis None), off or on."""

    def undo(self) -> None:
        """Take the last event back."""

    def accept(self) -> None:
        """Accept the current model."""

    def next_model(self) -> None:
        """Go on to the next model."""

    def other_photo(self) -> None:
        """Take it that the other photo of the model was laid into the mono comparator."""

    def reference(self, point: str | None = None) -> None:
        """Refer counters without reference to a measured point, or to the one proposed."""

    def keep_counters(self) -> None:
        """Take counters without reference as they are."""

    def suspend(self) -> None:
        """Interrupt the work."""

    def resume(self) -> None:
        """Go on with it."""

    def add_point(self, name: str) -> None:
        """Add a point beyond the plan."""

    def close(self) -> None:
        """Close link and journal; harmless when closed already."""


class ControlsLike(Protocol):
    """The controls that only a simulated instrument has, as the console sees them."""

    @property
    def automatic(self) -> bool:
        """Whether the simulated operator works by himself."""

    def set_automatic(self, on: bool) -> None:
        """Let the simulated operator work, or stop him."""

    def stereo(self, columns: int, rows: int, field_mm: float) -> StereoPair | None:
        """Return what is seen around the mark, the same object while nothing changes.

        `columns` and `rows` of square cells, `field_mm` wide.
        """

    def turn(self, dx: float = 0.0, dy: float = 0.0, dpx: float = 0.0, dpy: float = 0.0) -> None:
        """Turn the handwheels [mm]: both marks by x, y, the right by px, py."""

    @property
    def hand(self) -> bool:
        """Whether the simulated hand sets the mark after a drive."""

    def set_hand(self, on: bool) -> None:
        """Let the simulated hand set the mark, or leave it to the operator."""
