"""A recorded session as a station that one can only look at."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TextIO

from anaplot.aliases import Axis
from anaplot.errors import AnaplotError, InputError
from anaplot.exchange.journal import Record, read_journal
from anaplot.session.events import (
    FiducialMeasured,
    InnerAccepted,
    ModelAccepted,
    MonoMeasured,
    PhotoLaid,
    PointMeasured,
)
from anaplot.session.plates import ReadOut, image_of, plates_of
from anaplot.session.state import start
from anaplot.session.workflow import outlook
from anaplot.station.blockwatch import BlockWatch
from anaplot.station.replay import Step, recorded_block, replay
from anaplot.station.snapshot import LinkView, Snapshot, picture

__all__ = ["ReplayStation"]

_LONGEST_PAUSE = 5.0  # recorded seconds; nobody watches an operator at lunch


class ReplayStation:
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
        self._records = read_journal(session).records
        self._block = recorded_block(session, self._records)
        self._speed = speed
        self._stop = threading.Event()
        self._before: datetime | None = None
        self._subscribers: list[Callable[[Snapshot], None]] = []
        self._listeners: list[Callable[[str, str], None]] = []
        self._serial = 0
        self._readout: ReadOut | None = None
        self._lock = threading.Lock()
        self._of_session: set[str] = set()
        self._watch = BlockWatch(self._block_seen)
        self._snapshot = self._first()
        self._thread: threading.Thread | None = None

    def _first(self) -> Snapshot:
        state = start(self._block)
        return picture(self._block, state, outlook(state), 0, None, self._link(""))

    def _link(self, detail: str) -> LinkView:
        return LinkView("replay", "recorded", "", False, detail)

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
            self._tell("info", "the recorded session ends here")
        except AnaplotError as error:
            self._tell("error", str(error))

    def _steps(self) -> Iterator[Step]:
        for step in replay(self._block, self._records, self._pace):
            if self._stop.is_set():
                return
            yield step

    def _pace(self, record: Record) -> None:
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
        self._of_session.update(model.name for model in step.state.models)
        self._watch.tell(self._block, step.state, step.view, self._of_session)
        shown = picture(self._block, step.state, step.view, 0, step.view.next_point, self._link(""))
        self._publish(shown)
        for severity, line in [
            ("error" if step.difference is not None else "info", line) for line in _told(step)
        ]:
            self._tell(severity, line)

    def _block_seen(self) -> None:
        self._publish(None)

    def _publish(self, shown: Snapshot | None) -> None:
        """Show a new picture, or the old one with what the block says now."""
        with self._lock:
            self._serial += 1
            self._snapshot = replace(
                self._snapshot if shown is None else shown,
                serial=self._serial,
                block_view=self._watch.view,
            )
            now = self._snapshot
        for subscriber in list(self._subscribers):
            subscriber(now)

    def _tell(self, severity: str, text: str) -> None:
        for listener in list(self._listeners):
            listener(severity, text)

    # -- looking -------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """Return the current snapshot."""
        return self._snapshot

    def readout(self) -> ReadOut | None:
        """Return the recorded read-out."""
        return self._readout

    def subscribe(self, callback: Callable[[Snapshot], None]) -> Callable[[], None]:
        """Call back with every new snapshot; the first subscriber starts the replay."""
        self._subscribers.append(callback)
        self.start()

        def end() -> None:
            with contextlib.suppress(ValueError):
                self._subscribers.remove(callback)

        return end

    def subscribe_notices(self, callback: Callable[[str, str], None]) -> Callable[[], None]:
        """Call back with (severity, line)."""
        self._listeners.append(callback)

        def end() -> None:
            with contextlib.suppress(ValueError):
                self._listeners.remove(callback)

        return end

    # -- commands: none ------------------------------------------------------------------------

    def drive(self, point: str) -> None:
        """Refuse."""
        raise _refused()

    def stop(self) -> None:
        """Refuse."""
        raise _refused()

    def record(self) -> None:
        """Refuse."""
        raise _refused()

    def switch(self, point: str, axis: Axis | None, on: bool) -> None:
        """Refuse."""
        raise _refused()

    def undo(self) -> None:
        """Refuse."""
        raise _refused()

    def accept(self) -> None:
        """Refuse."""
        raise _refused()

    def next_model(self) -> None:
        """Refuse."""
        raise _refused()

    def other_photo(self) -> None:
        """Refuse."""
        raise _refused()

    def reference(self, point: str | None = None) -> None:
        """Refuse."""
        raise _refused()

    def keep_counters(self) -> None:
        """Refuse."""
        raise _refused()

    def suspend(self) -> None:
        """Refuse."""
        raise _refused()

    def resume(self) -> None:
        """Refuse."""
        raise _refused()

    def add_point(self, name: str) -> None:
        """Refuse."""
        raise _refused()

    def close(self) -> None:
        """Stop playing; a second call does nothing."""
        self._stop.set()
        self._watch.close()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()


def _refused() -> InputError:
    return InputError("this is a replay: one can only look on")


def _told(step: Step) -> list[str]:
    """Return what a person is told of a step."""
    lines = []
    event = step.event
    if isinstance(event, PointMeasured):
        lines.append(f"{event.left}/{event.right}: {event.point} recorded")
        solution = step.view.solution
        if solution is not None and solution.flagged and step.view.diagnosis is not None:
            lines.append(step.view.diagnosis.advice[0])
    elif isinstance(event, MonoMeasured):
        photo = event.left if event.side == "left" else event.right
        lines.append(f"{event.left}/{event.right}: {event.point} recorded in photo {photo}")
        solution = step.view.solution
        if solution is not None and solution.flagged and step.view.diagnosis is not None:
            lines.append(step.view.diagnosis.advice[0])
    elif isinstance(event, PhotoLaid):
        lines.append(f"photo {event.photo} laid into the comparator")
    elif isinstance(event, FiducialMeasured):
        lines.append(f"photo {event.photo} ({event.side}): fiducial {event.fiducial} recorded")
        inner = step.view.inner
        if inner is not None and inner.suspects:
            lines.append(inner.advice[0])
    elif isinstance(event, InnerAccepted):
        lines.append(f"inner orientation of photo {event.photo} ({event.side}) accepted")
    elif isinstance(event, ModelAccepted):
        lines.append(f"model {event.left}/{event.right} accepted")
    elif event is not None:
        lines.append(event.kind.replace("-", " "))
    if step.difference is not None:
        lines.append(f"DIFFERENT: {step.difference}")
    return lines
