"""A page that takes its time: what it shows is computed while it is open."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from textual.content import Content

from anaplot.console.beside import Beside
from anaplot.console.dialogs import LINE, Page
from anaplot.console.text import wrap

__all__ = ["ComputedPage"]

Result = TypeVar("Result")


class ComputedPage(Page):
    """A page computed when it is opened, and whenever it is renewed.

    Parameters
    ----------
    title
        Its title.
    lines
        What it shows first.
    compute
        Returns the result; called in a thread of its own.
    computed
        Shows the result.
    """

    def __init__(
        self,
        title: str,
        lines: list[Content],
        compute: Callable[[], Result],
        computed: Callable[[Result], None],
    ) -> None:
        super().__init__(title, lines)
        self._beside = Beside(self, compute, computed, self._failed)

    def on_mount(self) -> None:
        """Begin to compute."""
        self._beside.wanted()

    def renew(self) -> None:
        """Compute anew: something is another."""
        self._beside.wanted()

    def _failed(self, words: str) -> None:
        self.show([Content.styled(line, "$text-error") for line in wrap(words, LINE)])
