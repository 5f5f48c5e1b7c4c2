"""What is computed beside a page that is closed meanwhile."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from textual.message_pump import NoActiveAppError

from anaplot.console import beside
from anaplot.console.beside import Beside


class Page:
    """A page as it is in the thread: once closed it belongs to no application."""

    def __init__(self) -> None:
        self.is_running = True
        self.work: Any = None

    @property
    def app(self) -> Any:
        if not self.is_running:
            raise NoActiveAppError
        return SimpleNamespace(call_from_thread=lambda call, *given: call(*given))

    def run_worker(self, work: Any, *, thread: bool) -> None:
        assert thread
        self.work = work


def test_a_page_closed_just_before_its_result_is_told(monkeypatch):
    page, told = Page(), []

    class Worker:
        """Not cancelled yet when it is looked at, and the page is closed then."""

        @property
        def is_cancelled(self) -> bool:
            page.is_running = False
            return False

    monkeypatch.setattr(beside, "get_current_worker", Worker)
    computed = Beside(page, lambda: "result", told.append, told.append)  # type: ignore[arg-type]
    computed.wanted()
    page.work()
    assert not page.is_running
    assert told == []


def test_a_page_that_is_open_is_told_of_results_and_of_what_went_wrong(monkeypatch):
    page, told = Page(), []
    monkeypatch.setattr(beside, "get_current_worker", lambda: SimpleNamespace(is_cancelled=False))
    values = iter([1, 0])
    computed = Beside(page, lambda: 1 / next(values), told.append, told.append)  # type: ignore[arg-type]
    computed.wanted()
    computed.wanted()  # while it computes: once more afterwards
    page.work()
    page.work()
    assert told == [1.0, "unexpected ZeroDivisionError: division by zero"]
