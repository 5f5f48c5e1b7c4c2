"""`anaplot adjust --apply`: what is rejected or thinned out is switched off in image_points.csv."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import cast

from anaplot.aliases import Strategy
from anaplot.bundle.solve.observations import ORIENTATION, ObservationName
from anaplot.errors import AnaplotError, InputError
from anaplot.exchange.blockfolder import (
    PointsFound,
    block_files,
    image_points_digest,
    read_block,
    write_image_points,
)
from anaplot.exchange.lockfile import sessions_kept_out
from anaplot.exchange.rejectedrows import (
    STRATEGIES,
    as_before,
    chain,
    last_times,
    next_time,
    rejecting_reason,
)
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.report.adjustcommand import adjust
from anaplot.report.columns import counted
from anaplot.report.document import BLANK, Document, say
from anaplot.report.journalnote import session_of
from anaplot.report.output import Output
from anaplot.report.running import computed, run_computation
from anaplot.textfiles.wording import first_of, place, quoted

__all__ = ["applied", "run_adjust", "taken_back"]


def run_adjust(options: argparse.Namespace) -> int:
    """Adjust a block folder and show it; switch off what is rejected, or take that back.

    With `--apply-undo` the rows are as they were before anything is computed; where nothing can be
    computed then, the message says so.

    Returns
    -------
    int
        Exit code 0, or 1 with `--fail-on-flag` when something is flagged.

    Raises
    ------
    AnaplotError
        Bad input, what cannot be computed, or a folder that is locked or cannot be written; the
        old file stays, and nothing is printed.
    """
    folder = options.block
    reads = block_files(folder)
    if not (options.apply or options.apply_undo):
        return run_computation(options, adjust, reads)
    if options.apply and options.apply_undo:
        raise InputError("--apply and --apply-undo: one of them")
    if options.apply and options.errors is None and options.thin is None:
        raise InputError("--apply goes with --errors or --thin")
    with sessions_kept_out(folder):
        block = read_block(folder)
        before = block.image_points
        output = Output.of(options)
        output.check({"is read": reads})
        if options.apply_undo:
            return _undone(options, output, block)
        _check_session(folder, block)
        found = computed(options, adjust)
        rows: Sequence[ImagePoint] = before
        if options.errors is not None:
            rejected = (row.name for row in found.result.rejected)
            rows = applied(rows, rejected, options.errors, found.result.points_left_out)
        if found.result.thinning is not None:
            from anaplot.report.thinning import thinned_rows

            rows = thinned_rows(rows, frozenset(found.result.thinning.gone))
        _write(folder, before, rows)
    count = sum(now.use != then.use for now, then in zip(rows, before, strict=True))
    document = found.document
    done = f"{counted(count, 'image point is', 'image points are')} switched off"
    said = say(
        "{} in image_points.csv, with the reason {}; {}--apply-undo takes that back",
        done,
        " or ".join(_reasons(options)),
        "" if options.datum == "control" else f"--datum {options.datum} ",
    )
    names = [row.name for row in found.result.rejected if row.name[0] != "image"]
    others = len(names)
    answer = {**document.answer, "applied": count, "not_applied": others}
    page = (*document.page, BLANK, said)
    if others:
        page += (
            say(
                "{} of control, priors or conditions: nothing is written of them; {}",
                counted(others, "rejected row is", "rejected rows are"),
                _way_out(names),
            ),
        )
    output.show_done(Document(answer, page, document.tables), f"{done} in image_points.csv")
    return 1 if found.flagged and options.fail_on_flag else 0


def _reasons(options: argparse.Namespace) -> tuple[str, ...]:
    """Return what the options give as reasons for rows that are off."""
    strategy = () if options.errors is None else (options.errors,)
    return strategy if options.thin is None else (*strategy, "thin")


def _way_out(names: Sequence[ObservationName]) -> str:
    """Return how rows that are not of image_points.csv are switched off."""
    stated = [
        f"{'position' if unknown in ORIENTATION[:3] else 'rotation'}_sigma of photo {quoted(owner)}"
        for kind, owner, unknown in (name[:3] for name in names if name[0] == "prior")
        if owner is not None and unknown in ORIENTATION
    ]
    parts = []
    if any(name[0] != "prior" for name in names):
        parts.append("use = off switches a row of control or a condition off")
    if stated:
        parts.append(f"take {first_of(list(dict.fromkeys(stated)), 6)} out of block.toml")
    return "; ".join(parts) or "what is known of parameters beforehand is stated with them"


def _undone(options: argparse.Namespace, output: Output, block: Block) -> int:
    """Take back what was switched off, adjust without that and show it."""
    names, before = _reasons(options) or STRATEGIES, block.image_points
    rows = taken_back(before, names)
    # as it will be: what is taken back may be what the journal contradicts
    _check_session(options.block, replace(block, image_points=rows))
    _write(options.block, before, rows)
    count = sum(now != then for now, then in zip(rows, before, strict=True))
    said = f"{counted(count, 'image point is', 'image points are')} as before --apply"
    left = _left(rows, names)
    if left:
        said += f" ({left})"
    try:
        # the page tells of the block as the file has it: nothing goes again
        found = computed(argparse.Namespace(**{**vars(options), "thin": None}), adjust)
    except AnaplotError as error:
        error.args = (f"{error}; {said}: only the adjustment was not possible",)
        raise
    document = found.document
    page = (say("{} in image_points.csv", said), BLANK, *document.page)
    answer = {**document.answer, "taken_back": count}
    output.show_done(Document(answer, page, document.tables), f"{said} in image_points.csv")
    return 1 if found.flagged and options.fail_on_flag else 0


def applied(
    rows: Iterable[ImagePoint],
    rejected: Iterable[ObservationName],
    strategy: Strategy,
    points: Collection[str] = (),
) -> tuple[ImagePoint, ...]:
    """Return rows without the image coordinates that a strategy rejects.

    The reason is its name; where it stood in the rows before, which time it is follows, and where
    a row had another use or reason before, that.

    Parameters
    ----------
    rows
        Of image_points.csv.
    rejected
        Names of observations; control and priors, which have no rows here, are passed over.
    strategy
        Its name.
    points
        Points that it leaves out with all of their rays.
    """
    gone: dict[tuple[str | None, ...], set[str]] = {}
    for kind, *name in rejected:
        if kind == "image":
            *key, axis = name
            gone.setdefault(tuple(key), set()).add(cast("str", axis))
    rows = tuple(rows)
    time = next_time(rows, strategy)
    every, gone_points = {"x", "y"}, frozenset(points)
    return tuple(
        _without(
            row,
            every
            if row.point in gone_points
            else gone.get((row.photo, row.point, row.model), set()),
            strategy,
            time,
        )
        for row in rows
    )


def _without(row: ImagePoint, axes: set[str], strategy: Strategy, time: int) -> ImagePoint:
    left = row.use_without(axes)
    if left == row.use:
        return row
    return replace(row, use=left, reason=rejecting_reason(strategy, row.use, row.reason, time))


def taken_back(rows: Iterable[ImagePoint], strategies: Iterable[str]) -> tuple[ImagePoint, ...]:
    """Return rows as they were before some strategies' rejections were last applied."""
    rows, names = tuple(rows), tuple(strategies)
    times = last_times(rows, names)
    return tuple(as_before(row, names, times) for row in rows)


