"""The report of the block, written beside the screen while measuring goes on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from textual.screen import Screen

from anaplot.aliases import Progress
from anaplot.console.beside import Beside
from anaplot.console.keybar import show_key
from anaplot.station.snapshot import Snapshot

__all__ = ["ReportWriting", "WriteReport", "reports_of"]


class WriteReport(Protocol):
    """Writes a report and returns where it lies; may raise an AnaplotError."""

    def __call__(self, *, free: bool, progress: Progress) -> Path:
        """Write it; `free`: without control in any case. What `progress` raises ends it."""


def reports_of(folder: Path) -> WriteReport:
    """Return what writes reports into a block's folder, and loads its mathematics when called."""

    def write(*, free: bool, progress: Progress) -> Path:
        from anaplot.report.keptreport import keep_report

        return keep_report(folder, datum="free" if free else None, progress=progress).page

    return write


class _LeftError(Exception):
    """Nobody waits for the report any more."""


class ReportWriting:
    """Writes one report at a time.

    Parameters
    ----------
    screen
        Whose it is; at its end a report under way is given up.
    write
        Writes it, in a thread; None where no block folder belongs to what is shown.
    say
        Tells the operator: severity and one line.
    keys
        The keys in force, by action.
    temporary
        Whether the block is deleted on leaving, unless it is asked to be kept.
    """

    def __init__(
        self,
        screen: Screen[Any],
        write: WriteReport | None,
        say: Callable[[str, str], None],
        keys: Mapping[str, tuple[str, ...]],
        *,
        temporary: bool = False,
    ) -> None:
        self._screen, self._write, self._say, self._temporary = screen, write, say, temporary
        self._keys = keys
        self._beside = Beside(screen, self._written, self._done, self._failed)
        self._free = self._running = False

    def begin(self, snapshot: Snapshot) -> None:
        """Write the report of the block, in the datum in which it is shown."""
        if self._write is None:
            self._say("hint", "a recorded session is shown: anaplot report BLOCK writes the report")
            return
        if self._running:
            self._say("hint", "the report is being written")
            return
        if not _has_models(snapshot):
            accept = show_key(self._keys["accept"][0])
            self._say("hint", f"no model is accepted yet: {accept} accepts one")
            return
        view = snapshot.block_view
        self._running, self._free = True, view is not None and view.datum == "free"
        self._say("info", "the report of the accepted models is being written: go on measuring")
        self._beside.wanted()

    def _written(self) -> Path:
        def progress(_what: str, _share: float) -> None:
            if not self._screen.is_running:
                raise _LeftError

        assert self._write is not None
        return self._write(free=self._free, progress=progress)

    def _done(self, page: Path) -> None:
        self._running = False
        if self._temporary:
            short = f"{page.parent.name}/{page.name}"
            self._say("report", f"{short}, gone with this block unless kept")
        else:
            self._say("report", str(page))

    def _failed(self, words: str) -> None:
        self._running = False
        self._say("error", f"no report: {words}")


def _has_models(snapshot: Snapshot) -> bool:
    """Return whether the block's files have a model, of this session or from elsewhere."""
    if snapshot.accepted or snapshot.status is None:
        return True
    states = {model.state for model in snapshot.status.models}
    return not states <= {"open", "in work"}
