"""How long `anaplot --help` and the first screen of `anaplot open` take, as ratios of one run.

Run it as `python tests/benchmarks/start_up.py`. Compared with starting bare Python and with
importing Textual, interleaved, medians.
"""

from __future__ import annotations

import os
import pty
import select
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

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


def whole(*command: str) -> float:
    """Seconds from start to end of a command."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin


def first_screen(folder: Path) -> float:
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
    return taken


def main(runs: int = 9) -> None:
    """Print the ratios."""
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "block.toml").write_text(BLOCK)
        cases = {
            "bare Python": lambda: whole("-c", "pass"),
            "import textual.app": lambda: whole("-c", "import textual.app"),
            "anaplot --help": lambda: whole("-m", "anaplot", "--help"),
            "anaplot open, first screen": lambda: first_screen(folder),
        }
        for _ in range(runs):
            for title, case in cases.items():
                times.setdefault(title, []).append(case())
    middle = {title: statistics.median(values) for title, values in times.items()}
    print(f"{'':28}{'x bare Python':>15}{'x import textual':>18}")
    for title, value in middle.items():
        ratios = value / middle["bare Python"], value / middle["import textual.app"]
        print(f"{title:28}{ratios[0]:15.1f}{ratios[1]:18.2f}")


if __name__ == "__main__":
    main()
