"""Footswitches that a device tells within its positions: which are down, which went down."""

from __future__ import annotations

import re

from anaplot.plotter.schema import Profile, RecordFormat

__all__ = ["HeldKeys"]


class HeldKeys:
    """The footswitches that positions tell.

    Parameters
    ----------
    profile
        The device.
    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._down: dict[str, bool] = {}

    @property
    def down(self) -> set[str]:
        """Those that are down."""
        return {name for name, down in self._down.items() if down}

    def told(self, record: RecordFormat, match: re.Match[bytes]) -> list[str]:
        """Return the switches that a position says are pressed now."""
        begun = []
        for switch in self._profile.footswitches.values():
            if switch.source != "record" or switch.record != record.name:
                continue
            down = match.group(switch.group) == switch.value
            before = self._down.get(switch.name, False)
            self._down[switch.name] = down
            if down and not (switch.edge and before):
                begun.append(switch.name)
        return begun

    def paused(self, link: str, pause: float) -> None:
        """Let go of the keys of a link after a pause [s] on the line."""
        for switch in self._profile.footswitches.values():
            if (
                switch.release is not None
                and pause >= switch.release
                and link in self._profile.records[switch.record].links
            ):
                self._down[switch.name] = False

    def forget(self) -> None:
        """Take it that all are up."""
        self._down.clear()
