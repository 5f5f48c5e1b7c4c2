"""The instrument that a station works with: a real one on its line, or whatever plays one."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from anaplot.aliases import Side
from anaplot.photogrammetry.block import Block
from anaplot.plotter.link import Link
from anaplot.plotter.ports import parse_ports
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position
from anaplot.plotter.schema import Profile
from anaplot.session.heard import Abilities, Seen
from anaplot.session.pointedat import Targets
from anaplot.session.requests import (
    DriveTo,
    Lay,
    OfInstrument,
    Refer,
    SetMark,
    StopDrive,
    TakeRecord,
)
from anaplot.station.inbox import Inbox

__all__ = ["Instrument", "InstrumentSetup", "Setup"]

_STALE = 2.0  # s after which a read-out is no longer shown


class Instrument:
    """An instrument as a station knows it.

    What is said here is true of a real one: it is loaded and, where it has no drive, moved by a
    person, who sets the mark, too. An instrument of another kind says otherwise.

    Parameters
    ----------
    profile
        The instrument.
    addresses
        The port of each of the profile's links.
    port
        The same in one word, for people.
    listener
        Who hears it.
    speed_limits
        Whether counters that move faster than an axis' `fastest` have lost their reference.

    Raises
    ------
    InputError
        Addresses that do not fit the profile.
    """

    simulated = False
    """Whether it is a simulated one, as the journal and the screen say."""

    def __init__(
        self,
        profile: Profile,
        addresses: Mapping[str, str],
        port: str,
        listener: Inbox,
        *,
        speed_limits: bool = True,
    ) -> None:
        self.profile = profile
        self.port = port
        self.link = Link(
            profile,
            addresses,
            on_reading=listener.on_reading,
            on_state=listener.on_link_state,
            on_traffic=listener.on_traffic,
            on_decoder=listener.on_decoder,
            speed_limits=speed_limits,
            room=listener.room,
        )

    @property
    def drives(self) -> bool:
        """Whether it drives its plates."""
        return self.profile.drive is not None

    @property
    def moves(self) -> bool:
        """Whether the plates go to a point without the person at the instrument."""
        return self.drives

    @property
    def own_operator(self) -> str:
        """Who sets the mark by himself after a drive; "" where the person at it does."""
        return ""

    @property
    def drives_begun(self) -> int:
        """How many drives were begun after which the instrument's own operator sets the mark."""
        return 0

    @property
    def unchecked_parity(self) -> tuple[str, ...]:
        """Links whose profile has a parity that their ports do not check."""
        return self.link.unchecked_parity

    @property
    def middle(self) -> Position:
        """The middle of the travel, plate coordinates [mm]: where photographs are centred."""
        drive = self.profile.drive
        travel = {name: (axis.low, axis.high) for name, axis in self.profile.axes.items()}
        travel.update({} if drive is None else drive.limits)
        stage = self.profile.stage
        middle = tuple((low + high) / 2.0 for low, high in travel.values())
        return stage.position(stage.to_plate(middle))

    def open(self, *, referenced: bool = True, shift: Position | None = None) -> None:
        """Open the link; see `anaplot.plotter.link.Link.open`."""
        self.link.open(referenced=referenced, shift=shift)

    def recall(self, pointed: Targets) -> None:
        """Take it that things were pointed at so often in the sessions before."""

    def lay(self, left: str, right: str, side: Side = "left", placed: Side | None = None) -> None:
        """Take it that photographs lie in the carriages.

        Parameters
        ----------
        left, right
            Those of the model.
        side
            Which of them lies in a mono comparator.
        placed
            In which of its two placements it lies there; by default that of its side.
        """

    def drive(self, position: Position, side: Side | None = None) -> None:
        """Drive the plates.

        Parameters
        ----------
        position
            Where to, plate coordinates [mm].
        side
            Of the plate in which a fiducial is to be measured; None: a point, in both.

        Raises
        ------
        InputError
            There is no drive, or the target is outside its limits.
        LinkError
            The command cannot be sent.
        """
        self.link.drive(position)

    def point_again(
        self, places: Mapping[Side, tuple[float, float]], side: Side | None = None
    ) -> None:
        """Set the mark on something measured, to find the counters' reference again.

        Parameters
        ----------
        places
            Where it lies, plate coordinates [mm].
        side
            As in `drive`.
        """

    def referred(self) -> None:
        """Take it that the counters have their reference."""

    def record(self) -> None:
        """Record where the plates stand.

        Raises
        ------
        LinkError
            The link is down.
        """
        self.link.record()

    @property
    def abilities(self) -> Abilities:
        """What a desk has to know of it."""
        profile = self.profile
        return Abilities(
            mono=profile.mono,
            drives=self.drives,
            moves=self.moves,
            middle=self.middle,
            still=profile.still,
            reads=profile.reads,
        )

    def position(self) -> Position | None:
        """Return the live read-out, plate coordinates [mm]; None while there is none."""
        latest = self.link.latest()
        return None if latest is None or latest[1] > _STALE else latest[0]

    def seen(self, since: tuple[int, int]) -> Seen:
        """Return what is seen of it now, the counters read since a mark of the link, or not."""
        # first: a read-out that comes meanwhile makes the counters newer than they are said to be
        read = self.link.read_since(since)
        return Seen(
            time=time.monotonic(),
            own_operator=self.own_operator,
            line=self.link.state,
            position=self.position(),
            counters=self.link.unreferenced_position,
            shift=self.link.shift,
            read=read,
        )

    def do(self, request: OfInstrument) -> None:
        """Do what a desk asks for.

        Raises
        ------
        InputError
            There is no drive, or the target is outside its limits.
        LinkError
            The command cannot be sent.
        """
        match request:
            case DriveTo(position, side):
                self.drive(position, side)
            case SetMark(places, side):
                self.point_again(places, side)
            case StopDrive():
                self.link.stop()
            case TakeRecord():
                self.record()
            case Lay(left, right, side, placed):
                self.lay(left, right, side, placed)
            case Refer(shift):
                if shift is None:
                    self.link.confirm_reference()
                else:
                    self.link.reference_by(shift)
                self.referred()

    def close(self) -> None:
        """Close the link.

        Raises
        ------
        LinkError
            A driver does not let go of its port.
        """
        self.link.close()


class Setup(Protocol):
    """What an instrument is to be, before a station connects it."""

    def connect(self, listener: Inbox, block: Block) -> Instrument:
        """Return the instrument, not opened yet.

        Parameters
        ----------
        listener
            Who hears it.
        block
            Whose photographs are measured.

        Raises
        ------
        InputError
            The profile is unknown or wrong, or the ports do not fit it.
        LinkError
            The instrument cannot be reached.
        """


@dataclass(frozen=True, slots=True)
class InstrumentSetup:
    """A real instrument on serial ports.

    Attributes
    ----------
    profile
        Name or file of its profile.
    port
        The port's address; LINK=ADDRESS,LINK=ADDRESS where there are several cables.
    """

    profile: str
    port: str

    def connect(self, listener: Inbox, block: Block) -> Instrument:
        """Return the instrument, not opened yet; see `Setup.connect`."""
        profile = load_profile(self.profile)
        return Instrument(profile, parse_ports(profile, [self.port]), self.port, listener)
