"""The simulated plotter as a process of its own, worked over its port like any instrument."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from processes import ROOT, running
from programs import at_terminal

from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block, write_new_block
from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.demo import rough
from anaplot.simulation.opening import truth_of
from anaplot.station.instrument import InstrumentSetup
from anaplot.station.snapshot import Snapshot
from anaplot.station.station import Station

SESSION = ROOT / "tests" / "sessions" / "fiducials.jsonl"


def test_inner_orientation_and_a_model_over_the_port_of_another_process(tmp_path: Path) -> None:
    truth = tmp_path / "truth"
    assert main(["replay", str(SESSION), "--to", str(truth)]) == 0
    block = tmp_path / "block"
    write_new_block(block, read_block(truth))
    port = tmp_path / "port"
    command = [sys.executable, "-m", "anaplot", "plotter", "sim", "simulated", "--auto-pedal"]
    options = ["--truth", str(truth), "--link", str(port), "--time-scale", "200"]
    with running([*command, *options, "--lay", "101/102"], stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert "SIMULATED" in process.stdout.readline()
        tell = process.stdin
        asked: list[str] = []

        def attend(picture: Snapshot) -> None:
            wanted = "points" if picture.inner is None else picture.inner.side
            if asked[-1:] != [wanted]:
                asked.append(wanted)
                tell.write(f"attend {wanted}\n")
                tell.flush()

        with Station(
            block,
            plotter=InstrumentSetup("simulated", str(port)),
            candidates=rough(truth_of(truth)),
        ) as station:
            station.subscribe(attend)
            AutomaticOperator(station).run()
            models = station.state.models
        tell.write("quit\n")
        tell.flush()
        process.communicate(timeout=60)
    # what was there before the first model may be seen, or not
    assert asked[-3:] == ["left", "right", "points"]
    (model,) = models
    assert len(model.measured) == 13
    assert [inner.accepted is not None for inner in model.inner] == [True, True]
    assert process.returncode == 0
    assert main(["replay", str(block), "--check"]) == 0


@pytest.mark.slow
def test_the_simulator_goes_on_in_the_background_of_an_interactive_shell(tmp_path: Path) -> None:
    """A terminal stops what reads from it in the background."""
    sim = f"{sys.executable} -m anaplot plotter sim anaplot-ascii --link ./port"
    with at_terminal(
        [sys.executable, "-c", "import pty; pty.spawn(['bash', '--norc', '-i'])"], tmp_path
    ) as shell:
        shell.until(lambda screen: screen.strip())  # the prompt
        shell.type(f"{sim} &\r")
        shell.until(lambda screen: "SIMULATED  anaplot" in screen)
        watch = f"{sys.executable} -m anaplot plotter watch ./port anaplot-ascii --seconds 1"
        shell.type(f"clear; {watch}; jobs; kill %1\r")
        shell.until(lambda screen: "link      live" in screen and "Running" in screen)
        shell.type("exit\r")
