"""A return to an accepted model through the simulated plotter, and what the journal keeps of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from innerbench import inner_bench_in, orient
from stationbench import Bench, Watch, measure, measure_all, settled

from anaplot.exchange.blockfolder import read_block
from anaplot.orientation.strip import bridge_strip
from anaplot.session.models import solve
from anaplot.station.blockstatus import status_of
from anaplot.station.replay import replay_session
from anaplot.station.salvage import salvage
from anaplot.station.sessionlog import read_log
from anaplot.station.station import Station


def checked(station: Station, watch: Watch) -> None:
    """Record the points by which it is checked how the photos lie."""
    while station.snapshot().checks:
        left = len(station.snapshot().checks)
        settled(watch)
        station.record()
        watch.until(lambda p, left=left: len(p.checks) < left)


def assert_kept(bench: Bench, station: Station, tmp_path: Path) -> None:
    """What the journal says is the state, by replay, salvage and when it is opened again."""
    station.close()
    replayed = replay_session(bench.folder)
    assert replayed.differences == ()
    assert replayed.state == station.state
    brought = salvage(bench.folder, tmp_path / "salvaged")
    assert (brought.state, brought.left_out, brought.assumed) == (station.state, (), ())
    again, _ = bench.open(plotter=False)
    assert again.state == station.state
    block = read_block(bench.folder)
    bridged = bridge_strip(block, block.strips[0])
    for model, solution in zip(station.state.models, bridged.models, strict=True):
        assert solution.listed == solve(station.state, model).listed


@pytest.mark.slow
def test_a_return_through_the_line(bench: Bench, tmp_path: Path) -> None:
    station, watch = bench.open()
    for _ in range(2):
        station.next_model()
        measure_all(station, watch)
        station.accept()
    station.next_model()
    first = station.snapshot().points[0].point
    measure(station, watch, first)
    rows, models = bench.csv(), station.state.models
    point = models[0].plan[-1].point
    station.return_to("101", "102", point)
    now = station.snapshot()
    assert (now.left, now.right, now.reopened) == ("101", "102", True)
    assert station.state.returned.parked.photos == ("103", "104")
    assert station.instrument is not None
    assert station.instrument.simulator.laid == ("101", "102")  # type: ignore[attr-defined]
    checked(station, watch)
    assert bench.csv() == rows
    assert watch.until(lambda p: p.target == point).next_point == point
    measure(station, watch, point)
    assert bench.csv() == rows  # the accepted version stands in the file
    station.accept()
    now = station.snapshot()
    assert (now.left, now.right, now.reopened) == ("103", "104", False)
    assert bench.csv() != rows
    assert now.accepted == (("101", "102"), ("102", "103"))
    # the photos of the model that waited lie anew, too
    checked(station, watch)
    assert [p.times for p in station.snapshot().points if p.point == first] == [1]
    measure_all(station, watch)
    station.accept()
    changed = station.state.models[0].measurement(point)
    assert changed is not None
    assert changed.times == 2
    status = status_of(station.block, station.state, None, "x")
    assert next(m.state for m in status.strips[0].models) == "accepted"
    assert {(one.left, one.right) for one in status.recomputed} == {
        (m.left, m.right) for m in status.strips[0].models if m.state == "recomputed"
    }
    assert bench.kinds().count("model-reopened") == 1
    assert bench.kinds().count("point-checked") == 3
    log = [one.what for one in read_log(bench.folder)]
    assert log.count("reopened") == 1
    assert log[log.index("reopened") + 1] == "remeasured"
    assert_kept(bench, station, tmp_path)


@pytest.mark.slow
def test_both_photos_are_oriented_anew(tmp_path: Path) -> None:
    inner_bench = inner_bench_in(tmp_path / "inner")
    with inner_bench.stack:
        station, watch = inner_bench.open()
        station.next_model()
        orient(station, watch)
        measure_all(station, watch)
        station.accept()
        rows, models = inner_bench.csv(), station.state.models
        station.return_to("101", "102")
        station.accept()  # and left again, as it was
        assert (station.state.models, inner_bench.csv()) == (models, rows)
        station.return_to("101", "102")
        orient(station, watch)
        assert station.snapshot().checks == ()
        measure(station, watch, models[0].plan[3].point)
        station.accept()
        assert [m.times for m in station.state.models[0].measured].count(2) == 1
        assert_kept(inner_bench, station, tmp_path)
