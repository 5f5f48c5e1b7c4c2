"""From the record byte on the plotter's line to the new table on the operator's screen.

Run it as `python tests/benchmarks/console_latency.py`. The console is `anaplot open` in a
pseudo-terminal of its own, connected through a second pseudo-terminal to a simulated plotter that
lives in this process. A 13-point model is measured, then its last point again and again; each time
the clock runs from the pedal until the console has written the new table. Beside that clock stands
the processor time of the console's whole process meanwhile, which other work of the machine does
not lengthen, and the time that a thread of this process slept too long when it asked for 10 ms: on
an idle machine next to nothing.

In half of the rounds the block has so many photos more, measured elsewhere, that it is being
adjusted in the background all the while.
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
from typing import NamedTuple

import numpy as np

from anaplot.exchange.blockfolder import write_image_points
from anaplot.photogrammetry.block import ImagePoint
from anaplot.plotter.device.hand import Hand, HandSettled
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.profile import load_profile
from anaplot.simulation.demo import Demo

ROUNDS = 300
PHOTOS = 300  # of the block that is adjusted meanwhile, all the while
_PROCESS = 2  # the kind of a clock that runs while a process works (CPUCLOCK_SCHED)
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

    def processor(self) -> float:
        """Return the seconds that all threads of the console have worked so far (Linux)."""
        return time.clock_gettime(~self.pid << 3 | _PROCESS)

    def settle(self) -> None:
        """Read until nothing more is written."""
        while select.select([self.fd], [], [], 0.1)[0]:
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


class Round(NamedTuple):
    """Seconds of one record: by the clock, of the processor, and what 10 ms of sleep were late."""

    taken: float
    worked: float
    late: float


def measure(columns: int, lines: int, photos: int, count: int) -> list[Round]:
    """Return so many rounds in a block of so many photos."""
    demo = Demo.make(photos - 1, 1)
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
    rounds = []
    with tempfile.TemporaryDirectory() as name, SimulatorServer(simulator) as server:
        folder = Path(name) / "block"
        demo.write(folder)
        write_image_points(folder, elsewhere(demo))
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
            for k in range(13 + count):
                if k >= 13:
                    screen.type(b"\x1b[F")  # the last row, by hand
                    screen.settle()
                    screen.type(b"\r")  # back to its point
                if not settled.wait(10.0):
                    raise SystemExit(f"the simulated hand found no point in round {k}")
                screen.settle()
                settled.clear()
                begin = time.perf_counter()
                time.sleep(0.01)
                late = time.perf_counter() - begin - 0.01
                begin, worked = time.perf_counter(), screen.processor()
                simulator.press()
                screen.wait_for_table()
                found = Round(time.perf_counter() - begin, screen.processor() - worked, late)
                screen.settle()
                if k >= 13:
                    rounds.append(found)
        finally:
            screen.close()
    return rounds


def elsewhere(demo: Demo) -> list[ImagePoint]:
    """Return what was measured of all photos but the first, with its noise."""
    rng = np.random.default_rng(1)
    return [
        ImagePoint(photo, point, *(np.array(at) + rng.normal(0.0, 0.005, 2)).tolist())
        for photo, points in list(demo.strip.truth.items())[1:]
        for point, at in points.items()
        if sum(point in others for others in demo.strip.truth.values()) > 1
    ]


def figures(what: str, seconds: list[float]) -> str:
    """Return median, 95 %, 99 % and worst [ms]."""
    times = sorted(1e3 * one for one in seconds)
    return (
        f"    {what:22} median {statistics.median(times):6.1f}   "
        f"95 % {times[int(0.95 * len(times))]:6.1f}   99 % {times[int(0.99 * len(times))]:6.1f}   "
        f"worst {times[-1]:6.1f} ms"
    )


def main() -> None:
    """Print the figures for both sizes of screen."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS
    print(f"record byte to new table, {rounds} rounds each; to stay below 50 ms")
    for columns, lines in ((80, 24), (160, 50)):
        worked = {}
        for photos in (2, PHOTOS):
            found = measure(columns, lines, photos, rounds)
            worked[photos] = statistics.median(one.worked for one in found)
            print(f"{columns:4} x {lines}, block of {photos} photos")
            print(figures("clock", [one.taken for one in found]))
            print(figures("processor", [one.worked for one in found]))
            print(figures("10 ms of sleep, late", [one.late for one in found]), flush=True)
        ratio = worked[PHOTOS] / worked[2]
        print(f"    beside the block {ratio:.2f} times the processor time, median")


if __name__ == "__main__":
    main()
