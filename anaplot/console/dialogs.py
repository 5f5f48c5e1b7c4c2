"""Screens laid over the orientation screen: a question, a name, a page to read."""

from __future__ import annotations

from typing import ClassVar, Literal

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.style import Style
from textual.widgets import Input, Static

from anaplot.textfiles.wording import plain

__all__ = ["LINE", "AskName", "AskWhether", "Page", "clickable"]

LINE = 72
"""Cells of a line of a page."""

_LONGEST_NAME = 40


def clickable(text: str, action: str) -> Content:
    """Return text on which a click does what an action of the screen does."""
    return Content(text).stylize(Style.from_meta({"@click": f"screen.{action}"}))


Answered = Literal["yes", "no", "other"]


class AskWhether(ModalScreen[Answered]):
    """A question answered by y or n, or k where there is a third answer; escape means no.

    Parameters
    ----------
    question
        The question.
    yes, no
        What either answer means.
    again
        Keys that mean yes as well: those with which it was asked, (key, as people write it).
    other
        What k means; "" where it means nothing.
    """

    DEFAULT_CSS = """
    AskWhether { align: center middle; background: $background 60%; }
    AskWhether > Vertical { width: 64; max-width: 95%; height: auto; }
    AskWhether > Vertical { padding: 1 2; background: $panel; }
    AskWhether Static { height: auto; }
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y", "answer('yes')", "Yes"),
        Binding("n,escape", "answer('no')", "No"),
        Binding("k", "answer('other')", "Other"),
    ]

    def __init__(
        self,
        question: str,
        *,
        yes: str,
        no: str,
        again: tuple[tuple[str, str], ...] = (),
        other: str = "",
        id: str | None = None,  # noqa: A002 - Textual's name
    ) -> None:
        super().__init__(id=id)
        self._question, self._yes, self._no = plain(question), yes, no
        self._again, self._other = dict(again), other

    def on_key(self, event: events.Key) -> None:
        """Take the key with which it was asked for a yes."""
        if event.key in self._again:
            event.stop()
            self.dismiss("yes")

    def compose(self) -> ComposeResult:
        """Lay question and answers out."""
        y = ", ".join(("y", *list(self._again.values())[:1]))
        answers = [(y, self._yes, "yes"), ("k", self._other, "other"), ("n", self._no, "no")]
        shown = [
            clickable(f"{key} {words}", f"answer({answer!r})").stylize(
                "bold $text-accent", 0, len(key)
            )
            for key, words, answer in answers
            if words
        ]
        keys = Content("     ").join(shown)
        with Vertical():
            yield Static(Content(self._question), markup=False)
            yield Static(Content(""))
            yield Static(keys)

    def action_answer(self, answer: Answered) -> None:
        """Close with the answer."""
        if answer != "other" or self._other:
            self.dismiss(answer)


class AskName(ModalScreen[str | None]):
    """A prompt for a name; escape gives none.

    Parameters
    ----------
    title
        What is asked for.
    enter
        What the enter key does with it.
    """

    DEFAULT_CSS = """
    AskName { align: center middle; background: $background 60%; }
    AskName > Vertical { width: 52; max-width: 95%; height: auto; }
    AskName > Vertical { padding: 1 2; background: $panel; }
    AskName Static { height: auto; color: $foreground-muted; }
    """

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "cancel", "Cancel")]

    def __init__(self, title: str = "Name of the point to add", enter: str = "add") -> None:
        super().__init__()
        self._title, self._enter = title, enter

    def compose(self) -> ComposeResult:
        """Lay the prompt out."""
        with Vertical():
            yield Static(Content(self._title))
            yield Input(max_length=_LONGEST_NAME, compact=True)
            leave = clickable("escape leave it", "cancel")
            yield Static(Content.assemble(f"enter {self._enter}     ", leave))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Close with the name, which may be empty."""
        self.dismiss(event.value.strip())

    def action_cancel(self) -> None:
        """Close without a name."""
        self.dismiss(None)


class Page(ModalScreen[None]):
    """Something to read; it scrolls when it is longer than the screen."""

    DEFAULT_CSS = """
    Page { align: center middle; background: $background 60%; }
    Page > Vertical { width: 78; max-width: 98%; height: auto; max-height: 94%; }
    Page > Vertical { background: $panel; padding: 0 2; }
    Page VerticalScroll { height: auto; max-height: 100%; scrollbar-size-vertical: 1; }
    Page .page--title { dock: top; text-style: bold; color: $text-accent; height: 2; }
    Page .page--text { height: auto; width: 1fr; }
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,enter,question_mark,b,d,l,f2,space", "close", "Close"),
        Binding("up,k", "scroll(-1)", "Up"),
        Binding("down,j", "scroll(1)", "Down"),
        Binding("pageup", "page(-1)", "Page up"),
        Binding("pagedown", "page(1)", "Page down"),
    ]

    def __init__(self, title: str, lines: list[Content]) -> None:
        super().__init__()
        self._title, self._lines = plain(title), lines

    def compose(self) -> ComposeResult:
        """Lay title and text out."""
        with Vertical():
            title = Content.assemble(f"{self._title}   ", clickable("(escape closes)", "close"))
            yield Static(title, classes="page--title")
            with VerticalScroll(can_focus=False):
                yield Static(Content("\n").join(self._lines), classes="page--text")

    def on_mount(self) -> None:
        """Show what has come since it was laid out."""
        self._renew()

    def show(self, lines: list[Content]) -> None:
        """Show this from now on, scrolled as far as it was."""
        if lines != self._lines:
            self._lines = lines
            if self.is_mounted:
                self._renew()

    def _renew(self) -> None:
        # there is no text yet while the page is laid out, and none any more when it was closed
        for text in self.query(".page--text").results(Static):
            text.update(Content("\n").join(self._lines))

    def action_close(self) -> None:
        """Close the page."""
        self.dismiss(None)

    def action_scroll(self, step: int) -> None:
        """Scroll by a line."""
        self.query_one(VerticalScroll).scroll_relative(y=step, animate=False)

    def action_page(self, step: int) -> None:
        """Scroll by a page."""
        view = self.query_one(VerticalScroll)
        view.scroll_relative(y=step * max(view.size.height - 1, 1), animate=False)
