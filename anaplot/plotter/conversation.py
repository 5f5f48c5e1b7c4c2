"""What is said between host and device: the decoder in time, and who is told what, in order."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Literal

from anaplot.errors import InputError
from anaplot.plotter.decoder import Decoder
from anaplot.plotter.readings import InPosition, Position, Reading, Record
from anaplot.plotter.refusalcount import RefusalCount
from anaplot.plotter.schema import Profile

__all__ = ["Conversation", "DecoderEvent", "Traffic"]

Traffic = Callable[[Literal["in", "out"], str, bytes], None]
DecoderEvent = Callable[[Literal["press", "reopen", "reference", "confirm"], str], None]


class Conversation:
    """All that is said on the lines of one instrument.

    Everything is told before the decoder knows of it, with the time that the decoder is given: what
    is told replays to the same readings. No port is touched and nothing waits.

    Parameters
    ----------
    profile, on_reading, on_traffic, on_decoder, clock, speed_limits
        See `anaplot.plotter.link.Link`.
    lock
        Held for every step: one at a time over all lines.
    """

    def __init__(
        self,
        profile: Profile,
        lock: threading.RLock,
        *,
        on_reading: Callable[[Reading], None],
        on_traffic: Traffic | None,
        on_decoder: DecoderEvent | None,
        clock: Callable[[], float],
        speed_limits: bool,
    ) -> None:
        self._profile = profile
        self._lock = lock
        self._on_reading = on_reading
        self._on_traffic = on_traffic
        self._on_decoder = on_decoder
        self._clock = clock
        self._speed_limits = speed_limits
        self._refusals = RefusalCount()
        self._latest: tuple[Position, float] | None = None
        self.decoder = Decoder(profile, speed_limits=speed_limits)
        self.event_time = 0.0
        """The time [s] that the decoder is given with what is being told."""

    def begin(self, *, referenced: bool, shift: Position | None = None) -> None:
        """Begin anew.

        Parameters
        ----------
        referenced
            Whether the counters' origin is known.
        shift
            By how much they are moved from the beginning [mm]; whoever opens the line tells it.
        """
        with self._lock:
            self.decoder = Decoder(self._profile, speed_limits=self._speed_limits)
            if shift is not None:
                self.decoder.move(shift)
            self._latest = None
            if not referenced:
                self.reopened("")

    def now(self) -> float:
        """Return the time [s]."""
        return self._clock()

    def latest(self) -> tuple[Position, float] | None:
        """Return the latest valid position and its age [s], or None before the first."""
        latest = self._latest
        if latest is None:
            return None
        position, when = latest
        return position, max(0.0, self._clock() - when)

    # -- from the device -------------------------------------------------------------------

    def received(self, name: str, data: bytes) -> float | None:
        """Take bytes from a line; returns when a record of it was understood, else None."""
        with self._lock:
            now = self.event_time = self._clock()
            if self._on_traffic is not None:
                self._on_traffic("in", name, data)
            before = self.decoder.heard(name)
            readings = self.decoder.feed(data, now, name)
            understood = self.decoder.heard(name) > before
            self._tell(readings, now)
            return now if understood else None

    def tick(self) -> None:
        """Let time pass."""
        with self._lock:
            now = self.event_time = self._clock()
            self._tell(self.decoder.tick(now), now)

    def _tell(self, readings: list[Reading], now: float) -> None:
        for reading in readings:
            if isinstance(reading, Position):
                self._latest = (reading, now)
            elif isinstance(reading, Record | InPosition) and reading.position is not None:
                self._latest = (reading.position, now)
        for reading in self._refusals.sift(readings, now):
            self._on_reading(reading)

    # -- to the device ---------------------------------------------------------------------

    def sent(self, name: str, data: bytes) -> None:
        """Tell what is about to be sent."""
        with self._lock:
            self._tell_sent(name, data, self._clock())

    def _tell_sent(self, name: str, data: bytes, now: float) -> None:
        self.event_time = now
        if self._on_traffic is not None:
            self._on_traffic("out", name, data)
        self.decoder.sent(data, name, now)

    @property
    def polled(self) -> bool:
        """Whether the device is asked."""
        return self.decoder.poller is not None

    def wait(self) -> float:
        """Return in how many seconds a device that is asked is to be asked again."""
        poller = self.decoder.poller
        assert poller is not None
        if self.decoder.waiting:
            poller.urge()
        return poller.wait(self._clock())

    def ask(self, names: Sequence[str]) -> None:
        """Begin a cycle: the request is about to be written on these lines.

        It is told, and the decoder knows of it, before any answer can be decoded.
        """
        poll, poller = self._profile.poll, self.decoder.poller
        assert poll is not None
        assert poller is not None
        now = self._clock()
        poller.begin(now)
        for name in names:
            self._tell_sent(name, poll.request, now)

    @property
    def settling(self) -> bool:
        """Whether the device is not asked until late answers have come."""
        with self._lock:
            return self.decoder.poller is not None and self.decoder.poller.settling

    # -- what the decoder is told besides --------------------------------------------------

    def pressed(self, switch: str) -> None:
        """Take it that a footswitch or a key was pressed."""
        with self._lock:
            now = self.event_time = self._clock()
            self._note("press", switch)
            self.decoder.press(switch, now)
            if self.decoder.poller is not None:
                self.decoder.poller.urge()

    def reopened(self, name: str) -> None:
        """Start afresh after a line, or "" all, came back."""
        with self._lock:
            self._note("reopen", name)
            self.decoder.reopen(name or None)

    def moved_by(self, shift: Position) -> None:
        """Take it that the counters are to be moved by so much [mm].

        Raises
        ------
        InputError
            Nothing was heard yet.
        """
        with self._lock:
            here = self.decoder.unreferenced_position
            if here is None:
                raise InputError("no position was heard yet: there is nothing to refer to")
            place = (here.xl + shift.xl, here.yl + shift.yl, here.xr + shift.xr, here.yr + shift.yr)
            self.decoder.reference(Position(*place))
            self._note("reference", " ".join(repr(float(value)) for value in place))

    def confirmed(self) -> None:
        """Take it that the counters kept their origin."""
        with self._lock:
            self.decoder.confirm_reference()
            self._note("confirm", "")

    def _note(self, kind: Literal["press", "reopen", "reference", "confirm"], text: str) -> None:
        if self._on_decoder is not None:
            self._on_decoder(kind, text)
