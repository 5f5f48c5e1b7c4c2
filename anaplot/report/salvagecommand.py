"""The command `anaplot replay --salvage`: what was brought over and what not."""

from __future__ import annotations

import argparse
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.journalread import journal_files
from anaplot.exchange.salvage import Gap
from anaplot.report.columns import counted
from anaplot.report.document import Document, for_programs, named, say, table
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.session.state import SessionState
from anaplot.station.salvage import Salvaged, salvage
from anaplot.textfiles.wording import place

__all__ = ["run_salvage", "salvage_document"]

_MISSING = for_programs("file", "first_line", "last_line", "first_seq", "last_seq", "why")


def run_salvage(options: argparse.Namespace) -> int:
    """Bring what can be read of a session into a new block, and say what is missing.

    Raises
    ------
    InputError
        Options that exclude each other, or nothing can be brought over.
    """
    others = {"--check": options.check, "--to": options.to, "--console": options.console}
    others["--speed"] = options.speed
    for option, value in others.items():
        if value:
            raise InputError(f"--salvage and {option} exclude each other")
    output = Output.of(options)
    output.check({"is read": journal_files(options.session)}, options.salvage)
    with working("reading what can be read"):
        salvaged = salvage(options.session, options.salvage)
        lacking = _lacking(options.session, options.salvage, salvaged.state)
    output.show(salvage_document(salvaged, place(options.salvage), lacking))
    return 0


def _lacking(session: Path, folder: Path, state: SessionState) -> tuple[int, int] | None:
    """Return how many rows of the old image_points.csv the new block lacks, and of how many.

    None where there is no old one, or it cannot be read.
    """
    if not (session / "image_points.csv").is_file():
        return None
    try:
        old, new = (read_block(one).image_points for one in (session, folder))
    except InputError:
        return None
    there = {(row.photo, row.point) for row in new}
    if state.current is not None:
        there |= {
            (photo, m.point) for m in state.current.measured for photo in state.current.photos
        }
    rows = [(row.photo, row.point) for row in old]
    return sum(row not in there for row in rows), len(rows)


def salvage_document(
    salvaged: Salvaged, folder: str, lacking: tuple[int, int] | None = None
) -> Document:
    """Return the document of a salvage.

    Parameters
    ----------
    salvaged
        What was brought over.
    folder
        Where to.
    lacking
        How many rows of the old image_points.csv are not in the new one, and of how many; None: not
        known.
    """
    state, current = salvaged.state, salvaged.state.current
    missing = table("missing", _MISSING, (_gap(gap) for gap in salvaged.gaps))
    answer = {
        "records": salvaged.records,
        "models": [model.name for model in state.models],
        "in_work": None if current is None else current.name,
        "missing": missing,
        "left_out": list(salvaged.left_out),
        "assumed": list(salvaged.assumed),
        "lacking": None if lacking is None else lacking[0],
    }
    have = [say("{}", counted(len(state.models), "accepted model"))]
    if current is not None:
        points = counted(len(current.measured), "point")
        have.append(say("{} in model {}, which is in work", points, current.name))
    records = counted(salvaged.records, "record")
    page = [
        say("{} brought over to {}: {}", records, folder, named(have)),
        *(say("missing: {}", str(gap)).of("look") for gap in salvaged.gaps),
        *(say("left out: {}", sentence).of("look") for sentence in salvaged.left_out),
        *(say("assumed: {}", sentence).of("remark") for sentence in salvaged.assumed),
    ]
    if lacking is not None and lacking[0]:
        told = "image_points.csv: {} of its {} rows are not in the new block: keep the old one"
        page.append(say(told, *lacking).of("look"))
    if len(page) == 1:
        page.append(say("nothing is missing"))
    return Document(answer, tuple(page), (missing,))


def _gap(gap: Gap) -> tuple[str | int | None, ...]:
    return (gap.file, gap.first_line, gap.last_line, gap.first_seq, gap.last_seq, gap.why)
