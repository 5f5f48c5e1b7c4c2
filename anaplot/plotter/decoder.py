"""From records to readings, and from positions to commands: no ports, no clock of its own."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

from anaplot.errors import InputError
from anaplot.plotter.framing import Framer
from anaplot.plotter.jumps import JumpWatch
from anaplot.plotter.numbering import Numbering
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
from anaplot.plotter.readout import Gatherer, ReadOut
from anaplot.plotter.refusal import RefusedError
from anaplot.plotter.schema import Footswitch, Profile, RecordFormat
from anaplot.plotter.values import axis_number, whole_number
from anaplot.textfiles.wording import plain

__all__ = [
    "RULES",
    "Decoder",
    "check_examples",
]

RULES = 2
"""By which a decoder decides today what is a measurement; 1 are those of version 0.1."""
_UNDER_WAY = 0.25  # s that what a device says by itself may have been on its way


@dataclass(slots=True)
class _Confirming:
    """Equal records counted so far."""

    frame: bytes
    count: int
    last: float


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
        self._framers = {name: Framer(profile.framing) for name in profile.links}
        self._names = tuple(profile.axes)
        self._values: dict[str, float] = {}
        self._checksummed: set[str] = set()
        self._confirming: dict[tuple[str, str], _Confirming] = {}
        self._pressed: dict[str, bool] = {}
        self._cycle = 0
        self._last_byte = dict.fromkeys(profile.links, 0.0)
        self._notes: list[Reading] = []
        self._understood_records = dict.fromkeys(profile.links, 0)
        self._pressed_for_each = any(
            switch.source == "every" for switch in profile.footswitches.values()
        )
        self._referenced = True
        self._shift: tuple[float, ...] = (0.0,) * len(self._names)
        self._raw_plate: tuple[float, ...] | None = None
        self._heard_positions = 0
        self._heard_cycle: int | None = None

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
            self._let_go(name, now - self._last_byte[name])
            self._last_byte[name] = now
            if self._poller is not None:
                self._poller.bytes_came(now)
        readings: list[Reading] = list(self._presses.expire(now))
        for frame in framer.feed(data, now):
            if isinstance(frame, Refused):
                readings.append(frame)
                continue
            readings.extend(self._decode(frame, now, name))
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
            self._checksummed.discard(name)
        self._gatherer.forget()
        self._confirming.clear()
        self._pressed.clear()
        self._presses.forget()
        self._numbering.forget()
        if self._jumps is not None:
            self._jumps.forget()
        if self._poller is not None:
            self._poller.restart()
        if self._profile.incremental:
            self._referenced = False
            self._raw_plate = None

    @property
    def referenced(self) -> bool:
        """Whether the counters' origin is known."""
        return self._referenced

    @property
    def unreferenced_position(self) -> Position | None:
        """Where the carriages stand as the device counts, before any reference correction."""
        return None if self._raw_plate is None else self._profile.stage.position(self._raw_plate)

    @property
    def positions_heard(self) -> int:
        """How many complete positions were heard, refused for want of a reference or not."""
        return self._heard_positions

    @property
    def mark(self) -> tuple[int, int]:
        """What was asked and heard until now, for `read_since`."""
        return self._cycle, self._heard_positions

    def read_since(self, mark: tuple[int, int]) -> bool:
        """Say whether `unreferenced_position` was measured after a `mark` was taken.

        Of a device that is asked, it answers a request that left after it; of another, two
        positions have come since, as the first may have been under way.
        """
        if self._profile.poll is not None:
            return self._heard_cycle is not None and self._heard_cycle > mark[0]
        return self._heard_positions > mark[1] + 1

    @property
    def shift(self) -> Position:
        """By how much the counters are moved [mm]."""
        return self._profile.stage.position(self._shift)

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
        if self._raw_plate is None:
            raise InputError("no position was heard yet: there is nothing to refer to")
        target = self._profile.stage.plates(known)
        self._shift = tuple(
            wanted - raw for wanted, raw in zip(target, self._raw_plate, strict=True)
        )
        self._referenced = True
        return self._profile.stage.position(self._shift)

    def confirm_reference(self) -> None:
        """Take the counters as they are: they kept their origin."""
        self._referenced = True

    # -- to the device --------------------------------------------------------------------

    def poll_request(self) -> bytes:
        """Return the bytes that ask for a position.

        Raises
        ------
        InputError
            When the device speaks by itself.
        """
        if self._profile.poll is None:
            raise InputError(f"{self._profile.id} cannot be asked: it speaks by itself")
        return self._profile.poll.request

    def drive_command(self, position: Position) -> bytes:
        """Return the bytes that drive the plates.

        Parameters
        ----------
        position
            Target [mm], plate coordinates; of a mono comparator xl, yl count.

        Returns
        -------
        bytes
            Command with checksum and terminator.

        Raises
        ------
        InputError
            When there is no drive, the counters are unreferenced, or the target is outside
            the limits.
        """
        drive = self._profile.drive
        if drive is None:
            raise InputError(f"{self._profile.id} has no drive: move the plates by hand")
        if not self._referenced:
            raise InputError(UNREFERENCED)
        plate = self._profile.stage.plates(position)
        if not all(map(math.isfinite, plate)):
            raise InputError("the target of a drive is not a number")
        raw = tuple(value - shift for value, shift in zip(plate, self._shift, strict=True))
        values: dict[str, float] = {}
        for name, value in zip(self._names, self._profile.stage.to_axes(raw), strict=True):
            low, high = drive.limits[name]
            if not low <= value <= high:
                raise InputError(
                    f"axis {name} cannot be driven to {value:.3f} mm: "
                    f"its limits are {low:g} and {high:g} mm"
                )
            axis = self._profile.axes[name]
            values[name] = value * axis.direction / axis.scale
        return self._command(drive.command.render(values))

    def stop_command(self) -> bytes:
        """Return the bytes that stop a drive.

        Raises
        ------
        InputError
            When there is no drive.
        """
        if self._profile.drive is None:
            raise InputError(f"{self._profile.id} has no drive: there is nothing to stop")
        return self._command(self._profile.drive.stop.render({}))

    def _command(self, payload: bytes) -> bytes:
        checksum = self._profile.checksum
        if checksum is not None and checksum.host:
            payload += checksum.digits(payload)
        drive = self._profile.drive
        return payload + (drive.terminator if drive else b"")

    # -- records --------------------------------------------------------------------------

    def _decode(self, frame: bytes, now: float, link: str) -> Iterable[Reading]:
        self._notes.clear()
        try:
            payload = self._verified(frame, link)
            for record in self._profile.records.values():
                if link not in record.links or len(payload) > record.max_bytes:
                    continue
                match = record.pattern.fullmatch(payload)
                if match is not None:
                    readings = self._understood(record, match, frame, now, link)
                    return [*self._notes, *readings]
            raise RefusedError(f"no record of {self._profile.id}")
        except RefusedError as refusal:
            self._framers[link].lose_sync()
            return [*self._notes, *self._refuse(frame, str(refusal))]

    def _refuse(self, frame: bytes, reason: str) -> list[Reading]:
        """Refuse a record; a press that waited for it is refused with it."""
        return [Refused(frame, reason), *self._presses.refuse(reason)]

    def _verified(self, frame: bytes, link: str) -> bytes:
        """Return the record without its checksum."""
        checksum = self._profile.checksum
        if checksum is None:
            return frame
        bare = frame.rstrip(b"\r")
        length = checksum.length
        payload, digits = bare[:-length], bare[-length:]
        if len(digits) < length or digits[:1] != checksum.marker:
            if checksum.required or link in self._checksummed:
                raise RefusedError("the checksum is missing")
            return bare
        if checksum.marker + digits[1:].upper() != checksum.digits(payload):
            raise RefusedError("the checksum is wrong")
        self._checksummed.add(link)
        return payload

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
        if not self._confirmed(record, frame, now, link):
            return []
        switch, number = "", None
        if record.kind == "record":
            # the number counts even when the record is refused for what it says
            switch = self._switch_of(record, match)
            number = self._numbered(match, now)
        self._check_faults(record, match)
        values = self._axis_values(record, match, link)
        if record.kind == "in-position":
            place = self._reading(values) if values and self._referenced else None
            return [InPosition(place)]
        if record.kind == "record":
            if values:
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
            reason = "a position came that was not asked for"
            self._notes += self._presses.refuse_all(reason, own=False)
        return request

    def _confirmed(self, record: RecordFormat, frame: bytes, now: float, link: str) -> bool:
        if record.confirm == 1:
            return True
        key = (link, record.name)
        begun = self._confirming.get(key)
        if begun is None or now - begun.last > record.confirm_within:
            self._confirming[key] = _Confirming(frame, 1, now)
            return False
        if begun.frame != frame:
            self._confirming[key] = _Confirming(frame, 1, now)
            if self._pressed_for_each:
                raise RefusedError("differs from the one before it: press again")
            return False
        begun.count += 1
        begun.last = now
        if begun.count < record.confirm:
            return False
        del self._confirming[key]
        return True

    @staticmethod
    def _check_faults(record: RecordFormat, match: re.Match[bytes]) -> None:
        for group, meanings in record.faults.items():
            value = match.group(group)
            if value is not None and value in meanings:
                raise RefusedError(meanings[value])

    def _axis_values(
        self, record: RecordFormat, match: re.Match[bytes], link: str
    ) -> dict[str, float]:
        factor = 1.0
        if record.units is not None:
            unit = match.group(record.unit_group) or b""
            if unit not in record.units:
                raise RefusedError(f'unknown unit "{plain(unit, 20)}"')
            factor = record.units[unit]
        values: dict[str, float] = {}
        for axis in self._profile.axes.values():
            if axis.link != link or record.name not in axis.records:
                continue
            raw = match.group(axis.group)
            if raw is None:
                raise RefusedError(f"axis {axis.name} has no value")
            value = axis_number(raw, axis) * factor * axis.scale * axis.direction
            if not axis.low <= value <= axis.high:
                raise RefusedError(
                    f"axis {axis.name} at {value:.4f} mm is outside its range "
                    f"{axis.low:g} to {axis.high:g} mm"
                )
            values[axis.name] = value
        return values

    def _reading(self, values: dict[str, float]) -> Position:
        """Return the plate position of a complete set of axes.

        Raises
        ------
        RefusedError
            When the counters' origin is not known.
        """
        self._values.update(values)
        self._raw_plate = self._profile.stage.to_plate(tuple(values[name] for name in self._names))
        self._heard_positions += 1
        if not self._referenced:
            raise RefusedError(UNREFERENCED)
        return self._profile.stage.position(
            tuple(raw + shift for raw, shift in zip(self._raw_plate, self._shift, strict=True))
        )

    def _numbered(self, match: re.Match[bytes], now: float) -> int | None:
        """Return the device's own number; one that came before is refused, a gap is told."""
        if "number" not in match.re.groupindex or match.group("number") is None:
            return None
        number = whole_number(match.group("number"))
        if number is None:
            raise RefusedError("the record's number is none")
        fault = self._numbering.take(number, match.group(0))
        if fault is not None:
            self._notes.append(fault)
            if fault.code == "restarted":
                self._lose_reference()
        return number

    def _switch_of(self, record: RecordFormat, match: re.Match[bytes]) -> str:
        """Return the footswitch whose value the record holds."""
        for switch in self._profile.footswitches.values():
            if switch.source != "record" or switch.record != record.name:
                continue
            if not switch.group or match.group(switch.group) == switch.value:
                return switch.name
        raise RefusedError("no footswitch of the profile")

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
        readout = ReadOut(complete, self._reading(complete), now, cycle)
        switches = self._profile.footswitches.values()
        every = [switch.name for switch in switches if switch.source == "every"]
        begun = [switch.name for switch in switches if self._held(switch, record, match)]
        held = {name for name, down in self._pressed.items() if down}
        return [readout.position, *self._presses.read(readout, every, begun, held)]

    def _lose_reference(self) -> None:
        """Take it that the counters' origin is lost; those of an absolute device keep theirs."""
        if self._profile.incremental:
            self._referenced = False
            self._notes += self._presses.refuse_all(UNREFERENCED)

    def _held(self, switch: Footswitch, record: RecordFormat, match: re.Match[bytes]) -> bool:
        """Say whether a switch told within a position counts as pressed now."""
        if switch.source != "record" or switch.record != record.name:
            return False
        down = match.group(switch.group) == switch.value
        before = self._pressed.get(switch.name, False)
        self._pressed[switch.name] = down
        return down and not (switch.edge and before)

    def _let_go(self, link: str, pause: float) -> None:
        """Let go of the keys of a link after a pause on the line."""
        for switch in self._profile.footswitches.values():
            if (
                switch.release is not None
                and pause >= switch.release
                and link in self._profile.records[switch.record].links
            ):
                self._pressed[switch.name] = False


