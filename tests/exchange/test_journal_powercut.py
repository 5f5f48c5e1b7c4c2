"""States of the disk after a power cut: every one opens, and nothing acknowledged is lost.

The system's calls of a writer are written down. At every one of them the power may fail; then of
what was not synced any part is on disk: each page as it was, as zeros or as written, the length as
it was or as written, a new name there or not. What was synced is there whole.
"""

from __future__ import annotations

import os
import random
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from anaplot.errors import InputError
from anaplot.exchange.journal import Journal, read_journal

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="files of POSIX"),
]


@dataclass
class Stored:
    """A file: what is surely on disk, what was written since, and whether its name is on disk."""

    name: str
    synced: bytes = b""
    now: bytearray = field(default_factory=bytearray)
    named: bool = False

    def states(self, page: int, dice: random.Random) -> Iterator[bytes | None]:
        """Yield contents that a power cut may leave; None: no file."""
        if not self.named:
            yield None
        yield self.synced
        yield bytes(self.now)
        if self.synced == self.now:
            return
        for lost in ("zeros", "mixed", "cut"):
            longest = max(len(self.synced), len(self.now))
            length = len(self.now)
            if lost == "cut":
                length = dice.randint(min(len(self.synced), len(self.now)), longest)
            out = bytearray(longest)
            out[: len(self.now)] = self.now
            for start in range(0, longest, page):
                if lost != "zeros" and dice.random() < 0.5:
                    continue
                for at in range(start, min(start + page, longest)):
                    # what was synced and is unchanged is there, whatever becomes of the rest
                    same = at < min(len(self.synced), len(self.now))
                    if not (same and self.synced[at] == self.now[at]):
                        out[at] = self.synced[at] if at < len(self.synced) else 0
            yield bytes(out[:length])


