"""The link's speed and thrift: from a record's bytes to its reading, and 10 000 records.

Run: ``python tests/benchmarks/plotter_link.py``
"""

from __future__ import annotations

import gc
import os
import statistics
import threading
import time
import tracemalloc
from pathlib import Path

from anaplot.plotter.decoder import Decoder
from anaplot.plotter.device.hand import Hand
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.link import Link
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Record

RECORDS = 10_000
WAIT = 60.0


def descriptors() -> int:
    """Count the open descriptors of this process."""
    return len(list(Path("/proc/self/fd").iterdir()))


def decoding() -> float:
    """Return the time to decode one record [us]."""
    profile = load_profile("simulated")
    assert profile.checksum is not None
    frames = []
    for number in range(1, 5001):
        text = b"R %d 1 +012.3456 -034.5678 +012.0000 -034.5000" % number
        frames.append(text + profile.checksum.digits(text) + b"\n")
    decoder = Decoder(profile)
    begin = time.perf_counter()
    for frame in frames:
        (reading,) = decoder.feed(frame, 0.0)
        assert isinstance(reading, Record)
    return (time.perf_counter() - begin) / len(frames) * 1e6


def latencies(count: int = 500) -> list[float]:
    """Return the times from writing a record to a pseudo-terminal to its reading [ms]."""
    import tty

    profile = load_profile("simulated")
    assert profile.checksum is not None
    master, slave = os.openpty()
    tty.setraw(slave)
    heard = threading.Event()
    when = [0.0]

    def on_reading(reading: object) -> None:
        if isinstance(reading, Record):
            when[0] = time.perf_counter()
            heard.set()

    times = []
    with Link(profile, os.ttyname(slave), on_reading=on_reading):
        for number in range(1, count + 1):
            text = b"R %d 1 +012.3456 -034.5678 +012.0000 -034.5000" % number
            heard.clear()
            begin = time.perf_counter()
            os.write(master, text + profile.checksum.digits(text) + b"\n")
            assert heard.wait(WAIT)
            times.append((when[0] - begin) * 1e3)
    os.close(master)
    os.close(slave)
    return times


def soak() -> tuple[float, int, int, float]:
    """Send `RECORDS` records through a real line.

    Returns
    -------
    tuple
        Growth of memory [kB], of descriptors and of threads, time [s].
    """
    profile = load_profile("simulated")
    before = descriptors(), threading.active_count()
    count = [0]
    told = threading.Condition()

    def on_reading(reading: object) -> None:
        if isinstance(reading, Record):
            with told:
                count[0] += 1
                told.notify_all()

    plotter = SimulatedPlotter(profile, {}, hand=Hand(follow=False))
    begin = time.perf_counter()
    with SimulatorServer(plotter) as server, Link(profile, server.port, on_reading=on_reading):
        start = 0
        for number in range(1, RECORDS + 1):
            plotter.press()
            if number % 20 == 0:
                with told:
                    assert told.wait_for(lambda number=number: count[0] >= number, WAIT)
            if number == 1000:
                gc.collect()
                tracemalloc.start()
                start = tracemalloc.get_traced_memory()[0]
        gc.collect()
        growth = (tracemalloc.get_traced_memory()[0] - start) / 1000.0
        tracemalloc.stop()
    took = time.perf_counter() - begin
    return growth, descriptors() - before[0], threading.active_count() - before[1], took


def main() -> None:
    """Print all numbers."""
    print(f"decode one record: {decoding():.0f} us")
    times = latencies()
    print(
        f"record on the pseudo-terminal to its reading: median {statistics.median(times):.2f} ms, "
        f"worst {max(times):.2f} ms of {len(times)}"
    )
    growth, left, threads, took = soak()
    print(
        f"{RECORDS} records through the line in {took:.1f} s: memory grew by {growth:.0f} kB, "
        f"{left} descriptors and {threads} threads left"
    )


if __name__ == "__main__":
    main()
