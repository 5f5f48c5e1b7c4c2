"""The journal as it is written: lines, sequence, locking, full and failing disks."""

from __future__ import annotations

import errno
import json
import os
import platform
import re
import threading
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from journaltools import append_event, events_of

import anaplot
from anaplot.errors import InputError
from anaplot.exchange import recordline
from anaplot.exchange.journal import Journal, JournalError, read_journal
from anaplot.session.events import PointMeasured, RowSwitched, Undone

HEADER = {"block": "demo", "profile": "simulated", "sha256": "ab", "operator": "me", "link": {}}


@pytest.fixture
def block(tmp_path: Path) -> Path:
    folder = tmp_path / "block"
    folder.mkdir()
    return folder


def lines(block: Path, name: str = "0001.jsonl") -> list[dict]:
    text = (block / "sessions" / name).read_bytes()
    assert text.endswith(b"\n")
    return [json.loads(line) for line in text.splitlines()]


def measured(n: int) -> PointMeasured:
    return PointMeasured("101", "102", str(n), 0.1 * n, -92.0, 1.0 / 3.0, 4.0, "pedal")


def test_a_record_is_shown_without_what_a_device_said():
    line = recordline.encode_line(7, "2026-01-02T03:04:05.678Z", "raw", {"bytes": "secret"})
    record, _ = recordline.decode_line(line.rstrip(b"\n"), "0001.jsonl", 3)
    assert record.payload == {"bytes": "secret"}
    assert repr(record) == f"<JournalRecord 7 'raw' of '{record.time}', '0001.jsonl:3'>"


def test_a_new_journal_begins_with_its_header(block):
    journal, recovered = Journal.open(block, HEADER, clock=lambda: 1_000_000_000.1239)
    with journal:
        assert (recovered.records, recovered.remarks) == ((), ())
        assert journal.path == block / "sessions" / "0001.jsonl"
        assert journal.seq == 1
    (header,) = lines(block)
    assert re.fullmatch("[0-9a-f]{8}", header.pop("crc"))
    assert header == {
        "seq": 1,
        "t": "2001-09-09T01:46:40.123Z",
        "kind": "header",
        "durable": True,
        "program": "anaplot",
        "version": anaplot.__version__,
        "format": 1,
        **HEADER,
    }


def test_every_line_carries_sequence_number_and_checksum(block):
    with Journal.open(block, HEADER)[0] as journal:
        assert journal.append("traffic", {"in": "\x1b[2J\x7fé\u202e"}, durable=False) == 2
        assert journal.append_many([("a", {"n": 1}), ("b", {"n": 2})], durable=True) == 4
        assert journal.append_many([], durable=True) == 4
        assert append_event(journal, measured(7)) == 5
    raw = (block / "sessions" / "0001.jsonl").read_bytes()
    assert all(32 <= byte < 127 or byte == 10 for byte in raw)
    flags = [json.loads(line)["durable"] for line in raw.splitlines()]
    assert flags == [True, False, False, True, True]
    for number, line in enumerate(raw.splitlines(), start=1):
        body, crc = line.split(b',"crc":')
        assert crc == b'"%08x"}' % zlib.crc32(body)
        assert list(json.loads(line))[:3] == ["seq", "t", "kind"]
        assert json.loads(line)["seq"] == number
    records = read_journal(block).records
    assert [record.kind for record in records] == ["header", "traffic", "a", "b", "point-measured"]
    assert [record.seq for record in records] == [record.line for record in records]
    assert records[1].payload == {"in": "\x1b[2J\x7fé\u202e"}
    assert events_of(records) == (measured(7),)


def test_opened_again_it_goes_on_in_the_same_file(block):
    written = [measured(1), RowSwitched("1", "y", False), Undone()]
    for event in written:
        with Journal.open(block, HEADER)[0] as journal:
            append_event(journal, event)
    journal, recovered = Journal.open(block, {"operator": "you"})
    journal.close()
    assert recovered.remarks == ()
    assert events_of(recovered.records) == tuple(written)
    kinds = [line["kind"] for line in lines(block)]
    assert kinds[:4] == ["header", "point-measured", "opened", "row-switched"]
    assert kinds[4:] == ["opened", "undone", "opened"]
    assert lines(block)[-1]["operator"] == "you"
    assert lines(block)[-1]["format"] == 1
    assert [line["seq"] for line in lines(block)] == [1, 2, 3, 4, 5, 6, 7]


