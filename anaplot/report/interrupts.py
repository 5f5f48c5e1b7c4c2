"""An interrupt that ends a search with the best it has; the next one leaves at once.

The end of a time limit is an interrupt like a person's: Python knows no other way out of any work.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, TextIO

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Progress

__all__ = ["EndingEarly", "TimeLimit"]

_MORE = 0.5  # of a limit, for a search to end that was asked for it


class TimeLimit:
    """Interrupts the main thread when a time is over; a search that goes on once more.

    Also where interrupts are ignored, as of what a shell runs in the background.

    Parameters
    ----------
    seconds
        How long the work may take; None: as long as it takes.

    Attributes
    ----------
    seconds
        The same.
    over
        Whether an interrupt came from here.
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds = seconds
        self.over = False
        self._done = threading.Event()
        self._lock = threading.Lock()
        self._waiting: threading.Thread | None = None
        self._before: Any = None

    def _wait(self, seconds: float) -> None:
        for span in (seconds, _MORE * seconds):
            if self._done.wait(span):
                return
            with self._lock:
                if self._done.is_set():
                    return
                self.over = True
                _thread.interrupt_main()

    def enough(self) -> None:
        """Interrupt no more: a search has ended, and what it found is put together."""
        with self._lock:
            self._done.set()

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        if self.over or self._before is not signal.SIG_IGN:
            raise KeyboardInterrupt

    def __enter__(self) -> TimeLimit:
        if self.seconds is not None and threading.current_thread() is threading.main_thread():
            self._waiting = threading.Thread(
                target=self._wait, args=(self.seconds,), name="time limit", daemon=True
            )
            self._before = signal.signal(signal.SIGINT, self._interrupted)
            try:
                self._waiting.start()
            except KeyboardInterrupt:
                self._done.set()
                signal.signal(signal.SIGINT, self._before)
                raise
        return self

    def __exit__(self, *_: object) -> None:
        self.enough()
        if self._waiting is not None:
            self._waiting.join()
            # an interrupt that has come is raised before a handler changes: here, and not later
            signal.signal(signal.SIGINT, self._before)


class EndingEarly(Watch):
    """A watch that an interrupt (Ctrl-C) stops while a search runs, and only then.

    Parameters
    ----------
    progress
        As `Watch` has it.
    err
        Where a person is told.
    limit
        The time that it has.
    """

    def __init__(self, progress: Progress, err: TextIO, limit: TimeLimit | None = None) -> None:
        super().__init__(progress)
        self._err = err
        self._limit = TimeLimit(None) if limit is None else limit

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
            ends = "the search ends with the best that it has found, if any"
            if self._limit.over:
                self._err.write(f"\nanaplot: {self._limit.seconds:g} s are over: {ends}\n")
            else:
                self._err.write(f"\nanaplot: {ends}; again to leave at once\n")
            self._err.flush()

        signal.signal(signal.SIGINT, stop)
        try:
            yield self
            if self._limit.over:
                self._limit.enough()
        finally:
            signal.signal(signal.SIGINT, before)