def check_examples(profile: Profile) -> list[str]:
    """Decode a profile's examples and compare.

    Parameters
    ----------
    profile
        With its examples.

    Returns
    -------
    list of str
        One line for each example that means something else; empty when all are right.
    """
    problems: list[str] = []
    for at, example in enumerate(profile.examples, 1):
        # what its records say by themselves: no example has read-outs around it
        decoder = Decoder(replace(profile, confirm=False))
        readings = decoder.feed(example.data, 0.0, example.link)
        got = [_described(profile, reading) for reading in readings]
        wanted: list[str] = []
        for meaning in example.meanings:
            if meaning.kind == "axes":
                for name, value in (meaning.axes or {}).items():
                    heard = decoder.axes.get(name)
                    if heard is None or abs(heard - value) > 5e-7:
                        shown = "nothing" if heard is None else f"{heard:.6f}"
                        problems.append(f"example {at}: axis {name} is {shown}, not {value:.6f}")
            else:
                wanted.append(
                    _line(
                        meaning.kind,
                        meaning.position,
                        meaning.switch,
                        meaning.number,
                        meaning.text,
                    )
                )
        for index in range(max(len(got), len(wanted))):
            have = got[index] if index < len(got) else "nothing"
            want = wanted[index] if index < len(wanted) else "nothing"
            if have != want and not (want.startswith("refused") and _refused_as(have, want)):
                problems.append(f"example {at}: it means {have}, not {want}")
    return problems


def _refused_as(have: str, want: str) -> bool:
    return have.startswith("refused") and want.removeprefix("refused ") in have


def _described(profile: Profile, reading: Reading) -> str:
    def plate(position: Position | None) -> tuple[float, ...]:
        return () if position is None else profile.stage.plates(position)

    match reading:
        case Position():
            return _line("position", plate(reading))
        case Record(position, switch, number):
            return _line("record", plate(position), switch, number)
        case InPosition(position):
            return _line("in-position", plate(position))
        case Fault(code):
            return _line("fault", text=code)
        case Refused(_, reason):
            return _line("refused", text=reason)


def _line(
    kind: str,
    position: tuple[float, ...] = (),
    switch: str = "",
    number: int | None = None,
    text: str = "",
) -> str:
    parts = [kind]
    if number is not None:
        parts.append(f"number {number}")
    if switch:
        parts.append(f"of {plain(switch, 40)}")
    if position:
        parts.append("at " + " ".join(f"{value + 0.0:.6f}" for value in position))
    if text:
        parts.append(plain(text, 120))
    return " ".join(parts)
