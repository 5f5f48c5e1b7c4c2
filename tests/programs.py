"""A program in a terminal of its own: what is typed, and what then stands on the screen."""

from __future__ import annotations

import codecs
import contextlib
import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from processes import ROOT, running
from terminal import Terminal

__all__ = ["AtTerminal", "at_terminal"]

_PATIENCE = 60.0  # s, after which something never comes
_UNFINISHED = re.compile(r"\x1b(?:\[[0-?]*[ -/]*|\][^\x07\x1b]*\x1b?)?$")


class AtTerminal:
    """Who sits at a program's terminal.

    Parameters
    ----------
    master
        The terminal's other end.
    lines
        Of the screen.
    process
        What runs in it.
    """

    def __init__(self, master: int, lines: int, process: subprocess.Popen[str]) -> None:
        self._master, self._lines = master, lines
        self.process = process
        self._shown = Terminal()
        self._decode = codecs.getincrementaldecoder("utf-8")().decode
        self._rest = ""

    @property
    def screen(self) -> str:
        """What stands on the screen."""
        return "\n".join(line.rstrip() for line in self._shown.lines[: self._lines])

    def type(self, keys: str) -> None:
        """Type characters."""
        os.write(self._master, keys.encode())

    def until(self, condition: Callable[[str], object]) -> str:
        """Wait until something holds of the screen, and return that."""
        end = time.monotonic() + _PATIENCE
        while not condition(self.screen):
            assert time.monotonic() < end, f"it never came:\n{self.screen}"
            assert self._hear(0.1) or self.process.poll() is None, f"it ended:\n{self.screen}"
        return self.screen

    def quiet(self, seconds: float = 0.15) -> str:
        """Wait until nothing has been written for a while, and return the screen."""
        while self._hear(seconds):
            pass
        return self.screen

    def ended(self) -> int:
        """Wait for the program's end and return its exit code."""
        end = time.monotonic() + _PATIENCE
        while self.process.poll() is None:
            assert time.monotonic() < end, f"it does not end:\n{self.screen}"
            self._hear(0.1)
        while self._hear(0.0):
            pass
        return int(self.process.returncode)

    def _hear(self, seconds: float) -> bool:
        """Take in what the program writes within some time; whether there was anything."""
        ready, _, _ = select.select([self._master], [], [], seconds)
        if not ready:
            return False
        try:
            data = os.read(self._master, 65536)
        except OSError:  # so ends a terminal that nobody holds any more
            return False
        text = self._rest + self._decode(data)
        cut = _UNFINISHED.search(text)
        self._rest = "" if cut is None else text[cut.start() :]
        first, *rest = (text if cut is None else text[: cut.start()]).split("\r\n")
        self._shown.write(first)
        for line in rest:
            self._shown.line, self._shown.column = self._shown.line + 1, 1
            self._shown.write(line)
        return True


@contextmanager
def at_terminal(
    command: Sequence[object], folder: Path, *, columns: int = 80, lines: int = 24
) -> Iterator[AtTerminal]:
    """Run a command in a terminal, in a folder, without any settings of the user."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "TERM": "xterm-256color",
        "COLUMNS": str(columns),
        "LINES": str(lines),
        "XDG_CONFIG_HOME": str(folder / "config"),
        "LC_ALL": "C.UTF-8",
    }
    try:
        with running(
            command, cwd=folder, stdin=slave, stdout=slave, stderr=slave, env=environment
        ) as process:
            os.close(slave)
            slave = -1
            yield AtTerminal(master, lines, process)
    finally:
        if slave >= 0:
            with contextlib.suppress(OSError):
                os.close(slave)
        os.close(master)
