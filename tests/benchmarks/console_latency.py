"""From the record byte on the plotter's line to the new table on the operator's screen.

Run it as `python tests/benchmarks/console_latency.py`. The console is `anaplot open` in a
pseudo-terminal of its own, connected through a second pseudo-terminal to a simulated plotter that
lives in this process. A 13-point model is measured, then its last point again and again; each time
the clock runs from the pedal until the console has written the new table.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import re
import select
import statistics
import struct
import sys
import tempfile
import termios
import threading
import time
from pathlib import Path

from anaplot.plotter.device.hand import Hand, HandSettled
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.profile import load_profile
from anaplot.simulation.demo import Demo

ROUNDS = 100
_END_OF_FRAME = b"\x1b[?2026l"  # from a console whose terminal has said that it knows frames
_PLACE = re.compile(rb"\x1b\[(\d+);(\d+)H")
KNOWS_FRAMES = b"\x1b[?2026;2$y"


class Screen:
    """The console's terminal."""

    def __init__(self, *command: str, columns: int, lines: int) -> None:
        self.pid, self.fd = pty.fork()
        if self.pid == 0:
            os.environ |= {"TERM": "xterm-256color", "COLUMNS": str(columns), "LINES": str(lines)}
            os.execv(sys.executable, [sys.executable, "-m", "anaplot", *command])
        fcntl.ioctl(self.fd, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))

    def wait_for(self, text: bytes, seconds: float = 30.0) -> None:
        """Read until the console has written the text."""
        seen = b""
        end = time.monotonic() + seconds
        while text not in seen:
            if not select.select([self.fd], [], [], max(0.0, end - time.monotonic()))[0]:
                raise SystemExit(f"{text!r} was not written within {seconds} s: {seen[-400:]!r}")
            seen += os.read(self.fd, 65536)

    def wait_for_table(self, seconds: float = 30.0) -> None:
        """Read until the bell has rung for a record, and a frame has changed the table."""
        seen = b""
        end = time.monotonic() + seconds
        while True:
            _, rung, after = seen.partition(b"\a")
            frames = after.split(_END_OF_FRAME)[:-1] if rung else []
            places = [place for frame in frames for place in _PLACE.findall(frame)]
            if any(int(line) > 5 and int(column) < 50 for line, column in places):
                return
            if not select.select([self.fd], [], [], max(0.0, end - time.monotonic()))[0]:
                raise SystemExit(f"no table was written within {seconds} s: {seen[-400:]!r}")
            seen += os.read(self.fd, 65536)

    def settle(self) -> None:
        """Read until nothing more is written."""
        while select.select([self.fd], [], [], 0.15)[0]:
            os.read(self.fd, 65536)

    def type(self, keys: bytes) -> None:
        """Press keys."""
        os.write(self.fd, keys)

    def close(self) -> None:
        """Leave the console."""
        with contextlib.suppress(OSError):
            self.type(b"\x11\x11")
            while select.select([self.fd], [], [], 5.0)[0]:
                if not os.read(self.fd, 65536):
                    break
        os.close(self.fd)
        os.waitpid(self.pid, 0)


def measure(columns: int, lines: int) -> list[float]:
    """Return the seconds of every round."""
    demo = Demo.make(1, 1)
    settled = threading.Event()

    def on_settled(event: HandSettled) -> None:
        if event.point is not None:
            settled.set()

    simulator = SimulatedPlotter(
        load_profile("anaplot-ascii"),
        demo.strip.truth,
        hand=Hand(search_radius=20.0, settle_time=0.1),
        on_settled=on_settled,
    )
    simulator.lay("101", "102")
    times = []
    with tempfile.TemporaryDirectory() as name, SimulatorServer(simulator) as server:
        folder = Path(name) / "block"
        demo.write(folder)
        screen = Screen(
            *("open", str(folder), "--profile", "anaplot-ascii", "--port", server.port),
            columns=columns,
            lines=lines,
        )
        try:
            screen.wait_for(b"next model")
            screen.type(KNOWS_FRAMES)
            screen.settle()
            screen.type(b"g")  # lays the photos in and drives to the first point
            for count in range(13 + ROUNDS):
                if count >= 13:
                    screen.type(b"\x1b[F")  # the last row, by hand
                    screen.settle()
                    screen.type(b"\r")  # back to its point
                if not settled.wait(10.0):
                    raise SystemExit(f"the simulated hand found no point in round {count}")
                screen.settle()
                settled.clear()
                begin = time.perf_counter()
                simulator.press()
                screen.wait_for_table()
                taken = time.perf_counter() - begin
                screen.settle()
                if count >= 13:
                    times.append(taken)
        finally:
            screen.close()
    return times


def main() -> None:
    """Print median and worst for both sizes of screen."""
    print(f"record byte to new table, {ROUNDS} rounds; to stay below 50 ms")
    for columns, lines in ((80, 24), (160, 50)):
        times = sorted(measure(columns, lines))
        print(
            f"{columns:4} x {lines}: median {1e3 * statistics.median(times):5.1f} ms, "
            f"95 % {1e3 * times[int(0.95 * len(times))]:5.1f} ms, worst {1e3 * times[-1]:5.1f} ms"
        )


if __name__ == "__main__":
    main()
