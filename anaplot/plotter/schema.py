"""A device profile, once read: what an instrument says and understands."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from anaplot.plotter.readings import Position
from anaplot.plotter.template import Template

__all__ = [
    "AxisFormat",
    "Checksum",
    "DriveFormat",
    "Encoding",
    "Example",
    "Footswitch",
    "Framing",
    "LineSettings",
    "Meaning",
    "Poll",
    "Profile",
    "RecordFormat",
    "Simulate",
    "Stage",
    "pressed_only",
]

Encoding = Literal["decimal", "integer", "hex", "bits6", "bits7", "int-le", "int-be"]


@dataclass(frozen=True, slots=True)
class LineSettings:
    """One cable: ``[link.NAME]``; its address is the user's and never in the profile.

    Attributes
    ----------
    name
        Of the link.
    baud, bytesize, parity, stopbits, flow
        As on the device's page: parity none, even, odd, mark or space; flow none, rtscts or
        xonxoff.
    silence
        Seconds without a valid record after which the link counts as silent. None: four timeouts
        of a link that is polled, 2 s at least; never of a device that speaks when something
        happens.
    """

    name: str
    baud: int = 9600
    bytesize: int = 8
    parity: str = "none"
    stopbits: float = 1
    flow: str = "none"
    silence: float | None = None

    @property
    def bits_per_byte(self) -> float:
        """Bits on the wire for one byte, start and stop bits included."""
        return 1 + self.bytesize + (self.parity != "none") + self.stopbits


@dataclass(frozen=True, slots=True)
class Framing:
    """How bytes become records: ``[framing]``.

    Attributes
    ----------
    kind
        line: up to a terminator; fixed: `length` bytes after a pause; sync-bit: `length` bytes,
        the first one with bit 7 set and no other.
    terminator
        Ends a line.
    max_bytes
        Longest record.
    gap
        A pause [s] that ends whatever was begun, or None.
    length
        Bytes of a fixed or sync-bit record.
    lines
        Lines that make one record.
    joined
        How the first bytes after opening are taken: as the start of a record ("start"), or
        as the rest of one whose start was missed ("middle").
    """

    kind: Literal["line", "fixed", "sync-bit"]
    terminator: bytes = b"\n"
    max_bytes: int = 80
    gap: float | None = None
    length: int = 0
    lines: int = 1
    joined: Literal["start", "middle"] = "start"


@dataclass(frozen=True, slots=True)
class Checksum:
    """Hexadecimal digits after a marker at the end of a record: ``[checksum]``.

    Attributes
    ----------
    kind
        Of the bytes before the marker: xor8 or sum8; crc8 (polynomial 0x07, start 0); crc16
        (CCITT, polynomial 0x1021, start 0xFFFF). Two digits, four of crc16.
    marker
        One byte.
    required
        Whether a record without is refused; otherwise the device decides, and once it has sent
        one, every record needs one.
    host
        Whether the host's commands carry one.
    """

    kind: Literal["xor8", "sum8", "crc8", "crc16"]
    marker: bytes = b"*"
    required: bool = False
    host: bool = True

    @property
    def length(self) -> int:
        """How many bytes marker and digits are."""
        return 5 if self.kind == "crc16" else 3

    def digits(self, payload: bytes) -> bytes:
        """Return marker and digits for a payload."""
        if self.kind == "crc16":
            return self.marker + b"%04X" % _crc(payload, 16, 0x1021, 0xFFFF)
        if self.kind == "crc8":
            return self.marker + b"%02X" % _crc(payload, 8, 0x07, 0)
        value = 0
        for byte in payload:
            value = (value ^ byte) if self.kind == "xor8" else (value + byte) & 0xFF
        return self.marker + b"%02X" % value


def _crc(data: bytes, bits: int, polynomial: int, start: int) -> int:
    """Return a cyclic redundancy check, highest bit first, neither reflected nor inverted."""
    value, top, mask = start, 1 << (bits - 1), (1 << bits) - 1
    for byte in data:
        value ^= byte << (bits - 8)
        for _ in range(8):
            value = ((value << 1) ^ polynomial if value & top else value << 1) & mask
    return value


@dataclass(frozen=True, slots=True)
class Poll:
    """How positions are asked for: ``[poll]``; without it the device speaks by itself.

    Attributes
    ----------
    request
        Bytes sent, as they are.
    links
        Where they are sent.
    timeout
        After this time [s] without an answer the next request is sent.
    period
        Smallest time [s] between requests.
    latency
        No answer comes later than this [s] after its request.
    """

    request: bytes
    links: tuple[str, ...]
    timeout: float = 0.5
    period: float = 0.04
    latency: float = 5.0


@dataclass(frozen=True, slots=True)
class RecordFormat:
    """One kind of record: ``[record.NAME]``.

    Attributes
    ----------
    name
        Of the record.
    kind
        position; record: a footswitch's message; in-position: a drive has ended; fault; ignore.
    links
        Where it comes from.
    pattern
        For the whole record without terminator and checksum.
    max_bytes
        Longest record of this kind.
    faults
        Group -> value -> what it means: the reading is refused with that reason.
    unit_group, units
        Group that names the unit, and millimetres per unit by its value.
    send
        How the simulated device writes it, or None.
    constants
        What `send` fills into groups that are no axis, number, switch, code or text.
    confirm, confirm_within
        So many equal records in a row make one reading, each at most so many seconds after
        the one before it: for lines with neither parity nor checksum.
    """

    name: str
    kind: Literal["position", "record", "in-position", "fault", "ignore"]
    links: tuple[str, ...]
    pattern: re.Pattern[bytes]
    max_bytes: int
    faults: Mapping[str, Mapping[bytes, str]]
    unit_group: str = ""
    units: Mapping[bytes, float] | None = None
    send: Template | None = None
    constants: Mapping[str, bytes] | None = None
    confirm: int = 1
    confirm_within: float = 2.0

    @property
    def groups(self) -> frozenset[str]:
        """Names of the pattern's groups."""
        return frozenset(self.pattern.groupindex)


