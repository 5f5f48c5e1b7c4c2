"""The bytes that a simulated device has sent, on their way: timing and faults of its lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from anaplot.errors import InputError
from anaplot.plotter.device.faults import (
    FRAME_FAULTS,
    LASTING_FAULTS,
    check_fault,
    damaged,
    garbled,
    struck,
)
from anaplot.plotter.schema import Profile

__all__ = ["SLOWER", "Outgoing"]

SLOWER = 50.0
"""So many times longer every byte takes on a slow line."""


@dataclass(slots=True)
class _Outbox:
    """Bytes waiting for their time on one link."""

    waiting: list[tuple[float, bytes]] = field(default_factory=list)
    free: float = 0.0
    frames: int = 0
    once: list[str] = field(default_factory=list)
    lasting: dict[str, float] = field(default_factory=dict)

    def lasts(self, name: str, now: float) -> bool:
        """Say whether a lasting fault is still on."""
        return self.lasting.get(name, -1.0) > now

    def empty(self, now: float) -> None:
        """Lose what is under way."""
        self.waiting.clear()
        self.free = now


class Outgoing:
    """The lines from a device to the host.

    Parameters
    ----------
    profile
        The device.
    seed, fault_rates, fault_seconds
        See `SimulatedPlotter`.
    """

    def __init__(
        self, profile: Profile, seed: int, fault_rates: Mapping[str, float], fault_seconds: float
    ) -> None:
        self._profile = profile
        self._seed = seed
        self._fault_seconds = fault_seconds
        self._lines = {name: _Outbox() for name in profile.links}
        self._cuts: list[tuple[str, float]] = []
        self._rates: dict[str, float] = {}
        self.set_fault_rates(fault_rates)

    def set_fault_rates(self, rates: Mapping[str, float]) -> None:
        """Set the probabilities of faults; see `SimulatedPlotter.set_fault_rates`."""
        for name, rate in rates.items():
            check_fault(name)
            if not 0.0 <= rate <= 1.0:
                raise InputError(f'the rate of "{name}" must lie between 0 and 1')
        self._rates = dict(rates)

    def inject(self, fault: str, link: str | None, seconds: float | None, now: float) -> None:
        """Have a fault strike once; see `SimulatedPlotter.inject`."""
        check_fault(fault)
        if link is not None and link not in self._lines:
            raise InputError(f'{self._profile.id} has no link "{link[:40]}"')
        for name in self._lines if link is None else (link,):
            if fault in FRAME_FAULTS:
                self._lines[name].once.append(fault)
            else:
                self._begin(fault, name, self._fault_seconds if seconds is None else seconds, now)

    def take_cuts(self) -> list[tuple[str, float]]:
        """Return links to be broken now, with the simulated seconds until they are mended."""
        cuts, self._cuts = self._cuts, []
        return cuts

    def frozen(self, link: str, now: float) -> bool:
        """Return whether nothing goes over a link, in either direction."""
        return self._lines[link].lasts("freeze", now)

    def empty(self, now: float) -> None:
        """Lose what is under way on every link."""
        for line in self._lines.values():
            line.empty(now)

    def send(self, link: str, data: bytes, now: float) -> None:
        """Put a record on its way."""
        data = self._through_faults(link, data, now)
        if not data:
            return
        simulate, settings, line = (
            self._profile.simulate,
            self._profile.links[link],
            self._lines[link],
        )
        begin = max(now + simulate.latency, line.free)
        slow = line.lasts("slow", now)
        if not simulate.byte_timing and not slow:
            line.free = begin
            line.waiting.append((begin, data))
            return
        settings = self._profile.links[link]
        per_byte = settings.bits_per_byte / settings.baud * (SLOWER if slow else 1.0)
        for at in range(len(data)):
            line.waiting.append((begin + (at + 1) * per_byte, data[at : at + 1]))
        line.free = begin + len(data) * per_byte

    def take(self, link: str, now: float) -> bytes:
        """Return the bytes whose time has come, once."""
        waiting = self._lines[link].waiting
        ready = next((n for n, (when, _) in enumerate(waiting) if when > now), len(waiting))
        data = b"".join(part for _, part in waiting[:ready])
        del waiting[:ready]
        return data

    def next_time(self) -> float | None:
        """Return when the next bytes are there, or None."""
        times = [line.waiting[0][0] for line in self._lines.values() if line.waiting]
        return min(times, default=None)

    def _begin(self, fault: str, link: str, seconds: float, now: float) -> None:
        self._lines[link].lasting[fault] = now + seconds
        if fault == "disconnect":
            self._lines[link].empty(now)
            self._cuts.append((link, seconds))

    def _through_faults(self, link: str, data: bytes, now: float) -> bytes:
        """Return what a record becomes on its way."""
        line, settings = self._lines[link], self._profile.links[link]
        line.frames += 1
        names, generator = struck(self._rates, self._seed, line.frames)
        names += line.once
        line.once = []
        for name in names:
            if name in LASTING_FAULTS:
                self._begin(name, link, self._fault_seconds, now)
            else:
                data = damaged(name, data, settings, generator)
        if line.lasts("freeze", now) or line.lasts("disconnect", now):
            return b""
        if line.lasts("wrong-baud", now):
            return garbled(data, settings, generator)
        return data
