"""Every line of docs/papers.md gives what it says."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from anaplot.cli import main

PAGE = Path(__file__).parents[1] / "docs" / "papers.md"
PART = re.compile(r"([A-Za-z_]+)|\[([^\]]*)\]")
FEWEST = 50


class PrintedNumber(NamedTuple):
    where: str
    command: str
    path: str
    printed: str
    computed: str
    note: str


def printed_numbers() -> list[PrintedNumber]:
    found = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and cells[1].startswith("`anaplot "):
            where, command, path, *others = cells
            found.append(PrintedNumber(where, command.strip("`"), path.strip("`"), *others))
    return found


def value_at(answer: Any, path: str) -> Any:
    for name, inside in PART.findall(path):
        if name:
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
        if one.command not in answers:
            assert main([*shlex.split(one.command)[1:], "--json"]) == 0
            answers[one.command] = json.loads(capsys.readouterr().out)
        value = value_at(answers[one.command], one.path)
        if abs(value - float(one.computed)) > 0.51 * 10.0 ** -decimals(one.computed):
            wrong.append((one.where, one.computed, value))
    assert wrong == []


def test_what_is_not_as_printed_is_explained() -> None:
    for one in printed_numbers():
        if not one.printed or one.note:
            continue
        # printed numbers of these papers are cut as often as rounded
        assert abs(float(one.printed) - float(one.computed)) <= 10.0 ** -decimals(one.printed), one
