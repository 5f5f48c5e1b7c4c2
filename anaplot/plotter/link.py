"""The host's side of the line: one reader thread per port, states, and reconnection."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from typing import Literal

from anaplot.errors import InputError, LinkError
from anaplot.plotter.decoder import Decoder
from anaplot.plotter.readings import InPosition, Position, Reading, Record
from anaplot.plotter.refusalcount import RefusalCount
from anaplot.plotter.schema import Footswitch, Profile
from anaplot.plotter.serialport import SerialPort, find_port, identity_of
from anaplot.textfiles.wording import plain

__all__ = ["DecoderEvent", "Link", "LinkState", "Traffic"]

LinkState = Literal["closed", "opening", "live", "silent", "lost", "reconnecting"]
Traffic = Callable[[Literal["in", "out"], str, bytes], None]
DecoderEvent = Callable[[Literal["press", "reopen", "reference", "confirm"], str], None]

_TICK = 0.1
_CROWDED = 0.01
_MODEM_TICK = 0.01
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
        self._addresses = _addresses(profile, ports)
        self._on_reading = on_reading
        self._on_state = on_state
        self._on_traffic = on_traffic
        self._on_decoder = on_decoder
        self._clock = clock
        self._back_off = back_off
        self._speed_limits = speed_limits
        self._room = room
        self._refusals = RefusalCount()
        self._decoder = Decoder(profile, speed_limits=speed_limits)
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self._lines: dict[str, _Line] = {}
        self._state: LinkState = "closed"
        self._detail = ""
        self._latest: tuple[Position, float] | None = None
        self._event_time = 0.0

    # -- life -----------------------------------------------------------------------------

    def open(self, *, referenced: bool = True) -> None:
        """Open every port and start reading.

        Parameters
        ----------
        referenced
            Whether the counters' origin is known. When it is not, positions of incremental
            counters are refused until a reference was measured.

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
            self._decoder = Decoder(self._profile, speed_limits=self._speed_limits)
            self._latest = None
            if not referenced:
                self._note("reopen", "")
                self._decoder.reopen()
        self._announce("opening", "")
        lines: dict[str, _Line] = {}
        try:
            for name, address in self._addresses.items():
                port = SerialPort(address, self._profile.links[name])
                lines[name] = _Line(self, name, address, port)
        except LinkError as error:
            for line in lines.values():
                line.port.close()
            self._announce("closed", str(error))
            raise
        now = self._clock()
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
        return self._event_time

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
        latest = self._latest
        if latest is None:
            return None
        position, when = latest
        return position, max(0.0, self._clock() - when)

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
            command = self._decoder.drive_command(position)
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
        self._send_drive(self._decoder.stop_command())

    def poll_now(self) -> None:
        """Ask for a position at once; a device that speaks by itself is not asked.

        When an answer is still on its way, the request follows it immediately.

        Raises
        ------
        LinkError
            When the request cannot be sent.
        """
        self._usable(self._profile.default_link)
        with self._lock:
            poller = self._decoder.poller
            if poller is None:
                return
            poller.urge()
            now = self._clock()
            lines = [] if poller.wait(now) > 0.0 else self._begin_cycle(now)
        for line in lines:
            self._ask(line)

    def record(self, switch: str = "key") -> None:
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
        with self._lock:
            self._press(switch)
        self.poll_now()

    # -- references ------------------------------------------------------------------------

    @property
    def referenced(self) -> bool:
        """Whether the counters' origin is known."""
        return self._decoder.referenced

    @property
    def unreferenced_position(self) -> Position | None:
        """Where the carriages stand as the device counts [mm]."""
        return self._decoder.unreferenced_position

    def reference(self, known: Position) -> Position:
        """Tell where the carriages stand after the counters lost their origin.

        Parameters
        ----------
        known
            Plate coordinates of the reference pointed at [mm].

        Returns
        -------
        Position
            By how much the counters were moved [mm].

        Raises
        ------
        InputError
            When nothing was heard yet.
        """
        with self._lock:
            moved = self._decoder.reference(known)
            place = (known.xl, known.yl, known.xr, known.yr)
            self._note("reference", " ".join(repr(float(value)) for value in place))
            return moved

    @property
    def positions_heard(self) -> int:
        """How many complete positions were heard, refused for want of a reference or not."""
        return self._decoder.positions_heard

    @property
    def mark(self) -> tuple[int, int]:
        """What was asked and heard until now, for `read_since`."""
        with self._lock:
            return self._decoder.mark

    def read_since(self, mark: tuple[int, int]) -> bool:
        """Say whether `unreferenced_position` was measured after a `mark` was taken."""
        with self._lock:
            return self._decoder.read_since(mark)

    @property
    def shift(self) -> Position:
        """By how much the counters are moved [mm]."""
        return self._decoder.shift

    def reference_by(self, shift: Position) -> None:
        """Tell by how much the counters are to be moved from now on [mm].

        Raises
        ------
        InputError
            When nothing was heard yet.
        """
        with self._lock:
            here = self._decoder.unreferenced_position
            if here is None:
                raise InputError("no position was heard yet: there is nothing to refer to")
            self.reference(
                Position(
                    here.xl + shift.xl, here.yl + shift.yl, here.xr + shift.xr, here.yr + shift.yr
                )
            )

    def confirm_reference(self) -> None:
        """Take the counters as they are: they kept their origin."""
        with self._lock:
            self._decoder.confirm_reference()
            self._note("confirm", "")

    # -- inside ----------------------------------------------------------------------------

    def _send_drive(self, command: bytes) -> None:
        drive = self._profile.drive
        name = drive.link if drive is not None else self._profile.default_link
        self._usable(name).send(command)

    def _usable(self, name: str) -> _Line:
        line = self._lines.get(name)
        if line is None:
            raise LinkError(f"the link to {self._profile.id} is closed")
        if line.state in ("lost", "reconnecting"):
            raise LinkError(f"the link to {self._profile.id} is lost: {line.detail}")
        return line

    def _note(self, kind: Literal["press", "reopen", "reference", "confirm"], text: str) -> None:
        if self._on_decoder is not None:
            self._on_decoder(kind, text)

    def _press(self, switch: str) -> None:
        now = self._event_time = self._clock()
        self._note("press", switch)
        self._decoder.press(switch, now)

    def _begin_cycle(self, now: float) -> list[_Line]:
        """Begin a cycle; return the ports on which the request is to be written.

        The request is told and the decoder knows of it before any answer can be decoded; the
        writing itself, which may wait, is left to the caller and outside of the lock.
        """
        poll, poller = self._profile.poll, self._decoder.poller
        if poll is None or poller is None:
            return []
        with self._lock:
            poller.begin(now)
            lines = [self._lines[name] for name in poll.links if name in self._lines]
            usable = [line for line in lines if line.state not in ("lost", "reconnecting")]
            for line in usable:
                self._tell_sent(line.name, poll.request, now)
            return usable

    def _ask(self, line: _Line) -> None:
        if self._profile.poll is not None:
            line.port.write(self._profile.poll.request)

    def _tell_sent(self, name: str, data: bytes, now: float) -> None:
        self._event_time = now
        if self._on_traffic is not None:
            self._on_traffic("out", name, data)
        self._decoder.sent(data, name, now)

    def poll_if_due(self) -> float:
        """Send the next request when its time has come.

        Returns
        -------
        float
            Seconds until the next one may be due.
        """
        with self._lock:
            poller = self._decoder.poller
            if poller is None:
                return _TICK
            if self._decoder.waiting:
                poller.urge()
            now = self._clock()
            wait = poller.wait(now)
            if wait > 0.0:
                return min(wait, _TICK)
            lines = self._begin_cycle(now)
            wait = poller.wait(now)
        for line in lines:
            # a port that does not take the request gives no answer: its reader says so
            with contextlib.suppress(LinkError):
                self._ask(line)
        return min(wait, _TICK)

    def wait_for_room(self) -> None:
        """Wait until whoever listens has room for more, or the link is closed."""
        while self._room is not None and not self._room() and not self._stop.is_set():
            self._stop.wait(_CROWDED)

    @property
    def settling(self) -> bool:
        """Whether the device is not asked until late answers have come."""
        with self._lock:
            return self._decoder.poller is not None and self._decoder.poller.settling

    def received(self, line: _Line, data: bytes) -> None:
        """Take bytes from a port, decode them and tell."""
        with self._lock:
            now = self._event_time = self._clock()
            if self._on_traffic is not None:
                self._on_traffic("in", line.name, data)
            before = self._decoder.heard(line.name)
            readings = self._decoder.feed(data, now, line.name)
            if self._decoder.heard(line.name) > before:
                line.heard_at(now)
            self._tell(readings, now)

    def tick(self) -> None:
        """Let time pass for the decoder."""
        with self._lock:
            now = self._event_time = self._clock()
            self._tell(self._decoder.tick(now), now)

    def pressed(self, switch: str) -> None:
        """Take a modem line's footswitch."""
        with self._lock:
            self._press(switch)
            if self._decoder.poller is not None:
                self._decoder.poller.urge()

    def reopened(self, name: str) -> None:
        """Start the decoder afresh after a port came back."""
        with self._lock:
            self._note("reopen", name)
            self._decoder.reopen(name)

    def about_to_send(self, name: str, data: bytes) -> None:
        """Tell what is about to be sent."""
        with self._lock:
            self._tell_sent(name, data, self._clock())

    def _tell(self, readings: list[Reading], now: float) -> None:
        for reading in readings:
            if isinstance(reading, Position):
                self._latest = (reading, now)
            elif isinstance(reading, Record | InPosition) and reading.position is not None:
                self._latest = (reading.position, now)
        for reading in self._refusals.sift(readings, now):
            self._on_reading(reading)

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

    def change(self, line: _Line, state: LinkState, detail: str = "") -> None:
        """Set a port's state and tell."""
        with self._lock:
            if (line.state, line.detail) == (state, detail):
                return
            line.state = state
            line.detail = detail
        self._refresh()

    def now(self) -> float:
        """Return the link's time [s]."""
        return self._clock()


