"""Counters that lost their origin: refused until a reference was measured twice, then moved."""

from __future__ import annotations

from pathlib import Path

import pytest
from monobench import bench_in, finish, open_on, solutions
from stationbench import Bench, Watch

from anaplot.errors import InputError
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.link import Link
from anaplot.plotter.ports import parse_ports
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import UNREFERENCED, Position
from anaplot.station.inbox import Inbox
from anaplot.station.instrument import Instrument
from anaplot.station.replay import replay_session
from anaplot.station.station import Station

DISPLAYS = "heidenhain-nd281b"
MONO_DISPLAY = "heidenhain-nd720"


def device(station: Station) -> SimulatedPlotter:
    assert station.instrument is not None
    assert station.instrument.simulator is not None
    return station.instrument.simulator


def begin(station: Station, watch: Watch, points: int) -> None:
    """Measure the first points of the first model by the automatic operator."""
    station.next_model()
    watch.controls.set_automatic(True)
    watch.until(lambda p: sum(v.status != "pending" or bool(v.seen) for v in p.points) >= points)
    watch.controls.set_automatic(False)


def cut(station: Station, watch: Watch, *, power: bool) -> None:
    """Pull a cable for a moment; with `power` the counters begin at zero somewhere else."""
    if power:
        device(station).power_cycle()
    device(station).inject("disconnect", seconds=20.0)
    watch.until(lambda p: p.unreferenced and p.link.state == "live")


def point_at(station: Station, watch: Watch, name: str, dx: float = 0.0) -> None:
    """Have the hand set the mark on something measured, or beside it."""
    station.drive(name)
    watch.until(lambda _: station.standing)
    if dx:
        here = device(station).positions()
        device(station).move(dxl=dx, dxr=dx)
        assert device(station).positions() != here
    settle(station, watch)


def settle(station: Station, watch: Watch) -> None:
    """Wait until the counters have been read twice more."""
    assert station.instrument is not None
    link = station.instrument.link
    wanted = link.mark[1] + 3
    for _ in range(6000):
        if station.settled and link.mark[1] >= wanted:
            return
        with watch.condition:
            watch.condition.wait(0.01)
    raise AssertionError("the counters are not read")


@pytest.fixture
def undisturbed(tmp_path: Path) -> tuple[Bench, list]:
    bench = bench_in(tmp_path / "undisturbed")
    with bench.stack:
        station, _ = open_on(bench, DISPLAYS)
        finish(station)
        return bench, [s.table for s in solutions(station)]


def assert_alike(undisturbed: list, station: Station) -> None:
    """The same tables, but for the noise of points that were pointed at once more."""
    for table, now in zip(undisturbed, solutions(station), strict=True):
        for was, row in zip(table, now.table, strict=True):
            assert row.key == was.key
            # a shift of all points by a few micrometres is what is left of two pointings
            assert row.residual == pytest.approx(was.residual, abs=15.0)
        assert not now.flagged


def test_counters_that_kept_their_origin_change_nothing(tmp_path: Path, undisturbed) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        begin(station, watch, 6)
        cut(station, watch, power=False)
        with pytest.raises(InputError, match="lost their reference"):
            station.record()
        finish(station)
        watch.heard("the counters kept their origin")
        assert station.instrument is not None
        assert station.instrument.link.shift == Position(0.0, 0.0, 0.0, 0.0)
        assert_alike(undisturbed[1], station)
        station.close()
        assert "unreferenced" in bench.kinds()
    assert replay_session(bench.folder).differences == ()


def test_counters_that_begin_elsewhere_are_moved(tmp_path: Path, undisturbed) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        begin(station, watch, 6)
        before = device(station).positions()
        cut(station, watch, power=True)
        finish(station)
        watch.heard("the counters are moved by x'")
        assert station.instrument is not None
        shift = station.instrument.link.shift
        # displays begin at zero where the plates stood
        assert shift.xl == pytest.approx(before.xl, abs=0.02)
        assert shift.yr == pytest.approx(before.yr, abs=0.02)
        assert_alike(undisturbed[1], station)
        station.close()
        [note] = bench.payloads("referenced")
        moved = [shift.xl, shift.yl, shift.xr, shift.yr]
        assert note["shift"] == pytest.approx(moved, abs=1e-12)
    replayed = replay_session(bench.folder)
    assert replayed.differences == ()
    assert replayed.tables > 0


