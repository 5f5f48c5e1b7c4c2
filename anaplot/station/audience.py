"""Who is shown snapshots and told notices, on whatever thread, and what is still to be told."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from anaplot.session.requests import Severity
from anaplot.station.snapshot import Snapshot

__all__ = ["Audience", "News", "Notice"]

_KEPT_NOTICES = 100  # for whoever listens first
_TABLE_FIRST = 0.05  # s

Notice = tuple[Severity, str]


class News:
    """What has happened since it was published last.

    Attributes
    ----------
    any
        Whether there is something to show or to tell.
    """

    def __init__(self) -> None:
        self.any = False
        self._notices: list[Notice] = []

    def tell(self, severity: Severity, text: str) -> None:
        """Keep a notice."""
        self._notices.append((severity, text))
        self.any = True

    def take(self) -> tuple[bool, list[Notice]]:
        """Return whether there is news, and the notices; there is none after that."""
        taken = self.any, self._notices
        self.any, self._notices = False, []
        return taken


class Audience:
    """Subscribers to snapshots, and listeners to notices."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._subscribers: list[Callable[[Snapshot], None]] = []
        self._listeners: list[Callable[[str, str], None]] = []
        self._kept: list[Notice] = []

    @property
    def pause(self) -> float:
        """Seconds that the block's adjustment lets go by: who looks waits for the model's table."""
        return _TABLE_FIRST if self._subscribers else 0.0

    def subscribe(self, callback: Callable[[Snapshot], None]) -> Callable[[], None]:
        """Call back with every new snapshot, from any thread; returns what ends it."""
        self._subscribers.append(callback)

        def end() -> None:
            if callback in self._subscribers:
                self._subscribers.remove(callback)

        return end

    def subscribe_notices(self, callback: Callable[[str, str], None]) -> Callable[[], None]:
        """Call back with (severity, line), from any thread; returns what ends it."""
        with self._lock:
            self._listeners.append(callback)
            waiting, self._kept = self._kept, []
        for severity, text in waiting:
            callback(severity, text)

        def end() -> None:
            if callback in self._listeners:
                self._listeners.remove(callback)

        return end

    def show(self, snapshot: Snapshot) -> None:
        """Show a new snapshot."""
        for subscriber in list(self._subscribers):
            subscriber(snapshot)

    def tell(self, notices: Sequence[Notice]) -> None:
        """Tell notices; they wait for the first who listens."""
        with self._lock:
            listeners = list(self._listeners)
            if not listeners:
                self._kept = [*self._kept, *notices][-_KEPT_NOTICES:]
        for severity, text in notices:
            for listener in listeners:
                listener(severity, text)
