"""Snapshots in a journal: they say what the events lead to, and nothing when they are damaged."""

from __future__ import annotations

import copy
import json
import zlib
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, cast

import pytest
import test_inner_rules
import test_mono_fold
from hypothesis import given
from hypothesis import strategies as st
from journaltools import events_of
from sessionscene import Scene
from test_going_back import mono, three
from test_session_fold import Draft, drafts, played
from transferscene import flown, second_strip_begun

from anaplot.errors import InputError
from anaplot.exchange import journalsnapshot
from anaplot.exchange.blockfolder import read_block, write_new_block
from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import Journal, JournalError, read_journal
from anaplot.exchange.journalread import MAX_FILE_BYTES
from anaplot.exchange.journalsnapshot import snapshots_of
from anaplot.exchange.statecodec import StateWriter, Told, state_from_text
from anaplot.photogrammetry.block import Block
from anaplot.session import state as state_module
from anaplot.session.events import (
    EVENT_KINDS,
    Event,
    ModelAccepted,
    ModelReopened,
    ReasonGiven,
    RowSwitched,
    Undone,
)
from anaplot.session.pointedat import Target, Targets, pointed_at
from anaplot.session.returning import AsAccepted
from anaplot.session.state import EventRefusedError, SessionState, apply, fold, start
from anaplot.station import restored as restored_module
from anaplot.station import snapshotcheck
from anaplot.station.imagepoints import accepted_ever
from anaplot.station.replay import replay_session
from anaplot.station.restored import Past, PastReading, Snapshots, choice_for
from anaplot.station.salvage import salvage
from anaplot.station.station import Station

UNDO = 8


def read_back(
    state: SessionState, ever: Iterable[str] = (), pointed: Targets | None = None
) -> SessionState:
    text = StateWriter().text(state, frozenset(ever), pointed or {})
    told = state_from_text(text, start(state.block))
    assert told.ever == frozenset(ever)
    assert told.pointed == (pointed or {})
    return told.state


def check_same(one: SessionState, other: SessionState) -> None:
    """Equal also in what equality leaves out."""
    assert one == other
    assert one.last_change == other.last_change


def pointed_in(events: Iterable[Event], states: list[SessionState]) -> Counter[Target]:
    """How often what was pointed at, counted beside the fold."""
    pairs = zip(events, states[1:], strict=True)
    targets = (pointed_at(event, state.current) for event, state in pairs)
    return Counter(target for target in targets if target is not None)


@given(drafts)
def test_a_state_is_read_back_equal(steps: list[Draft]) -> None:
    events, states = played(steps)
    pointed = pointed_in(events, states)
    check_same(read_back(states[-1], accepted_ever(events), pointed), states[-1])
    assert not read_back(states[-1]).may_undo


@given(drafts)
def test_equal_states_have_the_same_text(steps: list[Draft]) -> None:
    events, states = played(steps)
    ever, pointed = accepted_ever(events), pointed_in(events, states)
    writer = StateWriter()
    for state in states[::7]:  # what it knows from earlier states changes nothing
        writer.text(state, ever, pointed)
    text = writer.text(states[-1], ever, pointed)
    other = copy.deepcopy(states[-1].models)  # equal models that are other objects
    assert StateWriter().text(replace(states[-1], models=other), ever, pointed) == text
    assert StateWriter().text(read_back(states[-1], ever, pointed), ever, pointed) == text


