"""`anaplot status`: where a block stands, what needs a look, what to do next."""

from __future__ import annotations

import argparse
from collections.abc import Container, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from anaplot.aliases import Progress
from anaplot.errors import AnaplotError, NotComputableError
from anaplot.exchange.blockfolder import read_block
from anaplot.photogrammetry.block import Block
from anaplot.report.accidentlines import accidents_answer, photos_answer, unchecked_line
from anaplot.report.blockcontents import (
    BlockContents,
    contents_answer,
    contents_lines,
    contents_of,
)
from anaplot.report.columns import counted
from anaplot.report.document import (
    BLANK,
    Answer,
    Document,
    Line,
    for_programs,
    name,
    named,
    number,
    say,
    table,
    whole,
)
from anaplot.report.document import Block as Part
from anaplot.report.journalnote import journal_answer
from anaplot.report.keptblock import without_rejected
from anaplot.report.lengthunits import with_lengths_of
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.session.filedaccidents import NO_ACCIDENTS
from anaplot.station.blockstatus import BlockStatus, status_of
from anaplot.station.journaled import Journaled, journaled
from anaplot.textfiles.wording import typed_path

if TYPE_CHECKING:
    from anaplot.bundle.solve.adjusted import AdjustedBlock
    from anaplot.orientation.strip import BridgedStrip
    from anaplot.session.recomputed import Recomputed
    from anaplot.station.blockview import BlockView

__all__ = ["adjusted_status", "block_status", "run_status", "status_document"]

PATIENCE, PATIENCE_PER_PHOTO = 200, 10
"""Strips, pairs and rounds of photos that the search for approximate values tries at most."""

_MODELS = (
    name("strip", "STRIP", 5, gap=0),
    name("left", "LEFT", 5),
    name("right", "RIGHT", 5),
    name("state", "STATE", 10, look=lambda state: state == "look"),
    number("sigma0_um", "SIGMA0 um", 2, 11),
    whole("redundancy", "REDUND", 8),
    whole("flagged", "FLAGGED", 9),
    whole("off", "OFF", 5),
    whole("ties", "TIES", 6),
)
_NO_STRIPS = say("no strips: models cannot be formed, the block is adjusted as a whole")
_MOST_SPOTS = 10
_MOST_WEAK = 6  # photos for which points are found that would help
_IN_STRIP = for_programs(
    "left", "right", "state", "sigma0_um", "redundancy", "flagged", "off", "ties"
)
_SUSPECTS = for_programs("photo", "point", "axis", "model", "probability", "unless")


def run_status(options: argparse.Namespace) -> int:
    """Say where a block stands and return the exit code.

    Raises
    ------
    InputError
        The block cannot be read.
    """
    output = Output.of(options)
    output.check({"is read": (options.block,)})
    with working("models and block"):
        status, found, contents, block = block_status(
            options.block, page=not (output.as_json or output.to)
        )
    document = status_document(options.block, status, found, contents)
    output.show(with_lengths_of(block, document))
    return 0


def block_status(
    folder: Path, *, page: bool = False
) -> tuple[BlockStatus, Journaled, BlockContents, Block]:
    """Return where the block in a folder stands, its journal, what there is in it, and the block.

    Parameters
    ----------
    folder
        The block folder.
    page
        Whether a page of text alone is made of it: without strips that shows no points that would
        help weak photos, and they are not looked for.

    Raises
    ------
    InputError
        The block cannot be read; a journal that does not fit it is a remark.
    """
    block = read_block(folder)
    found = journaled(folder, block)
    name = typed_path(folder)
    accidents = NO_ACCIDENTS
    if block.image_points:
        from anaplot.session.blockaccidents import block_accidents

        accidents = block_accidents(block)
    helped = bool(block.strips) or not page
    status = status_of(block, found.state, _view(block, helped), name, accidents)
    return status, found, contents_of(block), block