class Disk:
    """Writes down what is done to the files of one folder; `cut` is called before every step."""

    def __init__(self, folder: Path, cut: Callable[[], None], patch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        self.files: dict[int, Stored] = {}  # by inode
        self._cut = cut
        self._real = {name: getattr(os, name) for name in ("open", "write", "ftruncate", "fsync")}
        patch.setattr(os, "open", self.open)
        patch.setattr(os, "write", self.write)
        patch.setattr(os, "ftruncate", self.ftruncate)
        patch.setattr(os, "fsync", self.sync)
        patch.setattr(os, "fdatasync", self.sync, raising=False)

    def _file(self, descriptor: int) -> Stored | None:
        return self.files.get(os.fstat(descriptor).st_ino)

    def open(self, path: Any, flags: int, *rest: Any, **more: Any) -> int:
        descriptor: int = self._real["open"](path, flags, *rest, **more)
        path = Path(path)
        inode = os.fstat(descriptor).st_ino
        if path.parent == self.folder and flags & os.O_CREAT and inode not in self.files:
            self._cut()
            self.files[inode] = Stored(path.name)
        return descriptor

    def write(self, descriptor: int, data: bytes) -> int:
        written: int = self._real["write"](descriptor, data)
        self._changed(descriptor)
        return written

    def ftruncate(self, descriptor: int, length: int) -> None:
        self._real["ftruncate"](descriptor, length)
        self._changed(descriptor)

    def _changed(self, descriptor: int) -> None:
        file = self._file(descriptor)
        if file is not None:
            file.now = bytearray((self.folder / file.name).read_bytes())
            self._cut()

    def sync(self, descriptor: int) -> None:
        """Sync; nothing of a sync is on disk for sure before it has ended."""
        self._cut()
        file = self._file(descriptor)
        if file is not None:
            file.synced = bytes(file.now)
        elif os.path.samestat(os.fstat(descriptor), self.folder.stat()):
            for stored in self.files.values():
                stored.named = True
        self._cut()


class Cut:
    """At every step, disks that a power cut then would leave, each opened again and compared."""

    def __init__(self, tmp_path: Path, page: int, seed: int) -> None:
        self.block = tmp_path / "block"
        self.block.mkdir()
        self.after = tmp_path / "after"
        self.page = page
        self.dice = random.Random(seed)
        self.disk: Disk | None = None
        self.written: list[tuple[str, Any]] = []
        self.acknowledged = 0
        self.states: set[tuple[tuple[str, bytes], ...]] = set()
        self.mended = 0

    def __call__(self) -> None:
        disk = self.disk
        assert disk is not None
        files = [file for file in disk.files.values() if file.name != "lock"]
        choices = [list(file.states(self.page, self.dice)) for file in files]
        for k in range(max(map(len, choices), default=1)):
            chosen = [c[k % len(c)] for c in choices]
            state = tuple(
                (file.name, content)
                for file, content in zip(files, chosen, strict=True)
                if content is not None
            )
            if state not in self.states:
                self.states.add(state)
                self.check(state)

    def check(self, state: tuple[tuple[str, bytes], ...]) -> None:
        sessions = self.after / "sessions"
        shutil.rmtree(self.after, ignore_errors=True)
        sessions.mkdir(parents=True)
        for name, content in state:
            (sessions / name).write_bytes(content)
        with pytest.MonkeyPatch.context() as patch:
            assert self.disk is not None
            for name, real in self.disk._real.items():
                patch.setattr(os, name, real)
            patch.setattr(os, "fsync", lambda _: None)
            patch.setattr(os, "fdatasync", lambda _: None, raising=False)
            seen = read_journal(self.after) if state else None
            journal, recovered = Journal.open(self.after, {})
            journal.append("later", {}, durable=True)
            journal.close()
            found = [(r.kind, r.payload) for r in recovered.records if r.kind == "event"]
            assert found == self.written[: len(found)]
            assert len(found) >= self.acknowledged
            assert seen is None or seen.records == recovered.records
            again = read_journal(self.after)
            assert again.remarks == ()
            assert again.records[: len(recovered.records)] == recovered.records
            assert again.records[-1].kind == "later"
        self.mended += bool(recovered.remarks)

    def event(self, journal: Journal, *before: tuple[str, dict[str, Any]]) -> None:
        record = ("event", {"n": len(self.written), "x": "y" * self.dice.choice([0, 30, 300])})
        self.written.append(record)
        journal.append_many([*before, record], durable=True)
        self.acknowledged = len(self.written)


def traffic(dice: random.Random) -> tuple[str, dict[str, Any]]:
    return "traffic", {"items": [["in", "line", "x" * dice.choice([1, 40, 200, 900]), 1.5]]}


@pytest.mark.parametrize(("page", "seed"), [(16, 0), (64, 1), (512, 2), (4096, 3)])
def test_every_state_of_the_disk_opens_and_holds_what_was_acknowledged(
    tmp_path, monkeypatch, page, seed
):
    cut = Cut(tmp_path, page, seed)
    with monkeypatch.context() as patch:
        for _ in range(3):
            cut.disk = cut.disk or Disk(cut.block / "sessions", cut, patch)
            journal, _ = Journal.open(cut.block, {"block": "b"}, roll_bytes=4000)
            for _ in range(4):
                for _ in range(cut.dice.randint(0, 3)):
                    journal.append(*traffic(cut.dice), durable=False)
                cut.event(journal, *[traffic(cut.dice)] * cut.dice.randint(0, 2))
                journal.append("table", {"rows": [1.0] * 20}, durable=False)
            if cut.dice.random() < 0.5:
                journal.close()
            else:
                journal._leave()  # as one that is killed: nothing is synced
    assert len(cut.states) > 100
    assert cut.mended > 30


@pytest.mark.parametrize("page", [64, 512])
def test_a_power_cut_while_a_torn_tail_is_set_aside(tmp_path, monkeypatch, page):
    cut = Cut(tmp_path, page, seed=2)
    sessions = cut.block / "sessions"
    with Journal.open(cut.block, {})[0] as journal:
        cut.event(journal)
        cut.event(journal)
    path = sessions / "0001.jsonl"
    with path.open("ab") as file:
        file.write(b"\0" * 700 + b'"torn":1}\n' + b'{"seq":4')
    with monkeypatch.context() as patch:
        cut.disk = Disk(sessions, cut, patch)
        whole = path.read_bytes()
        cut.disk.files[path.stat().st_ino] = Stored(path.name, whole, bytearray(whole), named=True)
        journal, _ = Journal.open(cut.block, {})
        cut.event(journal)
        journal.close()
    assert len(cut.states) > 10
    assert cut.mended > 5


def test_damage_before_what_was_acknowledged_is_no_torn_tail(tmp_path):
    """A record behind the last durable one proves that it was on disk, and all before it."""
    block = tmp_path / "block"
    block.mkdir()
    with Journal.open(block, {})[0] as journal:
        journal.append("traffic", {"n": 1}, durable=False)
        journal.append("event", {"n": 2}, durable=True)
        journal.append("traffic", {"n": 3}, durable=False)
    path = block / "sessions" / "0001.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    zeros = b"\0" * len(lines[1])
    for behind in (lines[3], b"\0" * 9, b"{"):
        path.write_bytes(lines[0] + zeros + lines[2] + behind)
        with pytest.raises(InputError, match="line 2: damaged: not a complete record"):
            Journal.open(block, {})
    # Nothing behind it: zeros are what a power cut leaves, other bytes are not.
    path.write_bytes(lines[0] + lines[1].replace(b"1", b"7") + lines[2])
    with pytest.raises(InputError, match="line 2: damaged"):
        Journal.open(block, {})
    path.write_bytes(lines[0] + zeros + lines[2])
    journal, recovered = Journal.open(block, {})
    journal.close()
    assert "damaged" not in recovered.remarks[0]
    assert (block / "sessions" / "0001.jsonl.torn-1").read_bytes() == zeros + lines[2]


def test_damage_with_nothing_durable_behind_it_is_a_torn_tail(tmp_path):
    block = tmp_path / "block"
    block.mkdir()
    with Journal.open(block, {})[0] as journal:
        for n in range(4):
            journal.append("traffic", {"n": n}, durable=False)
    path = block / "sessions" / "0001.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + lines[1] + b"\0" * len(lines[2]) + b"".join(lines[3:]))
    whole = path.read_bytes()
    for other, why in ((b"x" * len(lines[2]), "not a complete record"), (lines[2], "")):
        path.write_bytes(lines[0] + lines[1] + other.replace(b'"n":1', b'"n":7') + lines[3])
        if why:
            assert why in read_journal(block).remarks[0]
        else:  # neither torn nor zeros: no power cut did this
            with pytest.raises(InputError, match="line 3: damaged: the checksum does not agree"):
                read_journal(block)
    path.write_bytes(whole)
    seen = read_journal(block)
    assert [r.kind for r in seen.records] == ["header", "traffic"]
    assert seen.remarks[0].endswith(
        "line 3: not a complete record, and with it 2 whole records that were never confirmed: "
        "left out"
    )
    journal, _ = Journal.open(block, {})
    journal.close()
    assert [r.kind for r in read_journal(block).records] == ["header", "traffic", "opened"]
