"""The journal among processes: the lock, a killed writer, a disk that is really full."""

from __future__ import annotations

import platform
import signal
import subprocess
import sys
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

import pytest
from journaltools import events_of
from processes import running

from anaplot.errors import InputError
from anaplot.exchange.journal import Journal, read_journal

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
from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import Journal
from anaplot.session.events import PointMeasured
journal, recovered = Journal.open(Path(sys.argv[1]), {}, roll_bytes=20_000)
for n in itertools.count(sum(r.kind == PointMeasured.kind for r in recovered.records)):
    journal.append("traffic", {"in": "00" * 40}, durable=False)
    event = PointMeasured("101", "102", str(n), n / 3, 0.0, 0.0, 0.0, "pedal")
    journal.append(event.kind, event_to_payload(event), durable=True)
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


def journal_process(
    script: str, block: Path, **options: int
) -> AbstractContextManager[subprocess.Popen[str]]:
    return running([sys.executable, "-c", script, block], stdin=subprocess.PIPE, **options)


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
    with journal_process(HOLD, block) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held 0\n"
        with pytest.raises(InputError) as caught:
            Journal.open(block, {})
        assert f"the block is open in another anaplot (process {holder.pid} on {HOST})" in str(
            caught.value
        )
        with journal_process(HOLD, block, stderr=subprocess.PIPE) as second:
            _, errors = second.communicate()
        assert second.returncode != 0
        assert f"(process {holder.pid} on {HOST})" in errors
        # Reading needs no lock.
        assert len(read_journal(block).records) == 1
        output, _ = holder.communicate()
        assert output == "released\n"
    journal, recovered = Journal.open(block, {})
    journal.close()
    assert len(recovered.records) == 1


def test_a_dead_holder_holds_nothing(block):
    with journal_process(HOLD, block) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held 0\n"
        holder.kill()
        assert holder.wait() == -signal.SIGKILL
    assert (block / "sessions" / "lock").read_text() == f"{holder.pid} {HOST}\n"
    Journal.open(block, {})[0].close()


def test_many_at_once_and_one_gets_it(block):
    with ExitStack() as stack:
        processes = [
            stack.enter_context(journal_process(HOLD, block, stderr=subprocess.DEVNULL))
            for _ in range(4)
        ]
        first_lines = [process.stdout.readline() for process in processes]
        assert sorted(first_lines) == ["", "", "", "held 0\n"]
        for process in processes:
            process.communicate()
    assert len(read_journal(block).records) == 1


def test_a_killed_writer_loses_nothing_that_it_acknowledged(block):
    told = -1
    for kills in range(1, 6):
        with journal_process(WRITE, block) as writer:
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
    with journal_process(WRITE, block) as writer:
        assert writer.stdout is not None
        told = 0
        for _ in range(60):
            told = int(writer.stdout.readline())
            seen = read_journal(block)
            assert len(events_of(seen.records)) > told


def test_a_disk_that_is_really_full(block):
    with journal_process(FILL, block) as filling:
        output, _ = filling.communicate()
    assert filling.returncode == 0
    assert "0001.jsonl: record refused: " in output
    recovered = read_journal(block)
    assert recovered.remarks == ()
    *before, last = recovered.records
    assert last.kind == "space"
    assert last.payload["refused"] == 100 - last.payload["accepted"] > 0
    assert [record.payload["n"] for record in before[1:]] == list(range(len(before) - 1))
    assert len(before) - 1 == last.payload["accepted"] > 0
