"""Counters that jump: read-outs further apart than any carriage could have gone meanwhile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from anaplot.plotter.refusal import RefusedError
from anaplot.plotter.schema import AxisFormat

__all__ = ["JumpWatch"]

_LONGEST = 0.25  # s that a carriage is given: a box that is silent for longer may have restarted


@dataclass(frozen=True, slots=True)
class _Standing:
    values: Mapping[str, float]
    since: float


class JumpWatch:
    """Compares each read-out with the one before it by the axes' `fastest`.

    One that is too far away may be damaged: it is refused. When the next one agrees with it, the
    counters have jumped.

    Parameters
    ----------
    axes
        The profile's axes.
    """

    def __init__(self, axes: Mapping[str, AxisFormat]) -> None:
        self._axes = [axis for axis in axes.values() if axis.fastest is not None]
        self._last: _Standing | None = None
        self._suspect: _Standing | None = None

    def forget(self) -> None:
        """Forget where the carriages were: the line was opened anew."""
        self._last = self._suspect = None

    def read(self, values: Mapping[str, float], since: float, now: float) -> bool:
        """Take a read-out.

        Parameters
        ----------
        values
            Axis -> value [mm].
        since, now
            It was taken between these times [s].

        Returns
        -------
        bool
            Whether the counters have jumped since the last but one.

        Raises
        ------
        RefusedError
            It is too far from the last one; the next one will tell.
        """
        here = _Standing(values, since)
        reason = self._impossible(self._last, values, now)
        if reason and (self._suspect is None or self._impossible(self._suspect, values, now)):
            self._suspect = here
            raise RefusedError(reason)
        self._last, self._suspect = here, None
        return bool(reason)

    def check(self, values: Mapping[str, float], now: float) -> None:
        """Refuse a record that is too far from the last read-out.

        Raises
        ------
        RefusedError
            Naming the axis.
        """
        if reason := self._impossible(self._last, values, now):
            raise RefusedError(reason)

    def _impossible(self, place: _Standing | None, values: Mapping[str, float], now: float) -> str:
        if place is None:
            return ""
        seconds = min(now - place.since, _LONGEST)
        for axis in self._axes:
            if axis.fastest is None:
                continue
            way = abs(values[axis.name] - place.values[axis.name])
            if way > axis.fastest * seconds + axis.still:
                return f"axis {axis.name} jumped by {way:.3f} mm: it moves {axis.fastest:g} mm/s"
        return ""
