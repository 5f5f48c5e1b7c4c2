"""The plotter that a station works with: a link, and a simulated device when one is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from anaplot.plotter.commands import parse_ports
from anaplot.plotter.link import Link
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position, Reading
from anaplot.plotter.schema import Profile
from anaplot.plotter.server import SimulatorServer
from anaplot.plotter.simulator import Hand, HandSettled, Offsets, SimulatedPlotter

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
        True image coordinates [mm] by photo and point.
    seed, noise_um
        Of the simulated pointing.
    mistakes
        (left, right, point) -> offsets of the first pointings.
    time_scale
        Simulated seconds per second.
    tcp
        Serve a loopback TCP port instead of a pseudo-terminal.
    """

    truth: Mapping[str, Mapping[str, tuple[float, float]]]
    seed: int = 0
    noise_um: float = 5.0
    mistakes: Mapping[tuple[str, str, str], Offsets] | None = None
    time_scale: float = 1.0
    tcp: bool = False


class Plotting:
    """An opened link, with its simulated device when there is one.

    Raises
    ------
    LinkError
        The port cannot be opened.
    InputError
        The profile is unknown or wrong.
    """

    def __init__(self, setup: InstrumentSetup | SimulationSetup, listener: Listener) -> None:
        self.simulator: SimulatedPlotter | None = None
        self._server: SimulatorServer | None = None
        self._settled: Callable[[HandSettled], None] = listener.on_settled
        if isinstance(setup, SimulationSetup):
            self.profile: Profile = load_profile(PROFILE_OF_SIMULATION)
            self.simulator = SimulatedPlotter(
                self.profile,
                setup.truth,
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

    def drive(self, position: Position) -> None:
        """Drive the plates."""
        self.link.drive(position)

    def set_pedal(self, automatic: bool) -> None:
        """Have the simulated hand press the pedal by itself, or not."""
        if self.simulator is not None:
            self.simulator.set_hand(Hand(auto_pedal=automatic))

    def close(self) -> None:
        """Close the link, and the simulated device behind it."""
        try:
            self.link.close()
        finally:
            if self._server is not None:
                self._server.close()
