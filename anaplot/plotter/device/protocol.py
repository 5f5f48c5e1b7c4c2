"""What a simulated device says and understands: values become bytes, and bytes commands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from anaplot.plotter.encoding import encode_value
from anaplot.plotter.schema import Footswitch, Profile, RecordFormat
from anaplot.plotter.template import Value

__all__ = ["Ask", "Command", "DeviceProtocol", "Halt", "MoveTo", "NotUnderstood"]

_MAX_COMMAND = 256
_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Ask:
    """The host asks for a position on a link."""

    link: str


@dataclass(frozen=True, slots=True)
class MoveTo:
    """The host wants the plates driven; `counts` are axis values [mm] as the device counts."""

    counts: tuple[float, ...]


class Halt:
    """The host stops a drive."""


class NotUnderstood:
    """A line that is no command."""


Command = Ask | MoveTo | Halt | NotUnderstood


class DeviceProtocol:
    """A profile's language, as the device speaks it.

    Parameters
    ----------
    profile
        The device.
    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._input = {name: bytearray() for name in profile.links}
        if profile.drive is not None:
            self._command = profile.drive.command.matcher()
            self._stop_payload = profile.drive.stop.render({})

    def forget(self) -> None:
        """Forget what was heard of a command so far."""
        for buffer in self._input.values():
            buffer.clear()

    # -- what it says ----------------------------------------------------------------------

    @property
    def carriers(self) -> list[RecordFormat]:
        """The records that tell positions, each once."""
        return [
            record
            for record in self._profile.records.values()
            if record.kind == "position" and record.send is not None
        ]

    @property
    def fault_record(self) -> RecordFormat | None:
        """The record that tells faults, or None."""
        records = self._profile.records.values()
        return next((record for record in records if record.kind == "fault"), None)

    def said(
        self,
        record: RecordFormat,
        counts: Mapping[str, float],
        number: int,
        switch: Footswitch | None = None,
        texts: Mapping[str, Value] | None = None,
    ) -> Iterator[tuple[str, bytes]]:
        """Yield a record as bytes, terminator included, for each of its links.

        Parameters
        ----------
        record
            Which.
        counts
            Axis -> what its encoder counts, in the device's units.
        number
            How many footswitches were told.
        switch
            The footswitch that it tells, or None.
        texts
            Further values by group.
        """
        if record.send is None:
            return
        for link in record.links:
            values: dict[str, Value] = dict(record.constants or {})
            carried = 0
            for axis in self._profile.axes.values():
                if axis.link == link and record.name in axis.records:
                    values[axis.group] = encode_value(axis, counts[axis.name])
                    carried += 1
            if not carried and record.kind == "position":
                continue
            values["number"] = number
            if switch is not None and switch.group and switch.record == record.name:
                values[switch.group] = switch.value
            values.update(texts or {})
            payload = record.send.render(values)
            if self._profile.checksum is not None:
                payload += self._profile.checksum.digits(payload)
            yield link, payload + self._profile.framing.terminator

    # -- what it understands ---------------------------------------------------------------

    def understood(self, data: bytes, link: str) -> Iterator[Command]:
        """Yield the commands that bytes from the host complete.

        Parameters
        ----------
        data
            What came.
        link
            Where.
        """
        buffer = self._input[link]
        buffer += data
        poll, drive = self._profile.poll, self._profile.drive
        while buffer:
            if poll is not None and link in poll.links and buffer.startswith(poll.request):
                del buffer[: len(poll.request)]
                yield Ask(link)
                continue
            if poll is not None and poll.request.startswith(bytes(buffer)):
                return
            if drive is None or link != drive.link:
                # drop bytes up to the next possible request
                at = buffer.find(poll.request[:1], 1) if poll is not None else -1
                del buffer[: at if at > 0 else len(buffer)]
                continue
            end = buffer.find(drive.terminator)
            if end < 0:
                if len(buffer) > _MAX_COMMAND:
                    buffer.clear()
                    yield NotUnderstood()
                return
            line = bytes(buffer[:end])
            del buffer[: end + len(drive.terminator)]
            yield self._read(line)

    def _read(self, line: bytes) -> Command:
        checksum = self._profile.checksum
        payload = line.rstrip(b"\r")
        if checksum is not None and checksum.host:
            bare = payload[: -checksum.length]
            if payload == bare + checksum.digits(bare):
                payload = bare
            elif checksum.required or checksum.marker in payload:
                return NotUnderstood()
        if payload == self._stop_payload:
            return Halt()
        match = self._command.fullmatch(payload)
        if match is None:
            return NotUnderstood()
        drive = self._profile.drive
        assert drive is not None
        try:
            return MoveTo(
                tuple(
                    drive.command.number(match, name) * axis.scale * axis.direction
                    for name, axis in self._profile.axes.items()
                )
            )
        except ValueError:
            return NotUnderstood()

    def within_travel(self, axes: tuple[float, ...]) -> bool:
        """Return whether axis values [mm] lie within the limits of the drive."""
        drive = self._profile.drive
        return drive is not None and all(
            drive.limits[name][0] - _TOLERANCE <= value <= drive.limits[name][1] + _TOLERANCE
            for name, value in zip(self._profile.axes, axes, strict=True)
        )
