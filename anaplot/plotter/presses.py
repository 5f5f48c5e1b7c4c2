"""Which read-out a press of a switch means."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from anaplot.plotter.readings import Reading, Record, Refused
from anaplot.plotter.readout import ReadOut
from anaplot.plotter.schema import Poll
from anaplot.plotter.text import safe_text

__all__ = ["Presses"]

_PATIENCE = 1.0  # s that a press waits for its read-out
_TIMEOUTS = 4.0  # or so many timeouts, if that is longer and a request has left after it
_STALL = 0.5  # s without a read-out after which a device that speaks by itself has stood still


@dataclass(slots=True)
class _Press:
    """A switch that waits for a read-out taken after it was pressed."""

    switch: str
    when: float
    cycle: int
    heard: int


class Presses:
    """Decides which read-out becomes a record.

    A device that is asked: the answer to a request that left after the press. Another one: the
    second read-out after the press, as the first may have been under way; and none around a pause
    in its stream, as whatever held it up may deliver old read-outs afterwards.

    Parameters
    ----------
    poll
        How the device is asked, or None.
    strict
        False for the rules of sessions recorded with version 0.1: a stream that stood still was
        not noticed then.
    """

    def __init__(self, poll: Poll | None, *, strict: bool = True) -> None:
        self._asked = poll is not None
        self._strict = strict
        slow = 0.0 if poll is None or not strict else _TIMEOUTS * poll.timeout
        self._patience = (_PATIENCE, max(_PATIENCE, slow))
        self._pending: list[_Press] = []
        self._cycle = 0
        self._heard = 0
        self._last: float | None = None
        self._stalled = float("-inf")

    @property
    def waiting(self) -> bool:
        """Whether a press waits for a read-out."""
        return bool(self._pending)

    def begun(self, cycle: int) -> None:
        """Take notice that a cycle of requests has begun."""
        self._cycle = cycle

    def press(self, switch: str, now: float) -> None:
        """Take a press; an earlier one of the same switch that still waits counts no more."""
        self._pending = [press for press in self._pending if press.switch != switch]
        self._pending.append(_Press(switch, now, self._cycle, self._heard))

    def read(self, readout: ReadOut, pressed: Collection[str]) -> list[Reading]:
        """Take a read-out.

        Parameters
        ----------
        readout
            All axes.
        pressed
            Switches that the read-out itself tells as pressed just now.

        Returns
        -------
        list of Reading
            Records, and refusals of presses that cannot be matched.
        """
        readings: list[Reading] = []
        if not self._asked:
            readings += self._after_a_pause(readout.when)
        readings += [Record(readout.position, switch) for switch in pressed]
        due = [press for press in self._pending if self._counts(press, readout)]
        readings += [Record(readout.position, press.switch) for press in due]
        self._pending = [press for press in self._pending if press not in due]
        self._heard += 1
        self._last = readout.when
        return readings

    def _counts(self, press: _Press, readout: ReadOut) -> bool:
        if self._asked:
            return readout.cycle is not None and readout.cycle > press.cycle
        return self._heard > press.heard

    def _after_a_pause(self, now: float) -> list[Refused]:
        """Refuse presses about a pause of the stream: the read-outs may be from before it."""
        if not self._strict:
            return []
        if self._last is not None and now - self._last > _STALL:
            self._stalled = now
        late = [press for press in self._pending if press.when <= self._stalled + _STALL]
        self._pending = [press for press in self._pending if press not in late]
        return [_not_recorded(press.switch, "the line stood still: press again") for press in late]

    def refuse(self, reason: str) -> list[Refused]:
        """Refuse every press that waits."""
        refused = [_not_recorded(press.switch, reason) for press in self._pending]
        self._pending.clear()
        return refused

    def expire(self, now: float) -> list[Refused]:
        """Refuse presses that have waited too long."""
        late = [
            press
            for press in self._pending
            if now - press.when > self._patience[self._cycle > press.cycle]
        ]
        self._pending = [press for press in self._pending if press not in late]
        return [_not_recorded(press.switch, "no position came after it") for press in late]

    def forget(self) -> None:
        """Forget everything: the line was opened anew."""
        self._pending.clear()
        self._last = None


def _not_recorded(switch: str, reason: str) -> Refused:
    return Refused(b"", f"{safe_text(switch, 40)} was not recorded: {reason}")
