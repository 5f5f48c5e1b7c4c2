"""A line that speaks at network speed: what waits is bounded, no record is lost, closing ends."""

from __future__ import annotations

import itertools
import socket
import threading
from collections.abc import Iterator

import pytest

from anaplot.plotter.link import Link
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position, Record, Refused
from anaplot.plotter.refusalcount import RefusalCount
from anaplot.station.inbox import _CROWDED, _FULL, Inbox, Traffic

PROFILE = load_profile("anaplot-ascii-crc")
PLACE = b"+012.3456 -034.5678 +012.0000 -034.5000"


def summed(text: bytes) -> bytes:
    assert PROFILE.checksum is not None
    return text + PROFILE.checksum.digits(text) + b"\n"


class Flood:
    """A terminal server that sends junk, positions and a press now and then, without end.

    `held_up` is set whenever the line takes no more, and is to be cleared by whoever waits for it.
    """

    def __init__(self, port: str) -> None:
        self.port = port
        self.held_up = threading.Event()


@pytest.fixture
def flood() -> Iterator[Flood]:
    listener = socket.create_server(("127.0.0.1", 0))
    flood = Flood(f"socket://127.0.0.1:{listener.getsockname()[1]}")
    ended = threading.Event()

    def serve() -> None:
        client, _ = listener.accept()
        client.settimeout(0.05)
        junk = (b"junk" * 10 + b"\n") * 40 + summed(b"P " + PLACE) * 5
        for number in itertools.count(1):
            data = junk + summed(b"R %d 1 " % number + PLACE)
            while data:
                try:
                    data = data[client.send(data) :]
                except TimeoutError:
                    flood.held_up.set()
                except OSError:
                    data = b""
                    ended.set()
                if ended.is_set():
                    client.close()
                    return

    thread = threading.Thread(target=serve)
    thread.start()
    yield flood
    ended.set()
    thread.join()
    listener.close()


def test_a_flood_is_bounded_and_loses_no_record(flood: Flood) -> None:
    full = threading.Event()

    def room() -> bool:
        if not ear.room():
            full.set()
        return ear.room()

    ear = Inbox()
    link = Link(
        PROFILE, flood.port, on_reading=ear.on_reading, on_traffic=ear.on_traffic, room=room
    )
    with link:
        assert full.wait(60)
        # nobody takes anything out: what waits grows no further than by what was read last, for
        # the line itself is full now
        flood.held_up.clear()
        assert flood.held_up.wait(60)
        assert ear.items.qsize() < _FULL + 200
        items = []
        while ear.items.qsize():
            items.append(ear.items.get())
    records = [item for item in items if isinstance(item, Record)]
    # opening a port throws away what had come before
    numbers = [record.number or 0 for record in records]
    assert numbers == list(range(numbers[0], numbers[0] + len(records)))
    assert len(records) > 20
    assert sum(isinstance(item, Position) for item in items) <= _CROWDED
    junk = [item for item in items if isinstance(item, Refused)]
    assert len(junk) < len(items) / 2
    held = sum(len(item.data) for item in items if isinstance(item, Traffic))
    assert held < _FULL * 4096


def test_refusals_beyond_a_number_a_second_are_counted() -> None:
    gate = RefusalCount()
    junk = [Refused(b"junk", "no record")] * 500
    press = Refused(b"", "key was not recorded: no position came after it")
    told = gate.sift([*junk, press], 10.0)
    assert len(told) == 21
    assert told[-1] == press
    assert gate.sift(junk, 10.5) == []
    first, *rest = gate.sift(junk[:1], 11.0)
    assert first == Refused(b"", "980 more in a second, last: no record")
    assert rest == junk[:1]
