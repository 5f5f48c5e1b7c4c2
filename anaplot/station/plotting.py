"""The plotter that a station works with: a link, and a simulated device when one is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from anaplot.aliases import Side
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.plotter.commands import parse_ports
from anaplot.plotter.link import Link
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position, Reading
from anaplot.plotter.schema import Profile
from anaplot.plotter.server import SimulatorServer
from anaplot.plotter.simulator import Hand, HandSettled, Offsets, SimulatedPlotter
from anaplot.station.laidplates import Placements, laid_photographs
from anaplot.station.stereo import StereoGround, StereoPair

__all__ = ["PROFILE_OF_SIMULATION", "InstrumentSetup", "Plotting", "SimulationSetup"]

PROFILE_OF_SIMULATION = "simulated"


class Listener(Protocol):
    """What a station hears; every call may come from any thread and must return at once."""

    def on_reading(self, reading: Reading) -> None:
        """Take a decoded reading."""

    def room(self) -> bool:
        """Whether more can be taken; while not, the line is not read."""

    def on_link_state(self, state: str, detail: str) -> None:
        """Take the new state of the link."""

    def on_traffic(self, direction: Literal["in", "out"], link: str, data: bytes) -> None:
        """Bytes came in or were sent."""

    def on_decoder(self, kind: str, text: str) -> None:
        """Take what the decoder was told besides bytes."""

    def on_settled(self, settled: HandSettled) -> None:
        """Take it that the simulated hand has set the mark."""


@dataclass(frozen=True, slots=True)
class InstrumentSetup:
    """An instrument on serial ports.

    Attributes
    ----------
    profile
        Name or file of its profile.
    port
        The port's address; LINK=ADDRESS,LINK=ADDRESS where there are several cables.
    """

    profile: str
    port: str


@dataclass(frozen=True, slots=True)
class SimulationSetup:
    """A simulated plotter.

    Attributes
    ----------
    truth
        True ideal image coordinates [mm] by photo and point.
    seed, noise_um
        Of the simulated pointing.
    mistakes
        (left, right, point) -> offsets of the first pointings; of a fiducial, see
        `anaplot.plotter.simulator.fiducial_name`.
    time_scale
        Simulated seconds per second.
    tcp
        Serve a loopback TCP port instead of a pseudo-terminal.
    placements
        (photo, carriage) -> how the photograph lies there, plate to fiducial system; photographs
        that are not named lie in the fiducial system.
    profile
        Name or file of the profile that the simulated device speaks.
    """

    truth: Mapping[str, Mapping[str, tuple[float, float]]]
    seed: int = 0
    noise_um: float = 5.0
    mistakes: Mapping[tuple[str, str, str], Offsets] | None = None
    time_scale: float = 1.0
    tcp: bool = False
    placements: Placements = field(default_factory=dict)
    profile: str = PROFILE_OF_SIMULATION


class Plotting:
    """An opened link, with its simulated device when there is one.

    Parameters
    ----------
    setup
        What to connect.
    listener
        Who hears it.
    block
        Whose photographs are laid into a simulated device.

    Raises
    ------
    LinkError
        The port cannot be opened.
    InputError
        The profile is unknown or wrong.
    """

    def __init__(
        self, setup: InstrumentSetup | SimulationSetup, listener: Listener, block: Block
    ) -> None:
        self.simulator: SimulatedPlotter | None = None
        self._server: SimulatorServer | None = None
        self._settled: Callable[[HandSettled], None] = listener.on_settled
        self._hand = isinstance(setup, SimulationSetup)
        self._pedal = False
        self._pressed: str | None = None
        self._beside = Position(0.0, 0.0, 0.0, 0.0)
        self._ground: tuple[object, StereoGround] | None = None
        self._seen: tuple[object, StereoPair] | None = None
        if isinstance(setup, SimulationSetup):
            self.profile: Profile = load_profile(setup.profile)
            self._pressed = _pedal_of(self.profile)
            in_left, in_right = laid_photographs(block, setup.truth, setup.placements)
            self.simulator = SimulatedPlotter(
                self.profile,
                in_left,
                in_right=in_right,
                seed=setup.seed,
                noise_um=setup.noise_um,
                hand=Hand(),
                mistakes=setup.mistakes,
                on_settled=self._settled,
            )
            self._server = SimulatorServer(
                self.simulator, tcp=setup.tcp, time_scale=setup.time_scale
            ).start()
            addresses = dict(self._server.ports)
            self.port = ",".join(addresses.values())
        else:
            self.profile = load_profile(setup.profile)
            self.port = setup.port
            addresses = parse_ports(self.profile, [setup.port])
        self.link = Link(
            self.profile,
            addresses,
            on_reading=listener.on_reading,
            on_state=listener.on_link_state,
            on_traffic=listener.on_traffic,
            on_decoder=listener.on_decoder,
            # simulated hands move plates at once, and simulated time may run faster
            speed_limits=not self.simulated,
            room=listener.room,
        )

    @property
    def simulated(self) -> bool:
        """Whether the device is a simulated one."""
        return self.simulator is not None

    @property
    def drives(self) -> bool:
        """Whether the device drives its plates."""
        return self.profile.drive is not None

    @property
    def moves(self) -> bool:
        """Whether the plates go to a point by themselves: driven, or moved by a simulated hand."""
        return self.drives or self.simulated

    @property
    def presses(self) -> bool:
        """Whether a simulated hand presses a pedal of the device; else the key records."""
        return self._pressed is not None

    def open(self, *, referenced: bool = True) -> None:
        """Open the link; `referenced` says whether the counters' origin is known."""
        self.link.open(referenced=referenced)

    def lay(self, left: str, right: str, side: Side = "left", placed: Side | None = None) -> None:
        """Lay photographs into a simulated device; a real one is loaded by hand.

        A mono comparator gets the one of `side`, in the placement of `placed`.
        """
        if self.simulator is not None:
            self.simulator.lay(left, right, side, placed)

    def remember(self, pointed: Mapping[tuple[str, str, str], int]) -> None:
        """Tell a simulated hand how often it set the mark on points before this session."""
        if self.simulator is not None:
            self.simulator.remember(pointed)

    @property
    def drives_begun(self) -> int:
        """How many drives a simulated device has begun; 0 for a real one."""
        return 0 if self.simulator is None else self.simulator.drives

    @property
    def middle(self) -> Position:
        """The middle of the travel, plate coordinates [mm]: where photographs are centred."""
        drive = self.profile.drive
        travel = {name: (axis.low, axis.high) for name, axis in self.profile.axes.items()}
        travel.update({} if drive is None else drive.limits)
        middle = self.profile.stage.to_plate(
            tuple((low + high) / 2.0 for low, high in travel.values())
        )
        return Position(*(middle if len(middle) == 4 else (*middle, *middle)))

    def attend(self, side: Side | None) -> None:
        """Have the simulated hand point at fiducials of one plate, or at points in both (None)."""
        if self.simulator is not None:
            self.simulator.attend(side)

    def drive(self, position: Position) -> None:
        """Drive the plates, or have a simulated hand move those of an undriven device."""
        self._use_hand()
        if self.drives or self.simulator is None:
            self.link.drive(position)
        else:
            self.simulator.hand_to(self._true(position))

    def point_again(self, position: Position) -> None:
        """Have the simulated hand set the mark near a place, without recording."""
        if self.simulator is not None:
            self.simulator.hand_to(self._true(position), unnoticed=True)

    def referred(self) -> None:
        """Take it that the counters have their reference: the hand finds places by them again."""
        if self.simulator is not None:
            origin, shift = self.simulator.counted_from, self.link.shift
            self._beside = Position(
                origin.xl - shift.xl,
                origin.yl - shift.yl,
                origin.xr - shift.xr,
                origin.yr - shift.yr,
            )

    def _true(self, place: Position) -> Position:
        """Return where the hand goes for what the counters, last referred, call a place."""
        beside = self._beside
        return Position(
            place.xl + beside.xl, place.yl + beside.yl, place.xr + beside.xr, place.yr + beside.yr
        )

    def record(self) -> None:
        """Record where the plates stand; a simulated device that only speaks then is pressed."""
        speaks = self.profile.poll is not None or self.profile.simulate.stream is not None
        if self.simulator is not None and self._pressed is not None and not speaks:
            self.simulator.press(self._pressed)
        else:
            self.link.record()

    @property
    def hand(self) -> bool:
        """Whether a simulated hand sets the mark after a drive."""
        return self._hand or self._pedal

    def set_hand(self, on: bool) -> None:
        """Have the simulated hand set the mark from the next drive on, or leave it alone now."""
        self._hand = on and self.simulated
        if not on:
            self._use_hand()

    def set_pedal(self, automatic: bool) -> None:
        """Have the simulated hand press the pedal by itself, or not."""
        self._pedal = automatic and self.simulated
        self._use_hand()

    def _use_hand(self) -> None:
        if self.simulator is not None:
            pedal = self._pressed
            self.simulator.set_hand(
                Hand(
                    follow=self.hand,
                    auto_pedal=self._pedal and pedal is not None,
                    pedal=pedal if pedal is not None else "pedal",
                )
            )

    def stands(self) -> Position:
        """Return where a simulated device's plates truly stand.

        Raises
        ------
        InputError
            There is no simulated device.
        """
        if self.simulator is None:
            raise InputError("only a simulated plotter is worked from here")
        return self.simulator.positions()

    def turn(self, there: Position) -> None:
        """Turn a simulated device's handwheels until the plates stand at a position.

        Raises
        ------
        InputError
            There is no simulated device, or the position is beyond its travel.
        """
        here = self.stands()
        axes = self.profile.stage.to_axes((there.xl, there.yl, there.xr, there.yr))
        for value, axis in zip(axes, self.profile.axes.values(), strict=True):
            if not axis.low <= value <= axis.high:
                raise InputError(f"the plates stand at the end of their travel ({axis.name})")
        assert self.simulator is not None
        self.simulator.move(
            there.xl - here.xl, there.yl - here.yl, there.xr - here.xr, there.yr - here.yr
        )

    def stereo(self, columns: int, rows: int, field_mm: float) -> StereoPair | None:
        """Return what is seen around the mark; the same object while nothing changes.

        None without a simulated device, and while no photographs lie in it.
        """
        if self.simulator is None or self.profile.mono:
            return None
        laid = left, right = self.simulator.laid
        if not left:
            return None
        points = self.simulator.points_of(left), self.simulator.points_of(right, "right")
        if self._ground is None or self._ground[0] != (laid, points):
            self._ground = ((laid, points), StereoGround(left, right, *points))
            self._seen = None
        at = self.simulator.positions()
        asked = (at, columns, rows, field_mm)
        if self._seen is None or self._seen[0] != asked:
            self._seen = (asked, self._ground[1].look(at, columns, rows, field_mm))
        return self._seen[1]

    def close(self) -> None:
        """Close the link, and the simulated device behind it."""
        try:
            self.link.close()
        finally:
            if self._server is not None:
                self._server.close()


def _pedal_of(profile: Profile) -> str | None:
    """Return the footswitch that a simulated device tells by itself, or None: keys are the host's.

    A modem line is the host's, too.
    """
    told = (name for name, s in profile.footswitches.items() if s.source in ("record", "every"))
    return next(told, None)
