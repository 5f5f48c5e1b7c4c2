"""The station's one thread."""

from __future__ import annotations

import threading
from collections.abc import Callable

from anaplot.errors import AnaplotError
from anaplot.station.inbox import End, Inbox, Item

__all__ = ["Worker"]


class Worker:
    """Takes what was heard out of the queue, one after another, until the end.

    Parameters
    ----------
    inbox
        Where it is put.
    take
        Does what follows from it.
    refused
        Told of an error in doing so that a person can read; the work goes on.
    failed
        Called at an error of the program, which ends the thread: nothing must look alive then.
    """

    def __init__(
        self,
        inbox: Inbox,
        take: Callable[[Item], None],
        refused: Callable[[str], None],
        failed: Callable[[], None],
    ) -> None:
        self._items = inbox.items
        self._take, self._refused, self._failed = take, refused, failed
        self.thread = threading.Thread(target=self._work, name="station", daemon=True)

    def end(self) -> None:
        """End after what was heard so far, and wait for it unless this is the thread itself."""
        self._items.put(End())
        if self.thread is not threading.current_thread():
            self.thread.join()

    def _work(self) -> None:
        ended = False
        try:
            while not isinstance(item := self._items.get(), End):
                try:
                    self._take(item)
                except AnaplotError as error:
                    self._refused(str(error))
            ended = True
        finally:
            if not ended:
                self._failed()