def test_counters_are_moved_in_a_session_of_many_files(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block", photos=2)
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        begin(station, watch, 3)
        cut(station, watch, power=True)
        station._journal._roll_bytes = 1
        finish(station)
        watch.heard("the counters are moved by x'")
        station.close()
    assert len(list((bench.folder / "sessions").glob("*.jsonl"))) > 3
    replayed = replay_session(bench.folder)
    assert replayed.differences == ()
    assert replayed.measurements >= 13


def test_pointings_that_disagree_are_forgotten(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        begin(station, watch, 6)
        cut(station, watch, power=True)
        picture = station.snapshot()
        last = picture.reference_point
        assert last is not None
        assert picture.expected.startswith("the counters have lost their reference: set the mark")
        assert last in picture.expected
        assert picture.next_point == last
        other = next(p.point for p in picture.points if p.status == "measured" and p.point != last)
        point_at(station, watch, last)
        with pytest.raises(InputError, match="no-such is no reference"):
            station.reference("no-such")
        station.reference()
        assert ", too, and press R" in station.snapshot().expected
        point_at(station, watch, other, dx=0.4)
        with pytest.raises(InputError, match=r"point \S+ \(left\) is 0\.\d+ mm from where"):
            station.reference(other)
        assert station.snapshot().unreferenced
        # the first one is forgotten, too: the wrong one alone cannot be confirmed by it
        assert ", too, and press R" not in station.snapshot().expected
        for name in (other, last):
            point_at(station, watch, name)
            station.reference(name)
        assert not station.snapshot().unreferenced
        finish(station)
        assert all(not s.flagged for s in solutions(station))
        station.close()
        assert "reference-refused" in bench.kinds()
    assert replay_session(bench.folder).differences == ()


def test_a_session_that_goes_on_measures_a_reference_first(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        begin(station, watch, 6)
        station.close()
        station, watch = open_on(bench, DISPLAYS)
        watch.until(lambda p: p.unreferenced)
        with pytest.raises(InputError, match=UNREFERENCED):
            station.record()
        finish(station)
        assert len(solutions(station)) == 2
        station.close()
        # nobody measures a reference where nothing is measured yet
        fresh = bench_in(tmp_path / "fresh")
        with fresh.stack:
            station, watch = open_on(fresh, DISPLAYS)
            assert not station.snapshot().unreferenced
            with pytest.raises(InputError, match="have their reference"):
                station.reference()
            with pytest.raises(InputError, match="have their reference"):
                station.keep_counters()
    assert replay_session(bench.folder).differences == ()


def test_the_operator_may_keep_the_counters(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        begin(station, watch, 6)
        cut(station, watch, power=False)
        station.keep_counters()
        picture = station.snapshot()
        assert not picture.unreferenced
        assert "reference" not in picture.expected
        finish(station)
        station.close()
    assert replay_session(bench.folder).differences == ()


@pytest.mark.parametrize("measured", [3, 11])
def test_fiducials_are_a_reference_during_inner_orientation(tmp_path: Path, measured: int) -> None:
    bench = bench_in(tmp_path / "block", fiducials=True, photos=2)
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        station.next_model()
        watch.controls.set_automatic(True)
        watch.until(lambda p: sum(f.times > 0 for i in p.inners for f in i.fiducials) >= measured)
        watch.controls.set_automatic(False)
        cut(station, watch, power=True)
        assert "fiducial" in station.snapshot().expected
        finish(station)
        watch.heard("the counters are moved by")
        assert not solutions(station)[0].flagged
        station.close()
    assert replay_session(bench.folder).differences == ()


def test_one_photo_in_a_comparator_is_referred_too(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block", fiducials=True, photos=2)
    with bench.stack:
        station, watch = open_on(bench, MONO_DISPLAY)
        station.next_model()
        watch.controls.set_automatic(True)
        watch.until(lambda p: sum("right" in v.seen for v in p.points) >= 4)
        watch.controls.set_automatic(False)
        cut(station, watch, power=True)
        finish(station)
        watch.heard("the counters are moved by x ")
        assert not solutions(station)[0].flagged
        station.close()
    assert replay_session(bench.folder).differences == ()


def test_where_nothing_is_measured_there_is_nothing_to_refer_to(tmp_path: Path) -> None:
    oriented = bench_in(tmp_path / "oriented", fiducials=True, photos=2)
    with oriented.stack:
        station, watch = open_on(oriented, DISPLAYS)
        station.next_model()
        cut(station, watch, power=True)
        # the inner orientation is still to come: it finds the plates wherever they are counted
        assert station.snapshot().reference_point is None
        assert "press R" in station.snapshot().expected
        finish(station)
        watch.heard("nothing measured depends on the counters")
        assert not solutions(station)[0].flagged
        station.close()
    bench = bench_in(tmp_path / "block", photos=2)
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        station.next_model()
        cut(station, watch, power=False)
        assert "press K" in station.snapshot().expected
        watch.until(lambda _: station.standing)
        settle(station, watch)
        with pytest.raises(InputError, match="set them by hand and keep them"):
            station.reference()
        with pytest.raises(InputError, match="set them by hand and keep them"):
            finish(station)
        station.keep_counters()
        finish(station)
        assert len(solutions(station)) == 1
        station.close()
    for folder in (oriented.folder, bench.folder):
        assert replay_session(folder).differences == ()


def test_counters_referred_while_their_loss_is_being_told_are_not_lost_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, watch = open_on(bench, DISPLAYS)
        station.next_model()
        looks = [False]  # the station looks, then a command refers them, then it has the lock
        monkeypatch.setattr(Link, "referenced", property(lambda _: not looks or looks.pop()))
        watch.until(lambda _: not looks)
        wanted = device(station).now + 5.0
        watch.until(lambda _: device(station).now > wanted)
        assert station.desk.referencing is None
        assert not station.snapshot().unreferenced


class Passing:
    """A line on which a read-out comes after every look."""

    state, shift = "live", Position(0.0, 0.0, 0.0, 0.0)

    def __init__(self) -> None:
        self.heard = 0

    def latest(self) -> None:
        return None

    @property
    def unreferenced_position(self) -> Position:
        self.heard += 1
        return Position(float(self.heard - 1), 0.0, 0.0, 0.0)

    def read_since(self, mark: tuple[int, int]) -> bool:
        self.heard += 1
        return self.heard - 1 > mark[1]


def test_counters_said_to_be_read_since_are_those_read_since() -> None:
    profile = load_profile(MONO_DISPLAY)
    instrument = Instrument(profile, parse_ports(profile, ["/dev/null"]), "", Inbox())
    for already in range(6):
        instrument.link = Passing()  # type: ignore[assignment]
        seen = instrument.seen((0, already))
        assert seen.counters is not None
        assert not seen.read or seen.counters.xl > already
    assert instrument.seen((0, 0)).read
