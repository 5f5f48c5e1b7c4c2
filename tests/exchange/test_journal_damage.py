"""Damaged journals: the valid prefix or a report, never a wrong record."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from journaltools import events_of, wait_for_no_disk

from anaplot.errors import InputError
from anaplot.exchange.journal import Journal, JournalRecord, read_journal
from anaplot.exchange.recordline import encode_line
from anaplot.exchange.salvage import read_what_can_be_read

STAMP = "2026-01-01T00:00:00.000Z"


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.name: path.read_bytes()
        for path in (folder / "sessions").iterdir()
        if path.name != "lock"
    }


def plain(records: tuple[JournalRecord, ...]) -> list[tuple[int, str, str, dict]]:
    return [(r.seq, r.time, r.kind, dict(r.payload)) for r in records]


def journal_lines(count: int, first: int = 1) -> list[bytes]:
    lines = [encode_line(first, STAMP, "header", {"format": 1, "block": "b"})]
    for seq in range(first + 1, first + count):
        lines.append(encode_line(seq, STAMP, "point", {"n": seq, "x": seq / 7, "s": '"}é\n'}))
    return lines


def expected(count: int, first: int = 1) -> list[tuple[int, str, str, dict]]:
    rows: list[tuple[int, str, str, dict]] = [(first, STAMP, "header", {"format": 1, "block": "b"})]
    for seq in range(first + 1, first + count):
        rows.append((seq, STAMP, "point", {"n": seq, "x": seq / 7, "s": '"}é\n'}))
    return rows


def assert_one_safe_line(error: InputError) -> None:
    assert str(error).isprintable()


@pytest.fixture(autouse=True)
def no_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Journals are opened by the hundred here."""
    wait_for_no_disk(monkeypatch)