@given(drafts, st.integers(0, 120))
def test_what_happens_behind_a_snapshot_leads_where_the_whole_fold_does(
    steps: list[Draft], at: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(state_module, "HISTORY", UNDO)
        events, states = played(steps)
        at = min(at, len(events))
        try:
            behind, full = read_back(states[at]), False
            for event in events[at:]:
                behind = apply(behind, event)
                full = full or behind.undo_is_full
        except EventRefusedError:
            return  # an undo reaches before the snapshot: it is passed over
        check_same(behind, states[-1])
        if full:
            assert behind._history == states[-1]._history


def _fiducials(kind: int, number: int, flag: bool) -> test_inner_rules.Draft:
    return test_inner_rules.Draft(kind, number, flag)


def _photos(kind: int, number: int, flag: bool) -> test_mono_fold.Draft:
    return test_mono_fold.Draft(kind, number, "left" if flag else "right")


@given(
    st.sampled_from(((test_inner_rules.SCENE, _fiducials), (test_mono_fold.SCENE, _photos))),
    st.lists(st.tuples(st.integers(0, 12), st.integers(0, 40), st.booleans()), max_size=100),
)
def test_so_are_fiducials_and_models_of_one_photo_after_the_other(
    made: tuple[Scene, Callable[[int, int, bool], Draft]], steps: list[tuple[int, int, bool]]
) -> None:
    scene, draft = made
    state = scene.start
    for step in steps:
        with suppress(EventRefusedError):
            state = apply(state, draft(*step).event(state))
    check_same(read_back(state), state)


def test_so_are_accepted_everner_orientations() -> None:
    scene = test_inner_rules.SCENE
    state = scene.whole(scene.chosen(2))
    assert state.current is not None
    assert all(inner.accepted for model in (*state.models, state.current) for inner in model.inner)
    check_same(read_back(state), state)


def test_models_returned_to_and_mono_ones_are_read_back_equal() -> None:
    for state in (three(), mono()):
        models = state.models
        assert models
        back = apply(state, ModelReopened(*models[0].photos))
        check_same(read_back(back), back)
        off = apply(back, RowSwitched(models[0].measured[0].point, None, on=False))
        check_same(read_back(off), off)
        given_ = apply(off, ReasonGiven("pointing"))
        check_same(read_back(given_), given_)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", "null", "[[],[1],null,false,0,null,null,[],[],null,[],[]]"]
)
def test_what_is_no_state_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="snapshot"):
        state_from_text(text, Scene(3).start)


def test_models_that_do_not_fit_the_block_are_refused() -> None:
    state = three()
    first = state.models[0]
    for wrong in (
        replace(first, strip="9"),
        replace(first, left="999"),
        replace(first, left=first.right, right=first.left),
        replace(first, plan=first.plan[1:]),
    ):
        with pytest.raises(InputError, match="does not fit the block"):
            read_back(replace(state, models=(wrong, *state.models[1:])))


def two_strips() -> SessionState:
    """Three models of a strip and one of another, of which the first is accepted anew."""
    begun = second_strip_begun(flown(1))
    assert begun.current is not None
    state = replace(begun, models=(*begun.models, begun.current), current=None)
    first = state.models[0]
    state = apply(state, ModelReopened(*first.photos))
    state = apply(state, RowSwitched(first.measured[0].point, "y", on=False))
    return apply(state, ModelAccepted(*first.photos))


def test_a_model_computed_anew_stands_with_those_of_its_strip_as_they_were() -> None:
    before = second_strip_begun(flown(1)).models
    state = two_strips()
    assert [one.photos for one in state.recomputed] == [m.photos for m in before[1:]]
    assert all(one.models == before for one in state.recomputed)
    check_same(read_back(state), state)
    numbers = json.loads(StateWriter().text(state, (), {}))[7]
    assert [len(listed) for _, listed in numbers] == [3, 3]


def test_so_it_is_read_where_a_text_has_all_models_of_the_block() -> None:
    state = two_strips()
    before = second_strip_begun(flown(1)).models
    every = tuple(AsAccepted(one.photos, (*before, state.models[-1])) for one in state.recomputed)
    check_same(read_back(replace(state, recomputed=every)), state)


