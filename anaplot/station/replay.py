"""Replay: recorded bytes through the same decoder, events through the same fold, tables compared.

A journal holds what came over the line, what was made of it, and the tables that the operator
saw. A replay makes all of it again; wherever the outcome differs, it says where.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Progress
from anaplot.errors import AnaplotError, InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.blocktoml import parse_block_toml
from anaplot.exchange.journal import JournalRecord, event_of
from anaplot.exchange.journalkinds import is_known
from anaplot.exchange.journalstored import StoredRecords
from anaplot.exchange.patternfile import is_pattern_file
from anaplot.exchange.recordline import OPENING
from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.block import Block
from anaplot.plotter.decoder import Decoder
from anaplot.plotter.profile import recorded_profile
from anaplot.plotter.readings import Position, Record
from anaplot.session.desk import Desk
from anaplot.session.events import (
    EVENT_KINDS,
    Event,
    FiducialMeasured,
    InnerAccepted,
    MonoMeasured,
    PointMeasured,
    PointRepeated,
)
from anaplot.session.innerwork import InnerOutlook, inner_outlook
from anaplot.session.models import solved_or_none
from anaplot.session.modes import mode_of
from anaplot.session.repeating import repetition
from anaplot.session.state import EventRefusedError, SessionState, apply, fold, start
from anaplot.session.tiecheck import NOTHING_KNOWN
from anaplot.station.payloads import (
    Heard,
    Opened,
    heard_in,
    inner_table_of,
    opened_by,
    refusal,
    table_of,
)
from anaplot.station.snapshotcheck import SnapshotCheck
from anaplot.station.tables import inner_table_difference, table_difference
from anaplot.textfiles.wording import quoted

__all__ = ["Difference", "Replayed", "Step", "recorded_block", "replay", "replay_session"]

Measurement = PointMeasured | FiducialMeasured | MonoMeasured | PointRepeated

_REMEMBERED = 64  # records of the line that may still become measurements
_SAME = 1e-9  # mm, by which an accepted transformation may differ at its fiducials


class Difference(NamedTuple):
    """Something that came out differently: where in the journal, and what."""

    file: str
    line: int
    what: str

    def __str__(self) -> str:
        return f"{self.file} line {self.line}: {self.what}"


@dataclass(frozen=True, eq=False)
class Step:
    """One step of a replay: the record, the state after it, what stands then, what differed.

    Attributes
    ----------
    record
        The journal's record.
    state
        The session's state after it.
    of_desk
        Computes the `desk` after it.
    event
        The event that it was, or None.
    position
        The latest position that the recorded bytes gave, or None.
    compared
        Whether it was a table, and was compared.
    difference
        What came out differently, or None.
    """

    record: JournalRecord
    state: SessionState
    of_desk: Callable[[], Desk] = field(repr=False)
    event: Event | None
    position: Position | None
    compared: bool
    difference: Difference | None

    @cached_property
    def desk(self) -> Desk:
        """The desk after it: most of what stands on it is an orientation, which is computed now."""
        return self.of_desk()


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """The outcome of a whole replay.

    Attributes
    ----------
    block
        The block as it was declared when the session was opened last.
    state
        The final state.
    tables, measurements
        How many tables were compared, and how many measurements found in the recorded bytes.
    differences
        Everything that came out differently, in order.
    remarks
        What of the journal was left out: a torn end, files that are none of it.
    """

    block: Block
    state: SessionState
    tables: int
    measurements: int
    differences: tuple[Difference, ...]
    remarks: tuple[str, ...] = ()


def recorded_block(session: Path, records: Iterable[JournalRecord]) -> Block:
    """Return the block as it was declared when a session was opened last.

    What is declared may be changed between two openings: all that was measured before is computed
    with it from then on. Point patterns of their own are as they were when a session was last
    opened with them. Journals that declare none belong to a folder whose block.toml still says it.

    Parameters
    ----------
    session
        A journal file, a folder `sessions`, or a block folder.
    records
        Of its journal; those of its headers suffice.

    Raises
    ------
    InputError
        Neither is there, or it is wrong.
    """
    openings = [record for record in records if record.kind in OPENING]
    for record in reversed(openings):
        said = opened_by(record)
        if said.block_toml is not None:
            return _with_pattern(_declared(record, said.block_toml, said.camera_files), openings)
    folder = session if session.is_dir() else session.parent
    if folder.name == "sessions":
        folder = folder.parent
    return read_block(folder)


def _declared(record: JournalRecord, text: str, cameras: Mapping[str, str]) -> Block:
    """Return the block that a record declares."""
    try:
        return parse_block_toml(text, Path(record.file).with_name("block.toml"), cameras)
    except InputError as error:
        raise refusal(record, str(error)) from None


def _with_pattern(block: Block, openings: Sequence[JournalRecord]) -> Block:
    """Return a block with the points of its pattern's file, where a session was opened with it."""
    name = block.measuring.pattern
    if name is None or not is_pattern_file(name):
        return block
    for record in reversed(openings):
        said = opened_by(record)
        if said.pattern == name and said.pattern_points is not None:
            points = said.pattern_points
            return replace(block, measuring=replace(block.measuring, points=points))
    return block


