"""Closed, killed and opened again: nothing acknowledged is lost, and the work goes on."""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import automaticjob
import pytest
from journaltools import events_of
from processes import ROOT, running
from stationbench import Bench, measure, measure_all

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.journal import read_journal
from anaplot.exchange.recordline import encode_line
from anaplot.exchange.salvage import read_what_can_be_read
from anaplot.plotter.device.hand import Offsets
from anaplot.session import state as state_module
from anaplot.session.events import FiducialMeasured, PointMeasured
from anaplot.session.state import SessionState, fold, start
from anaplot.simulation.demo import Demo
from anaplot.simulation.instrument import SimulatedInstrument
from anaplot.station import restored
from anaplot.station.replay import replay_session
from anaplot.station.replayed import ReplayStation
from anaplot.station.sessionlog import read_log
from anaplot.station.station import Station

MODELS, SEED = 2, 3
KILLS = 25  # of each of four jobs


class Jobs:
    """Jobs of the automatic operator in `folder`, each in a process that may be killed."""

    def __init__(self, process: subprocess.Popen[str], fiducials: bool) -> None:
        self._process = process
        self._fiducials = fiducials

    def run(
        self, folder: Path, kill_after: int | None = None, more_bytes: int = 0
    ) -> tuple[list[str], bool]:
        """Run a job until it has said so many lines, and a little on; then kill it.

        Returns the lines, and whether it finished.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([str(folder), MODELS, SEED, self._fiducials]) + "\n")
        self._process.stdin.flush()
        said, _, number = self._process.stdout.readline().partition(" ")
        assert said == "process"
        lines: list[str] = []
        for line in self._process.stdout:
            if line.startswith("ended "):
                break
            lines.append(line.strip())
            if len(lines) == kill_after:
                _kill_somewhere(folder, more_bytes, int(number))
        finished = lines[-1:] == ["finished"]
        assert not any("Traceback" in said for said in lines), lines
        assert finished or kill_after is not None, lines
        return lines, finished


@contextmanager
def jobs(folder: Path, fiducials: bool) -> Iterator[Jobs]:
    with running(
        [sys.executable, automaticjob.__file__],
        stdin=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        # what a killed process leaves behind goes with the test's own folder
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(folder)},
    ) as process:
        yield Jobs(process, fiducials)


def _written(folder: Path) -> int:
    return sum(path.stat().st_size for path in (folder / "sessions").glob("*.jsonl"))


def _kill_somewhere(folder: Path, more_bytes: int, process: int) -> None:
    """Kill when so many more bytes are in the journal: in the middle of whatever is going on."""
    enough = _written(folder) + more_bytes
    with contextlib.suppress(ProcessLookupError):  # it has ended
        while _written(folder) < enough:
            os.kill(process, 0)
        os.kill(process, signal.SIGKILL)


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


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="jobs are forks")
@pytest.mark.parametrize(("chance", "fiducials"), [(0, False), (1, False), (2, False), (3, True)])
def test_killed_again_and_again_the_job_ends_as_if_undisturbed(
    tmp_path: Path, chance: int, fiducials: bool
) -> None:
    calm = tmp_path / "calm"
    rng = random.Random(chance)
    killed = done = 0
    with jobs(tmp_path, fiducials) as work:
        work.run(calm)
        one, _ = recovered(calm)
        assert len(one.models) == MODELS
        assert any(m.times > 1 for model in one.models for m in model.measured)
        while killed < KILLS:
            done += 1
            folder = tmp_path / f"killed-{done}"
            killed += _killed_job(work, folder, KILLS - killed, rng)
            other, events = recovered(folder)
            assert other == one
            written = (folder / "image_points.csv").read_bytes()
            assert written == (calm / "image_points.csv").read_bytes()
            assert len(events) > 13 * MODELS


def _killed_job(work: Jobs, folder: Path, most: int, rng: random.Random) -> int:
    """Do a job, killed as often as it takes or so many times; returns how often it was."""
    acknowledged: list[str] = []
    kills = 0
    while True:
        kill_after = rng.randint(1, 2) if kills < most else None
        lines, finished = work.run(folder, kill_after, rng.randint(0, 900))
        # a point that is checked only, after photos were laid in anew, is told and not recorded
        acknowledged += [
            _recorded(line)
            for line in lines
            if line.startswith("record ") and "is where it is on record" not in line
        ]
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


def test_snapshots_of_a_session_say_what_its_events_lead_to(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(restored, "SPACING", 10)
    station, watch = bench.open()
    for _ in range(2):
        station.next_model()
        measure_all(station, watch)
        station.accept()
    station.undo()
    before = station.state
    station.close()
    folder = bench.folder
    kinds = [record.kind for record in read_journal(folder).records]
    assert kinds.count("snapshot") == kinds.count("snapshot-part") == 2
    replayed = replay_session(folder)
    assert (replayed.state, replayed.differences) == (before, ())


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


def test_so_it_does_behind_a_snapshot(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state_module, "HISTORY", 8)
    monkeypatch.setattr(restored, "SPACING", 10)
    station, watch = bench.open()
    for _ in range(2):
        station.next_model()
        measure_all(station, watch)
        measure(station, watch, station.snapshot().points[0].point)
        station.undo()
        station.accept()
    station.close()
    folds: list[bool] = []
    real = restored.PastReading.past

    def past_of(reading: restored.PastReading) -> restored.Past:
        past = real(reading)
        folds.append(past.folded == past.count)
        return past

    monkeypatch.setattr(restored.PastReading, "past", past_of)
    pointed = []
    for behind in (10, 1_000_000):
        monkeypatch.setattr(restored, "_BEHIND", behind)
        again, _ = bench.open()
        assert isinstance(again.instrument, SimulatedInstrument)
        pointed.append(again.instrument.simulator.pointed)
        again.close()
    assert folds == [False, True]
    assert pointed[0] == pointed[1]
    assert max(pointed[0].values()) > 1


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


def test_a_kind_of_record_that_is_not_known(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    station, _ = bench.open()
    station.close()
    path = bench.folder / "sessions" / "0001.jsonl"
    last = json.loads(path.read_bytes().splitlines()[-1])
    with path.open("ab") as file:
        file.write(encode_line(last["seq"] + 1, last["t"], "point-dreamt", {"point": "1"}))
    newer = path.read_bytes()
    told = rf"0001\.jsonl line {newer.count(10)}: .*kind 'point-dreamt'.* newer version"
    readers = (partial(Station, plotter=bench.setup()), read_log, replay_session)
    for reader in (*readers, partial(ReplayStation, speed=1.0), read_what_can_be_read):
        with pytest.raises(InputError, match=told):
            reader(bench.folder)
    assert main(["status", str(bench.folder)]) == 0
    assert re.search(told, capsys.readouterr().out)
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
