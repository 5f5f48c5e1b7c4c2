"""A command line that is not right: one line that says what may have been meant."""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import string
import sys
from collections.abc import Callable
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

import pytest
from clibench import here, one_line
from hypothesis import given
from hypothesis import strategies as st

from anaplot.cli import command_parser, main
from anaplot.errors import InputError
from anaplot.report.commandparser import CommandParser, Commands, commands_of


def said(*words: str) -> str:
    with pytest.raises(InputError) as caught:
        command_parser().parse_args(list(words))
    return str(caught.value)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("brige", "no command 'brige' (did you mean 'bridge'?)"),
        ("Adjust", "no command 'Adjust' (did you mean 'adjust'?)"),
        ("frobnicate", "no command 'frobnicate' (see anaplot --help)"),
        # what is a part of another command is found, too
        ("network", "no command 'network' (did you mean 'plan network'?)"),
        ("simulate x", "no command 'simulate' (did you mean 'plan simulate'?)"),
        ("help adjust", "no command 'help' (did you mean '--help'?)"),
        ("version", "no command 'version' (did you mean '--version'?)"),
        ("plan frobnicate", "no command 'plan frobnicate' (known: pattern, block, network, add"),
        ("plan help", "no command 'plan help' (did you mean '--help'?)"),
        ("plan netwrk", "no command 'plan netwrk' (did you mean 'network'?)"),
        ("plotter chek", "no command 'plotter chek' (did you mean 'check'?)"),
        ("plan", "plan what? pattern, block, network, additional, simulate (see anaplot plan "),
        ("--json adjust x", "no option '--json' before the command (see anaplot --help)"),
        ("adjust x --jsn", "no option '--jsn' (did you mean '--json'?)"),
        ("adjust x --contol-last=3", "no option '--contol-last' (did you mean '--control-last'?)"),
        ("plan block --sidlap 20", "no option '--sidlap' (did you mean '--sidelap'?)"),
        ("bridge x -q", "no option '-q' (see anaplot bridge --help)"),
        ("bridge x y", "unrecognized argument 'y' (see anaplot bridge --help)"),
        ("adjust x --datum fre", "argument --datum: no 'fre' (did you mean 'free'?)"),
        ("fit x --degree 7", "argument --degree: no '7' (known: 1, 2, 3) (see anaplot fit --help)"),
        ("compare a", "the following arguments are required: EPOCH2 (see anaplot compare --help)"),
    ],
)
def test_what_was_meant(words: str, message: str) -> None:
    found = said(*words.split())
    assert found.startswith(message)
    assert found.count("see anaplot") <= 1


@pytest.mark.parametrize("wrong", ["colmp", "opensfn"])
def test_kinds_are_choices(wrong: str, capsys: pytest.CaptureFixture[str]) -> None:
    for words in (("import", wrong, "x", "-o", "y"), ("export", wrong, "x", "-o", "y")):
        one_line(here(capsys, *words), 2, f"'{wrong}'", "did you mean")


def every_command(parser: CommandParser) -> list[tuple[str, ...]]:
    found = []
    for name, one in commands_of(parser).items():
        found += [(name,), *((name, *rest) for rest in every_command(one))]
    return found


COMMANDS = every_command(command_parser())


def alike(one: str, other: str) -> float:
    return SequenceMatcher(None, other, one).ratio()


@pytest.mark.slow
@given(st.sampled_from(COMMANDS), st.data())
def test_a_swapped_letter_is_understood(command: tuple[str, ...], data: st.DataObject) -> None:
    *before, name = command
    at = data.draw(st.integers(0, len(name) - 2))
    wrong = name[:at] + name[at + 1] + name[at] + name[at + 2 :]
    if (*before, wrong) not in COMMANDS:
        answer = re.search(r"\(did you mean '(.*)'\?\)", said(*before, wrong))
        assert answer is not None
        # xeport may be export or report
        assert alike(answer[1], wrong) >= alike(name, wrong)


@pytest.mark.slow
@given(st.lists(st.text(string.printable + "é\u202e\x1b\0", max_size=8), min_size=1, max_size=4))
def test_no_line_is_wrong_in_more_than_one_line(words: list[str]) -> None:
    heard = io.StringIO()
    with contextlib.redirect_stderr(heard):
        assert main(["adjust", "--datum=no", *words]) == 2
    (line,) = heard.getvalue().splitlines()
    assert line.startswith("anaplot: ")
    assert line.isprintable()


def test_nothing_says_what_to_do_first(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["anaplot"])
    for result in (here(capsys), here(capsys, *())):
        assert (result.returncode, result.stdout) == (2, "")
        lines = result.stderr.splitlines()
        assert 3 < len(lines) < 10
        assert all(len(line) < 80 for line in lines)
        named = [line.split()[1] for line in lines[1:-1]]
        assert named == ["demo", "new", "import", "open", "adjust"]
        assert set(named) <= commands_of(command_parser()).keys()


def test_commands_stand_in_groups_in_the_order_of_the_work() -> None:
    parser = command_parser()
    grouped = [name for _, names in parser.groups for name in names]
    assert sorted(grouped) == sorted(commands_of(parser))
    order = ("demo", "plan", "new", "open", "bridge", "adjust", "compare", "export")
    assert [name for name in grouped if name in order] == list(order)
    text = parser.format_help()
    places = [text.index(f"\n    {name} ") for name in grouped]
    assert places == sorted(places)
    for title, names in parser.groups:
        assert text.index(f"  {title}:\n") < text.index(f"\n    {names[0]} ")


