"""The terminal application."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

from textual import events
from textual.app import App, SystemCommand
from textual.binding import Binding, BindingType
from textual.driver import Driver
from textual.screen import Screen
from textual.theme import Theme

from anaplot.console.changedcells import ShownCells, writing_changes
from anaplot.console.errorspage import CHOICES
from anaplot.console.kept import Kept
from anaplot.console.keymap import default_path, load_keymap
from anaplot.console.keys import ACTIONS
from anaplot.console.orderly import OrderlyApp
from anaplot.console.panels import WELCOME, AdvicePanel
from anaplot.console.reportwriting import WriteReport
from anaplot.console.screen import OrientationScreen
from anaplot.console.stationlike import ControlsLike, StationLike
from anaplot.console.tidying import at_ease

if TYPE_CHECKING:
    from anaplot.console.palette import PointProvider

__all__ = ["KEPT", "THEME", "ConsoleApp", "run_console"]

KEPT = 1
"""Result of a console whose operator keeps a block that would be deleted."""

THEME = Theme(
    name="anaplot",
    primary="#7aa6c2",
    secondary="#8fa3ad",
    accent="#8ec3e0",
    warning="#e0b060",
    error="#ef7f72",
    success="#8fbf8a",
    foreground="#d6dadd",
    background="#101417",
    surface="#161b1f",
    panel="#1f262b",
    dark=True,
    variables={
        "foreground-muted": "#9aa5ab",
        "text-primary": "#7fb0d0",
        "text-accent": "#8ec3e0",
        "text-warning": "#e6b566",
        "text-error": "#f0857a",
        "text-success": "#9ccb96",
    },
)


def _point_provider() -> type[PointProvider]:
    # The palette's modules load when it is opened, not when the console starts.
    from anaplot.console.palette import PointProvider

    return PointProvider


class ConsoleApp(OrderlyApp[int]):
    """The console over a station.

    Parameters
    ----------
    station
        What is shown and commanded.
    keymap
        The user's keys, checked, by action id.
    controls
        Those of its simulated instrument; None where it has none.
    kept
        What is kept from one start to the next; None: nothing.
    temporary
        Whether the block is deleted on leaving, unless the operator keeps it: the result is then 1.
    report
        Writes the report of the block; None where no block folder belongs to the station.
    """

    TITLE = "anaplot"
    ALLOW_SELECT = False
    ENABLE_COMMAND_PALETTE = True
    # With priority it works over pages and questions too.
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+c", "help_quit", show=False, priority=True, system=True)
    ]
    COMMANDS: ClassVar = App.COMMANDS | {_point_provider}

    def __init__(
        self,
        station: StationLike,
        keymap: dict[str, str] | None = None,
        *,
        controls: ControlsLike | None = None,
        kept: Kept | None = None,
        temporary: bool = False,
        report: WriteReport | None = None,
    ) -> None:
        self._kept = kept
        self._shown = ShownCells()
        self._greeting: tuple[str, ...] = ()
        super().__init__()
        self._keys_of_user = dict(keymap or {})
        self._main = OrientationScreen(
            station, self._keys_of_user, controls, temporary=temporary, report=report
        )
        self.animation_level = "none"

    def get_driver_class(self) -> type[Driver]:
        """Return what writes to the terminal: of a frame only what changes."""
        return writing_changes(super().get_driver_class(), self._shown)

    def on_resize(self, _: events.Resize) -> None:
        """Write everything again: a terminal of another size has arranged its text anew."""
        self._shown.forget()

    def refresh(
        self, *, repaint: bool = True, layout: bool = False, recompose: bool = False
    ) -> Self:
        """Draw everything again, and write it whole."""
        self._shown.forget()
        return super().refresh(repaint=repaint, layout=layout, recompose=recompose)

    def get_default_screen(self) -> Screen[None]:
        """Return the orientation screen."""
        return self._main

    def on_mount(self) -> None:
        """Take theme and keys into force."""
        self.register_theme(THEME)
        self.theme = THEME.name
        if self._kept is not None:
            self._take_up(self._kept)
        self.set_keymap(self._keys_of_user)
        self.heed_signals()

    def _take_up(self, kept: Kept) -> None:
        """Go on as the console was left, and keep the theme from now on."""
        theme = kept.theme()
        if theme in self.available_themes:
            self.theme = theme
        if kept.first:
            self.call_after_refresh(self._greet, WELCOME)
            kept.keep(self.theme)
        self.theme_changed_signal.subscribe(self, lambda chosen: kept.keep(chosen.name))

    def _greet(self, lines: tuple[str, ...]) -> None:
        if lines == self._greeting:
            return
        self._greeting = lines
        for panel in self._main.query(AdvicePanel):
            panel.greet(lines)
        self._main.set_class(bool(lines), "-welcome")

    def on_key(self, _: events.Key) -> None:
        """End the welcome with the first key."""
        self._greet(())

    def on_click(self, _: events.Click) -> None:
        """End the welcome with the first click."""
        self._greet(())

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Yield what the palette offers: every action of the screen, and the theme."""
        yield SystemCommand("Theme", "Change the colours.", self.action_change_theme)
        if screen is not self._main:
            return
        for action in ACTIONS:
            label = "" if action.group else action.label
            title = label or action.id.replace("_", " ").capitalize()
            yield SystemCommand(title, action.help, partial(self._main.action_press, action.id))
        for strategy in CHOICES:
            about = f"Gross errors of the model by the strategy {strategy}."
            yield SystemCommand(
                f"Errors: {strategy}", about, partial(self._main.show_errors, strategy)
            )

    async def action_quit(self) -> None:
        """Leave as the q key does; asked a second time, leave at once."""
        if self.screen.id == "leave" or not self._main.is_mounted:
            self.exit(0)
            return
        while len(self.screen_stack) > 1:
            self.pop_screen()
        self._main.action_press("leave")

    async def action_help_quit(self) -> None:  # type: ignore[override]
        """Leave: what people mean by ctrl+c."""
        await self.action_quit()


def run_console(
    station: StationLike,
    *,
    controls: ControlsLike | None = None,
    keymap: Path | None = None,
    keep: Callable[[], None] | None = None,
    report: WriteReport | None = None,
) -> int:
    """Run the console until the operator leaves, then close the station; returns the exit code.

    Parameters
    ----------
    station
        What is shown and commanded.
    controls
        Those of its simulated instrument; None where it has none.
    keymap
        A keymap file; None takes the user's own if there is one.
    keep
        Called when the operator keeps a block that would be deleted; None where none would be.
    report
        Writes the report of the block; None where no block folder belongs to the station.

    Raises
    ------
    InputError
        When the keymap cannot be read or is not valid.
    """
    # threads are waited for at the end of the loop: the block is free before
    with asyncio.Runner() as runner, contextlib.closing(station):
        keys = (
            load_keymap(default_path(), required=False) if keymap is None else load_keymap(keymap)
        )
        app = ConsoleApp(
            station,
            keys,
            controls=controls,
            kept=Kept(default_path().with_name("console.toml")),
            temporary=keep is not None,
            report=report,
        )
        with at_ease():
            result = app.run(loop=runner.get_loop())
    if result == KEPT and keep is not None:
        keep()
    return app.return_code or 0
