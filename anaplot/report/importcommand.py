"""`anaplot import`: a block from another program's files."""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.formats.door import Imported, ImportOptions, Note
from anaplot.exchange.formats.registry import FORMATS, Format, format_of, module_of, recognised
from anaplot.exchange.importedfolder import write_imported
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.report.columns import counted
from anaplot.report.document import BLANK, Document, Line, say
from anaplot.report.doorarguments import refuse_unused
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.textfiles.wording import place, quoted, typed_path

__all__ = ["imported_document", "note_lines", "run_import"]

_OPTIONS = tuple(ImportOptions.__dataclass_fields__)


def run_import(options: argparse.Namespace) -> int:
    """Bring a block in as a new folder; raises InputError."""
    chosen, source = _chosen(options.kind, options.source)
    given = ImportOptions(
        **{name: value for name in _OPTIONS if (value := getattr(options, name)) is not None}
    )
    refuse_unused(given, ImportOptions(), chosen.kind, chosen.import_options)
    if os.path.lexists(options.output / "block.toml"):
        raise InputError(f"{place(options.output)}: there is a block already")
    output = Output.of(options)
    output.check({"is read": [source]}, made=options.output)
    with working(f"reading {source}") as line:
        found = module_of(chosen.kind).read(source, given)
        line(f"writing {options.output}", 0.0)
        write_imported(options.output, found, source)
    output.show(imported_document(chosen, options.output, found))
    return 0


def _chosen(kind: str, source: Path | None) -> tuple[Format, Path]:
    """Return the format and the source; of one argument alone it is the source."""
    if source is None:
        source = Path(kind)
        if kind in FORMATS and not os.path.lexists(source):
            raise InputError(f"import {kind}: SOURCE is missing")
        _check_there(source)
        return recognised(source), source
    chosen = format_of(kind)
    if not chosen.reads:
        raise InputError(f"{chosen.kind}: is written only ({chosen.title})")
    _check_there(source)
    return chosen, source


def _check_there(source: Path) -> None:
    if not os.path.lexists(source):
        raise InputError(f"{place(source)}: no such file or folder")


def imported_document(chosen: Format, folder: Path, found: Imported) -> Document:
    """Return what was brought in, and on which assumptions."""
    block = found.block
    counts = {
        "photos": len(block.photos),
        "cameras": len(block.cameras),
        "points": len(columns_of(block.image_points).point.values),
        "rays": len(block.image_points),
        "control": sum(row.use == "control" for row in block.control),
        "check": sum(row.use == "check" for row in block.control),
    }
    notes = [{**asdict(note), "examples": list(note.examples)} for note in found.notes]
    answer = {"kind": chosen.kind, "block": str(folder), **counts, "notes": notes}
    page = [
        say("{}, as {}", chosen.title, str(folder)),
        say(
            "{}, {}, {}, {}, {}",
            counted(counts["photos"], "photo"),
            counted(counts["cameras"], "camera"),
            counted(counts["points"], "point"),
            counted(counts["rays"], "ray"),
            counted(counts["control"] + counts["check"], "control and check point"),
        ),
        *note_lines(found.notes),
        BLANK,
        say("next: anaplot status {}", typed_path(folder)),
    ]
    return Document(answer, tuple(page), ())


def note_lines(notes: tuple[Note, ...]) -> list[Line]:
    """Return a line for every note."""
    out = []
    for note in notes:
        text = note.text if note.count is None else f"{note.count} {note.text}"
        some = ", ".join(quoted(name) for name in note.examples[:4])
        out.append(say("  {}: {}{}", note.what, text, f" ({some})" if some else "").of("remark"))
    return out
