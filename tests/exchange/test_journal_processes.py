"""The journal among processes: the lock, a killed writer, a disk that is really full."""

from __future__ import annotations

import os
import platform
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import anaplot
from anaplot.errors import InputError
from anaplot.exchange.journal import Journal, events_of, read_journal

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(anaplot.__file__).parents[1])}

HOST = platform.node()

HOLD = """
import sys
from pathlib import Path
from anaplot.exchange.journal import Journal
journal, recovered = Journal.open(Path(sys.argv[1]), {})
print("held", len(recovered.records), flush=True)
sys.stdin.read()
journal.close()
print("released", flush=True)
"""

WRITE = """
import itertools, sys
from pathlib import Path
from anaplot.exchange.journal import Journal, events_of
from anaplot.session.events import PointMeasured
journal, recovered = Journal.open(Path(sys.argv[1]), {}, roll_bytes=20_000)
for n in itertools.count(len(events_of(recovered.records))):
    journal.append("traffic", {"in": "00" * 40}, durable=False)
    journal.append_event(PointMeasured("101", "102", str(n), n / 3, 0.0, 0.0, 0.0, "pedal"))
    print(n, flush=True)
"""

FILL = """
import resource, sys
from pathlib import Path
from anaplot.exchange.journal import Journal, JournalError
journal, _ = Journal.open(Path(sys.argv[1]), {})
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))
accepted, refused = 0, []
for n in range(100):
    try:
        journal.append("a", {"n": n, "x": "y" * 37}, durable=True)
        accepted += 1
    except JournalError as error:
        refused.append(str(error))
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
journal.append("space", {"accepted": accepted, "refused": len(refused)}, durable=True)
journal.close()
print(refused[0])
"""


@contextmanager
def running(script: str, block: Path) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-c", script, str(block)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of POSIX"),
]


@pytest.fixture
def block(tmp_path: Path) -> Path:
    folder = tmp_path / "block"
    folder.mkdir()
    return folder


def test_two_processes_contend_and_the_holder_is_named(block):
    with running(HOLD, block) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held 0\n"
        with pytest.raises(InputError) as caught:
            Journal.open(block, {})
        assert f"the block is open in another anaplot (process {holder.pid} on {HOST})" in str(
            caught.value
        )
        second = subprocess.run(
            [sys.executable, "-c", HOLD, str(block)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            env=ENVIRONMENT,
            check=False,
        )
        assert second.returncode != 0
        assert f"(process {holder.pid} on {HOST})" in second.stderr
        # Reading needs no lock.
        assert len(read_journal(block).records) == 1
        output, _ = holder.communicate()
        assert output == "released\n"
    journal, recovered = Journal.open(block, {})
    journal.close()
    assert len(recovered.records) == 1


def test_a_dead_holder_holds_nothing(block):
    with running(HOLD, block) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held 0\n"
        holder.kill()
        assert holder.wait() == -signal.SIGKILL
    assert (block / "sessions" / "lock").read_text() == f"{holder.pid} {HOST}\n"
    Journal.open(block, {})[0].close()


def test_many_at_once_and_one_gets_it(block):
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", HOLD, str(block)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=ENVIRONMENT,
        )
        for _ in range(4)
    ]
    try:
        first_lines = [process.stdout.readline() for process in processes]
        assert sorted(first_lines) == ["", "", "", "held 0\n"]
    finally:
        for process in processes:
            process.communicate()
    assert len(read_journal(block).records) == 1


def test_a_killed_writer_loses_nothing_that_it_acknowledged(block):
    told = -1
    for kills in range(1, 6):
        with running(WRITE, block) as writer:
            assert writer.stdout is not None
            for _ in range(17 * kills):
                told = int(writer.stdout.readline())
            writer.send_signal(signal.SIGKILL)
            rest = writer.stdout.read().splitlines(keepends=True)
            told = max([told, *(int(line) for line in rest if line.endswith("\n"))])
            assert writer.wait() == -signal.SIGKILL
        events = events_of(read_journal(block).records)
        # At most one more than was told: killed between the record and the telling.
        assert len(events) - 1 in (told, told + 1)
        assert [event.point for event in events] == [str(n) for n in range(len(events))]
        assert [event.xl for event in events] == [n / 3 for n in range(len(events))]
    assert len(list((block / "sessions").glob("*.jsonl"))) > 1
    journal, recovered = Journal.open(block, {})
    journal.close()
    assert events_of(recovered.records) == events


def test_a_reader_beside_a_writer_sees_whole_records(block):
    with running(WRITE, block) as writer:
        assert writer.stdout is not None
        told = 0
        for _ in range(60):
            told = int(writer.stdout.readline())
            seen = read_journal(block)
            assert len(events_of(seen.records)) > told


def test_a_disk_that_is_really_full(block):
    result = subprocess.run(
        [sys.executable, "-c", FILL, str(block)],
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        check=True,
    )
    assert "0001.jsonl: record refused: " in result.stdout
    recovered = read_journal(block)
    assert recovered.remarks == ()
    *before, last = recovered.records
    assert last.kind == "space"
    assert last.payload["refused"] == 100 - last.payload["accepted"] > 0
    assert [record.payload["n"] for record in before[1:]] == list(range(len(before) - 1))
    assert len(before) - 1 == last.payload["accepted"] > 0