class Folder:
    """A block folder whose journal is written anew for every case."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def put(self, **files: bytes) -> None:
        sessions = self.path / "sessions"
        if sessions.exists():
            shutil.rmtree(sessions)
        sessions.mkdir(parents=True)
        for name, data in files.items():
            (sessions / f"{name[1:]}.jsonl").write_bytes(data)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    return Folder(tmp_path_factory.mktemp("damage") / "block")


@pytest.mark.slow
def test_cut_at_every_byte_the_whole_lines_remain(folder):
    lines = journal_lines(4)
    data = b"".join(lines)
    ends = [sum(map(len, lines[:n])) for n in range(len(lines) + 1)]
    for length in range(len(data) + 1):
        folder.put(f0001=data[:length])
        # A record that lacks no more than the end of its line is whole.
        good = sum(end - 1 <= length for end in ends[1:])
        torn = length not in ends and length + 1 not in ends
        seen = read_journal(folder.path)
        assert plain(seen.records) == expected(good)[:good]
        assert len(seen.remarks) == int(torn)
        journal, recovered = Journal.open(folder.path, {})
        assert plain(recovered.records) == plain(seen.records)
        assert len(recovered.remarks) == int(torn or length + 1 in ends or length == 0)
        assert journal.append("after", {}, durable=False) == good + 2
        journal.close()
        again = read_journal(folder.path)
        assert again.remarks == ()
        assert [record.seq for record in again.records] == list(range(1, good + 3))
        aside = contents(folder.path).get("0001.jsonl.torn-1")
        assert aside == (data[ends[good] : length] if torn else None)


@pytest.mark.slow
def test_every_flipped_bit_is_noticed(folder):
    lines = journal_lines(4)
    data = b"".join(lines)
    last = len(data) - len(lines[-1])
    for at in range(len(data)):
        for bit in range(8):
            flipped = bytearray(data)
            flipped[at] ^= 1 << bit
            folder.put(f0001=bytes(flipped))
            # as after a power cut: the last line has lost its end, or has zeros
            if at < len(data) - 1 and not (at >= last and flipped[at] == 0):
                with pytest.raises(InputError):
                    read_journal(folder.path)
            else:
                seen = read_journal(folder.path)
                assert plain(seen.records) == expected(4)[: len(seen.records)]
                assert len(seen.records) == 3 or at == len(data) - 1


@pytest.mark.parametrize("first", [0, 2, 3])
def test_line_ends_of_others_are_refused_and_salvaged(folder, first):
    lines = [encode_line(1, STAMP, "header", {"format": 1, "block": "b"})]
    lines += [encode_line(seq, STAMP, "traffic", {"n": seq}) for seq in (2, 3, 4)]
    lines[first:] = [line[:-1] + b"\r\n" for line in lines[first:]]
    folder.put(f0001=b"".join(lines))
    before = contents(folder.path)
    for attempt in (lambda: Journal.open(folder.path, {}), lambda: read_journal(folder.path)):
        with pytest.raises(
            InputError, match=rf"0001\.jsonl line {first + 1}: damaged: its end is CR"
        ):
            attempt()
    assert contents(folder.path) == before
    (records,) = read_what_can_be_read(folder.path).files
    assert [(record.seq, record.payload.get("n")) for record in records] == [
        *[(1, None), (2, 2), (3, 3), (4, 4)],
    ]


def test_what_was_confirmed_and_then_changed_is_refused_though_it_is_the_last(tmp_path):
    with Journal.open(tmp_path, {})[0] as journal:
        journal.append("event", {"n": 1}, durable=True)
        journal.append("traffic", {"n": 2}, durable=False)
    path = tmp_path / "sessions" / "0001.jsonl"
    header, event, traffic = path.read_bytes().splitlines(keepends=True)
    for old, new in ((b'"n":1', b'"n":7'), (b'{"seq"', b'{"ses"'), (b'"crc":"', b'"crx":"')):
        path.write_bytes(header + event.replace(old, new))
        with pytest.raises(InputError, match=r"line 2: damaged"):
            read_journal(tmp_path)
    # of this nobody was told
    path.write_bytes(header + event + traffic.replace(b'"n":2', b'"n":7'))
    assert [record.kind for record in read_journal(tmp_path).records] == ["header", "event"]


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(st.data())
def test_random_damage_never_yields_a_wrong_record(folder, data):
    first, second = b"".join(journal_lines(4)), b"".join(journal_lines(3, first=5))
    files = {"f0001": bytearray(first), "f0002": bytearray(second)}
    for _ in range(data.draw(st.integers(1, 3))):
        target = files[data.draw(st.sampled_from(sorted(files)))]
        at = data.draw(st.integers(0, len(target)))
        length = data.draw(st.sampled_from([0, 1, 2, 50, len(target)]))
        target[at : at + length] = data.draw(
            st.binary(max_size=4) | st.sampled_from([b"\n", first, second, first[:200]])
        )
    whole = expected(4) + expected(3, first=5)
    folder.put(**{name: bytes(content) for name, content in files.items()})
    before = contents(folder.path)
    try:
        seen = read_journal(folder.path)
    except InputError as error:
        assert_one_safe_line(error)
        with pytest.raises(InputError):
            Journal.open(folder.path, {})
        assert contents(folder.path) == before
        return
    if len(seen.records) <= len(whole):
        assert plain(seen.records) == whole[: len(seen.records)]
    else:
        # The second file was copied whole behind itself: refused, as its numbers run back.
        pytest.fail("more records than were written")
    journal, recovered = Journal.open(folder.path, {})
    journal.close()
    assert plain(recovered.records) == plain(seen.records)
    assert read_journal(folder.path).remarks == ()


@pytest.mark.parametrize("line", [0, 1, 2])
def test_damage_in_the_middle_stops_and_changes_nothing(folder, line):
    lines = journal_lines(4)
    lines[line] = lines[line].replace(b"2026", b"2027")
    folder.put(f0001=b"".join(lines))
    before = contents(folder.path)
    for attempt in (
        lambda: Journal.open(folder.path, {}),
        lambda: read_journal(folder.path),
    ):
        with pytest.raises(InputError) as caught:
            attempt()
        assert f"0001.jsonl line {line + 1}: damaged: the checksum does not agree" in str(
            caught.value
        )
    assert contents(folder.path) == before


def test_a_torn_file_that_is_not_the_last_stops(folder):
    first, second = b"".join(journal_lines(4)), b"".join(journal_lines(3, first=5))
    folder.put(f0001=first[:-5], f0002=second)
    with pytest.raises(InputError, match=r"0001\.jsonl line 4: damaged"):
        Journal.open(folder.path, {})
    folder.put(f0001=b"", f0002=second)
    with pytest.raises(InputError, match=r"0001\.jsonl: is empty, but files follow it"):
        Journal.open(folder.path, {})


def test_a_last_file_without_a_whole_header_is_begun_anew(folder):
    first, second = b"".join(journal_lines(4)), b"".join(journal_lines(3, first=5))
    for length in (0, 1, 50):
        folder.put(f0001=first, f0002=second[:length])
        journal, recovered = Journal.open(folder.path, {"operator": "me"})
        journal.close()
        assert plain(recovered.records) == expected(4)
        assert len(recovered.remarks) == 1
        records = read_journal(folder.path).records
        assert (records[-1].seq, records[-1].kind, records[-1].line) == (5, "header", 1)
        aside = contents(folder.path).get("0002.jsonl.torn-1")
        assert aside == (second[:length] or None)


def test_several_torn_tails_are_all_kept(folder):
    folder.put(f0001=b"".join(journal_lines(2)))
    for n in (1, 2, 3):
        with (folder.path / "sessions" / "0001.jsonl").open("ab") as file:
            file.write(b"torn %d" % n)
        journal, recovered = Journal.open(folder.path, {})
        journal.close()
        assert f"moved to 0001.jsonl.torn-{n}" in recovered.remarks[0]
        assert contents(folder.path)[f"0001.jsonl.torn-{n}"] == b"torn %d" % n


def test_a_long_torn_tail_is_one_line_and_kept_whole(folder):
    good = b"".join(journal_lines(2))
    for tail in (b"\x00" * 3_500_000, b"x" * 1_000_000 + b"\n", b"x" * 2_500_000 + b"\n"):
        folder.put(f0001=good + tail)
        journal, recovered = Journal.open(folder.path, {})
        journal.close()
        assert plain(recovered.records) == expected(2)
        assert contents(folder.path)["0001.jsonl.torn-1"] == tail
        folder.put(f0001=good + tail + b"\n" + b"".join(journal_lines(4)[2:]))
        with pytest.raises(InputError, match="line 3: damaged"):
            Journal.open(folder.path, {})


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (journal_lines(4)[1:], "line 1: the header is missing"),
        (journal_lines(4)[:2] + journal_lines(4)[3:], "line 3: record 4 where 3 should follow"),
        (journal_lines(4) + journal_lines(4)[3:], "line 5: record 4 where 5 should follow"),
        (journal_lines(2, first=3), "line 1: record 3 where 1 should follow"),
        (journal_lines(2) + journal_lines(1, first=3), "line 3: a second header"),
        ([encode_line(1, STAMP, "header", {"format": 2})], "line 1: written by a newer version"),
        ([encode_line(1, STAMP, "header", {"format": 0})], "line 1: not a journal of a known"),
        ([encode_line(1, STAMP, "header", {"format": "1"})], "line 1: not a journal of a known"),
        ([encode_line(1, STAMP, "header", {})], "line 1: not a journal of a known format"),
        ([b'{"kind":"header","format":7,"check":"sha"}\n'], "line 1: written by a newer version"),
        (
            [*journal_lines(2), encode_line(3, STAMP, "opened", {"format": 2})],
            "line 3: written by a newer version",
        ),
    ],
)
def test_whole_lines_that_do_not_belong_are_never_cut_off(folder, lines, words):
    folder.put(f0001=b"".join(lines))
    before = contents(folder.path)
    for attempt in (
        lambda: Journal.open(folder.path, {}),
        lambda: Journal.open(folder.path, {}, keep=lambda kind: False),
        lambda: read_journal(folder.path),
    ):
        with pytest.raises(InputError) as caught:
            attempt()
        assert words in str(caught.value)
    assert contents(folder.path) == before


def test_a_missing_file_is_noticed(folder):
    third = b"".join(journal_lines(3, first=8))
    folder.put(f0001=b"".join(journal_lines(4)), f0003=third)
    with pytest.raises(InputError, match=r"0002\.jsonl: is missing, but there is 0003\.jsonl"):
        read_journal(folder.path)


def test_files_of_other_names_are_reported_and_left_alone(folder):
    folder.put(f0001=b"".join(journal_lines(2)))
    for name in ("0001 (copy).jsonl", "00001.jsonl", "1.jsonl", "notes.txt"):
        (folder.path / "sessions" / name).write_bytes(b"anything")
    journal, recovered = Journal.open(folder.path, {})
    journal.close()
    assert plain(recovered.records) == expected(2)
    assert len(recovered.remarks) == 3
    assert all("not a file of this journal, not read" in remark for remark in recovered.remarks)
    assert contents(folder.path)["00001.jsonl"] == b"anything"


def test_a_record_that_is_no_event_is_named(folder):
    lines = [*journal_lines(1), encode_line(2, STAMP, "row-switched", {"point": "1", "on": True})]
    folder.put(f0001=b"".join(lines))
    with pytest.raises(InputError, match=r"0001\.jsonl line 2: .*no key 'axis'"):
        events_of(read_journal(folder.path).records)


@pytest.mark.parametrize("call", ["open", "write", "ftruncate", "fsync"])
def test_a_tail_that_cannot_be_set_aside_stays_where_it_is(folder, monkeypatch, call):
    data = b"".join(journal_lines(3))[:-9]
    folder.put(f0001=data)
    real_open, real = os.open, getattr(os, call)
    locks: set[int] = set()

    def watched_open(path, *rest, **more):
        descriptor = real_open(path, *rest, **more)
        if Path(path).name == "lock":
            locks.add(descriptor)
        return descriptor

    def fail(target, *rest, **more):
        if target in locks or Path(str(target)).name == "lock":
            return watched_open(target, *rest, **more) if call == "open" else real(target, *rest)
        if call == "open" and not rest[0] & (os.O_WRONLY | os.O_RDWR):
            return real(target, *rest, **more)
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", watched_open)
        patch.setattr(os, call, fail)
        with pytest.raises(InputError, match=r"(0001\.jsonl|block): cannot be .*: No space"):
            Journal.open(folder.path, {})
    after = contents(folder.path)
    assert after.pop("0001.jsonl") == data
    # What was already kept aside may stay; nothing half written does.
    assert all(data.endswith(aside) for aside in after.values())
    journal, recovered = Journal.open(folder.path, {})
    journal.close()
    assert plain(recovered.records) == expected(2)
