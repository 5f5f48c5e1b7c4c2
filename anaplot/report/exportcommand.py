"""`anaplot export`: a block as another program's files."""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict

from anaplot.aliases import Progress
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats.door import SOURCE, Exported, Exporting, ExportOptions
from anaplot.exchange.formats.registry import Format, format_of, module_of
from anaplot.photogrammetry.block import Block
from anaplot.report.columns import counted
from anaplot.report.document import Document, say
from anaplot.report.doorarguments import refuse_unused
from anaplot.report.exportresult import adjusted_result
from anaplot.report.importcommand import note_lines
from anaplot.report.journalnote import journal_note, with_journal_notes
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.textfiles.wording import place

__all__ = ["run_export"]

_OPTIONS = tuple(ExportOptions.__dataclass_fields__)


def run_export(options: argparse.Namespace) -> int:
    """Write a block as another program's files; raises InputError, NotComputableError."""
    chosen = format_of(options.kind)
    if not chosen.writes:
        raise InputError(f"{chosen.kind}: is read only ({chosen.title})")
    given = ExportOptions(
        **{name: value for name in _OPTIONS if (value := getattr(options, name)) is not None}
    )
    refuse_unused(given, ExportOptions(), chosen.kind, chosen.export_options)
    if os.path.lexists(options.output):
        raise InputError(f"{place(options.output)}: exists already and is not overwritten")
    with working(f"reading {options.block}") as line:
        block = read_block(options.block)
        noted = journal_note(options.block, block)
        written = _written(options, block, chosen, given, line)
    notes = [{**asdict(note), "examples": list(note.examples)} for note in written.notes]
    answer = {"kind": chosen.kind, "files": [str(file) for file in written.files], "notes": notes}
    page = (
        say("{}: {}, {}", str(options.output), chosen.title, counted(len(written.files), "file")),
        *note_lines(written.notes),
    )
    Output.of(options).show(with_journal_notes(Document(answer, page, ()), noted))
    return 0


def _written(
    options: argparse.Namespace,
    block: Block,
    chosen: Format,
    given: ExportOptions,
    progress: Progress,
) -> Exported:
    source = options.block / SOURCE
    starts = any(os.path.lexists(source / name) for name in chosen.starts_from)
    wanted = bool(block.control) if chosen.adjusted == "control" else chosen.adjusted
    adjusted = adjusted_result(block, progress) if wanted and not starts else None
    progress(f"writing {options.output}", 0.0)
    return module_of(chosen.kind).write(
        Exporting(block, options.block, given, adjusted), options.output
    )