def adjusted_status(
    folder: Path | None,
    block: Block,
    adjusted: AdjustedBlock,
    bridged: Iterable[BridgedStrip] = (),
    progress: Progress | None = None,
) -> tuple[BlockStatus, Journaled]:
    """Return where a block stands that is adjusted already, and its journal.

    Models and numbering are looked at without the image points that were rejected.

    Parameters
    ----------
    folder
        Where it comes from; None: from a program, without a journal.
    block
        As it was read.
    adjusted
        The same adjusted.
    bridged
        Its strips without what is rejected, as far as they are bridged already.
    progress
        Told of the accidents that are looked for; may raise to end it.
    """
    from anaplot.bundle.live import answer_of
    from anaplot.session.blockaccidents import block_accidents
    from anaplot.station.blockanswer import view_of
    from anaplot.station.blockview import BlockView

    found = Journaled() if folder is None else journaled(folder, block)
    view = view_of(answer_of(adjusted), BlockView("", 0, False), None, most_weak=_MOST_WEAK)
    name = "BLOCK" if folder is None else typed_path(folder)
    kept = without_rejected(adjusted)
    accidents = block_accidents(kept, progress)
    return status_of(kept, found.state, view, name, accidents, bridged), found


def _view(block: Block, helped: bool) -> BlockView | None:
    """Return what the block as one bundle says; None where there is nothing to adjust.

    With the points that would help weak photos, or without them.
    """
    if not block.image_points:
        return None
    from anaplot.bundle.live import LiveBlock
    from anaplot.bundle.start.approximate import SEARCHES
    from anaplot.station.blockanswer import view_of
    from anaplot.station.blockview import BlockView

    empty = BlockView("", 0, False)
    patience = _Patience(SEARCHES, PATIENCE + PATIENCE_PER_PHOTO * len(block.photos))
    try:
        found = LiveBlock(block).update(block, progress=patience.progress)
    except AnaplotError as error:
        return replace(empty, remark=patience.remark or str(error))
    return view_of(found, empty, None, most_weak=_MOST_WEAK, helped=helped)


class _Patience:
    """Ends a search for approximate values that takes too long: no status waits for nonsense.

    It counts what was tried, not time: the answer is the same on every machine.

    Parameters
    ----------
    searches
        What the search says of its progress.
    most
        How often it may say it.
    """

    def __init__(self, searches: Container[str], most: int) -> None:
        self._searches = searches
        self._most = most
        self._tried = 0
        self.remark = ""

    def progress(self, what: str, _: float) -> None:
        """Take notice of what is being done.

        Raises
        ------
        NotComputableError
            It was searched long enough.
        """
        if what not in self._searches:
            return
        self._tried += 1
        if self._tried > self._most:
            self.remark = (
                f"no approximate values found in {self._most} steps: the measurements may"
                " contradict each other; anaplot adjust searches on"
            )
            raise NotComputableError(self.remark)


def status_document(
    folder: Path, status: BlockStatus, found: Journaled, contents: BlockContents
) -> Document:
    """Return the document of where a block stands.

    Parameters
    ----------
    folder
        The block folder.
    status
        Where it stands.
    found
        What its journal says; where that is something else than the files, it is a remark.
    contents
        What there is in it.
    """
    note = journal_answer(folder, found)
    remarks = [] if note is None else [note["remark"]]
    rows = [
        (strip.strip, m.left, m.right, m.state, m.sigma0_um, m.redundancy, m.flagged, m.off, m.ties)
        for strip in status.strips
        for m in strip.models
    ]
    seen = status.coverage
    models = table("models", _MODELS, rows)
    suspects = table("suspects", _SUSPECTS, _suspects(status.block))
    answer: Answer = {
        "strips": [
            {
                "strip": strip.strip,
                "models": table(
                    "models", _IN_STRIP, [row[1:] for row in rows if row[0] == strip.strip]
                ),
            }
            for strip in status.strips
        ],
        "block": _block(status.block, suspects),
        "recomputed": [_recomputed(one) for one in status.recomputed],
        "lateral_ties": seen.lateral_ties,
        "control": {"points": seen.control, "seen": seen.control_seen},
        "contents": contents_answer(contents),
        "accidents": accidents_answer(status.accidents),
        "next": {key: value or None for key, value in status.next._asdict().items()},
        "remarks": remarks + _unsolved(status.block),
    }
    answer |= photos_answer(status.accidents.photos)
    if note is not None:
        answer["differs_from_journal"] = note
    page: list[Part] = [models, BLANK] if rows else [*contents_lines(contents), _NO_STRIPS, BLANK]
    if len(status.strips) > 1:
        page.append(say("lateral ties: {}", seen.lateral_ties))
    if seen.control:
        page.append(
            say("control: {} of {} measured", seen.control_seen, counted(seen.control, "point"))
        )
    page.append(_block_line(status))
    page += [say("  look: {}", one.text).of("look") for one in status.accidents.photos]
    spots = status.weak_spots
    page += [say("  look: {}", spot.words).of("look") for spot in spots[:_MOST_SPOTS]]
    if len(spots) > _MOST_SPOTS:
        page.append(say("  and {} more to look at", len(spots) - _MOST_SPOTS).of("look"))
    page += unchecked_line(status.accidents)
    page += _weak_lines(status.block, bool(rows))
    if status.block is not None:
        from anaplot.report.offsets import offset_advice_lines

        page += offset_advice_lines(status.block.offsets)
    page += [say("remark: {}", remark).of("remark") for remark in remarks]
    page.append(_next_line(status).of("heading"))
    return Document(answer, tuple(page), (models, suspects))


