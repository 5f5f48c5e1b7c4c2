"""Progress of long work on standard error: one line that overwrites itself."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TextIO
from unicodedata import east_asian_width

from anaplot.textfiles.wording import plain

__all__ = ["ProgressLine", "working"]

_FIRST = 1.0  # seconds before anything is shown
_EVERY = 0.2
_ALONE = 1.0  # seconds after which the line is drawn anew although nothing was said
_ESTIMATED = 2.0  # seconds of work before its end is estimated
_LEAST = 0.02  # part of the work that has to be done before


class ProgressLine:
    """A progress line that appears after a second and is gone when the work is done.

    It goes on counting while the work says nothing. Nothing is written where nobody watches: the
    stream must be a terminal.

    Parameters
    ----------
    stream
        Usually standard error.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._watched = stream.isatty()
        self._next = time.monotonic() + _FIRST
        self._shown = 0
        self._begun = time.monotonic()
        self._what, self._since = "", self._begun
        self._fraction, self._said = 0.0, self._since
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._ticking: threading.Thread | None = None

    def __call__(self, what: str, fraction: float) -> None:
        """Say what is being done and how much of it is done (0 to 1; 0: nobody knows)."""
        now = time.monotonic()
        with self._lock:
            if what != self._what:
                self._what, self._since = what, now
            self._fraction, self._said = min(fraction, 1.0), now
            if self._watched and now >= self._next:
                self._draw(now)

    @property
    def reached(self) -> str:
        """What was being done last, how much of that, and after which time: for a person."""
        with self._lock:
            done = f" {100.0 * self._fraction:.0f} %" if self._fraction > 0.0 else ""
            what = plain(self._what, 200) + done + (", " if self._what else "")
            gone = time.monotonic() - self._begun
        return f"{what}after {_span(gone) if gone >= 10.0 else f'{gone:.1f} s'}"

    def _draw(self, now: float) -> None:
        self._next = now + _EVERY
        done = f" {100.0 * self._fraction:3.0f} %" if self._fraction > 0.0 else ""
        rest = self._left(now)
        gone = now - self._since
        if not done and gone >= _ESTIMATED:
            rest = f", {_span(gone)}"
        width = self._width()
        # the estimate is given up before the name is
        text = plain(self._what, 200) + done
        text = _cut(text + rest, width) if _cells(text + rest) <= width else _cut(text, width)
        cells = _cells(text)
        with contextlib.suppress(OSError, ValueError):  # a terminal that has gone
            self._stream.write("\r" + text + " " * (min(self._shown, width) - cells))
            self._stream.flush()
        self._shown = cells

    def _left(self, now: float) -> str:
        """Estimate what is left of the work by what has gone; nothing once that was too short."""
        gone = self._said - self._since
        if gone < _ESTIMATED or not _LEAST < self._fraction < 1.0:
            return ""
        left = gone * (1.0 - self._fraction) / self._fraction - (now - self._said)
        return f", about {_span(left)} of it left" if left >= 0.5 else ""

    def _width(self) -> int:
        """Return how many cells a line may have that shall not go on in the next one."""
        try:
            columns = os.get_terminal_size(self._stream.fileno()).columns
        except (OSError, ValueError):
            columns = 0
        return max((columns or 80) - 1, 1)

    def _tick(self) -> None:
        while not self._over.wait(_ALONE):
            now = time.monotonic()
            with self._lock:
                if self._what and now >= max(self._next, self._said + _ALONE):
                    self._draw(now)

    def __enter__(self) -> ProgressLine:
        if self._watched:
            self._ticking = threading.Thread(target=self._tick, name="progress", daemon=True)
            self._ticking.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._over.set()
        if self._ticking is not None:
            self._ticking.join()
        if self._shown:
            with contextlib.suppress(OSError, ValueError):
                self._stream.write("\r" + " " * min(self._shown, self._width()) + "\r")
                self._stream.flush()


@contextmanager
def working(what: str) -> Iterator[ProgressLine]:
    """Show that something is being done, on standard error, until it is done.

    Parameters
    ----------
    what
        In a few words: "reading sparse/0".
    """
    with ProgressLine(sys.stderr) as line:
        line(what, 0.0)
        yield line


def _span(seconds: float) -> str:
    """Return a time in a unit in which it is a short number."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.0f} h"


def _cells(text: str) -> int:
    """Return how wide a terminal shows it, at most."""
    return sum(2 if east_asian_width(c) in "WF" else 1 for c in text)


def _cut(text: str, cells: int) -> str:
    """Return the beginning of a text that fits."""
    while _cells(text) > cells:
        text = text[:-1]
    return text
