"""From the axes that arrive one by one to whole read-outs of the instrument."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from anaplot.plotter.readings import Position

__all__ = ["AxesReadOut", "Gatherer"]


@dataclass(frozen=True, slots=True)
class AxesReadOut:
    """All axes at once.

    Attributes
    ----------
    values
        Axis -> value as the device counts [mm].
    position
        The same as plate coordinates.
    when
        When it was complete [s].
    cycle
        Of a device that is asked: of the request that it answers; None when it was not asked.
    """

    values: Mapping[str, float]
    position: Position
    when: float
    cycle: int | None


class Gatherer:
    """Puts the axes of one cycle together.

    Parameters
    ----------
    count
        How many axes make a read-out.
    within
        Axes belong together when heard within so many seconds.
    """

    def __init__(self, count: int, within: float) -> None:
        self._count = count
        self._within = within
        self._parts: dict[int | None, dict[str, tuple[float, float]]] = {}

    def forget(self) -> None:
        """Forget what was begun."""
        self._parts.clear()

    def begun(self) -> None:
        """Forget what was said unasked: a cycle begins."""
        self._parts.pop(None, None)

    def add(
        self, values: Mapping[str, float], cycle: int | None, now: float
    ) -> dict[str, float] | None:
        """Take the axes of one record.

        Parameters
        ----------
        values
            Axis -> value [mm].
        cycle
            To which they belong.
        now
            When they came [s].

        Returns
        -------
        dict or None
            Every axis, when this makes a cycle complete; older cycles are then given up.
        """
        for key in list(self._parts):
            part = self._parts[key]
            self._parts[key] = {n: v for n, v in part.items() if now - v[1] <= self._within}
            if not self._parts[key]:
                del self._parts[key]
        part = self._parts.setdefault(cycle, {})
        part.update((name, (value, now)) for name, value in values.items())
        if len(part) < self._count:
            return None
        self._parts = {
            key: rest
            for key, rest in self._parts.items()
            if key is not None and cycle is not None and key > cycle
        }
        return {name: value for name, (value, _) in part.items()}
