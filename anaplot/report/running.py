"""A command that computes: read, compute, show."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import read_block
from anaplot.freedmemory import keep_freed_memory
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.imagepoints import check_coordinates
from anaplot.report.computed import Computed
from anaplot.report.interrupts import EndingEarly, TimeLimit
from anaplot.report.keywords import Declare, declared_options, keywords_of
from anaplot.report.output import Output
from anaplot.report.progress import ProgressLine
from anaplot.textfiles.wording import place, plain

if TYPE_CHECKING:
    from anaplot.report.pageoption import AskedPage
    from anaplot.shares.work import Place

__all__ = [
    "BlockOrFolder",
    "block_of",
    "computed",
    "refuse_with_several",
    "run_computation",
    "run_side_by_side",
]

T = TypeVar("T")

BlockOrFolder: TypeAlias = Block | str | os.PathLike[str]
"""A block, or the folder of one."""


def run_computation(
    options: argparse.Namespace,
    compute: Callable[..., Computed[T]],
    reads: Iterable[Path],
    page: AskedPage | None = None,
) -> int:
    """Run what a command computes and show it.

    Parameters
    ----------
    options
        Of the command line.
    compute
        As `computed` has it.
    reads
        The files that it reads.
    page
        That `--report` writes; None: the command has no such option.

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
    output.check({"is read": reads, **({} if page is None else page.uses)})
    found = computed(options, compute)
    output.show(found.document if page is None else page.shown(found))
    return 1 if found.flagged and options.fail_on_flag else 0


def refuse_with_several(
    options: argparse.Namespace, alone: Iterable[str], declare: Declare, one: str
) -> None:
    """Refuse options of which nothing would be seen where results stand side by side.

    Parameters
    ----------
    options
        Of the command line.
    alone
        Names of those that go with one result.
    declare
        Adds the command's options.
    one
        What there must be one of.

    Raises
    ------
    InputError
        One of them is not what it is without.
    """
    declared = {key: declared_options(declare)[key] for key in alone}
    if any(getattr(options, key) != option.default for key, option in declared.items()):
        *first, last = (option.option_strings[0] for option in declared.values())
        raise InputError(f"{', '.join(first)} and {last} go with {one}")


def run_side_by_side(
    options: argparse.Namespace,
    option: str,
    compute: Callable[..., Computed[T]],
    compare: Callable[[Sequence[T]], Computed[Any]],
    reads: Iterable[Path] = (),
    at: Place | None = None,
) -> int:
    """Compute anew with each value of an option, and show the results beside each other.

    Parameters
    ----------
    options
        Of the command line.
    option
        Name of the one with several values; each is given alone, as a sequence of one.
    compute
        As `computed` has it.
    compare
        Puts the results side by side.
    reads
        The files that it reads.
    at
        Where, each value a share; None: here, one after the other.

    Raises
    ------
    AnaplotError
        Bad input, or what cannot be computed; nothing is printed then.
    """
    output = Output.of(options)
    output.check({"is read": reads})
    several = [
        argparse.Namespace(**{**vars(options), option: (value,)})
        for value in getattr(options, option)
    ]
    if at is None:
        results = [computed(one, compute).result for one in several]
    else:
        from anaplot.shares.work import in_order

        with ProgressLine(sys.stderr) as line:
            keywords = [keywords_of(compute, vars(one)) for one in several]
            results = in_order(partial(_result, compute), keywords, at, partial(line, option))
    output.show(compare(results).document)
    return 0


def _result(compute: Callable[..., Computed[T]], keywords: dict[str, Any]) -> T:
    return compute(**keywords).result


def computed(options: argparse.Namespace, compute: Callable[..., Computed[T]]) -> Computed[T]:
    """Return what a command computes; its progress is shown, and an interrupt ends a search.

    Memory that is freed on the way is kept for what comes: see `freedmemory`.

    Parameters
    ----------
    options
        Of the command line.
    compute
        Takes those that are its keywords, and `progress` if that is one.

    Raises
    ------
    NotComputableError
        The time that `--time-limit` gives is over, and there is nothing to be shown yet.
    KeyboardInterrupt
        With how far it came.
    """
    keep_freed_memory()
    limit = TimeLimit(getattr(options, "time_limit", None))
    with ProgressLine(sys.stderr) as line:
        line("reading", 0.0)
        watch = EndingEarly(line, sys.stderr, limit)
        try:
            with limit:
                return compute(**keywords_of(compute, {**vars(options), "progress": watch}))
        except KeyboardInterrupt:
            if limit.over:
                raise NotComputableError(
                    f"not finished in the {limit.seconds:g} s of --time-limit: {line.reached}"
                ) from None
            raise KeyboardInterrupt(f"interrupted: {line.reached}") from None


def block_of(block: BlockOrFolder) -> tuple[Block, str]:
    """Return a block, read where a folder is given, and how messages name its settings.

    Raises
    ------
    InputError
        It cannot be read; of a block in memory, an image coordinate is none.
    """
    if isinstance(block, Block):
        check_coordinates(block.image_points)
        return block, f"block {plain(block.name)}"
    return read_block(block), place(Path(block) / "block.toml")
