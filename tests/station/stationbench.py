"""A synthetic strip in a folder, stations on it, and what they tell."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from anaplot.exchange.journal import read_journal
from anaplot.planning.synthetic import SyntheticStrip
from anaplot.plotter.device.hand import Offsets
from anaplot.session.plates import image_of, plates_of
from anaplot.simulation.controls import controls_of
from anaplot.simulation.demo import rough
from anaplot.simulation.instrument import SimulationSetup
from anaplot.simulation.laidplates import random_placements
from anaplot.station.snapshot import Snapshot
from anaplot.station.station import Station

WAIT = 60.0  # generous: what does not come in this time does not come


class Watch:
    """What a station tells, and a way to wait for it."""

    def __init__(self, station: Station) -> None:
        self.station = station
        self.controls = controls_of(station)
        self.condition = threading.Condition()
        self.notices: list[tuple[str, str]] = []
        self.pictures: list[Snapshot] = []
        station.subscribe(self._picture)
        station.subscribe_notices(self._notice)

    def _picture(self, picture: Snapshot) -> None:
        with self.condition:
            self.pictures.append(picture)
            self.condition.notify_all()

    def _notice(self, severity: str, text: str) -> None:
        with self.condition:
            self.notices.append((severity, text))
            self.condition.notify_all()

    def until(self, true: Callable[[Snapshot], object]) -> Snapshot:
        """Wait for a picture of which something is true."""
        end = time.monotonic() + WAIT
        with self.condition:
            # some of what is waited for (a simulator's drives) comes without any news
            while not (held := self.condition.wait_for(lambda: true(self.station.snapshot()), 0.1)):
                if time.monotonic() > end:
                    break
        assert held, (self.station.snapshot(), self.notices[-5:])
        return self.station.snapshot()

    def heard(self, words: str, start: int = 0) -> str:
        """Wait for a notice with these words."""

        def found() -> str | None:
            return next((text for _, text in self.notices[start:] if words in text), None)

        with self.condition:
            assert self.condition.wait_for(found, WAIT), (words, self.notices)
            text = found()
        assert text is not None
        return text

    @property
    def mark(self) -> int:
        """How many notices there are: where to listen from."""
        with self.condition:
            return len(self.notices)


class Bench:
    """A synthetic strip in a folder, and stations on it."""

    def __init__(self, folder: Path, made: SyntheticStrip) -> None:
        from anaplot.exchange.blockfolder import write_new_block

        self.folder = folder
        self.made = made
        self.candidates = rough(made.truth)
        self.stack = ExitStack()
        write_new_block(folder, made.block)

    def setup(
        self,
        *,
        tcp: bool = False,
        time_scale: float = 1000.0,
        mistakes: dict[tuple[str, str, str], Offsets] | None = None,
    ) -> SimulationSetup:
        return SimulationSetup(
            self.made.truth,
            seed=7,
            noise_um=3.0,
            mistakes=mistakes,
            time_scale=time_scale,
            tcp=tcp,
            # none where the camera has no fiducials
            placements=random_placements(self.made.block, 7),
        )

    def open(
        self,
        *,
        tcp: bool = False,
        auto_drive: bool = True,
        pedal: bool = False,
        plotter: bool = True,
        mistakes: dict[tuple[str, str, str], Offsets] | None = None,
        time_scale: float = 1000.0,
    ) -> tuple[Station, Watch]:
        station = Station(
            self.folder,
            plotter=self.setup(tcp=tcp, mistakes=mistakes, time_scale=time_scale)
            if plotter
            else None,
            operator="tester",
            candidates=self.candidates,
            auto_drive=auto_drive,
        )
        self.stack.callback(station.close)
        watch = Watch(station)
        if plotter:
            assert station.instrument is not None
            station.instrument.set_pedal(pedal)
            watch.until(lambda p: p.link.state == "live")
        return station, watch

    def kinds(self) -> list[str]:
        return [record.kind for record in read_journal(self.folder).records]

    def payloads(self, kind: str) -> list[dict]:
        return [dict(r.payload) for r in read_journal(self.folder).records if r.kind == kind]

    def csv(self) -> str:
        path = self.folder / "image_points.csv"
        return path.read_text() if path.exists() else ""


def measure(station: Station, watch: Watch, point: str) -> None:
    """Drive to a point and record it with the key, as the console does."""
    before = next(p.times for p in watch.station.snapshot().points if p.point == point)
    if station.snapshot().target != point:
        station.drive(point)
    settled(watch)
    station.record()
    watch.until(lambda p: next(v.times for v in p.points if v.point == point) > before)


def settled(watch: Watch) -> None:
    """Wait until the hand has set the mark and the read-out shows where the plates stand.

    Simulated time runs so fast that a position may be on its way from before the mark was set.
    """
    station = watch.station
    assert station.instrument is not None
    simulator = station.instrument.simulator
    assert simulator is not None

    def stands() -> bool:
        read = station.readout()
        if not station.standing or read is None:
            return False
        true = image_of(simulator.positions(), plates_of(station.state))
        pairs = zip(
            (read.xl, read.yl, read.xr, read.yr), (true.xl, true.yl, true.xr, true.yr), strict=True
        )
        return all(abs(a - b) < 0.002 for a, b in pairs)

    deadline = time.monotonic() + WAIT
    while not stands():
        assert time.monotonic() < deadline, watch.notices[-5:]
        with watch.condition:
            watch.condition.wait(0.01)


def measure_all(station: Station, watch: Watch) -> None:
    """Measure what is pending, point by point."""
    while pending := [p.point for p in station.snapshot().points if p.status == "pending"]:
        measure(station, watch, pending[0])
