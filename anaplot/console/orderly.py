"""An application that leaves in order, whatever becomes of its terminal."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable
from functools import partial
from typing import IO, Any, TypeVar

from textual.app import App
from textual.driver import Driver

__all__ = ["LastingFile", "OrderlyApp", "lasting"]

Result = TypeVar("Result")


class LastingFile:
    """The terminal as a file; once the terminal is gone, what is written is lost without an error.

    The toolkit writes by a thread of its own, from a queue of 30 texts. An error would end that
    thread, and the application would wait for ever for room in the queue: it would keep the block
    and the line, and record what the pedal says, without a window.

    Parameters
    ----------
    file
        What is written to.
    """

    def __init__(self, file: IO[str]) -> None:
        self._file = file

    def write(self, text: str) -> None:
        """Write text, if it can be."""
        with contextlib.suppress(OSError):
            self._file.write(text)

    def flush(self) -> None:
        """Have it shown, if it can be."""
        with contextlib.suppress(OSError):
            self._file.flush()

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._file.fileno()


def lasting(driver: type[Driver]) -> type[Driver]:
    """Return a driver class that minds no terminal that is gone.

    Parameters
    ----------
    driver
        What writes to the terminal.
    """

    def begin(self: Any, *arguments: Any, **options: Any) -> None:
        driver.__init__(self, *arguments, **options)
        file = getattr(self, "_file", None)
        if file is not None:
            self._file = LastingFile(file)

    return type(f"Lasting{driver.__name__}", (driver,), {"__init__": begin})


class OrderlyApp(App[Result]):
    """An application that signals end as its keys do, with the exit code that shells expect."""

    def get_driver_class(self) -> type[Driver]:
        """Return what writes to the terminal, also when there is none any more."""
        return lasting(super().get_driver_class())

    def heed_signals(self) -> None:
        """Mind the signals of the system from now on, in the application's own loop.

        A terminal that is closed, a polite kill and an interrupt end it. A process that goes on
        after it was stopped takes the terminal up anew: the shell has used it meanwhile. A terminal
        that is closed tells this, too, to whom it ends; the toolkit by itself would then read keys
        twice.
        """
        for name in ("SIGTERM", "SIGHUP", "SIGINT"):
            if number := getattr(signal, name, 0):
                self._heed(number, partial(self.exit, return_code=128 + number))
        if hasattr(signal, "SIGTSTP"):
            self._heed(signal.SIGTSTP, self._stop)
            self._heed(signal.SIGCONT, self._go_on)

    def _heed(self, number: int, call: Callable[[], None]) -> None:
        # not every platform, nor every thread, takes signal handlers
        with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
            asyncio.get_running_loop().add_signal_handler(number, call)

    def _stop(self) -> None:
        """Give the terminal back and stop, until somebody lets the process go on."""
        self._leave_terminal()
        os.kill(os.getpid(), signal.SIGSTOP)

    def _go_on(self) -> None:
        if self._exit or self._driver is None:
            return
        self._leave_terminal()
        self._driver.resume_application_mode()
        self.refresh(layout=True)

    def _leave_terminal(self) -> None:
        writer = getattr(self._driver, "_writer_thread", None)
        if self._driver is not None and writer is not None and writer.is_alive():
            self._driver.suspend_application_mode()
