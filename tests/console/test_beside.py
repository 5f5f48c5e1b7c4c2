"""What is computed beside a page that is closed meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from textual.message_pump import NoActiveAppError

from anaplot.console.beside import Beside


class Page:
    """A page as it is in the thread: once closed it belongs to no application."""

    def __init__(self, call: Callable[..., None] = lambda call, *given: call(*given)) -> None:
        self.is_running = True
        self._app = SimpleNamespace(call_from_thread=call, is_running=True)

    @property
    def app(self) -> Any:
        if not self.is_running:
            raise NoActiveAppError
        return self._app


def ended() -> None:
    """Wait for what is computed beside, one after the other."""
    while threads := [one for one in threading.enumerate() if one.name == "beside"]:
        threads[0].join()


def test_a_page_closed_just_before_its_result_is_told() -> None:
    page, told = Page(), []

    def compute() -> str:
        page.is_running = False
        return "result"

    Beside(page, compute, told.append, told.append).wanted()  # type: ignore[arg-type]
    ended()
    assert told == []


def test_a_page_that_is_open_is_told_of_results_and_of_what_went_wrong() -> None:
    page, told, begun = Page(), [], threading.Event()
    values = iter([1, 0])

    def compute() -> float:
        begun.wait()
        return 1 / next(values)

    computed = Beside(page, compute, told.append, told.append)  # type: ignore[arg-type]
    computed.wanted()
    computed.wanted()  # while it computes: once more afterwards
    begun.set()
    ended()
    assert told == [1.0, "unexpected ZeroDivisionError: division by zero"]


def test_nobody_waits_for_it_when_the_program_ends() -> None:
    # after `q` the terminal was dead until the history of 200 models had been computed
    page, leave, there = Page(), threading.Event(), []

    def compute() -> None:
        there.append(threading.current_thread())
        leave.wait()

    Beside(page, compute, print, print).wanted()  # type: ignore[arg-type]
    (thread,) = (one for one in threading.enumerate() if one.name == "beside")
    assert thread.daemon
    leave.set()
    ended()
    assert there == [thread]


@pytest.mark.parametrize("running", [False, True])
def test_only_of_an_application_that_has_ended_nothing_is_heard(running: bool) -> None:
    def call(*_: object) -> None:
        raise RuntimeError("App is not running")

    page, heard = Page(call), []
    page.app.is_running = running
    hook, threading.excepthook = threading.excepthook, lambda args: heard.append(args.exc_type)
    try:
        Beside(page, lambda: None, print, print).wanted()  # type: ignore[arg-type]
        ended()
    finally:
        threading.excepthook = hook
    assert heard == ([RuntimeError] if running else [])
