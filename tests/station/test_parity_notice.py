"""An instrument with parity behind a line that does not check it: the operator is told."""

from __future__ import annotations

from pathlib import Path

from anaplot.exchange.blockfolder import write_new_block
from anaplot.planning.synthetic import synthetic_strip
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.profile import load_profile
from anaplot.station.instrument import InstrumentSetup
from anaplot.station.station import Station


def test_the_screen_says_that_parity_is_not_checked(tmp_path: Path) -> None:
    write_new_block(tmp_path / "block", synthetic_strip(2, seed=1).block)
    told: list[str] = []
    for name, unchecked in (("heidenhain-nd720", True), ("anaplot-ascii-crc", False)):
        told.clear()
        with SimulatorServer(SimulatedPlotter(load_profile(name), {"1": {}, "2": {}})) as server:
            setup = InstrumentSetup(name, server.port)
            with Station(tmp_path / "block", plotter=setup, operator="tester") as station:
                station.subscribe_notices(lambda severity, text: told.append(text))
                assert station.snapshot().link.parity_unchecked is unchecked
        assert ("parity is not checked by this line" in told) is unchecked
