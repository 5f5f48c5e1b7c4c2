"""The automatic operator: does an operator's job through the same station, without a screen.

He sees snapshots and gives the commands that the console gives; the pedal is pressed by the
simulated hand, and its record comes over the line. What is flagged he measures again, the most
suspicious row first, its point at most twice; then he switches the row off and reports it, so
that he always comes to an end.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Literal

from anaplot.aliases import Axis, Side
from anaplot.errors import AnaplotError, InputError, LinkError, NotComputableError
from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.session.models import solve
from anaplot.simulation.instrument import SimulatedInstrument
from anaplot.simulation.stages import Handled, Stage, stage_of_point
from anaplot.station.snapshot import InnerView, PointView, Snapshot
from anaplot.station.station import Station

__all__ = ["AutomaticOperator", "InnerRecord", "ModelRecord"]

_REPEATS = 2
_PATIENCE = 5.0  # s without a record before he drives to the point again
_LINE_PATIENCE = 60.0  # s that the line may be down
_PAUSE = 0.2  # s before another command to a line that took none
_READ = 0.05  # s between two looks at the counters
_ATTEMPTS = 8  # drives to one point without a record
_REFUSALS = 5  # commands refused one after the other: that it was nobody else's doing is clear then

Row = tuple[str, Axis | None]


@dataclass(slots=True)
class InnerRecord:
    """What happened in one photo's inner orientation.

    Attributes
    ----------
    photo, side
        The photo, and the carriage in which it lies.
    before, after
        The inner orientation when every fiducial was measured, and when it was accepted.
    """

    photo: str
    side: Side
    before: InnerOrientation | None = None
    after: InnerOrientation | None = None


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
        What was measured again or switched off, in order; fiducials among it.
    inners
        The photos' inner orientations, left first; none where the cameras have no fiducials.
    returned
        Whether it had been accepted before, and he returned to it.
    """

    left: str
    right: str
    before: ModelSolution | None = None
    after: ModelSolution | None = None
    handled: list[Handled] = field(default_factory=list)
    inners: list[InnerRecord] = field(default_factory=list)
    returned: bool = False