def replay_session(session: Path, progress: Progress | None = None) -> Replayed:
    """Replay a recorded session to its end, as fast as it goes.

    Parameters
    ----------
    session
        A journal file, a folder `sessions`, or a block folder.
    progress
        Is told how much of the journal is played.

    Raises
    ------
    InputError
        It cannot be read, is damaged, or does not fit its block.
    """
    records = StoredRecords(session, is_known)
    block = recorded_block(session, records.openings)
    state = start(block)
    tables = measurements = 0
    differences: list[Difference] = []
    for number, step in enumerate(replay(block, records), 1):
        if progress is not None:
            progress("replay", number / len(records))
        state = step.state
        tables += step.compared
        measured = isinstance(step.event, Measurement)
        measurements += measured and step.difference is None
        if step.difference is not None:
            differences.append(step.difference)
    return Replayed(state.block, state, tables, measurements, tuple(differences), records.remarks)


def replay(
    block: Block,
    records: StoredRecords | Sequence[JournalRecord],
    pace: Callable[[JournalRecord], None] | None = None,
) -> Iterator[Step]:
    """Replay records one after another.

    Where a session was opened again with another block.toml, all that happened before is computed
    with that from there on, as it was when the operator opened it.

    Parameters
    ----------
    block
        Which it is until a record declares it.
    records
        Of one journal, from its beginning.
    pace
        Called before each record; waits, when the recorded speed is wanted.

    Yields
    ------
    Step
        After each record.

    Raises
    ------
    InputError
        An event does not fit the state: the journal is not of this block.
    """
    if isinstance(records, StoredRecords):
        openings = records.openings
    else:
        openings = [record for record in records if record.kind in OPENING]
    state = start(block)
    desks = _Desks()
    events: list[Event] = []
    declared: tuple[str, Mapping[str, str]] | None = None
    line = _Decoding()
    snapshots = SnapshotCheck()
    for record in records:
        if pace is not None:
            pace(record)
        event: Event | None = None
        difference: str | None = None
        compared = False
        if record.kind in OPENING:
            said = opened_by(record)
            difference = line.opened(said)
            if said.block_toml is not None and (said.block_toml, said.camera_files) != declared:
                declared = said.block_toml, said.camera_files
                block = _with_pattern(_declared(record, *declared), openings)
                state = _opened_with(block, events, record)
        elif record.kind == "traffic":
            line.traffic(record)
        elif record.kind in EVENT_KINDS:
            event = event_of(record)
            if isinstance(event, Measurement):
                difference = line.check(event, state)
            before = state
            try:
                state = apply(state, event)
            except EventRefusedError as error:
                raise InputError(f"{record.file} line {record.line}: {error}") from error
            events.append(event)
            snapshots.happened(event, state)
            if isinstance(event, InnerAccepted):
                difference = _accepted_otherwise(event, state, _inner_in_work(before))
        elif record.kind == "table":
            compared = True
            difference = table_difference(table_of(record), _solution_in_work(state))
        elif record.kind == "inner-table":
            compared = True
            inner = _inner_in_work(state)
            difference = inner_table_difference(
                inner_table_of(record),
                None if inner is None else inner.state,
                None if inner is None else inner.solution,
            )
        else:
            difference = snapshots.difference(record, state)
        yield Step(
            record=record,
            state=state,
            of_desk=partial(desks.at, state),
            event=event,
            position=line.position,
            compared=compared,
            difference=None
            if difference is None
            else Difference(record.file, record.line, difference),
        )


def _opened_with(block: Block, events: Iterable[Event], record: JournalRecord) -> SessionState:
    """Return what all that happened before leads to with the block that a record declares."""
    try:
        return fold(start(block), events)
    except EventRefusedError as error:
        raise InputError(
            f"{record.file} line {record.line}: what happened before does not fit the block "
            f"declared here: {error}"
        ) from error


class _Desks:
    """The desk at states of a session, each after the one before: little of it is another."""

    def __init__(self) -> None:
        self._desk: Desk | None = None

    def at(self, state: SessionState) -> Desk:
        """Return the desk at a state."""
        if self._desk is None:
            self._desk = Desk.at(state)
        elif self._desk.state is not state:
            self._desk = self._desk.moved_to(state)
        return self._desk


