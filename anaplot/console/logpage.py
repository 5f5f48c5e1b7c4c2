"""The log page: who changed what and why, the newest first, as `anaplot log` tells it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime
from typing import ClassVar

from rich.cells import cell_len
from textual.binding import Binding, BindingType
from textual.content import Content

from anaplot.console.beside import Beside
from anaplot.console.computedpage import ComputedPage
from anaplot.console.dialogs import LINE, AskName
from anaplot.console.text import fit, fit_end, number, wrap
from anaplot.session.changes import Change
from anaplot.textfiles.wording import plain

__all__ = ["LogPage", "log_lines"]

_MOST = 500  # changes on the page; `anaplot log` has all
_KEYS = "/ show one model or point · m the model in work, or all · esc closes"
_AGAIN = ("remeasured", "renamed", "off", "on", "undone", "reopened")


def log_lines(changes: Sequence[Change] | None, wanted: str, width: int) -> list[Content]:
    """Return the page.

    Parameters
    ----------
    changes
        The oldest first; None while they are read.
    wanted
        Part of the name of a model, photo or point that is shown alone; "" for all.
    width
        Cells of a line.
    """
    keys = [Content.styled(line, "$foreground-muted") for line in wrap(_KEYS, width)]
    if changes is None:
        return [*keys, Content(""), Content("being read ...")]
    found = [one for one in reversed(changes) if _is_wanted(one, wanted)]
    shown = f"only {plain(wanted)}: " if wanted else ""
    lines = [*keys, Content(fit(f"{shown}{len(found)} of {len(changes)} changes", width))]
    heading = ""
    for one in found[:_MOST]:
        when = datetime.fromisoformat(one.time).astimezone()
        before, heading = heading, _heading(when, one.who)
        if heading != before:
            lines += [Content(""), Content.styled(fit(heading, width), "bold $text-accent")]
        lines += _change(one, when, width)
    if len(found) > _MOST:
        lines.append(Content(f"and {len(found) - _MOST} earlier ones: anaplot log has all"))
    return lines


def _is_wanted(one: Change, wanted: str) -> bool:
    return any(wanted in name for name in (one.model, one.photo, one.point))


def _heading(when: datetime, who: str) -> str:
    return f"{when:%Y-%m-%d} UTC{when.isoformat()[-6:]}   {who}".rstrip()


def _change(one: Change, when: datetime, width: int) -> list[Content]:
    row = f"{one.point} → {one.name}" if one.name else f"{one.point} {one.axis}".strip()
    text = (
        f"{when:%H:%M:%S} {fit(one.what, 10)} {fit_end(one.model, 13)} {fit_end(one.photo, 7)} "
        f"{fit_end(row, 14)}"
    )
    parts = [one.reason] if one.reason else []
    if one.w_before is not None or one.w_after is not None:
        before, after = number(one.w_before, 7, 2), number(one.w_after, 6, 2).strip()
        narrow = f" w {before.strip()} → {after}"
        told = next(
            (w for w in (f" w{before} → {after}", narrow) if cell_len(text + w) <= width), ""
        )
        text += told
        if not told:
            parts.insert(0, narrow.strip())
    again = one.what in _AGAIN
    lines = [Content.styled(fit(text, width), "bold" if again else "")]
    if one.old is not None or (again and one.new is not None):
        parts.insert(0, f"{_xy(one.old)} → {_xy(one.new)} mm")
    if parts:
        lines.append(Content(fit(f"         {'   '.join(parts)}", width)))
    return lines


def _xy(value: tuple[float, float] | None) -> str:
    return "nothing" if value is None else f"{value[0]:.4f} {value[1]:.4f}"


class LogPage(ComputedPage):
    """Who changed what; it follows the work while it is read.

    Parameters
    ----------
    read
        Returns the changes; called in a thread of its own.
    model
        Returns the name of the model in work, or "".
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("H", "close", "Close"),
        Binding("slash", "ask", "Show one model or point"),
        Binding("m", "model", "Show the model in work, or all"),
    ]

    def __init__(self, read: Callable[[], tuple[Change, ...]], model: Callable[[], str]) -> None:
        super().__init__("Who changed what", log_lines(None, "", LINE), read, self._read)
        self._model = model
        self._changes: tuple[Change, ...] | None = None
        self._wanted = ""
        # w of the changes that are shown is computed where they are put into lines
        self._drawing = Beside(self, self._drawn, self.show, self._failed)

    def _read(self, changes: tuple[Change, ...]) -> None:
        self._changes = changes
        self._drawing.wanted()

    def _drawn(self) -> list[Content]:
        return log_lines(self._changes, self._wanted, LINE)

    def _want(self, wanted: str | None) -> None:
        if wanted is not None:
            self._wanted = wanted
            self._drawing.wanted()

    def action_ask(self) -> None:
        """Ask for a model, photo or point."""
        ask = AskName("Model, photo or point to show alone", "show")
        self.app.push_screen(ask, self._want)

    def action_model(self) -> None:
        """Show the model in work alone, or all."""
        model = self._model()
        self._want("" if self._wanted == model else model)
