"""CSV files that commands write beside their report."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from anaplot.errors import InputError
from anaplot.report.ascsv import csv_text
from anaplot.report.document import Table
from anaplot.textfiles.wholefile import replace_whole
from anaplot.textfiles.wording import place, reason

__all__ = ["check_csv", "write_table"]


def check_csv(
    path: Path | None,
    taken: Mapping[str, Iterable[Path]] | None = None,
    made: Path | None = None,
) -> None:
    """Refuse a file that could not be written, before anything is computed or written.

    Parameters
    ----------
    path
        The file that is asked for, or None.
    taken
        Files that the command uses otherwise, by what becomes of them: "is read".
    made
        A folder that the command makes before it writes the file.

    Raises
    ------
    InputError
        Its folder does not exist or is read-only, or it is a folder, taken, or the standard output
        itself.
    """
    if path is None:
        return
    where = f"{place(path)}: cannot be written"
    try:
        # as it will be written: in place of what a link leads to
        target = path.resolve()
        parent = target.parent
        if target.is_dir():
            raise InputError(f"{where}: it is a folder")
        if path.is_file() or not path.exists():
            if parent.is_dir():
                if not os.access(parent, os.W_OK):
                    raise InputError(f"{where}: the folder is read-only")
            elif made is None or parent != made.resolve():
                raise InputError(f"{where}: there is no folder {place(parent)}")
        uses = {**(taken or {}), "becomes a folder": () if made is None else (made,)}
        for use, files in uses.items():
            if any(target == file.resolve() for file in files):
                raise InputError(f"{where}: it {use}; name another file for the table")
        if path.is_file() and _is_output(path):
            raise InputError(f"{where}: the report goes there")
    except (OSError, ValueError) as error:
        raise InputError(f"{where}: {reason(error)}") from error


def write_table(path: Path, table: Table) -> None:
    """Write a document's table, whole or not at all.

    Raises
    ------
    InputError
        It could not be written; an old file is as it was.
    """
    data = csv_text(table).encode()
    try:
        # a pipe or a device is no file that could be replaced
        if path.exists() and not path.is_file():
            path.write_bytes(data)
            return
        target = path.resolve()
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be written: {reason(error)}") from error
    replace_whole(target, data)


def _is_output(path: Path) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(sys.__stdout__.fileno()))  # type: ignore[union-attr]
    except (AttributeError, OSError, ValueError):
        # there is no standard output, or it is no file
        return False
