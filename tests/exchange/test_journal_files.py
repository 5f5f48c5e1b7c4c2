"""Files of a journal that are not what they seem: refused, and left as they are."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from anaplot.errors import InputError
from anaplot.exchange.journal import Journal, JournalError, read_journal
from anaplot.exchange.lockfile import FolderLock
from anaplot.exchange.recordline import encode_line

STAMP = "2026-01-01T00:00:00.000Z"
PRECIOUS = b"my only copy"

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="links and open files of POSIX")


@pytest.fixture
def block(tmp_path: Path) -> Path:
    folder = tmp_path / "block"
    folder.mkdir()
    return folder


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    path = tmp_path / "precious"
    path.write_bytes(PRECIOUS)
    return path


def opened(block: Path) -> None:
    Journal.open(block, {})[0].close()


@pytest.mark.parametrize("name", ["lock", "0001.jsonl"])
@pytest.mark.parametrize("how", ["symlink_to", "hardlink_to"])
def test_a_link_is_never_written_through(block, precious, name, how):
    (block / "sessions").mkdir()
    getattr(block / "sessions" / name, how)(precious)
    with pytest.raises(InputError, match=rf"sessions/{name}: .*link"):
        opened(block)
    assert precious.read_bytes() == PRECIOUS


def test_a_link_to_nowhere_makes_no_file(block, tmp_path):
    (block / "sessions").mkdir()
    for name in ("lock", "0001.jsonl"):
        link = block / "sessions" / name
        link.symlink_to(tmp_path / "new")
        with pytest.raises(InputError, match="a link to another file"):
            opened(block)
        assert not (tmp_path / "new").exists()
        link.unlink()


@pytest.mark.parametrize("name", ["0001.jsonl", "0002.jsonl"])
def test_every_file_of_the_journal_is_looked_at(block, tmp_path, name):
    with Journal.open(block, {}, roll_bytes=10)[0] as journal:
        journal.append("a", {}, durable=True)
    path = block / "sessions" / name
    path.rename(tmp_path / name)
    path.symlink_to(tmp_path / name)
    with pytest.raises(InputError, match=f"{name}: a link to another file"):
        opened(block)
    # to be read it may lie anywhere
    assert len(read_journal(block).records) == 3


def test_sessions_is_a_folder_of_its_own(block, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (block / "sessions").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="sessions: not a folder of its own"):
        opened(block)
    assert list((tmp_path / "elsewhere").iterdir()) == []


@pytest.mark.parametrize("name", ["lock", "0001.jsonl"])
def test_a_pipe_is_not_waited_for(block, name):
    (block / "sessions").mkdir()
    os.mkfifo(block / "sessions" / name)
    with pytest.raises(InputError, match=f"{name}: not a regular file"):
        opened(block)


@pytest.mark.parametrize(
    "content", [PRECIOUS, b"{}", b'{"seq"=1}', b"\xff\xfe", b"one line\nand another", b"\n", b" "]
)
def test_a_file_that_begins_with_no_record_is_no_torn_header(block, content):
    (block / "sessions").mkdir()
    path = block / "sessions" / "0001.jsonl"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"0001\.jsonl line 1: not a journal: left as it is"):
        opened(block)
    assert path.read_bytes() == content
    assert sorted(p.name for p in path.parent.iterdir()) == ["0001.jsonl", "lock"]


@pytest.mark.parametrize("content", [b"{", b'{"seq":1,"t":"2026', b"\0" * 5000, b'{"seq":1\0\0\n'])
def test_a_header_that_never_was_on_disk_is_set_aside(block, content):
    (block / "sessions").mkdir()
    (block / "sessions" / "0001.jsonl").write_bytes(content)
    opened(block)
    assert (block / "sessions" / "0001.jsonl.torn-1").read_bytes() == content
    assert [record.kind for record in read_journal(block).records] == ["header"]


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["999999999"], r"0001\.jsonl: is missing, but there is 999999999\.jsonl"),
        (["0001", "999999999"], r"0002\.jsonl: is missing, but there is 999999999\.jsonl"),
        (["0001", "0003"], r"0002\.jsonl: is missing, but there is 0003\.jsonl"),
        (["9" * 40], r"0001\.jsonl: is missing"),
        (["0000", "0001"], r"0001\.jsonl: is missing, but there is 0000\.jsonl"),
    ],
)
def test_numbers_that_do_not_follow_are_refused(block, names, words):
    (block / "sessions").mkdir()
    for name in names:
        line = encode_line(1, STAMP, "header", {"format": 1}, durable=True)
        (block / "sessions" / f"{name}.jsonl").write_bytes(line)
    for attempt in (opened, read_journal):
        with pytest.raises(InputError, match=words):
            attempt(block)
    assert len(list((block / "sessions").glob("*.jsonl"))) == len(names)


# -- the lock --------------------------------------------------------------------------------


def test_the_lock_names_process_and_host(block):
    with Journal.open(block, {})[0]:
        said = (block / "sessions" / "lock").read_text().split()
        assert said == [str(os.getpid()), os.uname().nodename]
        with pytest.raises(InputError) as caught:
            opened(block)
    assert f"(process {os.getpid()} on {os.uname().nodename})" in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"\x1b[2J", b"1 \x1b[2J", b"77777\n", b"\xff" * 3000])
def test_whatever_a_lock_holds_is_told_as_plain_text(block, content):
    with Journal.open(block, {})[0]:
        lock = block / "sessions" / "lock"
        with lock.open("rb+") as file:
            file.truncate(0)
            file.write(content)
        with pytest.raises(InputError, match="open in another anaplot") as caught:
            opened(block)
    assert str(caught.value).isprintable()


def test_a_lock_whose_file_is_removed_is_taken_again(block):
    lock = block / "sessions" / "lock"
    with Journal.open(block, {})[0] as journal:
        for remove in (lock.unlink, lambda: lock.rename(block / "moved")):
            remove()
            journal.append("a", {}, durable=True)
            with pytest.raises(InputError, match="open in another anaplot"):
                opened(block)
    opened(block)
    assert [r.kind for r in read_journal(block).records] == ["header", "a", "a", "opened"]


def test_whoever_lost_his_lock_to_another_writes_no_more(block):
    first, _ = Journal.open(block, {})
    (block / "sessions" / "lock").unlink()
    second, _ = Journal.open(block, {})
    for _ in range(2):
        with pytest.raises(JournalError, match=r"changed by another|lock was removed"):
            first.append("a", {}, durable=True)
    second.append("b", {}, durable=True)
    second.close()
    with pytest.raises(JournalError):
        first.append("a", {}, durable=True)
    first.close()
    assert [r.kind for r in read_journal(block).records] == ["header", "opened", "b"]


def test_a_lock_lost_to_one_who_began_a_new_file_is_noticed(block):
    first, _ = Journal.open(block, {})
    (block / "sessions" / "lock").unlink()
    second, _ = Journal.open(block, {}, roll_bytes=1)
    with pytest.raises(JournalError, match=r"lock was removed .*open in another anaplot"):
        first.append("a", {}, durable=True)
    second.close()
    with pytest.raises(JournalError, match="must be opened again"):
        first.append("a", {}, durable=True)
    first.close()
    third, _ = Journal.open(block, {})
    (block / "sessions" / "lock").unlink()
    Journal.open(block, {}, roll_bytes=1)[0].close()
    with pytest.raises(JournalError, match="another anaplot has written"):
        third.append("a", {}, durable=True)
    third.close()
    assert {r.kind for r in read_journal(block).records} == {"header", "opened"}


def test_a_lock_removed_between_opening_and_locking_is_opened_again(block, monkeypatch):
    path = block / "lock"
    take = FolderLock._take
    times = []

    def removed_first(descriptor: int) -> None:
        if not times:
            path.unlink()
        times.append(descriptor)
        take(descriptor)

    monkeypatch.setattr(FolderLock, "_take", staticmethod(removed_first))
    lock = FolderLock(path)
    assert len(times) == 2
    monkeypatch.undo()
    with pytest.raises(InputError, match="open in another anaplot"):
        FolderLock(path)
    lock.release()


def test_a_journal_moved_away_is_noticed(block):
    with Journal.open(block, {})[0] as journal:
        journal.path.rename(block / "moved.jsonl")
        with pytest.raises(JournalError, match="moved away"):
            journal.append("a", {}, durable=True)