@dataclass(frozen=True, slots=True)
class AxisFormat:
    """One measured axis of the machine: ``[axis.NAME]``.

    Attributes
    ----------
    name
        Of the axis.
    link
        Where it is read.
    records
        Records that carry it.
    group
        The pattern's group that holds it.
    encoding
        decimal (digits with or without a point), integer, hex, bits6 and bits7 (so many bits
        of each byte, lowest first), int-le, int-be (two's complement).
    scale
        Millimetres per unit of the device.
    direction
        1 or -1.
    low, high
        Range [mm] after scale and direction.
    incremental
        Whether its origin is lost with the power.
    still
        Read-outs of a carriage that stands still differ by no more than this [mm].
    fastest
        No carriage moves faster than this [mm/s]; None when nobody says.
    """

    name: str
    link: str
    records: tuple[str, ...]
    group: str
    encoding: Encoding = "decimal"
    scale: float = 1.0
    direction: int = 1
    low: float = -1000.0
    high: float = 1000.0
    incremental: bool = False
    still: float = 0.003
    fastest: float | None = None


@dataclass(frozen=True, slots=True)
class Stage:
    """The linear map from axes to plate coordinates: ``[stage]``.

    Attributes
    ----------
    mono
        One plate at a time (a mono comparator): two coordinates instead of four.
    axes
        Names of the axes, the columns of `matrix`.
    matrix
        Rows x', y', x'', y'' (or x, y): millimetres of plate per millimetre of axis.
    inverse
        Axis per plate millimetre.
    offset
        Added after the map [mm].
    within
        Axes that arrive one by one make a position only when heard within so many seconds.
    """

    mono: bool
    axes: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]
    inverse: tuple[tuple[float, ...], ...]
    offset: tuple[float, ...]
    within: float = 1.0

    def to_plate(self, axes: tuple[float, ...]) -> tuple[float, ...]:
        """Map axis values [mm] to plate coordinates [mm], both in the order of the stage."""
        return tuple(
            sum(factor * value for factor, value in zip(row, axes, strict=True) if factor) + shift
            for row, shift in zip(self.matrix, self.offset, strict=True)
        )

    def to_axes(self, plate: tuple[float, ...]) -> tuple[float, ...]:
        """Map plate coordinates [mm] to axis values [mm], both in the order of the stage."""
        shifted = [value - shift for value, shift in zip(plate, self.offset, strict=True)]
        return tuple(
            sum(factor * value for factor, value in zip(row, shifted, strict=True) if factor)
            for row in self.inverse
        )

    def plates(self, position: Position) -> tuple[float, ...]:
        """Return a position as the plate coordinates of this stage [mm]; of a mono one x', y'."""
        left = (position.xl, position.yl)
        return left if self.mono else (*left, position.xr, position.yr)

    def position(self, plates: tuple[float, ...]) -> Position:
        """Return plate coordinates [mm] as a position; those of a mono stage count for both."""
        return Position(*plates, *plates) if self.mono else Position(*plates)


@dataclass(frozen=True, slots=True)
class Footswitch:
    """What makes a position a measurement: ``[footswitch.NAME]``.

    Attributes
    ----------
    name
        Of the switch.
    source
        record: a message, or a value within one; every: each complete position is one;
        modem: a modem line; key: the keyboard alone.
    record, group, value
        Which record, and which value of which group; group "" means every such record.
    edge, release
        Only the change to the value counts, not its repetition; a pause of `release` seconds
        counts as letting go (None: only another value does).
    link, line, active, debounce
        The modem line cts, dsr, cd or ri, its level when pressed, and the time [s] within which
        further changes are the same press.
    """

    name: str
    source: Literal["record", "every", "modem", "key"]
    record: str = ""
    group: str = ""
    value: bytes = b""
    edge: bool = False
    release: float | None = None
    link: str = ""
    line: str = ""
    active: bool = True
    debounce: float = 0.05


