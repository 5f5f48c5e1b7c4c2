"""A command that computes: read, compute, show."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeAlias

from anaplot.exchange.blockfolder import block_files, read_block
from anaplot.photogrammetry.block import Block
from anaplot.report.computed import Computed
from anaplot.report.interrupts import EndingEarly
from anaplot.report.keywords import keywords_of
from anaplot.report.output import Output
from anaplot.report.progress import ProgressLine
from anaplot.textfiles.wording import place, plain

__all__ = ["BlockOrFolder", "block_of", "run_computation"]

BlockOrFolder: TypeAlias = Block | str | os.PathLike[str]
"""A block, or the folder of one."""


def run_computation(
    options: argparse.Namespace,
    compute: Callable[..., Computed[Any]],
    folders: Iterable[Path],
) -> int:
    """Run what a command computes and show it.

    Parameters
    ----------
    options
        Of the command line.
    compute
        Takes them as keywords, and `progress`.
    folders
        The blocks that it reads.

    Returns
    -------
    int
        Exit code 0, or 1 with `--fail-on-flag` when something is flagged.

    Raises
    ------
    AnaplotError
        Bad input, or what cannot be computed; nothing is printed then.
    """
    output = Output.of(options)
    output.check({"is read": [file for folder in folders for file in block_files(folder)]})
    with ProgressLine(sys.stderr) as line:
        found = compute(**keywords_of(compute, options), progress=EndingEarly(line, sys.stderr))
    output.show(found.document)
    return 1 if options.fail_on_flag and found.flagged else 0


def block_of(block: BlockOrFolder) -> tuple[Block, str]:
    """Return a block, read where a folder is given, and how messages name its settings."""
    if isinstance(block, Block):
        return block, f"block {plain(block.name)}"
    return read_block(block), place(Path(block) / "block.toml")
