"""A computation beside the screen, so that keys stay live while it takes its time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from textual.app import App
from textual.screen import Screen
from textual.worker import get_current_worker

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
        self._screen.run_worker(partial(self._run, self._screen.app), thread=True)

    def _run(self, app: App[Any]) -> None:
        worker = get_current_worker()
        try:
            told: Callable[[], None] = partial(self._done, self._compute())
        except AnaplotError as error:
            told = partial(self._failed, str(error))
        except Exception as error:  # noqa: BLE001 - measuring goes on; the operator is told
            told = partial(self._failed, f"unexpected {type(error).__name__}: {error}")
        if not worker.is_cancelled:
            app.call_from_thread(self._finish, told)

    def _finish(self, told: Callable[[], None]) -> None:
        self._running = False
        if not self._screen.is_running:
            return
        told()  # overtaken or not: news that never end do not keep it from being shown
        if self._again:
            self.wanted()
