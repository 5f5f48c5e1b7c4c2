"""`anaplot replay` and its call: a recorded session played through the same code."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files
from anaplot.exchange.journalread import journal_files
from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.block import Block
from anaplot.report.computed import Computed
from anaplot.report.document import BLANK, Document, say
from anaplot.report.modeldocument import model_document, model_tables
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.report.streams import complain
from anaplot.station.rebuild import rebuild, session_solutions
from anaplot.station.replay import Replayed, replay_session
from anaplot.station.replayed import ReplayStation

__all__ = ["replay", "replay_document", "replay_station", "run_replay"]


def replay(session: str | os.PathLike[str]) -> Computed[Replayed]:
    """Play a recorded session to its end, as fast as it goes.

    Parameters
    ----------
    session
        A journal file, or the block's folder.

    Returns
    -------
    Computed of Replayed
        The final state, and what came out differently from what was recorded; flagged when
        something did. The document has the session's models.

    Raises
    ------
    InputError
        It cannot be read, is damaged, or does not fit its block.
    """
    found = replay_session(Path(session))
    document = replay_document(found.block, session_solutions(found.state))
    return Computed(found, document, len(found.differences) > 0)


def run_replay(options: argparse.Namespace) -> int:
    """Replay a recorded session: print its models, check its tables, or tell it as it went.

    Returns
    -------
    int
        0, or 1 when something came out differently from what was recorded.

    Raises
    ------
    InputError
        Options that exclude each other, or a session that cannot be replayed.
    """
    if options.speed is not None:
        with contextlib.closing(replay_station(options)) as station:
            return station.run(sys.stdout)
    _check_csv(options, options.check)
    output = Output.of(options)
    written = () if options.to is None else block_files(options.to)
    output.check({"is read": journal_files(options.session), "is written": written}, options.to)
    with working("reading the journal") as line:
        replayed = replay_session(options.session, line)
    for remark in replayed.remarks:
        complain(f"note: {remark}")
    if options.to is not None:
        rebuild(replayed, options.to)
    if options.check:
        output.show(_check_document(replayed))
        if replayed.differences:
            complain(str(replayed.differences[0]))
        return 1 if replayed.differences else 0
    output.show(replay_document(replayed.block, session_solutions(replayed.state)))
    return 0


def replay_station(options: argparse.Namespace) -> ReplayStation:
    """Return a recorded session as a station to look at; errors as `run_replay` has them."""
    _check_csv(options, True)
    return ReplayStation(options.session, 1.0 if options.speed is None else options.speed)


def _check_csv(options: argparse.Namespace, otherwise: bool) -> None:
    if options.csv is not None and otherwise:
        raise InputError("--csv goes with the models, which --check, --speed and --console replace")


def _check_document(replayed: Replayed) -> Document:
    """Return the document of a comparison; what differs is complained of."""
    answer = {
        "tables": replayed.tables,
        "measurements": replayed.measurements,
        "differences": [one._asdict() for one in replayed.differences],
    }
    same = say(
        "{} tables and {} measurements came out the same", replayed.tables, replayed.measurements
    )
    return Document(answer, () if replayed.differences else (same,), ())


def replay_document(block: Block, solutions: Sequence[tuple[str, ModelSolution]]) -> Document:
    """Return the document of a session's models.

    Parameters
    ----------
    block
        The block as it was declared.
    solutions
        Strip and solution of each model.
    """
    strips = {strip.id: strip.models() for strip in block.strips}
    models = []
    for strip, model in solutions:
        pairs = strips[strip]
        at = pairs.index((model.left, model.right))
        models.append((strip, model_document(model, strip=strip, number=at + 1, count=len(pairs))))
    answer = {"models": [{"strip": strip, **one.answer} for strip, one in models]}
    page = tuple(part for _, one in models for part in (*one.page, BLANK))
    return Document(answer, page, model_tables(models))
