"""A recorded session as a station that one can only look at."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TextIO

from anaplot.errors import AnaplotError, InputError
from anaplot.exchange.journal import JournalRecord
from anaplot.exchange.journalkinds import is_known
from anaplot.exchange.journalstored import StoredRecords
from anaplot.photogrammetry.block import Block
from anaplot.session.commands import Command
from anaplot.session.desk import Desk
from anaplot.session.events import (
    FiducialMeasured,
    InnerAccepted,
    ModelAccepted,
    ModelReopened,
    MonoMeasured,
    PhotoLaid,
    PointMeasured,
    PointRepeated,
)
from anaplot.session.plates import ReadOut, image_of, plates_of
from anaplot.session.requests import Severity
from anaplot.session.state import SessionState, start
from anaplot.session.workflow import Outlook
from anaplot.station.blockwatch import BlockWatch
from anaplot.station.commanded import Commanded
from anaplot.station.livestatus import LiveStatus
from anaplot.station.replay import Step, recorded_block, replay
from anaplot.station.snapshot import LinkView, Snapshot, snapshot_of
from anaplot.textfiles.wording import typed_path

__all__ = ["ReplayStation"]

_LINK = LinkView("replay", "recorded")
_LONGEST_PAUSE = 5.0  # recorded seconds; nobody watches an operator at lunch


class ReplayStation(Commanded):
    """Plays a recorded session at a given speed; every command but closing is refused.

    Parameters
    ----------
    session
        A journal file, a folder `sessions`, or a block folder.
    speed
        Recorded seconds per second; pauses are cut to five recorded seconds.

    Raises
    ------
    InputError
        It cannot be read or is damaged.
    """

    def __init__(self, session: Path, speed: float) -> None:
        super().__init__(session)
        self._records = StoredRecords(session, is_known)
        self._block = recorded_block(session, self._records.openings)
        self._speed = speed
        self._stop = threading.Event()
        self._before: datetime | None = None
        self._serial = 0
        self._readout: ReadOut | None = None
        self._lock = threading.Lock()
        self._of_session: set[str] = set()
        self._watch = BlockWatch(self._block_seen)
        self._status = LiveStatus(typed_path(session))
        self._desk = Desk.at(start(self._block))
        self._snapshot = self._first()
        self._thread: threading.Thread | None = None

    def _first(self) -> Snapshot:
        return self._with_status(snapshot_of(self._desk, 0, _LINK))

    # -- playing -------------------------------------------------------------------------------

    def start(self) -> None:
        """Play in a thread of its own."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._background, name="replay", daemon=True)
            self._thread.start()

    def run(self, out: TextIO) -> int:
        """Play in this thread and print what happens; returns the exit code."""
        different = False
        for step in self._steps():
            for line in _told(step):
                print(f"{step.record.time}  {line}", file=out, flush=True)
            different |= step.difference is not None
        return 1 if different else 0

    def _background(self) -> None:
        try:
            for step in self._steps():
                self._show(step)
            self._audience.tell([("info", "the recorded session ends here")])
        except AnaplotError as error:
            self._audience.tell([("error", str(error))])

    def _steps(self) -> Iterator[Step]:
        for step in replay(self._block, self._records, self._pace):
            if self._stop.is_set():
                return
            yield step

    def _pace(self, record: JournalRecord) -> None:
        now = datetime.fromisoformat(record.time)
        before, self._before = self._before, now
        if before is not None:
            pause = min(max((now - before).total_seconds(), 0.0), _LONGEST_PAUSE)
            self._stop.wait(pause / self._speed)

    def _show(self, step: Step) -> None:
        if step.position is not None:
            self._readout = image_of(step.position, plates_of(step.state))
        if step.event is None and step.difference is None:
            return
        # as recorded: what lies in the folder today was not there
        state, view = step.state, step.desk.outlook
        self._of_session.update(model.name for model in state.models)
        self._watch.tell(state.block, state, view, self._of_session)
        self._desk = step.desk
        self._publish(snapshot_of(replace(step.desk, target=view.next_point), 0, _LINK))
        severity: Severity = "info" if step.difference is None else "error"
        self._audience.tell([(severity, line) for line in _told(step)])

    def _block_seen(self) -> None:
        self._publish(None)

    def _publish(self, shown: Snapshot | None) -> None:
        """Show a new picture, or the old one with what the block says now."""
        with self._lock:
            self._serial += 1
            now = replace(self._snapshot if shown is None else shown, serial=self._serial)
            self._snapshot = now = self._with_status(now)
        self._audience.show(now)

    def _with_status(self, shown: Snapshot) -> Snapshot:
        """Return a picture with what the block says now, and where it stands."""
        watch = self._watch
        status = self._status.now(self._block, self._desk, watch.view, watch.tables)
        return replace(shown, block_view=status.block, status=status)

    # -- looking -------------------------------------------------------------------------------

    @property
    def block(self) -> Block:
        """The block as it was declared."""
        return self._block

    @property
    def state(self) -> SessionState:
        """The session's state, as far as it was played."""
        return self._desk.state

    def snapshot(self) -> Snapshot:
        """Return the current snapshot."""
        return self._snapshot

    def readout(self) -> ReadOut | None:
        """Return the recorded read-out."""
        return self._readout

    def subscribe(self, callback: Callable[[Snapshot], None]) -> Callable[[], None]:
        """Call back with every new snapshot; the first subscriber starts the replay."""
        end = super().subscribe(callback)
        self.start()
        return end

    def give(self, command: Command) -> None:
        """Refuse."""
        raise InputError("this is a replay: one can only look on")

    def close(self) -> None:
        """Stop playing; a second call does nothing."""
        self._stop.set()
        self._watch.close()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()


def _told(step: Step) -> list[str]:
    """Return what a person is told of a step."""
    lines = []
    event = step.event
    if isinstance(event, PointMeasured):
        lines.append(f"{event.left}/{event.right}: {event.point} recorded")
        lines += _advice(step.desk.outlook)
    elif isinstance(event, MonoMeasured):
        photo = event.left if event.side == "left" else event.right
        lines.append(f"{event.left}/{event.right}: {event.point} recorded in photo {photo}")
        lines += _advice(step.desk.outlook)
    elif isinstance(event, PhotoLaid):
        lines.append(f"photo {event.photo} laid into the comparator")
    elif isinstance(event, PointRepeated):
        lines.append(f"{'fiducial' if event.fiducial else 'point'} {event.name} pointed at again")
    elif isinstance(event, FiducialMeasured):
        lines.append(f"photo {event.photo} ({event.side}): fiducial {event.fiducial} recorded")
        inner = step.desk.outlook.inner
        if inner is not None and inner.suspects:
            lines.append(inner.advice[0])
    elif isinstance(event, InnerAccepted):
        lines.append(f"inner orientation of photo {event.photo} ({event.side}) accepted")
    elif isinstance(event, ModelAccepted):
        lines.append(f"model {event.left}/{event.right} accepted")
    elif isinstance(event, ModelReopened):
        lines.append(f"model {event.left}/{event.right} is open again")
    elif event is not None:
        lines.append(event.kind.replace("-", " "))
    if step.difference is not None:
        lines.append(f"DIFFERENT: {step.difference}")
    return lines


def _advice(view: Outlook) -> tuple[str, ...]:
    """Return what is said of a model with flagged rows."""
    flagged = view.solution is not None and view.solution.flagged
    return view.diagnosis.advice[:1] if flagged and view.diagnosis is not None else ()
