"""The device's own count of presses: what came twice, what is missing, and a restart."""

from __future__ import annotations

from collections import deque

from anaplot.plotter.readings import Fault
from anaplot.plotter.refusal import RefusedError

__all__ = ["MAX_NUMBER", "Numbering"]

MAX_NUMBER = 999_999
_REMEMBERED = 16
_NEAR = 16  # numbers about the end of the count, from where it goes on with 1


class Numbering:
    """Follows the numbers that a device gives its presses.

    Parameters
    ----------
    incremental
        Whether a device that restarted has lost its counters' origin.
    strict
        False for the rules of sessions recorded with version 0.1: a number below the last one was
        a restart only when it was 1.
    """

    def __init__(self, *, incremental: bool, strict: bool = True) -> None:
        self._incremental = incremental
        self._strict = strict
        self._last: int | None = None
        self._records: deque[tuple[int, bytes]] = deque(maxlen=_REMEMBERED)

    def forget(self) -> None:
        """Forget the count: the line was opened anew."""
        self._last = None
        self._records.clear()

    def take(self, number: int, record: bytes) -> Fault | None:
        """Take the next number.

        Parameters
        ----------
        number
            What the device says.
        record
            The whole record: number and position.

        Returns
        -------
        Fault or None
            Records that are missing, or a restart (code "restarted").

        Raises
        ------
        RefusedError
            The record came before.
        """
        last = self._last
        if last is None:
            fault = None
        elif self._strict:
            fault = self._after(last, number, record)
        else:
            fault = self._as_before(last, number)
        self._last = number
        self._records.append((number, record))
        return fault

    def _after(self, last: int, number: int, record: bytes) -> Fault | None:
        if (number, record) in self._records:
            raise RefusedError(f"record {number} came twice")
        wrapped = last > MAX_NUMBER - _NEAR and number <= _NEAR
        if number > last or wrapped:
            return _missing(last, number, number - last - 1 + (MAX_NUMBER if wrapped else 0))
        # whoever counts on from below has begun anew
        self._records.clear()
        return self._restarted()

    def _as_before(self, last: int, number: int) -> Fault | None:
        if number == last or (number < last and number != 1 and last < MAX_NUMBER):
            raise RefusedError(f"record {number} came twice")
        if number <= 1 < last:
            return self._restarted() if last < MAX_NUMBER else None
        return _missing(last, number, number - last - 1)

    def _restarted(self) -> Fault | None:
        return Fault("restarted", "the device has restarted") if self._incremental else None


def _missing(last: int, number: int, count: int) -> Fault | None:
    if count <= 0:
        return None
    first, end = last % MAX_NUMBER + 1, (number - 2) % MAX_NUMBER + 1
    words = f"record {first}" if count == 1 else f"records {first} to {end}"
    return Fault("missing", f"{words} did not arrive")
