"""A pattern of one's own at the instrument: in the journal, and when its file has gone."""

from __future__ import annotations

from pathlib import Path

import pytest
from clibench import contents, here, one_line
from journaltools import append_event

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.journal import Journal, read_journal
from anaplot.exchange.patternfile import read_pattern
from anaplot.orientation.ownpattern import OwnPattern
from anaplot.session.events import ModelChosen, PlannedPoint
from anaplot.simulation.opening import open_station
from anaplot.station.payloads import opened_by
from anaplot.station.rebuild import rebuild
from anaplot.station.replay import recorded_block, replay_session
from anaplot.station.salvage import salvage
from anaplot.station.station import Station

BLOCK = """\
format = 1
name = "b"
[[camera]]
id = "c"
c = 150.0
format = [230.0, 230.0]
[[strip]]
id = "1"
photos = ["101", "102", "103"]
base = 92.0
[measuring]
pattern = "mine.csv"
"""
PATTERN = """\
label,x,y,tie
a,0,80,yes
b,0,0,yes
c,0,-80,yes
m,46,80,no
n,46,-80,no
d,92,80,no
e,92,0,no
f,92,-80,no
"""
PLAN = (PlannedPoint("101-a", "new", 0.0, 80.0, -92.0, 80.0),)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "b"
    folder.mkdir()
    (folder / "block.toml").write_text(BLOCK)
    (folder / "mine.csv").write_text(PATTERN)
    return folder


def opened(folder: Path, pattern: Path | None) -> Path:
    """Open a station with a pattern's file or the block's, begin a model, return its folder."""
    if pattern is None:
        open_station(folder).close()
    else:
        Station(folder, point_pattern=str(pattern)).close()
    journal, _ = Journal.open(folder, {})
    append_event(journal, ModelChosen("1", "101", "102", PLAN))
    journal.close()
    return folder


def test_the_journal_holds_the_pattern(folder: Path) -> None:
    points = read_pattern(folder / "mine.csv").points
    station = Station(folder, point_pattern=str(folder / "mine.csv"))
    assert isinstance(station.desk.pattern, OwnPattern)
    told: list[str] = []
    station.subscribe_notices(lambda _, text: told.append(text))
    station.close()
    assert any("pattern mine.csv is not suitable" in text for text in told)
    said = opened_by(read_journal(folder).records[0])
    assert (said.pattern, said.pattern_points) == ("mine.csv", points)
    Station(folder, point_pattern="13").close()
    again = opened_by(read_journal(folder).records[-1])
    assert (again.pattern, again.pattern_points) == ("13", None)


@pytest.mark.parametrize("changed", ["", "label,x,y\n1,0,0\n"])
def test_a_rebuilt_block_has_the_pattern_of_the_session(
    folder: Path, tmp_path: Path, changed: str
) -> None:
    points = read_pattern(folder / "mine.csv").points
    opened(folder, folder / "mine.csv")
    (folder / "mine.csv").unlink()
    if changed:
        (folder / "mine.csv").write_text(changed)
    rebuild(replay_session(folder), tmp_path / "again")
    salvage(folder, tmp_path / "saved")
    for new in (tmp_path / "again", tmp_path / "saved"):
        assert read_block(new).measuring.pattern == "mine.csv"
        assert read_pattern(new / "mine.csv").points == points
    Station(tmp_path / "saved", point_pattern=str(tmp_path / "saved" / "mine.csv")).close()


@pytest.mark.parametrize("kind", ["dot", "absolute", "link"])
def test_the_blocks_pattern_is_recorded_as_the_block_names_it(
    folder: Path, tmp_path: Path, kind: str
) -> None:
    points = read_pattern(folder / "mine.csv").points
    name = {"dot": "./mine.csv", "absolute": str(folder / "mine.csv"), "link": "link.csv"}[kind]
    (folder / "link.csv").symlink_to("mine.csv")
    (folder / "block.toml").write_text(BLOCK.replace("mine.csv", name))
    opened(folder, None)
    records = read_journal(folder).records
    assert opened_by(records[0]).pattern == name
    (folder / "mine.csv").unlink()
    assert recorded_block(folder, records).measuring.points == points
    rebuild(replay_session(folder), tmp_path / "again")
    salvage(folder, tmp_path / "saved")
    for new in (tmp_path / "again", tmp_path / "saved"):
        measuring = read_block(new).measuring
        assert measuring.pattern is not None
        assert read_pattern(new / measuring.pattern).points == points
        open_station(new).close()


def test_a_pattern_that_stood_elsewhere_comes_to_stand_in_the_folder(
    folder: Path, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere.toml"
    elsewhere.write_text('format = 1\n[[point]]\nlabel = "1"\nx = 1.0\ny = 2.0\n')
    (folder / "block.toml").write_text(BLOCK.replace("mine.csv", str(elsewhere)))
    one_point = r"its points do not determine a strip's first model|ties"
    with pytest.raises(InputError, match=one_point):
        Station(folder, point_pattern=str(elsewhere))
    assert not (folder / "sessions").exists()
    (folder / "block.toml").write_text(BLOCK.replace("mine.csv", str(tmp_path / "e.csv")))
    (tmp_path / "e.csv").write_text(PATTERN)
    opened(folder, tmp_path / "e.csv")
    (tmp_path / "e.csv").unlink()
    rebuild(replay_session(folder), tmp_path / "again")
    assert read_block(tmp_path / "again").measuring.pattern == "e.csv"
    assert len(read_pattern(tmp_path / "again" / "e.csv").points) == 8


def test_a_session_opened_with_another_pattern_says_nothing_of_the_blocks(folder: Path) -> None:
    (folder.parent / "other.csv").write_text(PATTERN)
    opened(folder, folder.parent / "other.csv")
    records = read_journal(folder).records
    assert opened_by(records[0]).pattern == str((folder.parent / "other.csv").resolve())
    assert recorded_block(folder, records).measuring.points is None


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("few.csv", PATTERN.replace("yes", "no"), "few.csv: 0 of its points are ties"),
        ("off.csv", PATTERN.replace("46,80", "46,180"), "off.csv line 5: point 'm' would lie at"),
        ("twice.csv", PATTERN.replace("b,0", "a,0"), "twice.csv line 3: label: label 'a' stands"),
        ("gone.csv", None, "gone.csv"),
    ],
)
def test_what_is_wrong_is_told_before_anything_is_written(
    folder: Path,
    name: str,
    text: str | None,
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("anaplot.cli.need_terminal", lambda: pytest.fail("asked too early"))
    path = folder / name
    if text is not None:
        path.write_text(text)
    before = contents(folder)
    one_line(here(capsys, "open", folder, "--simulate", "--pattern", path), 2, words)
    assert contents(folder) == before
    # named by block.toml it stands beside it, wherever one is
    (folder / "block.toml").write_text(BLOCK.replace("mine.csv", name))
    before = contents(folder)
    one_line(here(capsys, "open", folder, "--simulate"), 2, words)
    assert contents(folder) == before


def test_a_pattern_outside_of_the_folder_is_named_by_its_whole_path(folder: Path) -> None:
    (folder / "block.toml").write_text(BLOCK.replace("mine.csv", "../mine.csv"))
    with pytest.raises(InputError, match=r"block.toml line 12: .*leads out of the folder"):
        read_block(folder)
