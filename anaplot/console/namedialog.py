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
from anaplot.session.othernames import OtherName
from anaplot.textfiles.wording import plain

__all__ = ["AskOtherName"]

_LONGEST_NAME = 100
_SIDES: tuple[Side | None, ...] = (None, "left", "right")


class AskOtherName(ModalScreen[OtherName | None]):
    """A prompt for a point's other name; Enter takes what is proposed, escape gives none.

    Parameters
    ----------
    proposed
        The name that it has, the one that it probably has, "" where nothing is known, and in which
        photo.
    photos
        Left and right.
    measured
        The points that the model has: with one of these it is an exchange.
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

    def __init__(
        self, proposed: OtherName, photos: tuple[str, str], measured: tuple[str, ...]
    ) -> None:
        super().__init__()
        self._point, self._proposed = proposed.point, proposed
        self._photos, self._measured = photos, frozenset(measured)
        self._side = proposed.side

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

    def _say(self) -> None:
        name = self.query_one(Input).value.strip()
        left, right = map(plain, self._photos)
        where = {None: "in both photos", "left": f"in {left} alone", "right": f"in {right} alone"}
        what = "another name"
        if name and name != self._point:
            point, other = plain(self._point), plain(name)
            exchange = name in self._measured
            what = f"{point} and {other} exchanged" if exchange else f"{point} named {other}"
        self.query_one("#where", Static).update(Content(f"{what} {where[self._side]}"))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Close with the name."""
        name = event.value.strip()
        self.dismiss(OtherName(self._point, name, self._side) if name else None)

    def action_where(self) -> None:
        """Go on to the next choice: both photos, the left one, the right one."""
        self._side = _SIDES[(_SIDES.index(self._side) + 1) % len(_SIDES)]
        self._say()

    def action_cancel(self) -> None:
        """Close without a name."""
        self.dismiss(None)
