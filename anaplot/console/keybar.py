"""The footer: the keys that do something now, as many as there is room for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.keys import format_key
from textual.message import Message
from textual.widget import Widget

from anaplot.console.repainting import repaint

__all__ = ["KeyBar", "KeyHint", "key_in_words", "show_key", "show_keys"]

_GAP = 2


@dataclass(frozen=True, slots=True)
class KeyHint:
    """A key in the bar: what it is called, what it does, and how much that matters."""

    action: str
    key: str
    label: str
    weight: int

    @property
    def cells(self) -> int:
        """Width on the screen."""
        return cell_len(self.key) + 1 + cell_len(self.label)


def show_key(key: str) -> str:
    """Return how a key is written for people."""
    names = {"escape": "esc", "space": "space", "enter": "enter", "plus": "+"}
    *modifiers, last = key.split("+") if len(key) > 1 else (key,)
    shown = names.get(last) or (last if len(last) == 1 else format_key(last))
    return "".join("^" if m == "ctrl" else f"{m}+" for m in modifiers) + shown


def key_in_words(key: str) -> str:
    """Return how a key is written within a sentence: Enter, not to be read as a verb."""
    shown = show_key(key)
    return shown.capitalize() if shown == "enter" else shown


def show_keys(keys: Iterable[str]) -> str:
    """Return how keys that belong together are written: ←↑↓→, z/Z."""
    shown = [show_key(key) for key in keys]
    return ("" if all(len(key) == 1 and not key.isascii() for key in shown) else "/").join(shown)


class KeyBar(Widget):
    """The live keys; each can be clicked."""

    DEFAULT_CSS = "KeyBar { height: 2; background: $panel; }"

    class Pressed(Message):
        """A key in the bar was clicked."""

        def __init__(self, action: str) -> None:
            super().__init__()
            self.action = action

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._hints: tuple[KeyHint, ...] = ()

    def show(self, hints: tuple[KeyHint, ...]) -> None:
        """Show these keys, in this order."""
        if hints != self._hints:
            height, width = self.size.height, self.size.width
            before, self._hints = self.arranged(width, height), hints
            repaint(self, before, self.arranged(width, height))

    def arranged(self, width: int, height: int) -> list[list[KeyHint]]:
        """Return the keys in lines; those that matter least are left out until the rest fits."""
        kept = list(self._hints)
        while kept:
            lines: list[list[KeyHint]] = [[]]
            used = 1
            for hint in kept:
                if lines[-1] and used + hint.cells > width - 1:
                    lines.append([])
                    used = 1
                lines[-1].append(hint)
                used += hint.cells + _GAP
            if len(lines) <= height and all(
                sum(h.cells + _GAP for h in line) - _GAP <= width - 2 for line in lines
            ):
                return lines
            kept.remove(max(kept, key=lambda hint: hint.weight))
        return []

    def render(self) -> Content:
        """Return the keys as text."""
        lines = []
        for hints in self.arranged(*self.size):
            parts: list[tuple[str, str]] = [(" ", "")]
            for i, hint in enumerate(hints):
                if i:
                    parts.append((" " * _GAP, ""))
                parts += [(hint.key, "bold $text-accent"), (f" {hint.label}", "")]
            lines.append(Content.assemble(*parts))
        return Content("\n").join(lines)

    def on_click(self, event: events.Click) -> None:
        """Do what the key under the mouse does."""
        lines = self.arranged(*self.size)
        if not 0 <= event.y < len(lines):
            return
        column = 1
        for hint in lines[event.y]:
            if column <= event.x < column + hint.cells:
                self.post_message(self.Pressed(hint.action))
                return
            column += hint.cells + _GAP
