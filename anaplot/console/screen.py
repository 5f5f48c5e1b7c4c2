"""The orientation screen: one model, measured, judged, measured again and accepted."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal
from textual.message import Message
from textual.screen import Screen

from anaplot.console.asking import asking, asking_name
from anaplot.console.choices import Choices
from anaplot.console.connection import StationConnection
from anaplot.console.dialogs import AskName
from anaplot.console.errorspage import errors_line
from anaplot.console.intent import (
    Intent,
    Leave,
    OtherPointName,
    PointName,
    Question,
    Read,
    Report,
    Say,
    Toggle,
    Turn,
    aimed,
    answer,
    idle,
    intended,
)
from anaplot.console.inwork import in_work, recorded
from anaplot.console.keybar import KeyBar, key_in_words, show_key
from anaplot.console.keymap import keys_in_force
from anaplot.console.keys import bindings, key_hints
from anaplot.console.mapview import MapView
from anaplot.console.now import longest_now, now_of
from anaplot.console.overviewview import OverviewView
from anaplot.console.pages import Pages
from anaplot.console.panels import (
    AdvicePanel,
    DetailsPane,
    ExpectedLine,
    HeaderPanel,
    MessagePanel,
    ReadOutLine,
)
from anaplot.console.reportwriting import ReportWriting, WriteReport
from anaplot.console.rows import shown_rows, sort_rows
from anaplot.console.situation import Situation
from anaplot.console.stationlike import ControlsLike, StationLike
from anaplot.console.stereoview import StereoView
from anaplot.console.tableview import TableView
from anaplot.console.tidying import tidy
from anaplot.console.wheels import TURNS
from anaplot.console.whyline import why_line
from anaplot.session import commands
from anaplot.station.snapshot import Snapshot

__all__ = ["OrientationScreen"]

_READOUT_HZ = 20.0
_TOGETHER = 0.03  # s
_TABLE_SHOWN = 0.1  # s after a record, when its table is on the screen
_QUIET = 5.0  # s without news
_READABLE = ("live", "replay")  # states of a link whose read-out is one


class OrientationScreen(Screen[None]):
    """Everything about the current model on one screen.

    The screen decides nothing: keys become intents (`intent`), snapshots become lines.

    Parameters
    ----------
    station
        What is shown and commanded.
    keymap
        The user's keys, checked, by action id.
    controls
        Those of its simulated instrument; None where it has none.
    temporary
        Whether the block is deleted on leaving, unless it is asked to be kept.
    report
        Writes the report of the block; None where no block folder belongs to the station.
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
        #overview { display: none; width: 1fr; }
        &.-overview #overview { display: block; }
        &.-overview #table, &.-overview #map, &.-overview #stereo { display: none; }
        &.-overview #details, &.-overview #advice { display: none; }
        &.-overview.-welcome #advice { display: block; }
        &.-wide #overview Vertical, &.-broad #overview Vertical { width: 82; }
        &.-wide OverviewMap, &.-broad OverviewMap { display: block; }
        &.-tall OverviewFoot { max-height: 12; }
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
        *,
        temporary: bool = False,
        report: WriteReport | None = None,
    ) -> None:
        super().__init__()
        self._station = station
        self._controls = controls
        self._temporary = temporary
        self._keys = keys_in_force(keymap or {})
        self._connection = StationConnection(station, self._wake)
        self._snapshot = station.snapshot()
        self._choices = Choices()
        self._flagged: frozenset[tuple[str, str]] = frozenset()
        self._moved_by_hand = False
        self._longest = ""
        self._unread: list[tuple[str, str]] = []
        self._report = ReportWriting(self, report, self._say, self._keys, temporary=temporary)
        self._pages = Pages(
            station,
            self._keys,
            lambda width: self.query_one(MessagePanel).history(width),
            self._show_advice,
            self._point_again,
            lambda *there: self._do(commands.ReturnTo(*there)),
            lambda: self._do(Report()),
        )

    # -- layout and life -------------------------------------------------------------------

    def compose(self) -> ComposeResult:
        """Lay the screen out."""
        yield HeaderPanel(id="header")
        yield ReadOutLine(id="readout")
        yield ExpectedLine(id="expected")
        with Horizontal(id="body"):
            yield OverviewView(id="overview")
            yield TableView(id="table")
            yield StereoView(id="stereo")
            yield MapView(id="map")
            yield DetailsPane(
                lambda *size: self.query_one(MessagePanel).history(*size), id="details"
            )
        yield AdvicePanel(id="advice")
        yield MessagePanel(id="messages")
        yield KeyBar(id="keys")

    def on_mount(self) -> None:
        """Listen to the station and show what there is."""
        self._connection.open()
        self._show(self._station.snapshot(), first=True)
        self._poll()
        self.set_interval(1.0 / _READOUT_HZ, self._poll)
        self._quiet = self.set_interval(_QUIET, tidy)

    def on_unmount(self) -> None:
        """Let the station go; commands given so far are carried out."""
        self._connection.close()

    def _wake(self) -> None:
        """Post one message from whatever thread has news; after the end there is nobody to tell."""
        try:
            self.post_message(self.Woken())
        except RuntimeError:  # the event loop closed between the look and the call
            if self.is_running:
                raise

    def on_orientation_screen_woken(self) -> None:
        """Show the newest snapshot and all notices."""
        self._quiet.reset()
        snapshot, notices = self._connection.take()
        self._unread += notices
        if snapshot is None:
            # the snapshot that goes with a notice is a moment behind: one repaint for both
            self.set_timer(_TOGETHER, self._say_unread)
            return
        self._say_unread()
        if snapshot.serial >= self._snapshot.serial:
            self._show(snapshot)

    def _say_unread(self) -> None:
        notices, self._unread = self._unread, []
        for severity, text in notices:
            self._say(severity, text)
        if any(severity == "record" for severity, _ in notices):
            self.app.bell()
            self.set_timer(_TABLE_SHOWN, tidy)

    # -- showing ---------------------------------------------------------------------------

    def _poll(self) -> None:
        live = self._snapshot.link.state in _READABLE
        self.query_one(ReadOutLine).show(self._station.readout(), live=live)
        self.query_one(MessagePanel).age()
        self._show_header()
        self._show_stereo()

    def _show_header(self) -> None:
        automatic = self._controls is not None and self._controls.automatic
        hand = self._controls is None or self._controls.hand
        self.query_one(HeaderPanel).show(self._snapshot, automatic=automatic, hand=hand)

    def _show_stereo(self) -> None:
        """Look into the eyepieces, if they are on the screen."""
        view = self.query_one(StereoView)
        if view.display:
            live = self._snapshot.link.state in _READABLE
            readout = self._station.readout() if live else None
            view.look(self._snapshot, readout, self._controls, self._choices.wheels)

    def _show(self, snapshot: Snapshot, *, first: bool = False) -> None:
        before, self._snapshot = self._snapshot, snapshot
        if first or _phase(before) != _phase(snapshot):
            self._flagged = frozenset()
            self._moved_by_hand = False
            self.query_one(TableView).show((), self._choices.order)  # the cursor begins anew
        if recorded(before) != recorded(snapshot):
            self._moved_by_hand = False
        self.query_one(OverviewView).show(snapshot, self._keys)
        self._show_table()
        flagged = frozenset(in_work(snapshot).flagged)
        if flagged - self._flagged and not first:
            self.app.bell()
        self._flagged = flagged
        self._show_header()
        self._show_advice()
        if snapshot.link.detail and (first or before.link.detail != snapshot.link.detail):
            faulty = snapshot.link.state not in ("live", "none", "opening")
            self._say("warning" if faulty else "info", f"link: {snapshot.link.detail}")
        automatic = self._controls is not None and self._controls.automatic
        question = ("", "") if automatic else why_line(snapshot, self._keys)
        self.query_one(MessagePanel).ask(*question)
        self._pages.show(snapshot)
        self._show_selected()

    def _show_table(self) -> None:
        """Show the rows; the cursor follows the line NOW, unless it was moved by hand."""
        snapshot, order = self._snapshot, self._choices.order
        rows = sort_rows(shown_rows(snapshot), order)
        self.query_one(TableView).show(
            rows,
            order,
            fiducials=snapshot.inner is not None,
            chosen=None if self._moved_by_hand else now_of(snapshot, self._keys).row,
        )
        self._longest = longest_now(snapshot, self._keys, self.points())

    def _show_advice(self) -> None:
        snapshot = self._snapshot
        solution = snapshot.solution if snapshot.inner is None else None
        errors = errors_line(solution, self._pages.strategy)
        self.query_one(AdvicePanel).show(snapshot, errors)

    def _show_selected(self) -> None:
        now = self._situation
        enter = key_in_words(self._keys["drive"][0])
        self.query_one(ExpectedLine).show(
            now.snapshot,
            ", or ".join(filter(None, (aimed(now, enter), now.now.text))),
            self._longest,
        )
        self.set_class(self.query_one(OverviewView).stands, "-overview")
        self.query_one(MapView).show(
            now.snapshot,
            now.selected.key if now.selected else None,
            all_transfers=now.choices.all_transfers,
        )
        self.query_one(DetailsPane).show(now.snapshot, now.selected)
        self.query_one(KeyBar).show(key_hints(now, self._keys))

    @property
    def _situation(self) -> Situation:
        table, overview = self.query_one(TableView), self.query_one(OverviewView)
        return Situation(
            snapshot=self._snapshot,
            selected=table.selected,
            by_hand=self._moved_by_hand,
            rows=len(table.shown),
            choices=self._choices,
            controls=self._controls,
            now=now_of(self._snapshot, self._keys, table.selected if self._moved_by_hand else None),
            overview=overview.stands,
            aim=overview.aim,
            temporary=self._temporary,
        )

    def _say(self, severity: str, text: str) -> None:
        self.query_one(MessagePanel).say(severity, text)
        self.query_one(DetailsPane).show_lines()
        self._pages.tell(severity, text)

    # -- keys ------------------------------------------------------------------------------

    def action_press(self, action: str) -> None:
        """Do what the key of an action means now."""
        self.query_one(MessagePanel).clear()
        table, overview = self.query_one(TableView), self.query_one(OverviewView)
        now = self._situation
        if overview.stands and overview.press(action):
            return
        if action == "overview":
            overview.toggle(self._keys)
            if now.snapshot.status is None:
                self._say("hint", "nothing is known of the block yet")
            self._show_selected()
            return
        if overview.stands:
            overview.give_way(action)
            self._show_selected()
        step = None if now.at_wheels and action in TURNS else table.step(action)
        choices = self._choices.after(action)
        idly = idle(action, now)
        if step is not None:
            self._move(step)
        elif idly:
            self._say("hint", idly)
        elif choices is not None:
            self._choose(choices, choices.said(action))
        elif action == "next_flag":
            self._next_flag()
        elif action == "redraw":
            self._redraw()
        else:
            self._do(intended(action, now))

    def on_key(self, event: events.Key) -> None:
        """Answer a key that means nothing here."""
        bound = self.active_bindings.get(event.key)
        if bound is None or bound.binding.action.startswith("app.focus"):
            self.query_one(MessagePanel).clear()
            helps = show_key(self._keys["help"][0])
            self._say("hint", f"{show_key(event.key)} means nothing here ({helps} helps)")

    def on_key_bar_pressed(self, event: KeyBar.Pressed) -> None:
        """Do what a clicked key does."""
        self.action_press(event.action)

    def on_table_view_driven(self) -> None:
        """Drive to a row that was double-clicked."""
        self.action_press("drive")

    def on_model_list_selected(self) -> None:
        """Show which keys are live on the model selected in the overview."""
        self._show_selected()

    def on_model_list_entered(self) -> None:
        """Go to a model that was clicked again."""
        self.action_press("drive")

    def drive_to(self, point: str) -> None:
        """Drive the plates to a point."""
        self._do(commands.Drive(point))

    def _point_again(self) -> None:
        """Point again at the measured point chosen by hand, else the one under the mark."""
        self._do(commands.PointAgain(self._situation.chosen))

    def show_errors(self, strategy: str) -> None:
        """Choose a strategy for gross errors and show what it finds."""
        self._pages.strategy = strategy
        self._do(Read("errors"))

    def points(self) -> tuple[str, ...]:
        """Return the points of the current model, or the fiducials of an inner orientation."""
        return tuple(view.point for view in in_work(self._snapshot).points)

    def _do(self, intent: Intent) -> None:
        match intent:
            case Say(text):
                self._say("hint", text)
            case Question():
                self.app.push_screen(*asking(intent, self._keys, self._do))
            case PointName():
                self.app.push_screen(AskName(), self._named)
            case OtherPointName():
                self.app.push_screen(*asking_name(intent, self._do))
            case Read(page):
                self._pages.open(self.app, page, self._situation.selected)
            case Report():
                self._report.begin(self._snapshot)
            case Leave(keep):
                self.app.exit(int(keep))  # KEPT, or 0
            case Turn() | Toggle():
                if self._controls is not None:
                    self._connection.submit(partial(intent.at, self._controls))
            case _:
                told = answer(intent, self._snapshot)
                if told:
                    self._say("info", told)
                self._connection.give(intent)

    def _named(self, name: str | None) -> None:
        if name:
            self._do(commands.AddPoint(name))

    # -- looking around --------------------------------------------------------------------

    def on_table_view_selected(self) -> None:
        """Show what belongs to the row selected by hand."""
        self._moved_by_hand = True
        self._show_selected()

    def _choose(self, choices: Choices, said: str) -> None:
        """Show things as they are chosen to be seen."""
        self._choices = choices
        self.set_class(choices.panes == "map", "-only-map")
        self.set_class(choices.panes == "table", "-only-table")
        self.set_class(choices.stereo, "-stereo")
        self._show_table()
        self._show_selected()
        if said:
            self._say("info", said)
        self.call_after_refresh(self._show_stereo)

    def _move(self, step: int) -> None:
        """Move the cursor by rows."""
        if said := self.query_one(TableView).moved(step):
            self._say("hint", said)
        self.on_table_view_selected()

    def _next_flag(self) -> None:
        """Select the next flagged row, the most probable first."""
        table, flagged = self.query_one(TableView), in_work(self._snapshot).flagged
        if said := table.select_next(flagged):
            self._say("hint", said)
        if flagged and table.selected is not None:
            self._moved_by_hand = table.selected.key != self._situation.now.row
        self._show_selected()

    def _redraw(self) -> None:
        self._show(self._snapshot)
        self.app.refresh(layout=True)
        self.refresh(layout=True, repaint=True)


def _phase(snapshot: Snapshot) -> tuple[str, ...]:
    """Return what changes when other rows come into the table: photos, and the one oriented."""
    inner = snapshot.inner
    return (
        snapshot.left,
        snapshot.right,
        snapshot.laid,
        *(() if inner is None else (inner.photo, inner.side)),
    )
