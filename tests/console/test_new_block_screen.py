"""A new block as a screen: the questions of `anaplot new`."""

import argparse
import re
from pathlib import Path

import pytest
from rich.cells import cell_len
from screenreading import lines, text
from textual.widgets import Input

from anaplot.adjustment.leastsquares import RankDefectError
from anaplot.cli import main
from anaplot.console import newblockscreen
from anaplot.console.newblockscreen import NewBlockApp, ask_for_block
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.report.newquestions import NONE, new_block, new_questions

SIZES = [(80, 24), (160, 50)]


async def answer(pilot, words: str) -> None:
    """Write over what stands in the field, then enter."""
    await pilot.press("ctrl+u", *words, "enter")


@pytest.mark.parametrize("size", SIZES)
async def test_the_defaults_are_a_block(size, tmp_path):
    folder = tmp_path / "survey"
    app = NewBlockApp(folder)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        shown = lines(app)
        assert {cell_len(line) for line in shown} == {size[0]}
        for question in new_questions(folder):
            assert any(
                line.split() == [*question.short.split(), question.default] for line in shown
            )
        await pilot.press("down")
        assert ("Jena LMK 15/2323" if size[0] > 110 else "lmk15") in text(app)
        await pilot.press("f4")
    assert app.return_value[-1].startswith(f"next: anaplot open {folder} --simulate")
    block = read_block(folder)
    assert block.name == "survey"
    assert [strip.photos for strip in block.strips] == [("101", "102", "103")]
    assert block.measuring.pattern is None
    # the same as the command writes
    assert main(["new", str(tmp_path / "other"), "--name", "survey", "--strip", "101-103"]) == 0
    written = [(tmp_path / name / "block.toml").read_text() for name in ("survey", "other")]
    assert written[0] == written[1]


@pytest.mark.parametrize("size", SIZES)
async def test_what_is_wrong_stands_at_its_field_and_nothing_is_written(size, tmp_path):
    app = NewBlockApp(tmp_path / "b")
    async with app.run_test(size=size) as pilot:
        await answer(pilot, "my block")
        await answer(pilot, "rcx")
        assert app.focused.id == "camera"
        assert "camera 'rcx': neither a common type" in text(app)
        # F4 goes to the first field that is wrong
        await pilot.press("tab", "tab")
        await answer(pilot, "nowhere.csv")
        assert "nowhere.csv" in text(app)
        await pilot.press("f4")
        assert app.focused.id == "camera"
        assert not (tmp_path / "b").exists()
        await answer(pilot, "rc8")
        assert "neither a common type" not in text(app)
        await answer(pilot, "1-4; west=9-7")
        await answer(pilot, NONE)
        await answer(pilot, "anaplot-ascii")
        await answer(pilot, "9")
        await answer(pilot, "-1")
        assert app.focused.id == "sigma"
        await answer(pilot, "6")
    block = read_block(tmp_path / "b")
    assert block.name == "my block"
    assert [(s.id, s.photos) for s in block.strips] == [
        ("1", ("1", "2", "3", "4")),
        ("west", ("9", "8", "7")),
    ]
    assert (block.measuring.profile, block.measuring.pattern) == ("anaplot-ascii", "9")
    assert block.precision.image_um == 6.0


