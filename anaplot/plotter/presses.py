"""Which read-out a press of a switch means, and whether the read-outs around it agree."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from anaplot.plotter.readings import Reading, Record, Refused
from anaplot.plotter.readout import AxesReadOut
from anaplot.plotter.schema import AxisFormat, Poll
from anaplot.textfiles.wording import plain

__all__ = ["Presses"]

_PATIENCE = 1.0  # s that a press waits for its read-out
_TIMEOUTS = 4.0  # or so many timeouts, if that is longer and a request has left after it
_STALL = 0.5  # s without a read-out after which a device that speaks by itself has stood still
_AROUND = (
    0.5  # s (or two timeouts) by which the read-outs around a measurement may be apart from it
)
_APART = 5.0  # mm by which they may differ: further apart they confirm nothing
_ROUNDING = 1e-9


@dataclass(slots=True)
class _Press:
    """A switch that waits for a read-out taken after it was pressed.

    `held`: the read-outs themselves tell that it is down, and must go on to do so.
    """

    switch: str
    when: float
    cycle: int
    heard: int
    held: bool = False


@dataclass(frozen=True, slots=True)
class _Candidate:
    """What will be a measurement when the next read-out agrees.

    `own`: the record came with a position of its own.
    """

    record: Record
    values: Mapping[str, float]
    before: AxesReadOut
    when: float
    held: bool = False
    own: bool = False


class Presses:
    """Decides which read-out becomes a record.

    A device that is asked: the answer to a request that left after the press. Another one: the
    second read-out after the press, as the first may have been under way; and none around a pause
    in its stream, as whatever held it up may deliver old read-outs afterwards.

    Where no checksum tells damaged records, a measurement counts when on every axis it lies
    between the read-outs before and after it, give or take the axis' `still`. Where these are far
    apart, the next pair decides: then the carriage must have stood still since.

    Parameters
    ----------
    poll
        How the device is asked, or None.
    axes
        The profile's axes.
    confirm
        Whether read-outs are to confirm a measurement.
    strict
        False for the rules of sessions recorded with version 0.1: a stream that stood still was
        not noticed then.
    """

    def __init__(
        self,
        poll: Poll | None,
        axes: Mapping[str, AxisFormat],
        *,
        confirm: bool,
        strict: bool = True,
    ) -> None:
        self._asked = poll is not None
        self._axes = tuple(axes.values())
        self._confirm = confirm
        self._strict = strict
        slow = 0.0 if poll is None or not strict else poll.timeout
        self._patience = (_PATIENCE, max(_PATIENCE, _TIMEOUTS * slow))
        self._around = max(_AROUND, 2.0 * slow)
        self._pending: list[_Press] = []
        self._candidates: list[_Candidate] = []
        self._cycle = 0
        self._heard = 0
        self._last: AxesReadOut | None = None
        self._stalled = float("-inf")

    @property
    def waiting(self) -> bool:
        """Whether something waits for the next read-out."""
        return bool(self._pending or self._candidates)

    def begun(self, cycle: int) -> None:
        """Take notice that a cycle of requests has begun."""
        self._cycle = cycle

    def press(self, switch: str, now: float) -> None:
        """Take a press; an earlier one of the same switch that still waits counts no more."""
        self._pending = [press for press in self._pending if press.switch != switch]
        self._candidates = [c for c in self._candidates if c.own or c.record.switch != switch]
        self._pending.append(_Press(switch, now, self._cycle, self._heard))

    def read(
        self, readout: AxesReadOut, pressed: Collection[str], begun: Collection[str], held: set[str]
    ) -> list[Reading]:
        """Take a read-out.

        Parameters
        ----------
        readout
            All axes.
        pressed
            Switches of which every read-out is a press.
        begun, held
            Switches that the read-out tells as pressed: just now, and all that are down.

        Returns
        -------
        list of Reading
            Records, and refusals of presses that cannot be matched or confirmed.
        """
        readings: list[Reading] = []
        if not self._asked:
            readings += self._after_a_pause(readout.when)
        readings += self._unconfirmed(readout.when)
        candidates, self._candidates = self._candidates, []
        for candidate in candidates:
            readings += self._judged(candidate, readout, held)
        readings += [Record(readout.position, switch) for switch in pressed]
        for switch in begun:
            self._pending = [press for press in self._pending if press.switch != switch]
            self._pending.append(_Press(switch, readout.when, self._cycle, self._heard, held=True))
        waiting, self._pending = self._pending, []
        for press in waiting:
            if press.held and press.switch not in held:
                readings.append(_not_recorded(press.switch, "it was let go too early"))
            elif not press.held and not self._counts(press, readout):
                self._pending.append(press)
            else:
                readings += self._taken(press, readout)
        self._heard += 1
        self._last = readout
        return readings

    def _taken(self, press: _Press, readout: AxesReadOut) -> list[Reading]:
        record = Record(readout.position, press.switch)
        if not self._confirm:
            return [record]
        before = self._before(readout.when)
        if before is None:
            self._pending.append(press)  # this one is the read-out before the next
        else:
            self._candidates.append(
                _Candidate(record, readout.values, before, readout.when, press.held)
            )
        return []

    def recorded(self, record: Record, values: Mapping[str, float], now: float) -> list[Reading]:
        """Take a record with a position of its own.

        Parameters
        ----------
        record
            As the device says.
        values
            Axis -> value [mm].
        now
            When it came [s].

        Returns
        -------
        list of Reading
            The record, or nothing as long as the next read-out has not confirmed it.
        """
        if not self._confirm:
            return [record]
        before = self._before(now)
        if before is None:
            return [_not_recorded(record.switch, "no read-out came before it: press again")]
        self._candidates.append(_Candidate(record, values, before, now, own=True))
        return []

    def _before(self, now: float) -> AxesReadOut | None:
        last = self._last
        return last if last is not None and now - last.when <= self._around else None

    def _judged(self, candidate: _Candidate, after: AxesReadOut, held: set[str]) -> list[Reading]:
        record = candidate.record
        if candidate.held and record.switch not in held:
            return [_not_recorded(record.switch, "it was let go too early")]
        around = [
            (axis, candidate.before.values[axis.name], after.values[axis.name])
            for axis in self._axes
        ]
        if any(abs(one - other) > _APART for _, one, other in around):
            # one of them is damaged, or the carriage has only just arrived: the next pair tells
            self._candidates.append(replace(candidate, before=after))
            return []
        for axis, one, other in around:
            value, slack = candidate.values[axis.name], axis.still + _ROUNDING
            if not min(one, other) - slack <= value <= max(one, other) + slack:
                return [
                    _not_recorded(
                        record.switch,
                        f"axis {axis.name} at {value:.4f} mm is not between the read-outs around "
                        f"it ({one:.4f} and {other:.4f} mm): press again",
                    )
                ]
        return [record]

    def _counts(self, press: _Press, readout: AxesReadOut) -> bool:
        if self._asked:
            return readout.cycle is not None and readout.cycle > press.cycle
        return self._heard > press.heard

    def _after_a_pause(self, now: float) -> list[Refused]:
        """Refuse presses about a pause of the stream: the read-outs may be from before it."""
        if not self._strict:
            return []
        if self._last is not None and now - self._last.when > _STALL:
            self._stalled = now
        late = [press for press in self._pending if press.when <= self._stalled + _STALL]
        late = [press for press in late if not press.held]
        self._pending = [press for press in self._pending if press not in late]
        return [_not_recorded(press.switch, "the line stood still: press again") for press in late]

    def refuse(self, reason: str) -> list[Refused]:
        """Refuse every press that waits for its read-out."""
        refused = [_not_recorded(press.switch, reason) for press in self._pending]
        self._pending.clear()
        return refused

    def refuse_all(self, reason: str, *, own: bool = True) -> list[Refused]:
        """Refuse these and what waits to be confirmed; records of the device's `own` or not."""
        lost = [c for c in self._candidates if own or not c.own]
        self._candidates = [c for c in self._candidates if c not in lost]
        return [*self.refuse(reason), *(_not_recorded(c.record.switch, reason) for c in lost)]

    def expire(self, now: float) -> list[Refused]:
        """Refuse what has waited too long."""
        late = [
            press
            for press in self._pending
            if now - press.when > self._patience[self._cycle > press.cycle]
        ]
        self._pending = [press for press in self._pending if press not in late]
        return [
            *(_not_recorded(press.switch, "no position came after it") for press in late),
            *self._unconfirmed(now),
        ]

    def _unconfirmed(self, now: float) -> list[Refused]:
        """Refuse what was not confirmed in time: a read-out long after says nothing."""
        lost = [c for c in self._candidates if now - c.when > self._around]
        self._candidates = [c for c in self._candidates if c not in lost]
        return [_not_recorded(c.record.switch, "no read-out confirmed it") for c in lost]

    def forget(self) -> None:
        """Forget everything: the line was opened anew."""
        self._pending.clear()
        self._candidates.clear()
        self._last = None


def _not_recorded(switch: str, reason: str) -> Refused:
    return Refused(b"", f"{plain(switch, 40)} was not recorded: {reason}")
