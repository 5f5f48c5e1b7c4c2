"""Where a command's document goes: to standard output, and as CSV into files."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, TextIO

from anaplot.errors import InputError
from anaplot.report.ascsv import csv_text
from anaplot.report.asjson import json_parts, json_text
from anaplot.report.astext import page_parts
from anaplot.report.document import Document, Table
from anaplot.report.streams import system_message
from anaplot.textfiles.inputfile import read_bytes, real_path
from anaplot.textfiles.wholefile import (
    all_or_nothing,
    make_folder,
    replace_whole,
    write_together,
)
from anaplot.textfiles.wording import place, reason

__all__ = ["Output"]

_SUMMARY = "summary.json"
_MOST_BYTES = 500_000_000  # of a summary
_TABLE = re.compile(r"[a-z0-9_]{1,64}")


class Output(NamedTuple):
    """How a command shows its document.

    Attributes
    ----------
    as_json
        Print the answer for programs instead of the page.
    everything
        Print long tables and lists whole.
    csv
        A file for the main table.
    to
        A folder for all tables, and for the rest of the answer.
    stream
        Standard output when None.
    named
        Other files that the command line names.
    """

    as_json: bool = False
    everything: bool = False
    csv: Path | None = None
    to: Path | None = None
    stream: TextIO | None = None
    named: tuple[Path, ...] = ()

    @classmethod
    def of(cls, options: argparse.Namespace) -> Output:
        """Return what the options of a command line ask for."""
        asked = vars(options)
        named = [one for key, one in asked.items() if isinstance(one, Path) and key != "csv"]
        return cls(
            options.json,
            options.all,
            asked.get("csv"),
            asked.get("tables"),
            named=tuple(path for path in named if not path.is_dir()),
        )

    def check(
        self, taken: Mapping[str, Iterable[Path]] | None = None, made: Path | None = None
    ) -> None:
        """Refuse files that could not be written, before anything is computed or written.

        Parameters
        ----------
        taken
            Files that the command uses otherwise, by what becomes of them: "is read".
        made
            A folder that the command makes before the table's file is written.

        Raises
        ------
        InputError
            The file's folder does not exist or is read-only; or it is a folder, taken, or the
            standard output itself; or the folder for all tables holds something else.
        """
        if self.csv is not None:
            _check_csv(self.csv, taken or {}, made, self.named)
        if self.to is not None:
            _check_folder(self.to)

    def show(self, document: Document) -> None:
        """Write the files that were asked for and print the document."""
        self.write(document)
        self.print(document)

    def show_done(self, document: Document, done: str) -> None:
        """Show the document of a command that has changed something already.

        Parameters
        ----------
        document
            What is shown.
        done
            What was changed, in words.

        Raises
        ------
        InputError
            It cannot be shown; says what is done all the same.
        """
        stream = sys.stdout if self.stream is None else self.stream
        try:
            self.show(document)
            stream.flush()
        except InputError as error:
            error.args = (f"{error}; {done} all the same",)
            raise
        except BrokenPipeError:
            raise
        except OSError as error:
            message = system_message(error, output_failed=True)
            raise InputError(f"{message}; {done} all the same") from error

    def write(self, document: Document) -> None:
        """Write the files that were asked for, each whole or not at all.

        Raises
        ------
        InputError
            One could not be written; an old file is as it was.
        """
        if self.csv is not None:
            _write_csv(self.csv, document.tables[0])
        if self.to is not None:
            _write_folder(self.to, document)

    def print(self, document: Document) -> None:
        """Print the document, part by part; nothing where its page is empty."""
        stream = sys.stdout if self.stream is None else self.stream
        if self.as_json:
            for part in json_parts(document.answer):
                print(part, end="", file=stream)
            print(file=stream)
        else:
            for part in page_parts(document.page, everything=self.everything):
                print(part, file=stream)


def _check_csv(
    path: Path,
    taken: Mapping[str, Iterable[Path]],
    made: Path | None,
    named: Iterable[Path],
) -> None:
    where = f"{place(path)}: cannot be written"
    try:
        # as it will be written: in place of what a link leads to
        target = real_path(path)
        parent = target.parent
        if target.is_dir():
            raise InputError(f"{where}: it is a folder")
        if path.is_file() or not path.exists():
            if parent.is_dir():
                if not os.access(parent, os.W_OK):
                    raise InputError(f"{where}: the folder is read-only")
            elif made is None or parent != real_path(made):
                raise InputError(f"{where}: there is no folder {place(parent)}")
        folder = () if made is None else (made,)
        uses = {**taken, "becomes a folder": folder, "is named as well": named}
        for use, files in uses.items():
            if any(target == real_path(file) for file in files):
                raise InputError(f"{where}: it {use}; name another file for the table")
        if path.is_file() and _is_output(path):
            raise InputError(f"{where}: the report goes there")
        # what knows blocks is loaded where a table is written
        from anaplot.exchange.ownfiles import block_of_file

        block = block_of_file(target)
        if block is not None:
            raise InputError(
                f"{where}: it is a file of block {place(block)}; name another file for the table"
            )
    except (OSError, ValueError) as error:
        raise InputError(f"{where}: {reason(error)}") from error


def _is_output(path: Path) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(sys.__stdout__.fileno()))  # type: ignore[union-attr]
    except (AttributeError, OSError, ValueError):
        # there is no standard output, or it is no file
        return False


def _check_folder(folder: Path) -> None:
    """Refuse a folder that holds anything but an earlier output: a block would be overwritten."""
    where = f"{place(folder)}: cannot be written"
    try:
        if not os.path.lexists(folder):
            around = next(path for path in folder.absolute().parents if os.path.lexists(path))
            if not os.access(around, os.W_OK | os.X_OK):
                raise InputError(f"{where}: {place(around)} is no folder that can be written")
            return
        if not folder.is_dir():
            raise InputError(f"{where}: it is no folder")
        if any(folder.iterdir()) and _earlier_tables(folder) is None:
            raise InputError(f"{where}: it is neither new nor empty")
    except (OSError, ValueError) as error:
        raise InputError(f"{where}: {reason(error)}") from error


def _write_csv(path: Path, table: Table) -> None:
    data = csv_text(table).encode()
    try:
        # a pipe or a device is no file that could be replaced
        if path.exists() and not path.is_file():
            path.write_bytes(data)
            return
        target = real_path(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be written: {reason(error)}") from error
    replace_whole(target, data)


def _write_folder(folder: Path, document: Document) -> None:
    """Write every table and the summary, and take away the tables of an earlier output."""
    names = [f"{table.key}.csv" for table in document.tables]
    rest = {k: v for k, v in document.answer.items() if not isinstance(v, Table)}
    rest["tables"] = [table.key for table in document.tables]

    def files() -> Iterator[tuple[Path, bytes]]:
        for name, table in zip(names, document.tables, strict=True):
            yield folder / name, csv_text(table).encode()
        yield folder / _SUMMARY, json_text(rest).encode() + b"\n"

    earlier = _earlier_tables(folder) or []
    with all_or_nothing():
        make_folder(folder)
        write_together(files())
    for name in earlier:
        if name not in names:
            with contextlib.suppress(OSError):
                (folder / name).unlink()


def _earlier_tables(folder: Path) -> list[str] | None:
    """Return the names of the tables that an earlier output made in a folder; None: there is none.

    Its summary says so itself.
    """
    try:
        said = json.loads(read_bytes(folder / _SUMMARY, _MOST_BYTES))["tables"]
        return [f"{key}.csv" for key in said if _TABLE.fullmatch(key)]
    except (InputError, ValueError, KeyError, TypeError, RecursionError):
        return None
