"""What is declared is changed between two openings of a session."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from stationbench import Bench, measure_all

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.journal import read_journal
from anaplot.exchange.recordline import encode_line
from anaplot.planning.synthetic import synthetic_strip
from anaplot.session.state import start
from anaplot.station.changedplates import told_changed_plates
from anaplot.station.rebuild import rebuild
from anaplot.station.replay import recorded_block, replay_session
from anaplot.station.salvage import salvage
from anaplot.station.sessionlog import read_log
from anaplot.station.station import Station


@pytest.fixture(scope="module")
def two_days(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photo is added after the first day, and the camera constant and image_um corrected."""
    bench = Bench(tmp_path_factory.mktemp("days") / "b", synthetic_strip(3, seed=5))
    declared = bench.folder / "block.toml"
    second = declared.read_text()
    first = re.sub(r"photos = \[.*\]", 'photos = ["101", "102"]', second)
    first = re.sub(r"(?m)^c = .*$", "c = 152.2", first)
    first = re.sub(r"(?m)^image_um = .*$", "image_um = 9.0", first)
    assert len({*first.splitlines()} - {*second.splitlines()}) == 3
    for text in (first, second):
        declared.write_text(text)
        with bench.stack:
            station, watch = bench.open()
            station.next_model()
            watch.until(lambda p: p.left)
            measure_all(station, watch)
            station.accept()
            watch.until(lambda p: not p.left)
    return bench.folder


def test_each_days_tables_come_out_the_same(two_days: Path) -> None:
    replayed = replay_session(two_days)
    assert replayed.differences == ()
    assert replayed.tables > 10
    assert len(replayed.state.models) == 2


def test_what_was_measured_belongs_to_the_block_as_it_is_now(
    two_days: Path, tmp_path: Path
) -> None:
    now = read_block(two_days)
    assert now.precision.image_um != 9.0
    records = read_journal(two_days).records
    assert recorded_block(two_days, records).precision == now.precision
    rebuild(replay_session(two_days), tmp_path / "again")
    saved = salvage(two_days, tmp_path / "saved")
    assert (saved.left_out, saved.assumed) == ((), ())
    for folder in (tmp_path / "again", tmp_path / "saved"):
        block = read_block(folder)
        assert [p.id for p in block.photos] == [p.id for p in now.photos]
        assert [c.c for c in block.cameras] == [c.c for c in now.cameras]
        assert block.precision == now.precision
    points = (two_days / "image_points.csv").read_bytes()
    assert (tmp_path / "again" / "image_points.csv").read_bytes() == points


def test_the_log_knows_both_days(two_days: Path) -> None:
    accepted = [change.model for change in read_log(two_days) if change.what == "accepted"]
    assert accepted == ["101/102", "102/103"]


def test_that_plates_become_image_coordinates_otherwise_is_told_once(
    two_days: Path, tmp_path: Path
) -> None:
    """What was measured stays as it is: a certificate typed later left two calibrations in it."""
    folder = tmp_path / "b"
    shutil.copytree(two_days, folder)
    (camera,) = read_block(folder).cameras
    declared = folder / "block.toml"
    declared.write_text(re.sub(r"(?m)^(c = .*)$", r'\1\nfile = "cam.toml"', declared.read_text()))
    head = f'format = 1\n[camera]\nid = "{camera.id}"\nc = {camera.c}\n'
    size = "" if camera.format is None else f"format = {list(camera.format)}\n"
    points = (folder / "image_points.csv").read_bytes()

    def told() -> list[str]:
        with Station(folder) as station:
            said: list[str] = []
            station.subscribe_notices(lambda _, text: said.append(text))
        return [text for text in said if "stays as it is" in text]

    state = replay_session(folder).state
    (folder / "cam.toml").write_text(head + size)
    assert told() == [], "a file that says the same"
    (folder / "cam.toml").write_text(f"{head}{size}principal_point = [0.02, 0.0]\n")
    words = f"principal point of camera '{camera.id}': changed since the block was open last; what "
    words += "was measured of 101, 102, 103 stays as it is"
    assert told_changed_plates(folder, read_block(folder), state) == words
    assert told() == [words]
    assert told() == []
    assert (folder / "image_points.csv").read_bytes() == points
    heights = "flying_height = 1900.0\nground_height = 100.0\n"
    (folder / "cam.toml").write_text(f"{head}{size}[distortion]\nradial = [0.0, 1e-8, 0.0, 0.0]\n")
    declared.write_text(f"{declared.read_text()}\n[refinement]\nrefraction = true\n{heights}")
    (text,) = told()
    assert text.startswith("principal point, distortion of camera")
    assert " and refinement: changed since" in text
    # nothing is said where nothing was measured
    assert told_changed_plates(folder, read_block(two_days), start(read_block(folder))) == ""


def test_a_declaration_that_does_not_fit_is_named_with_its_line(
    two_days: Path, tmp_path: Path
) -> None:
    lines = (two_days / "sessions" / "0001.jsonl").read_text().splitlines()
    records = read_journal(two_days).records
    (again,) = (k for k, record in enumerate(records) if record.kind == "opened")
    header = dict(records[0].payload)
    record = records[again]
    other = {**record.payload, "block_toml": header["block_toml"].replace('"102"', '"202"')}
    changed = encode_line(record.seq, record.time, record.kind, other, durable=True)
    copy = tmp_path / "0001.jsonl"
    at = next(k for k, line in enumerate(lines) if json.loads(line)["seq"] == record.seq)
    lines[at] = changed.decode().rstrip("\n")
    copy.write_text("\n".join(lines) + "\n")
    words = rf"0001\.jsonl line {record.line}: what happened before does not fit the block declared"
    with pytest.raises(InputError, match=words):
        replay_session(copy)
