"""The pages name every option, those of adjust and compare none that there is not."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import pytest
from clibench import every_parser

from anaplot.adjustment.strategies import STRATEGIES
from anaplot.cli import command_parser
from anaplot.report.adjustarguments import add_adjust_arguments
from anaplot.report.commandparser import CommandParser, commands_of
from anaplot.report.comparecommand import add_compare_arguments

DOCS = Path(__file__).parents[1] / "docs"
OUTPUT = {"--json", "--all", "--csv", "--to", "--fail-on-flag", "--apply", "--apply-undo"}


def options(add: object) -> set[str]:
    parser = argparse.ArgumentParser(add_help=False)
    add(parser)
    return {flag for action in parser._actions for flag in action.option_strings}


@pytest.mark.parametrize(
    ("page", "add"),
    [("adjust.md", add_adjust_arguments), ("epochs.md", add_compare_arguments)],
    ids=["adjust", "compare"],
)
def test_every_option_stands_on_its_page(page: str, add: object) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    told = {word.rstrip("-") for word in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)}
    known = options(add) - {"--help", "-h"}
    assert known - told == set()
    assert set(re.findall(r"`(--[a-z][a-z-]*)", text)) - known - OUTPUT == set()


@pytest.mark.parametrize(
    "parser", [*every_parser(command_parser())], ids=lambda parser: parser.prog
)
def test_every_command_and_option_stands_on_some_page(parser: CommandParser) -> None:
    pages = [page.read_text(encoding="utf-8") for page in sorted(DOCS.glob("*.md"))]
    told = {
        option.rstrip("-")
        for page in pages
        if parser.prog in page
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", page)
    }
    own = {flag for action in parser._actions for flag in action.option_strings if len(flag) > 2}
    assert own - told - {"--help"} == set()
    if not commands_of(parser):
        assert any(f"{parser.prog} " in page or f"{parser.prog}`" in page for page in pages)


def test_every_strategy_has_its_row_and_its_rate() -> None:
    text = (DOCS / "errors.md").read_text(encoding="utf-8")
    first = text.split("| strategy | rejects |")[1].split("\n\n")[0]
    cells = [line.split("|")[1] for line in first.splitlines()[2:]]
    assert sorted(re.findall(r"`(\w+)`", " ".join(cells))) == sorted(STRATEGIES)
    rates = text.split("## Rates")[1].split("### ")[0]
    heads = [line for line in rates.splitlines() if re.match(r"\| (scenario)?\s*\| `", line)]
    assert set(re.findall(r"`(\w+)`", " ".join(heads))) == set(STRATEGIES)
