"""The same computation for many blocks, on processes, a cluster or any executor."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from numpy.linalg import LinAlgError

from anaplot.aliases import Progress
from anaplot.errors import AnaplotError, InputError
from anaplot.exchange.answersfile import AnswersFile, KeptAnswer
from anaplot.exchange.blockfolder import read_block
from anaplot.photogrammetry.block import Block
from anaplot.report.computed import Computed
from anaplot.report.running import BlockOrFolder
from anaplot.report.sameasked import digest_of, name_of, unwrapped
from anaplot.report.workplace import place_of, said_how_to_go_on
from anaplot.shares.address import LOCAL, cluster_address
from anaplot.shares.work import SharesLostError, carry_out
from anaplot.textfiles.wording import plain, quoted
from anaplot.version import JSON_VERSION, __version__

__all__ = ["OneOfMany", "each"]

_WRITE = ("covariance_to", "posterior", "write_camera")  # keywords of `adjust` that name a new file


@dataclass(frozen=True, slots=True)
class OneOfMany:
    """What was computed of one of many blocks.

    Attributes
    ----------
    block
        The folder as it was given, or the block's name.
    answer
        What `--json` prints of it, see `Computed.to_dict`; None: it could not be computed.
    flagged
        What `--fail-on-flag` goes by.
    error
        Why it could not be computed, one line; None: it could.
    """

    block: str
    answer: dict[str, Any] | None
    flagged: bool
    error: str | None


def each(
    compute: Callable[..., Computed[Any]],
    blocks: Iterable[BlockOrFolder],
    *,
    on: str = LOCAL,
    processes: int | None = None,
    executor: Executor | None = None,
    to: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> tuple[OneOfMany, ...]:
    """Compute the same of many blocks; one that cannot be computed does not end the others.

    That is one with an `AnaplotError`, too little memory, or equations without a solution. What
    else `compute` raises is a fault of it, and ends the call.

    Parameters
    ----------
    compute
        `adjust`, `bridge`, `find_gross_errors`, or a function of a module that takes a block and
        returns a `Computed`; or a `functools.partial` of one.
    blocks
        Folders, or what `read_block` returned; folders are read here, and blocks sent.
    on, processes, executor
        As `simulate` has them. With more than one process a script needs the guard
        `if __name__ == "__main__"`.
    to
        A file that keeps the answers; the same call goes on from there. A block that has changed,
        or failed, is computed again; where an option says something else, or what is in a file
        that it names, the file is refused.
    progress
        Called with what is being done and the fraction of it (0 to 1).
    **options
        Keywords of `compute`. A file that they name is read by who computes.

    Returns
    -------
    tuple of OneOfMany
        In the order of the blocks.

    Raises
    ------
    InputError
        What does not go together, or a file that cannot be used.
    NotComputableError
        Workers were lost and could not be replaced, or a cluster does not answer.
    """
    try:
        cluster_address(on)
    except ValueError as error:
        raise InputError(f"--on: {plain(on, 60)!r}: {error}") from None
    place = place_of(on, processes, executor)
    given = _several(blocks)
    _check_writes_nothing(compute, options)
    names = [one.name if isinstance(one, Block) else os.fspath(one) for one in given]
    found: dict[int, OneOfMany] = {}
    with contextlib.ExitStack() as stack:
        file: AnswersFile | None = None
        if to is not None:
            file = stack.enter_context(AnswersFile(Path(to), _head(compute, options)))
        known = {} if file is None else {row.digest: row for row in file.rows}

        def shares() -> Iterator[_Share]:
            for number, one in enumerate(given):
                share = _read(number, one, digest=file is not None)
                kept = known.get(share.digest or "")
                if kept is None:
                    yield share
                else:
                    take(_Done(number, share.digest, kept.answer, kept.flagged, None), store=False)

        def take(done: _Done, *, store: bool = True) -> None:
            name = names[done.number]
            found[done.number] = OneOfMany(name, done.answer, done.flagged, done.error)
            if store and file is not None and done.digest is not None and done.answer is not None:
                file.keep(KeptAnswer(done.digest, done.flagged, done.answer), name)
            if progress is not None:
                progress("blocks", len(found) / len(given))

        def called(share: _Share) -> str:
            return f"block {quoted(names[share.number])}"

        try:
            carry_out(_Each(compute, options), shares(), len(given), place, take, called)
        except SharesLostError as error:
            raise said_how_to_go_on(error, to) from error
    return tuple(found[number] for number in range(len(given)))


def _check_writes_nothing(compute: Callable[..., Any], options: dict[str, Any]) -> None:
    """Raise where every block would write the same file over."""
    called, partials = unwrapped(compute)
    for one in partials:
        options = {**one.keywords, **options}
    ours = str(getattr(called, "__module__", "")).startswith("anaplot.")
    for name in _WRITE if ours else ():
        if options.get(name) is not None:
            raise InputError(
                f"{name}: every block would write {plain(str(options[name]), 60)} over: an option "
                "that writes a file does not go with several blocks"
            )


def _several(blocks: Iterable[BlockOrFolder]) -> list[BlockOrFolder]:
    if isinstance(blocks, str | bytes | os.PathLike | Block):
        raise InputError("blocks: one block, not several: put it into a list")
    given: list[Any] = list(blocks)
    for number, one in enumerate(given, 1):
        if not isinstance(one, Block | str | os.PathLike):
            kind = plain(type(one).__name__, 60)
            raise InputError(f"blocks: number {number} is a {kind}, no block and no folder")
    return given


class _Share(NamedTuple):
    number: int
    block: Block | str  # or why there is none
    digest: str | None


class _Done(NamedTuple):
    number: int
    digest: str | None
    answer: dict[str, Any] | None
    flagged: bool
    error: str | None


@dataclass(frozen=True, slots=True)
class _Each:
    """One computation as `Work`."""

    compute: Callable[..., Computed[Any]]
    options: dict[str, Any]

    def prepare(self) -> Callable[[_Share], _Done]:
        return self.do

    def do(self, share: _Share) -> _Done:
        if isinstance(share.block, str):
            return _Done(share.number, None, None, False, share.block)
        try:
            found = self.compute(share.block, **self.options)
            return _Done(share.number, share.digest, found.to_dict(), found.flagged, None)
        except AnaplotError as error:
            return _Done(share.number, None, None, False, str(error))
        except MemoryError:
            return _Done(share.number, None, None, False, "this needs more memory than there is")
        except LinAlgError as error:
            return _Done(share.number, None, None, False, f"no solution: {plain(str(error), 200)}")


def _read(number: int, one: BlockOrFolder, *, digest: bool) -> _Share:
    try:
        block = one if isinstance(one, Block) else read_block(one)
        return _Share(number, block, digest_of("the block", block) if digest else None)
    except AnaplotError as error:
        return _Share(number, str(error), None)


def _head(compute: Callable[..., Any], options: dict[str, Any]) -> dict[str, Any]:
    """Return what tells a computation from another one."""
    name, parts = name_of(compute)
    asked = sorted(options.items())
    return {
        "anaplot": __version__,
        "json": JSON_VERSION,
        "compute": name,
        "options": {option: _said(value) for option, value in asked},
        "content": digest_of("an option", [asked, parts], names_files=True),
    }


def _said(value: Any) -> str:
    """Return an option for people; what it holds is in the digest."""
    return plain(os.fspath(value) if isinstance(value, os.PathLike) else repr(value), 200)
