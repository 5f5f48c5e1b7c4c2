"""The host's side of an instrument: its ports, their common state, commands and references."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Mapping

from anaplot.errors import InputError, LinkError
from anaplot.plotter.conversation import Conversation, DecoderEvent, Traffic
from anaplot.plotter.line import TICK, LinkState, PortLine
from anaplot.plotter.ports import addresses_of
from anaplot.plotter.readings import KEY, Position, Reading
from anaplot.plotter.schema import Profile
from anaplot.plotter.serialport import SerialPort
from anaplot.textfiles.wording import plain

__all__ = ["DecoderEvent", "Link", "LinkState", "Traffic"]

_CROWDED = 0.01
_BACK_OFF = (0.25, 0.5, 1.0, 2.0, 4.0)
_JOIN = 10.0
# worst first: several ports are as good as the worst of them
_ORDER: tuple[LinkState, ...] = ("lost", "reconnecting", "silent", "opening", "live")


class Link:
    """An instrument on one or several ports.

    Parameters
    ----------
    profile
        The instrument.
    ports
        Address of each link of the profile; one address serves a profile with one link.
    on_reading
        Called with each reading, in order, from a reader thread.
    on_state
        Called with each new state and a line of detail.
    on_traffic
        Called with direction, link and bytes before they are decoded or sent.
    on_decoder
        Called with what else the decoder was told: a press and its switch, a link that was
        reopened, a reference and its coordinates. Traffic and these are all that a replay needs.
    clock
        Seconds that never go back.
    back_off
        Waits [s] before the attempts to reopen a lost port; the last one repeats.
    speed_limits
        Whether counters that move faster than an axis' `fastest` have lost their reference.
    room
        Asked before each reading of a port, from its thread and without any lock held: while it
        says no, nothing is read, and what the device sends waits in the line.

    Notes
    -----
    Callbacks of readings are serialised over all ports. A callback may drive, stop, ask and
    close; it must not wait for a thread that waits for `close`.
    """

    def __init__(
        self,
        profile: Profile,
        ports: Mapping[str, str] | str,
        *,
        on_reading: Callable[[Reading], None],
        on_state: Callable[[LinkState, str], None] | None = None,
        on_traffic: Traffic | None = None,
        on_decoder: DecoderEvent | None = None,
        clock: Callable[[], float] = time.monotonic,
        back_off: tuple[float, ...] = _BACK_OFF,
        speed_limits: bool = True,
        room: Callable[[], bool] | None = None,
    ) -> None:
        self._profile = profile
        self._addresses = addresses_of(profile, ports)
        self._on_state = on_state
        self._back_off = back_off
        self._room = room
        self._lock = threading.RLock()
        self._conversation = Conversation(
            profile,
            self._lock,
            on_reading=on_reading,
            on_traffic=on_traffic,
            on_decoder=on_decoder,
            clock=clock,
            speed_limits=speed_limits,
        )
        self._stop = threading.Event()
        self._lines: dict[str, PortLine] = {}
        self._state: LinkState = "closed"
        self._detail = ""

    # -- life -----------------------------------------------------------------------------

    def open(self, *, referenced: bool = True, shift: Position | None = None) -> None:
        """Open every port and start reading.

        Parameters
        ----------
        referenced
            Whether the counters' origin is known. When it is not, positions of incremental
            counters are refused until a reference was measured.
        shift
            By how much the counters are moved from the beginning [mm], as they were before.

        Raises
        ------
        LinkError
            When a port cannot be opened; nothing stays open then.
        InputError
            When the link is open already.
        """
        with self._lock:
            if self._lines:
                raise InputError("the link is open already")
            self._stop = threading.Event()
            self._conversation.begin(referenced=referenced, shift=shift)
        self._announce("opening", "")
        lines: dict[str, PortLine] = {}
        try:
            for name, address in self._addresses.items():
                port = SerialPort(address, self._profile.links[name])
                lines[name] = PortLine(self, self._conversation, self._profile, name, address, port)
        except LinkError as error:
            for line in lines.values():
                line.port.close()
            self._announce("closed", str(error))
            raise
        now = self._conversation.now()
        with self._lock:
            self._lines = lines
            for line in lines.values():
                line.opened(now)
        for line in lines.values():
            line.thread.start()
        self._refresh()

    def close(self) -> None:
        """Stop reading and give every port back; may be called more than once.

        Raises
        ------
        LinkError
            When a driver does not let go of its port.
        """
        with self._lock:
            lines = list(self._lines.values())
        self._stop.set()
        for line in lines:
            line.port.wake()
        current = threading.current_thread()
        stuck = ""
        for line in lines:
            if line.thread is not current:
                line.thread.join(_JOIN)
            if line.thread.is_alive() and line.thread is not current:
                stuck = line.address
            line.port.close()
        with self._lock:
            self._lines = {}
        self._announce("closed", "")
        if stuck:
            raise LinkError(f"port {plain(stuck, 120)}: the driver does not let go of it")

    def __enter__(self) -> Link:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- what is known ---------------------------------------------------------------------

    @property
    def profile(self) -> Profile:
        """The instrument's profile."""
        return self._profile

    @property
    def state(self) -> LinkState:
        """The state of the worst port."""
        return self._state

    @property
    def detail(self) -> str:
        """Why the state is what it is, one line, "" when there is nothing to say."""
        return self._detail

    @property
    def event_time(self) -> float:
        """The time [s] that the decoder is given with what is being told to a callback.

        A journal that keeps it replays to the same readings.
        """
        return self._conversation.event_time

    @property
    def identities(self) -> dict[str, str]:
        """``VID:PID:serial`` of each port, where it has one."""
        with self._lock:
            return {name: line.identity for name, line in self._lines.items()}

    @property
    def unchecked_parity(self) -> tuple[str, ...]:
        """Links whose profile has a parity that their ports do not check."""
        with self._lock:
            return tuple(n for n, line in self._lines.items() if not line.port.checks_parity)

    def latest(self) -> tuple[Position, float] | None:
        """Return the latest valid position and its age [s], or None before the first."""
        return self._conversation.latest()

    # -- commands --------------------------------------------------------------------------

    def drive(self, position: Position) -> None:
        """Drive the plates.

        Parameters
        ----------
        position
            Target, plate coordinates [mm].

        Raises
        ------
        InputError
            When there is no drive or the target is outside its limits.
        LinkError
            When the command cannot be sent.
        """
        with self._lock:
            command = self._conversation.decoder.drive_command(position)
        self._send_drive(command)

    def stop(self) -> None:
        """Stop a drive.

        Raises
        ------
        InputError
            When there is no drive.
        LinkError
            When the command cannot be sent.
        """
        self._send_drive(self._conversation.decoder.stop_command())

    def record(self, switch: str = KEY) -> None:
        """Record the next position, as if a footswitch had been pressed now.

        Parameters
        ----------
        switch
            The name the record will carry.

        Raises
        ------
        LinkError
            When the link is down.
        """
        self._usable(self._profile.default_link)
        self._conversation.pressed(switch)
        with self._lock:
            polled = self._conversation.polled
            # a request still owed an answer is followed by this one at once
            lines = self._begin_cycle() if polled and self._conversation.wait() <= 0.0 else []
        self._ask(lines)

    # -- references ------------------------------------------------------------------------

    @property
    def referenced(self) -> bool:
        """Whether the counters' origin is known."""
        return self._conversation.decoder.referenced

    @property
    def unreferenced_position(self) -> Position | None:
        """Where the carriages stand as the device counts [mm]."""
        return self._conversation.decoder.unreferenced_position

    @property
    def mark(self) -> tuple[int, int]:
        """What was asked and heard until now, for `read_since`."""
        with self._lock:
            return self._conversation.decoder.mark

    def read_since(self, mark: tuple[int, int]) -> bool:
        """Say whether `unreferenced_position` was measured after a `mark` was taken."""
        with self._lock:
            return self._conversation.decoder.read_since(mark)

    @property
    def shift(self) -> Position:
        """By how much the counters are moved [mm]."""
        return self._conversation.decoder.shift

    def reference_by(self, shift: Position) -> None:
        """Tell by how much the counters are to be moved from now on [mm].

        Raises
        ------
        InputError
            When nothing was heard yet.
        """
        self._conversation.moved_by(shift)

    def confirm_reference(self) -> None:
        """Take the counters as they are: they kept their origin."""
        self._conversation.confirmed()

    # -- inside ----------------------------------------------------------------------------

    def _send_drive(self, command: bytes) -> None:
        drive = self._profile.drive
        name = drive.link if drive is not None else self._profile.default_link
        self._usable(name).send(command)

    def _usable(self, name: str) -> PortLine:
        line = self._lines.get(name)
        if line is None:
            raise LinkError(f"the link to {self._profile.id} is closed")
        if not line.usable:
            raise LinkError(f"the link to {self._profile.id} is lost: {line.detail}")
        return line

    def _begin_cycle(self) -> list[PortLine]:
        """Begin a cycle; return the ports on which the request is to be written.

        The writing itself, which may wait, is left to the caller and outside of the lock.
        """
        polled = self._profile.poll.links if self._profile.poll is not None else ()
        lines = [self._lines[name] for name in polled if name in self._lines]
        usable = [line for line in lines if line.usable]
        self._conversation.ask([line.name for line in usable])
        return usable

    def _ask(self, lines: Iterable[PortLine]) -> None:
        if self._profile.poll is not None:
            for line in lines:
                line.port.write(self._profile.poll.request)

    # -- for the lines -----------------------------------------------------------------------

    def poll_if_due(self) -> float:
        """Send the next request when its time has come.

        Returns
        -------
        float
            Seconds until the next one may be due.
        """
        with self._lock:
            if not self._conversation.polled:
                return TICK
            wait = self._conversation.wait()
            if wait > 0.0:
                return min(wait, TICK)
            lines = self._begin_cycle()
            wait = self._conversation.wait()
        for line in lines:
            # a port that does not take the request gives no answer: its reader says so
            with contextlib.suppress(LinkError):
                self._ask([line])
        return min(wait, TICK)

    def wait_for_room(self) -> None:
        """Wait until whoever listens has room for more, or the link is closed."""
        while self._room is not None and not self._room() and not self._stop.is_set():
            self._stop.wait(_CROWDED)

    def _refresh(self) -> None:
        """Tell the state of the worst port when it has changed."""
        with self._lock:
            lines = list(self._lines.values())
            if not lines or self._stop.is_set():
                return
            worst = min(lines, key=lambda line: _ORDER.index(line.state))
            self._announce(worst.state, worst.detail)

    def _announce(self, state: LinkState, detail: str) -> None:
        with self._lock:
            if (state, detail) == (self._state, self._detail):
                return
            self._state = state
            self._detail = detail
            if self._on_state is not None:
                self._on_state(state, detail)

    @property
    def stopping(self) -> threading.Event:
        """Set when the reader threads are to end."""
        return self._stop

    @property
    def back_off(self) -> tuple[float, ...]:
        """Waits before the attempts to reopen [s]."""
        return self._back_off

    def change(self, line: PortLine, state: LinkState, detail: str = "") -> None:
        """Set a port's state and tell."""
        with self._lock:
            if (line.state, line.detail) == (state, detail):
                return
            line.state = state
            line.detail = detail
        self._refresh()
