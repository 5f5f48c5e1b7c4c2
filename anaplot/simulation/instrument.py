"""The simulated instrument: a simulated device behind a real line, with a hand at its wheels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from anaplot.aliases import Side
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.plotter.device.hand import Hand, HandSettled, Offsets, fiducial_name, monocular_name
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position
from anaplot.plotter.schema import Profile
from anaplot.session.heard import MarkSet
from anaplot.session.pointedat import Target, Targets
from anaplot.simulation.laidplates import Placements, laid_photographs
from anaplot.simulation.stereo import StereoGround, StereoPair
from anaplot.station.inbox import Inbox
from anaplot.station.instrument import Instrument

__all__ = ["PROFILE_OF_SIMULATION", "SimulatedInstrument", "SimulationSetup", "name_of"]

PROFILE_OF_SIMULATION = "simulated"
_OPERATOR = "the simulated operator"


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
        `anaplot.plotter.device.hand.fiducial_name`.
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

    def connect(self, listener: Inbox, block: Block) -> SimulatedInstrument:
        """Start the device and return the instrument; see `anaplot.station.instrument.Setup`."""
        return SimulatedInstrument(self, listener, block)


class SimulatedInstrument(Instrument):
    """A simulated device, the line to it, and the hand at its wheels.

    Parameters
    ----------
    setup
        What is simulated.
    listener
        Who hears it.
    block
        Whose photographs are laid into it.

    Raises
    ------
    InputError
        The profile is unknown or wrong, or the photographs cannot be simulated.
    LinkError
        The line cannot be made.
    """

    simulated = True

    def __init__(self, setup: SimulationSetup, listener: Inbox, block: Block) -> None:
        profile = load_profile(setup.profile)
        self._listener = listener
        self._follows = True
        self._presses_itself = False
        self._pedal = _pedal_of(profile)
        self._beside = Position(0.0, 0.0, 0.0, 0.0)
        self._ground: tuple[object, StereoGround] | None = None
        self._seen: tuple[object, StereoPair] | None = None
        in_left, in_right = laid_photographs(block, setup.truth, setup.placements)
        self.simulator = SimulatedPlotter(
            profile,
            in_left,
            in_right=in_right,
            seed=setup.seed,
            noise_um=setup.noise_um,
            hand=Hand(),
            mistakes=setup.mistakes,
            on_settled=self._settled,
        )
        self.server = SimulatorServer(
            self.simulator, tcp=setup.tcp, time_scale=setup.time_scale
        ).start()
        addresses = dict(self.server.ports)
        # the hand moves plates at once, and simulated time may run faster: no limits of speed
        super().__init__(
            profile, addresses, ",".join(addresses.values()), listener, speed_limits=False
        )

    # -- as a station knows it -----------------------------------------------------------------

    @property
    def moves(self) -> bool:
        """True: what has no drive is moved by the hand."""
        return True

    @property
    def own_operator(self) -> str:
        """The simulated operator, while his hand sets the mark after a drive."""
        return _OPERATOR if self.hand else ""

    @property
    def drives_begun(self) -> int:
        """How many drives were begun, by the device or by the hand."""
        return self.simulator.drives

    @property
    def unchecked_parity(self) -> tuple[str, ...]:
        """None: a simulated line has no parity."""
        return ()

    def recall(self, pointed: Targets) -> None:
        """Tell the hand how often it set the mark on what, so that its noise goes on as it was."""
        counts = {(t.left, t.right, name_of(t)): count for t, count in pointed.items()}
        self.simulator.remember(counts)

    def lay(self, left: str, right: str, side: Side = "left", placed: Side | None = None) -> None:
        """Lay photographs into the carriages; see `Instrument.lay`."""
        self.simulator.lay(left, right, side, placed)

    def drive(self, position: Position, side: Side | None = None) -> None:
        """Drive the plates, or have the hand move those of an undriven device."""
        self.simulator.attend(side)
        self._use_hand()
        if self.drives:
            self.link.drive(position)
        else:
            self.simulator.hand_to(self._true(position))

    def point_again(
        self, places: Mapping[Side, tuple[float, float]], side: Side | None = None
    ) -> None:
        """Have the hand set the mark near a place, without recording."""
        here = self.simulator.positions()
        left = places.get("left", (here.xl, here.yl))
        right = places.get("right", (here.xr, here.yr))
        if self.profile.mono:
            left = right = next(iter(places.values()))
        self.simulator.attend(side)
        self.simulator.hand_to(self._true(Position(*left, *right)), unnoticed=True)

    def referred(self) -> None:
        """Take it that the counters have their reference: the hand finds places by them again."""
        origin, shift = self.simulator.counted_from, self.link.shift
        self._beside = Position(
            origin.xl - shift.xl, origin.yl - shift.yl, origin.xr - shift.xr, origin.yr - shift.yr
        )

    def _true(self, place: Position) -> Position:
        """Return where the hand goes for what the counters, last referred, call a place."""
        beside = self._beside
        return Position(
            place.xl + beside.xl, place.yl + beside.yl, place.xr + beside.xr, place.yr + beside.yr
        )

    def record(self) -> None:
        """Record where the plates stand; a device that only speaks then is pressed."""
        speaks = self.profile.poll is not None or self.profile.simulate.stream is not None
        if self._pedal is not None and not speaks:
            self.simulator.press(self._pedal)
        else:
            self.link.record()

    def close(self) -> None:
        """Close the link, and the device behind it."""
        try:
            super().close()
        finally:
            self.server.close()

    # -- the hand ------------------------------------------------------------------------------

    @property
    def presses(self) -> bool:
        """Whether the hand presses a pedal of the device; else the key records."""
        return self._pedal is not None

    @property
    def hand(self) -> bool:
        """Whether the hand sets the mark after a drive."""
        return self._follows or self._presses_itself

    def set_hand(self, on: bool) -> None:
        """Have the hand set the mark from the next drive on, or leave it alone now."""
        self._follows = on
        if not on:
            self._use_hand()

    def set_pedal(self, automatic: bool) -> None:
        """Have the hand press the pedal by itself, or not."""
        self._presses_itself = automatic
        self._use_hand()

    def _use_hand(self) -> None:
        self.simulator.set_hand(
            Hand(
                follow=self.hand,
                auto_pedal=self._presses_itself and self._pedal is not None,
                pedal=self._pedal if self._pedal is not None else "pedal",
            )
        )

    def _settled(self, settled: HandSettled) -> None:
        remark = f"{_OPERATOR} finds no point here" if settled.point is None else ""
        self._listener.on_mark_set(MarkSet(settled.drive, remark))

    # -- at the wheels and in the eyepieces ----------------------------------------------------

    def turn(self, there: Position) -> None:
        """Turn the handwheels until the plates stand at a position.

        Raises
        ------
        InputError
            The position is beyond the travel.
        """
        here = self.simulator.positions()
        axes = self.profile.stage.to_axes(self.profile.stage.plates(there))
        for value, axis in zip(axes, self.profile.axes.values(), strict=True):
            if not axis.low <= value <= axis.high:
                raise InputError(f"the plates stand at the end of their travel ({axis.name})")
        self.simulator.move(
            there.xl - here.xl, there.yl - here.yl, there.xr - here.xr, there.yr - here.yr
        )

    def stereo(self, columns: int, rows: int, field_mm: float) -> StereoPair | None:
        """Return what is seen around the mark; the same object while nothing changes.

        None in a mono comparator, and while no photographs lie in it.
        """
        if self.profile.mono:
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


def name_of(target: Target) -> str:
    """Return the name under which pointings at a target are counted."""
    if target.side is None:
        return target.name
    name = fiducial_name if target.fiducial else monocular_name
    return name(target.side, target.name)


def _pedal_of(profile: Profile) -> str | None:
    """Return the footswitch that a device tells by itself, or None: keys are the host's.

    A modem line is the host's, too.
    """
    told = (name for name, s in profile.footswitches.items() if s.source in ("record", "every"))
    return next(told, None)
