"""What a station and a replay have in common: they are looked at, and given commands."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, Self

from anaplot.aliases import Axis
from anaplot.photogrammetry.block import Block
from anaplot.session import commands
from anaplot.session.changes import Change
from anaplot.session.commands import Command
from anaplot.session.events import Reason
from anaplot.session.state import SessionState
from anaplot.station.audience import Audience
from anaplot.station.sessionlog import SessionLog
from anaplot.station.snapshot import Snapshot

if TYPE_CHECKING:
    from anaplot.orientation.stripfit import Degree
    from anaplot.station.pointing import Pointing
    from anaplot.station.stripcontrol import StripOnControl

__all__ = ["Commanded"]


class Commanded(ABC):
    """Something that is looked at, asked, and given commands by methods of their names.

    Parameters
    ----------
    session
        The block folder, or the recorded session.
    """

    def __init__(self, session: Path) -> None:
        self._audience = Audience()
        self._session = session
        self._log = SessionLog(session)

    @property
    @abstractmethod
    def block(self) -> Block:
        """The block as it was declared."""

    @property
    @abstractmethod
    def state(self) -> SessionState:
        """The session's state."""

    def log(self) -> tuple[Change, ...]:
        """Return who changed what, the oldest first, as the journal tells it.

        Raises
        ------
        InputError
            It cannot be read.
        """
        return self._log.read()

    def strips_on_control(
        self, degree: Degree, without: Collection[str]
    ) -> tuple[StripOnControl, ...]:
        """Return the strips fitted to the control measured so far; nothing waits for it."""
        from anaplot.station.stripcontrol import strips_on_control  # loaded with its page

        return strips_on_control(self.block, self.state, degree, without)

    @abstractmethod
    def close(self) -> None:
        """End; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def subscribe(self, callback: Callable[[Snapshot], None]) -> Callable[[], None]:
        """Call back with every new snapshot, from any thread; returns what ends it."""
        return self._audience.subscribe(callback)

    def subscribe_notices(self, callback: Callable[[str, str], None]) -> Callable[[], None]:
        """Call back with (severity, line), from any thread; returns what ends it."""
        return self._audience.subscribe_notices(callback)

    def pointing(self) -> Pointing:
        """Return what it says of the precision of pointing, from its files and journal."""
        from anaplot.station.pointing import read_pointing  # loaded with its page

        return read_pointing(self._session)

    @abstractmethod
    def give(self, command: Command) -> None:
        """Give a command.

        Raises
        ------
        InputError
            It cannot be carried out now; says why.
        NotComputableError
            What is to be accepted is not determined.
        LinkError
            The plotter cannot be reached.
        """

    def drive(self, point: str) -> None:
        """Drive the plates to a point; see `anaplot.session.commands.Drive`."""
        self.give(commands.Drive(point))

    def stop(self) -> None:
        """Stop a drive."""
        self.give(commands.Stop())

    def record(self) -> None:
        """Record the point at which the plates stand."""
        self.give(commands.RecordPoint())

    def point_again(self, point: str | None = None, times: int = 5) -> None:
        """Point again at something measured; see `anaplot.session.commands.PointAgain`."""
        self.give(commands.PointAgain(point, times))

    def switch(self, point: str, axis: Axis | None, on: bool) -> None:
        """Switch a row, or the whole point (axis None), off or on."""
        self.give(commands.Switch(point, axis, on))

    def undo(self) -> None:
        """Take the last event back."""
        self.give(commands.Undo())

    def give_reason(self, reason: Reason) -> None:
        """Say why the latest change of a measurement was made."""
        self.give(commands.GiveReason(reason))

    def accept(self) -> None:
        """Accept the inner orientation in work, else the model."""
        self.give(commands.Accept())

    def next_model(self) -> None:
        """Go on to the next model, or to the next photo of a mono comparator."""
        self.give(commands.NextModel())

    def return_to(self, left: str, right: str, point: str = "", photo: str = "") -> None:
        """Return to an accepted model; see `anaplot.session.commands.ReturnTo`."""
        self.give(commands.ReturnTo(left, right, point, photo))

    def other_photo(self) -> None:
        """Take it that the other photo of the model was laid into the mono comparator."""
        self.give(commands.OtherPhoto())

    def reference(self, point: str | None = None) -> None:
        """Refer counters without reference to a measured point, or to the one proposed."""
        self.give(commands.Reference(point))

    def keep_counters(self) -> None:
        """Take counters without reference as they are."""
        self.give(commands.KeepCounters())

    def add_point(self, name: str) -> None:
        """Add a point beyond the plan, where the plates stand now."""
        self.give(commands.AddPoint(name))

    def suspend(self) -> None:
        """Interrupt the work."""
        self.give(commands.Suspend())

    def resume(self) -> None:
        """Go on with it."""
        self.give(commands.Resume())
