"""A file that was changed behind the session's back is told when the block is opened again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from clibench import contents
from journaltools import append_event
from sessionscene import Scene

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_image_points, write_new_block
from anaplot.exchange.journal import Journal
from anaplot.photogrammetry.block import ImagePoint
from anaplot.report.adjustcommand import adjust
from anaplot.report.comparecommand import compare
from anaplot.report.findcommand import find_gross_errors
from anaplot.report.journalnote import session_note
from anaplot.session.events import Event, ModelAccepted, RowSwitched, Undone
from anaplot.session.state import SessionState, apply, start
from anaplot.station.edited import check_unedited
from anaplot.station.imagepoints import rows_of
from anaplot.station.journaled import Journaled, journaled
from anaplot.station.sessionlog import read_history
from anaplot.station.station import Station
from anaplot.textfiles.wording import quoted

OF_SESSION = {"101/102"}


class Work:
    """A block of which one model is accepted, with a row off, taken back and accepted with two."""

    def __init__(self, folder: Path, photos: int = 3) -> None:
        scene = Scene(photos)
        self.folder = folder
        write_new_block(folder, scene.block)
        self.states: list[SessionState] = [scene.start]
        self._journal = Journal.open(folder, {})[0]
        self.happen(scene.choice(scene.start, 0))
        for event in scene.measurements(self.state):
            self.happen(event)
        self.first, self.second, self.third = (p.point for p in self.state.current.plan[:3])
        self.happen(RowSwitched(self.first, "y", on=False))
        self.happen(ModelAccepted("101", "102"))
        self.before = rows_of(self.state.models)
        self.happen(Undone())
        self.happen(RowSwitched(self.second, "y", on=False))
        self.happen(ModelAccepted("101", "102"))
        self._journal.close()
        self.rows = rows_of(self.state.models)

    @property
    def state(self) -> SessionState:
        return self.states[-1]

    def happen(self, event: Event) -> None:
        append_event(self._journal, event)
        self.states.append(apply(self.state, event))

    def write(self, rows: tuple[ImagePoint, ...]) -> None:
        write_image_points(self.folder, rows)

    def check(self) -> None:
        check_unedited(self.folder, read_block(self.folder), self.state, OF_SESSION)

    def with_row(self, point: str, **changes: object) -> tuple[ImagePoint, ...]:
        return tuple(
            replace(row, **changes) if (row.photo, row.point) == ("102", point) else row
            for row in self.rows
        )


@pytest.fixture
def work(tmp_path: Path) -> Work:
    return Work(tmp_path / "b")


@pytest.fixture
def one_model(tmp_path: Path) -> Work:
    return Work(tmp_path / "b", photos=2)


def test_what_the_session_wrote_now_or_before_is_no_change(work: Work) -> None:
    assert len(read_history(work.folder)[1]) == len(work.states) - 1
    work.check()  # no file at all: the disk was full
    for rows in (work.rows, work.before, work.rows[:5]):
        work.write(rows)
        work.check()
    # rows from elsewhere, a reason in words, and a file of an older version without the column
    work.write((*work.rows, ImagePoint("102", "lamp", 1.0, 2.0)))
    work.check()
    work.write(work.with_row(work.first, reason="mark on a lorry"))
    work.check()
    work.write(tuple(replace(row, use="xy") for row in work.rows))
    work.check()


def test_a_use_is_seen_below_a_header_in_quotes(work: Work) -> None:
    # the session wrote its own rows over such an edit
    work.write(work.with_row(work.third, use="off"))
    file = work.folder / "image_points.csv"
    header, rows = file.read_text(encoding="utf-8").split("\n", 1)
    assert "use" in header.split(",")
    quoted_header = ", ".join(f'"{name}"' for name in header.split(","))
    file.write_text(f"{quoted_header}\n{rows}", encoding="utf-8")
    with pytest.raises(InputError, match="use is off there and xy in"):
        work.check()


@pytest.mark.slow
@pytest.mark.parametrize("change", ["use", "x", "extra"])
def test_an_edit_is_told_with_photo_point_and_what_to_do(
    work: Work,
    change: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("anaplot.console.app.run_console", lambda *_, **__: 99)
    monkeypatch.setattr("anaplot.cli.need_terminal", lambda: None)
    old = next(r for r in work.rows if (r.photo, r.point) == ("102", work.first))
    if change == "use":
        work.write(work.with_row(work.first, use="x", reason="looks odd"))
        words = "use is x there and off in the journal: put it back"
    elif change == "x":
        work.write(work.with_row(work.first, x=1.25))
        words = f"x, y are 1.25, {old.y} there and {old.x}, {old.y} in the journal: put them back"
    else:
        work.write((*work.rows, ImagePoint("102", "lamp", 1.0, 2.0, model="101/102")))
        words = "is not in the session's journal: take the row out"
    name = "lamp" if change == "extra" else work.first
    before = contents(work.folder)
    for _ in range(2):
        assert main(["open", str(work.folder)]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "image_points.csv: photo '102', point " in error
        assert f"{quoted(name)} of model '101/102'" in error
        assert words in error
    assert contents(work.folder) == before  # nor does the journal say that it was opened
    # elsewhere it is no error
    assert main(["status", str(work.folder)]) == 0
    capsys.readouterr()
    work.write(work.rows)
    with Station(work.folder) as station:
        assert station.state.models == work.state.models


def test_what_a_strategy_never_rejected_is_refused_with_the_command_that_helps(work: Work) -> None:
    work.write(work.with_row(work.third, use="off", reason="tau; before: y"))
    with pytest.raises(InputError, match="--apply-undo takes back"):
        work.check()


@pytest.mark.slow
def test_who_computes_from_the_files_notes_what_open_refuses(
    one_model: Work, capsys: pytest.CaptureFixture[str]
) -> None:
    work = one_model
    work.write((*work.rows, ImagePoint("102", "lamp", 1.0, 2.0)))
    assert journaled(work.folder, read_block(work.folder)).state == work.state
    before = contents(work.folder)
    quiet, plain = computed(work, capsys)
    assert "differs_from_journal" not in "".join(map(str, quiet))
    work.write(
        tuple(
            replace(row, x=row.x + 0.002) if row.photo == "102" and row.point in some else row
            for some in [(work.first, work.third)]
            for row in work.rows
        )
    )
    with pytest.raises(InputError) as refused:
        work.check()
    loud, told = computed(work, capsys)
    remark = f"{refused.value} (and 1 more row)"
    own = {(r.photo, r.point): r for r in work.rows}
    for answer in loud:
        note = answer["differs_from_journal"]
        assert (note["count"], note["remark"]) == (2, remark)
        assert [(r["photo"], r["point"], r["model"]) for r in note["rows"]] == [
            ("102", point, "101/102") for point in sorted((work.first, work.third))
        ]
        for row in note["rows"]:
            mine = own[row["photo"], row["point"]]
            assert row["journal"] == {"x": mine.x, "y": mine.y, "use": mine.use}
            assert row["file"]["x"] == mine.x + 0.002
    assert remark in loud[0]["remarks"]
    assert "note: " not in plain
    assert told.endswith(f"note: {remark}\n")
    # nothing is written, and nothing locked
    assert {name for name in contents(work.folder) if "sessions" in name} == {
        name for name in before if "sessions" in name
    }
    stable = [row.point for row in work.rows if row.photo == "102" and row.use == "xy"]
    second = compare(write_plain(work), work.folder, stable=stable[-4:]).to_dict()
    assert [note and note["count"] for note in second["differs_from_journal"]] == [None, 2]


def computed(work: Work, capsys: pytest.CaptureFixture[str]) -> tuple[list[dict], str]:
    capsys.readouterr()
    assert main(["status", str(work.folder), "--json"]) == 0
    answers = [json.loads(capsys.readouterr().out)]
    assert main(["bridge", str(work.folder), "--json"]) == 0
    answers.append(json.loads(capsys.readouterr().out))
    assert main(["bridge", str(work.folder)]) == 0
    text = capsys.readouterr().out
    target = work.folder.with_name(f"tables-{len(list(work.folder.parent.iterdir()))}")
    assert main(["export", "csv", str(work.folder), "-o", str(target), "--json"]) == 0
    answers.append(json.loads(capsys.readouterr().out))
    answers.append(adjust(work.folder, datum="free").to_dict())
    answers.append(find_gross_errors(work.folder, "tau", datum="free").to_dict())
    return answers, text


@pytest.mark.slow
def test_measurements_that_the_file_has_lost_are_noted_and_come_back(
    one_model: Work, capsys: pytest.CaptureFixture[str]
) -> None:
    work = one_model
    lost = [row for row in work.rows if row.point in (work.first, work.third)]
    for rows, said in (
        ([row for row in work.rows if row not in lost], f"lacks {len(lost)} measurements"),
        ([row for row in work.rows if row is not lost[0]], "lacks a measurement"),
    ):
        work.write(tuple(rows))
        work.check()  # it may lag behind after a power cut: that is no edit
        assert main(["status", str(work.folder), "--json"]) == 0
        note = json.loads(capsys.readouterr().out)["differs_from_journal"]
        assert (note["count"], note["rows"]) == (0, [])
        assert note["lacking"] == len(work.rows) - len(rows)
        assert said in note["remark"]
        assert note["remark"].endswith("anaplot open brings them back")
    work.write(work.rows)
    assert main(["status", str(work.folder), "--json"]) == 0
    assert "differs_from_journal" not in json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_fit_log_and_pointing_note_it_too(
    one_model: Work, capsys: pytest.CaptureFixture[str]
) -> None:
    work = one_model

    def answer(command: str, *more: str) -> str:
        # one model alone has no control: that is no reason not to note it
        assert main([command, str(work.folder), *more]) in (0, 4)
        return capsys.readouterr().out

    work.write(work.rows)
    for command in ("fit", "log", "pointing"):
        assert "differs_from_journal" not in json.loads(answer(command, "--json"))
    work.write(work.with_row(work.first, x=1.25))
    with pytest.raises(InputError) as refused:
        work.check()
    for command in ("fit", "log", "pointing"):
        note = json.loads(answer(command, "--json"))["differs_from_journal"]
        assert (note["count"], note["remark"]) == (1, str(refused.value))
        assert answer(command).endswith(f"note: {refused.value}\n")
    # the journal alone differs from nothing; and files that cannot be read are noted
    assert main(["log", str(work.folder / "sessions"), "--json"]) == 0
    assert "differs_from_journal" not in json.loads(capsys.readouterr().out)
    (work.folder / "image_points.csv").write_text("nothing\n")
    note = session_note(work.folder)
    assert note is not None
    assert note["count"] is None
    assert note["remark"].startswith("the files were not read: ")
    # a journal that is damaged: said once
    work.write(work.rows)
    path = work.folder / "sessions" / "0001.jsonl"
    path.write_bytes(path.read_bytes().replace(b'"101"', b'"191"', 1))
    assert json.loads(answer("pointing", "--json"))["differs_from_journal"]["count"] is None
    assert answer("pointing").count("the journal was not read") == 1
    assert answer("fit").count("the journal was not read") == 1


def write_plain(work: Work) -> Path:
    folder = work.folder.parent / "plain"
    write_new_block(folder, work.states[0].block)
    write_image_points(folder, work.rows)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["newer", "damaged", "other block", "held", "torn", "no journal"])
def test_a_journal_that_cannot_be_read_is_noted_and_stands_in_nobodys_way(
    one_model: Work, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    work = one_model
    work.write(work.rows)
    path = work.folder / "sessions" / "0001.jsonl"
    whole = path.read_bytes()
    changed, words = {
        "newer": (whole.replace(b'"format":1', b'"format":7'), "newer version"),
        "damaged": (whole.replace(b'"101"', b'"191"', 1), "line "),
        "other block": (whole.replace(b'"strip":"1"', b'"strip":"9"'), "line "),
        "torn": (whole + whole.splitlines()[-1][:30], ""),
        "held": (whole, ""),
        "no journal": (b"", ""),
    }[fault]
    path.write_bytes(changed)
    if fault == "no journal":
        path.unlink()
    if fault == "held":
        with Journal.open(work.folder, {})[0]:
            answers, text = computed(work, capsys)
    else:
        answers, text = computed(work, capsys)
    if not words:
        assert "differs_from_journal" not in "".join(map(str, answers))
        assert "note: " not in text
        return
    assert changed != whole
    for answer in answers:
        note = answer["differs_from_journal"]
        assert (note["count"], note["rows"]) == (None, [])
        assert note["remark"].startswith("the journal was not read: ")
        assert words in note["remark"]
    assert text.endswith(f"note: {note['remark']}\n")


def test_of_a_session_in_which_nothing_happened_no_file_differs(tmp_path: Path) -> None:
    scene = Scene(3)
    write_new_block(tmp_path / "b", scene.block)
    Journal.open(tmp_path / "b", {})[0].close()
    left, right = scene.block.strips[0].photos[:2]
    rows = [ImagePoint(photo, "7", 1.0, 2.0, None, f"{left}/{right}") for photo in (left, right)]
    write_image_points(tmp_path / "b", rows)
    found = journaled(tmp_path / "b", read_block(tmp_path / "b"))
    assert found == Journaled(start(read_block(tmp_path / "b")))
    assert found.remark(tmp_path / "b") == ""
