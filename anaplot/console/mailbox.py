"""What a station says, from any thread, kept until the screen has time for it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from threading import Lock

from anaplot.station.snapshot import Snapshot

__all__ = ["Mailbox", "Notice"]

Notice = tuple[str, str]


class Mailbox:
    """The newest snapshot and the notices since the last look.

    However much arrives, the owner is woken once until it has looked: a thousand snapshots cost
    one repaint. Of the notices the newest `keep` stay.

    Parameters
    ----------
    wake
        Called in the thread that brings something, outside the lock.
    keep
        How many notices are kept at most.
    """

    def __init__(self, wake: Callable[[], None], keep: int = 200) -> None:
        self._wake = wake
        self._lock = Lock()
        self._woken = False
        self._snapshot: Snapshot | None = None
        self._notices: deque[Notice] = deque(maxlen=keep)

    def put_snapshot(self, snapshot: Snapshot) -> None:
        """Keep a snapshot unless a newer one is here already."""
        with self._lock:
            if self._snapshot is not None and self._snapshot.serial > snapshot.serial:
                return
            self._snapshot = snapshot
            wake = not self._woken
            self._woken = True
        if wake:
            self._wake()

    def put_notice(self, severity: str, text: str) -> None:
        """Keep a notice."""
        with self._lock:
            self._notices.append((severity, text))
            wake = not self._woken
            self._woken = True
        if wake:
            self._wake()

    def take(self) -> tuple[Snapshot | None, list[Notice]]:
        """Return what has arrived since the last call: the newest snapshot, and all notices."""
        with self._lock:
            self._woken = False
            snapshot, self._snapshot = self._snapshot, None
            notices = list(self._notices)
            self._notices.clear()
        return snapshot, notices