class _Line:
    """One port of a link and the thread that reads it."""

    def __init__(self, link: Link, name: str, address: str, port: SerialPort) -> None:
        self.link = link
        self.name = name
        self.address = address
        self.port = port
        self.identity = identity_of(address)
        self.settings = link.profile.links[name]
        self.detail = ""
        self._heard = 0.0
        self._answered = False
        self.state: LinkState = "live" if self._limit() is None else "opening"
        self.thread = threading.Thread(target=self._run, name=f"plotter link {name}", daemon=True)
        self._switches = [
            switch
            for switch in link.profile.footswitches.values()
            if switch.source == "modem" and switch.link == name
        ]
        self._levels: dict[str, tuple[bool, float]] = {}

    def _limit(self) -> float | None:
        """Return after how many seconds the port counts as silent, or None."""
        if self.settings.silence is not None:
            return self.settings.silence
        poll = self.link.profile.poll
        if poll is not None and self.name in poll.links:
            return max(2.0, 4 * poll.timeout)
        return None

    def opened(self, now: float) -> None:
        """Begin to wait for the first record."""
        self._heard = now
        self._answered = False

    def heard_at(self, now: float) -> None:
        """Take notice of a record that was understood."""
        self._heard = now
        self._answered = True

    def send(self, data: bytes) -> None:
        """Send bytes; what is sent is told before."""
        self.link.about_to_send(self.name, data)
        self.port.write(data)

    def _run(self) -> None:
        try:
            while not self.link.stopping.is_set():
                try:
                    self._read_until_lost()
                except LinkError as error:
                    if self.link.stopping.is_set():
                        return
                    self.port.close()
                    self.link.change(self, "lost", str(error))
                    self._reopen()
        finally:
            # an error in a callback ends this thread: the link must not look alive then
            if not self.link.stopping.is_set():
                self.link.change(self, "lost", "the reader has failed")

    def _read_until_lost(self) -> None:
        while not self.link.stopping.is_set():
            wait = self.link.poll_if_due()
            if self._switches:
                wait = min(wait, _MODEM_TICK)
            self.link.wait_for_room()
            data = self.port.read(min(wait, _TICK))
            if self.link.stopping.is_set():
                return
            if data:
                self.link.received(self, data)
            else:
                self.link.tick()
            self._check_silence()
            for switch in self._switches:
                self._check_modem(switch)

    def _check_silence(self) -> None:
        limit = self._limit()
        if limit is None:
            return
        if self.link.settling:
            # it is not asked, so that it need not answer
            self._heard = self.link.now()
        quiet = self.link.now() - self._heard
        if quiet >= limit:
            where = plain(self.address, 60)
            self.link.change(self, "silent", f"nothing understood from {where} for {limit:g} s")
        elif self._answered:
            self.link.change(self, "live")

    def _check_modem(self, switch: Footswitch) -> None:
        level = self.port.modem(switch.line) == switch.active
        before, when = self._levels.get(switch.name, (level, 0.0))
        now = self.link.now()
        if level != before and now - when < switch.debounce:
            return
        if switch.name not in self._levels or level != before:
            self._levels[switch.name] = (level, now)
        if level and not before:
            self.link.pressed(switch.name)

    def _reopen(self) -> None:
        attempt = 0
        waits = self.link.back_off
        while not self.link.stopping.wait(waits[min(attempt, len(waits) - 1)]):
            attempt += 1
            self.link.change(self, "reconnecting", self.detail)
            address = find_port(self.identity) or self.address
            try:
                port = SerialPort(address, self.settings)
            except LinkError as error:
                self.link.change(self, "lost", str(error))
                continue
            self.port = port
            self.address = address
            if self.link.stopping.is_set():
                return
            self.link.reopened(self.name)
            self._levels.clear()
            self.opened(self.link.now())
            self.link.change(self, "live" if self._limit() is None else "opening")
            return


def _addresses(profile: Profile, ports: Mapping[str, str] | str) -> dict[str, str]:
    """Return the address of every link of the profile."""
    if isinstance(ports, str):
        if len(profile.links) > 1:
            names = ", ".join(profile.links)
            raise InputError(f"{profile.id} needs a port for each of its links: {names}")
        return {profile.default_link: ports}
    for name in ports:
        if name not in profile.links:
            known = ", ".join(profile.links)
            raise InputError(f'{profile.id} has no link "{plain(name, 40)}" (known: {known})')
    for name in profile.links:
        if name not in ports:
            raise InputError(f'{profile.id}: no port is given for its link "{name}"')
    return {name: ports[name] for name in profile.links}
