"""The prompt for another name: what a point is in truth, and in which of the photos."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from anaplot.aliases import Side
from anaplot.console.dialogs import clickable
from anaplot.console.intent import OtherPointName
from anaplot.session.othernames import OtherName
from anaplot.textfiles.wording import plain

__all__ = ["AskOtherName"]

_LONGEST_NAME = 100


class AskOtherName(ModalScreen[OtherName | None]):
    """A prompt for a point's other name; Enter takes what is proposed, escape gives none.

    Parameters
    ----------
    asked
        The name that it has, the one that it probably has, "" where nothing is known, and in which
        photo; the photos, and the points with which it is an exchange.
    """

    DEFAULT_CSS = """
    AskOtherName { align: center middle; background: $background 60%; }
    AskOtherName > Vertical { width: 64; max-width: 95%; height: auto; }
    AskOtherName > Vertical { padding: 1 2; background: $panel; }
    AskOtherName Static { height: auto; color: $foreground-muted; }
    AskOtherName #where { color: $foreground; }
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "cancel", "Cancel"),
        Binding("tab", "where", "In which photo", priority=True),
    ]

    def __init__(self, asked: OtherPointName) -> None:
        super().__init__()
        self._asked = asked
        self._point, self._proposed = asked.proposed.point, asked.proposed
        self._side = asked.proposed.side  # where the name is one that can be exchanged there

    def compose(self) -> ComposeResult:
        """Lay the prompt out."""
        title = f"What was measured as {plain(self._point)} is in truth"
        with Vertical():
            yield Static(Content(title))
            yield Input(self._proposed.name, max_length=_LONGEST_NAME, compact=True)
            yield Static(id="where")
            yield Static(Content(""))
            yield Static(
                Content("     ").join(
                    (
                        Content("enter do it"),
                        clickable("tab in which photo", "where"),
                        clickable("escape leave it", "cancel"),
                    )
                )
            )

    def on_mount(self) -> None:
        """Say what Enter would do."""
        self._say()

    def on_input_changed(self) -> None:
        """Say what Enter would do now."""
        self._say()

    @property
    def _typed(self) -> str:
        return self.query_one(Input).value.strip()

    @property
    def _sides(self) -> tuple[Side | None, ...]:
        """In which photos it can get the name, None for both: in one alone only by an exchange."""
        alone = self._typed in self._asked.alone
        return (None, *(side for side in self._asked.seen if alone))

    @property
    def _where(self) -> Side | None:
        return self._side if self._side in self._sides else None

    def _say(self) -> None:
        name = self._typed
        left, right = map(plain, self._asked.photos)
        where = {None: "in both photos", "left": f"in {left} alone", "right": f"in {right} alone"}
        what = "another name"
        if name and name != self._point:
            point, other = plain(self._point), plain(name)
            exchange = name in self._asked.measured
            what = f"{point} and {other} exchanged" if exchange else f"{point} named {other}"
        line = f"{what} {where[self._where]}"
        if name and len(self._sides) == 1:
            line += ": in one alone it can only be exchanged with a point of the model"
        self.query_one("#where", Static).update(Content(line))

    def on_input_submitted(self) -> None:
        """Close with the name."""
        name = self._typed
        self.dismiss(OtherName(self._point, name, self._where) if name else None)

    def action_where(self) -> None:
        """Go on to the next choice: both photos, the left one, the right one."""
        sides = self._sides
        if len(sides) > 1:
            self._side = sides[(sides.index(self._where) + 1) % len(sides)]
        self._say()

    def action_cancel(self) -> None:
        """Close without a name."""
        self.dismiss(None)
