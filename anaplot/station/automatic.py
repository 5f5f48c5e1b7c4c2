"""The automatic operator: does an operator's job through the same station, without a screen.

He sees snapshots and gives the commands that the console gives; the pedal is pressed by the
simulated hand, and its record comes over the line. What is flagged he measures again, the most
suspicious row first, a row at most twice; then he switches it off and reports it, so that he
always comes to an end.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

from anaplot.errors import AnaplotError, LinkError, NotComputableError
from anaplot.orientation.results import ModelSolution
from anaplot.session.events import Axis
from anaplot.station.snapshot import Snapshot

if TYPE_CHECKING:
    from anaplot.station.station import Station

__all__ = ["AutomaticOperator", "Handled", "ModelRecord"]

_REPEATS = 2
_PATIENCE = 5.0  # s without any change before he drives to the point again
_ATTEMPTS = 6

Row = tuple[str, Axis | None]


class Handled(NamedTuple):
    """A row that was flagged and measured again or switched off; axis None: the whole point."""

    model: str
    point: str
    axis: Axis | None
    action: str


@dataclass(slots=True)
class ModelRecord:
    """What happened in one model.

    Attributes
    ----------
    left, right
        Names of the photos.
    before, after
        The model when its pattern was complete, and when it was accepted.
    handled
        What was measured again or switched off, in order.
    """

    left: str
    right: str
    before: ModelSolution | None = None
    after: ModelSolution | None = None
    handled: list[Handled] = field(default_factory=list)


class AutomaticOperator:
    """Works at a station with a simulated plotter until every model is accepted.

    Parameters
    ----------
    station
        The station; its plotter must be a simulated one.
    on_accepted
        Called with what happened in a model when it is accepted.
    """

    def __init__(
        self, station: Station, on_accepted: Callable[[ModelRecord], None] | None = None
    ) -> None:
        self._station = station
        self._on_accepted = on_accepted
        self._woken = threading.Event()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._measured_again: Counter[tuple[str, Row]] = Counter()
        self._records: dict[str, ModelRecord] = {}

    @property
    def records(self) -> tuple[ModelRecord, ...]:
        """What happened, model by model."""
        return tuple(self._records.values())

    # -- in the background, for the console ------------------------------------------------------

    def start(self) -> None:
        """Work in a thread of his own until stopped or finished."""
        self._thread = threading.Thread(target=self._background, name="operator", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop; returns when he has stopped."""
        self._stopping.set()
        self._woken.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def _background(self) -> None:
        try:
            self.run()
        except AnaplotError as error:
            self._station.tell("error", f"the simulated operator gives up: {error}")
        if not self._stopping.is_set():
            self._station.operator_finished()

    # -- the job ---------------------------------------------------------------------------------

    def run(self) -> None:
        """Work until every model is accepted, or until stopped.

        Raises
        ------
        LinkError
            The plotter does not answer any more.
        NotComputableError
            A model cannot be determined with what can be measured.
        InputError
            The journal or a file cannot be written.
        """
        plotting = self._station.plotting
        assert plotting is not None
        end = self._station.subscribe(lambda _: self._woken.set())
        plotting.set_pedal(True)
        try:
            self._loop()
        finally:
            plotting.set_pedal(False)
            end()

    def _loop(self) -> None:
        seen = -1
        changed = monotonic()
        attempts = 0
        while not self._stopping.is_set():
            self._woken.clear()
            picture = self._station.snapshot()
            if picture.finished:
                return
            if picture.serial != seen:
                seen, changed = picture.serial, monotonic()
                if picture.target is None:
                    attempts = 0
            if not picture.suspended and not self._step(picture):
                # waiting for a record: a lost byte must not end the job
                if monotonic() - changed > _PATIENCE and picture.link.state == "live":
                    attempts += 1
                    if attempts > _ATTEMPTS:
                        raise LinkError("the simulated plotter does not answer any more")
                    changed = monotonic()
                    if picture.target is not None:
                        self._station.drive(picture.target)
                self._woken.wait(0.5)
            elif picture.suspended:
                self._woken.wait(0.5)

    def _step(self, picture: Snapshot) -> bool:
        """Do the next thing; False when there is nothing to do but wait."""
        station = self._station
        if not picture.left:
            station.next_model()
            return True
        if picture.target is not None:
            return False
        pending = [p.point for p in picture.points if p.status == "pending"]
        if pending:
            station.drive(pending[0])
            return True
        name = f"{picture.left}/{picture.right}"
        record = self._records.setdefault(name, ModelRecord(picture.left, picture.right))
        if record.before is None:
            record.before = picture.solution
        if picture.solution is None:
            if picture.next_point is None:
                raise NotComputableError(picture.problem or f"model {name} is not determined")
            self._handle(record, name, (picture.next_point, None))
        elif picture.diagnosis is not None and picture.diagnosis.suspects:
            self._handle(record, name, picture.diagnosis.suspects[0])
        else:
            record.after = picture.solution
            station.accept()
            if self._on_accepted is not None:
                self._on_accepted(record)
        return True

    def _handle(self, record: ModelRecord, model: str, row: Row) -> None:
        point, axis = row
        if self._measured_again[model, row] < _REPEATS:
            self._measured_again[model, row] += 1
            record.handled.append(Handled(model, point, axis, "measured again"))
            self._station.drive(point)
            return
        record.handled.append(Handled(model, point, axis, "switched off"))
        self._station.switch(point, axis, False)
