"""Progress of long work on standard error: one line that overwrites itself."""

from __future__ import annotations

import time
from types import TracebackType
from typing import TextIO

__all__ = ["ProgressLine"]

_FIRST = 1.0  # seconds before anything is shown
_EVERY = 0.2
_ESTIMATED = 2.0  # seconds of work before its end is estimated


class ProgressLine:
    """A progress line that appears after a second and is gone when the work is done.

    Nothing is written where nobody watches: the stream must be a terminal.

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
        self._what, self._since = "", time.monotonic()

    def __call__(self, what: str, fraction: float) -> None:
        """Say what is being done and how much of it is done (0 to 1)."""
        now = time.monotonic()
        if what != self._what:
            self._what, self._since = what, now
        if not self._watched or now < self._next:
            return
        self._next = now + _EVERY
        share = f" {100.0 * fraction:3.0f} %" if fraction > 0.0 else ""
        text = f"{what}{share}{self._left(now, fraction)}"
        self._stream.write("\r" + text.ljust(self._shown))
        self._stream.flush()
        self._shown = len(text)

    def _left(self, now: float, fraction: float) -> str:
        """Estimate what is left of the work by what has gone."""
        gone = now - self._since
        if gone < _ESTIMATED or not 0.02 < fraction < 1.0:
            return ""
        return f", about {gone * (1.0 - fraction) / fraction:.0f} s left"

    def __enter__(self) -> ProgressLine:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._shown:
            self._stream.write("\r" + " " * self._shown + "\r")
            self._stream.flush()
