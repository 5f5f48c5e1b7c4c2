"""A new block from what can be read of a damaged journal, and what is missing in it.

Where records are missing, those behind them may not fit any more. Little is assumed then, and all
of it is said: a model is taken as begun when something is measured in it, and as accepted when the
next one was; an inner orientation is accepted anew as its fiducials have it; a tie whose
measurement is lost becomes a new point; an undo that may have taken back something lost takes back
nothing.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import JournalRecord, event_of
from anaplot.exchange.journalsnapshot import PART, SNAPSHOT
from anaplot.exchange.recordline import JOURNAL_FORMAT, OPENING, SESSIONS, encode_line
from anaplot.exchange.salvage import Gap, read_what_can_be_read
from anaplot.session.events import (
    EVENT_KINDS,
    DecidedRow,
    DecisionsTakenOver,
    Event,
    FiducialMeasured,
    InnerAccepted,
    ModelAccepted,
    ModelChosen,
    ModelReopened,
    MonoMeasured,
    PhotoLaid,
    PlannedPoint,
    PointAdded,
    PointMeasured,
    PointRenamed,
    ReasonGiven,
    Resumed,
    Role,
    Suspended,
    Undone,
)
from anaplot.session.innerwork import acceptance, solve_inner
from anaplot.session.state import (
    WHILE_SUSPENDED,
    EventRefusedError,
    SessionState,
    apply,
    fold,
    start,
)
from anaplot.station.payloads import heard_in, inner_table_of, opened_by, table_of
from anaplot.station.rebuild import rebuild
from anaplot.station.replay import Replayed, recorded_block
from anaplot.textfiles.wholefile import create_whole, make_folder
from anaplot.textfiles.wording import place, plain
from anaplot.version import __version__

__all__ = ["Salvaged", "salvage"]

_PARSERS = {
    "header": opened_by,
    "opened": opened_by,
    "traffic": heard_in,
    "table": table_of,
    "inner-table": inner_table_of,
}
_IN_A_MODEL = FiducialMeasured | InnerAccepted | PointMeasured | MonoMeasured | PointRenamed
_IN_A_PHOTO = FiducialMeasured | InnerAccepted | MonoMeasured


@dataclass(frozen=True, slots=True)
class Salvaged:
    """What was brought over.

    Attributes
    ----------
    state
        The session's state in the new block.
    records
        How many records were brought over.
    gaps
        What cannot be read.
    left_out, assumed
        Sentences, with file and line: what can be read and does not fit any more; what was put
        in so that the rest fits.
    """

    state: SessionState
    records: int
    gaps: tuple[Gap, ...]
    left_out: tuple[str, ...]
    assumed: tuple[str, ...]


def salvage(session: Path, folder: Path) -> Salvaged:
    """Bring what can be read of a session into a new block, whose session goes on there.

    Parameters
    ----------
    session
        A journal file, a folder `sessions`, or a block folder; nothing in it is changed.
    folder
        The new block: block.toml, camera files, image_points.csv and `sessions`.

    Raises
    ------
    InputError
        Nothing can be read, nobody knows of which block it is, or the new one cannot be written.
    """
    sessions = folder / SESSIONS
    if sessions.exists() or sessions.is_symlink():
        raise InputError(f"{place(sessions)}: there is a session already")
    readable = read_what_can_be_read(session)
    headers = [r for records in readable.files for r in records if r.kind in OPENING]
    block = recorded_block(session, headers)
    fold = _Fold(start(block), readable.lost_before)
    files = [fold.file(records) for records in readable.files if records]
    rebuild(Replayed(block, fold.state, 0, 0, ()), folder)
    make_folder(sessions)
    for number, data in enumerate(files, 1):
        create_whole(sessions / f"{number:04d}.jsonl", data)
    return Salvaged(
        fold.state, fold.brought, readable.gaps, tuple(fold.left_out), tuple(fold.assumed)
    )


class _Fold:
    """The state while records come in, and the lines of the new journal.

    Parameters
    ----------
    state
        Before the first record.
    lost_before
        Sequence numbers of the records before which others are missing.
    """

    def __init__(self, state: SessionState, lost_before: frozenset[int]) -> None:
        self.state = state
        self.left_out: list[str] = []
        self.assumed: list[str] = []
        self.brought = 0
        self._lost_before = lost_before
        self._mono = False  # whether the instrument holds one photo
        self._lost = False  # whether anything is missing so far
        self._undoable = 0  # events since the last thing that is missing
        self._changed = False  # whether any of them changed a measurement
        self._seq = 0
        self._header: dict[str, Any] = {
            "program": "anaplot",
            "version": __version__,
            "format": JOURNAL_FORMAT,
            "block": state.block.name,
        }

    def file(self, records: Iterable[JournalRecord]) -> bytes:
        """Return the lines of a new file from the records of an old one."""
        lines: list[bytes] = []
        for record in records:
            if record.seq in self._lost_before:
                self._gap()
            if not lines and record.kind != "header":
                # sessions begin another file in their midst, as a rule
                header = self._header | ({"goes_on": True} if self._seq else {})
                lines.append(self._line(record.time, "header", header))
            lines.extend(self._taken(record, first=not lines))
        return b"".join(lines)

    def _gap(self) -> None:
        """Take notice that something is missing here."""
        self._lost, self._undoable, self._changed = True, 0, False

    def _line(self, time: str, kind: str, payload: Mapping[str, Any]) -> bytes:
        # a file of the new journal is on disk whole before anything is written behind it
        line = encode_line(self._seq + 1, time, kind, payload, durable=True)
        self._seq += 1
        return line

    def _taken(self, record: JournalRecord, *, first: bool) -> list[bytes]:
        """Return the lines that a record becomes."""
        try:
            if record.kind in (SNAPSHOT, PART):
                return []  # it follows from the events, and another file stands before it now
            if record.kind in EVENT_KINDS:
                events = self._happened(record, event_of(record))
                lines = [self._line(record.time, e.kind, event_to_payload(e)) for e in events]
            else:
                if record.kind == "header" and not first:
                    raise InputError(f"{record.file} line {record.line}: a second header")
                if record.kind in _PARSERS:
                    _PARSERS[record.kind](record)
                lines = [self._line(record.time, record.kind, record.payload)]
        except InputError as error:
            self.left_out.append(str(error))
            return []
        if record.kind in OPENING:
            self._header = dict(record.payload)
        self.brought += 1
        return lines

    def _happened(self, record: JournalRecord, event: Event) -> list[Event]:
        """Let an event happen; return it, and before it what had to be assumed."""
        where = f"{record.file} line {record.line}"
        self._mono |= isinstance(event, PhotoLaid | MonoMeasured)
        if isinstance(event, Undone) and self._lost:
            if self._undoable == 0:
                raise InputError(f"{where}: an undo, of what is missing perhaps")
            self._undoable -= 1
        if isinstance(event, ReasonGiven) and self._lost and not self._changed:
            raise InputError(f"{where}: a reason, for what is missing perhaps")
        events, words = self._fitting(event) if self._lost else ([event], [])
        state = self.state
        try:
            for each in events:
                state = apply(state, each)
        except EventRefusedError as error:
            if not isinstance(event, Suspended | Resumed | ReasonGiven):
                self._gap()
            raise InputError(f"{where}: {event.kind}: {error}") from None
        self.state = state
        if not isinstance(event, Suspended | Resumed | Undone | ReasonGiven):
            self._undoable += 1
        if not isinstance(event, Suspended | Resumed | ReasonGiven):
            self._changed |= state.last_change is not None and state.last_change.latest
        self.assumed += [f"{where}: {word}" for word in words]
        fallen = _fallen(event, events[-1])
        if fallen:
            self.left_out.append(f"{where}: {event.kind}: what does not fit: {plain(fallen)}")
        return events

    def _fitting(self, event: Event) -> tuple[list[Event], list[str]]:
        """Return an event with what must have happened before it, and that in words."""
        events: list[Event] = []
        words: list[str] = []
        if self.state.suspended and not isinstance(event, WHILE_SUSPENDED):
            events.append(Resumed())
            words.append("work was resumed")
        here = _photos_of(event) or self._photos_of_plate(event)
        if here is not None:
            put_in, said = self._changed_over(event, here)
            events += put_in
            words += said
        put_in, said = self._laid(event, events)
        events += put_in
        words += said
        if here is not None:
            put_in, said = self._oriented(event, here, events)
            events += put_in
            words += said
        current = self._ahead(events).current
        if isinstance(event, DecisionsTakenOver):
            return self._decided(event)
        if isinstance(event, ModelChosen):
            before = self._ahead(events).preceding(event.strip, event.left)
            known = set() if before is None else {m.point for m in before.used}
            plan = tuple(_as_known(point, known) for point in event.plan)
            changed = [q for p, q in zip(event.plan, plan, strict=True) if p != q]
            words += _roles_told(event, {point.point: point.role for point in changed})
            event = replace(event, plan=plan)
        elif isinstance(event, PointRenamed):
            as_named = self._as_named(event, events)
            if as_named != event:
                words += _roles_told(event, {event.name: as_named.role})
            event = as_named
        elif isinstance(event, ModelReopened):
            event = self._reopened(event)
        elif isinstance(event, PointMeasured | MonoMeasured) and current is not None:
            mine = here == current.photos and current.mono == isinstance(event, MonoMeasured)
            if mine and current.planned(event.point) is None:
                before = self.state.preceding(current.strip, current.left)
                known = set() if before is None else {m.point for m in before.used}
                events.append(PointAdded(_as_known(_planned(event), known)))
                words.append(f"point {plain(event.point)} was added to model {current.name}")
        return [*events, event], words

    def _as_named(self, event: PointRenamed, before: list[Event]) -> PointRenamed:
        """Return a renaming with the role that the name can have, after what happens before it."""
        ahead = self._ahead(before)
        model = ahead.current
        if model is None or model.planned(event.name) is not None:
            return event  # the name has a role
        preceding = ahead.preceding(model.strip, model.left)
        known = set() if preceding is None else {m.point for m in preceding.used}
        return replace(event, role=_role_as_known(event.name, event.role, known))

    def _decided(self, event: DecisionsTakenOver) -> tuple[list[Event], list[str]]:
        """Return the decisions that fit; before them that the model in work was accepted.

        As a whole where none fits: then it is refused.
        """
        ahead, events, words = self.state, list[Event](), list[str]()
        current = ahead.current
        if (
            current is not None
            and ahead.accepted(*current.photos) is None
            and any((row.left, row.right) == current.photos for row in event.rows)
        ):
            accepted = ModelAccepted(*current.photos)
            with contextlib.suppress(EventRefusedError):
                ahead = apply(ahead, accepted)
                events.append(accepted)
                words.append(f"model {plain(current.name)} was accepted")
        rows = event.rows
        if not _fits(ahead, rows):
            rows = tuple(row for row in rows if _fits(ahead, (row,))) or rows
        return [*events, replace(event, rows=rows)], words

    def _changed_over(self, event: Event, here: tuple[str, str]) -> tuple[list[Event], list[str]]:
        """Return how the work came to the model of an event: what was accepted or returned to."""
        state, events, words = self.state, list[Event](), list[str]()
        strip = self._strip_begun(event, here)
        chosen = isinstance(event, ModelChosen) or strip is not None
        reopened = isinstance(event, ModelReopened)
        while (current := state.current) is not None:
            there = current.photos == here
            finished = there and reopened and (state.returned or not state.accepted(*here))
            left = not there and (chosen or state.returned is not None)
            try:
                after = apply(state, ModelAccepted(*current.photos))
            except EventRefusedError:
                break
            if not (finished or left):
                break
            state = after
            events.append(ModelAccepted(*current.photos))
            words.append(f"model {plain(current.name)} was accepted")
        elsewhere = state.current is None or state.current.photos != here
        if elsewhere and not (chosen or reopened) and state.accepted(*here) is not None:
            events.append(ModelReopened(*here))
            words.append(f"model {plain('/'.join(here))} was returned to")
        elif strip is not None and state.current is None:
            events.append(ModelChosen(strip, *here, (), mono=self._mono))
            words.append(f"model {plain('/'.join(here))} was begun")
        return events, words

    def _ahead(self, events: Iterable[Event]) -> SessionState:
        """Return the state after events that are put in, where they fit."""
        with contextlib.suppress(EventRefusedError):
            return fold(self.state, events)
        return self.state

    def _strip_begun(self, event: Event, here: tuple[str, str]) -> str | None:
        """Return the strip of a model in which something is measured that was never begun."""
        state = self.state
        if not isinstance(event, _IN_A_MODEL) or state.accepted(*here) is not None:
            return None
        if state.current is not None and state.current.photos == here:
            return None
        return next((strip.id for strip in state.block.strips if here in strip.models()), None)

    def _photos_of_plate(self, event: Event) -> tuple[str, str] | None:
        """Return the photos of the only model in which a plate lies in its carriage, or None."""
        if not isinstance(event, FiducialMeasured | InnerAccepted):
            return None
        current = self.state.current
        if current is not None and current.mono:
            return None
        at = 0 if event.side == "left" else 1
        models = (model for strip in self.state.block.strips for model in strip.models())
        here = [model for model in models if model[at] == event.photo]
        return here[0] if len(here) == 1 else None

    def _laid(self, event: Event, before: list[Event]) -> tuple[list[Event], list[str]]:
        """Return that the photo lies in a mono comparator in which something is measured."""
        model = self._ahead(before).current
        if model is None or not (model.mono and isinstance(event, _IN_A_PHOTO)):
            return [], []
        photo = model.photo(event.side)
        elsewhere = not isinstance(event, MonoMeasured) and event.photo != photo
        if elsewhere or model.laid == event.side:
            return [], []
        return [PhotoLaid(photo)], [f"photo {plain(photo)} was laid in"]

    def _oriented(
        self, event: Event, here: tuple[str, str], before: list[Event]
    ) -> tuple[list[Event], list[str]]:
        """Return which inner orientations were accepted before something else was measured."""
        events, words = list[Event](), list[str]()
        while True:
            model = self._ahead([*before, *events]).current
            inner = None if model is None or model.photos != here else model.open_inner
            if inner is None or not isinstance(event, _IN_A_MODEL):
                return events, words
            if isinstance(event, FiducialMeasured | InnerAccepted) and event.side == inner.side:
                return events, words
            try:
                accepted = acceptance(inner, solve_inner(self.state.block, inner))
            except NotComputableError:
                return events, words  # it is refused, and why is said
            events.append(accepted)
            words.append(f"the inner orientation of {plain(inner.name)} was accepted")

    def _reopened(self, event: ModelReopened) -> ModelReopened:
        """Return a return to a model, without the point for which it was where that is lost."""
        model = self.state.accepted(event.left, event.right)
        if event.point is None or model is None or model.measurement(event.point) is not None:
            return event
        return replace(event, point=None, photo=None)


def _planned(event: PointMeasured | MonoMeasured) -> PlannedPoint:
    """Return a point of the plan where it was measured; elsewhere nobody knows its place."""
    if isinstance(event, PointMeasured):
        return PlannedPoint(event.point, "new", event.xl, event.yl, event.xr, event.yr)
    return PlannedPoint(event.point, "new", event.x, event.y, event.x, event.y)


def _photos_of(event: Event) -> tuple[str, str] | None:
    """Return the photos of the model that an event names, or None."""
    match event:
        case ModelChosen() | ModelReopened() | ModelAccepted():
            return event.left, event.right
        case PointMeasured() | MonoMeasured() | PointRenamed():
            return event.left, event.right
        case _:
            return None


def _fits(state: SessionState, rows: tuple[DecidedRow, ...]) -> bool:
    try:
        apply(state, DecisionsTakenOver(rows))
    except EventRefusedError:
        return False
    return True


def _fallen(before: Event, after: Event) -> str:
    """Return which rows of decisions are not among those that were brought over; "" for none."""
    if not isinstance(before, DecisionsTakenOver) or not isinstance(after, DecisionsTakenOver):
        return ""
    kept = set(after.rows)
    rows = [row for row in before.rows if row not in kept]
    return ", ".join(f"{row.left}/{row.right} {row.point} {row.axis}" for row in rows)


def _roles_told(event: ModelChosen | PointRenamed, roles: Mapping[str, Role]) -> Iterator[str]:
    """Yield which points of a model have another role than was recorded, and which."""
    for ties, what in ((False, "no ties, but new points"), (True, "ties, of the model before")):
        names = [point for point, role in roles.items() if (role == "tie") == ties]
        if names:
            yield f"model {event.left}/{event.right}: {what}: {plain(', '.join(names))}"


def _as_known(point: PlannedPoint, known: set[str]) -> PlannedPoint:
    """Return a planned point in the role that it can have: a tie is known before."""
    return replace(point, role=_role_as_known(point.point, point.role, known))


def _role_as_known(point: str, role: Role, known: set[str]) -> Role:
    if point in known:
        return "tie"
    return "new" if role == "tie" else role
