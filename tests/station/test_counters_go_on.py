"""Counters that were moved by an offset are moved by it when the block is opened again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from monobench import bench_in
from stationbench import Bench, Watch

from anaplot.errors import InputError
from anaplot.exchange.journal import Journal
from anaplot.plotter.device.hand import Hand
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position
from anaplot.session.referencing import Referencing
from anaplot.station.instrument import InstrumentSetup
from anaplot.station.lastshift import last_shift
from anaplot.station.replay import replay_session
from anaplot.station.salvage import salvage
from anaplot.station.snapshot import PointView, Snapshot
from anaplot.station.station import Station

PROFILE = "anaplot-ascii"
MEASURED = 5


class Place:
    """A block, and a device beside it that stays switched on while the block is closed."""

    def __init__(self, folder: Path, *, incremental: bool = True) -> None:
        self.bench: Bench = bench_in(folder)
        truth = self.bench.made.truth
        # time runs fast here, and hands move plates at once
        lines = load_profile(PROFILE).text.splitlines()
        file = folder.parent / f"{PROFILE}.toml"
        left_out = ("fastest",) if incremental else ("fastest", "incremental")
        file.write_text("\n".join(line for line in lines if not line.startswith(left_out)))
        self.beside = 0.0  # by how much x is set beside points
        self.profile = str(file)
        self.device = SimulatedPlotter(
            load_profile(self.profile), truth, in_right=truth, hand=Hand(follow=False)
        )
        self.server = SimulatorServer(self.device, tcp=True, time_scale=200.0).start()

    def open(self, folder: Path | None = None) -> tuple[Station, Watch]:
        station = Station(
            self.bench.folder if folder is None else folder,
            plotter=InstrumentSetup(self.profile, self.server.port),
            candidates=self.bench.candidates,
            auto_drive=False,
        )
        self.bench.stack.callback(station.close)
        watch = Watch(station)
        watch.until(lambda p: p.link.state == "live")
        return station, watch

    def measure(self, station: Station, watch: Watch) -> None:
        """Measure the first points of the first model at the wheels."""
        station.next_model()
        for point in station.snapshot().points[:MEASURED]:
            self.measure_one(station, watch, point)

    def measure_one(self, station: Station, watch: Watch, point: PointView) -> PointView:
        station.drive(point.point)
        watch.until(lambda _: station.standing)
        self.set_mark(station, watch, point.point)
        self.device.press("pedal")

        def now(picture: Snapshot) -> PointView:
            return next(p for p in picture.points if p.point == point.point)

        return now(watch.until(lambda p: now(p).times > point.times))

    def set_mark(self, station: Station, watch: Watch, name: str) -> None:
        """Set the mark on a point by hand, and wait until the counters are read there."""
        picture = station.snapshot()
        truth = self.bench.made.truth
        (xl, yl), (xr, yr) = truth[picture.left][name], truth[picture.right][name]
        self.move_to(xl + self.beside, yl, xr + self.beside, yr)
        assert station.instrument is not None
        link = station.instrument.link
        wanted = link.mark[1] + 4
        watch.until(lambda _: station.settled)
        for _ in range(6000):
            if station.settled and link.mark[1] >= wanted:
                return
            with watch.condition:
                watch.condition.wait(0.01)
        raise AssertionError("the counters are not read")

    def move_to(self, *there: float) -> None:
        here = self.device.positions()
        stood = (here.xl, here.yl, here.xr, here.yr)
        self.device.move(*(a - b for a, b in zip(there, stood, strict=True)))

    def refer(self, station: Station, watch: Watch) -> None:
        """Refer the counters to two points that are measured."""
        measured = [v.point for v in station.snapshot().points if v.times]
        for name in measured[:2]:
            self.set_mark(station, watch, name)
            station.reference(name)
        assert not station.snapshot().unreferenced

    def measure_again(self, station: Station, watch: Watch) -> None:
        """Measure the first point once more; it is where it was."""
        first = station.snapshot().points[0]
        again = self.measure_one(station, watch, first)
        assert (again.x, again.y) == pytest.approx((first.x, first.y), abs=0.02)

    def offset(self, station: Station, watch: Watch) -> Position:
        """Have the counters begin anew elsewhere, and refer them; returns the offset."""
        self.move_to(10.0, 5.0, -10.0, 5.0)  # the whole travel stays within what they count
        self.device.power_cycle()
        self.device.inject("disconnect", seconds=20.0)
        watch.until(lambda p: p.unreferenced and p.link.state == "live")
        self.refer(station, watch)
        return shift_of(station)


def shift_of(station: Station) -> Position:
    assert station.instrument is not None
    return station.instrument.link.shift


def alike(one: Position, other: Position, mm: float = 1e-9) -> bool:
    axes = ("xl", "yl", "xr", "yr")
    return all(abs(getattr(one, a) - getattr(other, a)) <= mm for a in axes)


@contextmanager
def place_in(folder: Path, *, incremental: bool = True) -> Iterator[Place]:
    made = Place(folder, incremental=incremental)
    try:
        with made.bench.stack:
            yield made
    finally:
        made.server.close()


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    with place_in(tmp_path / "block") as made:
        yield made


def test_an_offset_is_known_when_the_block_is_opened_again(place: Place) -> None:
    station, watch = place.open()
    place.measure(station, watch)
    shift = place.offset(station, watch)
    assert abs(shift.xl) > 1.0
    station.close()
    for _ in range(2):
        station, watch = place.open()
        assert alike(shift_of(station), shift)
        assert "the counters are moved as before" in watch.heard("as before")
        # nobody knows whether they were off meanwhile; who says that they were not is right
        assert station.snapshot().unreferenced
        station.keep_counters()
        assert alike(shift_of(station), shift)
        place.measure_again(station, watch)
        station.close()
    # pointing says the same
    station, watch = place.open()
    place.refer(station, watch)
    watch.heard("the counters kept their origin")
    assert alike(shift_of(station), shift)
    station.close()
    assert replay_session(place.bench.folder).differences == ()


def test_counters_that_were_off_meanwhile_are_referred_anew(place: Place) -> None:
    station, watch = place.open()
    place.measure(station, watch)
    shift = place.offset(station, watch)
    station.close()
    place.move_to(20.0, 10.0, -20.0, 10.0)
    place.device.power_cycle()
    station, watch = place.open()
    assert alike(shift_of(station), shift)
    place.refer(station, watch)
    assert "the counters are moved by x'" in watch.heard("moved by")
    now = shift_of(station)
    assert now.xl == pytest.approx(20.0, abs=0.02)
    station.close()
    # the latest one counts, whoever looked on since
    Station(place.bench.folder).close()
    station, watch = place.open()
    assert alike(shift_of(station), now)
    station.close()
    assert replay_session(place.bench.folder).differences == ()


def test_a_salvaged_session_knows_the_offset(place: Place, tmp_path: Path) -> None:
    station, watch = place.open()
    place.measure(station, watch)
    shift = place.offset(station, watch)
    station.close()
    file = place.bench.folder / "sessions" / "0001.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    at = next(k for k, line in enumerate(lines) if b'"kind":"table"' in line)
    file.write_bytes(b"".join((*lines[:at], lines[at].replace(b"rows", b"rowz"), *lines[at + 1 :])))
    salvaged = salvage(place.bench.folder, tmp_path / "salvaged")
    assert len(salvaged.gaps) == 1
    station, watch = place.open(tmp_path / "salvaged")
    assert alike(shift_of(station), shift)


def test_an_offset_that_photos_needed_is_known_of_counters_that_lose_nothing(
    tmp_path: Path,
) -> None:
    with place_in(tmp_path / "block", incremental=False) as place:
        station, watch = place.open()
        place.measure(station, watch)
        # as after photos that were laid in anew and lie elsewhere, by as much in both
        with station._lock:
            station._desk = replace(station.desk, referencing=Referencing())
        watch.until(lambda _: station.desk.referencing is not None)
        place.beside = 0.4
        place.refer(station, watch)
        shift = shift_of(station)
        assert shift.xl == pytest.approx(-0.4, abs=0.02)
        station.close()
        station, watch = place.open()
        # nothing is to be referred, and what is measured must fit what was
        assert not station.snapshot().unreferenced
        assert alike(shift_of(station), shift)
        place.measure_again(station, watch)
        station.close()
    assert replay_session(place.bench.folder).differences == ()


# -- what a journal says of it -------------------------------------------------------------------

A = {"profile": "a"}
B = {"profile": "b"}
MOVED = {"text": "", "shift": [1.0, 2.0, 3.0, 4.0]}
ONE = Position(1.0, 2.0, 3.0, 4.0)
BEFORE = {"shift": [9.0, 9.0, 9.0, 9.0]}
KEPT = {"text": "the counters kept their origin"}


@pytest.mark.parametrize(
    ("sessions", "shift"),
    [
        ([], None),
        ([(A,)], None),
        ([(A, MOVED)], ONE),
        ([(A, MOVED, KEPT)], ONE),
        ([(A | BEFORE, KEPT)], Position(9.0, 9.0, 9.0, 9.0)),
        ([(A | BEFORE, MOVED)], ONE),
        # of another instrument, and without any
        ([(B, MOVED)], None),
        ([(A, MOVED), (B,), ({},)], ONE),
        ([(A, MOVED), (B, {"text": "", "shift": [0.0, 0.0, 0.0, 5.0]})], ONE),
        # of a version that did not know it again: what it measured was not moved
        ([(A, MOVED), (A,)], None),
        ([(A | {"simulated": True}, MOVED)], None),
    ],
)
@pytest.mark.parametrize("rolled", [False, True])
def test_what_a_journal_says_of_an_offset(
    tmp_path: Path, sessions: list, shift: Position | None, rolled: bool
) -> None:
    folder = new_block(tmp_path)
    for header, *notes in sessions:
        with Journal.open(folder, header)[0] as journal:
            journal._roll_bytes = 1 if rolled else 1_000_000
            for note in notes:
                journal.append("referenced", note, durable=False)
            journal.append("refused", {"reason": '"kind":"referenced"'}, durable=False)
    if sessions:
        assert last_shift(folder, "a") == shift


def test_an_offset_that_is_none_is_told_with_its_place(tmp_path: Path) -> None:
    folder = new_block(tmp_path)
    with Journal.open(folder, A)[0] as journal:
        journal.append("referenced", {"shift": [1.0, 2.0]}, durable=False)
    with pytest.raises(InputError, match=r"0001.jsonl line 2: referenced: "):
        last_shift(folder, "a")


def new_block(folder: Path) -> Path:
    return bench_in(folder / "new").folder
