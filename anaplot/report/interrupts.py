"""An interrupt that ends a search with the best it has; the next one leaves at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TextIO

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Progress

__all__ = ["EndingEarly"]


class EndingEarly(Watch):
    """A watch that an interrupt (Ctrl-C) stops while a search runs, and only then.

    Parameters
    ----------
    progress
        As `Watch` has it.
    err
        Where a person is told.
    """

    def __init__(self, progress: Progress, err: TextIO) -> None:
        super().__init__(progress)
        self._err = err

    @contextmanager
    def searching(self) -> Iterator[Watch]:
        """Let the first interrupt ask for the end meanwhile; the second interrupts as always."""
        if threading.current_thread() is not threading.main_thread():
            yield self
            return
        before = signal.getsignal(signal.SIGINT)

        def stop(number: int, frame: FrameType | None) -> None:
            signal.signal(signal.SIGINT, before)
            self.stop()
            self._err.write(
                "\nanaplot: the search ends with the best that it has found; again to leave at "
                "once\n"
            )
            self._err.flush()

        signal.signal(signal.SIGINT, stop)
        try:
            yield self
        finally:
            signal.signal(signal.SIGINT, before)
