"""What the console asks of a station and of a simulated instrument's controls."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from anaplot.orientation.stripfit import Degree
    from anaplot.session.changes import Change
    from anaplot.session.commands import Command
    from anaplot.session.plates import ReadOut
    from anaplot.simulation.stereo import StereoPair
    from anaplot.station.pointing import Pointing
    from anaplot.station.snapshot import Snapshot
    from anaplot.station.stripcontrol import StripOnControl

__all__ = ["ControlsLike", "StationLike"]


class StationLike(Protocol):
    """A station as the console sees it.

    A command may raise `anaplot.errors.AnaplotError`, whose text is shown.
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

    def give(self, command: Command) -> None:
        """Give a command; it returns quickly."""

    def strips_on_control(
        self, degree: Degree, without: Collection[str]
    ) -> tuple[StripOnControl, ...]:
        """Return the strips fitted to the control measured so far; called beside the screen."""

    def pointing(self) -> Pointing:
        """Return what is known of the precision of pointing; called beside the screen."""

    def log(self) -> tuple[Change, ...]:
        """Return who changed what, the oldest first; called beside the screen."""

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
