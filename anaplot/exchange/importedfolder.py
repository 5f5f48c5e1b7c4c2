"""The folder of a block that was brought in: commented, with its source beside it."""

from __future__ import annotations

import os
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files, write_block
from anaplot.exchange.blocktoml import format_block_toml
from anaplot.exchange.controlcsv import parse_control
from anaplot.exchange.formats.door import SOURCE, Imported
from anaplot.exchange.formats.filecopy import pieces
from anaplot.textfiles.wholefile import all_or_nothing, create_whole, make_folder
from anaplot.textfiles.wording import place, plain

__all__ = ["write_imported"]


def write_imported(folder: Path, imported: Imported, read: Path) -> None:
    """Write a block that was brought in as a new folder; all of it, or nothing.

    Parameters
    ----------
    folder
        The block folder, made when it does not exist.
    imported
        What was read.
    read
        Of which file or folder.

    Raises
    ------
    InputError
        Something of the kind is there already, or cannot be written; or what was read would be
        refused by all that reads a block.
    """
    comments = [f"# {plain(line, 400)}".rstrip() for line in imported.comments]
    text = "\n".join([*comments, "", format_block_toml(imported.block)])
    with all_or_nothing():
        make_folder(folder)
        source = folder / SOURCE
        if os.path.lexists(source):
            raise InputError(f"{place(source)}: exists already and is not overwritten")
        for name, path in imported.source.items():
            target = source.joinpath(*name.split("/"))
            for parent in reversed(target.relative_to(folder).parents):
                make_folder(folder / parent)
            create_whole(target, pieces(path))
        try:
            write_block(folder, imported.block, text=text.lstrip("\n"))
            if imported.block.control or imported.block.priors:
                parse_control(block_files(folder)[2])
        except InputError as error:
            raise _of_source(error, folder, read) from None


def _of_source(error: InputError, folder: Path, read: Path) -> InputError:
    """Return an error about a line of a file that is not there for long as one of what was read."""
    for path in block_files(folder):
        begin, colon, wrong = str(error).partition(": ")
        if colon and begin.startswith(f"{place(path)} line "):
            return InputError(f"{place(read)}: no block can hold it: {wrong}")
    return error
