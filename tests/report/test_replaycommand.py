"""`anaplot replay SESSION`: a recorded session's models as text, JSON and CSV."""

from __future__ import annotations

import csv
import json
import re
import shutil
import zlib
from pathlib import Path

import pytest

from anaplot.cli import main
from anaplot.exchange.journal import read_journal
from anaplot.exchange.journalkinds import is_known
from anaplot.session import desk as desk_module
from anaplot.session.desk import Desk
from anaplot.session.models import solved_or_none
from anaplot.session.workflow import outlook
from anaplot.station import replay as replay_module
from anaplot.station.replay import recorded_block, replay, replay_session

SESSIONS = Path(__file__).parents[1] / "sessions"
SESSION = SESSIONS / "changes.jsonl"


def test_the_table_of_all_models_is_that_of_the_json(tmp_path, capsys):
    written = tmp_path / "again" / "rows.csv"
    command = ["replay", str(SESSION), "--json", "--to", str(tmp_path / "again")]
    assert main([*command, "--csv", str(written)]) == 0
    models = json.loads(capsys.readouterr().out)["models"]
    with written.open(newline="") as file:
        rows = list(csv.DictReader(file))
    told = [(model, row) for model in models for row in model["table"]]
    assert len(rows) == len(told) > 0
    for row, (model, same) in zip(rows, told, strict=True):
        # a model of which nothing is off does not say so
        assert list(row) == ["strip", "left", "right", *(same | {"off": False})]
        assert bool(int(row["off"] or 0)) == same.get("off", False)
        assert [row[key] for key in ("strip", "left", "right")] == [
            model[key] for key in ("strip", "left", "right")
        ]
        assert (row["point"], row["axis"]) == (same["point"], same["axis"])
        assert (float(row["redn"]) if row["redn"] else None) == same["redn"]
    assert any(same.get("off") for _, same in told)


def test_no_table_in_place_of_what_is_read_or_written(tmp_path, capsys):
    session = tmp_path / "session.jsonl"
    shutil.copy(SESSION, session)
    before = session.read_bytes()
    new = tmp_path / "new"
    for command, words in (
        (["--csv", str(session)], "it is read"),
        (["--salvage", str(new), "--csv", str(session)], "it is read"),
        (["--to", str(new), "--csv", str(new / "block.toml")], "it is written"),
        (["--check", "--csv", str(new)], "--csv goes with the models"),
    ):
        assert main(["replay", str(session), *command]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert words in err
    assert session.read_bytes() == before
    assert not new.exists()


@pytest.mark.parametrize("everything", [[], ["--all"]])
def test_a_table_that_is_not_long_is_whole(capsys, everything):
    assert main(["replay", str(SESSION), *everything]) == 0
    out = capsys.readouterr().out
    assert "RED-N" in out
    assert "not shown" not in out


def test_a_comparison_is_told_to_programs_too(tmp_path, capsys):
    assert main(["replay", str(SESSION), "--check", "--json"]) == 0
    same = json.loads(capsys.readouterr().out)
    assert same["differences"] == []
    assert same["tables"] > 0
    lines = SESSION.read_bytes().splitlines(keepends=True)
    k = next(k for k, line in enumerate(lines) if b'"kind":"table"' in line)
    text = lines[k].rpartition(b',"crc"')[0]
    text = re.sub(rb'(\["101-1","y",)[^,]+', rb"\g<1>0.5", text, count=1)
    changed = text + b',"crc":"%08x"}\n' % zlib.crc32(text)
    (tmp_path / "s.jsonl").write_bytes(b"".join([*lines[:k], changed, *lines[k + 1 :]]))
    assert main(["replay", str(tmp_path / "s.jsonl"), "--check", "--json"]) == 1
    out, err = capsys.readouterr()
    (first, *_) = json.loads(out)["differences"]
    assert Path(first["file"]).name == "s.jsonl"
    assert first["line"] == k + 1
    assert first["what"] in err


@pytest.mark.parametrize("name", ["changes", "fiducials", "fault-flip"])
def test_what_stands_on_the_desk_is_computed_when_it_is_asked_for(name, monkeypatch):
    session = SESSIONS / f"{name}.jsonl"
    records = read_journal(session, keep=is_known).records
    block = recorded_block(session, records)
    asked: list[object] = []

    def counted(state):
        asked.append(state)
        return outlook(state)

    def solved(state, model):
        oriented.append(model)
        return solved_or_none(state, model)

    oriented: list[object] = []
    monkeypatch.setattr(desk_module, "outlook", counted)
    monkeypatch.setattr(replay_module, "solved_or_none", solved)
    steps = list(replay(block, records))
    tables = sum(step.record.kind == "table" for step in steps)
    assert len(oriented) == tables
    assert replay_session(session).tables == sum(step.compared for step in steps) >= tables > 0
    assert asked == []
    events = [step for step in steps if step.event is not None]
    # in whichever order they are asked for
    for step in (*events[::3], *reversed(events)):
        anew = Desk.at(step.state)
        assert step.desk.state is step.state
        assert step.desk.recomputed == anew.recomputed
        assert step.desk.expected == anew.expected
        assert (step.desk.outlook.solution is None) == (anew.outlook.solution is None)
