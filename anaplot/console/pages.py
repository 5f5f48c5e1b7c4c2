"""The pages laid over the orientation screen, kept up to date while they are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from textual.app import App
from textual.content import Content

from anaplot.console.blockpage import BlockPage
from anaplot.console.computedpage import ComputedPage
from anaplot.console.describe import describe_model, describe_row
from anaplot.console.dialogs import LINE, Page
from anaplot.console.errorspage import FIRST, ErrorsPage, errors_lines
from anaplot.console.fitpage import FitChoice, FitPage
from anaplot.console.helppage import HelpPage
from anaplot.console.helptext import help_lines
from anaplot.console.keybar import show_key
from anaplot.console.logpage import LogPage
from anaplot.console.panels import entry_lines
from anaplot.console.pointingpage import PointingPage
from anaplot.console.rows import ShownRow
from anaplot.console.stationlike import StationLike
from anaplot.console.tiespage import TiesPage
from anaplot.station.snapshot import Snapshot
from anaplot.textfiles.wording import plain

if TYPE_CHECKING:
    from anaplot.station.stripcontrol import StripOnControl

__all__ = ["Pages"]


class Pages:
    """What can be read about the model, the block and the screen itself.

    Parameters
    ----------
    station
        What is shown; computes fits, and how precise the pointing is.
    keys
        The keys in force, by action.
    messages
        Returns all messages, wrapped to a width.
    chosen
        Called when another strategy for gross errors is looked at.
    again
        Begins to point again at something measured.
    back
        Returns to an accepted model: left, right, point and photo.
    report
        Begins to write the report.

    Attributes
    ----------
    strategy
        The strategy for gross errors, once one is chosen.
    """

    def __init__(
        self,
        station: StationLike,
        keys: Mapping[str, tuple[str, ...]],
        messages: Callable[[int], list[Content]],
        chosen: Callable[[], None],
        again: Callable[[], None],
        back: Callable[[str, str, str, str], None],
        report: Callable[[], None],
    ) -> None:
        self.strategy: str | None = None
        self._station, self._snapshot, self._keys = station, station.snapshot(), keys
        self._messages, self._chosen, self._again = messages, chosen, again
        self._back, self._report = back, report
        self._choice = FitChoice()
        self._followed: dict[Page, Callable[[Snapshot], None]] = {}

    def show(self, snapshot: Snapshot) -> None:
        """Bring the pages that follow the work up to date."""
        before, self._snapshot = self._snapshot, snapshot
        for renew in tuple(self._followed.values()):
            renew(before)

    def tell(self, severity: str, text: str) -> None:
        """Say on the block page what becomes of the report that it asked for."""
        for page in self._followed:
            if isinstance(page, BlockPage):
                page.tell(severity, text)

    def open(self, app: App[object], page: str, selected: ShownRow | None) -> None:
        """Open the page of that name; details are those of the selected row."""
        snapshot = self._snapshot
        if page == "details" and selected is not None:
            lines = entry_lines(describe_row(selected, snapshot), LINE, 20)
            app.push_screen(Page(f"{plain(selected.point)} {selected.axis}", lines))
        elif page == "orientation":
            inner = snapshot.inner is not None
            title = "Inner orientation" if inner else "Orientation of the model"
            app.push_screen(Page(title, entry_lines(describe_model(snapshot), LINE, 14)))
        elif page == "messages":
            app.push_screen(Page("Messages", self._messages(LINE)))
        elif page == "block":
            writes = self._report, show_key(self._keys["report"][0])
            block = BlockPage(snapshot, self._back, writes)
            self._follow(app, block, lambda _: block.renew(self._snapshot))
        elif page == "ties":
            ties = TiesPage(snapshot)
            self._follow(app, ties, lambda _: ties.renew(self._snapshot))
        elif page == "fit":
            strip = self._choice.strip or snapshot.strip
            self._choice = replace(self._choice, strip=strip)
            bundle = partial(self.open, app, "block", selected)
            fit = FitPage(self._choice, self._fitted, self._fit_chosen, bundle)
            self._compute(app, fit, _measured)
        elif page == "pointing":
            pointing = PointingPage(self._station.pointing, self._again)
            self._compute(app, pointing, lambda shown: shown.accepted)
        elif page == "log":
            self._compute(app, LogPage(self._station.log, self._model), _events)
        elif page == "errors":
            strategy = self.strategy or FIRST
            self._choose(strategy)
            errors = ErrorsPage(strategy, self._errors_lines, self._choose)
            self._follow(app, errors, lambda _: errors.renew())
        elif page == "help":
            app.push_screen(HelpPage(lambda words: help_lines(self._keys, LINE, words)))

    def _follow(self, app: App[object], page: Page, renew: Callable[[Snapshot], None]) -> None:
        """Open a page that is renewed while it is read; `renew` is told the snapshot before."""
        self._followed[page] = renew

        def closed(_: None) -> None:
            del self._followed[page]

        app.push_screen(page, closed)

    def _compute(
        self, app: App[object], page: ComputedPage, needed: Callable[[Snapshot], object]
    ) -> None:
        """Open a page that is computed anew, while it is read, when what it needs is another."""

        def renew(before: Snapshot) -> None:
            if needed(before) != needed(self._snapshot):
                page.renew()

        self._follow(app, page, renew)

    def _model(self) -> str:
        now = self._snapshot
        return f"{now.left}/{now.right}" if now.left else ""

    def _fit_chosen(self, choice: FitChoice) -> None:
        self._choice = choice

    def _fitted(self, choice: FitChoice) -> tuple[StripOnControl, ...]:
        return self._station.strips_on_control(choice.degree, choice.without)

    def _errors_lines(self, strategy: str) -> list[Content]:
        return errors_lines(self._snapshot.solution, strategy, LINE)

    def _choose(self, strategy: str) -> None:
        self.strategy = strategy
        self._chosen()


def _measured(snapshot: Snapshot) -> tuple[object, ...]:
    """Return what is another when something was measured, switched or accepted."""
    return snapshot.accepted, id(snapshot.solution), snapshot.recomputed


def _events(snapshot: Snapshot) -> tuple[object, ...]:
    """Return what is another when something has happened, and equal when nothing has."""
    inners = tuple((inner.fiducials, inner.accepted) for inner in snapshot.inners)
    model = snapshot.left, snapshot.right, snapshot.reopened, snapshot.accepted
    return *model, snapshot.points, inners, snapshot.last_change