def test_a_python_that_hands_on_formatters_gets_the_same_help(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As those do that colour a help by the file it is printed to."""
    usual = command_parser().format_help()
    old = argparse.ArgumentParser
    formatter_of, help_of, print_message = old._get_formatter, old.format_help, old._print_message

    def help_with(self: argparse.ArgumentParser, formatter: object = None) -> str:
        assert formatter is not None
        return help_of(self)

    def print_help(self: Any, file: Any = None) -> None:
        print_message(self, self.format_help(formatter=self._get_formatter(file)), file)

    monkeypatch.setattr(old, "_get_formatter", lambda self, file=None: formatter_of(self))
    monkeypatch.setattr(old, "format_help", help_with)
    monkeypatch.setattr(old, "print_help", print_help)
    command_parser().print_help(sys.stdout)
    assert capsys.readouterr().out == usual


def test_what_prints_tables_writes_them_as_csv() -> None:
    parser = command_parser()
    lines_only = {"import", "export"}  # what was assumed and left out
    for name, one in commands_of(parser).items():
        for prog, command in ((name, one), *commands_of(one).items()):
            options = command._option_string_actions
            if "--json" in options and prog not in lines_only:
                assert {"--csv", "--all"} <= options.keys(), prog


@pytest.mark.parametrize("width", [20, 40, 80, 200])
def test_help_keeps_to_the_width(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    parser = command_parser()
    for one in (parser, *(commands_of(parser)[name] for name in ("adjust", "demo", "plan"))):
        text = one.format_help()
        cut = text.index("\nexamples:")
        if width >= 80:
            assert max(map(len, text[:cut].splitlines())) <= width
        assert text[cut:].splitlines()[2:] == [f"  {example}" for example in one.examples]


# -- options of several words before the block ---------------------------------------------------


@pytest.fixture
def block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("b").mkdir()
    return "b"


@pytest.mark.parametrize(
    "line",
    [
        "adjust b --covariance points:A photos:101 --json",
        "adjust --covariance points:A photos:101 b --json",
        "adjust --json --covariance points:A photos:101 b",
        "adjust --covariance points:A --json --covariance photos:101 b",
        "adjust --covariance=points:A --covariance=photos:101 b --json",
    ],
)
def test_the_block_may_stand_behind_the_unknowns(block: str, line: str) -> None:
    options = command_parser().parse_args(line.split())
    assert options.block == Path(block)
    assert options.covariance == ["points:A", "photos:101"]
    assert options.json


def test_the_block_may_stand_behind_an_optional_word(block: str) -> None:
    assert command_parser().parse_args(["adjust", "--components", "b"]).components == "axes"
    found = command_parser().parse_args(["adjust", "--components", "kinds", "b"])
    assert (found.components, found.block) == ("kinds", Path(block))


def test_where_there_is_no_such_block_nothing_is_guessed(block: str) -> None:
    found = said("adjust", "--covariance", "points:A", "points:B")
    assert found.startswith("the following arguments are required: BLOCK")
    assert found.endswith("--covariance takes every word behind it: write it last")
    assert "no 'nobody' (known: kinds" in said("adjust", "--components", "nobody")
    for name in ("x" * 5000, "x\0y", ""):
        assert "argument --components: no " in said("adjust", "--components", name)
    # a folder that is called like one of the choices is the choice
    Path("kinds").mkdir()
    assert "required: BLOCK" in said("adjust", "--components", "kinds")
    # and a folder too many is one
    assert "no 'b' (known: kinds" in said("adjust", "x", "--components", "b")
    assert command_parser().parse_args(["adjust", "x", "--covariance", "b"]).covariance == ["b"]


@pytest.mark.parametrize("words", [("--foo",), ("plan", "--foo"), ("--foo", "demo")])
def test_an_unknown_option_in_the_place_of_a_command_is_named(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    result = here(capsys, *words)
    assert result.returncode == 2
    assert "no option '--foo' before the command" in result.stderr


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (("adjust", ""), "argument BLOCK: an empty name (. is the folder you are in)"),
        (("adjust", "x", "--csv", ""), "argument --csv: an empty name"),
        (("adjust", "x", "--csv", "-"), "argument --csv: not to standard output: name a file"),
        (("adjust", "x", "--csv=a", "--csv=b"), "argument --csv: given twice"),
        (("bridge", "x", "--to", "a", "--to", "a"), "argument --to: given twice"),
        (("report", "x", "-o", "-"), "argument -o/--output: not to standard output"),
        (("report", "x", "-o", "a", "--output", "b"), "argument -o/--output: given twice"),
        (("pack", "x", "-o", ""), "argument -o/--output: an empty name"),
    ],
)
def test_what_is_written_has_one_name(line: tuple[str, ...], message: str) -> None:
    assert said(*line).startswith(message)


def test_a_file_may_be_named_like_standard_output() -> None:
    assert command_parser().parse_args(["adjust", "x", "--csv", "./-"]).csv == Path("-")


def test_only_the_command_that_is_called_adds_its_arguments() -> None:
    added = []

    def adding(name: str) -> Callable[[CommandParser], None]:
        def add(one: CommandParser) -> None:
            added.append(name)
            one.add_argument(f"--{name}")

        return add

    parser = CommandParser(prog="p")
    commands = Commands(parser, "command")
    for name in ("first", "second"):
        commands.add(name, lambda _: 0, name).later(adding(name), adding(f"{name}-too"))
    found = parser.parse_args(["second", "--second-too", "x"])
    assert (found.second, found.second_too) == (None, "x")
    assert added == ["second", "second-too"]
    # whoever looks at the others finds theirs, once
    first = commands_of(parser)["first"]
    assert "--first-too" in first._option_string_actions
    assert "--first " in first.format_help()
    assert added == ["second", "second-too", "first", "first-too"]
