"""`anaplot open`: what fails, fails before the screen starts."""

from __future__ import annotations

from pathlib import Path

import pytest
from clibench import anaplot, contents, here, make_block, one_line
from journaltools import append_event

from anaplot.cli import main
from anaplot.exchange.journal import Journal
from anaplot.session.events import ModelAccepted

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is a terminal as far as commands in this process can tell."""
    monkeypatch.setattr("anaplot.cli.need_terminal", lambda: None)


@pytest.fixture
def block(tmp_path: Path) -> Path:
    return make_block(tmp_path / "block")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--simulate", "--port", "/dev/ttyS0"), "exclude each other"),
        (("--simulate", "--profile", "no-such"), "no-such"),
        (("--truth", "x"), "--truth goes with --simulate"),
        (("--profile", "anaplot-ascii"), "both --profile and --port"),
        (("--port", "/dev/ttyS0"), "both --profile and --port"),
        (("--pattern", "14"), "no point pattern '14'"),
        (("--profile", "anaplot-asci", "--port", "/dev/ttyS0"), "anaplot-ascii"),
        (("--simulate", "--truth", "/nowhere"), "no such folder"),
    ],
)
def test_options_that_make_no_sense(
    block: Path, arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(block)
    one_line(here(capsys, "open", block, *arguments), 2, words)
    assert contents(block) == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--simulate", "--port", "/dev/ttyS0"), "exclude each other"),
        (("--truth", "x"), "--truth goes with --simulate"),
        (("--profile", "anaplot-ascii"), "both --profile and --port"),
        (("--pattern", "14"), "no point pattern '14'"),
        (("--simulate", "--profile", "no-such"), "no-such"),
        (("--simulate", "--truth", "/nowhere"), "no such folder"),
    ],
)
def test_options_that_make_no_sense_are_told_before_a_new_block_is_asked_for(
    tmp_path: Path,
    arguments: tuple[str, ...],
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Path] = []
    monkeypatch.setattr("anaplot.cli._is_missing", lambda _: True)
    monkeypatch.setattr("anaplot.console.newblockscreen.ask_for_block", asked.append)
    folder = tmp_path / "new"
    one_line(here(capsys, "open", folder, *arguments), 2, words)
    assert asked == []
    assert not folder.exists()


def test_a_journal_that_does_not_fit_gets_no_record_of_an_opening(
    block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal, _ = Journal.open(block, {})
    append_event(journal, ModelAccepted("7", "8"))
    journal.close()
    before = contents(block)
    one_line(here(capsys, "open", block, "--simulate"), 2, "does not fit block.toml")
    assert contents(block) == before


def test_without_a_terminal_it_is_said(block: Path, tmp_path: Path) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    before = contents(block)
    words = "the console needs a terminal, and standard"
    one_line(anaplot("open", block, "--simulate"), 2, words)
    one_line(anaplot("demo", env={"TMPDIR": str(temporary)}), 2, words)
    one_line(anaplot("open", block, env={"TERM": "dumb"}), 2, "TERM is dumb")
    assert list(temporary.iterdir()) == []
    assert contents(block) == before  # no session, and no folder for one
    assert not (block / "sessions").exists()
    assert anaplot("bridge", block).returncode == 0  # the block is left unlocked


def test_a_port_that_does_not_exist(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for port in ("/dev/does-not-exist", "socket://127.0.0.1:1"):
        result = here(capsys, "open", block, "--profile", "anaplot-ascii", "--port", port)
        one_line(result, 3, "port", port)
        assert result.stdout == ""


def test_a_block_that_is_open_elsewhere(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal, _ = Journal.open(block, {})
    with journal:
        before = contents(block)
        one_line(here(capsys, "open", block, "--simulate"), 2, "open in another anaplot")
        assert contents(block) == before
        assert anaplot("bridge", block).returncode == 0


def test_a_journal_of_a_newer_version(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal, _ = Journal.open(block, {})
    journal.close()
    path = block / "sessions" / "0001.jsonl"
    path.write_bytes(path.read_bytes().replace(b'"format":1', b'"format":7'))
    before = contents(block)
    one_line(here(capsys, "open", block, "--simulate"), 2, "newer version")
    after = contents(block)
    before.pop("sessions/lock", None)
    after.pop("sessions/lock", None)
    assert after == before


def test_a_damaged_journal(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal, _ = Journal.open(block, {})
    for _ in range(3):
        journal.append("note", {"text": "something"}, durable=False)
    journal.close()
    path = block / "sessions" / "0001.jsonl"
    damaged = path.read_bytes().replace(b"something", b"sometHing", 1)
    path.write_bytes(damaged)
    one_line(here(capsys, "open", block), 2, "damaged", "line 2")
    assert path.read_bytes() == damaged


def test_truth_that_lacks_a_photo(
    block: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = make_block(tmp_path / "other", photos=2)
    one_line(
        here(capsys, "open", block, "--simulate", "--truth", other),
        2,
        "has no point of photo 103",
    )


def test_a_block_without_strips_cannot_be_measured(tmp_path, capsys):
    (tmp_path / "image_points.csv").write_text("photo,point,x,y\na,1,1,2\nb,1,1,2\n")
    assert main(["new", str(tmp_path), "--camera", "100"]) == 0
    capsys.readouterr()
    assert main(["open", str(tmp_path), "--simulate"]) == 2
    assert "at least one [[strip]] is needed to measure" in capsys.readouterr().err
