"""The running workstation: link, journal and session wired together.

Bytes become readings in the link's reader thread, which only puts them into a queue. One station
thread takes them out: journal first (on disk), then state, then table, then whoever looks.
Commands come from any thread and go the same way under the same lock. The lock is never held
while the link may wait for a port, and the link never waits for the station.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from anaplot.adjustment.tested import Observation
from anaplot.aliases import Axis, Side
from anaplot.errors import AnaplotError, InputError, NotComputableError
from anaplot.exchange.blockfolder import clear_image_points, read_block, write_image_points
from anaplot.exchange.journal import Journal, JournalError, event_of
from anaplot.orientation.model import warm_up
from anaplot.orientation.patterns import pattern
from anaplot.orientation.results import Row
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.platetransformation import TITLES
from anaplot.planning.modelplan import Candidates
from anaplot.plotter.ports import UNCHECKED
from anaplot.plotter.readings import UNREFERENCED, Fault, InPosition, Position, Record, Refused
from anaplot.session.events import (
    EVENT_KINDS,
    Event,
    FiducialSwitched,
    ModelAccepted,
    ModelChosen,
    PhotoLaid,
    PlannedPoint,
    PointAdded,
    Resumed,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.fiducialdrive import fiducial_target
from anaplot.session.innerstate import InnerState
from anaplot.session.innerwork import InnerOutlook, acceptance
from anaplot.session.measuring import check_instrument, measurement_of
from anaplot.session.plans import added_point, plan_of, point_target
from anaplot.session.plates import ReadOut, image_of, plates_of
from anaplot.session.referencing import (
    Reference,
    Referencing,
    in_words,
    references,
    tolerance_mm,
)
from anaplot.session.state import EventRefusedError, ModelState, SessionState, apply, start
from anaplot.session.workflow import Outlook, outlook
from anaplot.station.blockwatch import BlockWatch
from anaplot.station.header import session_header
from anaplot.station.imagepoints import measured_here, merged_rows
from anaplot.station.inbox import End, Heard, Inbox, LinkChange, Told, Traffic, WarmUp
from anaplot.station.instrument import Instrument, MarkSet, Setup
from anaplot.station.journaling import Recorder
from anaplot.station.snapshot import LinkView, Snapshot, asking, picture
from anaplot.station.tables import inner_table_payload, table_payload

__all__ = ["DEFAULT_PATTERN", "Severity", "Station"]

DEFAULT_PATTERN = "13"
_STALE = 2.0  # s after which a read-out is no longer shown
_ARRIVED_MM = 0.02  # a read-out this near to the target ends a drive as its reply would
_REFUSALS_TOLD = 1.0  # s between two notices about bytes that are no readings
_KEPT_NOTICES = 100  # for whoever listens first

Severity = Literal["info", "warning", "error", "record"]


class Station:
    """A workstation on one block.

    Parameters
    ----------
    folder
        The block folder; it is locked and its journal goes on where it ended.
    plotter
        The instrument, not connected yet, or None to look on without a plotter.
    point_pattern
        Name of the point pattern of new models.
    operator
        Name for the journal.
    candidates
        Approximate image coordinates of known points by photo; None when there are none.
    auto_drive
        Whether the plates drive to the next point by themselves after a record.
    story
        What the session is about, for the journal's header.

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
        point_pattern: str = DEFAULT_PATTERN,
        operator: str = "",
        candidates: Candidates | None = None,
        auto_drive: bool = True,
        story: str = "",
    ) -> None:
        self._folder = folder
        self._pattern = pattern(point_pattern)
        self._auto_drive = auto_drive
        self._block = read_block(folder)
        self._lock = threading.RLock()
        self._inbox = Inbox()
        self._subscribers: list[Callable[[Snapshot], None]] = []
        self._listeners: list[Callable[[Severity, str], None]] = []
        self._closed = False
        self._link = LinkView("none")
        self._target: str | None = None
        self._drive_target: Position | None = None
        self._setting = ""
        self._settles_after: int | None = None
        self._referencing: Referencing | None = None
        self._last_measured: str | None = None
        self._heard_before = (0, 0)
        self._ends: list[Callable[[], None]] = []
        self._refusal_told = float("-inf")
        self._traffic_refused = False
        self._failed = False
        self._serial = 0
        self._notices: list[tuple[Severity, str]] = []
        self._after: list[Callable[[], None]] = []
        self._watch = BlockWatch(self._block_seen)
        self._instrument: Instrument | None = None
        with contextlib.ExitStack() as undo:
            self._instrument = (
                None if plotter is None else plotter.connect(self._inbox, self._block)
            )
            if self._instrument is not None:
                undo.callback(self._instrument.close)
                link = self._instrument.link
                self._inbox.time = lambda: link.event_time
            self._journal, recovered = Journal.open(
                folder,
                session_header(self._block, operator, self._instrument, story),
                keep=lambda kind: kind in EVENT_KINDS,
            )
            undo.callback(self._journal.close)
            clear_image_points(folder)
            self._recorder = Recorder(self._journal, time.monotonic)
            self._state = start(self._block)
            self._of_session: set[str] = set()
            before: list[Event] = []
            for record in recovered.records:
                event = event_of(record)
                try:
                    self._state = apply(self._state, event)
                except EventRefusedError as error:
                    raise InputError(
                        f"{record.file} line {record.line}: does not fit block.toml: {error}"
                    ) from error
                if isinstance(event, ModelAccepted):
                    self._of_session.add(f"{event.left}/{event.right}")
                before.append(event)
            for remark in recovered.remarks:
                self._tell("warning", remark)
            self._candidates = self._known_points(candidates)
            self._outlook: Outlook = outlook(self._state)
            self._points_written = not self._of_session
            self._write_points()
            if self._instrument is not None:
                self._link = LinkView(
                    "opening",
                    self._instrument.profile.id,
                    self._instrument.port,
                    self._instrument.simulated,
                )
                self._instrument.recall(before)
                known = references(self._state)[1]
                counting_on = not (self._instrument.profile.incremental and known)
                # counters may have been off since: nothing they say is believed unchecked
                self._instrument.open(referenced=counting_on)
                if self._instrument.unchecked_parity:
                    self._link = replace(self._link, parity_unchecked=True)
                    self._tell("warning", UNCHECKED)
                self._lay()
            undo.pop_all()
        self._watch.tell(self._block, self._state, self._outlook, self._of_session)
        self._snapshot = self._picture()
        self._thread = threading.Thread(target=self._work, name="station", daemon=True)
        self._thread.start()

    # -- looking -------------------------------------------------------------------------------

    @property
    def block(self) -> Block:
        """The block as declared."""
        return self._block

    @property
    def state(self) -> SessionState:
        """The session's state."""
        return self._state

    @property
    def instrument(self) -> Instrument | None:
        """The instrument, or None."""
        return self._instrument

    def snapshot(self) -> Snapshot:
        """Return the current snapshot."""
        return self._snapshot

    def readout(self) -> ReadOut | None:
        """Return the live read-out, or None while there is none."""
        instrument = self._instrument
        latest = None if instrument is None else instrument.link.latest()
        if latest is None or latest[1] > _STALE:
            return None
        read = image_of(latest[0], plates_of(self._state))
        assert instrument is not None
        return replace(read, mono=instrument.profile.mono)

    def subscribe(self, callback: Callable[[Snapshot], None]) -> Callable[[], None]:
        """Call back with every new snapshot, from any thread; returns what ends it."""
        self._subscribers.append(callback)

        def end() -> None:
            if callback in self._subscribers:
                self._subscribers.remove(callback)

        return end

    def subscribe_notices(self, callback: Callable[[str, str], None]) -> Callable[[], None]:
        """Call back with (severity, line), from any thread; returns what ends it."""
        with self._lock:
            self._listeners.append(callback)
            waiting, self._notices = self._notices, []
        for severity, text in waiting:
            callback(severity, text)

        def end() -> None:
            if callback in self._listeners:
                self._listeners.remove(callback)

        return end

    # -- commands ------------------------------------------------------------------------------

    def drive(self, point: str) -> None:
        """Drive the plates to a point of the current model; without a drive, name it as next.

        During an inner orientation it is a fiducial.

        Raises
        ------
        InputError
            No model, no such point, work suspended, or a target outside the travel.
        LinkError
            The plotter cannot be reached.
        """
        with self._change():
            if self._referencing is not None:
                self._aim_at_reference(self._referencing, point)
                return
            model = self._model()
            if self._state.suspended:
                raise InputError("work is suspended: resume first")
            self._check_instrument(model)
            inner = model.open_inner
            if inner is not None:
                if point not in inner.fiducials:
                    raise InputError(f"{inner.name} has no fiducial {point}")
                self._aim_at_fiducial(inner, point)
                return
            planned = model.planned(point)
            if planned is None:
                raise InputError(f"point {point} is not in model {model.name}")
            self._aim(planned)

    def stop(self) -> None:
        """Stop a drive."""
        with self._change():
            self._drive_target = None
            self._setting = ""
            if self._instrument is not None and self._instrument.drives:
                self._after.append(self._instrument.link.stop)

    def record(self) -> None:
        """Record the point or fiducial at which the plates stand, with the next position coming in.

        Raises
        ------
        InputError
            No plotter, no model, plates not at a point or still under way, or work suspended.
        LinkError
            The plotter cannot be reached.
        """
        with self._change():
            instrument = self._instrument
            if instrument is None:
                raise InputError("no plotter is connected: nothing to record")
            if self._referencing is not None:
                raise InputError(UNREFERENCED)
            self._recordable()
            self._after.append(instrument.record)

    def switch(self, point: str, axis: Axis | None, on: bool) -> None:
        """Switch a row, or the whole point, off or on; during an inner orientation a fiducial's."""
        with self._change():
            model = self._state.current
            if model is not None and model.open_inner is not None:
                self._happen(FiducialSwitched(model.open_inner.photo, point, axis, on))
            else:
                self._happen(RowSwitched(point, axis, on))

    def undo(self) -> None:
        """Take the last event back."""
        with self._change():
            before = self._state
            self._happen(Undone())
            if before.models != self._state.models:
                self._points_written = False
                self._write_points()
            if _photos(before) != _photos(self._state):
                self._nowhere()
                self._lay()
            elif _laid(before) != _laid(self._state) or _in_inner(before) != _in_inner(self._state):
                self._nowhere()
            elif _in_inner(before) is not None:
                pass  # a fiducial is always one of its camera's
            elif self._target is not None and self._model().planned(self._target) is None:
                self._nowhere()

    def accept(self) -> None:
        """Accept the inner orientation in work, else the model, and write image_points.csv.

        Raises
        ------
        InputError
            No model, or the journal or the file could not be written.
        NotComputableError
            The model, or the inner orientation, is not determined.
        """
        with self._change():
            model = self._model()
            if self._outlook.inner is not None:
                self._accept_inner(self._outlook.inner)
                return
            if self._outlook.solution is None:
                raise NotComputableError(
                    f"model {model.name} is not determined yet"
                    + (f": {self._outlook.problem}" if self._outlook.problem else "")
                )
            self._happen(ModelAccepted(model.left, model.right))
            self._of_session.add(model.name)
            self._nowhere()
            self._points_written = False
            self._tell("info", f"model {model.name} accepted")
            self._write_points()

    def _accept_inner(self, view: InnerOutlook) -> None:
        inner = view.state
        if view.solution is None:
            raise NotComputableError(
                f"the inner orientation of {inner.name} is not determined yet"
                + (f": {view.problem}" if view.problem else "")
            )
        self._happen(acceptance(inner, view.solution))
        self._nowhere()
        self._tell(
            "info",
            f"inner orientation of {inner.name} accepted: {TITLES[view.solution.kind]}",
        )
        self._advance()

    def next_model(self) -> None:
        """Choose the next model: the right photo becomes left, ties are driven to first.

        In a mono comparator first of all the photo that is to be laid in now.

        Raises
        ------
        InputError
            A model is still in the instrument, or there is none left.
        """
        with self._change():
            model, next_photo = self._state.current, self._outlook.next_photo
            if model is not None and next_photo is not None:
                self._lay_photo(model.photo(next_photo))
                return
            if model is not None:
                raise InputError(f"accept model {model.name} first")
            following = self._outlook.next_model
            if following is None:
                raise InputError("every model of the block is accepted")
            strip, left, right = following
            self._write_points()
            plan = plan_of(self._state, self._pattern, self._candidates, strip, left, right)
            self._happen(ModelChosen(strip, left, right, plan, mono=self._mono))
            self._inbox.items.put(WarmUp())
            self._tell("info", f"photos {left} and {right}: {len(plan)} points to measure")
            if self._mono and self._model().laid is None:
                self._lay_photo(left)
                return
            self._lay()
            self._advance()

    def other_photo(self) -> None:
        """Take it that the other photo of the model was laid into the mono comparator.

        Raises
        ------
        InputError
            No model, or none that is measured one photo after the other.
        """
        with self._change():
            model = self._model()
            self._check_instrument(model)
            self._lay_photo(model.photo("right" if model.laid == "left" else "left"))

    def _lay_photo(self, photo: str) -> None:
        self._happen(PhotoLaid(photo))
        self._nowhere()
        self._lay()
        self._tell("info", f"photo {photo} lies in the comparator")
        self._advance()

    # -- the counters' reference ---------------------------------------------------------------

    @property
    def standing(self) -> bool:
        """Whether the plates stand still, and the mark is not being set."""
        return self._drive_target is None and not self._setting

    @property
    def settled(self) -> bool:
        """Whether they do, and the counters have been read since."""
        instrument = self._instrument
        if instrument is None or not self.standing:
            return False
        return instrument.link.read_since(self._heard_before)

    def reference(self, point: str | None = None) -> None:
        """Take it that the mark is set on something measured, of counters without reference.

        Parameters
        ----------
        point
            The measured point, or fiducial; None for the one that was proposed.

        Raises
        ------
        InputError
            The counters have their reference, there is nothing to refer them to, or a second
            pointing contradicts the first.
        """
        with self._change():
            instrument, referencing = self._instrument, self._referencing
            if instrument is None or referencing is None:
                raise InputError("the counters have their reference")
            if instrument.link.state != "live":
                raise InputError(f"the plotter's line is {instrument.link.state}")
            here = instrument.link.unreferenced_position
            if here is None or not self.settled:
                raise InputError("the counters have not been read since: try again")
            needed, known = references(self._state, self._last_measured)
            if point is not None:
                referencing = replace(referencing, chosen=point)
            at = referencing.proposed(needed, known)
            if not needed:
                self._referenced("nothing measured depends on the counters: they count on", None)
                return
            if at is None or (point is not None and at.name != point):
                raise InputError(
                    "nothing measured is there to refer the counters to: set them by hand and "
                    "keep them as they are"
                    if at is None
                    else f"{point} is no reference: it is not measured"
                )
            tolerance = tolerance_mm(self._block.precision.image_um)
            note = {"reference": at.title, "counters": [here.xl, here.yl, here.xr, here.yr]}
            try:
                referencing = referencing.pointed(at, here, tolerance)
            except InputError as error:
                self._referencing = Referencing()
                self._recorder.note("reference-refused", {**note, "reason": str(error)})
                raise
            self._recorder.note("reference-pointed", note)
            self._referencing = replace(referencing, chosen=None)
            self._heard_before = instrument.link.mark
            if referencing.open_sides(needed):
                self._tell("info", f"{at.title} pointed at: once more, there or elsewhere")
                return
            shift = referencing.shift(instrument.link.shift, tolerance, mono=self._mono)
            if shift is None:
                self._referenced("the counters kept their origin", None)
            else:
                self._referenced(
                    f"the counters are moved by {in_words(shift, mono=self._mono)}", shift
                )

    def keep_counters(self) -> None:
        """Take the counters as they are: the operator knows that they kept their origin, or set it.

        Raises
        ------
        InputError
            The counters have their reference.
        """
        with self._change():
            if self._instrument is None or self._referencing is None:
                raise InputError("the counters have their reference")
            self._referenced("the counters are taken as they are", None)

    def _referenced(self, words: str, shift: Position | None) -> None:
        """End re-measuring: readings count again, moved by an offset or as before (None)."""
        assert self._instrument is not None
        link = self._instrument.link
        payload = {} if shift is None else {"shift": [shift.xl, shift.yl, shift.xr, shift.yr]}
        self._recorder.note("referenced", {"text": words, **payload})
        if shift is None:
            link.confirm_reference()
        else:
            link.reference_by(shift)
        self._instrument.referred()
        self._referencing = None
        self._tell("info", words)
        self._nowhere()
        if not self._state.suspended:
            self._advance()

    def _watch_reference(self) -> None:
        """Notice that the counters have lost their reference."""
        instrument = self._instrument
        if instrument is None or instrument.link.referenced or self._referencing is not None:
            return
        with self._change():
            self._referencing = Referencing()
            self._heard_before = instrument.link.mark
            self._nowhere()
            self._recorder.note("unreferenced", {"reason": UNREFERENCED})
            self._tell("error", UNREFERENCED)

    def _aim_at_reference(self, referencing: Referencing, point: str) -> None:
        """Choose what the counters are referred to; an instrument may set the mark on it."""
        needed, known = references(self._state, self._last_measured)
        chosen = replace(referencing, chosen=point)
        at = chosen.proposed(needed, known)
        if at is None or at.name != point:
            raise InputError(f"{UNREFERENCED}; {point} is not measured or helps no further")
        self._referencing = chosen
        self._tell("info", f"reference: {at.title}")
        instrument = self._instrument
        if instrument is None or not instrument.own_operator:
            return
        self._setting = instrument.own_operator
        self._settles_after = instrument.drives_begun
        fiducial = len(at.places) == 1 and not self._is_point(at)
        side = next(iter(at.places)) if fiducial else None
        self._after.append(lambda: instrument.point_again(at.places, side))

    @staticmethod
    def _is_point(reference: Reference) -> bool:
        return reference.title.startswith("point ")

    def add_point(self, name: str) -> None:
        """Add a point beyond the plan, where the plates stand now.

        Raises
        ------
        InputError
            No model, no read-out, or the point exists already.
        """
        here = self.readout()
        with self._change():
            model = self._model()
            if model.open_inner is not None:
                raise InputError(f"{model.open_inner.name}: inner orientation comes first")
            if not name.strip() or not name.isprintable() or len(name) > 100:
                raise InputError("a point needs a printable name of at most 100 characters")
            if here is None:
                raise InputError("there is no read-out: drive the plates to the new point first")
            self._check_instrument(model)
            self._happen(PointAdded(added_point(self._state, model, name, here)))
            self._target = name

    def suspend(self) -> None:
        """Interrupt the work."""
        with self._change():
            self._happen(Suspended())

    def resume(self) -> None:
        """Go on with it."""
        with self._change():
            self._happen(Resumed())

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
            if self._drive_target is not None:
                raise InputError("the plates are still under way")
            yield
            self._setting = ""

    def take_over(self) -> None:
        """Take it that the instrument does not set the mark any more: somebody else does."""
        with self._change():
            self._setting = ""

    def tell(self, severity: Severity, text: str) -> None:
        """Tell whoever listens."""
        with self._change():
            self._tell(severity, text)

    @property
    def points_written(self) -> bool:
        """Whether image_points.csv holds every accepted model."""
        return self._points_written

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
            self._inbox.items.put(End())
            if self._thread is not threading.current_thread():
                self._thread.join()
            try:
                with contextlib.suppress(JournalError):
                    self._recorder.flush()
            finally:
                self._journal.close()

    def __enter__(self) -> Station:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- the one way in ------------------------------------------------------------------------

    @contextlib.contextmanager
    def _change(self) -> Iterator[None]:
        """Hold the lock, then publish what changed, then ask the link for what it is to do."""
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
                notices = self._notices
                self._notices = [] if self._listeners else notices[-_KEPT_NOTICES:]
                after, self._after = self._after, []
                self._watch.tell(self._block, self._state, self._outlook, self._of_session)
                self._snapshot = taken = self._picture()
        for severity, text in notices:
            for listener in list(self._listeners):
                listener(severity, text)
        for subscriber in list(self._subscribers):
            subscriber(taken)
        if refused is not None:
            raise refused
        for action in after:
            action()

    def _work(self) -> None:
        """Take readings out of the queue, one after another, until the end."""
        ended = False
        try:
            while True:
                item = self._inbox.items.get()
                if isinstance(item, End):
                    ended = True
                    return
                try:
                    self._take(item)
                except AnaplotError as error:
                    with contextlib.suppress(AnaplotError), self._change():
                        self._tell("error", str(error))
        finally:
            # an error of the program ends this thread: the station must not look alive then
            if not ended:
                self._fail()

    def _fail(self) -> None:
        with contextlib.suppress(Exception), self._change():
            self._link = replace(self._link, state="lost", detail="the station has failed")
            self._tell("error", "the station has failed: close the block and open it again")
        self._failed = True

    def _take(self, item: Heard) -> None:
        self._take_in(item)
        self._watch_reference()

    def _take_in(self, item: Heard) -> None:
        match item:
            case Traffic():
                self._keep(item)
            case Told():
                with self._lock:
                    self._recorder.told(item.kind, item.text, item.when)
            case Position():
                if self._drive_target is not None and _near(item, self._drive_target, _ARRIVED_MM):
                    with self._change():
                        self._arrived()
            case InPosition():
                if item.position is None or self._is_target(item.position):
                    with self._change():
                        self._arrived()
            case MarkSet():
                with self._change():
                    if self._settles_after is not None and item.drive > self._settles_after:
                        self._setting = ""
                        if self._instrument is not None:
                            self._heard_before = self._instrument.link.mark
                    if item.remark:
                        self._tell("warning", item.remark)
            case Record():
                with self._change():
                    self._recorded(item)
            case Fault():
                with self._change():
                    self._interrupted()
                    self._tell("error", f"plotter fault {item.code}: {item.text}")
                    self._recorder.note("fault", {"code": item.code, "text": item.text})
            case Refused():
                self._refused(item)
            case LinkChange():
                with self._change():
                    self._link_state(item)
            case WarmUp():
                warm_up()
            case End():
                pass

    # -- readings ------------------------------------------------------------------------------

    def _is_target(self, position: Position) -> bool:
        """Whether a drive's reply belongs to the present drive, not to one given up before."""
        return self._drive_target is not None and _near(position, self._drive_target, 1.0)

    def _arrived(self) -> None:
        self._drive_target = None

    def _nowhere(self) -> None:
        """Forget where the plates were to go: nothing is recorded before the next drive."""
        self._target = None
        self._drive_target = None
        self._setting = ""

    def _interrupted(self) -> None:
        """Give up the drive under way: nobody knows where the plates stand."""
        if self._drive_target is not None or self._setting:
            self._nowhere()

    def _keep(self, item: Traffic) -> None:
        """Remember the line's bytes; a disk that takes none is told once, until it does."""
        try:
            with self._lock:
                self._recorder.traffic(item.direction, item.link, item.data, item.when)
        except JournalError:
            if not self._traffic_refused:
                self._traffic_refused = True
                raise
        else:
            self._traffic_refused = self._recorder.refused

    def _recorded(self, record: Record) -> None:
        """Turn a record of the plotter into a measurement, or say why not."""
        try:
            model, point = self._recordable()
            before = {row.key for row in self._flagged()}
            inner = model.open_inner
            self._happen(measurement_of(self._state, model, point, record))
        except AnaplotError as error:
            self._tell("error", f"not recorded: {error}")
            if not isinstance(error, JournalError):
                self._recorder.note("record-refused", {"reason": str(error)})
            return
        self._target = None
        self._last_measured = point
        self._tell("record", f"{point} recorded" if inner is None else f"fiducial {point} recorded")
        fresh = [row.key for row in self._flagged() if row.key not in before]
        if fresh:
            self._tell("warning", "flagged: " + ", ".join(f"{name} {axis}" for name, axis in fresh))
        self._advance()

    def _flagged(self) -> tuple[Observation[Row], ...]:
        view = self._outlook.inner
        solution = self._outlook.solution if view is None else view.solution
        return () if solution is None else solution.flagged

    def _refused(self, refused: Refused) -> None:
        if refused.reason == UNREFERENCED:
            return  # every reading, until the reference is measured: told once, and on the screen
        now = time.monotonic()
        with self._lock:
            self._recorder.note("refused", {"reason": refused.reason})
        if now - self._refusal_told >= _REFUSALS_TOLD:
            self._refusal_told = now
            with self._change():
                self._tell("warning", f"line: {refused.reason}")

    def _link_state(self, item: LinkChange) -> None:
        self._link = replace(self._link, state=item.state, detail=item.detail)
        if item.state in ("lost", "reconnecting"):
            self._interrupted()
        if item.state == "lost":
            self._tell("error", f"link lost: {item.detail}" if item.detail else "link lost")

    # -- changing ------------------------------------------------------------------------------

    def _happen(self, event: Event) -> None:
        """Let an event happen: refused, or on disk before anybody is told."""
        state = apply(self._state, event)
        self._recorder.event(event)
        self._state = state
        old = self._outlook
        self._outlook = new = outlook(state)
        if new.solution is not None and new.solution is not old.solution:
            self._note("table", table_payload(new.solution))
        if new.inner is not None and new.inner.solution is not None:
            before = None if old.inner is None else old.inner.solution
            if new.inner.solution is not before:
                payload = inner_table_payload(new.inner.state, new.inner.solution)
                self._note("inner-table", payload)

    def _note(self, kind: str, payload: dict[str, Any]) -> None:
        """Put a table into the journal: what a replay will be compared with."""
        try:
            self._recorder.note(kind, payload)
        except JournalError as error:
            # the measurement itself is safe; a table can be computed again
            self._tell("warning", str(error))

    def _model(self) -> ModelState:
        if self._state.current is None:
            raise InputError("no model is in the instrument: choose the next model")
        return self._state.current

    def _recordable(self) -> tuple[ModelState, str]:
        """Return the model and the point that a record now belongs to."""
        model = self._model()
        if self._state.suspended:
            raise InputError("work is suspended: resume first")
        self._check_instrument(model)
        if self._drive_target is not None:
            raise InputError("the plates are still under way")
        if self._setting:
            raise InputError(f"{self._setting} is still setting the mark")
        if self._target is not None:
            return model, self._target
        # Without a drive the operator finds the points in the order of the plan by hand. Plates
        # that are driven stand at the last point: a second press must not be taken for another.
        by_hand = self._instrument is None or not self._instrument.drives
        inner = model.open_inner
        if inner is not None:
            if by_hand and inner.pending:
                return model, inner.pending[0]
            raise InputError("choose a fiducial first" if by_hand else "drive to a fiducial first")
        pending = self._pending(model)
        if by_hand and pending:
            return model, pending[0].point
        raise InputError("choose a point first" if by_hand else "drive to a point first")

    @property
    def _mono(self) -> bool:
        """Whether the instrument holds one photo at a time."""
        return self._instrument is not None and self._instrument.profile.mono

    def _check_instrument(self, model: ModelState) -> None:
        """Refuse a model that was begun in an instrument of the other kind, or lies nowhere."""
        if self._instrument is not None:
            check_instrument(model, mono=self._mono)

    def _pending(self, model: ModelState) -> tuple[PlannedPoint, ...]:
        """Return what is to be measured without anything being changed in the instrument."""
        if not model.mono:
            return model.pending
        return () if model.laid is None else model.pending_in(model.laid)

    def _aim(self, planned: PlannedPoint) -> None:
        """Make a point the target, and drive there where the plotter can."""
        self._target = planned.point
        instrument = self._instrument
        if instrument is None or not instrument.moves:
            return
        known = self._candidates is not None
        self._go(instrument, point_target(self._state, planned, known=known), None)

    def _aim_at_fiducial(self, inner: InnerState, fiducial: str) -> None:
        """Make a fiducial the target, and drive there where the plotter can."""
        self._target = fiducial
        instrument = self._instrument
        if instrument is None or not instrument.moves:
            return
        target = fiducial_target(self._state, inner, fiducial, instrument.middle)
        self._go(instrument, target, inner.side)

    def _go(self, instrument: Instrument, target: Position, side: Side | None) -> None:
        """Drive, to measure in one plate or (None) in both."""
        # undriven plates that are moved are there at once, and no reply says so
        self._drive_target = target if instrument.drives else None
        self._setting = instrument.own_operator
        # the mark that counts is the one set after this drive, not after one given up before
        self._settles_after = None

        def drive() -> None:
            self._settles_after = instrument.drives_begun
            try:
                instrument.drive(target, side)
            except AnaplotError:
                with contextlib.suppress(InputError), self._change():
                    self._interrupted()
                raise

        self._after.append(drive)

    def _advance(self) -> None:
        """Go to the next point of the plan by itself, where that is wanted."""
        model = self._state.current
        if not self._auto_drive or model is None:
            return
        inner = model.open_inner
        if inner is not None:
            if inner.pending:
                self._aim_at_fiducial(inner, inner.pending[0])
        elif self._referencing is None and (pending := self._pending(model)):
            self._aim(pending[0])

    def _lay(self) -> None:
        model = self._state.current
        if self._instrument is None or model is None:
            return
        if not model.mono:
            self._instrument.lay(model.left, model.right)
        elif model.laid is not None:
            before = self._state.preceding(model.strip, model.left)
            # the right photo of the model before, never taken out since
            still = before is not None and before.laying == model.laying and model.laid == "left"
            placed: Side = "right" if still else model.laid
            self._instrument.lay(model.left, model.right, model.laid, placed)

    # -- files ---------------------------------------------------------------------------------

    def _write_points(self) -> None:
        """Bring image_points.csv up to the accepted models; what fails is tried again later."""
        if self._points_written:
            return
        try:
            # read anew: rows that came from elsewhere meanwhile stay
            found = read_block(self._folder).image_points
            rows = merged_rows(found, self._state.models, self._of_session)
            if rows != found:
                write_image_points(self._folder, rows)
        except InputError as error:
            self._tell("error", f"{error}; the measurements are safe in the journal")
            return
        self._block = replace(self._block, image_points=rows)
        self._points_written = True

    def _known_points(self, candidates: Candidates | None) -> Candidates | None:
        """Points to choose from: given ones, else rows measured elsewhere before."""
        if candidates is not None:
            return candidates
        known: dict[str, dict[str, tuple[float, float]]] = {}
        own = measured_here(self._state.models)
        for row in self._block.image_points:
            if (row.photo, row.point, row.x, row.y) in own:
                continue
            if row.model is None or row.model not in self._of_session:
                known.setdefault(row.photo, {})[row.point] = (row.x, row.y)
        return known or None

    # -- showing -------------------------------------------------------------------------------

    def _block_seen(self) -> None:
        """Show what the block says now, in the thread of the watch."""
        with contextlib.suppress(InputError), self._change():
            pass

    def _tell(self, severity: Severity, text: str) -> None:
        self._notices.append((severity, text))

    def _picture(self) -> Snapshot:
        self._serial += 1
        shown = picture(
            self._block, self._state, self._outlook, self._serial, self._target, self._link
        )
        shown = replace(shown, block_view=self._watch.view)
        if self._mono and not shown.left and self._outlook.next_model is not None:
            _, left, right = self._outlook.next_model
            words = f"lay photo {left} into the comparator: next model, {left} / {right}"
            if not self._state.suspended:
                shown = replace(shown, expected=words)
        if self._referencing is None:
            return shown
        return asking(shown, self._referencing, references(self._state, self._last_measured))


def _laid(state: SessionState) -> Side | None:
    """Return which photo lies in a mono comparator, or None."""
    return None if state.current is None else state.current.laid


def _photos(state: SessionState) -> tuple[str, str] | None:
    return None if state.current is None else state.current.photos


def _in_inner(state: SessionState) -> tuple[str, Side] | None:
    """Return the photo and carriage of the inner orientation in work, or None."""
    inner = None if state.current is None else state.current.open_inner
    return None if inner is None else (inner.photo, inner.side)


def _near(here: Position, target: Position, within: float) -> bool:
    return (
        max(
            abs(here.xl - target.xl),
            abs(here.yl - target.yl),
            abs(here.xr - target.xr),
            abs(here.yr - target.yr),
        )
        <= within
    )
