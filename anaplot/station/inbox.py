"""What a station hears, put into one queue in the order in which it came."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from anaplot.plotter.readings import Position, Reading
from anaplot.session.heard import Heard, LinkChanged, MarkSet
from anaplot.session.requests import WarmUp

__all__ = ["End", "Inbox", "Item", "Told", "Traffic"]


@dataclass(frozen=True, slots=True)
class Traffic:
    """Bytes that came in or were sent."""

    direction: Literal["in", "out"]
    link: str
    data: bytes
    when: float


@dataclass(frozen=True, slots=True)
class Told:
    """What the decoder was told besides bytes."""

    kind: str
    text: str
    when: float


class End:
    """Ends the station thread."""


Item = Heard | Traffic | Told | WarmUp


_CROWDED = 200  # items waiting, from which on positions are left out: others will follow
_FULL = 2000  # items waiting, from which on the line is read no further


class Inbox:
    """Takes what the plotter says on whatever thread and puts everything into one queue, in order.

    The queue is bounded: when much is waiting, positions are left out, and then the line is not
    read (`room`). Records are never left out.
    """

    def __init__(self) -> None:
        self.items: queue.SimpleQueue[Item | End] = queue.SimpleQueue()
        # the time that the decoder was given: a journal that keeps it replays to the same readings
        self.time: Callable[[], float] = time.monotonic

    def on_reading(self, reading: Reading) -> None:
        """Take a decoded reading."""
        if isinstance(reading, Position) and self.items.qsize() >= _CROWDED:
            return
        self.items.put(reading)

    def room(self) -> bool:
        """Whether the line may be read on."""
        return self.items.qsize() < _FULL

    def on_link_state(self, state: str, detail: str) -> None:
        """Take the new state of the link."""
        self.items.put(LinkChanged(state, detail))

    def on_traffic(self, direction: Literal["in", "out"], link: str, data: bytes) -> None:
        """Bytes came in or were sent."""
        self.items.put(Traffic(direction, link, data, self.time()))

    def on_decoder(self, kind: str, text: str) -> None:
        """Take what the decoder was told besides bytes."""
        self.items.put(Told(kind, text, self.time()))

    def on_mark_set(self, mark: MarkSet) -> None:
        """Take it that the instrument has set the mark."""
        self.items.put(mark)
