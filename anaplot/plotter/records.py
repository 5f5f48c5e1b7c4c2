"""Which record of a profile a frame is, and what it says."""

from __future__ import annotations

import re
from dataclasses import dataclass

from anaplot.plotter.refusal import RefusedError
from anaplot.plotter.schema import Profile, RecordFormat
from anaplot.plotter.values import axis_number, whole_number
from anaplot.textfiles.wording import plain

__all__ = ["RecordReader"]


@dataclass(slots=True)
class _Confirming:
    """Equal records counted so far."""

    frame: bytes
    count: int
    last: float


class RecordReader:
    """Reads the records of a profile.

    It remembers which links send checksums, and how many equal records have come in a row. What is
    wrong with a record is a `RefusedError`.

    Parameters
    ----------
    profile
        The device.
    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._checksummed: set[str] = set()
        self._confirming: dict[tuple[str, str], _Confirming] = {}
        self._pressed_for_each = any(
            switch.source == "every" for switch in profile.footswitches.values()
        )

    def forget(self, link: str) -> None:
        """Start afresh on a link that was lost."""
        self._checksummed.discard(link)
        self._confirming.clear()

    def read(self, frame: bytes, link: str) -> tuple[RecordFormat, re.Match[bytes]]:
        """Return the record that a frame is, its checksum verified, and its groups.

        Raises
        ------
        RefusedError
            The checksum is wrong or missing, or there is no such record.
        """
        payload = self._verified(frame, link)
        for record in self._profile.records.values():
            if link not in record.links or len(payload) > record.max_bytes:
                continue
            match = record.pattern.fullmatch(payload)
            if match is not None:
                return record, match
        raise RefusedError(f"no record of {self._profile.id}")

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

    def confirmed(self, record: RecordFormat, frame: bytes, now: float, link: str) -> bool:
        """Return whether a record has come as often in a row as it must.

        Raises
        ------
        RefusedError
            It differs from the one before it, and each is a press.
        """
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
    def check_faults(record: RecordFormat, match: re.Match[bytes]) -> None:
        """Refuse a record in which the device reports a fault."""
        for group, meanings in record.faults.items():
            value = match.group(group)
            if value is not None and value in meanings:
                raise RefusedError(meanings[value])

    def axis_values(
        self, record: RecordFormat, match: re.Match[bytes], link: str
    ) -> dict[str, float]:
        """Return the values [mm] of the axes that a record holds.

        Raises
        ------
        RefusedError
            An unknown unit, or an axis without value or outside its range.
        """
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

    def switch_of(self, record: RecordFormat, match: re.Match[bytes]) -> str:
        """Return the footswitch whose value a record holds.

        Raises
        ------
        RefusedError
            The profile has no such footswitch.
        """
        for switch in self._profile.footswitches.values():
            if switch.source != "record" or switch.record != record.name:
                continue
            if not switch.group or match.group(switch.group) == switch.value:
                return switch.name
        raise RefusedError("no footswitch of the profile")

    @staticmethod
    def number_of(match: re.Match[bytes]) -> int | None:
        """Return the device's own number of a record, or None where it has none.

        Raises
        ------
        RefusedError
            It is no number.
        """
        if "number" not in match.re.groupindex or match.group("number") is None:
            return None
        number = whole_number(match.group("number"))
        if number is None:
            raise RefusedError("the record's number is none")
        return number