def pressed_only(switches: Iterable[Footswitch], records: Mapping[str, RecordFormat]) -> bool:
    """Whether a device that is not asked tells positions only when something is pressed."""
    return any(
        switch.source == "every"
        or (switch.source == "record" and records[switch.record].kind == "position")
        for switch in switches
    )


@dataclass(frozen=True, slots=True)
class DriveFormat:
    """How the plates are driven: ``[drive]``; without it they are moved by hand.

    Attributes
    ----------
    link
        Where commands go.
    command, stop
        Templates; fields are axis names, in the device's units.
    terminator
        Ends a command.
    in_position
        The record that ends a drive.
    limits
        Axis -> smallest and largest target [mm].
    """

    link: str
    command: Template
    stop: Template
    terminator: bytes
    in_position: str
    limits: Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Simulate:
    """How the simulated device behaves: ``[simulate]``.

    Attributes
    ----------
    latency
        From request to the first byte of the answer [s].
    byte_timing
        Whether each byte takes its time at the link's baud rate.
    resolution_um, noise_um, backlash_um
        Of every axis.
    speed
        Of a driven carriage [mm/s].
    stream
        Period [s] at which positions are sent unasked; None for never. Unless told otherwise, a
        device that is neither asked nor speaks when a switch is pressed sends 25 a second.
    hold, hold_period
        A pressed key that is told within positions is told so many times, at this period [s].
    tells_release
        Whether one more position tells that the key was let go.
    """

    latency: float = 0.0
    byte_timing: bool = False
    resolution_um: float = 1.0
    noise_um: float = 0.0
    backlash_um: float = 0.0
    speed: float = 60.0
    stream: float | None = None
    hold: int = 3
    hold_period: float = 0.02
    tells_release: bool = True


@dataclass(frozen=True, slots=True)
class Meaning:
    """One thing that an example's bytes mean.

    Attributes
    ----------
    kind
        position, record, in-position, fault, refused or axes.
    position
        Plate coordinates [mm], two or four.
    axes
        Axis -> value [mm].
    switch, number
        Of a record.
    text
        Code of a fault, or a part of the reason of a refusal.
    """

    kind: Literal["position", "record", "in-position", "fault", "refused", "axes"]
    position: tuple[float, ...] = ()
    axes: Mapping[str, float] | None = None
    switch: str = ""
    number: int | None = None
    text: str = ""


@dataclass(frozen=True, slots=True)
class Example:
    """Bytes and what they mean: ``[[example]]``.

    Attributes
    ----------
    link
        Where the bytes come from.
    data
        As they come.
    meanings
        In order.
    """

    link: str
    data: bytes
    meanings: tuple[Meaning, ...]


@dataclass(frozen=True, slots=True)
class Profile:
    """A device profile of schema 1.

    Attributes
    ----------
    id, title, status, sources
        Name, one line about it, verified | from-manual | simulated, where it is from.
    links, records, axes, footswitches
        By name, in the file's order.
    framing, checksum, poll, stage, drive, simulate
        The other tables; None where the instrument has none.
    confirm
        Whether a measurement counts only when it lies between the read-outs around it.
    examples
        Checked by `check_examples`.
    text
        The file, as it stands.
    sha256
        Of the file, hexadecimal.
    origin
        The file's name as errors show it.
    """

    id: str
    title: str
    status: Literal["verified", "from-manual", "simulated"]
    sources: tuple[str, ...]
    links: Mapping[str, LineSettings]
    framing: Framing
    checksum: Checksum | None
    poll: Poll | None
    records: Mapping[str, RecordFormat]
    axes: Mapping[str, AxisFormat]
    stage: Stage
    footswitches: Mapping[str, Footswitch]
    drive: DriveFormat | None
    simulate: Simulate
    confirm: bool
    examples: tuple[Example, ...]
    text: str
    sha256: str
    origin: str

    @property
    def mono(self) -> bool:
        """Whether the instrument holds one plate at a time."""
        return self.stage.mono

    @property
    def incremental(self) -> bool:
        """Whether any axis loses its origin with the power."""
        return any(axis.incremental for axis in self.axes.values())

    @property
    def still(self) -> float:
        """By how much read-outs of plates that stand may differ, plate coordinates [mm]."""
        stills = [axis.still for axis in self.axes.values()]
        rows = self.stage.matrix
        return max(sum(abs(f) * s for f, s in zip(row, stills, strict=True)) for row in rows)

    @property
    def reads(self) -> bool:
        """Whether positions come that nobody pressed for: by themselves, or because it is asked."""
        if self.poll is not None:
            return True
        told = any(record.kind == "position" for record in self.records.values())
        return told and not pressed_only(self.footswitches.values(), self.records)

    @property
    def default_link(self) -> str:
        """The first link's name."""
        return next(iter(self.links))
