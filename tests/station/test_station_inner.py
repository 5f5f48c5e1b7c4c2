"""Inner orientation at the station, over a real line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import hypot
from pathlib import Path

import numpy as np
import pytest
from innerbench import (
    inner_bench_in,
    inner_of,
    measure_fiducial,
    measure_fiducials,
    orient,
    times,
)
from sessionscene import however_it_lies
from stationbench import Bench, measure, measure_all, settled

from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import read_block
from anaplot.orientation.strip import bridge_strip
from anaplot.plotter.device.hand import Offsets, fiducial_name
from anaplot.plotter.readings import Position
from anaplot.session.models import solve
from anaplot.session.plates import IN_IMAGE, image_of, plate_of, plates_of
from anaplot.simulation.laidplates import laid_photographs, random_placements
from anaplot.station.rebuild import rebuild
from anaplot.station.replay import replay_session
from anaplot.station.replayed import ReplayStation
from anaplot.station.station import Station


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = inner_bench_in(tmp_path / "block")
    with made.stack:
        yield made


# -- measuring -----------------------------------------------------------------------------------


@pytest.mark.parametrize("tcp", [False, True])
def test_a_model_begins_with_the_inner_orientation_of_both_photos(bench: Bench, tcp: bool) -> None:
    station, watch = bench.open(tcp=tcp)
    station.next_model()
    first = station.snapshot()
    assert inner_of(station).photo == "101"
    # the plates drive to the first fiducial by themselves
    assert first.target == first.next_point == "1"
    assert first.expected == "measure fiducial 1 of photo 101 (left): 8 of 8 to go"
    said = station.snapshot().status
    assert said is not None
    assert said.next.words == "measure fiducial 1 of photo 101"
    measure_fiducial(station, watch, "1")
    said = station.snapshot().status
    assert said is not None
    assert "needs 3 fiducials" in station.snapshot().problem
    assert said.weak_spots == ()
    measure_fiducials(station, watch)
    said = station.snapshot().status
    assert said is not None
    assert said.next.words == "accept the inner orientation of photo 101"
    inner = inner_of(station)
    assert inner.solution is not None
    assert (inner.solution.kind, inner.solution.redundancy) == ("bilinear", 8)
    assert not inner.solution.flagged
    assert ("record", "fiducial 8 recorded") in watch.notices
    station.accept()
    inner = inner_of(station)
    assert (inner.photo, inner.side) == ("102", "right")
    assert station.snapshot().target == "1"
    measure_fiducials(station, watch)
    station.accept()
    # and then to the first point
    picture = station.snapshot()
    assert picture.inner is None
    assert picture.target == picture.points[0].point
    assert [i.accepted for i in picture.inners] == [True, True]
    words = "inner orientation of photo 102 (right) accepted: the bilinear transformation"
    assert ("info", words) in watch.notices
    measure_all(station, watch)
    station.accept()
    block = read_block(bench.folder)
    bridged = bridge_strip(block, block.strips[0])
    assert bridged.models[0].table == solve(station.state, station.state.models[0]).table
    kinds = bench.kinds()
    assert kinds.count("fiducial-measured") == 16
    assert kinds.count("inner-accepted") == 2
    assert kinds.count("inner-table") == 2 * 6


def test_the_pedal_does_it_all_but_accepting(bench: Bench) -> None:
    station, watch = bench.open(pedal=True)
    station.next_model()
    picture = watch.until(lambda p: p.inner is not None and p.may_accept and p.target is None)
    assert picture.inner is not None
    assert all(f.times == 1 for f in picture.inner.fiducials)
    assert {event["switch"] for event in bench.payloads("fiducial-measured")} == {"pedal"}


def test_what_was_measured_agrees_with_the_ideal_truth(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    orient(station, watch)
    measure_all(station, watch)
    station.accept()
    rows = read_block(bench.folder).image_points
    assert len(rows) == 26
    gaps = [
        (row.x - x, row.y - y) for row in rows for x, y in [bench.made.truth[row.photo][row.point]]
    ]
    # 3 um of the pointing, and as much of eight fiducials
    assert max(hypot(*gap) for gap in gaps) < 0.025
    assert np.sqrt(np.mean(np.square(gaps))) < 0.006
    # on the plates they lie millimetres away
    left, _ = laid_photographs(
        bench.made.block, bench.made.truth, random_placements(bench.made.block, 7)
    )
    shift = [
        hypot(x - left["101"][name][0], y - left["101"][name][1])
        for name, (x, y) in bench.made.truth["101"].items()
    ]
    assert max(shift) > 0.5


def test_the_readout_says_which_coordinates_are_the_plates(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    for flags in ((True, True), (False, True)):
        settled(watch)
        read = station.readout()
        assert read is not None
        assert (read.plate_left, read.plate_right) == flags
        measure_fiducials(station, watch)
        station.accept()
    settled(watch)
    read = station.readout()
    assert read is not None
    assert (read.plate_left, read.plate_right) == (False, False)
    point = station.snapshot().points[0].point
    assert read.xl == pytest.approx(bench.made.truth["101"][point][0], abs=0.02)


def test_the_other_plate_waits_in_its_middle(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    assert station.instrument is not None
    simulator = station.instrument.simulator
    assert simulator is not None
    settled(watch)
    there = simulator.positions()
    assert (there.xr, there.yr) == (0.0, 0.0)
    measure_fiducials(station, watch)
    station.accept()
    settled(watch)
    there = simulator.positions()
    assert (there.xl, there.yl) == (0.0, 0.0)
    assert hypot(there.xr, there.yr) > 100.0


def test_a_wrong_fiducial_is_found_and_measured_again(bench: Bench) -> None:
    key = ("101", "102", fiducial_name("left", "3"))
    station, watch = bench.open(mistakes={key: Offsets(dyl=0.15)})
    station.next_model()
    measure_fiducials(station, watch)
    picture = station.snapshot()
    inner = inner_of(station)
    assert picture.next_point == "3"
    assert picture.expected.startswith("remeasure fiducial 3")
    assert inner.suspects[0] == ("3", "y")
    assert [f.fiducial for f in inner.fiducials if f.status == "flagged"].count("3") == 1
    assert watch.heard("flagged: ").count("3 y") == 1
    assert inner.advice[0].startswith("remeasure 3 (y)")
    measure_fiducial(station, watch, "3")
    inner = inner_of(station)
    assert inner.solution is not None
    assert not inner.solution.flagged
    assert times(station, "3") == 2


def test_fiducials_are_switched(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_fiducials(station, watch)
    whole = inner_of(station).solution
    assert whole is not None
    station.switch("5", "y", False)
    inner = inner_of(station)
    assert inner.solution is not None
    assert inner.solution.redundancy == whole.redundancy - 1
    view = next(f for f in inner.fiducials if f.fiducial == "5")
    assert (view.status, view.off_axes) == ("measured", ("y",))
    station.switch("5", None, False)
    inner = inner_of(station)
    assert next(f.status for f in inner.fiducials if f.fiducial == "5") == "off"
    assert inner.advice[-1] == "switched off: 5 x, 5 y"
    station.switch("5", None, True)
    assert inner_of(station).solution is whole
    with pytest.raises(InputError, match="fiducial 9 of photo 101"):
        station.switch("9", None, False)


def test_the_next_model_looks_where_the_last_photo_lay(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    orient(station, watch)
    measure_all(station, watch)
    station.accept()
    station.next_model()
    inner = inner_of(station)
    assert (inner.photo, inner.side) == ("102", "left")
    before = station.state.models[0].inner_of("left")
    assert before is not None
    assert before.accepted is not None
    target = station.desk.drive_target
    assert target is not None
    mark = station.block.cameras[0].calibration
    assert mark is not None
    place = before.accepted.to_plate(np.array([mark.fiducials[0][1:]]))[0]
    assert (target.xl, target.yl) == pytest.approx(tuple(place), abs=0.05)
    orient(station, watch)
    measure_all(station, watch)
    solution = station.snapshot().solution
    assert solution is not None
    assert len(solution.ties) == 5
    assert not solution.flagged


# -- what is refused -----------------------------------------------------------------------------


def test_what_is_refused_during_an_inner_orientation(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    state = station.state
    with pytest.raises(InputError, match=r"photo 101 \(left\) has no fiducial 102-1"):
        station.drive("102-1")
    with pytest.raises(InputError, match="inner orientation comes first"):
        station.add_point("extra")
    with pytest.raises(
        NotComputableError, match=r"the inner orientation of photo 101 \(left\) is not"
    ):
        station.accept()
    measure_fiducial(station, watch, "1")
    with pytest.raises(NotComputableError, match="needs 3 fiducials, 1 measured"):
        station.accept()
    station.undo()
    assert however_it_lies(station.state) == however_it_lies(state)


def test_without_a_target_nothing_is_recorded(bench: Bench) -> None:
    station, watch = bench.open(auto_drive=False)
    station.next_model()
    with pytest.raises(InputError, match="drive to a fiducial first"):
        station.record()
    assert station.instrument is not None
    assert station.instrument.simulator is not None
    watch.until(lambda _: station.readout() is not None)
    station.instrument.simulator.press("pedal")
    watch.heard("not recorded: drive to a fiducial first")
    assert bench.payloads("record-refused") == [{"reason": "drive to a fiducial first"}]
    measure_fiducial(station, watch, "6")
    assert [f.fiducial for f in inner_of(station).fiducials if f.times] == ["6"]


def test_without_a_plotter_one_looks_on(bench: Bench) -> None:
    station, _ = bench.open(plotter=False)
    station.next_model()
    assert inner_of(station).solution is None
    station.drive("4")
    assert station.snapshot().target == "4"


# -- undo, reopening, replay ---------------------------------------------------------------------


def test_undo_goes_back_through_the_inner_orientations(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    orient(station, watch)
    measure(station, watch, station.snapshot().points[0].point)
    oriented = station.state
    station.undo()
    assert station.snapshot().inner is None
    station.undo()
    # the right photo's inner orientation is open again, and nothing is aimed at
    picture = station.snapshot()
    assert picture.inner is not None
    assert picture.inner.side == "right"
    assert picture.target is None
    assert picture.may_accept
    station.accept()
    measure(station, watch, station.snapshot().points[0].point)
    assert station.state.current is not None
    assert oriented.current is not None
    assert station.state.current.inner == oriented.current.inner
    for _ in range(1 + 2 * 9 + 1):
        station.undo()
    assert station.snapshot().left == ""


def test_reopened_in_the_middle_of_an_inner_orientation(bench: Bench) -> None:
    key = ("101", "102", fiducial_name("right", "2"))
    mistakes = {key: Offsets(dxr=0.2)}
    station, watch = bench.open(mistakes=mistakes)
    station.next_model()
    measure_fiducials(station, watch)
    station.accept()
    for name in "1234":
        measure_fiducial(station, watch, name)
    before, picture = station.state, station.snapshot()
    station.close()
    again, watch = bench.open(mistakes=mistakes)
    assert again.state == before
    assert again.state._history == before._history
    after = again.snapshot()
    assert (after.expected, after.next_point, after.points) == (
        picture.expected,
        picture.next_point,
        picture.points,
    )
    assert picture.inner is not None
    assert inner_of(again).fiducials == picture.inner.fiducials
    with pytest.raises(InputError, match="drive to a fiducial first"):
        again.record()
    measure_fiducials(again, watch)
    # the mistake was made yesterday, and is made once
    assert inner_of(again).suspects[0] == ("2", "x")
    measure_fiducial(again, watch, "2")
    solution = inner_of(again).solution
    assert solution is not None
    assert not solution.flagged
    again.accept()
    measure_all(again, watch)
    again.accept()
    assert len(read_block(bench.folder).image_points) == 26


def test_a_replay_finds_every_digit(bench: Bench, tmp_path: Path) -> None:
    station, watch = bench.open(mistakes={("101", "102", "102-2"): Offsets(dyr=0.2)})
    station.next_model()
    orient(station, watch)
    measure_all(station, watch)
    measure(station, watch, "102-2")
    station.accept()
    state = station.state
    station.close()
    replayed = replay_session(bench.folder)
    assert replayed.differences == ()
    assert replayed.measurements == 16 + 14
    # every fiducial from the third on, every point from the fifth or sixth on
    assert replayed.tables >= 2 * 6 + 8
    assert replayed.state == state
    # the journal alone is enough: it holds the camera file too
    rebuild(replayed, tmp_path / "rebuilt")
    assert read_block(tmp_path / "rebuilt") == read_block(bench.folder)
    for name in ("block.toml", "camera.toml"):
        (bench.folder / name).unlink()
    assert replay_session(bench.folder / "sessions").differences == ()


@pytest.mark.parametrize(
    ("kind", "key", "words"),
    [
        ("fiducial-measured", "x", "fiducial 1 of photo 101 (left): the recorded bytes do not say"),
        ("point-measured", "yr", "the recorded bytes do not say what was measured"),
        ("inner-table", "sigma0_um", "photo 101 (left): sigma0"),
        ("inner-accepted", "numerator", "a transformation that differs by"),
    ],
)
def test_a_replay_finds_what_was_changed(bench: Bench, kind: str, key: str, words: str) -> None:
    from anaplot.exchange.journal import read_journal
    from anaplot.exchange.recordline import JournalRecord
    from anaplot.station.replay import recorded_block, replay

    station, watch = bench.open()
    station.next_model()
    orient(station, watch)
    for view in station.snapshot().points[:2]:
        measure(station, watch, view.point)
    station.close()
    changed: list[JournalRecord] = []
    done = False
    for record in read_journal(bench.folder).records:
        if record.kind == kind and not done:
            done = True
            value = record.payload[key]
            if isinstance(value, list):
                value = [[value[0][0] + 1e-6, *value[0][1:]], value[1]]
            else:
                value += 1e-6 if kind != "inner-table" else 1e-3
            record = record._replace(payload={**record.payload, key: value})
        changed.append(record)
    assert done
    steps = replay(recorded_block(bench.folder, changed), changed)
    found = [step.difference for step in steps if step.difference is not None]
    assert found
    assert words in str(found[0])


def test_a_replay_is_watched(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    import sys

    station, watch = bench.open()
    station.next_model()
    measure_fiducials(station, watch)
    station.accept()
    station.close()
    replay = ReplayStation(bench.folder, 1e9)
    assert replay.run(sys.stdout) == 0
    said = capsys.readouterr().out
    assert "photo 101 (left): fiducial 8 recorded" in said
    assert "inner orientation of photo 101 (left) accepted" in said


# -- plates --------------------------------------------------------------------------------------


def test_image_and_plate_are_inverse(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    orient(station, watch)
    plates = plates_of(station.state)
    for place in ((0.0, 0.0, 0.0, 0.0), (100.0, -90.0, -95.0, 110.0), (-1.0, 2.0, -3.0, 4.0)):
        at = plate_of(*place, plates)
        read = image_of(at, plates)
        assert (read.xl, read.yl, read.xr, read.yr) == pytest.approx(place, abs=1e-7)
        assert hypot(at.xl - place[0], at.yl - place[1]) > 0.01


def test_plates_without_calibration_are_the_image() -> None:
    at = Position(1.0 / 3.0, -2.0, 1e-9, 115.0)
    read = image_of(at)
    assert (read.xl, read.yl, read.xr, read.yr) == (at.xl, at.yl, at.xr, at.yr)
    assert (read.plate_left, read.plate_right) == (False, False)
    assert plate_of(at.xl, at.yl, at.xr, at.yr, IN_IMAGE) == at


def test_distortion_counts_without_fiducials_too(bench: Bench, tmp_path: Path) -> None:
    camera = bench.made.block.cameras[0]
    assert camera.calibration is not None
    bare = replace(camera, calibration=replace(camera.calibration, fiducials=()))
    made = replace(bench.made, block=replace(bench.made.block, cameras=(bare,)))
    other = Bench(tmp_path / "bare", made)
    with other.stack:
        station, watch = other.open()
        station.next_model()
        assert station.snapshot().inner is None
        measure_all(station, watch)
        station.accept()
        for row in read_block(other.folder).image_points:
            x, y = made.truth[row.photo][row.point]
            assert hypot(row.x - x, row.y - y) < 0.02
        assert station.state.models[0].inner == ()


def test_photos_lie_as_their_placements_say(bench: Bench) -> None:
    placements = random_placements(bench.made.block, 3)
    assert placements == random_placements(bench.made.block, 3)
    assert len(set(placements.values())) == 8
    assert not random_placements(
        replace(
            bench.made.block,
            cameras=(replace(bench.made.block.cameras[0], calibration=None, file=None),),
        ),
        3,
    )
    left, right = laid_photographs(bench.made.block, bench.made.truth, placements)
    calibration = bench.made.block.cameras[0].calibration
    assert calibration is not None
    for side, laid in (("left", left), ("right", right)):
        for mark in calibration.fiducials:
            at = np.array([laid["102"][fiducial_name(side, mark.id)]])  # type: ignore[arg-type]
            back = placements["102", side].to_image(at)[0]  # type: ignore[index]
            assert back == pytest.approx((mark.x, mark.y), abs=1e-9)
    plain, _ = laid_photographs(bench.made.block, bench.made.truth, {})
    assert plain["102"][fiducial_name("left", "1")] == pytest.approx(calibration.fiducials[0][1:])


def test_a_journal_of_a_camera_that_had_no_fiducials(bench: Bench) -> None:
    toml = (bench.folder / "block.toml").read_text()
    (bench.folder / "block.toml").write_text(toml.replace('file = "camera.toml"\n', ""))
    station, watch = bench.open()
    station.next_model()
    measure(station, watch, station.snapshot().points[0].point)
    station.close()
    (bench.folder / "block.toml").write_text(toml)
    with pytest.raises(InputError, match=r"does not fit block\.toml: photo 101 \(left\): inner"):
        Station(bench.folder)
