"""Other processes in tests: whatever happens, none is left behind or waited for without end."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


@contextmanager
def running(command: Sequence[object], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Run a command in a process group of its own, and kill what is left of it at the end.

    A test that fails in the middle would otherwise wait for a process that waits for the test.
    Standard output is a pipe, and the package is found, unless `options` of Popen say otherwise.
    """
    options = {
        "stdout": subprocess.PIPE,
        "env": {**os.environ, "PYTHONPATH": str(ROOT)},
        "text": True,
        **options,
    }
    with subprocess.Popen(
        [str(word) for word in command], start_new_session=True, **options
    ) as process:
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def nothing_stays() -> Iterator[None]:
    """Fail where a descriptor or a thread is left at the end that was not there before."""
    threads, descriptors = set(threading.enumerate()), _descriptors()
    yield
    assert set(threading.enumerate()) <= threads
    # what an earlier test left to be collected may have gone meanwhile
    assert _descriptors() - descriptors == set()


def _descriptors() -> set[tuple[str, str]]:
    """Number and file of every open descriptor."""
    folder, found = Path("/proc/self/fd"), set()
    for one in list(folder.iterdir()) if folder.is_dir() else ():
        with contextlib.suppress(OSError):  # that of this very look has gone
            found.add((one.name, str(one.readlink())))
    return found