async def test_what_only_the_whole_says_is_told_too(tmp_path):
    (tmp_path / "image_points.csv").write_text("photo,point,x,y\na,1,116,2\nb,1,1,2\n")
    app = NewBlockApp(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert app.query_one("#strip", Input).value == NONE
        await pilot.press("f4")
        await pilot.pause()
        assert "lies outside the format of camera 'rmk15'" in re.sub(r"\s+", " ", text(app))
        assert not (tmp_path / "block.toml").exists()
        await pilot.press("escape")
    assert app.return_value is None


async def test_fields_are_chosen_by_mouse_and_text_is_no_markup(tmp_path):
    app = NewBlockApp(tmp_path / "[b]x[/b]")
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert lines(app)[0].rstrip().endswith("[b]x[/b]")
        await pilot.click("#control")
        await answer(pilot, "[red]no.csv")
        assert "[red]no.csv" in text(app)


def test_leaving_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(NewBlockApp, "run", lambda self: None)
    with pytest.raises(InputError, match="nothing is written"):
        ask_for_block(tmp_path / "b")


def test_without_a_terminal_it_is_an_error_as_ever(tmp_path, capsys):
    assert main(["open", str(tmp_path / "nowhere"), "--simulate"]) == 2
    assert "no such folder" in capsys.readouterr().err
    assert main(["open", str(tmp_path)]) == 2
    assert "block.toml" in capsys.readouterr().err


@pytest.mark.parametrize("device", [False, True])
def test_open_asks_where_there_is_no_block(tmp_path, monkeypatch, capsys, device):
    """With a device it goes on into the console; else it says the command."""
    monkeypatch.setattr("anaplot.cli._is_missing", lambda folder: True)
    asked, opened = [], []

    def ask(folder: Path, *, instrument: bool) -> tuple[str, ...]:
        asked.append(folder)
        return ("written", "next: anaplot open b")

    def station(folder: Path, **options: object) -> None:
        opened.append(folder)
        raise InputError("far enough")

    monkeypatch.setattr(newblockscreen, "ask_for_block", ask)
    monkeypatch.setattr("anaplot.simulation.opening.open_station", station)
    arguments = ["open", str(tmp_path / "b"), *(["--simulate"] if device else [])]
    assert main(arguments) == (2 if device else 0)
    assert asked == [tmp_path / "b"]
    assert opened == ([tmp_path / "b"] if device else [])
    assert "next: anaplot open b" in capsys.readouterr().out


def test_options_questions_and_screen_have_one_declaration(tmp_path):
    from anaplot.report.newarguments import add_new_arguments

    parser = argparse.ArgumentParser()
    add_new_arguments(parser)
    options = {action.dest: action.help or "" for action in parser._actions}
    for question in new_questions(tmp_path / "b"):
        assert question.name in options
        assert question.fault([question.default]) == ""
        assert question.optional or question.default in options[question.name] + "b"
    assert new_block(tmp_path / "b", {}).strips == ()


async def test_an_instrument_that_waits_needs_its_profile(tmp_path):
    folder = tmp_path / "b"
    app = NewBlockApp(folder, instrument=True)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("f4")
        assert "the instrument at --port needs its profile" in text(app)
        assert app.focused.id == "profile"
        assert not folder.exists()
        await pilot.press("ctrl+u", *"anaplot-ascii", "f4")
    assert read_block(folder).measuring.profile == "anaplot-ascii"


def test_a_device_that_is_not_there_is_told_with_the_command_that_goes_on(
    tmp_path, capsys, monkeypatch
):
    folder = tmp_path / "b"

    def written(where, *, instrument):
        assert instrument
        assert main(["new", str(where), "--strip", "101-103", "--profile", "anaplot-ascii"]) == 0
        return ()

    monkeypatch.setattr("anaplot.cli._is_missing", lambda _: True)
    monkeypatch.setattr("anaplot.cli.need_terminal", lambda: None)
    monkeypatch.setattr(newblockscreen, "ask_for_block", written)
    assert main(["open", str(folder), "--port", str(tmp_path / "nothing")]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "nothing" in line
    assert line.endswith(
        f"; the block is written - anaplot open {folder} --port {tmp_path}/nothing opens it"
    )


def test_an_error_that_knows_more_than_its_text_is_told_with_the_command_too(
    tmp_path, capsys, monkeypatch
):
    def opened(*_, **__):
        raise RankDefectError(("scale",), 1e9)

    monkeypatch.setattr("anaplot.cli._is_missing", lambda _: True)
    monkeypatch.setattr(newblockscreen, "ask_for_block", lambda _, *, instrument: ())
    monkeypatch.setattr("anaplot.simulation.opening.open_station", opened)
    assert main(["open", str(tmp_path / "b"), "--simulate"]) == 4
    (line,) = capsys.readouterr().err.splitlines()
    assert "not determined: scale (condition number 1e+09); the block is written - " in line
