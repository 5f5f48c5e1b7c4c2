"""How long commands that compute nothing take, and the first screen of `anaplot open`.

Run it as `python tests/benchmarks/start_up.py`. Compared with starting bare Python, with importing
NumPy and with importing Textual, interleaved, medians; of what ends by itself the processor time
too, which other work of the machine does not lengthen.
"""

from __future__ import annotations

import os
import pty
import resource
import select
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

BLOCK = """format = 1
name = "start-up"
[[camera]]
id = "c"
c = 152.4
format = [230.0, 230.0]
[[strip]]
id = "1"
photos = ["101", "102"]
base = 92.0
[[photo]]
id = "101"
camera = "c"
[[photo]]
id = "102"
camera = "c"
"""


class Taken(NamedTuple):
    """Seconds by the clock, and of the processor where they are known."""

    clock: float
    processor: float = float("nan")


def worked() -> float:
    """Return the processor seconds of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def whole(*command: str) -> Taken:
    """Return what a command takes from start to end."""
    begin, before = time.perf_counter(), worked()
    subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL)
    return Taken(time.perf_counter() - begin, worked() - before)


def first_screen(folder: Path) -> Taken:
    """Seconds from the start of `anaplot open` to the line that tells what is expected."""
    begin = time.perf_counter()
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ["TERM"] = "xterm-256color"
        os.environ["COLUMNS"], os.environ["LINES"] = "80", "24"
        os.execv(sys.executable, [sys.executable, "-m", "anaplot", "open", str(folder)])
    seen = b""
    while b"next model" not in seen:
        if not select.select([terminal], [], [], 30.0)[0]:
            raise SystemExit("no screen within 30 s")
        seen += os.read(terminal, 65536)
    taken = time.perf_counter() - begin
    os.write(terminal, b"q")
    deadline = time.perf_counter() + 10.0
    while time.perf_counter() < deadline:
        try:
            if select.select([terminal], [], [], 0.1)[0] and not os.read(terminal, 65536):
                break
        except OSError:
            break
    os.close(terminal)
    os.waitpid(pid, 0)
    return Taken(taken)


def main(runs: int = 9) -> None:
    """Print the ratios."""
    times: dict[str, list[Taken]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "block.toml").write_text(BLOCK)
        for run in range(runs):
            new = str(folder / f"new-{run}")
            cases = {
                "bare Python": lambda: whole("-c", "pass"),
                "import numpy": lambda: whole("-c", "import numpy"),
                "import textual.app": lambda: whole("-c", "import textual.app"),
                "anaplot --help": lambda: whole("-m", "anaplot", "--help"),
                "anaplot new": lambda new=new: whole(
                    *("-m", "anaplot", "new", new, "--strip", "101-105")
                ),
                "anaplot status": lambda: whole("-m", "anaplot", "status", str(folder)),
                "anaplot open, first screen": lambda: first_screen(folder),
            }
            for title, case in cases.items():
                times.setdefault(title, []).append(case())
    middle = {
        title: Taken(*map(statistics.median, zip(*taken, strict=True)))
        for title, taken in times.items()
    }
    print(f"{'':28}{'x bare Python':>15}{'x import textual':>18}{'processor':>12}")
    for title, value in middle.items():
        bare, textual = (middle[one].clock for one in ("bare Python", "import textual.app"))
        processor = "" if value.processor != value.processor else f"{value.processor:10.3f} s"
        print(f"{title:28}{value.clock / bare:15.1f}{value.clock / textual:18.2f}{processor:>12}")


if __name__ == "__main__":
    main()
