"""`anaplot report`: an adjusted block as a page that stands by itself."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from anaplot.exchange.blockfolder import block_files
from anaplot.report.adjustcommand import adjust
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.columns import counted
from anaplot.report.computed import Computed
from anaplot.report.document import Document, Line, say
from anaplot.report.html.blocksections import Material, block_sections
from anaplot.report.html.evidence import block_plates
from anaplot.report.html.parts import Report
from anaplot.report.html.sections.innerorientations import OrientedPlate
from anaplot.report.html.write import Written, check_report, write_report
from anaplot.report.output import Output
from anaplot.report.running import computed

__all__ = ["block_report", "run_report", "written_lines"]


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
    found = computed(options, adjust)
    plates = block_plates(options.block, options.fiducials)
    report = block_report(found, options.block, plates)
    written = write_report(report, options.output, options.figures, most_rows=options.rows)
    document = found.document
    answer = {
        **document.answer,
        "inner": [plate.answer for plate in plates],
        "report": _answer(written),
    }
    output.show(Document(answer, written_lines(written), document.tables))
    return 1 if found.flagged and options.fail_on_flag else 0


def block_report(
    found: Computed[BlockAdjustment],
    folder: str | os.PathLike[str] | None = None,
    plates: Sequence[OrientedPlate] = (),
) -> Report:
    """Return the report of an adjusted block.

    Parameters
    ----------
    found
        What `adjust` has returned.
    folder
        The folder that the block was read from.
    plates
        Inner orientations, from `block_plates`.
    """
    material = Material(found, None if folder is None else Path(folder), tuple(plates))
    return Report(say("Block {}", material.measured.name), (), block_sections(material))


def _answer(written: Written) -> dict[str, object]:
    return {
        "page": str(written.page),
        "bytes": written.size,
        "cut": [str(path) for path in written.cut],
        "figures": [str(path) for path in written.figures],
    }


def written_lines(written: Written) -> tuple[Line, ...]:
    """Return what is said of a report that was written."""
    lines = [say("{}: written, {:.1f} MB", str(written.page), written.size / 1e6)]
    if written.cut:
        lines.append(
            say(
                "  {} cut to what needs a look; whole in {}",
                counted(len(written.cut), "table is", "tables are"),
                str(written.cut[0].parent),
            )
        )
    if written.figures:
        lines.append(
            say(
                "  {} in {}",
                counted(len(written.figures), "figure"),
                str(written.figures[0].parent),
            )
        )
    return tuple(lines)
