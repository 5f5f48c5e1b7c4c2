"""From records to readings, and from positions to commands: no ports, no clock of its own."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from anaplot.errors import InputError
from anaplot.plotter.framing import Framer
from anaplot.plotter.heldkeys import HeldKeys
from anaplot.plotter.hostcommands import drive_command, poll_request, stop_command
from anaplot.plotter.jumps import JumpWatch
from anaplot.plotter.numbering import Numbering
from anaplot.plotter.origin import Origin
from anaplot.plotter.poller import Poller, Request
from anaplot.plotter.presses import Presses
from anaplot.plotter.readings import (
    UNREFERENCED,
    Fault,
    InPosition,
    Position,
    Reading,
    Record,
    Refused,
)
from anaplot.plotter.readout import AxesReadOut, Gatherer
from anaplot.plotter.records import RecordReader
from anaplot.plotter.refusal import RefusedError
from anaplot.plotter.schema import Profile, RecordFormat
from anaplot.textfiles.wording import plain

__all__ = ["RULES", "Decoder"]

RULES = 2
"""By which a decoder decides today what is a measurement; 1 are those of version 0.1."""
_UNDER_WAY = 0.25  # s that what a device says by itself may have been on its way


class Decoder:
    """What a profile's device says, decoded; and the commands it understands.

    Parameters
    ----------
    profile
        The device.
    rules
        By which it decides what is a measurement: `RULES`, or those by which a session was
        recorded.
    speed_limits
        Whether the axes' `fastest` is minded; a simulated hand moves plates at once.

    Notes
    -----
    The decoder depends on the bytes, the times and the calls it is given and on nothing else:
    a recorded session fed to a new decoder gives the same readings.
    """

    def __init__(self, profile: Profile, *, rules: int = RULES, speed_limits: bool = True) -> None:
        if not 1 <= rules <= RULES:
            raise InputError(f"the rules {rules} of a newer version are not known here")
        strict = rules > 1
        self._profile = profile
        self._poller = Poller(profile.poll) if profile.poll is not None and strict else None
        self._gatherer = Gatherer(len(profile.axes), profile.stage.within)
        self._presses = Presses(
            profile.poll, profile.axes, confirm=profile.confirm and strict, strict=strict
        )
        self._jumps = JumpWatch(profile.axes) if speed_limits and strict else None
        self._numbering = Numbering(incremental=profile.incremental, strict=strict)
        self._now = math.inf  # unknown: a request sent then does not grow old
        self._records = RecordReader(profile)
        self._framers = {name: Framer(profile.framing) for name in profile.links}
        self._names = tuple(profile.axes)
        self._values: dict[str, float] = {}
        self._keys = HeldKeys(profile)
        self._cycle = 0
        self._last_byte = dict.fromkeys(profile.links, 0.0)
        self._notes: list[Reading] = []
        self._understood_records = dict.fromkeys(profile.links, 0)
        self._origin = Origin(profile.stage)
        self._heard_cycle: int | None = None
        self._whole = False  # the record decoded last says where it was pressed
        self._twice = False  # among those decoded at once an answer came that nobody asked for

    @property
    def profile(self) -> Profile:
        """The device's profile."""
        return self._profile

    @property
    def axes(self) -> dict[str, float]:
        """The latest valid value of each axis that was heard [mm]."""
        return dict(self._values)

    # -- from the device ------------------------------------------------------------------

    def feed(self, data: bytes, now: float, link: str | None = None) -> list[Reading]:
        """Decode what arrived.

        Parameters
        ----------
        data
            Bytes as they came.
        now
            When [s], on any clock that does not go back.
        link
            Where they came from; the profile's first link by default.

        Returns
        -------
        list of Reading
            In the order of the bytes. A footswitch's position is followed by its record.
        """
        name = link if link is not None else self._profile.default_link
        framer = self._framers[name]
        self._now = now
        if data:
            self._keys.paused(name, now - self._last_byte[name])
            self._last_byte[name] = now
            if self._poller is not None:
                self._poller.bytes_came(now)
        readings: list[Reading] = list(self._presses.expire(now))
        frames = framer.feed(data, now)
        self._twice = False
        for frame in frames:
            self._whole = False
            if isinstance(frame, Refused):
                readings.append(frame)
            else:
                readings.extend(self._decode(frame, now, name))
        if self._poller is not None and frames:
            between = all(one.between for one in self._framers.values())
            self._poller.records_came(unasked=self._whole and between and not self._twice)
        return readings

    def tick(self, now: float) -> list[Reading]:
        """Let time pass without bytes: incomplete records and unanswered presses are refused.

        Parameters
        ----------
        now
            The time [s].

        Returns
        -------
        list of Reading
            Refusals.
        """
        self._now = now
        readings: list[Reading] = []
        for framer in self._framers.values():
            readings.extend(framer.expire(now))
        readings.extend(self._presses.expire(now))
        return readings

    def press(self, switch: str, now: float) -> None:
        """Make the next position a record (a modem line closed, a key was hit).

        Only a position measured after the press counts: of a device that is asked, the answer
        to a request sent after it; of another, the second one that comes, as the first may
        have been under way. Pressed again before that, the earlier press does not count any
        more: else one pointing would be recorded twice, the second time for the next point.

        Parameters
        ----------
        switch
            What was pressed.
        now
            When [s].
        """
        self._now = now
        self._presses.press(switch, now)

    def sent(self, data: bytes, link: str | None = None, now: float | None = None) -> None:
        """Take notice of what the host sent: a request begins a new cycle.

        A position is made of answers of one cycle only. The request on the first of the polled
        links counts for all.

        Parameters
        ----------
        data
            Bytes sent.
        link
            Where; the profile's first link by default.
        now
            When [s]; by default the latest time that the decoder was given.
        """
        self._now = self._now if now is None else now
        poll = self._profile.poll
        name = link if link is not None else self._profile.default_link
        if poll is not None and data == poll.request and name == poll.links[0]:
            self._cycle += 1
            self._gatherer.begun()
            self._presses.begun(self._cycle)
            if self._poller is not None:
                self._poller.sent(name, self._now)

    @property
    def poller(self) -> Poller | None:
        """When to ask a device that is asked; None for another, and by former rules."""
        return self._poller

    @property
    def waiting(self) -> bool:
        """Whether something waits for the next read-out."""
        return self._presses.waiting

    def heard(self, link: str) -> int:
        """Return how many records were understood.

        Parameters
        ----------
        link
            Where.
        """
        return self._understood_records[link]

    def reopen(self, link: str | None = None) -> None:
        """Start afresh after a link was lost: nothing begun before it counts.

        Parameters
        ----------
        link
            Which one; None for all.
        """
        for name in self._framers if link is None else (link,):
            self._framers[name].reset()
            self._records.forget(name)
        self._gatherer.forget()
        self._keys.forget()
        self._presses.forget()
        self._numbering.forget()
        if self._jumps is not None:
            self._jumps.forget()
        if self._poller is not None:
            self._poller.restart()
        if self._profile.incremental:
            self._origin.lose()
            self._origin.forget()

    @property
    def referenced(self) -> bool:
        """Whether the counters' origin is known."""
        return self._origin.known

    @property
    def unreferenced_position(self) -> Position | None:
        """Where the carriages stand as the device counts, before any reference correction."""
        return self._origin.counted

    @property
    def mark(self) -> tuple[int, int]:
        """What was asked and heard until now, for `read_since`."""
        return self._cycle, self._origin.heard

    def read_since(self, mark: tuple[int, int]) -> bool:
        """Say whether `unreferenced_position` was measured after a `mark` was taken.

        Of a device that is asked, it answers a request that left after it; of another, two
        positions have come since, as the first may have been under way.
        """
        if self._profile.poll is not None:
            return self._heard_cycle is not None and self._heard_cycle > mark[0]
        return self._origin.heard > mark[1] + 1

    @property
    def shift(self) -> Position:
        """By how much the counters are moved [mm]."""
        return self._origin.shift

    def reference(self, known: Position) -> Position:
        """Tell where the carriages stand: from now on positions count from there.

        Parameters
        ----------
        known
            Plate coordinates of the reference the operator points at [mm].

        Returns
        -------
        Position
            By how much the counters were moved [mm].

        Raises
        ------
        InputError
            When no position was heard since the line was opened.
        """
        return self._origin.refer(known)

    def move(self, shift: Position) -> None:
        """Take it that the counters are to be moved by so much [mm], wherever they stand."""
        self._origin.move(shift)

    def confirm_reference(self) -> None:
        """Take the counters as they are: they kept their origin."""
        self._origin.known = True

    # -- to the device --------------------------------------------------------------------

    def poll_request(self) -> bytes:
        """Return the bytes that ask for a position; see `hostcommands.poll_request`."""
        return poll_request(self._profile)

    def drive_command(self, position: Position) -> bytes:
        """Return the bytes that drive the plates to a position [mm].

        See `hostcommands.drive_command`.
        """
        return drive_command(self._profile, self._origin, position)

    def stop_command(self) -> bytes:
        """Return the bytes that stop a drive; see `hostcommands.stop_command`."""
        return stop_command(self._profile)

    # -- records --------------------------------------------------------------------------

    def _decode(self, frame: bytes, now: float, link: str) -> Iterable[Reading]:
        self._notes.clear()
        try:
            record, match = self._records.read(frame, link)
            readings = self._understood(record, match, frame, now, link)
            return [*self._notes, *readings]
        except RefusedError as refusal:
            self._framers[link].lose_sync()
            self._whole = False
            return [*self._notes, *self._refuse(frame, str(refusal))]

    def _refuse(self, frame: bytes, reason: str) -> list[Reading]:
        """Refuse a record; a press that waited for it is refused with it."""
        return [Refused(frame, reason), *self._presses.refuse(reason)]

    def _understood(
        self, record: RecordFormat, match: re.Match[bytes], frame: bytes, now: float, link: str
    ) -> list[Reading]:
        self._understood_records[link] += 1
        answered = self._answered(link, now) if record.kind == "position" else None
        if record.kind == "ignore":
            return []
        if record.kind == "fault":
            groups = match.groupdict(b"")
            code = plain((groups.get("code") or b"fault").strip(), 20)
            return [Fault(code, plain((groups.get("text") or b"").strip(), 120))]
        if not self._records.confirmed(record, frame, now, link):
            return []
        switch, number = "", None
        if record.kind == "record":
            # the number counts even when the record is refused for what it says
            switch = self._records.switch_of(record, match)
            number = self._numbered(match)
        self._records.check_faults(record, match)
        values = self._records.axis_values(record, match, link)
        if record.kind == "in-position":
            place = self._reading(values) if values and self._origin.known else None
            return [InPosition(place)]
        if record.kind == "record":
            if values:
                self._whole = True
                if self._jumps is not None:
                    self._jumps.check(values, now)
                made = Record(self._reading(values), switch, number)
                return self._presses.recorded(made, values, now)
            self.press(switch, now)
            return []
        return self._positioned(record, match, values, answered, now)

    def _answered(self, link: str, now: float) -> Request | None:
        """Return the request to which a position belongs; None when nobody asked for it."""
        poll = self._profile.poll
        if poll is None:
            return None
        if self._poller is None:
            return Request(self._cycle, now)
        if link not in poll.links:
            # it speaks by itself: what comes now may have been under way when the cycle began
            return Request(self._cycle - 1, now - _UNDER_WAY)
        request = self._poller.answered(link, now)
        if request is None:
            self._twice = True
            reason = "a position came that was not asked for"
            self._notes += self._presses.refuse_all(reason, own=False)
        return request

    def _reading(self, values: dict[str, float]) -> Position:
        """Return the plate position of a complete set of axes.

        Raises
        ------
        RefusedError
            When the counters' origin is not known.
        """
        self._values.update(values)
        return self._origin.place(tuple(values[name] for name in self._names))

    def _numbered(self, match: re.Match[bytes]) -> int | None:
        """Return the device's own number; one that came before is refused, a gap is told."""
        number = self._records.number_of(match)
        if number is None:
            return None
        fault = self._numbering.take(number, match.group(0))
        if fault is not None:
            self._notes.append(fault)
            if fault.code == "restarted":
                self._lose_reference()
        return number

    def _positioned(
        self,
        record: RecordFormat,
        match: re.Match[bytes],
        values: dict[str, float],
        answered: Request | None,
        now: float,
    ) -> list[Reading]:
        self._values.update(values)
        cycle = None if answered is None else answered.cycle
        complete = self._gatherer.add(values, cycle, now)
        if complete is None:
            return []
        since = now - _UNDER_WAY if answered is None else answered.when
        if self._jumps is not None and self._jumps.read(complete, since, now):
            self._notes.append(Fault("jumped", "the counters jumped"))
            self._lose_reference()
        self._heard_cycle = cycle
        readout = AxesReadOut(complete, self._reading(complete), now, cycle)
        switches = self._profile.footswitches.values()
        every = [switch.name for switch in switches if switch.source == "every"]
        begun = self._keys.told(record, match)
        return [readout.position, *self._presses.read(readout, every, begun, self._keys.down)]

    def _lose_reference(self) -> None:
        """Take it that the counters' origin is lost; those of an absolute device keep theirs."""
        if self._profile.incremental:
            self._origin.lose()
            self._notes += self._presses.refuse_all(UNREFERENCED)
