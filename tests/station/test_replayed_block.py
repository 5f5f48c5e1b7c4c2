"""A replay shows what the block says, as the session itself did."""

from __future__ import annotations

import threading
from pathlib import Path

from anaplot.station.replayed import ReplayStation

SESSION = Path(__file__).parents[1] / "sessions" / "profile-simulated.jsonl"


def test_a_replay_shows_the_block() -> None:
    station = ReplayStation(SESSION, 1e9)
    seen = threading.Event()
    serials = []

    def look(picture) -> None:  # type: ignore[no-untyped-def]
        serials.append(picture.serial)
        view = picture.block_view
        if view is not None and not view.busy and view.models == 2 and view.sigma0 is not None:
            seen.set()

    station.subscribe(look)
    try:
        assert seen.wait(60.0)
        view = station.snapshot().block_view
        assert view is not None
        assert view.remark == ""
        assert len(serials) > 10
    finally:
        station.close()


def test_closing_a_replay_ends_its_threads() -> None:
    before = set(threading.enumerate())
    station = ReplayStation(SESSION, 1e9)
    station.subscribe(lambda _: None)
    station.close()
    assert set(threading.enumerate()) <= before