def _left(rows: Iterable[ImagePoint], names: Collection[str]) -> str:
    """Return what of some strategies was not taken back, and why."""
    earlier, beneath, others = 0, 0, set[str]()
    for said in map(chain, rows):
        by = [strategy for strategy, _ in said]
        above = list(takewhile(lambda strategy: strategy not in names, by))
        earlier += bool(by) and not above
        if above and len(above) < len(by):
            beneath += 1
            others.update(above)
    parts = [f"{earlier} of an earlier one stay off"] if earlier else []
    if beneath:
        verb = "lies" if beneath == 1 else "lie"
        parts.append(f"{beneath} {verb} beneath {', '.join(sorted(others))}: take that back first")
    return "; ".join(parts)


def _check_session(folder: Path, block: Block) -> None:
    """Refuse a file of which the session's journal says something else: nobody could open it.

    What the session takes over when it is opened may go on, and go back.
    """
    found = session_of(folder, block)
    if found is None:
        return
    foreign = tuple(row for row in found.edited if not row.taken_over)
    if foreign:
        remark = found._replace(edited=foreign).remark(folder)
        raise InputError(f"{remark}; nothing is written")


def _write(folder: Path, before: Sequence[ImagePoint], rows: Sequence[ImagePoint]) -> None:
    # first: what is written between the two is read anew
    digest = image_points_digest(folder)
    block = read_block(folder)
    if block.image_points != before:
        path = folder / "image_points.csv"
        raise InputError(f"{place(path)}: has changed meanwhile, nothing is written")
    if rows != before:
        write_image_points(folder, rows, block, PointsFound(before, digest))
