"""How much the console writes to its terminal for an event.

Run it as `python tests/benchmarks/console_bytes.py`. The console is `anaplot demo` in a
pseudo-terminal; a model is measured by hand, then cursor keys, records and steps of the handwheel
in the stereo view are counted: bytes, and frames (the terminal is told where one begins and ends).
"""

from __future__ import annotations

import os
import select
import statistics

from console_latency import KNOWS_FRAMES, Screen

ROUNDS = 12
_BEGIN = b"\x1b[?2026h"  # of a frame, for a terminal that has said that it shows it at once


def heard(screen: Screen, seconds: float) -> bytes:
    """Return what the console writes until it has been silent for this long."""
    seen = b""
    while select.select([screen.fd], [], [], seconds)[0]:
        seen += os.read(screen.fd, 65536)
    return seen


def count(screen: Screen, what: str, *keys: bytes) -> None:
    """Press the keys in turn, and print bytes and frames of a key."""
    sizes, frames = [], []
    for k in range(ROUNDS):
        heard(screen, 0.3)
        screen.type(keys[k % len(keys)])
        seen = heard(screen, 0.5)
        sizes.append(len(seen))
        frames.append(seen.count(_BEGIN))
    print(
        f"      {what:12} median {statistics.median(sizes):6.0f} bytes, worst {max(sizes):6d}; "
        f"frames {statistics.mean(frames):4.1f}",
        flush=True,
    )


def main() -> None:
    """Print the figures for both sizes of screen."""
    for columns, lines in ((80, 24), (160, 50)):
        screen = Screen("demo", "--seed", "1", columns=columns, lines=lines)
        try:
            screen.wait_for(b"next model")
            screen.type(KNOWS_FRAMES)
            screen.type(b"g")
            heard(screen, 2.0)
            print(f"{columns:4} x {lines}")
            count(screen, "record", b" ")
            count(screen, "cursor key", b"j", b"j", b"k")
            screen.type(b"v")
            heard(screen, 1.0)
            count(screen, "stereo step", b"\x1b[C", b"\x1b[D")
        finally:
            screen.close()


if __name__ == "__main__":
    main()
