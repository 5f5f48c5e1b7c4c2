"""An interrupt that ends a search with the best it has; the next one leaves at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from types import FrameType
from typing import TextIO

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Progress

__all__ = ["EndingEarly", "ending_early"]


class EndingEarly(Watch):
    """A watch that an interrupt stops while a search runs, and only then.

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

    def searching(self) -> AbstractContextManager[Watch]:
        """Listen to interrupts meanwhile."""
        return ending_early(self, self._err)


@contextmanager
def ending_early(watch: Watch, err: TextIO) -> Iterator[Watch]:
    """Let the first interrupt (Ctrl-C) ask for the end; the second interrupts as always.

    Parameters
    ----------
    watch
        What the search asks whether to stop.
    err
        Where a person is told.
    """
    if threading.current_thread() is not threading.main_thread():
        yield watch
        return
    before = signal.getsignal(signal.SIGINT)

    def stop(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, before)
        watch.stop()
        err.write(
            "\nanaplot: the search ends with the best that it has found; again to leave at once\n"
        )
        err.flush()

    signal.signal(signal.SIGINT, stop)
    try:
        yield watch
    finally:
        signal.signal(signal.SIGINT, before)
