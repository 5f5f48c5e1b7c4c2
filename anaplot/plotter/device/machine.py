"""A simulated device without anybody at it: motion, footswitches and protocol in time."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Mapping
from dataclasses import replace

from anaplot.errors import InputError
from anaplot.plotter.device.motion import Carriages
from anaplot.plotter.device.outgoing import Outgoing
from anaplot.plotter.device.protocol import Ask, DeviceProtocol, Halt, MoveTo, NotUnderstood
from anaplot.plotter.schema import Footswitch, Profile, RecordFormat
from anaplot.plotter.template import Value

__all__ = ["Machine"]


class Machine:
    """A device that speaks a profile.

    Parameters
    ----------
    profile
        The device.
    carriages, outgoing
        Its carriages, and the lines to the host.
    arrived
        Called when a drive has come to its end.

    Notes
    -----
    One thread at a time.
    """

    def __init__(
        self,
        profile: Profile,
        carriages: Carriages,
        outgoing: Outgoing,
        arrived: Callable[[], None],
    ) -> None:
        self._profile = profile
        self._carriages = carriages
        self._outgoing = outgoing
        self._arrived = arrived
        self._protocol = DeviceProtocol(profile)
        self._number = 0  # of footswitches told
        self._held: Footswitch | None = None
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._begun = 0  # motions and intentions: what belongs to an earlier one is not carried on
        self.now = 0.0
        """Simulated time [s]."""
        self.drives = 0
        """How many drives were begun."""
        if profile.simulate.stream is not None:
            self._at(profile.simulate.stream, self._stream)

    # -- time ------------------------------------------------------------------------------

    def advance(self, dt: float) -> None:
        """Let simulated time pass [s]."""
        until = self.now + max(0.0, dt)
        while self._events and self._events[0][0] <= until:
            when, _, action = heapq.heappop(self._events)
            self.now = max(self.now, when)
            action()
        self.now = until

    def next_event(self) -> float | None:
        """Return in how many simulated seconds something happens by itself, or None."""
        times = [event[0] for event in self._events[:1]]
        arrival = self._outgoing.next_time()
        times += [] if arrival is None else [arrival]
        return max(0.0, min(times) - self.now) if times else None

    def _at(self, delay: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._events, (self.now + delay, next(self._order), action))

    def unless_disturbed(self, delay: float, action: Callable[[], object]) -> None:
        """Do something after a delay [s] if nothing else is begun or stopped before."""
        begun = self._begun

        def act() -> None:
            if begun == self._begun:
                action()

        self._at(delay, act)

    # -- motion ----------------------------------------------------------------------------

    def disturb(self) -> None:
        """Give up what was to be done `unless_disturbed`."""
        self._begun += 1

    def halt(self) -> None:
        """Stop whatever moves, and give up what was about to happen then."""
        self._carriages.halt(self.now)
        self.disturb()

    def _drive_to(self, target: tuple[float, ...]) -> None:
        if not self._protocol.within_travel(target):
            self._fault("1", "target outside the travel")
            return
        self.halt()
        self.drives += 1
        self.unless_disturbed(self._carriages.begin(target, self.now), self._arrive)

    def _arrive(self) -> None:
        self._carriages.arrive()
        if self._profile.drive is not None:
            self._say(self._profile.records[self._profile.drive.in_position])
        self._arrived()

    def switch_off_and_on(self) -> None:
        """Begin at zero: incremental counters, the count of presses, what was under way."""
        self.halt()
        self._carriages.switch_on()
        self._number = 0
        self._outgoing.empty(self.now)
        self._protocol.forget()

    # -- footswitches ----------------------------------------------------------------------

    def press(self, name: str) -> bool:
        """Press a footswitch; see `SimulatedPlotter.press`."""
        switch = self._profile.footswitches.get(name)
        if switch is None:
            known = ", ".join(self._profile.footswitches) or "none"
            raise InputError(f'{self._profile.id} has no footswitch "{name}" (known: {known})')
        if switch.source == "every":
            for record in self._protocol.carriers:
                for _ in range(record.confirm):
                    self._say(record)
            return True
        if switch.source != "record":
            return False
        record = self._profile.records[switch.record]
        if record.kind == "position":
            self._held = switch
            self._repeat(record, self._profile.simulate.hold)
        else:
            self._number = self._number % 999_999 + 1
            self._say(record, switch)
        return True

    def _repeat(self, record: RecordFormat, times: int) -> None:
        """Tell the held key again and again, then let it go."""
        simulate = self._profile.simulate
        if times == 0:
            self._held = None
            if simulate.tells_release:
                for _ in range(record.confirm):
                    self._say(record)
            return
        self._say(record, self._held)
        self._at(simulate.hold_period, lambda: self._repeat(record, times - 1))

    # -- what it says ----------------------------------------------------------------------

    def _stream(self) -> None:
        period = self._profile.simulate.stream
        if period is None:
            return
        for record in self._protocol.carriers:
            self._say(record, self._held)
        self._at(period, self._stream)

    def _say(
        self,
        record: RecordFormat,
        switch: Footswitch | None = None,
        texts: Mapping[str, Value] | None = None,
    ) -> None:
        """Send a record on each of its links."""
        if record.send is None:
            return
        counts = self._carriages.counts(self.now)
        for link, data in self._protocol.said(record, counts, self._number, switch, texts):
            self._outgoing.send(link, data, self.now)

    def _fault(self, code: str, text: str) -> None:
        record = self._protocol.fault_record
        if record is not None:
            self._say(record, texts={"code": code, "text": text})

    # -- what it does when it is told ------------------------------------------------------

    def receive(self, data: bytes, link: str) -> None:
        """Take bytes from the host."""
        if self._outgoing.frozen(link, self.now):
            return
        for command in self._protocol.understood(data, link):
            match command:
                case Ask(link):
                    self._answer(link)
                case MoveTo(counts):
                    origin = self._carriages.origin
                    self._drive_to(tuple(a + b for a, b in zip(counts, origin, strict=True)))
                case Halt():
                    self.halt()
                case NotUnderstood():
                    self._fault("4", "command not understood")

    def _answer(self, link: str) -> None:
        carriers = (record for record in self._protocol.carriers if link in record.links)
        record = next(carriers, None)
        if record is not None:
            self._say(replace(record, links=(link,)))
