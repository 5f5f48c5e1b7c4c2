"""A line that says much nonsense: refusals are told one by one up to a number a second."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.plotter.readings import UNREFERENCED, Reading, Refused

__all__ = ["RefusalCount"]

_MOST = 20  # a second that are told one by one
_SECOND = 1.0


class RefusalCount:
    """Lets everything pass but the refusals beyond a number a second; these are counted.

    A press that was refused is always told.
    """

    def __init__(self) -> None:
        self._since = float("-inf")
        self._told = self._counted = 0
        self._last = ""

    def sift(self, readings: Iterable[Reading], now: float) -> list[Reading]:
        """Take readings and return those to be told.

        Parameters
        ----------
        readings
            In order.
        now
            When [s]; a count is told when its second is over.
        """
        out: list[Reading] = []
        if now - self._since >= _SECOND:
            if self._counted:
                out.append(Refused(b"", f"{self._counted} more in a second, last: {self._last}"))
            self._since, self._told, self._counted = now, 0, 0
        for reading in readings:
            if not isinstance(reading, Refused) or not reading.raw:
                out.append(reading)
            elif self._told < _MOST:
                self._told += 1
                out.append(reading)
            elif reading.reason != UNREFERENCED:
                self._counted += 1
                self._last = reading.reason
        return out
