"""What a report was computed with: versions, settings, files with their checksums, date."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.report.document import Answer, Line, Table, name, named, say, table, whole
from anaplot.report.html.parts import Facts, HtmlBlock, Section
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wording import place
from anaplot.version import JSON_VERSION, __version__

__all__ = [
    "InputFile",
    "Provenance",
    "checked_files",
    "provenance",
    "provenance_answer",
    "provenance_section",
    "unchanged",
]

_MOST_BYTES = 4_000_000_000
_COLUMNS = (
    name("file", "FILE", 5),
    whole("bytes", "bytes", 12),
    name("sha256", "SHA-256", 64),
)


class InputFile(NamedTuple):
    """A file that was read: its name, size and checksum."""

    file: str
    bytes: int
    sha256: str


class Provenance(NamedTuple):
    """What was computed, with what and from what.

    Attributes
    ----------
    command
        As one types it; "" from a program.
    options
        Options that are not the default, by their names.
    versions
        Of the program and of what it computes with.
    time
        When, in UTC.
    files
        What was read.
    """

    command: str
    options: Mapping[str, Any]
    versions: Mapping[str, str]
    time: str
    files: tuple[InputFile, ...]


def checked_files(paths: Iterable[Path]) -> tuple[InputFile, ...]:
    """Return the files that exist with their checksums; raises InputError."""
    found = []
    for path in dict.fromkeys(paths):
        if path.is_file():
            data = read_bytes(path, _MOST_BYTES)
            found.append(InputFile(str(path), len(data), hashlib.sha256(data).hexdigest()))
    return tuple(found)


def unchanged(before: tuple[InputFile, ...], after: tuple[InputFile, ...]) -> None:
    """Refuse a report of files that changed while it was computed; raises InputError."""
    for one in before:
        if one not in after:
            raise InputError(f"{place(Path(one.file))}: has changed meanwhile, nothing is written")


def provenance(
    command: str = "", options: Mapping[str, Any] | None = None, files: tuple[InputFile, ...] = ()
) -> Provenance:
    """Return what is known of a computation that has just been made."""
    versions = {
        "anaplot": __version__,
        "JSON keys": str(JSON_VERSION),
        "Python": platform.python_version(),
        **{package: version(package) for package in ("numpy", "scipy")},
        "system": f"{platform.system()} {platform.machine()}",
    }
    time = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    return Provenance(command, options or {}, versions, time, files)


def provenance_section(
    made: Provenance, block: Block | None = None, free: Line | None = None
) -> Section:
    """Return the section, with what a block says of precision and tests.

    A line says it where the datum is free and nobody asked for that.
    """
    facts: list[tuple[str, Line]] = [("Computed", say("{}", made.time))]
    if made.command:
        facts.append(("Command", say("{}", made.command)))
    versions = named([say("{} {}", what, which) for what, which in made.versions.items()])
    facts.append(("Versions", say("{}", versions)))
    options = [say("{} = {}", option, _written(value)) for option, value in made.options.items()]
    facts.append(
        ("Options", say("{}", named(options) if options else "all as they are without any"))
    )
    if free is not None:
        facts.append(("Datum", free))
    if block is not None:
        for title, settings in (("[precision]", block.precision), ("[test]", block.test)):
            said = [say("{} = {}", key, _written(value)) for key, value in asdict(settings).items()]
            facts.append((title, say("{}", named(said))))
    blocks: list[HtmlBlock] = [Facts(tuple(facts))]
    if made.files:
        blocks.append(files_table(made))
    return Section("provenance", "What this was computed with", tuple(blocks))


def files_table(made: Provenance) -> Table:
    """Return the table of files."""
    return table("files", _COLUMNS, made.files)


def provenance_answer(made: Provenance) -> Answer:
    """Return what programs read of it."""
    return {
        "command": made.command or None,
        "time": made.time,
        "versions": dict(made.versions),
        "options": {key: _written(value) for key, value in made.options.items()},
        "files": files_table(made),
    }


def _written(value: Any) -> str:
    if isinstance(value, list | tuple):
        return " ".join(map(str, value))
    return "not stated" if value is None else str(value)
