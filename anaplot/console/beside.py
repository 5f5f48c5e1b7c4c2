"""A computation beside the screen, so that keys stay live while it takes its time.

In a thread that the program does not wait for: who leaves has left, whatever is being computed.
"""

from __future__ import annotations

import concurrent.futures
import contextvars
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from textual.app import App
from textual.screen import Screen

from anaplot.errors import AnaplotError

__all__ = ["Beside"]

Result = TypeVar("Result")


class Beside:
    """Computes in a thread what a screen shows, one after the other, the newest question last.

    Every result is shown when it is there, and gives way to the next one.

    Parameters
    ----------
    screen
        Whose it is; nothing comes after its end.
    compute
        Returns the result, in the thread.
    done
        Takes it, in the screen's thread.
    failed
        Takes the words of what went wrong.
    """

    def __init__(
        self,
        screen: Screen[Any],
        compute: Callable[[], Result],
        done: Callable[[Result], None],
        failed: Callable[[str], None],
    ) -> None:
        self._screen, self._compute, self._failed = screen, compute, failed
        self._done: Callable[[Any], None] = done
        self._running = self._again = False

    def wanted(self) -> None:
        """Compute; while something is being computed, once more afterwards."""
        if self._running:
            self._again = True
            return
        self._running, self._again = True, False
        # asked for here: a screen that is closed meanwhile has no application any more
        run = partial(contextvars.copy_context().run, self._run, self._screen.app)
        threading.Thread(target=run, name="beside", daemon=True).start()

    def _run(self, app: App[Any]) -> None:
        try:
            told: Callable[[], None] = partial(self._done, self._compute())
        except AnaplotError as error:
            told = partial(self._failed, str(error))
        except Exception as error:  # noqa: BLE001 - measuring goes on; the operator is told
            told = partial(self._failed, f"unexpected {type(error).__name__}: {error}")
        try:
            app.call_from_thread(self._finish, told)
        except (RuntimeError, concurrent.futures.CancelledError):
            # an application that has ended, or ends just now, takes nothing any more
            if app.is_running:
                raise

    def _finish(self, told: Callable[[], None]) -> None:
        self._running = False
        if not self._screen.is_running:
            return
        told()  # overtaken or not: news that never end do not keep it from being shown
        if self._again:
            self.wanted()
