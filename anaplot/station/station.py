"""The running workstation: one thread, the journal and the link around a desk.

Bytes become readings in the link's reader thread, which only puts them into a queue. One station
thread takes them out and asks the desk what follows: journal first (on disk), then state, then
table, then whoever looks. Commands come from any thread and go the same way under the same lock.
The lock is never held while the link may wait for a port, and the link never waits for the
station.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from anaplot.errors import AnaplotError, InputError
from anaplot.exchange.blockfolder import clear_image_points
from anaplot.exchange.journal import JournalError
from anaplot.orientation.model import warm_up
from anaplot.orientation.ownpattern import PointPattern
from anaplot.orientation.suitability import pattern_verdict
from anaplot.photogrammetry.block import Block
from anaplot.planning.modelplan import Candidates
from anaplot.plotter.ports import UNCHECKED
from anaplot.plotter.readings import Position
from anaplot.session.commanding import decide
from anaplot.session.commands import Command, TurnWheels
from anaplot.session.desk import DEFAULT_PATTERN, Desk
from anaplot.session.draft import Decision
from anaplot.session.heard import (
    DriveBegun,
    DriveFailed,
    Heard,
    KeyFailed,
    LinkChanged,
    ReferenceLost,
    Seen,
)
from anaplot.session.hearing import hear
from anaplot.session.plates import ReadOut, image_of, plates_of
from anaplot.session.pointedat import Targets
from anaplot.session.referencing import references
from anaplot.session.requests import (
    DriveTo,
    Lay,
    OfInstrument,
    ReadAnew,
    Refer,
    Request,
    SetMark,
    Severity,
    StopDrive,
    TakeRecord,
    Tell,
    WarmUp,
    WritePoints,
)
from anaplot.session.state import SessionState
from anaplot.station.audience import News
from anaplot.station.blockwatch import BlockWatch
from anaplot.station.commanded import Commanded
from anaplot.station.header import session_header
from anaplot.station.inbox import Inbox, Item, Told, Traffic
from anaplot.station.instrument import Instrument, Setup
from anaplot.station.journaling import Recorder
from anaplot.station.livestatus import LiveStatus
from anaplot.station.pointpattern import point_pattern_of
from anaplot.station.pointsfile import BlockRead
from anaplot.station.restored import Snapshots
from anaplot.station.snapshot import LinkView, Snapshot, snapshot_of
from anaplot.station.takenup import TakenUp
from anaplot.station.worker import Worker
from anaplot.textfiles.wording import typed_path

__all__ = ["DEFAULT_PATTERN", "Severity", "Station"]


class Station(Commanded):
    """A workstation on one block.

    Parameters
    ----------
    folder
        The block folder; it is locked and its journal goes on where it ended.
    plotter
        The instrument, not connected yet, or None to look on without a plotter.
    point_pattern
        The point pattern of new models, its name or its file.
    operator
        Name for the journal.
    candidates
        Approximate image coordinates of known points by photo; None when there are none.
    auto_drive
        Whether the plates drive to the next point by themselves after a record.
    story
        What the session is about, for the journal's header.
    read
        The block, where it was read just now; None: it is read.

    Raises
    ------
    InputError
        The block, the journal or the profile is wrong, or the block is open elsewhere.
    LinkError
        The plotter cannot be reached.
    """

    def __init__(
        self,
        folder: Path,
        *,
        plotter: Setup | None = None,
        point_pattern: PointPattern | str = DEFAULT_PATTERN,
        operator: str = "",
        candidates: Candidates | None = None,
        auto_drive: bool = True,
        story: str = "",
        read: BlockRead | None = None,
    ) -> None:
        super().__init__(folder)
        taken_up = TakenUp(folder, read or BlockRead.of(folder))
        block = taken_up.block
        if isinstance(point_pattern, str):
            point_pattern = point_pattern_of(point_pattern, folder, block)
        self._lock = threading.RLock()
        # who asks the instrument; taken before the other, never in it
        self._turn = threading.Lock()
        self._driven = 0  # the errand of the last drive that was begun
        self._inbox = Inbox()
        self._closed = self._failed = False
        self._link = LinkView("none")
        self._read_since = (0, 0)
        self._ends: list[Callable[[], None]] = []
        self._serial = 0
        self._news = News()
        self._after: list[Callable[[], None]] = []
        self._watch = BlockWatch(self._block_seen)
        self.adjust_apart = self._watch.apart
        self._instrument: Instrument | None = None
        with contextlib.ExitStack() as undo:
            if plotter is not None:
                self._instrument = plotter.connect(self._inbox, block)
                undo.callback(self._instrument.close)
                link = self._instrument.link
                self._inbox.time = lambda: link.event_time
            self._journal, recovered = taken_up.open(
                session_header(block, operator, self._instrument, story, point_pattern)
            )
            undo.callback(self._journal.close)
            clear_image_points(folder)
            self._recorder = Recorder(self._journal, time.monotonic)
            self._recorder.events(taken_up.decided)
            past, self._points = taken_up.past, taken_up.points
            self._snapshots = Snapshots(self._journal, block, past)
            self._status = LiveStatus(typed_path(folder))
            self._desk = Desk.at(
                past.state,
                None if self._instrument is None else self._instrument.abilities,
                point_pattern=point_pattern,
                candidates=self._points.known_points(past.state.models)
                if candidates is None
                else candidates,
                control=block.control,
                auto_drive=auto_drive,
            )
            told = (pattern_verdict(point_pattern), *taken_up.remarks)
            for remark in filter(None, (*recovered.remarks, *told)):
                self._news.tell("warning", remark)
            self._write_points()
            if self._instrument is not None:
                self._open(self._instrument, past.pointed, taken_up.shift)
            undo.pop_all()
        self._tell_watch()
        self._snapshot = self._picture()
        self._audience.tell(self._news.take()[1])
        self._worker = Worker(self._inbox, self._take, self._refused, self._fail)
        self._worker.thread.start()

    def _open(self, instrument: Instrument, pointed: Targets, shift: Position | None) -> None:
        self._link = LinkView(
            "opening", instrument.profile.id, instrument.port, instrument.simulated
        )
        instrument.recall(pointed)
        known = references(self._desk.state)[1]
        # counters may have been off since: nothing they say is believed unchecked
        instrument.open(referenced=not (instrument.profile.incremental and known), shift=shift)
        if instrument.unchecked_parity:
            self._link = replace(self._link, parity_unchecked=True)
            self._news.tell("warning", UNCHECKED)
        if self._desk.laid is not None:
            instrument.do(self._desk.laid)

    # -- looking -------------------------------------------------------------------------------

    @property
    def block(self) -> Block:
        """The block as declared."""
        return self._points.block

    @property
    def desk(self) -> Desk:
        """The desk as it stands."""
        return self._desk

    @property
    def state(self) -> SessionState:
        """The session's state."""
        return self._desk.state

    @property
    def instrument(self) -> Instrument | None:
        """The instrument, or None."""
        return self._instrument

    @property
    def points_written(self) -> bool:
        """Whether image_points.csv holds every accepted model."""
        return self._points.holds(self._desk.state)

    @property
    def standing(self) -> bool:
        """Whether the plates stand, and the mark is set."""
        return self._desk.standing

    @property
    def settled(self) -> bool:
        """Whether they do, and the counters have been read since."""
        return self._instrument is not None and self.standing and self._seen().read

    def snapshot(self) -> Snapshot:
        """Return the current snapshot."""
        return self._snapshot

    def readout(self) -> ReadOut | None:
        """Return the live read-out, or None while there is none."""
        position = None if self._instrument is None else self._instrument.position()
        if position is None:
            return None
        return replace(image_of(position, plates_of(self.state)), mono=self._desk.mono)

    # -- commands ------------------------------------------------------------------------------

    def give(self, command: Command) -> None:
        """Give a command; see `Commanded.give`. The journal may refuse it, too."""
        with self._change():
            self._follow(decide(self._desk, command, self._seen()))

    @contextlib.contextmanager
    def by_hand(self) -> Iterator[None]:
        """Hold everything while plates that stand are moved by hand; the mark is set then.

        Raises
        ------
        InputError
            The station is closed, or the plates are under way.
        """
        with self._lock:
            if self._closed:
                raise InputError("the station is closed")
            turned = decide(self._desk, TurnWheels(), self._seen())
            yield
            self._desk = turned.after

    def tell(self, severity: Severity, text: str) -> None:
        """Tell whoever listens."""
        with self._change():
            self._news.tell(severity, text)

    def before_close(self, callback: Callable[[], None]) -> None:
        """Call back when the station is to be closed, while it still works."""
        self._ends.append(callback)

    def close(self) -> None:
        """Close link and journal; a second call does nothing."""
        ends, self._ends = self._ends, []
        for end in ends:
            end()
        with self._lock:
            if self._closed:
                return
            self._write_points()
            self._closed = True
        try:
            if self._instrument is not None:
                self._instrument.close()
        finally:
            self._watch.close()
            self._worker.end()
            try:
                with contextlib.suppress(JournalError):
                    self._recorder.flush()
            finally:
                self._journal.close()

    # -- the one way in ------------------------------------------------------------------------

    @contextlib.contextmanager
    def _change(self) -> Iterator[None]:
        """Hold the lock, then publish news, then ask the link for what it is to do."""
        with self._lock:
            if self._closed:
                raise InputError("the station is closed")
            if self._failed:
                raise InputError("the station has failed: close the block and open it again")
            refused: AnaplotError | None = None
            try:
                yield
            except AnaplotError as error:
                # what was told before, and what changed, is published all the same
                refused = error
            finally:
                news, notices = self._news.take()
                after, self._after = self._after, []
                if news:
                    self._tell_watch()
                    self._snapshot = self._picture()
                taken = self._snapshot
        if news:
            self._audience.tell(notices)
            self._audience.show(taken)
        if refused is not None:
            raise refused
        for action in after:
            action()

    def _refused(self, text: str) -> None:
        with contextlib.suppress(AnaplotError), self._change():
            self._news.tell("error", text)

    def _fail(self) -> None:
        with contextlib.suppress(Exception), self._change():
            self._link = replace(self._link, state="lost", detail="the station has failed")
            self._news.tell("error", "the station has failed: close the block and open it again")
        self._failed = True

    def _take(self, item: Item) -> None:
        match item:
            case Traffic():
                with self._lock:
                    self._recorder.traffic(item.direction, item.link, item.data, item.when)
            case Told():
                with self._lock:
                    self._recorder.told(item.kind, item.text, item.when)
            case WarmUp():
                warm_up()
            case _:
                self._hear(item)
        if self._unreferenced():
            self._hear(ReferenceLost())

    def _unreferenced(self) -> bool:
        """Whether the counters have lost their reference, and the desk does not know it yet."""
        instrument = self._instrument
        lost = instrument is not None and not instrument.link.referenced
        return lost and self._desk.referencing is None

    def _hear(self, heard: Heard) -> None:
        """Ask the desk what follows."""
        with self._change():
            if isinstance(heard, ReferenceLost) and not self._unreferenced():
                return  # a command has referred them between the look and the lock
            if isinstance(heard, LinkChanged):
                self._link = replace(self._link, state=heard.state, detail=heard.detail)
                self._news.any = True
            self._follow(hear(self._desk, heard, self._seen()), heard=True)

    # -- following the desk --------------------------------------------------------------------

    def _seen(self) -> Seen:
        if self._instrument is None:
            return Seen(time.monotonic())
        return self._instrument.seen(self._read_since)

    def _follow(self, decision: Decision, *, heard: bool = False) -> None:
        """Let a decision come true: on disk before it is the state, and told after that.

        What was heard has happened whether the disk takes its explanation or not.
        """
        try:
            self._recorder.events(decision.events)
        except JournalError as error:
            if not heard:
                raise
            self._news.tell("error", f"not recorded: {error}")
            return
        if not heard:
            self._recorder.explain(decision.notes)
        before, self._desk = self._desk, decision.after
        self._news.any |= self._desk is not before
        self._points.happened(decision.events)
        self._snapshots.happened(decision.events, self._desk.state)
        remark = self._recorder.tables(before.outlook, self._desk.outlook)
        if remark:
            self._news.tell("warning", remark)
        for request in decision.requests:
            self._do(request)
        if heard:
            try:
                self._recorder.explain(decision.notes)
            except JournalError as error:
                self._news.tell("error", f"not recorded: {error}")
        if decision.refusal is not None:
            raise decision.refusal

    def _do(self, request: Request) -> None:
        """Do what the desk asks for; what may wait for a port is done without the lock."""
        instrument = self._instrument
        match request:
            case Tell(severity, text):
                self._news.tell(severity, text)
            case WritePoints():
                self._write_points()
            case WarmUp():
                self._inbox.items.put(request)
            case ReadAnew() if instrument is not None:
                self._read_since = instrument.link.mark
            case Lay() | Refer() if instrument is not None:
                instrument.do(request)
            case DriveTo() | SetMark() | StopDrive() | TakeRecord() if instrument is not None:
                errand = self._desk.errand
                self._after.append(lambda: self._begin(instrument, request, errand))

    def _begin(self, instrument: Instrument, request: OfInstrument, errand: int) -> None:
        """Have the instrument do something, unless the desk has thought better of it since.

        Two threads come here in any order: the plates go where the later decision sends them.
        A drive that cannot be commanded leads nowhere.
        """
        driving = isinstance(request, DriveTo | SetMark)
        try:
            with self._turn:
                with self._lock:
                    stopping = isinstance(request, StopDrive)
                    if stopping and self._driven > errand:
                        return  # what was to be stopped has given way to another drive
                    if self._desk.errand != errand and not stopping:
                        if isinstance(request, TakeRecord):
                            raise InputError("not recorded: the plates are to go elsewhere")
                        return
                    if driving:
                        self._driven = errand
                        begun = DriveBegun(instrument.drives_begun)
                        self._desk = hear(self._desk, begun, self._seen()).after
                instrument.do(request)
        except AnaplotError:
            with contextlib.suppress(InputError):
                if driving:
                    self._hear(DriveFailed(errand))
                elif isinstance(request, TakeRecord):
                    self._hear(KeyFailed(errand))
            raise

    # -- showing -------------------------------------------------------------------------------

    def _write_points(self) -> None:
        """Bring image_points.csv up to the accepted models; what fails is tried again later."""
        try:
            self._points.write(self._desk.state)
        except InputError as error:
            self._news.tell("error", f"{error}; the measurements are safe in the journal")

    def _block_seen(self) -> None:
        """Show what the block says now, in the thread of the watch."""
        with contextlib.suppress(InputError), self._change():
            self._news.any = True

    def _tell_watch(self) -> None:
        desk, points, pause = self._desk, self._points, self._audience.pause
        self._watch.tell(points.block, desk.state, desk.outlook, *points.own, pause=pause)

    def _picture(self) -> Snapshot:
        self._serial += 1
        watch = self._watch
        status = self._status.now(self._points.block, self._desk, watch.view, watch.tables)
        return snapshot_of(self._desk, self._serial, self._link, status)
