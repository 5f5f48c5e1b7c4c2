"""`anaplot new`: a block from a few answers, or from options without questions."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from anaplot.errors import InputError
from anaplot.report.newquestions import (
    NONE,
    Answers,
    Question,
    answered,
    camera_types,
    new_block,
    new_questions,
)

if TYPE_CHECKING:
    from anaplot.photogrammetry.block import Block

__all__ = ["run_new", "write_answers"]

_GIVEN = ("name", "camera", "strip", "control", "profile", "pattern", "sigma")


def run_new(options: argparse.Namespace) -> int:
    """Write a new block and say what is in it and what is next."""
    from anaplot.textfiles.wording import place

    folder: Path = options.folder
    if os.path.lexists(folder / "block.toml"):
        raise InputError(f"{place(folder / 'block.toml')}: exists already and is not overwritten")
    if options.camera == "?":
        print(_cameras())
        return 0
    answers = _given(options)
    if not answers and sys.stdin is not None and sys.stdin.isatty():
        answers = _asked(folder)
    for line in write_answers(folder, answers):
        print(line)
    return 0


def write_answers(folder: Path, answers: Answers) -> tuple[str, ...]:
    """Write the block that the answers describe.

    Returns
    -------
    tuple[str, ...]
        Lines for people: what is in it, what its camera is, what is next.

    Raises
    ------
    InputError
        An answer is wrong, the block exists, or it cannot be written.
    """
    from anaplot.exchange.newblock import write_new
    from anaplot.station.waystoopen import ways_to_open
    from anaplot.textfiles.wording import plain, typed_path

    new = new_block(folder, answers)
    block = write_new(folder, new)
    shown = typed_path(folder)
    following = f"anaplot open {shown} {ways_to_open(block)}"
    if block.image_points:
        following = f"anaplot {'bridge' if block.strips else 'adjust'} {shown}"
    camera = f"camera {plain(block.cameras[0].id)}: {new.camera.remark}"
    commas = ("control: numbers with a decimal comma",) if new.commas else ()
    return _summary(shown, block), camera, *commas, f"next: {following}"


def _given(options: argparse.Namespace) -> dict[str, list[str]]:
    """Return what the options say."""
    found = {name: getattr(options, name) for name in _GIVEN}
    return {
        name: list(value) if isinstance(value, list) else [str(value)]
        for name, value in found.items()
        if value is not None
    }


def _asked(folder: Path) -> dict[str, list[str]]:
    """Ask for everything; an empty answer takes the default."""
    answers: dict[str, list[str]] = {}
    for question in new_questions(folder):
        said: list[str] = []
        while not said or (question.many and said[-1] != NONE):
            said.append(_answer(question, said))
        answers[question.name] = said
    return answered(folder, answers)


def _answer(question: Question, before: list[str]) -> str:
    """Ask until the answer can be read; `before`: those to the same question."""
    default = NONE if before else question.default
    text = question.text.format(number=len(before) + 1)
    while True:
        try:
            answer = input(f"{text} [{default}]: ").strip() or default
        except EOFError:
            raise InputError("the questions were not answered: nothing is written") from None
        if answer == "?":
            print(_cameras())
            continue
        fault = question.fault([*before, answer])
        if not fault:
            return answer
        print(f"  {fault}")


def _cameras() -> str:
    return "\n".join(f"  {name:9} {title}" for name, title in camera_types())


def _summary(folder: str, block: Block) -> str:
    from anaplot.textfiles.wording import plain

    counts = (
        (len(block.strips), "strip"),
        (len(block.photos), "photo"),
        (len(block.image_points), "image point"),
        (len(block.control), "control point"),
        (len(block.priors), "point prior"),
    )
    parts = [f"{count} {what}{'' if count == 1 else 's'}" for count, what in counts if count]
    return f"{folder}: block {plain(block.name)}, " + ", ".join(parts)