def test_the_sequence_runs_on_through_the_files(block):
    with Journal.open(block, HEADER, roll_bytes=600)[0] as journal:
        for n in range(20):
            append_event(journal, measured(n), durable=False)
        last = journal.path
    names = sorted(path.name for path in (block / "sessions").glob("*.jsonl"))
    assert names == [f"{n:04d}.jsonl" for n in range(1, len(names) + 1)]
    assert len(names) > 3
    assert last.name == names[-1]
    seqs = [line["seq"] for name in names for line in lines(block, name)]
    assert seqs == list(range(1, len(seqs) + 1))
    assert {lines(block, name)[0]["kind"] for name in names} == {"header"}
    # in the midst of a session, but for the first
    goes_on = [lines(block, name)[0].get("goes_on", False) for name in names]
    assert goes_on == [False] + [True] * (len(names) - 1)
    assert events_of(read_journal(block).records) == tuple(measured(n) for n in range(20))
    assert read_journal(block / "sessions") == read_journal(block)
    single = read_journal(block / "sessions" / names[2])
    assert single.records[0].kind == "header"
    assert [record.seq for record in single.records] == [r["seq"] for r in lines(block, names[2])]
    journal, recovered = Journal.open(block, HEADER, roll_bytes=1)
    with journal:
        assert len(events_of(recovered.records)) == 20
        assert int(journal.path.stem) == len(names) + 1
        assert "goes_on" not in lines(block, journal.path.name)[0]


def test_only_the_wanted_kinds_are_kept(block):
    with Journal.open(block, HEADER)[0] as journal:
        journal.append("traffic", {"in": "00"}, durable=False)
        append_event(journal, measured(1))
    assert [r.kind for r in read_journal(block, keep=lambda k: k == "traffic").records] == [
        "traffic"
    ]
    journal, recovered = Journal.open(block, HEADER, keep=lambda kind: kind == "point-measured")
    journal.close()
    assert events_of(recovered.records) == (measured(1),)


def test_a_clock_that_jumps_back_is_written_as_it_is(block):
    times = iter([2e9, 1e9, 1.5e9])
    with Journal.open(block, HEADER, clock=lambda: next(times))[0] as journal:
        journal.append("a", {}, durable=True)
        journal.append("b", {}, durable=True)
    records = read_journal(block).records
    assert [record.time[:4] for record in records] == ["2033", "2001", "2017"]
    assert [record.seq for record in records] == [1, 2, 3]


def test_a_clock_that_makes_no_sense_refuses_the_record(block):
    clock = [1e9]
    with Journal.open(block, HEADER, clock=lambda: clock[0])[0] as journal:
        clock[0] = 1e30
        with pytest.raises(JournalError, match="the clock is wrong"):
            journal.append("a", {}, durable=True)
        clock[0] = 1e9
        assert journal.append("b", {}, durable=True) == 2


@pytest.mark.parametrize(
    ("kind", "payload", "words"),
    [
        ("Bad Kind", {}, "bad kind"),
        ("", {}, "bad kind"),
        ("a" * 41, {}, "bad kind"),
        ("a", {"seq": 1}, "bad key 'seq'"),
        ("a", {"crc": "x"}, "bad key 'crc'"),
        ("a", {"durable": True}, "bad key 'durable'"),
        ("a", {1: "x"}, "bad key '1'"),
        ("a", {"x": float("nan")}, "refused"),
        ("a", {"x": b"bytes"}, "refused"),
        ("a", {"x": "y" * 1_000_000}, "more than 1000000"),
    ],
)
def test_a_record_that_is_none_is_refused(block, kind, payload, words):
    with Journal.open(block, HEADER)[0] as journal:
        with pytest.raises(JournalError, match=words):
            journal.append(kind, payload, durable=True)
        with pytest.raises(JournalError, match=words):
            journal.append_many([("good", {}), (kind, payload)], durable=True)
        assert journal.append("a", {}, durable=True) == 2
    assert [line["kind"] for line in lines(block)] == ["header", "a"]


def test_the_longest_line_is_written_and_read(block):
    with Journal.open(block, HEADER)[0] as journal:
        journal.append("a", {"x": ""}, durable=False)
        empty = len((block / "sessions" / "0001.jsonl").read_bytes().splitlines()[1]) + 1
        text = "y" * (recordline.MAX_LINE - empty)
        assert journal.append("a", {"x": text}, durable=True) == 3
        with pytest.raises(JournalError):
            journal.append("a", {"x": text + "y"}, durable=False)
        journal.append("b", {}, durable=True)
    assert read_journal(block).records[2].payload == {"x": text}
    assert len(read_journal(block).records) == 4


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=10),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)
payloads = st.dictionaries(
    st.text(max_size=6).filter(lambda key: key not in ("seq", "t", "kind", "durable", "crc")),
    json_values,
    max_size=4,
)


