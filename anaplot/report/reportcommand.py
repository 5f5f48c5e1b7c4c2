"""`anaplot report`: an adjusted block as a page that stands by itself."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from anaplot.aliases import Progress
from anaplot.bundle.solve.problem import Datum
from anaplot.exchange.blockfolder import block_files
from anaplot.exchange.blockpack import block_paths
from anaplot.report.adjustcommand import adjust
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.computed import Computed
from anaplot.report.document import Document, Line, say
from anaplot.report.html.angles import AngleUnit, with_angles_in
from anaplot.report.html.blocksections import Material, block_sections
from anaplot.report.html.evidence import block_plates
from anaplot.report.html.parts import Report
from anaplot.report.html.sections.definitions import with_definitions
from anaplot.report.html.sections.innerorientations import OrientedPlate
from anaplot.report.html.sections.provenance import (
    Provenance,
    checked_files,
    provenance,
    provenance_answer,
    provenance_section,
    unchanged,
)
from anaplot.report.html.sections.verdict import verdict_lines
from anaplot.report.html.write import check_report, write_report
from anaplot.report.html.written import written_answer, written_lines
from anaplot.report.keywords import chosen_options
from anaplot.report.lengthunits import in_px, without_pixel_size
from anaplot.report.output import Output
from anaplot.report.pageoption import as_typed
from anaplot.report.progress import working
from anaplot.report.reportarguments import add_report_arguments
from anaplot.report.reportdatum import adjusted_in_datum
from anaplot.report.running import computed

__all__ = ["block_report", "run_report"]


def run_report(options: argparse.Namespace) -> int:
    """Adjust a block and write its report.

    Returns
    -------
    int
        Exit code 0, or 1 with `--fail-on-flag` when something is flagged.

    Raises
    ------
    AnaplotError
        Bad input, what cannot be computed, or files that cannot be written; nothing is written
        then.
    """
    output = Output.of(options)
    reads = (*block_files(options.block), *options.fiducials)
    output.check({"is read": reads, "becomes the report": (options.output,)})
    check_report(options.output, options.figures)
    computing = [*block_paths(options.block), *options.fiducials, *_named_files(options)]
    files = checked_files(computing)
    ours = adjusted_in_datum(
        lambda datum: computed(_in_datum(options, datum), adjust), options.datum
    )
    found = ours.adjusted
    with working("the page") as line:
        plates = block_plates(options.block, options.fiducials)
        unchanged(files, checked_files(computing))
        made = provenance(
            as_typed("report", add_report_arguments, options),
            chosen_options(add_report_arguments, options),
            files,
        )
        material = Material(found, options.block, plates, ours.line, line)
        report = _report(material, made, options.angles)
        written = write_report(report, options.output, options.figures, most_rows=options.rows)
    document = found.document
    answer = {
        **document.answer,
        "inner": [plate.answer for plate in plates],
        "report": {
            **written_answer(written),
            **material.summary,
            "free_datum": ours.why or None,
            "provenance": provenance_answer(made),
        },
    }
    said = () if ours.line is None else (say("  ") + ours.line,)
    output.show(Document(answer, (*written_lines(written), *said), document.tables))
    return 1 if found.flagged and options.fail_on_flag else 0


def block_report(
    found: Computed[BlockAdjustment],
    folder: str | os.PathLike[str] | None = None,
    plates: Sequence[OrientedPlate] | None = None,
    *,
    angles: AngleUnit = "deg",
    free: Line | None = None,
    progress: Progress | None = None,
) -> Report:
    """Return the report of an adjusted block.

    Parameters
    ----------
    found
        What `adjust` has returned.
    folder
        The folder that the block was read from.
    plates
        Inner orientations, from `block_plates`; None: those of the folder's journal.
    angles
        Unit of angles in its tables.
    free
        What is said of a free datum that nobody asked for; None: nothing.
    progress
        Told of every step; may raise to end it.
    """
    path = None if folder is None else Path(folder)
    if plates is None:
        plates = () if path is None else block_plates(path)
    material = Material(found, path, tuple(plates), free, progress)
    return _report(material, provenance(), angles)


def _in_datum(options: argparse.Namespace, datum: Datum) -> argparse.Namespace:
    return argparse.Namespace(**{**vars(options), "datum": datum})


def _report(material: Material, made: Provenance, angles: AngleUnit) -> Report:
    verdict = verdict_lines(material.adjusted.result, material.status, material.free)
    if without_pixel_size(material.measured):
        verdict = tuple(map(in_px, verdict))
    report = Report(
        say("Block {}", material.measured.name),
        verdict,
        block_sections(material),
        provenance_section(made, material.measured, material.free),
        say("Adjusted as one bundle by anaplot {}, {}", made.versions["anaplot"], made.time),
    )
    return with_definitions(with_angles_in(report, angles))


def _named_files(options: argparse.Namespace) -> Iterator[Path]:
    """Yield the files that options name; what is no file is something else."""
    for key in ("additional_prior", "given", "operators", "snooping_model", "test_set"):
        value = getattr(options, key)
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, str | Path) and Path(one).is_file():
                yield Path(one)
