"""What the console keeps: the theme, and that it was started before."""

from __future__ import annotations

from pathlib import Path

import pytest
from consolefake import FakeStation, picture
from screenreading import text

from anaplot.console.app import ConsoleApp
from anaplot.console.kept import Kept
from anaplot.console.panels import WELCOME
from anaplot.console.tableview import TableView


@pytest.mark.smoke
def test_a_theme_is_kept(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "none" / "anaplot" / "console.toml")
    assert kept.first
    assert kept.theme() == ""
    kept.keep('no"rd')
    assert not kept.first
    assert kept.theme() == 'no"rd'


@pytest.mark.smoke
@pytest.mark.parametrize("content", [b"\xff", b"theme = 3", b"theme", b"colour = 'x'"])
def test_what_cannot_be_read_is_as_nothing(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "console.toml"
    path.write_bytes(content)
    assert Kept(path).theme() == ""


@pytest.mark.smoke
def test_what_cannot_be_written_is_no_fault(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    kept = Kept(tmp_path / "file" / "console.toml")
    kept.keep("nord")
    assert kept.theme() == ""


async def test_the_theme_survives_and_the_welcome_is_shown_once(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "anaplot" / "console.toml")
    station = FakeStation(picture(gross=False))
    app = ConsoleApp(station, kept=kept)
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.pause()
        assert all(line in text(app) for line in WELCOME)
        await pilot.press("space")  # waits for nothing: the key does what it does
        assert WELCOME[0] not in text(app)
        app.theme = "nord"
        await pilot.pause()
    assert kept.theme() == "nord"
    assert ("record_point",) in station.calls
    again = ConsoleApp(FakeStation(), kept=kept)
    async with again.run_test(size=(160, 50)) as pilot:
        await pilot.pause()
        assert again.theme == "nord"
        assert WELCOME[0] not in text(again)


async def test_wide_screens_show_block_and_history_too() -> None:
    station = FakeStation(picture())
    app = ConsoleApp(station)
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.press("s", "end")
        shown = text(app)
        assert "nothing is in it yet" in shown
        assert "sorted by significance" in shown[shown.index("HISTORY") :]
        assert all(word in shown for word in ("FINDS µm", "ODDS %", "BLOCK"))
        await pilot.resize_terminal(80, 24)
        await pilot.pause()
        assert "HISTORY" not in text(app)


async def test_the_culprit_is_told_apart_where_the_environment_wants_no_colour(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    app = ConsoleApp(FakeStation(picture()))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert app.no_color
        table = app.screen.query_one(TableView)
        lines = [table.render_line(y) for y in range(table.size.height)]
    accused = [line for line in lines if "REMEASURE" in line.text]
    (line,) = accused
    assert sum("<<" in other.text for other in lines) == 1
    (verdict,) = (segment for segment in line if "REMEASURE" in segment.text)
    assert verdict.style is not None
    assert verdict.style.bold
    assert verdict.style.reverse  # neither is a colour
    others = [segment for other in lines if other is not line for segment in other]
    assert not any(segment.style and segment.style.reverse for segment in others)