@given(st.integers(1, 10**15 - 1), payloads, st.sampled_from([None, True, False]))
def test_a_line_is_read_back_exactly(seq, payload, durable):
    line = recordline.encode_line(seq, "2026-01-01T00:00:00.000Z", "a-1", payload, durable)
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    record, wanted = recordline.decode_line(line[:-1], "f", 3)
    assert wanted
    assert record == recordline.JournalRecord(
        seq, "2026-01-01T00:00:00.000Z", "a-1", payload, "f", 3, durable
    )


@given(payloads, st.data())
def test_a_line_changed_anywhere_is_not_taken(payload, data):
    line = recordline.encode_line(12, "2026-01-01T00:00:00.000Z", "a", payload)[:-1]
    at = data.draw(st.integers(0, len(line) - 1))
    bit = data.draw(st.integers(0, 7))
    flipped = bytearray(line)
    flipped[at] ^= 1 << bit
    for changed in (bytes(flipped), line[:at], line[:at] + line[at + 1 :]):
        with pytest.raises(recordline.DamagedLineError):
            recordline.decode_line(changed, "f", 1)


# -- refused ---------------------------------------------------------------------------------


def test_a_second_journal_on_the_block_is_refused_until_the_first_is_closed(block):
    first, _ = Journal.open(block, HEADER)
    with pytest.raises(InputError) as caught:
        Journal.open(block, HEADER)
    assert str(caught.value) == (
        f"{block}: the block is open in another anaplot "
        f"(process {os.getpid()} on {platform.node()})"
    )
    assert first.append("a", {}, durable=True) == 2
    assert len(read_journal(block).records) == 2
    first.close()
    first.close()
    second, recovered = Journal.open(block, HEADER)
    second.close()
    assert len(recovered.records) == 2


def test_a_closed_journal_refuses(block):
    journal, _ = Journal.open(block, HEADER)
    journal.close()
    with pytest.raises(JournalError, match="closed"):
        journal.append("a", {}, durable=True)
    with pytest.raises(JournalError, match="closed"):
        assert journal.seq


def test_the_keys_of_the_header_are_the_journals_own(block):
    for header in ({"format": 2}, {"seq": 1}, {"x": float("nan")}):
        with pytest.raises(JournalError):
            Journal.open(block, header)
    journal, _ = Journal.open(block, HEADER)
    journal.close()
    assert [line["kind"] for line in lines(block)] == ["header"]


def test_a_block_that_is_not_there_or_not_writable(block, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="sessions: cannot be made: No such file"):
        Journal.open(tmp_path / "nowhere", HEADER)
    with pytest.raises(InputError, match=r"cannot be made|cannot be read"):
        Journal.open(Path("a\0b"), HEADER)
    (block / "sessions").write_text("")
    with pytest.raises(InputError, match="sessions: not a folder of its own"):
        Journal.open(block, HEADER)
    (block / "sessions").unlink()
    read_only = OSError(errno.EROFS, os.strerror(errno.EROFS))

    def refuse(*_: object, **__: object) -> int:
        raise read_only

    with monkeypatch.context() as patch:
        patch.setattr(os, "mkdir", refuse)
        with pytest.raises(InputError, match="sessions: cannot be made: Read-only file system"):
            Journal.open(block, HEADER)
    Journal.open(block, HEADER)[0].close()
    before = (block / "sessions" / "0001.jsonl").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(os, "open", refuse)
        with pytest.raises(InputError, match="lock: cannot be written: Read-only file system"):
            Journal.open(block, HEADER)
    assert (block / "sessions" / "0001.jsonl").read_bytes() == before


def test_there_is_no_journal_to_read(block, tmp_path):
    with pytest.raises(InputError, match="nowhere: no such journal"):
        read_journal(tmp_path / "nowhere")
    with pytest.raises(InputError, match="holds no journal"):
        read_journal(block)
    with pytest.raises(InputError, match=r"cannot be read|no such journal"):
        read_journal(Path("a\0b"))


# -- disks that fail -------------------------------------------------------------------------


