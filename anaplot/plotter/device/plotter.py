"""The simulated plotter: what any profile's device would say, with a hand at its wheels.

No ports, no threads and no clock: bytes in, simulated time in, bytes out. `server` puts it
behind a pseudo-terminal.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from anaplot.aliases import Side
from anaplot.plotter.device.hand import (
    Hand,
    HandSettled,
    Observer,
    Offsets,
    Photographs,
    Pointing,
)
from anaplot.plotter.device.machine import Machine
from anaplot.plotter.device.motion import Carriages
from anaplot.plotter.device.outgoing import Outgoing
from anaplot.plotter.readings import Position
from anaplot.plotter.schema import Profile

__all__ = ["SimulatedPlotter"]


class SimulatedPlotter:
    """A plotter that speaks a profile, with photographs in it.

    Parameters
    ----------
    profile
        The device.
    photographs
        Photo -> point -> true plate coordinates (x, y) [mm]. Fiducials are among them, see
        `fiducial_name`.
    in_right
        The same for the right carriage, where a photograph lies differently there.
    seed
        Of the pointing noise.
    noise_um
        Standard deviation of a pointing in each coordinate [um].
    hand
        What the operator's hand does.
    mistakes
        (left, right, point) -> offsets added the first times the point is pointed at; of a
        fiducial the offsets of its own carriage.
    drift
        Added to every pointing, growing with each one: n times the offsets at the n-th pointing
        in a model, counted over the model's points; fiducials are free of it.
    on_settled
        Called when the mark is set; from whatever thread lets time pass, without any lock held.
    start
        Where the carriages stand first.
    fault_rates
        Fault -> probability for one record, see `faults`.
    fault_seconds
        How long lasting faults last when they strike by rate [s].
    pointed
        How often points were pointed at before, as `pointed` returns it: a session that goes on
        tomorrow meets the same noise and mistakes as one that was never interrupted.

    Notes
    -----
    Pointing noise is drawn from a generator keyed by seed, photos, point and how often the
    point was pointed at in this model, so that results do not depend on timing or order.
    All methods may be called from any thread.
    """

    def __init__(
        self,
        profile: Profile,
        photographs: Photographs,
        *,
        seed: int = 0,
        noise_um: float = 5.0,
        hand: Hand | None = None,
        mistakes: Mapping[tuple[str, str, str], Offsets] | None = None,
        drift: Offsets | None = None,
        on_settled: Callable[[HandSettled], None] | None = None,
        start: Position | None = None,
        pointed: Mapping[tuple[str, str, str], int] | None = None,
        in_right: Photographs | None = None,
        fault_rates: Mapping[str, float] | None = None,
        fault_seconds: float = 2.0,
    ) -> None:
        self._profile = profile
        self._hand = hand if hand is not None else Hand()
        self._on_settled = on_settled
        self._on_wake: Callable[[], None] | None = None
        self._lock = threading.RLock()
        self._observer = Observer(
            mono=profile.mono,
            in_left=photographs,
            in_right=in_right,
            seed=seed,
            noise_um=noise_um,
            mistakes=mistakes or {},
            drift=drift if drift is not None else Offsets(),
            pointed=pointed or {},
        )
        self._carriages = Carriages(profile, start or Position(0.0, 0.0, 0.0, 0.0), seed)
        self._outgoing = Outgoing(profile, seed, fault_rates or {}, fault_seconds)
        self._machine = Machine(profile, self._carriages, self._outgoing, self._begin_settling)
        self._settled: list[HandSettled] = []

    # -- from outside ----------------------------------------------------------------------

    @property
    def profile(self) -> Profile:
        """The device's profile."""
        return self._profile

    @property
    def now(self) -> float:
        """Simulated time [s]."""
        return self._machine.now

    @property
    def hand(self) -> Hand:
        """What the hand does."""
        return self._hand

    def set_hand(self, hand: Hand) -> None:
        """Change what the hand does; one that is to follow does so from the next drive on."""
        with self._lock:
            self._hand = hand

    def set_on_settled(self, callback: Callable[[HandSettled], None] | None) -> None:
        """Set who is told when the mark is set."""
        with self._lock:
            self._on_settled = callback

    def set_on_wake(self, callback: Callable[[], None] | None) -> None:
        """Set who is told that something happens earlier than announced (the server)."""
        with self._lock:
            self._on_wake = callback

    def lay(
        self,
        left: str,
        right: str | None = None,
        side: Side = "left",
        placed: Side | None = None,
    ) -> None:
        """Lay photographs into the carriages.

        Parameters
        ----------
        left, right
            Photos of the model; with a mono comparator `right` may be left out.
        side
            Which of them lies in a mono comparator.
        placed
            In which of its two placements it lies there; by default that of its side.

        Raises
        ------
        InputError
            When there is no such photograph.
        """
        with self._lock:
            self._observer.lay(left, right, side, placed)

    def attend(self, side: Side | None) -> None:
        """Say in which plate the hand points at fiducials from now on; None: points, in both."""
        with self._lock:
            self._observer.attended = side

    def set_drift(self, drift: Offsets) -> None:
        """Have the hand creep by so much [mm] at every pointing of a model, from now on."""
        with self._lock:
            self._observer.drift = drift

    def add_mistakes(self, mistakes: Mapping[tuple[str, str, str], Offsets]) -> None:
        """Plant more mistakes; one of the same model and point is replaced."""
        with self._lock:
            self._observer.mistakes.update(mistakes)

    @property
    def laid(self) -> tuple[str, str]:
        """The photographs in the left and the right carriage; "" when empty."""
        return self._observer.laid

    def points_of(self, photo: str, side: Side = "left") -> dict[str, tuple[float, float]]:
        """Return the true plate coordinates (x, y) [mm] of a photograph's points in a carriage.

        Raises
        ------
        InputError
            When there is no such photograph.
        """
        return self._observer.points_of(photo, side)

    @property
    def pointed(self) -> dict[tuple[str, str, str], int]:
        """(left, right, point) -> how often it was pointed at."""
        with self._lock:
            return dict(self._observer.pointed)

    @property
    def drives(self) -> int:
        """How many drives were begun, by the device or by the hand."""
        return self._machine.drives

    def remember(self, pointed: Mapping[tuple[str, str, str], int]) -> None:
        """Take over how often points were pointed at before, as in the constructor."""
        with self._lock:
            self._observer.pointed.update(pointed)

    def positions(self) -> Position:
        """Return where the carriages truly stand, plate coordinates [mm]."""
        with self._lock:
            return self._carriages.stand(self._machine.now)

    @property
    def counted_from(self) -> Position:
        """Where the carriages stand when the counters are where they began, less that beginning.

        Plate coordinates [mm]; zero until the device was switched off and on.
        """
        with self._lock:
            return self._carriages.counted_from

    def move(
        self, dxl: float = 0.0, dyl: float = 0.0, dxr: float = 0.0, dyr: float = 0.0
    ) -> Position:
        """Turn the handwheels; a drive under way is stopped.

        Parameters
        ----------
        dxl, dyl, dxr, dyr
            Displacements of the plates [mm]; the travel's ends hold.

        Returns
        -------
        Position
            Where the carriages stand then.
        """
        with self._lock:
            self._machine.halt()
            here = self._carriages.stand(self._machine.now)
            self._carriages.put(
                Position(here.xl + dxl, here.yl + dyl, here.xr + dxr, here.yr + dyr)
            )
            result = self._carriages.stand(self._machine.now)
        self._wake()
        return result

    def hand_to(self, position: Position, *, unnoticed: bool = False) -> None:
        """Have the hand move the plates near a place by itself, as an undriven plotter needs.

        Parameters
        ----------
        position
            Plate coordinates [mm]; the mark is then set on the nearest true point.
        unnoticed
            It is no measurement: the pedal is left alone and the pointing is not counted.
        """
        with self._lock:
            self._machine.halt()
            self._carriages.put(position)
            self._machine.drives += 1
            self._begin_settling(unnoticed=unnoticed)
        self._wake()

    def press(self, switch: str | None = None) -> bool:
        """Press a footswitch where the carriages stand now.

        Parameters
        ----------
        switch
            Its name; the hand's pedal by default.

        Returns
        -------
        bool
            Whether the device sends anything for it: a key or a modem line is the host's.

        Raises
        ------
        InputError
            When the profile has no such footswitch.
        """
        with self._lock:
            sent = self._machine.press(switch if switch is not None else self._hand.pedal)
        self._wake()
        return sent

    def power_cycle(self) -> None:
        """Switch the device off and on: its counters and its count of presses begin at zero."""
        with self._lock:
            self._machine.switch_off_and_on()

    def inject(self, fault: str, link: str | None = None, seconds: float | None = None) -> None:
        """Have a fault strike once: the next record, or from now on for a while.

        Parameters
        ----------
        fault
            One of `faults.FAULTS`.
        link
            Where; None for every link.
        seconds
            How long a lasting fault lasts.

        Raises
        ------
        InputError
            When there is no such fault or link.
        """
        with self._lock:
            self._outgoing.inject(fault, link, seconds, self._machine.now)
        self._wake()

    def set_fault_rates(self, rates: Mapping[str, float]) -> None:
        """Set the probabilities with which faults strike a record.

        Raises
        ------
        InputError
            When there is no such fault, or a rate is no probability.
        """
        with self._lock:
            self._outgoing.set_fault_rates(rates)

    def take_cuts(self) -> list[tuple[str, float]]:
        """Return links to be broken now, with the simulated seconds until they are mended."""
        with self._lock:
            return self._outgoing.take_cuts()

    def receive(self, data: bytes, link: str | None = None) -> None:
        """Take bytes from the host.

        Parameters
        ----------
        data
            What came.
        link
            Where; the profile's first link by default.
        """
        name = link if link is not None else self._profile.default_link
        with self._lock:
            self._machine.receive(data, name)

    def step(self, dt: float, link: str | None = None) -> bytes:
        """Let simulated time pass.

        Parameters
        ----------
        dt
            How much [s].
        link
            Whose bytes are wanted; the profile's first link by default.

        Returns
        -------
        bytes
            What the device has sent on that link; other links keep theirs for their turn.
        """
        self.advance(dt)
        return self.take(link)

    def advance(self, dt: float) -> None:
        """Let simulated time pass; the bytes stay until they are taken."""
        with self._lock:
            self._machine.advance(dt)
            settled, self._settled = self._settled, []
            callback = self._on_settled
        if callback is not None:
            for event in settled:
                callback(event)

    def take(self, link: str | None = None) -> bytes:
        """Return the bytes whose time has come, once."""
        name = link if link is not None else self._profile.default_link
        with self._lock:
            return self._outgoing.take(name, self._machine.now)

    def next_event(self) -> float | None:
        """Return in how many simulated seconds something happens by itself, or None."""
        with self._lock:
            return self._machine.next_event()

    def _wake(self) -> None:
        callback = self._on_wake
        if callback is not None:
            callback()

    # -- the hand --------------------------------------------------------------------------

    def _begin_settling(self, *, unnoticed: bool = False) -> None:
        self._machine.disturb()
        if self._hand.follow and self._observer.laid[0]:
            self._machine.unless_disturbed(
                self._hand.settle_time, lambda: self._settle(unnoticed=unnoticed)
            )

    def _settle(self, *, unnoticed: bool) -> None:
        if not self._hand.follow:
            return
        machine, carriages = self._machine, self._carriages
        here = carriages.stand(machine.now)
        found = self._observer.point(here, self._hand, unnoticed=unnoticed)
        if found is None:
            self._settled.append(HandSettled(None, here, 0, machine.drives))
            return
        seconds = carriages.by_hand(found.place, machine.now)
        if seconds:
            machine.unless_disturbed(seconds, lambda: self._set(found, unnoticed=unnoticed))
        else:
            self._set(found, unnoticed=unnoticed)

    def _set(self, found: Pointing, *, unnoticed: bool) -> None:
        """End setting the mark: tell, and press the pedal where the hand does."""
        machine, carriages = self._machine, self._carriages
        carriages.arrive()
        there = carriages.stand(machine.now)
        self._settled.append(HandSettled(found.point, there, found.times, machine.drives))
        if self._hand.auto_pedal and not unnoticed:
            machine.unless_disturbed(
                self._hand.pedal_time, lambda: self._machine.press(self._hand.pedal)
            )
