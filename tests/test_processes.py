"""The tests' own way to run other processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import running

HERE = Path(__file__).parent
# one that waits for ever, and has one of its own that does
WAITS = "import os, sys; print(os.fork(), flush=True); sys.stdin.read()"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="POSIX")
def test_what_raises_leaves_no_process() -> None:
    reading, writing = os.pipe()

    def work() -> None:
        with running(
            [sys.executable, "-c", WAITS], stdin=subprocess.PIPE, pass_fds=[writing]
        ) as process:
            os.close(writing)
            assert process.stdout is not None
            assert process.stdout.readline()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    assert os.read(reading, 1) == b""  # nobody holds the other end any more
    os.close(reading)


def test_no_test_has_another_way() -> None:
    started = "subprocess." + "Popen("
    files = [path for path in HERE.rglob("*.py") if path.parent.name != "benchmarks"]
    having = [path.name for path in files if started in path.read_text(encoding="utf-8")]
    assert having == ["processes.py"]
