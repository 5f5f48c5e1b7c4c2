"""An interrupt that ends a search with the best it has; the next one leaves at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TextIO

from anaplot.adjustment.watch import Watch

__all__ = ["ending_early"]


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