def _unsolved(view: BlockView | None) -> list[str]:
    """Return why there is no adjusted block; in the text its line says so."""
    return [] if view is None or view.solved or not view.remark else [view.remark]


def _suspects(
    view: BlockView | None,
) -> list[tuple[str, str, str, str | None, float, str | None]]:
    if view is None:
        return []
    return [
        (
            one.accused.photo,
            one.point,
            one.flagged[0].axis,
            one.accused.model,
            one.accused.probability,
            None if (other := view.unless(one)) is None else other.what,
        )
        for one in view.suspects
    ]


def _recomputed(one: Recomputed) -> Answer:
    before, after = one.sigma0_um
    return {
        "model": one.name,
        "sigma0_um": {"before": before, "after": after},
        "newly_flagged": [{"point": point, "axis": axis} for point, axis in one.newly_flagged],
        "no_longer": [{"point": point, "axis": axis} for point, axis in one.no_longer],
        "largest": None
        if one.row is None
        else {"point": one.row[0], "axis": one.row[1], "change_um": one.change_um},
        "error": one.why or None,
    }


def _block(view: BlockView | None, suspects: object) -> Answer | None:
    if view is None or not view.solved:
        return None
    from anaplot.report.offsets import offset_advice_json
    from anaplot.report.stabilizing import stabilizing_json

    flagged = sum(len(point.flagged) for point in view.suspects)
    return {
        "sigma0": view.sigma0,
        "flagged": flagged,
        "suspects": suspects,
        "flagged_others": [one._asdict() for one in view.others],
        "offsets_advised": offset_advice_json(view.offsets),
        "weak_photos": list(view.weak),
        "stabilizing": stabilizing_json(view.stabilizing),
        "stabilizing_left_out": _left_out(view),
    }


def _weak_lines(view: BlockView | None, strips: bool) -> list[Part]:
    """Return the weak photos, and where they lie in an instrument what would help them."""
    if view is None or not view.weak:
        return []
    from anaplot.report.stabilizing import stabilizing_lines

    count = say("weak: {} of {} photos have few redundant observations beside the others",
                len(view.weak), view.photos)  # fmt: skip
    if not strips:
        return [count, say("  {}", named(view.weak, _MOST_WEAK))]
    lines = [count, *stabilizing_lines(view.stabilizing)]
    if _left_out(view):
        lines.append(say("and {} more, for which nothing was looked for", _left_out(view)))
    return lines


def _left_out(view: BlockView) -> int:
    """Return for how many weak photos no points were looked for."""
    return max(len(view.weak) - _MOST_WEAK, 0)


def _block_line(status: BlockStatus) -> Line:
    view = status.block
    if view is None:
        in_work = any(model.state == "in work" for model in status.models)
        return say(f"block: {'no model is accepted' if in_work else 'nothing is measured'} yet")
    if not view.solved:
        return say("block: {}", view.remark).of("look")
    flagged = sum(len(point.flagged) for point in view.suspects)
    others = counted(len(view.others), "other observation")
    return say(
        "block: {photos} photos, {points} points, {rays} rays, datum {datum}, "
        "sigma0 {sigma0_um:.2f|um|none}, {flagged} flagged",
        photos=view.photos,
        points=view.points,
        rays=view.rays,
        datum=view.datum,
        sigma0_um=view.sigma0_um,
        flagged=flagged,
    ) + (say(" and {}", others) if view.others else "")


def _next_line(status: BlockStatus) -> Line:
    return say("NEXT: {}: {}", status.next.words, status.next_command)