class Disk:
    """System calls that fail when they are told to."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.write_room: int | None = None
        self.sync_error = 0
        self.cut_error = 0
        self.interrupt = False
        self._write, self._cut = os.write, os.ftruncate
        self._sync = getattr(os, "fdatasync", os.fsync)
        patch.setattr(os, "write", self.write)
        patch.setattr(os, "fdatasync", self.sync, raising=False)
        patch.setattr(os, "ftruncate", self.cut)

    def write(self, descriptor: int, data: bytes) -> int:
        if self.write_room is None:
            return self._write(descriptor, data)
        if self.write_room == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = self._write(descriptor, data[: self.write_room])
        self.write_room -= written
        return written

    def sync(self, descriptor: int) -> None:
        if self.interrupt:
            raise KeyboardInterrupt
        if self.sync_error:
            raise OSError(self.sync_error, os.strerror(self.sync_error))
        self._sync(descriptor)

    def cut(self, descriptor: int, length: int) -> None:
        if self.cut_error:
            raise OSError(self.cut_error, os.strerror(self.cut_error))
        self._cut(descriptor, length)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


@pytest.mark.parametrize("room", [0, 1, 40, 100])
def test_a_full_disk_refuses_the_record_and_keeps_what_was_before(block, disk, room):
    with Journal.open(block, HEADER)[0] as journal:
        append_event(journal, measured(1))
        before = journal.path.read_bytes()
        disk.write_room = room
        with pytest.raises(JournalError) as caught:
            append_event(journal, measured(2))
        assert "0001.jsonl: record refused: " in str(caught.value)
        assert ("No space left" if room == 0 else f"only {room} of") in str(caught.value)
        with pytest.raises(JournalError):
            journal.append_many([("a", {}), ("b", {"x": "y" * 200})], durable=False)
        assert journal.path.read_bytes() == before
        disk.write_room = None
        assert append_event(journal, measured(3)) == 3
    recovered = read_journal(block)
    assert recovered.remarks == ()
    assert events_of(recovered.records) == (measured(1), measured(3))


def test_a_disk_full_only_when_synced_refuses_the_record_too(block, disk):
    with Journal.open(block, HEADER)[0] as journal:
        disk.sync_error = errno.ENOSPC
        with pytest.raises(JournalError, match="No space left"):
            append_event(journal, measured(1))
        disk.sync_error = 0
        assert append_event(journal, measured(2)) == 2
    assert events_of(read_journal(block).records) == (measured(2),)


def test_after_a_failed_sync_nothing_is_trusted(block, disk):
    with Journal.open(block, HEADER)[0] as journal:
        disk.sync_error = errno.EIO
        with pytest.raises(JournalError, match="Input/output error"):
            append_event(journal, measured(1))
        disk.sync_error = 0
        with pytest.raises(JournalError, match="could not be brought to disk"):
            append_event(journal, measured(2))
    journal, recovered = Journal.open(block, HEADER)
    with journal:
        assert events_of(recovered.records) == ()
        assert append_event(journal, measured(3)) == 3


def test_when_a_refused_record_cannot_be_removed_everything_after_is_refused(block, disk):
    with Journal.open(block, HEADER)[0] as journal:
        disk.write_room, disk.cut_error = 30, errno.EIO
        with pytest.raises(JournalError, match="only 30 of"):
            append_event(journal, measured(1))
        disk.write_room, disk.cut_error = None, 0
        with pytest.raises(JournalError, match="a refused record could not be removed"):
            append_event(journal, measured(2))
    journal, recovered = Journal.open(block, HEADER)
    journal.close()
    assert events_of(recovered.records) == ()
    assert len(recovered.remarks) == 1


def test_an_interrupted_record_holds_no_sequence_number(block, disk):
    with Journal.open(block, HEADER)[0] as journal:
        disk.interrupt = True
        with pytest.raises(KeyboardInterrupt):
            append_event(journal, measured(1))
        disk.interrupt = False
        assert append_event(journal, measured(2)) == 2
    assert events_of(read_journal(block).records) == (measured(2),)


def test_a_full_disk_when_opening_leaves_the_block_free(block, disk):
    disk.write_room = 20
    with pytest.raises(InputError, match=r"0001\.jsonl: cannot be written: No space left"):
        Journal.open(block, HEADER)
    assert [path.name for path in (block / "sessions").iterdir()] == ["lock"]
    disk.write_room = None
    with Journal.open(block, HEADER)[0] as journal:
        append_event(journal, measured(1))
    before = (block / "sessions" / "0001.jsonl").read_bytes()
    disk.write_room = 20
    with pytest.raises(JournalError, match="only"):
        Journal.open(block, HEADER)
    assert (block / "sessions" / "0001.jsonl").read_bytes() == before
    disk.write_room = 0
    with pytest.raises(InputError, match="lock: cannot be locked: No space left"):
        Journal.open(block, HEADER)
    disk.write_room = None
    Journal.open(block, HEADER)[0].close()


def test_a_full_disk_at_the_beginning_of_a_new_file(block, disk):
    with Journal.open(block, HEADER, roll_bytes=10)[0] as journal:
        disk.write_room = 50
        with pytest.raises(JournalError, match=r"0002\.jsonl: cannot be written"):
            append_event(journal, measured(1))
        disk.write_room, disk.sync_error = None, errno.EIO
        with pytest.raises(JournalError, match=r"0001\.jsonl: record refused"):
            append_event(journal, measured(1))
        disk.sync_error = 0
    assert sorted(p.name for p in (block / "sessions").iterdir()) == ["0001.jsonl", "lock"]


def test_a_close_that_cannot_sync_says_so_and_still_gives_the_block_free(block, disk):
    journal, _ = Journal.open(block, HEADER)
    journal.append("a", {}, durable=False)
    disk.sync_error = errno.EIO
    with pytest.raises(JournalError, match="the last records may not be on disk"):
        journal.close()
    disk.sync_error = 0
    Journal.open(block, HEADER)[0].close()


def test_systems_without_fdatasync(block, monkeypatch):
    synced: list[int] = []
    real = os.fsync
    monkeypatch.delattr(os, "fdatasync", raising=False)
    monkeypatch.setattr(os, "fsync", lambda fd: (synced.append(fd), real(fd))[1])
    with Journal.open(block, HEADER)[0] as journal:
        synced.clear()
        journal.append("a", {}, durable=False)
        assert synced == []
        journal.append_many([("a", {}), ("b", {})], durable=True)
        assert len(synced) == 1


def test_one_write_and_one_sync_for_a_batch(block, monkeypatch):
    calls: list[str] = []
    write, sync = os.write, os.fsync
    monkeypatch.setattr(os, "write", lambda fd, data: (calls.append("write"), write(fd, data))[1])

    def logged(descriptor: int) -> None:
        calls.append("sync")
        sync(descriptor)

    monkeypatch.setattr(os, "fdatasync", logged, raising=False)
    with Journal.open(block, HEADER)[0] as journal:
        calls.clear()
        journal.append("a", {}, durable=False)
        journal.append_many([("a", {})] * 5, durable=True)
        assert calls == ["write", "write", "sync"]


def test_a_file_changed_or_removed_behind_its_back_is_noticed(block):
    with Journal.open(block, HEADER)[0] as journal:
        with journal.path.open("ab") as other:
            other.write(b"x")
        with pytest.raises(JournalError, match="changed by another program"):
            journal.append("a", {}, durable=True)
        journal.path.unlink()
        with pytest.raises(JournalError, match="removed"):
            journal.append("a", {}, durable=True)


def test_many_threads_write_whole_records_in_one_order(block):
    with Journal.open(block, HEADER, roll_bytes=5000)[0] as journal:

        def work(name: str) -> None:
            for n in range(50):
                journal.append("work", {"name": name, "n": n}, durable=False)

        threads = [threading.Thread(target=work, args=(name,)) for name in "abcd"]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    records = [r for r in read_journal(block).records if r.kind == "work"]
    assert len(records) == 200
    for name in "abcd":
        assert [r.payload["n"] for r in records if r.payload["name"] == name] == list(range(50))


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no list of open files here")
def test_nothing_stays_open(block):
    def descriptors() -> set[str]:
        return {
            target
            for link in Path("/proc/self/fd").iterdir()
            if (target := _target(link)).startswith(str(block))
        }

    journal, _ = Journal.open(block, HEADER, roll_bytes=10)
    journal.append("a", {}, durable=True)
    assert len(descriptors()) == 2
    with pytest.raises(InputError):
        Journal.open(block, HEADER)
    journal.close()
    with (block / "sessions" / "0001.jsonl").open("ab") as file:
        file.write(b"damage")
    with pytest.raises(InputError):
        Journal.open(block, HEADER)
    assert descriptors() == set()


def _target(link: Path) -> str:
    try:
        return str(link.readlink())
    except OSError:
        return ""
