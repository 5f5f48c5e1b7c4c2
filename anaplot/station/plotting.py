"""The plotter that a station works with: a link, and a simulated device when one is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.plotter.commands import parse_ports
from anaplot.plotter.link import Link
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position, Reading
from anaplot.plotter.schema import Profile
from anaplot.plotter.server import SimulatorServer
from anaplot.plotter.simulator import Hand, HandSettled, Offsets, Side, SimulatedPlotter
from anaplot.station.laidplates import Placements, laid_photographs
from anaplot.station.stereo import StereoGround, StereoPair

__all__ = ["InstrumentSetup", "Plotting", "SimulationSetup"]

PROFILE_OF_SIMULATION = "simulated"


class Listener(Protocol):
    """What a station hears; every call may come from any thread and must return at once."""

    def on_reading(self, reading: Reading) -> None:
        """Take a decoded reading."""

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
    """

    truth: Mapping[str, Mapping[str, tuple[float, float]]]
    seed: int = 0
    noise_um: float = 5.0
    mistakes: Mapping[tuple[str, str, str], Offsets] | None = None
    time_scale: float = 1.0
    tcp: bool = False
    placements: Placements = field(default_factory=dict)


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
        self._ground: tuple[object, StereoGround] | None = None
        self._seen: tuple[object, StereoPair] | None = None
        if isinstance(setup, SimulationSetup):
            self.profile: Profile = load_profile(PROFILE_OF_SIMULATION)
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
            self.port = self._server.port
            addresses = {self.profile.default_link: self.port}
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
        )

    @property
    def simulated(self) -> bool:
        """Whether the device is a simulated one."""
        return self.simulator is not None

    @property
    def drives(self) -> bool:
        """Whether the device drives its plates."""
        return self.profile.drive is not None

    def open(self) -> None:
        """Open the link."""
        self.link.open()

    def lay(self, left: str, right: str) -> None:
        """Lay photographs into a simulated device; a real one is loaded by hand."""
        if self.simulator is not None:
            self.simulator.lay(left, right)

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
        """Drive the plates."""
        self._use_hand()
        self.link.drive(position)

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
            self.simulator.set_hand(Hand(follow=self.hand, auto_pedal=self._pedal))

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
        if self.simulator is None:
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
