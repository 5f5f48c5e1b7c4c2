"""The records of a journal that are read from the disk one by one."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest
from journaltools import PLAIN, append_event, lines_decoded, wait_for_no_disk

from anaplot.errors import InputError
from anaplot.exchange import journalstored
from anaplot.exchange.journal import Journal, read_journal
from anaplot.exchange.journalkinds import is_known
from anaplot.exchange.journalstored import StoredRecords
from anaplot.session.events import ModelChosen, PlannedPoint, PointMeasured
from anaplot.station.replay import recorded_block, replay, replay_session

SESSIONS = Path(__file__).parents[1] / "sessions"


@pytest.fixture(autouse=True)
def no_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    wait_for_no_disk(monkeypatch)


def known(kind: str) -> bool:
    return True


def test_they_are_those_of_the_journal(tmp_path: Path) -> None:
    for _ in range(2):
        with Journal.open(tmp_path, {}, roll_bytes=900)[0] as journal:
            for number in range(9):
                journal.append("point", {"n": number}, durable=False)
    sessions = tmp_path / "sessions"
    last = max(sessions.glob("*.jsonl"))
    assert last.name > "0001.jsonl"
    (sessions / "x.jsonl").touch()
    whole = last.read_bytes()
    for end in (whole, whole[:-1], whole[:-9], whole + b'{"seq":', b""):
        last.write_bytes(end)
        stored, at_once = StoredRecords(tmp_path, known), read_journal(tmp_path)
        for _ in range(2):
            assert tuple(stored) == at_once.records
        assert len(stored) == len(at_once.records)
        assert stored.remarks == at_once.remarks
        kinds = ("header", "opened")
        assert tuple(stored.openings) == tuple(r for r in at_once.records if r.kind in kinds)


def test_what_is_added_meanwhile_is_none_of_them_and_a_change_is_told(tmp_path: Path) -> None:
    with Journal.open(tmp_path, {})[0] as journal:
        journal.append("point", {"n": 1}, durable=False)
        stored = StoredRecords(tmp_path, known)
        journal.append("point", {"n": 2}, durable=False)
        assert [record.seq for record in stored] == [1, 2]
    file = tmp_path / "sessions" / "0001.jsonl"
    file.write_bytes(file.read_bytes().replace(b'"n":1', b'"n":7'))
    with pytest.raises(InputError, match=r"0001\.jsonl line 2: changed while it was read"):
        list(stored)
    file.unlink()
    with pytest.raises(InputError, match=r"0001\.jsonl: file not found"):
        list(stored)


def test_a_replay_reads_as_far_as_it_is_played(monkeypatch: pytest.MonkeyPatch) -> None:
    session = SESSIONS / "changes.jsonl"
    stored = StoredRecords(session, is_known)
    lines = lines_decoded(monkeypatch, journalstored)
    steps = replay(recorded_block(session, stored.openings), stored)
    for number in range(1, 6):
        assert next(steps).record.line == number
        assert lines == list(range(1, number + 1))


def test_a_replay_keeps_no_records(tmp_path: Path) -> None:
    (tmp_path / "block.toml").write_text(PLAIN)
    plan = (PlannedPoint("p", "new", 1.0, 2.0, -91.0, 2.0),)
    with Journal.open(tmp_path, {})[0] as journal:
        append_event(journal, ModelChosen("1", "1", "2", plan))
        for number in range(40):
            journal.append("refused", {"why": f"{number:100000d}"}, durable=False)
        append_event(journal, PointMeasured("1", "2", "p", 1.0, 2.0, -91.0, 2.0, "key"))
    said = replay_session(tmp_path)  # what is loaded and remembered is there then
    tracemalloc.start()
    try:
        assert replay_session(tmp_path).state == said.state
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2_000_000 < 40 * 100_000