def _inner_in_work(state: SessionState) -> InnerOutlook | None:
    """Return the inner orientation that comes before the points of the model in work, or None."""
    inner = None if state.current is None else state.current.open_inner
    return None if inner is None else inner_outlook(state.block, inner)


def _solution_in_work(state: SessionState) -> ModelSolution | None:
    """Return the model in work, where its points are measured and determine it."""
    model = state.current
    if model is None or model.open_inner is not None or not model.measured:
        return None
    return solved_or_none(state, model)


class _Decoding:
    """The decoder's side of a replay."""

    def __init__(self) -> None:
        self._decoder: Decoder | None = None
        self._records: deque[Record] = deque(maxlen=_REMEMBERED)
        self.position: Position | None = None

    def opened(self, said: Opened) -> str | None:
        """Begin with a fresh decoder, as the link did; not where a session goes on."""
        if said.goes_on and self._decoder is not None:
            return None
        self._decoder = None
        self._records.clear()
        if said.profile is None:
            return None
        name = quoted(said.profile)
        try:
            profile = recorded_profile(said.profile, said.profile_sha256, said.profile_text)
            self._decoder = Decoder(profile, rules=said.rules, speed_limits=not said.simulated)
            if said.shift is not None:
                self._decoder.move(said.shift)
        except AnaplotError as error:
            return f"profile {name}: {error}"
        if said.profile_sha256 != profile.sha256:
            return f"profile {name} is not the one that the session was recorded with"
        return None

    def traffic(self, record: JournalRecord) -> None:
        """Feed recorded bytes to the decoder; raises InputError for what no line has said."""
        heard = heard_in(record)
        decoder = self._decoder
        if decoder is None:
            return
        for item in heard:
            if item.kind == "decoder":
                self._tell(decoder, item, record)
            elif item.kind in ("in", "out"):
                _check_link(decoder, item.name, record)
                if item.kind == "out":
                    decoder.sent(item.data, item.name, item.when)
                else:
                    self._hear(decoder, item)

    def _hear(self, decoder: Decoder, item: Heard) -> None:
        for reading in decoder.feed(item.data, item.when, item.name):
            if isinstance(reading, Record):
                self._records.append(reading)
                self.position = reading.position
            elif isinstance(reading, Position):
                self.position = reading

    @staticmethod
    def _tell(decoder: Decoder, item: Heard, record: JournalRecord) -> None:
        if item.name == "press":
            decoder.press(item.text, item.when)
        elif item.name == "reopen":
            if item.text:
                _check_link(decoder, item.text, record)
            decoder.reopen(item.text or None)
        elif item.name == "reference":
            try:
                decoder.reference(item.position())
            except InputError as error:
                raise refusal(record, str(error)) from None
        elif item.name == "confirm":
            decoder.confirm_reference()

    def check(self, event: Measurement, state: SessionState) -> str | None:
        """Find the measurement among what the bytes said before it, to the last digit."""
        if self._decoder is None:
            return None
        mode = mode_of(state, NOTHING_KNOWN)
        if isinstance(event, FiducialMeasured):
            point = event.fiducial
            name = f"fiducial {point} of photo {event.photo} ({event.side})"
        elif isinstance(event, PointRepeated):
            point = event.name
            name = f"{'fiducial' if event.fiducial else 'point'} {point}, pointed at again"
        else:
            point = event.point
            name = f"point {point}"
        while self._records and mode is not None:
            at = self._records.popleft().position
            # whatever switch it was
            said: Event = mode.measurement(point, at, event.switch)
            if isinstance(event, PointRepeated):
                said = repetition(mode.model, said, moved=event.moved)
            if said == event:
                return None
        return f"{name}: the recorded bytes do not say what was measured"


def _check_link(decoder: Decoder, link: str, record: JournalRecord) -> None:
    if link not in decoder.profile.links:
        raise refusal(record, f"profile {decoder.profile.id} has no link {quoted(link)}")


def _accepted_otherwise(
    event: InnerAccepted, state: SessionState, inner: InnerOutlook | None
) -> str | None:
    """Compare an accepted inner orientation with the one computed now; None when they agree."""
    after = None if state.current is None else state.current.inner_of(event.side)
    was = None if after is None else after.accepted
    name = f"photo {event.photo} ({event.side})"
    if inner is None or inner.solution is None or was is None:
        return f"{name}: an inner orientation was accepted, but none is computed now"
    now = inner.solution.transformation
    if now.kind != was.kind:
        return f"{name}: {now.kind} instead of {was.kind}"
    places = np.array([(m.x, m.y) for m in inner.state.used])
    gap = float(np.abs(was.to_image(places) - now.to_image(places)).max())
    return None if gap <= _SAME else f"{name}: a transformation that differs by {gap * 1e3:.3g} um"
