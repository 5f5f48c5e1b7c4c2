"""The one line in the shell after the console: what was done, what is next, the command."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from anaplot.session.workdone import WorkDone
from anaplot.station.blockstep import NextStep
from anaplot.textfiles.wording import plain, typed_value

__all__ = ["open_again", "parting_line"]

_GIVEN = ("profile", "port", "truth", "pattern", "operator")


def open_again(folder: Path, options: argparse.Namespace) -> str:
    """Return the command with which a block was opened, for the next time.

    Parameters
    ----------
    folder
        The block's.
    options
        Those of `open`; what has its default is not repeated.
    """
    words = ["anaplot", "open", typed_value(folder)]
    if getattr(options, "simulate", False):
        words.append("--simulate")
        if options.seed != 1:
            words += ["--seed", str(options.seed)]
    for name in _GIVEN:
        value = getattr(options, name, None)
        if value:
            words += [f"--{name}", str(value)]
    return plain(" ".join(shlex.quote(word) for word in words))


def parting_line(done: WorkDone, step: NextStep | None, opening: str) -> str:
    """Return the line.

    Parameters
    ----------
    done
        What was done.
    step
        What is next, or None where nobody will go on: the block is not kept.
    opening
        The command that opens the block again; where it is not kept, what would keep it.
    """
    parts = []
    if done.models:
        parts.append(f"{done.models} model{'' if done.models == 1 else 's'} accepted")
    if done.points:
        parts.append(f"{done.points} point{'' if done.points == 1 else 's'} measured")
    said = ", ".join(parts) or "nothing measured"
    if step is None:
        return f"{said}; the block is deleted - {opening}"
    command = opening if step.opens else step.command
    return f"{said}; next: {plain(step.words)} - {command}"
