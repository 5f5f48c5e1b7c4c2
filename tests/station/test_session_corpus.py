"""Recorded sessions replay to the tables beside them; adding one is dropping in a pair of files."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from anaplot.cli import main
from anaplot.exchange.recordline import decode_line, encode_line
from anaplot.plotter.device.faults import FAULTS
from anaplot.plotter.profile import find_profiles, profile_folders

CORPUS = Path(__file__).parents[1] / "sessions"
SESSIONS = sorted(CORPUS.glob("*.jsonl"))
TOLERANCE = 1e-6  # rad, mm and um: other machines round otherwise


def same(was: Any, now: Any, where: str = "") -> None:
    if isinstance(was, dict):
        assert was.keys() <= now.keys(), where
        # how many steps there are until corrections drown in rounding hangs on the machine
        for key, value in was.items():
            if key == "iterations":
                continue
            same(value, now[key], f"{where}.{key}")
    elif isinstance(was, list):
        assert len(was) == len(now), where
        for k, (a, b) in enumerate(zip(was, now, strict=True)):
            same(a, b, f"{where}[{k}]")
    elif isinstance(was, float):
        assert now == pytest.approx(was, rel=TOLERANCE, abs=TOLERANCE), where
    else:
        assert was == now, where


@pytest.mark.parametrize("session", SESSIONS, ids=lambda path: path.stem)
def test_a_recorded_session(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header = json.loads(session.read_bytes().split(b"\n", 1)[0])
    assert len(header["story"]) > 20
    assert main(["replay", str(session), "--check"]) == 0
    said = capsys.readouterr().out.split()
    tables, measurements = int(said[0]), int(said[3])
    assert tables > 3
    assert measurements >= 9
    assert main(["replay", str(session), "--json"]) == 0
    now = json.loads(capsys.readouterr().out)
    expected = json.loads(session.with_suffix(".tables.json").read_text())
    assert len(expected["models"]) >= 1
    same(expected, now)


def test_there_is_one_for_every_profile_and_every_fault() -> None:
    names = {path.stem for path in SESSIONS}
    shipped = profile_folders()[-1]
    profiles = {name for name, path in find_profiles().items() if path.parent == shipped}
    assert {f"profile-{name}" for name in profiles} <= names
    assert {f"fault-{name}" for name in FAULTS} <= names
    expected = {path.name.removesuffix(".tables.json") for path in CORPUS.glob("*.tables.json")}
    assert expected == names


def test_a_changed_digit_in_the_bytes_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (CORPUS / "profile-simulated.jsonl").read_bytes().splitlines(keepends=True)
    at = next(k for k, line in enumerate(lines) if b'"kind":"traffic"' in line)
    damaged = tmp_path / "damaged.jsonl"
    text = re.sub(rb"\d(?=[^\d]*\*)", b"5", lines[at], count=1)
    assert text != lines[at]
    damaged.write_bytes(b"".join([*lines[:at], text, *lines[at + 1 :]]))
    # the record's own checksum tells
    assert main(["replay", str(damaged), "--check"]) == 2
    assert f"line {at + 1}" in capsys.readouterr().err


def test_other_bytes_of_a_measurement_are_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (CORPUS / "profile-mitutoyo-gauge.jsonl").read_bytes().splitlines(keepends=True)
    first = lines[0]
    forged = [first]
    for seq, line in enumerate(lines[1:], 2):
        record, _ = decode_line(line.rstrip(b"\n"), "forged", seq)
        payload = dict(record.payload)
        if record.kind == "traffic":
            items = json.dumps(payload["items"]).replace("01A+0002.168", "01A+0002.169")
            payload["items"] = json.loads(items)
        forged.append(encode_line(seq, "2026-01-01T00:00:00.000Z", record.kind, payload))
    path = tmp_path / "forged.jsonl"
    path.write_bytes(b"".join(forged))
    assert main(["replay", str(path), "--check"]) == 1
    assert "the recorded bytes do not say what was measured" in capsys.readouterr().err
