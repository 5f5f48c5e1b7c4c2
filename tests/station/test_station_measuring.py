"""A model measured over a real line: pseudo-terminal and loopback TCP."""

from __future__ import annotations

import pytest
from sessionscene import however_it_lies
from stationbench import Bench, Watch, measure, measure_all, settled

from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.orientation.strip import bridge_strip
from anaplot.photogrammetry.block import ImagePoint
from anaplot.plotter.device.hand import Offsets
from anaplot.plotter.readings import Position
from anaplot.session.models import solve
from anaplot.session.plates import image_of, plates_of
from anaplot.station.snapshot import Snapshot
from anaplot.station.station import Station


@pytest.mark.parametrize("tcp", [pytest.param(False, marks=pytest.mark.smoke), True])
def test_a_model_is_measured_by_commands(bench: Bench, tcp: bool) -> None:
    station, watch = bench.open(tcp=tcp)
    assert station.snapshot().link.simulated
    station.next_model()
    first = station.snapshot()
    assert (first.left, first.right, first.model_number, first.model_count) == ("101", "102", 1, 3)
    # the plates drive to the first point by themselves
    assert first.target == first.points[0].point == first.next_point
    measure_all(station, watch)
    picture = station.snapshot()
    assert picture.solution is not None
    assert picture.solution.redundancy == 8
    assert picture.expected == "accept the model"
    assert [p.times for p in picture.points] == [1] * 13
    station.accept()
    assert station.snapshot().accepted == (("101", "102"),)
    assert ("record", f"{first.points[0].point} recorded") in watch.notices
    assert ("info", "model 101/102 accepted") in watch.notices
    # what was written is what was measured: the bridge finds the same model
    block = read_block(bench.folder)
    assert len(block.image_points) == 26
    bridged = bridge_strip(block, block.strips[0])
    assert bridged.models[0].table == solve(station.state, station.state.models[0]).table
    kinds = bench.kinds()
    assert kinds.count("point-measured") == 13
    assert kinds.count("table") >= 1
    assert kinds[-1] in ("model-accepted", "traffic")


def test_the_pedal_records_and_the_plates_drive_on(bench: Bench) -> None:
    station, watch = bench.open(pedal=True)
    station.next_model()
    # nobody gives a command: the pedal's record drives the plates to the next point
    picture = watch.until(lambda p: all(v.status != "pending" for v in p.points))
    assert {event["switch"] for event in bench.payloads("point-measured")} == {"pedal"}
    assert picture.target is None
    assert picture.may_accept


