"""A full disk, a lost line, lost records, hostile text: told aloud, and nothing lost."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Iterable
from pathlib import Path

import pytest
from stationbench import WAIT, Bench, Watch, measure, measure_all, settled

from anaplot.errors import InputError, LinkError
from anaplot.exchange import journal as journal_module
from anaplot.exchange.journal import Journal, JournalError, read_journal
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.readings import Fault, InPosition, Position, Record, Refused
from anaplot.session.heard import MarkSet
from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.instrument import SimulatedInstrument
from anaplot.station.instrument import InstrumentSetup
from anaplot.station.journaling import Recorder
from anaplot.station.station import Station


def server_of(station: Station) -> SimulatorServer:
    assert isinstance(station.instrument, SimulatedInstrument)
    return station.instrument.server


class FullDisk:
    """A disk that takes nothing while it is full."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        real = os.write
        here = os.getpid()

        class Os:
            def __getattr__(self, name: str) -> object:
                return getattr(os, name)

            @staticmethod
            def write(descriptor: int, data: bytes) -> int:
                if self.full and os.getpid() == here:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                return real(descriptor, data)

        monkeypatch.setattr(journal_module, "os", Os())


def test_a_disk_that_takes_no_explanation_holds_no_drive_up(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.accept()
    station.return_to("101", "102")
    settled(watch)
    real = Journal.append_many

    def refusing(
        self: Journal, records: Iterable[tuple[str, dict[str, object]]], *, durable: bool
    ) -> object:
        records = list(records)
        if any(kind == "point-checked" for kind, _ in records):
            raise JournalError("record refused: No space left on device")
        return real(self, records, durable=durable)

    monkeypatch.setattr(Journal, "append_many", refusing)
    before, left = station.snapshot().target, len(station.snapshot().checks)
    station.record()
    watch.heard("not recorded: record refused")
    watch.until(lambda p: len(p.checks) < left)
    settled(watch)  # the plates stand at the next point: the drive was begun
    assert station.snapshot().target != before
    monkeypatch.undo()
    station.record()
    watch.until(lambda p: len(p.checks) < left - 1)


def test_a_full_disk_refuses_aloud_and_goes_on_when_there_is_space(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = FullDisk(monkeypatch)
    station, watch = bench.open()
    station.next_model()
    first, second = (p.point for p in station.snapshot().points[:2])
    measure(station, watch, first)
    settled(watch)
    state = station.state
    disk.full = True
    station.record()
    text = watch.heard("not recorded: ")
    assert "No space left on device" in text
    assert station.state is state
    assert station.snapshot().target == second
    for command in (station.undo, station.suspend, lambda: station.switch(first, None, False)):
        with pytest.raises(InputError, match="record refused"):
            command()
        assert station.state is state
    disk.full = False
    # the plates stand where they stood: the pedal once more
    station.record()
    watch.until(lambda p: p.points[1].times == 1)
    station.close()
    again, _ = bench.open(plotter=False)
    assert again.state.current is not None
    assert [m.point for m in again.state.current.measured] == [first, second]
    read_journal(bench.folder)


def test_the_lines_bytes_do_not_flood_a_full_disks_operator(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = FullDisk(monkeypatch)
    station, watch = bench.open()
    disk.full = True
    recorder = station._recorder
    start = watch.mark
    for k in range(3000):
        recorder._since = float("-inf")  # a second has gone by
        station._inbox.on_traffic("in", "main", b"\xff" * 100 + bytes([k % 256]))
    done = threading.Event()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(station._worker, "_take", _taking(station, station._take))
        station._inbox.items.put(_Call(done))  # type: ignore[arg-type]
        assert done.wait(WAIT)
    refused = [text for _, text in watch.notices[start:] if "record refused" in text]
    assert len(refused) == 1
    # what one record cannot hold is given up, and that is recorded too
    disk.full = False
    station.next_model()
    items = [item for p in bench.payloads("traffic") for item in p["items"]]
    assert any(item[0] == "lost" and "the disk took no records" in item[2] for item in items)
    assert watch.station.state.current is not None


class _Call:
    def __init__(self, done: threading.Event) -> None:
        self.done = done


def _taking(station: Station, real):  # type: ignore[no-untyped-def]
    def take(item: object) -> None:
        if isinstance(item, _Call):
            item.done.set()
        else:
            real(item)

    return take


def test_a_batch_of_any_bytes_fits_into_one_record(tmp_path: Path) -> None:
    lines: list[tuple[str, dict]] = []

    class Sink:
        full = True

        def append_many(self, records, *, durable):  # type: ignore[no-untyped-def]
            if self.full:
                raise journal_module.JournalError("record refused: full")
            lines.extend(records)
            return 0

    now = [0.0]
    sink = Sink()
    recorder = Recorder(sink, lambda: now[0])  # type: ignore[arg-type]
    refused = []
    for k in range(20_000):
        now[0] += 0.5
        try:
            recorder.traffic("in" if k % 2 else "out", "main", b"\xff" * 30, now[0])
        except journal_module.JournalError:
            refused.append(k)
        recorder.told("press", "key", now[0])
    # told once, and not with every byte
    assert len(refused) == 1
    sink.full = False
    recorder.flush()
    from anaplot.exchange.recordline import MAX_LINE, encode_line

    (record,) = lines
    line = encode_line(1, "2026-01-01T00:00:00.000Z", *record)
    assert 100_000 < len(line) < MAX_LINE


def test_image_points_that_cannot_be_written_are_written_later(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    from anaplot.station import pointsfile

    real = pointsfile.write_image_points

    def refuse(*_: object) -> None:
        raise InputError("image_points.csv: cannot be written: No space left on device")

    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    monkeypatch.setattr(pointsfile, "write_image_points", refuse)
    station.accept()
    assert "the measurements are safe in the journal" in watch.heard("cannot be written")
    assert not station.points_written
    assert station.snapshot().accepted == (("101", "102"),)
    monkeypatch.setattr(pointsfile, "write_image_points", real)
    station.close()
    assert station.points_written
    assert bench.csv().count("\n") == 27


# -- the line ------------------------------------------------------------------------------------


def test_a_line_lost_in_mid_drive_and_back(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure(station, watch, station.snapshot().points[0].point)
    settled(watch)
    station.close()
    slow, watch = bench.open(time_scale=0.01)
    point = slow.snapshot().points[1].point
    slow.drive(point)
    with pytest.raises(InputError, match="under way"):
        slow.record()
    state = slow.state
    server_of(slow).disconnect()
    watch.until(lambda p: p.link.state in ("lost", "reconnecting"))
    watch.heard("link lost")
    # nobody knows where the plates stand
    watch.until(lambda p: p.target is None)
    with pytest.raises(InputError, match=r"the plotter's line is (lost|reconnecting)"):
        slow.record()
    with pytest.raises(LinkError, match="lost"):
        slow.drive(point)
    assert slow.snapshot().target is None
    server_of(slow).reconnect()
    watch.until(lambda p: p.link.state == "live")
    assert slow.state is state
    with pytest.raises(InputError, match="drive to a point first"):
        slow.record()
    slow.close()
    again, watch = bench.open()
    measure(again, watch, point)


def test_the_automatic_job_survives_a_lost_line(bench: Bench) -> None:
    station, watch = bench.open()
    operator = AutomaticOperator(station)
    cut = threading.Event()

    def cut_once(picture) -> None:  # type: ignore[no-untyped-def]
        if len(picture.accepted) == 1 and not cut.is_set():
            cut.set()

    station.subscribe(cut_once)
    worker = threading.Thread(target=operator.run)
    worker.start()
    try:
        assert cut.wait(WAIT)
        server_of(station).disconnect()
        watch.until(lambda p: p.link.state in ("lost", "reconnecting") or p.finished)
        server_of(station).reconnect()
        watch.until(lambda p: p.finished)
    finally:
        operator.stop()
        worker.join(WAIT)
    assert not worker.is_alive()
    assert len(station.state.models) == 3


def test_lost_records_do_not_end_the_automatic_job(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    from anaplot.simulation import automatic

    monkeypatch.setattr(automatic, "_PATIENCE", 0.2)
    station, watch = bench.open()
    assert station.instrument is not None
    assert station.instrument.simulator is not None
    station.instrument.simulator.set_fault_rates({"drop": 0.05, "flip": 0.05, "duplicate": 0.05})
    AutomaticOperator(station).run()
    assert station.snapshot().finished
    assert any("line: " in text for _, text in watch.notices)
    assert [len(model.measured) for model in station.state.models] == [13, 13, 13]
    # refused bytes are in the journal, with the reason
    assert all(payload["reason"] for payload in bench.payloads("refused"))


def test_a_point_of_which_no_record_comes_ends_the_job(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    from anaplot.simulation import automatic

    monkeypatch.setattr(automatic, "_PATIENCE", 0.05)
    station, _ = bench.open()
    assert station.instrument is not None
    # the foot is off the pedal
    monkeypatch.setattr(station.instrument, "set_pedal", lambda automatic: None)
    with pytest.raises(LinkError, match="was not recorded in 8 attempts"):
        AutomaticOperator(station).run()


@pytest.mark.parametrize("refusals", [1, 1000])
def test_what_came_between_look_and_command_does_not_end_the_job_but_what_stays_does(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, refusals: int
) -> None:
    station, _ = bench.open()
    accept, refused = station.accept, []

    def overtaken() -> None:
        if len(refused) < refusals:
            refused.append(station.state)
            raise InputError("the plates are still under way")
        accept()

    monkeypatch.setattr(station, "accept", overtaken)
    operator = AutomaticOperator(station)
    if refusals == 1:
        operator.run()
        assert station.snapshot().finished
        assert all(record.after is not None for record in operator.records)
    else:
        with pytest.raises(InputError, match="still under way"):
            operator.run()
        assert operator.records[0].after is None
        assert 1 < len(refused) < refusals


def test_a_line_that_stays_down_ends_the_job(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    from anaplot.simulation import automatic

    monkeypatch.setattr(automatic, "_LINE_PATIENCE", 0.2)
    station, watch = bench.open()
    server_of(station).disconnect()
    watch.until(lambda p: p.link.state in ("lost", "reconnecting"))
    with pytest.raises(LinkError, match="the plotter's line is") as caught:
        AutomaticOperator(station).run()
    assert caught.value.exit_code == 3


def test_a_fault_of_the_device_ends_the_drive(bench: Bench) -> None:
    station, watch = bench.open(time_scale=0.01)
    station.next_model()
    assert station.snapshot().target is not None
    station._inbox.on_reading(Fault("3", "left x lost counts"))
    watch.heard("plotter fault 3: left x lost counts")
    assert station.snapshot().target is None
    with pytest.raises(InputError, match="drive to a point first"):
        station.record()
    assert bench.payloads("fault") == [{"code": "3", "text": "left x lost counts"}]


def test_a_fault_while_the_plates_stand_changes_nothing(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    target = station.snapshot().target
    station._inbox.on_reading(Fault("4", "command not understood"))
    watch.heard("plotter fault 4")
    assert station.snapshot().target == target


def test_hostile_text_stays_text(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    settled(watch)
    state = station.state
    station._inbox.on_reading(Refused(b"\x1b[2J\x1b]0;owned\x07", "not a record: [red]x[/red]"))
    watch.heard("line: not a record")
    station._inbox.on_traffic("in", "main", b"\x1b[2J\r\n\x00\xff" * 50)
    evil = "\x1b[31m101-1\x07"
    for command in (
        lambda: station.drive(evil),
        lambda: station.switch(evil, None, False),
        lambda: station.add_point(evil),
    ):
        with pytest.raises(InputError):
            command()
    station._inbox.on_reading(Record(Position(float("nan"), 0.0, 0.0, float("inf")), "pedal"))
    watch.heard("not recorded: ")
    assert station.state is state
    station.close()
    for path in (bench.folder / "sessions").glob("*.jsonl"):
        data = path.read_bytes()
        assert all(32 <= byte < 127 or byte == 10 for byte in data)


def test_a_point_with_a_wild_name_from_the_file(bench: Bench) -> None:
    toml = bench.folder / "block.toml"
    toml.write_text(toml.read_text().replace('name = "demo"', 'name = "[bold]\\u001b[31m"'))
    with pytest.raises(InputError) as caught:
        Station(bench.folder)
    assert str(caught.value).isprintable()


# -- opening -------------------------------------------------------------------------------------


def test_a_port_that_does_not_exist(bench: Bench) -> None:
    for port in ("/dev/does-not-exist", "socket://127.0.0.1:1", "nonsense://x"):
        with pytest.raises(LinkError) as caught:
            Station(bench.folder, plotter=InstrumentSetup("anaplot-ascii", port))
        assert caught.value.exit_code == 3
        assert "\n" not in str(caught.value)
    # nothing of it stays locked
    station, _ = bench.open()
    station.close()


def test_a_profile_that_does_not_exist(bench: Bench) -> None:
    with pytest.raises(InputError) as caught:
        Station(bench.folder, plotter=InstrumentSetup("anaplot-asci", "/dev/null"))
    assert caught.value.exit_code == 2
    assert "anaplot-ascii" in str(caught.value)
    assert not (bench.folder / "sessions").exists()


def test_the_header_says_what_was_connected(bench: Bench) -> None:
    station, _ = bench.open()
    station.close()
    (header,) = bench.payloads("header")
    assert header["operator"] == "tester"
    assert header["simulated"] is True
    assert header["profile"] == "simulated"
    assert header["links"]["main"]["baud"] == 115200
    assert len(header["profile_sha256"]) == 64


def test_the_simulated_operator_works_and_rests(bench: Bench) -> None:
    _, watch = bench.open()
    watch.controls.set_automatic(True)
    assert watch.controls.automatic
    watch.until(lambda p: sum(v.times for v in p.points) >= 3 or p.accepted)
    watch.controls.set_automatic(False)
    assert not watch.controls.automatic
    watch.controls.set_automatic(True)
    watch.until(lambda p: p.finished)
    watch.heard("the simulated operator has finished")
    assert not watch.controls.automatic


def test_closing_while_the_operator_works(bench: Bench) -> None:
    station, watch = bench.open()
    watch.controls.set_automatic(True)
    watch.until(lambda p: any(v.times for v in p.points))
    station.close()
    assert not watch.controls.automatic
    again = Watch(bench.open()[0])
    assert any(v.times for v in again.station.snapshot().points)


def test_a_mark_set_after_an_earlier_drive_does_not_count(bench: Bench) -> None:
    station, watch = bench.open(time_scale=0.01)
    station.next_model()
    assert station.instrument is not None
    simulator = station.instrument.simulator
    assert simulator is not None
    watch.until(lambda _: simulator.drives == 1)
    position = simulator.positions()
    station.drive(station.snapshot().points[0].point)
    watch.until(lambda _: simulator.drives == 2)
    # what the first drive had the hand do comes late
    station._inbox.on_mark_set(MarkSet(1))
    station._inbox.on_reading(InPosition(station.desk.drive_target))
    mark = watch.mark
    station._inbox.on_reading(Record(position, "pedal"))
    watch.heard("not recorded: the simulated operator is still setting the mark", mark)
    station._inbox.on_mark_set(MarkSet(2))
    station._inbox.on_reading(Record(position, "pedal"))
    watch.until(lambda p: p.points[0].times == 1)