def test_a_model_stands_once_in_a_text_whichever_object_it_is(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    models = day.state.models
    state = replace(day.state, recomputed=(AsAccepted(models[1].photos, models),))
    other = replace(state, models=copy.deepcopy(models))
    assert other == state
    assert StateWriter().text(other, (), {}) == StateWriter().text(state, (), {})


def open_session(folder: Path, block: Block, header: dict[str, object]) -> tuple[Journal, Past]:
    """Open a block's journal as a station does."""
    reading = PastReading(folder, block)
    journal, recovered = Journal.open(
        folder,
        header,
        keep=lambda kind: kind in EVENT_KINDS,
        choose=choice_for(block),
        begin=reading.begin,
    )
    try:
        assert recovered.records == ()
        return journal, reading.past()
    except BaseException:
        journal.close()
        raise


class Day:
    """A block of which three models are measured, switched in and returned to."""

    def __init__(self, folder: Path, roll_bytes: int = 64_000_000) -> None:
        scene = Scene(4)
        self.folder = folder
        write_new_block(folder, scene.block)
        self.block = read_block(folder)
        self.state = start(self.block)
        self.count = 0
        self.pointed: Counter[Target] = Counter()
        self.journal = Journal.open(folder, {}, roll_bytes=roll_bytes)[0]
        past = Past(0, 0, self.state, frozenset())
        self.snapshots = Snapshots(self.journal, self.block, past)
        for k in range(3):
            self.happen(scene.choice(self.state, k))
            for event in scene.measurements(self.state):
                self.happen(event)
            self.happen(ModelAccepted(*self.block.strips[0].models()[k]))
        first = self.state.models[0]
        for _ in range(3):
            self.happen(ModelReopened(*first.photos))
            for point in first.plan[:2]:
                self.happen(RowSwitched(point.point, None, on=False))
                self.happen(RowSwitched(point.point, None, on=True))
            self.happen(ReasonGiven("pointing"))
            self.happen(ModelAccepted(*first.photos))
        self.happen(Undone())

    def happen(self, event: Event) -> None:
        self.journal.append(event.kind, event_to_payload(event), durable=True)
        self.state = apply(self.state, event)
        self.count += 1
        target = pointed_at(event, self.state.current)
        if target is not None:
            self.pointed[target] += 1
        self.snapshots.happened([event], self.state)

    @property
    def last(self) -> Path:
        return max((self.folder / "sessions").glob("*.jsonl"))

    def check(self, *, by_snapshot: bool) -> None:
        """Open it: the state is that of the fold, by a snapshot or without."""
        journal, past = open_session(self.folder, self.block, {})
        journal.close()
        records = read_journal(self.folder, keep=lambda kind: kind in EVENT_KINDS).records
        events = events_of(records)
        state = fold(start(self.block), events)
        assert past.state == state == self.state
        assert past.state.last_change == state.last_change
        assert past.state._history == state._history
        assert past.of_session == accepted_ever(events)
        assert past.pointed == self.pointed
        assert past.count == len(events) == self.count
        assert (past.folded < len(events)) is by_snapshot


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Snapshots come often, and little may be undone."""
    monkeypatch.setattr(state_module, "HISTORY", UNDO)
    monkeypatch.setattr(restored_module, "SPACING", 7)
    monkeypatch.setattr(restored_module, "_BEHIND", 14)
    monkeypatch.setattr(restored_module, "_AT_ONCE", 5)


OFTEN = pytest.mark.usefixtures("often")


@pytest.mark.slow
@OFTEN
def test_opening_begins_at_a_snapshot(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    day.check(by_snapshot=True)
    day.check(by_snapshot=True)  # also behind the record of the first opening
    assert replay_session(day.folder).differences == ()


@OFTEN
def test_work_goes_on_behind_it(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    day.journal, past = open_session(day.folder, day.block, {})
    day.snapshots = Snapshots(day.journal, day.block, past)
    while day.state.may_undo:
        day.happen(Undone())
    day.journal.close()
    day.check(by_snapshot=True)


@OFTEN
def test_files_before_the_last_count_too(tmp_path: Path) -> None:
    day = Day(tmp_path / "b", roll_bytes=12_000)
    day.journal.close()
    files = sorted((day.folder / "sessions").glob("*.jsonl"))
    assert len(files) > 1
    journal, past = open_session(day.folder, day.block, {})
    journal.close()
    assert past.state == day.state
    data = files[0].read_bytes()
    files[0].write_bytes(data.replace(b'"tie"', b'"tia"').replace(b'"new"', b'"nev"', 1))
    with pytest.raises(InputError, match=r"0001.jsonl line \d+: damaged"):
        open_session(day.folder, day.block, {})


@OFTEN
def test_opening_begins_at_a_snapshot_of_an_earlier_file_where_the_last_has_none(
    tmp_path: Path,
) -> None:
    day = Day(tmp_path / "b", roll_bytes=2_500)
    while day.state.may_undo:
        day.happen(Undone())
    day.journal.close()
    files = sorted((day.folder / "sessions").glob("*.jsonl"))
    assert b'"kind":"snapshot"' not in files[-1].read_bytes()
    day.check(by_snapshot=True)
    # damage is refused before it and behind it, in every file
    for file in (files[0], files[-1]):
        data = file.read_bytes()
        file.write_bytes(data.replace(b'"kind"', b'"kinq"', 1))
        with pytest.raises(InputError, match=file.name):
            open_session(day.folder, day.block, {})
        file.write_bytes(data)
    day.check(by_snapshot=True)


@OFTEN
def test_every_file_is_summed_once_and_only_for_snapshots_of_this_form(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    day = Day(tmp_path / "b", roll_bytes=2_500)
    day.journal.close()
    files = sorted((day.folder / "sessions").glob("*.jsonl"))
    with_some = [k for k, f in enumerate(files) if b'"kind":"snapshot",' in f.read_bytes()]
    summed: list[Path] = []
    usual = journalsnapshot._summed

    def counted(path: Path, max_bytes: int) -> list[int]:
        summed.append(path)
        return usual(path, max_bytes)

    monkeypatch.setattr(journalsnapshot, "_summed", counted)
    assert len(list(snapshots_of(files, MAX_FILE_BYTES))) >= len(with_some) > 1
    assert summed == files[: with_some[-1]]
    summed.clear()
    monkeypatch.setattr(journalsnapshot, "VERSIONS", (journalsnapshot.VERSION + 1,))
    assert list(snapshots_of(files, MAX_FILE_BYTES)) == []
    assert summed == []


def test_snapshots_of_many_models_are_farther_apart() -> None:
    class Counting:
        counts: ClassVar[list[int]] = []

        def append_snapshot(self, text: str, block: str, events: int) -> None:
            self.counts.append(events)

    state = three()
    many = replace(state, models=(state.models * 900)[:900])
    accepted = [ModelAccepted(*state.models[0].photos)] * 100
    for at_work, expected in ((state, [600, 1200, 1800]), (many, [900, 1800])):
        Counting.counts.clear()
        past = Past(0, 100, at_work, frozenset())
        snapshots = Snapshots(cast("Journal", Counting()), state.block, past)
        for _ in range(17):
            snapshots.happened(accepted, at_work)
        assert Counting.counts == expected


@OFTEN
def test_a_snapshot_of_the_version_before_serves(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(journalsnapshot, "VERSION", 3)
        day = Day(tmp_path / "b")
        day.journal.close()
    assert b'"version":3' in day.last.read_bytes()
    assert len(list(snapshots_of([day.last], MAX_FILE_BYTES))) > 3
    assert replay_session(day.folder).differences == ()


@OFTEN
def test_damage_before_a_snapshot_is_refused_as_ever(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    data = day.last.read_bytes()
    day.last.write_bytes(data.replace(b'"new"', b'"nev"', 1))
    with pytest.raises(InputError, match="damaged: the checksum does not agree"):
        open_session(day.folder, day.block, {})


@OFTEN
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'"version":4', b'"version":2'),
        (b'"version":4', b'"version":5'),
        (b'"format":1', b'"format":2'),
        (b'"parts":1', b'"parts":2'),
        (b'"part_bytes":', b'"part_bytes":1'),
        (b'"events":', b'"events":-'),
        (b'"before":[[', b'"before":[[1'),
        (b'"before":[[', b'"before":[[3,4],['),
    ],
)
def test_what_is_not_understood_is_passed_over(tmp_path: Path, old: bytes, new: bytes) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    trusted = list(snapshots_of([day.last], MAX_FILE_BYTES))
    data = day.last.read_bytes()
    begin = data.rindex(b"\n", 0, data.rindex(b'"kind":"snapshot",')) + 1
    end = data.index(b"\n", begin)
    body = data[begin : data.rindex(b',"crc"', begin, end)].replace(old, new)
    day.last.write_bytes(data[:begin] + body + b',"crc":"%08x"}' % zlib.crc32(body) + data[end:])
    assert len(trusted) > 3
    assert list(snapshots_of([day.last], MAX_FILE_BYTES)) == trusted[1:]
    day.check(by_snapshot=True)


@OFTEN
def test_a_cut_anywhere_in_a_snapshot_leaves_the_events(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    data = day.last.read_bytes()
    at = data.rindex(b'"kind":"snapshot-part"')
    begin = data.rindex(b"\n", 0, at) + 1
    end = data.index(b"\n", data.rindex(b'"kind":"snapshot",')) + 1
    middle = data.index(b"\n", begin) + 1
    for cut in (begin, begin + 100, middle, middle + 50, end - 1, end):
        day.last.write_bytes(data[:cut])
        records = read_journal(day.folder, keep=lambda kind: kind in EVENT_KINDS).records
        state = fold(start(day.block), events_of(records))
        journal, past = open_session(day.folder, day.block, {})
        journal.close()
        assert past.state == state
        assert past.state._history == state._history


@OFTEN
def test_a_snapshot_that_says_otherwise_is_told_by_a_replay(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    wrong = replace(day.state, layings=day.state.layings + 1)
    text = StateWriter().text(wrong, frozenset(), {})
    day.journal.append_snapshot(text, "x", day.count)
    day.journal.close()
    [difference] = replay_session(day.folder).differences
    assert "the snapshot says otherwise" in str(difference)


@OFTEN
@OFTEN
def test_a_replay_reads_no_snapshot_that_says_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    assert b'"kind":"snapshot"' in day.last.read_bytes()
    asked: list[str] = []

    def counted(text: str, state: SessionState) -> Told:
        asked.append(text)
        return state_from_text(text, state)

    monkeypatch.setattr(snapshotcheck, "state_from_text", counted)
    assert replay_session(day.folder).differences == ()
    assert asked == []
    # one that says the same in another way does not differ
    monkeypatch.setattr(snapshotcheck.StateWriter, "text", lambda *_: "")
    assert replay_session(day.folder).differences == ()
    assert len(asked) > 0


def test_another_block_than_that_of_the_snapshot_is_folded(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    other: Block = replace(day.block, name="another")
    journal, past = open_session(day.folder, other, {})
    journal.close()
    assert past.count == past.folded


@OFTEN
def test_salvage_brings_over_the_events_alone(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    (tmp_path / "new").mkdir()
    salvaged = salvage(day.folder, tmp_path / "new")
    assert salvaged.state == day.state
    assert salvaged.left_out == ()
    kinds = {record.kind for record in read_journal(tmp_path / "new").records}
    assert not kinds & {"snapshot", "snapshot-part"}


@OFTEN
def test_a_snapshot_that_is_refused_is_no_loss(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise JournalError("no space")

    monkeypatch.setattr(Journal, "append_snapshot", refused)
    day = Day(tmp_path / "b")
    day.journal.close()
    day.check(by_snapshot=False)


def test_without_enough_to_undo_everything_is_folded(tmp_path: Path) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    day.check(by_snapshot=False)


@OFTEN
def test_a_station_that_begins_at_a_snapshot_stands_where_another_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    day = Day(tmp_path / "b")
    day.journal.close()
    seen = []
    for behind in (14, 1_000_000):
        monkeypatch.setattr(restored_module, "_BEHIND", behind)
        station = Station(day.folder)
        seen.append((station.state, station.state._history, replace(station.snapshot(), serial=0)))
        station.close()
        seen.append((day.folder / "image_points.csv").read_bytes())
    assert seen[:2] == seen[2:]
    assert seen[0][0] == day.state
