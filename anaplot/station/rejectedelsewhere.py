"""What `anaplot adjust --errors NAME --apply` switched in a session's rows, or took back.

The session takes it over when it is opened: what is decided belongs to the block.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from anaplot.aliases import Axis, SwitchedBy
from anaplot.exchange.blockfolder import image_points_identity
from anaplot.exchange.rejectedrows import STRATEGIES, as_before, rejected_axes, rejects, said_by
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.measuredimage import computed_place
from anaplot.photogrammetry.selection import points_of, rows_by_photo, rows_off
from anaplot.session.events import DecidedRow, DecisionsTakenOver
from anaplot.session.modelstate import Measured, ModelState
from anaplot.session.state import SessionState, apply, fold

__all__ = ["Elsewhere", "agreeing", "decisions", "elsewhere", "told_decisions"]

_MOST = 1000  # rows an event
Name = tuple[str, str, str | None]


class Elsewhere(NamedTuple):
    """What strategies decided in a file.

    Attributes
    ----------
    new
        What a session has still to take over.
    said
        The session's state with all of it, new or not: what the file is to be checked against.
    """

    new: tuple[DecisionsTakenOver, ...]
    said: SessionState


def decisions(
    block: Block, state: SessionState, file: str | None = None
) -> tuple[DecisionsTakenOver, ...]:
    """Return what strategies switched in the rows of a session's models since it last had them.

    Parameters
    ----------
    block
        As read from its files.
    state
        To which the journal led.
    file
        Which image_points.csv that was; see `DecisionsTakenOver`.
    """
    if not (any(map(rejects, block.image_points)) or _rejected(state)):
        return ()
    rows = rows_by_photo(block.image_points)
    found: list[DecidedRow] = []
    for photos in [photos for strip in block.strips for photos in strip.models()]:
        model = state.accepted(*photos)
        if model is not None and (here := tuple(_of_model(rows, state, model))):
            # a point of which every row is off is no tie of the next model
            state = apply(state, DecisionsTakenOver(here))
            found += here
    return tuple(
        DecisionsTakenOver(tuple(found[k : k + _MOST]), file) for k in range(0, len(found), _MOST)
    )


def elsewhere(
    folder: Path, block: Block, state: SessionState, last: DecisionsTakenOver | None
) -> Elsewhere:
    """Return what strategies switched in a folder's file, and has still to be taken over.

    What a session took over of this file last, and is not in its state, was undone since: it is
    not taken over again. A file that another one came after is a new one.

    Parameters
    ----------
    folder, block
        The block folder, and what was read from it.
    state
        To which the journal led.
    last
        What the session took over last, or None.
    """
    file = image_points_identity(folder)
    found = decisions(block, state, file)
    known = file is not None and last is not None and last.file == file
    return Elsewhere(() if known else found, fold(state, found))


def _rejected(state: SessionState) -> bool:
    return any(row.reason in STRATEGIES for row in state.reasons)


def _of_model(
    rows: Mapping[str, list[ImagePoint]], state: SessionState, model: ModelState
) -> Iterator[DecidedRow]:
    known = {r[1:3]: r.reason for r in state.reasons if r.model == model.name}
    for in_file in _in_files(rows, model):
        for axis in model.axes(in_file.point):
            there, here = axis in in_file.off, (in_file.point, axis) in model.off
            reason = known.get((in_file.point, axis))
            by = in_file.rejected.get(axis)
            if there and not here and by is not None:
                yield DecidedRow(*model.photos, in_file.point, axis, False, by)
            by = next((strategy for strategy in STRATEGIES if strategy == reason), None)
            if here and not there and by is not None:
                yield DecidedRow(*model.photos, in_file.point, axis, True, by)


def agreeing(image_points: Iterable[ImagePoint], models: Iterable[ModelState]) -> frozenset[Name]:
    """Return the rows of points that strategies rejected and a session has taken over.

    A strategy rejects image coordinates, a session switches rows of models, so that their uses
    may differ where they say the same of every model.

    Parameters
    ----------
    image_points
        Of the file.
    models
        The session's accepted models.

    Returns
    -------
    frozenset of tuple
        Photo, point and model of the rows.
    """
    image_points = tuple(image_points)
    if not any(map(rejects, image_points)):
        return frozenset()
    rows = rows_by_photo(image_points)
    found: set[Name] = set()
    wrong: set[Name] = set()
    for model in models:
        for point in _in_files(rows, model):
            if rejects(point.left) or rejects(point.right):
                axes = model.axes(point.point)
                there = {axis for axis in axes if axis in point.off}
                here = {axis for axis in axes if (point.point, axis) in model.off}
                names = {(row.photo, row.point, row.model) for row in (point.left, point.right)}
                (found if there == here else wrong).update(names)
    return frozenset(found - wrong)


def told_decisions(taken: Iterable[DecisionsTakenOver]) -> str:
    """Return in words what was taken over; "" for nothing."""
    rows = [row for event in taken for row in event.rows]
    parts = []
    for on, done, state in ((False, "--apply", "off"), (True, "--apply-undo", "on again")):
        mine = [row for row in rows if row.on == on]
        if mine:
            names = ", ".join(sorted({row.reason for row in mine}))
            models = len({(row.left, row.right) for row in mine})
            many, of = "s" * (len(mine) > 1), "s" * (models > 1)
            parts.append(
                f"adjust {done} ({names}): {len(mine)} row{many} of {models} model{of} {state}"
            )
    return "taken over from " + "; from ".join(parts) if parts else ""


@dataclass(frozen=True, slots=True)
class _InFile:
    """A session's point of a model in the file: which rows are off, and which a strategy has."""

    left: ImagePoint
    right: ImagePoint
    off: frozenset[Axis]
    rejected: Mapping[Axis, SwitchedBy]

    @property
    def point(self) -> str:
        """Its name."""
        return self.right.point


def _in_files(rows: Mapping[str, list[ImagePoint]], model: ModelState) -> Iterator[_InFile]:
    """Yield the points of a model of which the file has the session's coordinates."""
    left, right = (points_of(rows.get(p, ()), p, model.name) for p in model.photos)
    off = rows_off(left, right)
    axes: tuple[Axis, ...] = ("y", "x")
    for m in model.measured:
        one, other = left.get(m.point), right.get(m.point)
        if one is None or other is None or not _same(m, one, other):
            continue
        rejected = dict(rejected_axes(other))
        by = said_by(one.reason)
        # a left ray serves as given, unless it is off
        if by is not None and one.use == "off" and as_before(one).use != "off":
            rejected = dict.fromkeys(axes, by) | rejected
        yield _InFile(
            one, other, frozenset(axis for axis in axes if (m.point, axis) in off), rejected
        )


def _same(m: Measured, left: ImagePoint, right: ImagePoint) -> bool:
    return (m.xl, m.yl, m.xr, m.yr) == (*computed_place(left), *computed_place(right))