def test_the_key_is_named_in_the_journal(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure(station, watch, station.snapshot().points[0].point)
    assert [event["switch"] for event in bench.payloads("point-measured")] == ["key"]


def test_without_auto_drive_the_operator_drives(bench: Bench) -> None:
    station, watch = bench.open(auto_drive=False)
    station.next_model()
    assert station.snapshot().target is None
    with pytest.raises(InputError, match="drive to a point first"):
        station.record()
    point = station.snapshot().points[4].point
    measure(station, watch, point)
    picture = station.snapshot()
    assert [p.point for p in picture.points if p.times] == [point]
    assert picture.target is None


def test_a_second_press_is_not_taken_for_another_point(bench: Bench) -> None:
    station, watch = bench.open(mistakes={("101", "102", "102-2"): Offsets(dyr=0.2)})
    station.next_model()
    measure_all(station, watch)
    picture = station.snapshot()
    # something is to be measured again, but the plates stand at the last point of the pattern
    assert picture.next_point == "102-2"
    assert picture.target is None
    state = station.state
    assert station.instrument is not None
    assert station.instrument.simulator is not None
    station.instrument.simulator.press("pedal")
    watch.heard("not recorded: drive to a point first")
    assert station.state is state


def test_a_wrong_point_is_found_and_measured_again(bench: Bench) -> None:
    station, watch = bench.open(mistakes={("101", "102", "102-2"): Offsets(dyr=0.2)})
    station.next_model()
    measure_all(station, watch)
    picture = station.snapshot()
    assert [p.point for p in picture.points if p.status == "flagged"].count("102-2") == 1
    assert picture.diagnosis is not None
    assert picture.diagnosis.suspects[0] == ("102-2", "y")
    assert picture.diagnosis.advice[0].startswith("remeasure 102-2 (y)")
    assert any("flagged: " in text for severity, text in watch.notices if severity == "warning")
    measure(station, watch, "102-2")
    picture = station.snapshot()
    assert picture.solution is not None
    assert not picture.solution.flagged
    assert next(p.times for p in picture.points if p.point == "102-2") == 2


def test_rows_are_switched(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    whole = station.snapshot().solution
    assert whole is not None
    station.switch("102-1", "y", False)
    picture = station.snapshot()
    assert picture.solution is not None
    assert picture.solution.redundancy == whole.redundancy - 1
    view = next(p for p in picture.points if p.point == "102-1")
    assert (view.status, view.off_axes) == ("off", ("y",))
    station.switch("102-1", None, True)
    again = station.snapshot().solution
    assert again is not None
    assert again.table == whole.table
    with pytest.raises(InputError, match="no tie"):
        station.switch("102-1", "x", False)


def test_the_next_model_begins_with_its_ties(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.accept()
    station.next_model()
    picture = station.snapshot()
    assert (picture.left, picture.right, picture.model_number) == ("102", "103", 2)
    roles = [p.role for p in picture.points]
    assert roles == ["tie"] * 5 + ["new"] * 8
    measure_all(station, watch)
    solution = station.snapshot().solution
    assert solution is not None
    assert len(solution.ties) == 5
    assert solution.redundancy == 13 + 5 - 6


def test_a_point_is_added_where_the_plates_stand(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.drive("101-8")
    settled(watch)
    watch.until(lambda _: station.readout() is not None)
    station.add_point("extra")
    picture = station.snapshot()
    assert picture.points[-1].point == picture.target == "extra"
    with pytest.raises(InputError, match="extra is in model 101/102 already"):
        station.add_point("extra")
    station.record()
    watch.until(lambda p: p.points[-1].times == 1)
    for bad in ("", "   ", "a\nb", "x" * 101, "\x1b[31mred"):
        with pytest.raises(InputError):
            station.add_point(bad)
    assert len(station.snapshot().points) == 14


def test_the_pictures_come_in_order(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.close()
    assert len(watch.pictures) > 13
    assert max(p.serial for p in watch.pictures) == station.snapshot().serial
    assert len({p.serial for p in watch.pictures}) == len(watch.pictures)


# -- files ---------------------------------------------------------------------------------------


def test_accepting_keeps_the_rows_of_others(bench: Bench) -> None:
    others = (
        ImagePoint("101", "far", 1.25, -2.5),
        ImagePoint("103", "hut", 10.0, 20.0, sigma_um=4.0),
        ImagePoint("103", "inner", 1.0, 2.0, model="103/104"),
    )
    write_image_points(bench.folder, others)
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.accept()
    rows = read_block(bench.folder).image_points
    assert rows[:3] == others
    assert {row.model for row in rows[3:]} == {"101/102"}
    # what another program adds meanwhile stays too
    more = ImagePoint("104", "late", 3.0, 4.0)
    write_image_points(bench.folder, (*rows, more))
    station.next_model()
    measure_all(station, watch)
    station.accept()
    rows = read_block(bench.folder).image_points
    assert more in rows
    assert set(others) <= set(rows)
    assert len(rows) == 4 + 26 + 26


def test_undoing_an_accept_takes_the_rows_out_again(bench: Bench) -> None:
    other = ImagePoint("103", "hut", 10.0, 20.0)
    write_image_points(bench.folder, (other,))
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    before = station.state
    station.accept()
    written = bench.csv()
    station.undo()
    assert station.state == before
    assert read_block(bench.folder).image_points == (other,)
    assert station.snapshot().left == "101"
    station.accept()
    assert bench.csv() == written


def test_points_switched_off_are_written_as_such(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.switch("102-1", None, False)
    station.accept()
    uses = {(r.photo, r.point): r.use for r in read_block(bench.folder).image_points}
    assert (uses["101", "102-1"], uses["102", "102-1"]) == ("xy", "off")
    assert list(uses.values()).count("off") == 1


def test_a_model_that_is_not_determined_is_not_accepted(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    for view in station.snapshot().points[:3]:
        measure(station, watch, view.point)
    state = station.state
    with pytest.raises(NotComputableError, match="model 101/102 is not determined yet"):
        station.accept()
    assert station.state is state
    assert bench.csv() == ""


# -- undo ----------------------------------------------------------------------------------------


def test_undo_takes_measurements_back_one_by_one(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    states = [station.state]
    for view in station.snapshot().points[:4]:
        measure(station, watch, view.point)
        states.append(station.state)
    for state in reversed(states[:-1]):
        station.undo()
        assert however_it_lies(station.state) == however_it_lies(state)
    station.undo()
    assert station.snapshot().left == ""
    with pytest.raises(InputError, match="nothing to undo"):
        station.undo()


def test_undoing_the_choice_of_a_model_lays_the_photos_before(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.accept()
    station.next_model()
    assert station.instrument is not None
    simulator = station.instrument.simulator
    assert simulator is not None
    assert simulator.laid == ("102", "103")
    station.undo()
    with pytest.raises(InputError, match="no model is in the instrument"):
        station.record()
    station.undo()
    assert simulator.laid == ("101", "102")
    measure(station, watch, "102-3")
    assert next(p.times for p in station.snapshot().points if p.point == "102-3") == 2


def test_a_target_that_was_undone_is_no_target(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.drive("101-8")
    settled(watch)
    watch.until(lambda _: station.readout() is not None)
    station.add_point("extra")
    station.undo()
    assert station.snapshot().target is None
    with pytest.raises(InputError, match="drive to a point first"):
        station.record()


# -- what is refused -----------------------------------------------------------------------------


def test_commands_without_a_model(bench: Bench) -> None:
    station, _ = bench.open()
    for command in (
        lambda: station.drive("102-1"),
        station.record,
        station.accept,
        lambda: station.switch("102-1", None, False),
        lambda: station.add_point("extra"),
    ):
        with pytest.raises(InputError, match="no model is in the instrument"):
            command()
    assert [k for k in bench.kinds() if k not in ("header", "traffic")] == []


def test_a_model_at_a_time(bench: Bench) -> None:
    station, _ = bench.open()
    station.next_model()
    with pytest.raises(InputError, match="accept model 101/102 first"):
        station.next_model()
    with pytest.raises(InputError, match="point nowhere is not in model 101/102"):
        station.drive("nowhere")


def test_while_suspended_nothing_is_recorded(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    station.suspend()
    state = station.state
    for command in (station.record, station.accept, station.undo, station.suspend):
        with pytest.raises((InputError, NotComputableError), match=r"suspended|not determined"):
            command()
    with pytest.raises(InputError, match="suspended"):
        station.drive(station.snapshot().points[0].point)
    assert station.instrument is not None
    assert station.instrument.simulator is not None
    station.instrument.simulator.press("pedal")
    watch.heard("not recorded: work is suspended")
    assert station.state is state
    station.resume()
    measure(station, watch, station.snapshot().points[0].point)
    assert bench.payloads("record-refused") == [{"reason": "work is suspended: resume first"}]
    with pytest.raises(InputError, match="not suspended"):
        station.resume()


def test_plates_under_way_record_nothing(bench: Bench) -> None:
    # so slow that the drive lasts longer than any test
    station, watch = bench.open(time_scale=0.001)
    station.next_model()
    state = station.state
    with pytest.raises(InputError, match="the plates are still under way"):
        station.record()
    assert station.instrument is not None
    assert station.instrument.simulator is not None
    station.instrument.simulator.press("pedal")
    station._take(_press(station))
    watch.heard("not recorded: the plates are still under way")
    assert station.state is state
    assert bench.payloads("record-refused")[0] == {"reason": "the plates are still under way"}


def _press(station: Station):  # type: ignore[no-untyped-def]
    from anaplot.plotter.readings import Record

    return Record(Position(1.0, 2.0, 3.0, 4.0), "pedal")


def test_a_record_outside_the_photo(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    state, target = station.state, station.snapshot().target
    assert station.instrument is not None
    assert station.instrument.simulator is not None
    station.instrument.simulator.move(dxr=-200.0)
    station.instrument.simulator.press("pedal")
    text = watch.heard("not recorded: ")
    assert "lies outside photo 102" in text
    assert station.state is state
    assert station.snapshot().target == target
    assert "lies outside photo 102" in bench.payloads("record-refused")[0]["reason"]


def test_without_a_plotter_one_looks_on(bench: Bench) -> None:
    station, _ = bench.open(plotter=False)
    assert station.snapshot().link.state == "none"
    assert station.readout() is None
    station.next_model()
    with pytest.raises(InputError, match="no plotter is connected"):
        station.record()
    station.drive(station.snapshot().points[2].point)
    assert station.snapshot().target == station.snapshot().points[2].point
    station.stop()


def test_a_stopped_drive(bench: Bench) -> None:
    station, watch = bench.open(time_scale=0.05)
    station.next_model()
    first = station.snapshot().target
    assert first is not None
    station.stop()
    assert station.standing
    assert station.desk.drive_target is None
    # the plates stand anywhere: what is recorded there is not the point that they went to
    assert station.snapshot().target is None
    assert station.snapshot().next_point == first
    assert station.instrument is not None
    assert station.instrument.simulator is not None
    station.instrument.simulator.press("pedal")
    watch.heard("not recorded: drive to a point first")
    with pytest.raises(InputError, match="drive to a point first"):
        station.record()
    assert bench.payloads("point-measured") == []


def test_after_closing_everything_is_refused(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    station.close()
    station.close()
    for command in (station.record, station.undo, station.accept, station.next_model):
        with pytest.raises(InputError, match="closed"):
            command()
    assert watch.pictures


def test_a_failing_listener_does_not_pass_for_a_station_at_work(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    # what the program itself did wrong ends the thread; here its excepthook is not wanted
    import threading

    hook, threading.excepthook = threading.excepthook, lambda _: None
    try:
        end = station.subscribe(_fails)
        station._inbox.on_link_state("live", "again")
        station._worker.thread.join(60.0)
        assert not station._worker.thread.is_alive()
        end()
        with pytest.raises(InputError, match="the station has failed"):
            station.undo()
    finally:
        threading.excepthook = hook


def _fails(_: object) -> None:
    raise RuntimeError("a listener's own error")


def test_notices_wait_for_the_first_listener(bench: Bench) -> None:
    station, _ = bench.open(plotter=False)
    station.close()
    journal = bench.folder / "sessions" / "0001.jsonl"
    with journal.open("ab") as file:
        file.write(b'{"seq":3,"t":"torn')
    again = Station(bench.folder)
    bench.stack.callback(again.close)
    again.next_model()
    watch = Watch(again)
    assert any("moved to" in text for _, text in watch.notices)


def test_the_plates_go_where_the_later_of_two_threads_sends_them(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    instrument = station.instrument
    assert instrument is not None
    first, later, latest = (p.point for p in station.snapshot().points[:3])
    commanded = []
    plain = instrument.drive
    instrument.drive = lambda position, side=None: (  # type: ignore[method-assign]
        commanded.append(station.desk.target),
        plain(position, side),
    )
    overtaking = iter([later])

    def overtake(picture: Snapshot) -> None:
        # decided after the first one, before the instrument was asked for that
        if picture.target == first and (point := next(overtaking, None)) is not None:
            station.drive(point)

    station.drive(latest)
    settled(watch)
    station.subscribe(overtake)
    commanded.clear()
    station.drive(first)
    settled(watch)
    assert commanded == [later]
    station.record()
    watch.until(lambda p: p.points[1].times == 1)
    (measured,) = bench.payloads("point-measured")
    assert measured["point"] == later
    planned = station.snapshot().points[1]
    position = image_of(
        Position(*(measured[axis] for axis in ("xl", "yl", "xr", "yr"))), plates_of(station.state)
    )
    assert abs(position.xl - bench.made.truth["101"][later][0]) < 0.1
    assert planned.point == later


def test_a_stop_stops_nothing_that_was_begun_after_it(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    instrument = station.instrument
    assert instrument is not None
    later = station.snapshot().points[2].point
    stopped = []
    plain = instrument.link.stop
    instrument.link.stop = lambda: (stopped.append(1), plain())  # type: ignore[method-assign]
    overtaking = iter([later])

    def overtake(picture: Snapshot) -> None:
        # decided after the stop, before the instrument was asked for that
        if (point := next(overtaking, None)) is not None:
            station.drive(point)

    station.subscribe(overtake)
    station.stop()
    assert stopped == []
    settled(watch)
    station.record()
    watch.until(lambda p: p.points[2].times == 1)
    station.stop()
    assert stopped == [1]
