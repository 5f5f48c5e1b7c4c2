"""The operator's commands, run one after the other beside the screen."""

from __future__ import annotations

from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread

from anaplot.errors import AnaplotError, InputError, NotComputableError
from anaplot.exchange.recordline import JournalError

__all__ = ["CommandThread"]


class CommandThread:
    """One daemon thread that gives commands to the station in the order of the keys.

    The screen never waits for a lock or a port. What a command raises is told as one line.

    Parameters
    ----------
    told
        Called in the command thread with a severity and a line: "hint" when the command makes no
        sense now, which is no fault, and "error" when something went wrong.
    """

    def __init__(self, told: Callable[[str, str], None]) -> None:
        self._told = told
        self._queue: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="console-commands", daemon=True)

    def start(self) -> None:
        """Start working."""
        self._thread.start()

    def submit(self, command: Callable[[], None]) -> None:
        """Run a command after those submitted before it."""
        self._queue.put(command)

    def close(self, timeout: float = 5.0) -> None:
        """End after the commands submitted so far, waiting at most `timeout` seconds."""
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout)

    def _run(self) -> None:
        while (command := self._queue.get()) is not None:
            try:
                command()
            except AnaplotError as fault:
                self._told(_severity(fault), str(fault))
            except Exception as fault:  # noqa: BLE001 - the work goes on; the operator is told
                self._told("error", f"unexpected {type(fault).__name__}: {fault}")


def _severity(fault: AnaplotError) -> str:
    """Return how a refused command is told: a disk or a line that fails is no hint."""
    untimely = isinstance(fault, InputError | NotComputableError)
    return "hint" if untimely and not isinstance(fault, JournalError) else "error"
