"""A simulation that is interrupted or killed: nothing done is lost, and no process stays behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from processes import running

# chunks of a first and quick kind, then of one that would take longer than any test
JOB = """
import os, sys, time
from dataclasses import dataclass, field
from pathlib import Path
from anaplot.cli import main
from anaplot.planning import montecarlo, quantities
from anaplot.planning import scenarios as named
from anaplot.report import simulatecommand

@dataclass(frozen=True)
class Slow:
    name: str = "slow"
    about: str = "some chunks are quick"
    methods: tuple[str, ...] = ("m",)
    runs: int = 80
    chunk: int = 10
    references: dict = field(default_factory=dict)

    def prepare(self):
        return Trial()

class Trial:
    def remarks(self):
        return ()

    def quantities(self, methods):
        return {("c", "m", "q"): quantities.COUNT}

    def run(self, rng, runs, methods):
        Path(sys.argv[1], str(os.getpid())).touch()
        for k in range(5):
            try:
                Path(sys.argv[1], f"taken-{k}").touch(exist_ok=False)
                break
            except FileExistsError:
                pass
        if k > 2:
            time.sleep(600)
        return {("c", "m", "q"): montecarlo.Sums(runs, 1.0, 1.0)}

if __name__ == "__main__":
    simulatecommand.scenarios = lambda: {"slow": Slow()}
    sys.exit(main(["plan", "simulate", "slow", "--processes", "2", "--to", sys.argv[2]]))
"""
_DEADLINE = 60.0


def until(met: Callable[[], bool]) -> None:
    end = time.monotonic() + _DEADLINE
    while not met():
        assert time.monotonic() < end, "waited for too long"
        time.sleep(0.05)


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.fixture
def job(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], Path, Path]]:
    seen = tmp_path / "seen"
    seen.mkdir()
    script = tmp_path / "job.py"
    script.write_text(JOB)
    kept = tmp_path / "kept.jsonl"
    with running([sys.executable, script, seen, kept], stderr=subprocess.PIPE) as process:
        # three chunks are done and kept, two are being done
        until(lambda: kept.exists() and kept.read_bytes().count(b"\n") == 4)
        until(lambda: len(list(seen.glob("taken-*"))) == 5)
        yield process, seen, kept


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc"),
]


def workers(seen: Path) -> list[int]:
    return [int(path.name) for path in seen.iterdir() if path.name.isdigit()]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_ends_it_at_once_and_keeps_what_is_done(job, number: int, code: int) -> None:
    process, seen, kept = job
    os.killpg(process.pid, signal.SIGINT) if number == signal.SIGINT else process.terminate()
    _, error = process.communicate(timeout=_DEADLINE)
    assert process.returncode == code
    assert "Traceback" not in error
    until(lambda: not any(alive(pid) for pid in workers(seen)))
    lines = kept.read_text().splitlines()
    assert len([json.loads(line) for line in lines]) == 4


def test_workers_end_with_a_parent_that_was_killed(job) -> None:
    process, seen, _ = job
    assert len(workers(seen)) == 2
    process.kill()
    process.wait(_DEADLINE)
    until(lambda: not any(alive(pid) for pid in workers(seen)))
