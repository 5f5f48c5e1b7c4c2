"""`anaplot log` of a recorded session."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from journaltools import PLAIN, append_event, lines_decoded
from orientedforw import models_of_w

from anaplot.aliases import Progress
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange import journalread
from anaplot.exchange.journal import Journal
from anaplot.report import astext
from anaplot.report.astext import page_parts, page_text
from anaplot.report.html.sections.switchedoff import protocol_blocks
from anaplot.report.journalnote import session_note
from anaplot.report.logcommand import log_document
from anaplot.session.changes import Change, Sizes
from anaplot.session.events import (
    ModelAccepted,
    ModelChosen,
    PlannedPoint,
    PointMeasured,
    ReasonGiven,
    RowSwitched,
)
from anaplot.station.sessionlog import SessionLog, read_log

SESSION = Path(__file__).parents[1] / "sessions" / "changes.jsonl"
KEYS = ["time", "who", "what", "model", "photo", "point", "axis"]
KEYS += ["old", "new", "reason", "w_before", "w_after"]


def test_text_json_and_csv_say_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", str(SESSION), "--json", "--csv", str(tmp_path / "log.csv")]) == 0
    changes = json.loads(capsys.readouterr().out)["changes"]
    assert [list(one) for one in changes] == [KEYS] * len(changes)
    assert {"measured", "remeasured", "off", "accepted"} <= {one["what"] for one in changes}
    remeasured = next(one for one in changes if one["what"] == "remeasured")
    assert len(remeasured["old"]) == len(remeasured["new"]) == 2
    with (tmp_path / "log.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["what"] for row in rows] == [one["what"] for one in changes]
    k = changes.index(remeasured)
    assert [float(rows[k][key]) for key in ("new_x", "new_y")] == remeasured["new"]
    assert main(["log", str(SESSION), "--all"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(changes) + 1
    # times with their zone
    assert lines[1][19] in "+-"


def test_the_reason_stands_beside_the_change(tmp_path: Path, capsys) -> None:
    block = tmp_path / "b"
    points = [f"p{k}" for k in range(3)]
    plan = tuple(PlannedPoint(p, "new", 1.0, 2.0, -91.0, 2.0) for p in points)
    block.mkdir()
    (block / "block.toml").write_text(PLAIN)
    events = [
        ModelChosen("1", "1", "2", plan),
        *(PointMeasured("1", "2", p, 1.0, 2.0, -91.0, 2.0, "key") for p in points),
        RowSwitched("p1", "y", on=False),
        ReasonGiven("transfer"),
    ]
    with Journal.open(block, {"operator": "Ada"})[0] as journal:
        for event in events:
            append_event(journal, event)
    capsys.readouterr()
    assert main(["log", str(block), "--json", "--csv", str(tmp_path / "log.csv")]) == 0
    *_, before, off = json.loads(capsys.readouterr().out)["changes"]
    assert (off["what"], off["point"], off["axis"]) == ("off", "p1", "y")
    assert (before["reason"], off["reason"], off["who"]) == (None, "transfer", "Ada")
    with (tmp_path / "log.csv").open() as file:
        assert [row["reason"] for row in csv.DictReader(file)][-2:] == ["", "transfer"]
    assert main(["log", str(block)]) == 0
    assert "transfer" in capsys.readouterr().out.splitlines()[-1]


def test_a_log_goes_on_where_it_was_read_to(tmp_path: Path) -> None:
    block = tmp_path / "b"
    block.mkdir()
    (block / "block.toml").write_text(PLAIN)
    plan = (PlannedPoint("p", "new", 1.0, 2.0, -91.0, 2.0),)
    log = SessionLog(block)
    with Journal.open(block, {"operator": "Ada"})[0] as journal:
        assert log.read() == ()
        append_event(journal, ModelChosen("1", "1", "2", plan))
        append_event(journal, PointMeasured("1", "2", "p", 1.0, 2.0, -91.0, 2.0, "key"))
        left, right = log.read()
        append_event(journal, RowSwitched("p", "y", on=False))
        append_event(journal, ReasonGiven("pointing"))
        *before, off = log.read()
        assert before == [left, right]
        assert (off.what, off.reason, off.who) == ("off", "pointing", "Ada")
        assert log.read() == read_log(block)


def test_a_block_without_a_journal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", str(tmp_path / "b"), "--strip", "1-3"]) == 0
    capsys.readouterr()
    assert main(["log", str(tmp_path / "b")]) == 2
    assert "journal" in capsys.readouterr().err


def test_foreign_names_control_no_terminal() -> None:
    from anaplot.report.astext import page_text

    change = Change("2026-01-01T10:00:00.000Z", "\x1b[2J", "off", "1/2", "2", "p\x07", "y")
    text = page_text(log_document([change]).page)
    assert "\x1b" not in text
    assert "\x07" not in text
    assert "\\x1b[2J" in text


def test_what_contradicts_a_journal_that_ends_torn_may_be_the_newer(tmp_path: Path) -> None:
    def refuse(_: object) -> None:
        raise InputError("the file says something else")

    with Journal.open(tmp_path, {})[0]:
        pass
    file = tmp_path / "sessions" / "0001.jsonl"
    file.write_bytes(file.read_bytes() + b'{"seq":2,"t":')
    before = file.read_bytes()
    with pytest.raises(InputError, match=r"something else; but the journal ends torn .*--salvage"):
        Journal.open(tmp_path, {}, accept=refuse)
    assert file.read_bytes() == before


def test_w_is_computed_for_the_rows_that_are_shown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = models_of_w(monkeypatch)
    found = read_log(SESSION)
    again = [one for one in found if one.what not in ("measured", "oriented")]
    monkeypatch.setattr(astext, "MOST_ROWS", len(again))
    assert main(["log", str(SESSION)]) == 0
    shown = capsys.readouterr().out
    some = len(asked)
    assert 0 < some <= 2 * len(again) < len(found)
    protocol_blocks(log_document(found))
    assert len(asked) == 2 * some
    # what is shown does not hang on what else is
    assert main(["log", str(SESSION), "--all"]) == 0
    every = capsys.readouterr().out.splitlines()
    assert len(asked) > 3 * some
    assert {" ".join(line.split()) for line in shown.splitlines()[:-1]} <= {
        " ".join(line.split()) for line in every
    }


def test_the_computation_of_w_says_how_far_it_is() -> None:
    found = read_log(SESSION)
    told: list[float] = []

    @contextmanager
    def working() -> Iterator[Progress]:
        yield lambda what, fraction: told.append(fraction)

    document = log_document(found, working)
    assert told == []
    assert len(page_text(document.page, everything=True).splitlines()) == len(found) + 1
    assert told[-1] == 1.0
    assert sorted(set(told)) == [(k + 1) / len(found) for k in range(len(found))]


def test_the_first_rows_of_a_long_log_do_not_wait_for_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[int] = []
    found = [
        Change(
            "2026-01-01T10:00:00.000Z",
            "",
            "measured",
            "1/2",
            w=Sizes(partial(asked.append, k), float),
        )
        for k in range(1000)
    ]
    parts = page_parts(log_document(found).page, everything=True)
    assert next(parts).startswith("TIME")
    assert asked == []
    assert next(parts).count("\n") == len(asked) - 1 < 500
    assert sum(part.count("\n") + 1 for part in parts) + len(asked[:128]) == 1000
    assert asked == list(range(1000))


@pytest.mark.parametrize("command", [["log"], ["replay", "--check"]])
def test_a_torn_end_is_told_of(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "0001.jsonl"
    lines = SESSION.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines))
    assert main([*command, str(file)]) == 0
    assert capsys.readouterr().err == ""
    file.write_bytes(b"".join(lines)[:-20])
    assert main([*command, str(file)]) == 0
    told = capsys.readouterr().err
    assert told.startswith("anaplot: note: ")
    assert f"line {len(lines)}: " in told
    assert "left out" in told


def test_what_does_not_fit_is_named_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = tmp_path / "b"
    block.mkdir()
    (block / "block.toml").write_text(PLAIN)
    plan = (PlannedPoint("p", "new", 1.0, 2.0, -91.0, 2.0),)
    with Journal.open(block, {})[0] as journal:
        append_event(journal, ModelChosen("1", "1", "2", plan))
        journal.append("traffic", {"items": []}, durable=False)
        append_event(journal, PointMeasured("2", "3", "p", 1.0, 2.0, -91.0, 2.0, "key"))
    assert main(["log", str(block)]) == 2
    assert "0001.jsonl line 4: does not fit the block" in capsys.readouterr().err


def test_a_journal_is_read_once_for_the_changes_and_the_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    block = tmp_path / "b"
    block.mkdir()
    (block / "block.toml").write_text(PLAIN)
    toml = block / "block.toml"
    plan = (PlannedPoint("p", "new", 1.0, 2.0, -91.0, 2.0),)
    with Journal.open(block, {"block_toml": PLAIN})[0] as journal:
        append_event(journal, ModelChosen("1", "1", "2", plan))
        append_event(journal, PointMeasured("1", "2", "p", 1.0, 2.0, -91.0, 2.0, "key"))
        append_event(journal, ModelAccepted("1", "2"))
    lines = lines_decoded(monkeypatch, journalread)
    said = []
    for text in (PLAIN, PLAIN.replace("150.0", "151.0")):
        toml.write_text(text)
        lines.clear()
        assert main(["log", str(block), "--json"]) == 0
        said.append((json.loads(capsys.readouterr().out), list(lines)))
        assert said[-1][0]["differs_from_journal"] == session_note(block)
    (answer, once), (other, twice) = said
    assert answer["differs_from_journal"]["lacking"] == 2
    assert other == answer
    assert once == [1, 2, 3, 4]
    # what was declared may have been changed since: whether all of it fits is seen from the events
    assert twice == once * 2
