"""Jobs in a mono comparator: one photo after the other, models when both are measured."""

from __future__ import annotations

import io
import math
from pathlib import Path

import pytest
from monobench import bench_in, finish, open_on, quick_tablet, solutions
from stationbench import Watch

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.orientation.strip import bridge_strip
from anaplot.plotter.device.hand import Offsets
from anaplot.session.events import MonoMeasured, PhotoLaid
from anaplot.station.rebuild import rebuild
from anaplot.station.replay import replay_session
from anaplot.station.replayed import ReplayStation
from anaplot.station.station import Station

GAUGES = "mitutoyo-gauge"


def record(station: Station, watch: Watch, point: str) -> None:
    """Set the mark on a point of the photo that lies in, and record it."""
    if station.snapshot().target != point:
        station.drive(point)
    watch.until(lambda _: station.standing)
    mark = watch.mark
    station.record()
    watch.heard(f"{point} recorded", mark)


def record_checks(station: Station, watch: Watch) -> None:
    """Record the points by which a photo that was laid in again is checked."""
    while checks := station.snapshot().checks:
        left = len(checks)
        if station.snapshot().target != checks[0]:
            station.drive(checks[0])
        watch.until(lambda _: station.standing)
        station.record()
        watch.until(lambda p, left=left: len(p.checks) < left)


def record_all(station: Station, watch: Watch) -> None:
    while (point := station.snapshot().next_point) is not None:
        record(station, watch, point)


def test_the_models_are_those_of_a_stereo_plotter(tmp_path: Path) -> None:
    found = []
    for name, profile in (("stereo", "simulated"), ("mono", GAUGES)):
        bench = bench_in(tmp_path / name, photos=4)
        with bench.stack:
            station, _ = open_on(bench, profile)
            finish(station)
            found.append(solutions(station))
            assert station.points_written
            station.close()
        assert replay_session(bench.folder).differences == ()
    stereo, mono = found
    assert [s.name for s in mono] == ["101/102", "102/103", "103/104"]
    # in the first model the same pointings, so the same table
    for was, row in zip(stereo[0].table, mono[0].table, strict=True):
        assert row.residual == pytest.approx(was.residual, abs=1e-6)
    for was_model, now in zip(stereo, mono, strict=True):
        assert now.redundancy == was_model.redundancy
        assert now.ties == was_model.ties
        assert not now.flagged
        assert now.base == pytest.approx(was_model.base, abs=0.1)
        assert now.rotation == pytest.approx(was_model.rotation, abs=5e-4)
        for was, row in zip(was_model.table, now.table, strict=True):
            assert row.key == was.key
            assert row.r == pytest.approx(was.r, abs=0.02)
            assert row.residual == pytest.approx(was.residual, abs=25.0)


def test_a_tablet_serves_as_a_comparator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tablet = quick_tablet(tmp_path / "config", monkeypatch.setenv)
    # a step is 127 um
    bench = bench_in(tmp_path / "block", fiducials=True, image_um=40.0)
    with bench.stack:
        station, _ = open_on(bench, tablet, time_scale=4.0)
        finish(station)
        truth = [math.degrees(angle) for angle in solutions(station)[0].rotation]
        station.close()
    stereo = bench_in(tmp_path / "stereo", fiducials=True, image_um=40.0)
    with stereo.stack:
        station, _ = open_on(stereo, "simulated")
        finish(station)
        wanted = [math.degrees(angle) for angle in solutions(station)[0].rotation]
        station.close()
    assert truth == pytest.approx(wanted, abs=0.15)
    replayed = replay_session(bench.folder)
    assert replayed.differences == ()
    # eight fiducials in each of three photos, 26 points in the first model, 13 of photo 103 and
    # eight more of photo 102 in the second
    assert replayed.measurements == 24 + 26 + 13 + 8


