"""Closed, killed and opened again: nothing acknowledged is lost, and the work goes on."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import automaticjob
import pytest
from stationbench import Bench, measure, measure_all

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_block_toml
from anaplot.exchange.journal import events_of, read_journal
from anaplot.plotter.simulator import Offsets
from anaplot.session.events import FiducialMeasured, PointMeasured
from anaplot.session.state import SessionState, fold, start
from anaplot.station.demo import Demo
from anaplot.station.station import Station

ROOT = Path(automaticjob.__file__).parents[2]
MODELS, SEED = 2, 3
KILLS = 25  # of each of four jobs


def environment(folder: Path) -> dict[str, str]:
    # what a killed process leaves behind goes with the test's own folder
    return {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(folder.parent)}


def _written(folder: Path) -> int:
    return sum(path.stat().st_size for path in (folder / "sessions").glob("*.jsonl"))


def _somewhere(folder: Path, more_bytes: int, process: subprocess.Popen[str]) -> None:
    """Wait until so many more bytes are in the journal: in the middle of whatever is going on."""
    enough = _written(folder) + more_bytes
    while _written(folder) < enough and process.poll() is None:
        pass


def run_job(
    folder: Path,
    kill_after: int | None,
    seed: int = SEED,
    more: tuple[str, ...] = (),
    more_bytes: int = 0,
) -> tuple[list[str], bool]:
    """Run the job until it has said so many lines, and a little on; then kill it.

    Returns the lines, and whether it finished.
    """
    with subprocess.Popen(
        [sys.executable, automaticjob.__file__, str(folder), str(MODELS), str(seed), *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(folder),
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        lines = []
        for line in process.stdout:
            lines.append(line.strip())
            if kill_after is not None and len(lines) >= kill_after:
                _somewhere(folder, more_bytes, process)
                process.kill()
                break
        lines += [line.strip() for line in process.stdout]
        errors = process.stderr.read()
        process.wait()
    finished = lines[-1:] == ["finished"]
    assert "Traceback" not in errors, errors
    assert finished or kill_after is not None, errors
    return lines, finished


def _recorded(line: str) -> str:
    """What "record 102-1 recorded" or "record fiducial 3 recorded" speaks of."""
    return line.removeprefix("record ").removesuffix(" recorded")


def _name(event: PointMeasured | FiducialMeasured) -> str:
    if isinstance(event, FiducialMeasured):
        return f"fiducial {event.fiducial}"
    return event.point


def recovered(folder: Path) -> tuple[SessionState, list[PointMeasured | FiducialMeasured]]:
    events = events_of(read_journal(folder).records)
    state = fold(start(read_block(folder)), events)
    return state, [e for e in events if isinstance(e, PointMeasured | FiducialMeasured)]


@pytest.mark.parametrize(("chance", "more"), [(0, ()), (1, ()), (2, ()), (3, ("fiducials",))])
def test_killed_again_and_again_the_job_ends_as_if_undisturbed(
    tmp_path: Path, chance: int, more: tuple[str, ...]
) -> None:
    calm = tmp_path / "calm"
    run_job(calm, None, more=more)
    one, _ = recovered(calm)
    assert len(one.models) == MODELS
    assert any(m.times > 1 for model in one.models for m in model.measured)
    rng = random.Random(chance)
    kills = jobs = 0
    while kills < KILLS:
        jobs += 1
        folder = tmp_path / f"killed-{jobs}"
        kills += _killed_job(folder, KILLS - kills, rng, more)
        other, events = recovered(folder)
        assert other == one
        written = (folder / "image_points.csv").read_bytes()
        assert written == (calm / "image_points.csv").read_bytes()
        assert len(events) > 13 * MODELS


def _killed_job(folder: Path, most: int, rng: random.Random, more: tuple[str, ...]) -> int:
    """Do a job, killed as often as it takes or so many times; returns how often it was."""
    acknowledged: list[str] = []
    kills = 0
    while True:
        kill_after = rng.randint(1, 2) if kills < most else None
        lines, finished = run_job(folder, kill_after, more=more, more_bytes=rng.randint(0, 900))
        acknowledged += [_recorded(line) for line in lines if line.startswith("record ")]
        _, measured = recovered(folder)
        # what was told is on disk, in that order
        journaled = iter([_name(event) for event in measured])
        assert all(any(point == other for other in journaled) for point in acknowledged)
        if finished:
            return kills
        kills += 1
        assert kills < 60


def test_reopened_the_state_is_equal(bench: Bench) -> None:
    station, watch = bench.open(mistakes={("102", "103", "103-2"): Offsets(dyr=0.2)})
    station.next_model()
    measure_all(station, watch)
    station.switch("102-1", "y", False)
    station.accept()
    station.next_model()
    measure_all(station, watch)
    station.undo()
    station.switch("102-2", "x", False)
    station.suspend()
    before, picture = station.state, station.snapshot()
    written = bench.csv()
    station.close()
    again, _ = bench.open()
    assert again.state == before
    assert again.state._history == before._history
    assert bench.csv() == written
    after = again.snapshot()
    assert (after.points, after.accepted, after.expected) == (
        picture.points,
        picture.accepted,
        picture.expected,
    )
    assert (after.solution is None) == (picture.solution is None)
    if picture.solution is not None and after.solution is not None:
        assert after.solution.table == picture.solution.table
    again.resume()
    again.undo()
    assert again.state.current is not None
    assert again.state.current.off == frozenset()


def test_after_reopening_nothing_is_recorded_before_a_drive(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure(station, watch, station.snapshot().points[0].point)
    station.close()
    again, watch = bench.open()
    watch.until(lambda _: again.readout() is not None)
    with pytest.raises(InputError, match="drive to a point first"):
        again.record()
    measure(again, watch, again.snapshot().points[1].point)


def test_the_simulated_hand_goes_on_where_it_was(bench: Bench) -> None:
    mistakes = {("101", "102", "102-2"): Offsets(dyr=0.2)}
    station, watch = bench.open(mistakes=mistakes)
    station.next_model()
    measure_all(station, watch)
    assert station.snapshot().next_point == "102-2"
    station.close()
    again, watch = bench.open(mistakes=mistakes)
    measure(again, watch, "102-2")
    # the mistake was made once, yesterday
    picture = again.snapshot()
    assert picture.solution is not None
    assert not picture.solution.flagged


def test_points_not_written_before_the_end_are_written_at_the_next_start(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.accept()
    written = bench.csv()
    station.close()
    (bench.folder / "image_points.csv").unlink()
    bench.open()
    assert bench.csv() == written


def test_a_journal_that_does_not_fit_the_block(bench: Bench) -> None:
    station, _ = bench.open()
    station.next_model()
    station.close()
    toml = bench.folder / "block.toml"
    toml.write_text(toml.read_text().replace('"101", "102", "103"', '"103", "102", "101"'))
    with pytest.raises(InputError, match=r"0001\.jsonl line 3: does not fit block\.toml"):
        Station(bench.folder)


def test_a_journal_of_a_newer_version(bench: Bench) -> None:
    station, _ = bench.open()
    station.close()
    path = bench.folder / "sessions" / "0001.jsonl"
    newer = path.read_bytes().replace(b'"format":1', b'"format":2')
    path.write_bytes(newer)
    with pytest.raises(InputError, match="newer version"):
        Station(bench.folder, plotter=bench.setup())
    assert path.read_bytes() == newer


def test_two_stations_on_one_block(bench: Bench) -> None:
    station, watch = bench.open()
    with pytest.raises(InputError, match="open in another anaplot") as caught:
        Station(bench.folder, plotter=bench.setup())
    assert caught.value.exit_code == 2
    # the first one does not even notice
    station.next_model()
    measure(station, watch, station.snapshot().points[0].point)
    station.close()
    bench.open()


def test_what_a_killed_session_left_is_cleared_under_the_lock(bench: Bench) -> None:
    left = bench.folder / ".image_points.csv.0123456789ab.tmp"
    station, _ = bench.open()
    left.write_bytes(b"half")
    with pytest.raises(InputError, match="open in another anaplot"):
        Station(bench.folder)
    assert left.exists()
    station.close()
    bench.open()
    assert not left.exists()


def test_a_demo_is_not_written_over_another(tmp_path: Path) -> None:
    demo = Demo.make(1, 1)
    demo.write(tmp_path)
    with pytest.raises(InputError, match="exists already"):
        demo.write(tmp_path)
    with pytest.raises(InputError, match="exists already"):
        write_block_toml(tmp_path, demo.strip.block)
