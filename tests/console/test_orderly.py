"""A console whose terminal is closed, or that is stopped and goes on, leaves nothing behind."""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from clibench import TIMEOUT, command, environment
from processes import running
from textual.drivers._writer_thread import MAX_QUEUED_WRITES, WriterThread
from textual.drivers.headless_driver import HeadlessDriver

from anaplot.console.orderly import LastingFile, lasting

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no such terminals")


class Gone:
    """A terminal that was closed."""

    def write(self, text: str) -> None:
        raise OSError(5, "Input/output error")

    def flush(self) -> None:
        raise OSError(5, "Input/output error")

    def fileno(self) -> int:
        return 2


class WithFile(HeadlessDriver):
    def __init__(self, *arguments: object) -> None:
        self._file = Gone()


def test_a_terminal_that_is_gone_holds_nobody_up() -> None:
    driver = lasting(WithFile)()  # type: ignore[call-arg]
    assert driver._file.fileno() == 2  # type: ignore[attr-defined]
    writer = WriterThread(driver._file)  # type: ignore[attr-defined]
    writer.start()

    def write_much() -> None:
        for _ in range(10 * MAX_QUEUED_WRITES):
            writer.write("a frame")
        writer.stop()

    whole = threading.Thread(target=write_much, daemon=True)
    whole.start()
    whole.join(TIMEOUT)
    assert not whole.is_alive()


def test_what_can_be_written_is(tmp_path: Path) -> None:
    with (tmp_path / "shown").open("w") as file:
        LastingFile(file).write("a frame")
        LastingFile(file).flush()
        assert (tmp_path / "shown").read_text() == "a frame"


class Watched:
    """The master's side of a console's terminal, read all the time."""

    def __init__(self, master: int) -> None:
        self.master = master
        self._heard = bytearray()
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while data := os.read(self.master, 65536):
                with self._news:
                    self._heard += data
                    self._news.notify_all()

    def until(self, words: bytes, count: int = 1) -> None:
        """Wait until the console has written words so many times."""
        with self._news:
            assert self._news.wait_for(lambda: self._heard.count(words) >= count, TIMEOUT)

    def has(self, words: bytes) -> bool:
        """Whether the console has written words so far."""
        with self._news:
            return words in self._heard

    def end(self) -> None:
        """Wait until nothing can come any more."""
        self._thread.join(TIMEOUT)


@contextlib.contextmanager
def console(*arguments: object) -> Iterator[tuple[subprocess.Popen[str], Watched]]:
    """Run a command in a terminal of its own; ends with it closed."""
    master, slave = os.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    env = {**environment(), "TERM": "xterm-256color"}
    streams = {"stdin": slave, "stdout": slave, "stderr": slave}
    try:
        with running(command(*arguments), **streams, env=env) as process:
            os.close(slave)
            watched = Watched(master)
            yield process, watched
            process.wait(TIMEOUT)
            watched.end()
    finally:
        os.close(master)


LEFT = b"\x1b[?1049l"
TAKEN = b"\x1b[?1049h"


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
@pytest.mark.parametrize("asks", [False, True])
def test_a_signal_ends_the_console_with_its_code(name: str, asks: bool, tmp_path: Path) -> None:
    what = ("open", tmp_path / "new") if asks else ("demo", "--models", "1")
    with console(*what) as (process, watched):
        watched.until(b"next field" if asks else b"NOW")
        process.send_signal(getattr(signal, name))
        assert process.wait(TIMEOUT) == 128 + getattr(signal, name)
        watched.until(LEFT)
    assert not watched.has(b"Traceback")
    assert not (tmp_path / "new").exists()


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads")
@pytest.mark.parametrize("name", ["SIGSTOP", "SIGTSTP"])
def test_a_console_that_was_stopped_reads_each_key_once(name: str) -> None:
    with console("demo", "--models", "1") as (process, watched):

        def threads() -> int:
            return len(list(Path(f"/proc/{process.pid}/task").iterdir()))

        watched.until(b"NOW")
        watched.until(b"Quit")
        before = threads()
        for count in (1, 2):
            process.send_signal(getattr(signal, name))
            os.waitid(os.P_PID, process.pid, os.WSTOPPED)
            process.send_signal(signal.SIGCONT)
            watched.until(TAKEN, 1 + count)
            watched.until(b"NOW", 1 + count)
        assert threads() <= before
        process.send_signal(signal.SIGTERM)