def test_photos_are_asked_for_and_not_more_often_than_needed(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, watch = open_on(bench, GAUGES)
        picture = station.snapshot()
        assert picture.expected == "lay photo 101 into the comparator: next model, 101 / 102"
        station.next_model()
        picture = station.snapshot()
        assert (picture.mono, picture.laid) == (True, "101")
        assert picture.expected.endswith("in photo 101: 13 of 13 points to go")
        record_all(station, watch)
        picture = station.snapshot()
        assert picture.next_photo == "102"
        assert picture.expected == "lay photo 102 into the comparator: 13 points to go"
        assert {p.status for p in picture.points} == {"pending"}
        assert {p.seen for p in picture.points} == {("left",)}
        assert picture.solution is None
        station.next_model()
        assert station.snapshot().laid == "102"
        record_all(station, watch)
        assert station.snapshot().expected == "accept the model"
        station.accept()
        assert "102" in station.snapshot().expected
        station.next_model()
        # it lies there still, and its five ties are measured
        picture = station.snapshot()
        assert picture.laid == "102"
        ties = [p.point for p in picture.points if p.role == "tie"]
        assert len(ties) == 5
        assert [p.point for p in picture.points if p.seen] == ties
        assert picture.expected.endswith("in photo 102: 8 of 13 points to go")
        record_all(station, watch)
        assert station.snapshot().next_photo == "103"
        station.close()
    out = io.StringIO()
    watched = ReplayStation(bench.folder, 1e6)
    assert watched.run(out) == 0
    assert out.getvalue().count("laid into the comparator") == 2
    assert "101/102: 101-8 recorded in photo 102" in out.getvalue()
    with pytest.raises(InputError, match="replay"):
        watched.other_photo()
    laid = [payload["photo"] for payload in bench.payloads(PhotoLaid.kind)]
    assert laid == ["101", "102"]
    assert len(bench.payloads(MonoMeasured.kind)) == 13 + 13 + 8
    assert replay_session(bench.folder).differences == ()


def test_a_flagged_point_is_measured_again_in_the_photo_that_lies_there(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block", photos=2)
    wrong = {("101", "102", "101-8"): Offsets(dyl=0.2, count=1)}
    with bench.stack:
        station, watch = open_on(bench, GAUGES, mistakes=wrong)
        for _ in range(2):
            station.next_model()
            record_all_once(station, watch)
        picture = station.snapshot()
        assert picture.diagnosis is not None
        assert picture.diagnosis.suspects[0] == ("101-8", "y")
        assert picture.expected.startswith("remeasure 101-8 in photo 102, or switch")
        assert picture.next_photo is None
        record(station, watch, "101-8")
        # it was the other photo
        picture = station.snapshot()
        assert picture.next_photo == "101"
        assert picture.expected.startswith("lay photo 101 in again to remeasure 101-8 there")
        station.next_model()
        # nothing says how it lies but what is on record of it
        assert len(station.snapshot().checks) == 2
        record_checks(station, watch)
        record(station, watch, "101-8")
        picture = station.snapshot()
        assert picture.expected == "accept the model"
        assert next(p.times for p in picture.points if p.point == "101-8") == 3
        station.accept()
        station.close()
    assert replay_session(bench.folder).differences == ()


def record_all_once(station: Station, watch: Watch) -> None:
    """Measure what is pending in the photo that lies in."""
    side = "left" if station.snapshot().laid == station.snapshot().left else "right"
    for point in [p.point for p in station.snapshot().points if side not in p.seen]:
        record(station, watch, point)


@pytest.mark.parametrize("fiducials", [True, False])
def test_the_automatic_operator_changes_photos_for_a_mistake(
    tmp_path: Path, fiducials: bool
) -> None:
    bench = bench_in(tmp_path / "block", photos=2, fiducials=fiducials)
    wrong = {("101", "102", "101-8"): Offsets(dyl=0.2, count=1)}
    with bench.stack:
        station, _ = open_on(bench, GAUGES, mistakes=wrong)
        operator = finish(station)
        [model] = operator.records
        assert [(h.point, h.action) for h in model.handled] == [("101-8", "measured again")] * 2
        assert model.after is not None
        assert not model.after.flagged
        station.close()
    # plates lie anew: inner orientation of photo 101 twice, or two points that are checked
    oriented = [p["photo"] for p in bench.payloads("inner-accepted")]
    assert oriented == (["101", "102", "101"] if fiducials else [])
    assert len(bench.payloads("point-checked")) == (0 if fiducials else 2)
    assert replay_session(bench.folder).differences == ()


def test_a_job_goes_on_where_it_was_left(tmp_path: Path) -> None:
    whole = bench_in(tmp_path / "whole", fiducials=True)
    with whole.stack:
        station, _ = open_on(whole, GAUGES)
        finish(station)
        wanted = [s.table for s in solutions(station)]
        station.close()
    bench = bench_in(tmp_path / "block", fiducials=True)
    with bench.stack:
        for measured in (3, 8, 17, 26, 30):
            station, watch = open_on(bench, GAUGES)
            watch.controls.set_automatic(True)

            def done(_: object, least: int = measured) -> bool:
                return len(bench.payloads(MonoMeasured.kind)) >= least

            watch.until(done)
            watch.controls.set_automatic(False)
            station.close()
        station, _ = open_on(bench, GAUGES)
        finish(station)
        for table, solution in zip(wanted, solutions(station), strict=True):
            for was, row in zip(table, solution.table, strict=True):
                assert row.residual == pytest.approx(was.residual, abs=25.0)
        station.close()
    replayed = replay_session(bench.folder)
    assert replayed.differences == ()
    rebuild(replayed, tmp_path / "again")
    rows = read_block(tmp_path / "again").image_points
    assert rows == read_block(bench.folder).image_points


def test_what_was_measured_once_is_one_row(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, _ = open_on(bench, GAUGES)
        finish(station)
        models = solutions(station)
        first = read_block(bench.folder).image_points
        shared = [row for row in first if row.model is None]
        assert {row.photo for row in shared} == {"102"}
        assert sorted(row.point for row in shared) == sorted(models[1].ties)
        # every other row is of its model, and the models come out of the file as they were
        bridged = bridge_strip(read_block(bench.folder), station.block.strips[0]).models
        for solution, again in zip(models, bridged, strict=True):
            for row, other in zip(solution.table, again.table, strict=True):
                assert other.residual == pytest.approx(row.residual, abs=1e-3)
        station.undo()
        rows = read_block(bench.folder).image_points
        assert {row.model for row in rows} == {"101/102"}
        assert len(rows) == 26
        station.close()
        station, _watch = open_on(bench, GAUGES)
        station.accept()
        assert read_block(bench.folder).image_points == first


def test_an_undone_change_of_photos_asks_what_lies_there(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block", photos=2)
    with bench.stack:
        station, watch = open_on(bench, GAUGES)
        station.next_model()
        record_all_once(station, watch)
        station.other_photo()
        assert station.snapshot().laid == "102"
        station.undo()
        picture = station.snapshot()
        assert (picture.laid, picture.next_photo) == ("", "102")
        with pytest.raises(InputError, match="no photo lies in the comparator"):
            station.drive("101-8")
        with pytest.raises(InputError, match="no photo lies in the comparator"):
            station.record()
        station.next_model()
        assert station.snapshot().laid == "102"


def test_a_model_stays_with_its_kind_of_instrument(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block", photos=2)
    with bench.stack:
        station, _ = open_on(bench, GAUGES)
        station.next_model()
        station.close()
        station, _ = open_on(bench, "simulated")
        with pytest.raises(InputError, match="begun in a mono comparator"):
            station.drive("101-8")
        with pytest.raises(InputError, match="begun in a mono comparator"):
            station.record()
        station.undo()
        station.undo()
        assert station.snapshot().left == ""
        station.next_model()
        assert not station.snapshot().mono
        with pytest.raises(InputError, match="holds both photos"):
            station.other_photo()
        station.close()
        station, _watch = open_on(bench, GAUGES)
        with pytest.raises(InputError, match="holds both photos"):
            station.drive("101-8")


def test_a_point_is_added_in_one_photo_and_asked_for_in_the_other(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block", photos=2)
    with bench.stack:
        station, watch = open_on(bench, "heidenhain-nd720", auto_drive=False)
        station.next_model()
        record_all_once(station, watch)
        watch.until(lambda _: station.readout() is not None)
        read = station.readout()
        assert read is not None
        assert read.mono
        assert (read.xl, read.yl) == (read.xr, read.yr)
        station.add_point("extra")
        assert station.snapshot().target == "extra"
        current = station.state.current
        assert current is not None
        planned = current.planned("extra")
        assert planned is not None
        assert (planned.xl, planned.yl) == (read.xl, read.yl)
        assert planned.xr == pytest.approx(planned.xl - 92.0, abs=20.0)
        assert station.snapshot().expected.startswith("measure extra in photo 101")


def test_the_handwheels_of_a_comparator_move_its_one_plate(tmp_path: Path) -> None:
    bench = bench_in(tmp_path / "block")
    with bench.stack:
        station, watch = open_on(bench, GAUGES)
        station.next_model()
        watch.until(lambda _: station.standing)
        before = station.instrument.simulator.positions()
        watch.controls.turn(dx=0.5, dy=-0.25)
        after = station.instrument.simulator.positions()
        assert (after.xl - before.xl, after.yl - before.yl) == pytest.approx((0.5, -0.25))
        with pytest.raises(InputError, match="end of their travel"):
            watch.controls.turn(dx=4000.0)
