"""A new block as a screen: the questions of `anaplot new`, with their defaults and checks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.content import Content
from textual.widgets import Input, Static

from anaplot.console.app import THEME
from anaplot.console.orderly import OrderlyApp
from anaplot.console.text import fit, fit_end, wrap
from anaplot.errors import InputError
from anaplot.report.newcommand import write_answers
from anaplot.report.newquestions import NONE, Question, answered, camera_types, new_questions
from anaplot.textfiles.wording import plain

__all__ = ["NewBlockApp", "ask_for_block"]

_LONGEST = 400
_LABEL = 12
_HINTS = {
    "name": "What the block is called.",
    "strip": "FIRST-LAST counts up or down (101-120; 220-201), or names with commas; semicolons "
    "part the strips, NAME=PHOTOS names one. none: they follow from image_points.csv.",
    "control": "A list with a header: name, E, N, H and perhaps sigma, in any order; or none.",
    "profile": "The device profile of the instrument (anaplot plotter list), or none.",
    "pattern": "Of the points of a model: 6, 9, 13, 15, or a file.",
    "sigma": "Standard deviation of an image coordinate, um.",
}


class NewBlockApp(OrderlyApp[tuple[str, ...]]):
    """The screen; what is wrong stands under its field, and nothing is written until all is right.

    Returns the lines that `anaplot new` prints, or None when the person left.

    Parameters
    ----------
    folder
        The block's folder; it is made when it does not exist.
    instrument
        Whether an instrument waits for the block, so that its profile is needed.
    """

    TITLE = "anaplot"
    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = "#name"

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,ctrl+c,ctrl+q", "leave", "Leave", priority=True),
        Binding("f4,ctrl+s", "write", "Write", priority=True),
        Binding("down,tab", "go(1)", "Next field", priority=True),
        Binding("up,shift+tab", "go(-1)", "Field before", priority=True),
    ]

    DEFAULT_CSS = """
    NewBlockApp {
        Screen { overflow: hidden; }
        #title { height: 1; background: $panel; text-style: bold; }
        #intro { height: 2; color: $foreground-muted; }
        .field { height: 1; }
        .label { width: 13; }
        Input { width: 1fr; }
        .fault { height: 1; color: $text-error; text-style: bold; }
        #hint { height: 1fr; color: $foreground-muted; }
        #wrong { height: auto; max-height: 4; color: $text-error; text-style: bold; }
        #live { height: 1; background: $panel; }
    }
    """

    def __init__(self, folder: Path, *, instrument: bool = False) -> None:
        super().__init__()
        self._folder = folder
        self._instrument = instrument
        self._questions = new_questions(folder)
        self.animation_level = "none"

    def compose(self) -> ComposeResult:
        """Lay the questions out."""
        yield Static("", id="title")
        yield Static(
            Content(" There is no block in this folder yet. Every question has its default:\n"
                    " F4 takes what stands here."),
            id="intro",
        )  # fmt: skip
        for question in self._questions:
            with Horizontal(classes="field"):
                yield Static(Content(f" {question.short}"), classes="label")
                yield Input(question.default, max_length=_LONGEST, compact=True, id=question.name)
            yield Static("", id=f"fault-{question.name}", classes="fault")
        yield Static("", id="hint")
        yield Static("", id="wrong")
        yield Static(
            Content(" F4 write the block   ↑ ↓ field   enter next field   esc leave"), id="live"
        )

    def on_mount(self) -> None:
        """Take the colours, and say what the first field is about."""
        self.register_theme(THEME)
        self.theme = THEME.name
        self.heed_signals()
        self._hint()

    def on_resize(self) -> None:
        """Say which folder it is; of one that is too long, the end."""
        folder = fit_end(str(self._folder), max(self.size.width - 13, 20)).rstrip()
        self.query_one("#title", Static).update(Content(f" NEW BLOCK  {folder}"))

    # -- fields --------------------------------------------------------------------------------

    def _said(self, question: Question) -> list[str]:
        """Return the answers in a field; an empty one has its default."""
        text = self.query_one(f"#{question.name}", Input).value.strip() or question.default
        if not question.many:
            return [text]
        return [part.strip() for part in text.split(";") if part.strip()]

    def _check(self, question: Question) -> bool:
        """Say under a field what is wrong with it; returns whether nothing is."""
        said = self._said(question)
        fault = question.fault(said)
        if self._instrument and question.name == "profile" and said == [NONE]:
            fault = "the instrument at --port needs its profile"
        shown = self.query_one(f"#fault-{question.name}", Static)
        width = max(self.size.width - _LABEL - 3, 20)
        shown.update(Content(" " * (_LABEL + 1) + fit(fault, width).rstrip() if fault else ""))
        return not fault

    def on_input_blurred(self, event: Input.Blurred) -> None:
        """Check a field when it is left."""
        self._check(self._question(event.input.id))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Go to the next field when this one is right; from the last one, write."""
        question = self._question(event.input.id)
        if not self._check(question):
            return
        if question is self._questions[-1]:
            self.action_write()
        else:
            self.action_go(1)

    def on_descendant_focus(self, _: events.DescendantFocus) -> None:
        """Say what the field is about."""
        self._hint()

    def _question(self, name: str | None) -> Question:
        return next(question for question in self._questions if question.name == name)

    def _hint(self) -> None:
        focused = self.focused
        name = None if focused is None else focused.id
        lines: Sequence[str] = wrap(_HINTS.get(name or "", ""), max(self.size.width - 3, 20))
        if name == "camera":
            lines = _cameras(max(self.size.width - 2, 20))
        self.query_one("#hint", Static).update(Content("\n".join(f" {line}" for line in lines)))

    # -- keys ----------------------------------------------------------------------------------

    def action_go(self, step: int) -> None:
        """Go to the next field, or to the one before."""
        names = [question.name for question in self._questions]
        here = self.focused.id if self.focused is not None else None
        place = names.index(here) if here in names else 0
        self.query_one(f"#{names[(place + step) % len(names)]}", Input).focus()

    def action_write(self) -> None:
        """Write the block, unless something is wrong; then go to the first field that is."""
        faulty = [question for question in self._questions if not self._check(question)]
        if faulty:
            self.query_one(f"#{faulty[0].name}", Input).focus()
            return
        answers = {question.name: self._said(question) for question in self._questions}
        try:
            lines = write_answers(self._folder, answered(self._folder, answers))
        except InputError as error:
            shown = wrap(str(error), max(self.size.width - 2, 20))
            self.query_one("#wrong", Static).update(
                Content("\n".join(f" {line}" for line in shown))
            )
            return
        self.exit(lines)

    def action_leave(self) -> None:
        """Leave; nothing is written."""
        self.exit(None)


def _cameras(width: int) -> list[str]:
    """Return the common cameras, in as many columns as there is room for."""
    names = [name for name, _ in camera_types()]
    if width < 110:
        words = "A common type, a camera file, or c in mm. Nominal values, no calibration: "
        return wrap(words + ", ".join(names), width)
    lines = ["A common type (nominal values, no calibration), a camera file, or c in mm:"]
    return [*lines, *(f"  {name:9} {plain(title)}" for name, title in camera_types())]


def ask_for_block(folder: Path, *, instrument: bool = False) -> tuple[str, ...]:
    """Show the screen and write the block.

    Parameters
    ----------
    folder, instrument
        As `NewBlockApp` has them.

    Returns
    -------
    tuple[str, ...]
        Lines for people, as `anaplot new` prints them.

    Raises
    ------
    InputError
        The person left: nothing is written.
    SystemExit
        A signal ended it.
    """
    app = NewBlockApp(folder, instrument=instrument)
    lines = app.run()
    if lines is None:
        if app.return_code is not None and app.return_code > 128:
            raise SystemExit(app.return_code)
        raise InputError("the questions were not answered: nothing is written")
    return lines
