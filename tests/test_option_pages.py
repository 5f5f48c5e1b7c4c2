"""The pages of adjust and compare name every option of theirs, and none that there is not."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import pytest

from anaplot.adjustment.strategies import STRATEGIES
from anaplot.report.adjustarguments import add_adjust_arguments
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


def test_every_strategy_has_its_row_and_its_rate() -> None:
    text = (DOCS / "errors.md").read_text(encoding="utf-8")
    first = text.split("| strategy | rejects |")[1].split("\n\n")[0]
    cells = [line.split("|")[1] for line in first.splitlines()[2:]]
    assert sorted(re.findall(r"`(\w+)`", " ".join(cells))) == sorted(STRATEGIES)
