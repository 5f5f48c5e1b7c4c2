"""The orientation screen: one model, measured, judged, measured again and accepted."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal
from textual.content import Content
from textual.message import Message
from textual.screen import Screen

from anaplot.console.blockpage import TITLE as BLOCK_TITLE
from anaplot.console.blockpage import block_page
from anaplot.console.commands import CommandThread
from anaplot.console.describe import describe_model, describe_row
from anaplot.console.dialogs import Ask, AskName, Page
from anaplot.console.errorspage import FIRST, ErrorsPage, errors_line, errors_lines
from anaplot.console.helptext import help_lines
from anaplot.console.inwork import in_work
from anaplot.console.keybar import KeyBar, KeyHint, show_keys
from anaplot.console.keymap import keys_in_force
from anaplot.console.keys import ACTIONS, Action, bindings, is_live, label_now
from anaplot.console.mailbox import Mailbox
from anaplot.console.mapview import MapView
from anaplot.console.panels import (
    AdvicePanel,
    DetailsPane,
    ExpectedLine,
    HeaderPanel,
    MessagePanel,
    ReadOutLine,
    entry_lines,
)
from anaplot.console.rows import SORT_ORDERS, ShownRow, shown_rows, sort_rows
from anaplot.console.stationlike import ControlsLike, StationLike
from anaplot.console.stereoview import StereoView, Viewed
from anaplot.console.tableview import TableView
from anaplot.console.wheels import Wheels
from anaplot.session import commands
from anaplot.session.commands import Command
from anaplot.station.snapshot import Snapshot
from anaplot.textfiles.wording import plain

__all__ = ["OrientationScreen"]

_READOUT_HZ = 20.0
_TOGETHER = 0.01  # s
_LAYOUTS = ("both", "map", "table")
_PAGE_WIDTH = 72
_READABLE = ("live", "replay")  # states of a link whose read-out is one


class OrientationScreen(Screen[None]):
    """Everything about the current model on one screen.

    The screen decides nothing: keys become commands to the station, snapshots become lines.

    Parameters
    ----------
    station
        What is shown and commanded.
    keymap
        The user's keys, checked, by action id.
    controls
        Those of its simulated instrument; None where it has none.
    """

    BINDINGS: ClassVar[list[BindingType]] = [*bindings()]

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (120, "-wide"), (156, "-broad")]  # noqa: RUF012
    VERTICAL_BREAKPOINTS = [(0, "-low"), (32, "-tall")]  # noqa: RUF012

    DEFAULT_CSS = """
    OrientationScreen {
        layout: vertical;
        overflow: hidden;
        #body { height: 1fr; }
        #table { width: 53; margin-right: 1; }
        #map { width: 1fr; }
        #details { display: none; width: 38; margin-left: 1; }
        &.-wide #details, &.-broad #details { display: block; }
        &.-broad #table { width: 68; }
        &.-broad #details { width: 46; }
        &.-tall #advice { height: 5; }
        &.-tall #messages { height: 3; }
        &.-broad #keys { height: 1; }
        #stereo { display: none; width: 1fr; }
        &.-stereo #stereo { display: block; }
        &.-stereo #map, &.-stereo #details { display: none; }
        &.-stereo.-narrow #table { width: 31; }
        &.-stereo.-broad #table { width: 53; }
        &.-stereo.-broad #stereo { width: 66; }
        &.-stereo.-broad #map { display: block; margin-left: 1; }
        &.-only-map #table { display: none; }
        &.-only-table #map { display: none; }
        &.-only-table #table { width: 1fr; }
    }
    """

    class Woken(Message):
        """The mailbox has something."""

    def __init__(
        self,
        station: StationLike,
        keymap: dict[str, str] | None = None,
        controls: ControlsLike | None = None,
    ) -> None:
        super().__init__()
        self._station = station
        self._controls = controls
        self._keys = keys_in_force(keymap or {})
        self._mailbox = Mailbox(self._wake)
        self._commands = CommandThread(partial(self._mailbox.put_notice, "error"))
        self._unsubscribe: list[Callable[[], None]] = []
        self._snapshot: Snapshot | None = None
        self._flagged: frozenset[tuple[str, str]] = frozenset()
        self._order = SORT_ORDERS[0]
        self._layout_shown = _LAYOUTS[0]
        self._all_transfers = False
        self._moved_by_hand = False
        self._stereo_on = False
        self._wheels = Wheels()
        self._unread: list[tuple[str, str]] = []
        self._block_page: Page | None = None
        self._errors_page: ErrorsPage | None = None
        self._strategy: str | None = None  # for gross errors, once one is chosen

    # -- layout and life -------------------------------------------------------------------

    def compose(self) -> ComposeResult:
        """Lay the screen out."""
        yield HeaderPanel(id="header")
        yield ReadOutLine(id="readout")
        yield ExpectedLine(id="expected")
        with Horizontal(id="body"):
            yield TableView(id="table")
            yield StereoView(id="stereo")
            yield MapView(id="map")
            yield DetailsPane(id="details")
        yield AdvicePanel(id="advice")
        yield MessagePanel(id="messages")
        yield KeyBar(id="keys")

    def on_mount(self) -> None:
        """Listen to the station and show what there is."""
        self._commands.start()
        self._unsubscribe = [
            self._station.subscribe(self._mailbox.put_snapshot),
            self._station.subscribe_notices(self._mailbox.put_notice),
        ]
        self._show(self._station.snapshot())
        self._poll()
        self.set_interval(1.0 / _READOUT_HZ, self._poll)

    def on_unmount(self) -> None:
        """Let the station go; commands given so far are carried out."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        self._unsubscribe = []
        self._commands.close()

    def _wake(self) -> None:
        """Post one message from whatever thread has news; after the end there is nobody to tell."""
        try:
            self.post_message(self.Woken())
        except RuntimeError:  # the event loop closed between the look and the call
            if self.is_running:
                raise

    def on_orientation_screen_woken(self) -> None:
        """Show the newest snapshot and all notices."""
        snapshot, notices = self._mailbox.take()
        self._unread += notices
        if snapshot is None:
            # the snapshot that goes with a notice is a moment behind: one repaint for both
            self.set_timer(_TOGETHER, self._say_unread)
            return
        self._say_unread()
        if self._snapshot is None or snapshot.serial >= self._snapshot.serial:
            self._show(snapshot)

    def _say_unread(self) -> None:
        notices, self._unread = self._unread, []
        for severity, text in notices:
            self._say(severity, text)
        if any(severity == "record" for severity, _ in notices):
            self.app.bell()

    def _poll(self) -> None:
        if self._snapshot is None:
            return
        link = self._snapshot.link
        self.query_one(ReadOutLine).show(self._station.readout(), live=link.state in _READABLE)
        self.query_one(HeaderPanel).show(self._snapshot, automatic=self._automatic)
        self._show_stereo()

    def _show_stereo(self) -> None:
        """Look into the eyepieces, if they are on the screen."""
        view, snapshot = self.query_one(StereoView), self._snapshot
        if snapshot is None or not view.display:
            return
        raster, controls = view.raster, self._controls
        pair = None
        if raster is not None and controls is not None:
            pair = controls.stereo(*raster, self._wheels.field_mm)
        readout = self._station.readout() if snapshot.link.state in _READABLE else None
        view.show(Viewed(snapshot.left, snapshot.right, pair, readout, self._wheels, self._hand))

    @property
    def _at_wheels(self) -> bool:
        """Whether the keys turn the handwheels: a simulated plotter's stereo view is shown."""
        return self._stereo_shown and self._controls is not None

    @property
    def _stereo_shown(self) -> bool:
        return self._stereo_on and self._layout_shown != "table"

    @property
    def _automatic(self) -> bool:
        return self._controls is not None and self._controls.automatic

    @property
    def _hand(self) -> bool:
        return self._controls is not None and self._controls.hand

    # -- showing ---------------------------------------------------------------------------

    def _show(self, snapshot: Snapshot) -> None:
        before, self._snapshot = self._snapshot, snapshot
        table = self.query_one(TableView)
        if before is None or _phase(before) != _phase(snapshot):
            self._flagged = frozenset()
            self._moved_by_hand = False
            table.show((), self._order)  # the cursor begins anew
        rows = sort_rows(shown_rows(snapshot), self._order)
        table.show(rows, self._order, fiducials=snapshot.inner is not None)
        flagged = frozenset(in_work(snapshot).flagged)
        if flagged - self._flagged:
            if before is not None:
                self.app.bell()
            if not self._moved_by_hand:
                self._select_flag(after=None)
        self._flagged = flagged
        self.query_one(HeaderPanel).show(snapshot, automatic=self._automatic)
        self.query_one(ExpectedLine).show(snapshot)
        self._show_advice(snapshot)
        if snapshot.link.detail and (before is None or before.link != snapshot.link):
            faulty = snapshot.link.state not in ("live", "none", "opening")
            self._say("warning" if faulty else "info", f"link: {snapshot.link.detail}")
        if self._block_page is not None:
            self._block_page.show(block_page(snapshot.block_view, _PAGE_WIDTH))
        if self._errors_page is not None:
            self._errors_page.renew()
        self._show_selected()

    def _show_advice(self, snapshot: Snapshot) -> None:
        solution = snapshot.solution if snapshot.inner is None else None
        self.query_one(AdvicePanel).show(snapshot, errors_line(solution, self._strategy))

    def _show_selected(self) -> None:
        if self._snapshot is None:
            return
        shown = self._selected
        self.query_one(MapView).show(
            self._snapshot, shown.key if shown else None, all_transfers=self._all_transfers
        )
        self.query_one(DetailsPane).show(self._snapshot, shown)
        self._show_keys()

    def _show_keys(self) -> None:
        if self._snapshot is None:
            return
        snapshot, shown = self._snapshot, self._selected
        row_off = shown is not None and shown.state == "off"
        point_off = shown is not None and self._point_off(shown.point)
        rows = len(self.query_one(TableView).shown)
        self.query_one(KeyBar).show(
            tuple(
                KeyHint(
                    action.id,
                    self._keys_of(action),
                    label_now(
                        action,
                        snapshot,
                        row_off=row_off,
                        point_off=point_off,
                        stereo=self._stereo_shown,
                        coarse=self._wheels.coarse,
                        hand=self._hand,
                    ),
                    action.weight,
                )
                for action in ACTIONS
                if action.label and is_live(action.id, snapshot, rows=rows, wheels=self._at_wheels)
            )
        )

    def _keys_of(self, action: Action) -> str:
        """Return the keys shown for an action: its first, and those of the rest of its group."""
        together = [a for a in ACTIONS if a.group == action.group] if action.group else [action]
        return show_keys(self._keys[a.id][0] for a in together)

    @property
    def _selected(self) -> ShownRow | None:
        return self.query_one(TableView).selected

    def _point_off(self, point: str) -> bool:
        return self._snapshot is not None and any(
            view.point == point and view.status == "off" for view in in_work(self._snapshot).points
        )

    def _say(self, severity: str, text: str) -> None:
        self.query_one(MessagePanel).say(severity, text)

    def _submit(self, command: Callable[[], None]) -> None:
        self._commands.submit(command)

    def _give(self, command: Command) -> None:
        self._submit(partial(self._station.give, command))

    # -- the operator's work ---------------------------------------------------------------

    def action_record(self) -> None:
        """Record the point under the mark."""
        self._give(commands.Record())

    def drive_to(self, point: str) -> None:
        """Drive the plates to a point."""
        self._give(commands.Drive(point))

    def action_drive(self) -> None:
        """Drive to the selected row's point."""
        if self._selected is None:
            self._say("warning", "no row is selected")
        else:
            self.drive_to(self._selected.point)

    def action_next_point(self) -> None:
        """Drive to the point expected next."""
        if self._snapshot is None or self._snapshot.next_point is None:
            self._say("warning", "no point is expected next")
        else:
            self.drive_to(self._snapshot.next_point)

    def action_accept(self) -> None:
        """Accept inner orientation or model when that may be done; with flagged rows, ask first."""
        snapshot = self._snapshot
        if snapshot is None:
            return
        if not snapshot.may_accept:
            reason = snapshot.problem or snapshot.expected
            what = "the model" if snapshot.inner is None else "the inner orientation"
            self._say("warning", f"{what} cannot be accepted now: {reason}")
            return
        flagged = len(in_work(snapshot).flagged)
        if not flagged:
            self._give(commands.Accept())
            return
        rows = "1 row is" if flagged == 1 else f"{flagged} rows are"
        where = f"model {snapshot.left} / {snapshot.right}"
        if snapshot.inner is not None:
            where = f"the inner orientation of photo {snapshot.inner.photo}"
        self.app.push_screen(
            Ask(
                f"{rows} still flagged in {where}. Accept it?",
                yes="accept as it is",
                no="go on measuring",
            ),
            self._accept_if,
        )

    def _accept_if(self, yes: bool | None) -> None:
        if yes:
            self._give(commands.Accept())

    def action_next_model(self) -> None:
        """Go on to the next model."""
        self._give(commands.NextModel())

    def action_other_photo(self) -> None:
        """Say that the other photo lies in the mono comparator."""
        self._give(commands.OtherPhoto())

    def action_reference(self) -> None:
        """Refer the counters to the row selected by hand, if it is measured, or as proposed."""
        shown = self._selected
        chosen = None
        if self._moved_by_hand and shown is not None and shown.state == "measured":
            chosen = shown.point
        self._give(commands.Reference(chosen))

    def action_keep_counters(self) -> None:
        """Keep the counters as they are, when asked once more."""
        if self._snapshot is None or not self._snapshot.unreferenced:
            self._say("info", "the counters have their reference")
            return
        self.app.push_screen(
            Ask(
                "Did the counters keep their origin, or were they set to it by hand? Everything "
                "measured from now on depends on that.",
                yes="keep them as they are",
                no="measure a reference",
            ),
            self._keep_if,
        )

    def _keep_if(self, yes: bool | None) -> None:
        if yes:
            self._give(commands.KeepCounters())

    def action_undo(self) -> None:
        """Take the last event back."""
        self._give(commands.Undo())

    def action_switch_row(self) -> None:
        """Switch the selected row off, or on again."""
        shown = self._selected
        if shown is None:
            self._say("warning", "no row is selected")
        else:
            self._give(commands.Switch(shown.point, shown.axis, shown.state == "off"))

    def action_switch_point(self) -> None:
        """Switch the selected row's whole point off, or on again."""
        shown = self._selected
        if shown is None:
            self._say("warning", "no row is selected")
        else:
            on = self._point_off(shown.point)
            self._give(commands.Switch(shown.point, None, on))

    def action_automatic(self) -> None:
        """Let the simulated operator work, or stop him."""
        controls = self._controls
        if controls is None:
            self._say("warning", "only a simulated plotter has a simulated operator")
        else:
            self._submit(lambda: controls.set_automatic(not controls.automatic))

    def action_suspend(self) -> None:
        """Suspend the work, or resume it."""
        if self._snapshot is not None:
            suspended = self._snapshot.suspended
            self._give(commands.Resume() if suspended else commands.Suspend())

    def action_stop(self) -> None:
        """Stop the plates."""
        self._give(commands.Stop())

    def action_add_point(self) -> None:
        """Ask for a name and add the point."""
        self.app.push_screen(AskName(), self._add)

    def _add(self, name: str | None) -> None:
        if name:
            self._give(commands.AddPoint(name))

    # -- the handwheels --------------------------------------------------------------------

    def _turn(
        self, x: int = 0, y: int = 0, px: int = 0, py: int = 0, *, coarse: bool = False
    ) -> None:
        """Turn the handwheels by so many steps."""
        if self._controls is None or not self._at_wheels:
            self._say("info", "the handwheels are those of a simulated plotter's stereo view (v)")
            return
        step = self._wheels.step_um(coarse=coarse) / 1000.0
        self._submit(partial(self._controls.turn, x * step, y * step, px * step, py * step))

    def action_left(self) -> None:
        """Move the mark to the left."""
        self._turn(x=-1)

    def action_right(self) -> None:
        """Move the mark to the right."""
        self._turn(x=1)

    def action_up(self) -> None:
        """Move the mark up, or select the row above."""
        if self._at_wheels:
            self._turn(y=1)
        else:
            self.action_row_up()

    def action_down(self) -> None:
        """Move the mark down, or select the row below."""
        if self._at_wheels:
            self._turn(y=-1)
        else:
            self.action_row_down()

    def action_page_up(self) -> None:
        """Make px larger, or select a row one page above."""
        if self._at_wheels:
            self._turn(px=1)
        else:
            table = self.query_one(TableView)
            table.move(-table.page)

    def action_page_down(self) -> None:
        """Make px smaller, or select a row one page below."""
        if self._at_wheels:
            self._turn(px=-1)
        else:
            table = self.query_one(TableView)
            table.move(table.page)

    def action_py_more(self) -> None:
        """Make py larger."""
        self._turn(py=1)

    def action_py_less(self) -> None:
        """Make py smaller."""
        self._turn(py=-1)

    def action_far_left(self) -> None:
        """Move the mark far to the left."""
        self._turn(x=-1, coarse=True)

    def action_far_right(self) -> None:
        """Move the mark far to the right."""
        self._turn(x=1, coarse=True)

    def action_far_up(self) -> None:
        """Move the mark far up."""
        self._turn(y=1, coarse=True)

    def action_far_down(self) -> None:
        """Move the mark far down."""
        self._turn(y=-1, coarse=True)

    def action_far_px_more(self) -> None:
        """Make px much larger."""
        self._turn(px=1, coarse=True)

    def action_far_px_less(self) -> None:
        """Make px much smaller."""
        self._turn(px=-1, coarse=True)

    def action_far_py_more(self) -> None:
        """Make py much larger."""
        self._turn(py=1, coarse=True)

    def action_far_py_less(self) -> None:
        """Make py much smaller."""
        self._turn(py=-1, coarse=True)

    def action_zoom_in(self) -> None:
        """Show a smaller field."""
        self._set_wheels(self._wheels.zoomed(1))

    def action_zoom_out(self) -> None:
        """Show a wider field."""
        self._set_wheels(self._wheels.zoomed(-1))

    def action_coarse(self) -> None:
        """Take coarse steps, or fine ones again."""
        self._set_wheels(self._wheels.toggled())

    def _set_wheels(self, wheels: Wheels) -> None:
        self._wheels = wheels
        self._show_stereo()
        self._show_keys()

    def action_hand(self) -> None:
        """Let the simulated hand set the mark, or not."""
        controls = self._controls
        if controls is not None:
            self._submit(lambda: controls.set_hand(not controls.hand))
        elif self._snapshot is not None and self._snapshot.link.state == "replay":
            self._say("error", "this is a replay: one can only look on")
        else:
            self._say("error", "only a simulated plotter is worked from here")

    # -- looking around --------------------------------------------------------------------

    def on_table_view_selected(self) -> None:
        """Show what belongs to the row selected by hand."""
        self._moved_by_hand = True
        self._show_selected()

    def on_table_view_driven(self) -> None:
        """Drive to a row that was double-clicked."""
        self.action_drive()

    async def on_key_bar_pressed(self, event: KeyBar.Pressed) -> None:
        """Do what a clicked key does."""
        await self.run_action(event.action)

    def action_row_up(self) -> None:
        """Select the row above."""
        self.query_one(TableView).move(-1)

    def action_row_down(self) -> None:
        """Select the row below."""
        self.query_one(TableView).move(1)

    def action_first(self) -> None:
        """Select the first row."""
        table = self.query_one(TableView)
        table.move(-len(table.shown))

    def action_last(self) -> None:
        """Select the last row."""
        table = self.query_one(TableView)
        table.move(len(table.shown))

    def action_next_flag(self) -> None:
        """Select the next flagged row, the most probable first."""
        shown = self._selected
        if not self._select_flag(after=shown.key if shown else None):
            self._say("info", "nothing is flagged")
        self._show_selected()

    def _select_flag(self, *, after: tuple[str, str] | None) -> bool:
        """Select the first suspect, or the one after `after`; returns whether there is one."""
        if self._snapshot is None:
            return False
        ranked = in_work(self._snapshot).flagged
        if not ranked:
            return False
        place = ranked.index(after) + 1 if after in ranked else 0
        wanted = ranked[place % len(ranked)]
        table = self.query_one(TableView)
        return any(table.select(row.key) for row in table.shown if row.key == wanted)

    def action_sort(self) -> None:
        """Sort by the next order."""
        self._order = SORT_ORDERS[(SORT_ORDERS.index(self._order) + 1) % len(SORT_ORDERS)]
        if self._snapshot is not None:
            rows = sort_rows(shown_rows(self._snapshot), self._order)
            fiducials = self._snapshot.inner is not None
            self.query_one(TableView).show(rows, self._order, fiducials=fiducials)
        self._say("info", f"sorted by {self._order}" if self._order != "table" else "table order")

    def action_transfers(self) -> None:
        """Show the critical transfers of all rows, or of the selected one."""
        self._all_transfers = not self._all_transfers
        self._say(
            "info",
            "critical transfers of all rows"
            if self._all_transfers
            else "critical transfers of the selected row",
        )
        self._show_selected()

    def action_layout(self) -> None:
        """Show table and map, the map alone, or the table alone."""
        place = (_LAYOUTS.index(self._layout_shown) + 1) % len(_LAYOUTS)
        self._layout_shown = _LAYOUTS[place]
        self._lay_out()

    def action_stereo(self) -> None:
        """Show the stereo view in place of the map, or the map again."""
        hidden = self._layout_shown == "table"
        self._stereo_on = hidden or not self._stereo_on
        if hidden:
            self._layout_shown = "both"
        self._lay_out()

    def _lay_out(self) -> None:
        self.set_class(self._layout_shown == "map", "-only-map")
        self.set_class(self._layout_shown == "table", "-only-table")
        self.set_class(self._stereo_shown, "-stereo")
        self._show_keys()
        self.call_after_refresh(self._show_stereo)

    def action_redraw(self) -> None:
        """Draw everything again."""
        if self._snapshot is not None:
            self._show(self._snapshot)
        self.app.refresh(layout=True)
        self.refresh(layout=True, repaint=True)

    def action_details(self) -> None:
        """Show all that is known of the selected row."""
        shown = self._selected
        if shown is None or self._snapshot is None:
            self._say("warning", "no row is selected")
            return
        lines = entry_lines(describe_row(shown, self._snapshot), _PAGE_WIDTH, 20)
        self.app.push_screen(Page(f"{plain(shown.point)} {shown.axis}", lines))

    def action_orientation(self) -> None:
        """Show the model's orientation."""
        if self._snapshot is not None:
            lines = entry_lines(describe_model(self._snapshot), _PAGE_WIDTH, 14)
            inner = self._snapshot.inner is not None
            title = "Inner orientation" if inner else "Orientation of the model"
            self.app.push_screen(Page(title, lines))

    def action_messages(self) -> None:
        """Show all messages."""
        lines = self.query_one(MessagePanel).history(_PAGE_WIDTH)
        self.app.push_screen(Page("Messages", lines))

    def action_block(self) -> None:
        """Show what the block as a whole says, kept up to date while it is read."""
        if self._snapshot is not None:
            lines = block_page(self._snapshot.block_view, _PAGE_WIDTH)
            self._block_page = Page(BLOCK_TITLE, lines)
            self.app.push_screen(self._block_page, self._block_read)

    def _block_read(self, _: None) -> None:
        self._block_page = None

    def action_errors(self) -> None:
        """Show what a strategy for gross errors finds in the model; it is chosen there."""
        if self._snapshot is not None:
            self._choose(self._strategy or FIRST)
            page = ErrorsPage(self._strategy or FIRST, self._errors_lines, self._choose)
            self._errors_page = page
            self.app.push_screen(page, self._errors_read)

    def show_errors(self, strategy: str) -> None:
        """Choose a strategy for gross errors and show what it finds."""
        self._strategy = strategy
        self.action_errors()

    def _errors_lines(self, strategy: str) -> list[Content]:
        solution = None if self._snapshot is None else self._snapshot.solution
        return errors_lines(solution, strategy, _PAGE_WIDTH)

    def _choose(self, strategy: str) -> None:
        self._strategy = strategy
        if self._snapshot is not None:
            self._show_advice(self._snapshot)

    def _errors_read(self, _: None) -> None:
        self._errors_page = None

    def action_help(self) -> None:
        """Explain the screen."""
        self.app.push_screen(Page("Orientation screen", help_lines(self._keys, _PAGE_WIDTH)))

    def points(self) -> tuple[str, ...]:
        """Return the points of the current model, or the fiducials of an inner orientation."""
        return tuple(v.point for v in in_work(self._snapshot).points) if self._snapshot else ()

    def action_leave(self) -> None:
        """Leave; with a model in progress, ask first."""
        snapshot = self._snapshot
        in_progress = (
            snapshot is not None
            and bool(snapshot.left)
            and not snapshot.finished
            and (snapshot.left, snapshot.right) not in snapshot.accepted
            and _measured(snapshot)
        )
        if snapshot is None or not in_progress:
            self.app.exit(0)
            return
        self.app.push_screen(
            Ask(
                f"Model {snapshot.left} / {snapshot.right} is not accepted yet. Everything "
                "recorded is on disk, and the work goes on here next time. Leave?",
                yes="leave",
                no="stay",
                id="leave",
            ),
            self._leave_if,
        )

    def _leave_if(self, yes: bool | None) -> None:
        if yes:
            self.app.exit(0)


def _phase(snapshot: Snapshot) -> tuple[str, ...]:
    """Return what changes when other rows come into the table: photos, and the one oriented."""
    inner = snapshot.inner
    return (
        snapshot.left,
        snapshot.right,
        snapshot.laid,
        *(() if inner is None else (inner.photo, inner.side)),
    )


def _measured(snapshot: Snapshot) -> bool:
    """Return whether anything was measured in the current model."""
    fiducials = any(view.times for inner in snapshot.inners for view in inner.fiducials)
    return fiducials or any(view.times for view in snapshot.points)
