"""A journal that is read again while it goes on: what was added, and what a reading anew finds."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from journaltools import lines_decoded, wait_for_no_disk

from anaplot.errors import InputError
from anaplot.exchange import journalread
from anaplot.exchange.journal import Journal, read_journal
from anaplot.exchange.journalfollowed import FollowedJournal
from anaplot.exchange.recordline import JournalRecord
from anaplot.station.sessionlog import SessionLog

SESSIONS = Path(__file__).parents[1] / "sessions"


@pytest.fixture(autouse=True)
def no_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    wait_for_no_disk(monkeypatch)


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the lines that are read from now on."""
    return lines_decoded(monkeypatch, journalread)


class Following:
    """A journal that is followed, beside one reading of it at once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.journal = FollowedJournal(path, lambda kind: True)
        self.records: list[JournalRecord] = []

    def check(self, *, goes_on: bool) -> None:
        assert self.journal.goes_on() is goes_on
        if not goes_on:
            self.records = []
        remarks = self.journal.read(self.records.append)
        at_once = read_journal(self.path)
        assert tuple(self.records) == at_once.records
        assert remarks == at_once.remarks


def test_only_what_was_added_is_read(tmp_path: Path, decoded: list[int]) -> None:
    taken: list[JournalRecord] = []
    followed = FollowedJournal(tmp_path, lambda kind: True)
    with Journal.open(tmp_path, {}, roll_bytes=700)[0] as journal:
        for number in range(3):
            journal.append("point", {"n": number}, durable=False)
        followed.read(taken.append)
        assert decoded == [1, 2, 3, 4]
        decoded.clear()
        assert followed.goes_on()
        assert followed.read(taken.append) == ()
        assert decoded == []
        for number in range(3, 9):
            journal.append("point", {"n": number}, durable=False)
        assert journal.path.name == "0002.jsonl"
        assert followed.goes_on()
        followed.read(taken.append)
        assert len(decoded) == 7  # and the second file's header
        assert [r.payload["n"] for r in taken if r.kind == "point"] == list(range(9))
        assert tuple(taken) == read_journal(tmp_path).records


def test_what_is_torn_is_read_when_it_is_whole(tmp_path: Path) -> None:
    with Journal.open(tmp_path, {})[0] as journal:
        journal.append("point", {"n": 1}, durable=False)
    file = tmp_path / "sessions" / "0001.jsonl"
    data = file.read_bytes()
    for path in (tmp_path, file):
        file.write_bytes(data[:-20])
        following = Following(path)
        following.check(goes_on=False)
        file.write_bytes(data[:-1])  # the end of its line alone is missing
        following.check(goes_on=True)
        file.write_bytes(data)
        following.check(goes_on=False)
        following.check(goes_on=True)


def test_what_another_has_taken_the_place_of_is_read_from_its_beginning(tmp_path: Path) -> None:
    def append(path: Path, count: int) -> None:
        with Journal.open(path, {}, roll_bytes=1500)[0] as journal:
            for number in range(count):
                journal.append("point", {"n": number}, durable=False)

    block = tmp_path / "b"
    for path in (block, tmp_path / "other"):
        path.mkdir()
        append(path, 30)
    first, second = (block / "sessions" / f"{number:04d}.jsonl" for number in (1, 2))
    following = Following(block)
    following.check(goes_on=False)
    following.check(goes_on=True)
    (tmp_path / "other" / "sessions" / first.name).replace(first)
    following.check(goes_on=False)
    append(block, 2)
    following.check(goes_on=True)
    last = max((block / "sessions").glob("*.jsonl"))
    lines = last.read_bytes().splitlines(keepends=True)
    last.write_bytes(b"".join(lines[:-1]))
    following.check(goes_on=False)
    second.unlink()
    assert not following.journal.goes_on()
    with pytest.raises(InputError, match=r"0002\.jsonl"):
        following.journal.read(following.records.append)


def outcome(log: SessionLog) -> tuple[object, ...]:
    """What a reading tells: changes and remarks, or what is wrong."""
    try:
        changes = log.read()
    except InputError as error:
        return (str(error),)
    return (*map(repr, changes), log.remarks, log.inner, log.state)


@pytest.mark.parametrize("name", ["changes", "torn-tail"])
def test_a_log_read_in_pieces_says_what_it_says_at_once(tmp_path: Path, name: str) -> None:
    data = (SESSIONS / f"{name}.jsonl").read_bytes()
    chance = random.Random(name)
    for damaged in (False, True, True):
        file = tmp_path / f"{name}.jsonl"
        file.unlink(missing_ok=True)
        now = bytearray(data)
        if damaged:
            now[chance.randrange(len(now))] ^= 1 << chance.randrange(8)
        log = SessionLog(file)
        for cut in [*sorted(chance.sample(range(len(now)), 9)), len(now), len(now)]:
            file.write_bytes(now[:cut])
            assert outcome(log) == outcome(SessionLog(file))
