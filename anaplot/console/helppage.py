"""The help as a page: what it is to be about can be typed."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Input

from anaplot.console.dialogs import Page

__all__ = ["HelpPage"]


class HelpPage(Page):
    """The help; after `/` only what has the words typed in it.

    Parameters
    ----------
    lines
        Returns the lines in which some words stand; all for none.
    """

    DEFAULT_CSS = """
    HelpPage Input { display: none; height: 1; dock: bottom; }
    HelpPage.-filtered Input { display: block; }
    """

    AUTO_FOCUS = ""  # the prompt waits for its key
    BINDINGS: ClassVar[list[BindingType]] = [Binding("slash", "filter", "Filter")]

    def __init__(self, lines: Callable[[str], list[Content]]) -> None:
        super().__init__("Help: / finds words, page up and page down turn", lines(""))
        self._find = lines

    def compose(self) -> ComposeResult:
        """Lay page and prompt out."""
        yield from super().compose()
        yield Input(placeholder="words to find; escape: all", max_length=40, compact=True)

    def action_filter(self) -> None:
        """Ask for words."""
        self.add_class("-filtered")
        self.query_one(Input).focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Show what has the words in it."""
        self.show(self._find(event.value))
        self.query_one(VerticalScroll).scroll_home(animate=False)

    def on_input_submitted(self) -> None:
        """Read what was found."""
        self.set_focus(None)

    def action_close(self) -> None:
        """Show all again, or close the page when all is shown."""
        if not self.has_class("-filtered"):
            super().action_close()
            return
        self.remove_class("-filtered")
        self.set_focus(None)
        self.query_one(Input).value = ""
