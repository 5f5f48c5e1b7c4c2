"""A command that computes, run on options as keywords or on words, and a block for it."""

from __future__ import annotations

import io
import json
from argparse import Namespace
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from anaplot import cli
from anaplot.exchange.blockfolder import (
    block_files,
    write_control,
    write_image_points,
    write_new_block,
)
from anaplot.photogrammetry.block import Block
from anaplot.report.adjustarguments import add_adjust_arguments
from anaplot.report.adjustcommand import adjust
from anaplot.report.keywords import declared_options
from anaplot.report.running import run_computation


def run_adjust(
    folder: Path,
    *,
    as_json: bool = False,
    out: io.StringIO | None = None,
    err: io.StringIO | None = None,
    **options: Any,
) -> tuple[int, str, str]:
    """Return exit code, output and errors; keywords are the options by their names."""
    out = io.StringIO() if out is None else out
    err = io.StringIO() if err is None else err
    asked = {name: each.default for name, each in declared_options(add_adjust_arguments).items()}
    asked |= {"all": True, "json": as_json, "block": folder, **options}
    with redirect_stdout(out), redirect_stderr(err):
        code = run_computation(Namespace(**asked), adjust, block_files(folder))
    return code, out.getvalue(), err.getvalue()


def written(block: Block, folder: Path) -> Path:
    """Write a block with its measurements and control into a new folder."""
    write_new_block(folder, replace(block, image_points=(), control=()))
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    return folder


def run(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, object]:
    """Return what `adjust --json` answers."""
    assert cli.main(["adjust", *map(str, words), "--json"]) == 0
    answer: dict[str, object] = json.loads(capsys.readouterr().out)
    return answer