class AutomaticOperator:
    """Works at a station with a simulated plotter until every model is accepted.

    Parameters
    ----------
    station
        The station; at its instrument a simulated hand must press the pedal or set the mark.
    on_accepted
        Called with what happened in a model when it is accepted.
    repeats
        How often he points again at one point of every model, and at one fiducial of every photo,
        before he accepts.
    wait
        How he waits, at most so many seconds, for something to happen at the station; None: until
        it shows something new. Where nothing happens beside him, it is made to happen so.
    """

    def __init__(
        self,
        station: Station,
        on_accepted: Callable[[ModelRecord], None] | None = None,
        *,
        repeats: int = 0,
        wait: Callable[[float], object] | None = None,
    ) -> None:
        self._station = station
        self._repeats = repeats
        self._wait = self._until_woken if wait is None else wait
        self._repeated: set[tuple[str, ...]] = set()
        self._on_accepted = on_accepted
        instrument = station.instrument
        self._instrument = instrument if isinstance(instrument, SimulatedInstrument) else None
        self._woken = threading.Event()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._noted: set[tuple[str, str, Row, int]] = set()
        self._drives = 0
        self._refusals = 0
        self._pressed = False
        self._aimed = False
        self._since = 0.0
        self._records: dict[str, ModelRecord] = {}
        self._returns: list[ModelRecord] = []
        self._handled: list[Handled] = []

    @property
    def handled(self) -> tuple[Handled, ...]:
        """What was measured again or switched off in all models, in the order of time."""
        return tuple(self._handled)

    @property
    def records(self) -> tuple[ModelRecord, ...]:
        """What happened, model by model; `after` is how a model stands now."""
        state, out = self._station.state, []
        for name, record in self._records.items():
            again = [one for one in self._returns if f"{one.left}/{one.right}" == name]
            handled = [h for one in (record, *again) for h in one.handled]
            model = state.accepted(record.left, record.right)
            after = record.after
            if model is not None:
                with contextlib.suppress(NotComputableError):
                    after = solve(state, model)
            out.append(replace(record, handled=handled, after=after))
        return tuple(out)

    # -- in the background, for the console ------------------------------------------------------

    def start(self, ended: Callable[[Literal["info", "error"], str], None]) -> None:
        """Work in a thread of his own until stopped or finished.

        Parameters
        ----------
        ended
            Called, from that thread, with how he came to his end if he was not stopped.
        """
        self._thread = threading.Thread(
            target=self._background, args=(ended,), name="operator", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """Stop; returns when he has stopped."""
        self._stopping.set()
        self._woken.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def _background(self, ended: Callable[[Literal["info", "error"], str], None]) -> None:
        try:
            self.run()
        except AnaplotError as error:
            ended("error", f"the simulated operator gives up: {error}")
            return
        if not self._stopping.is_set():
            ended("info", "the simulated operator has finished")

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
        end = self._station.subscribe(lambda _: self._woken.set())
        if self._instrument is not None:
            self._instrument.set_pedal(True)
        try:
            self._loop()
        finally:
            if self._instrument is not None:
                self._instrument.set_pedal(False)
            end()

    def _loop(self) -> None:
        done: object = None
        while not self._stopping.is_set():
            self._woken.clear()
            picture = self._station.snapshot()
            if picture.finished and picture.returning is None:
                if not self._waits_for_block(picture):
                    return
                self._wait(_READ)
                continue
            if done != _progress(picture):
                done = _progress(picture)
                self._since, self._drives, self._refusals = monotonic(), 0, 0
                self._pressed = False
            try:
                waiting = picture.suspended or not self._step(picture)
            except _GivenUpError:
                raise
            except LinkError:
                # the line has gone and the station is about to hear of it
                if monotonic() - self._since > _LINE_PATIENCE:
                    raise
                waiting = False
                self._stopping.wait(_PAUSE)
            except InputError:
                # a record or somebody else's command came after he had looked: look again
                self._refusals += 1
                if self._refusals >= _REFUSALS:
                    raise
                waiting = False
                self._stopping.wait(_READ)
            if waiting:
                # nobody wakes him when the counters have been read again
                self._wait(_READ if picture.unreferenced else 0.5)

    def _until_woken(self, seconds: float) -> None:
        self._woken.wait(seconds)

    def _step(self, picture: Snapshot) -> bool:
        """Do the next thing; False when there is nothing to do but wait."""
        station = self._station
        if picture.link.state != "live":
            if monotonic() - self._since > _LINE_PATIENCE:
                raise _GivenUpError(f"the plotter's line is {picture.link.state}")
            return False
        if picture.unreferenced:
            return self._refer(picture)
        self._aimed = False
        if self._waits_for_block(picture):
            return False
        if picture.returning is not None:
            back = picture.returning
            station.return_to(back.left, back.right, back.point, back.photo)
            axis: Axis = "x" if back.axis == "x" else "y"
            # the block can be sure of it as soon as the next model has it, too
            stage: Stage = "next model" if picture.left == back.right else "block"
            name = f"{back.left}/{back.right}"
            again = ModelRecord(back.left, back.right, returned=True)
            self._returns.append(again)
            self._note(again, Handled(name, back.point, axis, "measured again", stage=stage))
            return True
        if picture.checks and picture.inner is None and picture.target is None:
            self._drive(picture.checks[0])
            return True
        if not picture.left or (picture.next_photo is not None and self._changes(picture)):
            station.next_model()
            return True
        if picture.target is not None:
            hand = self._instrument
            pressed = self._pressed or (hand is not None and hand.presses)
            if not pressed and station.standing:
                # no pedal that the simulated hand presses: the key
                self._pressed = True
                station.record()
                return True
            # waiting for a record: a lost byte must not end the job
            if monotonic() - self._since > _PATIENCE:
                self._drive(picture.target, again=picture.repeating)
            return False
        name, record = f"{picture.left}/{picture.right}", self._record(picture)
        if picture.inner is not None:
            self._orient(picture, picture.inner, record)
            return True
        pending = [p.point for p in picture.points if _pending(picture, p)]
        if pending:
            self._drive(pending[0])
            return True
        if record.before is None:
            record.before = picture.solution
        if picture.wanted is not None:
            self._drive(picture.wanted)
            return True
        if picture.solution is None:
            if picture.next_point is None:
                raise NotComputableError(picture.problem or f"model {name} is not determined")
            self._handle(picture, record, (picture.next_point, None))
        elif picture.diagnosis is not None and picture.diagnosis.suspects:
            self._handle(picture, record, picture.diagnosis.suspects[0])
        elif wrong := _wrong_ties(picture):
            self._handle(picture, record, (wrong[0], None))
        elif not self._points_again((name,), [p.point for p in picture.points]):
            station.accept()
            record.after = picture.solution
            if self._on_accepted is not None:
                self._on_accepted(record)
        return True

    def _changes(self, picture: Snapshot) -> bool:
        """Whether the photo in a mono comparator is changed now: all is done that can be there.

        For a point that has been measured again often enough it is not: its row is switched off.
        """
        again = {p.point: p.times for p in picture.points if p.status != "pending"}
        suspects = picture.diagnosis.suspects if picture.diagnosis is not None else ()
        if any(p.status == "pending" for p in picture.points) or not suspects:
            return True
        if picture.wanted is not None:
            return True
        record = self._record(picture)
        if record.before is None:
            record.before = picture.solution
        return again[suspects[0][0]] <= _REPEATS

    def _refer(self, picture: Snapshot) -> bool:
        """Set the mark on something measured and say so: the counters have lost their reference."""
        station = self._station
        if picture.reference_point is not None and not self._aimed:
            self._aimed = True
            station.drive(picture.reference_point)
            return True
        if not station.settled:
            return False
        # the second pointing is one of its own, and so is what follows a refusal
        self._aimed = False
        station.reference()
        return True

    def _orient(self, picture: Snapshot, inner: InnerView, record: ModelRecord) -> None:
        """Do the next thing of an inner orientation."""
        pending = [f.fiducial for f in inner.fiducials if f.status == "pending"]
        if pending:
            self._drive(pending[0])
            return
        key = (inner.photo, inner.side)
        done = next((i for i in record.inners if (i.photo, i.side) == key), None)
        if done is None:
            done = InnerRecord(*key, before=inner.solution)
            record.inners.append(done)
        if inner.solution is None:
            raise NotComputableError(
                f"photo {inner.photo} ({inner.side}): "
                + (picture.problem or "its inner orientation is not determined")
            )
        times = {f.fiducial: f.times for f in inner.fiducials}
        row = inner.suspects[0] if inner.suspects else None
        if row is not None and not inner.solution.locatable and times[row[0]] > _REPEATS:
            # each was measured again, and which one to leave out cannot be known
            name = f"{picture.left}/{picture.right}"
            what = Handled(name, *row, "accepted as it is", inner.photo, "inner orientation")
            self._note(record, what)
            row = None
        if row is not None:
            self._handle(picture, record, row)
        elif not self._points_again(key, [f.fiducial for f in inner.fiducials]):
            self._station.accept()
            done.after = inner.solution

    def _points_again(self, where: tuple[str, ...], names: Sequence[str]) -> bool:
        """Point again at one of what is measured there, a different one every time, once."""
        if not self._repeats or where in self._repeated:
            return False
        name = names[len(self._repeated) % len(names)]
        self._repeated.add(where)
        self._station.point_again(name, self._repeats)
        return True

    def _drive(self, point: str, again: tuple[int, int] | None = None) -> None:
        """Drive to a point, but not for ever to one of which no record comes.

        `again`: it is pointed at again, how often it was and is to be.
        """
        if self._drives >= _ATTEMPTS:
            what = "point" if self._station.snapshot().inner is None else "fiducial"
            raise _GivenUpError(f"{what} {point} was not recorded in {_ATTEMPTS} attempts")
        self._pressed = False
        if again is None:
            self._station.drive(point)
        else:
            self._station.point_again(point, again[1] - again[0])
        self._drives += 1
        self._since = monotonic()

    def _handle(self, picture: Snapshot, record: ModelRecord, row: Row) -> None:
        point, axis = row
        name = f"{picture.left}/{picture.right}"
        inner = picture.inner
        photo = "" if inner is None else inner.photo
        told = stage_of_point(point, picture.accidents)
        stage: Stage = told if inner is None else "inner orientation"
        # counted by the session, so that an interrupted job goes on as if it had not been
        if inner is None:
            times = next(p.times for p in picture.points if p.point == point)
        else:
            times = next(f.times for f in inner.fiducials if f.fiducial == point)
        if times <= _REPEATS:
            # driven to a second time when the line failed, but measured once
            if (name, photo, row, times) not in self._noted:
                self._noted.add((name, photo, row, times))
                self._note(record, Handled(name, point, axis, "measured again", photo, stage))
            self._drive(point)
            return
        self._station.switch(point, axis, False)
        self._note(record, Handled(name, point, axis, "switched off", photo, stage))

    def _note(self, record: ModelRecord, handled: Handled) -> None:
        record.handled.append(handled)
        self._handled.append(handled)

    def _record(self, picture: Snapshot) -> ModelRecord:
        """Return what is to be told of the model in work: of its last return, or of its making."""
        if picture.reopened:
            names = (picture.left, picture.right)
            if not self._returns or (self._returns[-1].left, self._returns[-1].right) != names:
                self._returns.append(ModelRecord(*names, returned=True))
            return self._returns[-1]
        name = f"{picture.left}/{picture.right}"
        return self._records.setdefault(name, ModelRecord(picture.left, picture.right))

    @staticmethod
    def _waits_for_block(picture: Snapshot) -> bool:
        """Whether what the block says is still to come, and might be to return to a model."""
        if picture.block_view is None or not picture.block_view.busy or picture.reopened:
            return False
        return all(p.status != "pending" for p in picture.points) and picture.target is None


def _pending(picture: Snapshot, point: PointView) -> bool:
    """Whether a point is to be measured with what lies in the instrument."""
    if picture.mono:
        side: Side = "left" if picture.laid == picture.left else "right"
        return side not in point.seen
    return point.status == "pending"


def _wrong_ties(picture: Snapshot) -> list[str]:
    """Return points of the model that another strip, or the ground, certainly has elsewhere."""
    off = {p.point for p in picture.points if p.status == "off"}
    return [a.point for a in picture.accidents if a.certain and a.point not in off]


class _GivenUpError(LinkError):
    """The job cannot be finished over this line."""


def _progress(picture: Snapshot) -> tuple[object, ...]:
    """Return what changes when, and only when, the job has come a step further."""
    return (
        picture.accepted,
        picture.reopened,
        picture.checks,
        picture.left,
        picture.right,
        picture.suspended,
        picture.laid,
        picture.unreferenced,
        picture.repeating,
        tuple((p.times, p.off_axes, p.seen) for p in picture.points),
        tuple(
            (i.accepted, tuple((f.times, f.off_axes) for f in i.fiducials)) for i in picture.inners
        ),
    )
