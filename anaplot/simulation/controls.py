"""What only a simulated instrument offers a person: eyepieces, handwheels, hand and operator."""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.session.commands import TakeOver
from anaplot.session.plates import image_of, plate_of, plates_of
from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.instrument import SimulatedInstrument
from anaplot.simulation.stereo import StereoPair
from anaplot.station.station import Severity, Station

__all__ = ["Controls", "controls_of"]


def controls_of(station: Station) -> Controls | None:
    """Return the controls of a station's instrument; None where it is no simulated one."""
    instrument = station.instrument
    return Controls(station, instrument) if isinstance(instrument, SimulatedInstrument) else None


class Controls:
    """The controls of a simulated instrument at which a station works.

    Parameters
    ----------
    station
        The station.
    instrument
        Its instrument.
    """

    def __init__(self, station: Station, instrument: SimulatedInstrument) -> None:
        self._station = station
        self._instrument = instrument
        self._operator: AutomaticOperator | None = None
        station.before_close(self._rest)

    def stereo(self, columns: int, rows: int, field_mm: float) -> StereoPair | None:
        """Return what is seen around the mark, the same object while nothing changes.

        Parameters
        ----------
        columns, rows
            Size of each patch in square cells.
        field_mm
            Width of a patch [mm].

        Returns
        -------
        StereoPair or None
            None in a mono comparator, and before photographs are laid.
        """
        return self._instrument.stereo(columns, rows, field_mm)

    def turn(self, dx: float = 0.0, dy: float = 0.0, dpx: float = 0.0, dpy: float = 0.0) -> None:
        """Turn the handwheels; whoever turns takes over from the hand.

        Parameters
        ----------
        dx, dy
            Both marks move over the photographs [mm].
        dpx, dpy
            Changes of the parallaxes px = x' - x'', py = y' - y'' [mm]: the right mark moves.

        Raises
        ------
        InputError
            Plates under way or at the end of their travel, or the simulated operator is at work.
        """
        self._check_free()
        with self._station.by_hand():
            plates = plates_of(self._station.state)
            here = image_of(self._instrument.simulator.positions(), plates)
            there = (here.xl + dx, here.yl + dy, here.xr + dx - dpx, here.yr + dy - dpy)
            self._instrument.turn(plate_of(*there, plates))

    @property
    def hand(self) -> bool:
        """Whether the hand sets the mark after a drive."""
        return self._instrument.hand

    def set_hand(self, on: bool) -> None:
        """Let the hand set the mark from the next drive on, or leave it to the person.

        Raises
        ------
        InputError
            The simulated operator is at work.
        """
        self._check_free()
        self._instrument.set_hand(on)
        if on:
            self._station.tell("info", "the simulated hand sets the mark from the next drive on")
        else:
            self._station.give(TakeOver())
            self._station.tell("info", "the mark is yours: clear the parallax, then record")

    def _check_free(self) -> None:
        if self.automatic:
            raise InputError("the simulated operator is at work: stop him first")

    @property
    def automatic(self) -> bool:
        """Whether the simulated operator works by himself."""
        return self._operator is not None

    def set_automatic(self, on: bool) -> None:
        """Let the simulated operator work by himself, or stop him."""
        if on and self._operator is None:
            self._operator = AutomaticOperator(self._station)
            self._operator.start(self._ended)
        elif not on:
            self._rest()
        self._station.tell("info", "the simulated operator " + ("works" if on else "rests"))

    def _ended(self, severity: Severity, text: str) -> None:
        self._operator = None
        self._station.tell(severity, text)

    def _rest(self) -> None:
        operator, self._operator = self._operator, None
        if operator is not None:
            operator.stop()
