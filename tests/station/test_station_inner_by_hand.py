"""Inner orientation on an instrument without a drive: the operator finds the fiducials himself."""

from __future__ import annotations

import time
from math import hypot
from pathlib import Path

import pytest
from innerbench import inner_bench_in, inner_of, times
from stationbench import WAIT, Watch

from anaplot.errors import InputError
from anaplot.plotter.device.hand import HandSettled, fiducial_name
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position
from anaplot.simulation.laidplates import laid_photographs, random_placements
from anaplot.station.instrument import InstrumentSetup
from anaplot.station.replay import replay_session
from anaplot.station.station import Station

PROFILE = "heidenhain-nd281b"


def test_fiducials_are_recorded_in_the_order_of_the_certificate(tmp_path: Path) -> None:
    bench = inner_bench_in(tmp_path / "block")
    placements = random_placements(bench.made.block, 7)
    left, right = laid_photographs(bench.made.block, bench.made.truth, placements)
    settled: list[HandSettled] = []
    device = SimulatedPlotter(
        load_profile(PROFILE), left, in_right=right, noise_um=3.0, on_settled=settled.append
    )
    device.lay("101", "102")
    with bench.stack, SimulatorServer(device, time_scale=200.0) as server:
        ports = ",".join(f"{link}={port}" for link, port in server.ports.items())
        station = Station(bench.folder, plotter=InstrumentSetup(PROFILE, ports))
        bench.stack.callback(station.close)
        watch = Watch(station)
        watch.until(lambda p: p.link.state == "live")
        station.next_model()
        assert station.snapshot().target == "1"
        for side, laid in (("left", left["101"]), ("right", right["102"])):
            for name in "12345678":
                _point(station, watch, device, settled, side, laid, name)
            solution = inner_of(station).solution
            assert solution is not None
            assert not solution.flagged
            with pytest.raises(InputError, match="choose a fiducial first"):
                station.record()
            station.accept()
        assert station.snapshot().inner is None
        current = station.state.current
        assert current is not None
        for inner in current.inner:
            assert inner.accepted is not None
            found = inner.accepted.placement()
            true = placements[inner.photo, inner.side].placement()
            assert hypot(found.x - true.x, found.y - true.y) < 0.01
            assert found.rotation == pytest.approx(true.rotation, abs=1e-4)
        station.close()
    assert replay_session(bench.folder).differences == ()


def _point(
    station: Station,
    watch: Watch,
    device: SimulatedPlotter,
    settled: list[HandSettled],
    side: str,
    laid: dict[str, tuple[float, float]],
    name: str,
) -> None:
    """Have the hand move the plates to a fiducial, and record it with the key."""
    x, y = laid[fiducial_name(side, name)]  # type: ignore[arg-type]
    device.attend(side)  # type: ignore[arg-type]
    done = len(settled)
    there = Position(x + 1.0, y, 0.0, 0.0) if side == "left" else Position(0.0, 0.0, x + 1.0, y)
    device.hand_to(there)
    deadline = time.monotonic() + WAIT
    while not _stands(station, device, settled, done):
        assert time.monotonic() < deadline, watch.notices[-5:]
        with watch.condition:
            watch.condition.wait(0.01)
    station.record()
    watch.until(lambda _: times(station, name) == 1)


def _stands(
    station: Station, device: SimulatedPlotter, settled: list[HandSettled], done: int
) -> bool:
    read, true = station.readout(), device.positions()
    if len(settled) == done or read is None:
        return False
    at = (read.xl, read.yl) if read.plate_left else (read.xr, read.yr)
    wanted = (true.xl, true.yl) if read.plate_left else (true.xr, true.yr)
    return hypot(at[0] - wanted[0], at[1] - wanted[1]) < 0.002
