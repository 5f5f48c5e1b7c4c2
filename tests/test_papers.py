"""Every line of docs/papers.md gives what it says."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import pytest

from anaplot.cli import main

PAGE = Path(__file__).parents[1] / "docs" / "papers.md"
COMMAND = re.compile(r"`(anaplot [^`]*)`")
WITHIN = re.compile(r"within (\d\.\d+): ")
PART = re.compile(r"([A-Za-z_]+)|\[([^\]]*)\]")
FEWEST = 50


class PrintedNumber(NamedTuple):
    where: str
    commands: tuple[str, ...]
    path: str
    printed: str
    computed: str
    note: str


def printed_numbers() -> list[PrintedNumber]:
    found = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and cells[1].startswith("`anaplot "):
            where, commands, path, *others = cells
            called = tuple(COMMAND.findall(commands))
            assert " and ".join(f"`{one}`" for one in called) == commands
            found.append(PrintedNumber(where, called, path.strip("`"), *others))
    return found


def value_at(answer: Any, path: str) -> Any:
    for name, inside in PART.findall(path):
        if name == "length":
            answer = len(answer)
        elif name:
            answer = answer[name]
        elif inside.isdigit():
            answer = answer[int(inside)]
        else:
            wanted = dict(part.split("=") for part in inside.split(","))
            answer = next(o for o in answer if all(words(o[k]) == v for k, v in wanted.items()))
    return answer


def words(value: Any) -> str:
    return " ".join(value) if isinstance(value, list) else str(value)


def decimals(number: str) -> int:
    return len(number.partition(".")[2])


@pytest.mark.slow
def test_every_number_is_what_its_command_gives(capsys) -> None:
    answers: dict[str, Any] = {}
    wrong = []
    numbers = printed_numbers()
    assert len(numbers) >= FEWEST
    for one in numbers:
        for command in one.commands:
            if command not in answers:
                assert main([*shlex.split(command)[1:], "--json"]) == 0
                answers[command] = json.loads(capsys.readouterr().out)
        value = fmean(value_at(answers[command], one.path) for command in one.commands)
        if abs(value - float(one.computed)) > 0.51 * 10.0 ** -decimals(one.computed):
            wrong.append((one.where, one.computed, value))
    assert wrong == []


def test_what_is_not_as_printed_is_explained() -> None:
    for one in printed_numbers():
        within = WITHIN.match(one.note)
        if not one.printed or (one.note and not within):
            continue
        # printed numbers of these papers are cut as often as rounded
        bound = float(within[1]) if within else 10.0 ** -decimals(one.printed)
        assert abs(float(one.printed) - float(one.computed)) <= bound, one
