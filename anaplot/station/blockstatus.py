"""Where a block stands: its strips and models, what the block says, and what is to be done next."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Literal, NamedTuple

from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import bridge_strip
from anaplot.photogrammetry.block import Block, Strip
from anaplot.photogrammetry.selection import points_of, rows_by_photo
from anaplot.session.modelstate import ModelState
from anaplot.session.recomputed import Recomputed, recomputed_models
from anaplot.session.state import SessionState
from anaplot.session.workflow import outlook
from anaplot.station.blockview import BlockView

__all__ = ["BlockStatus", "ModelStanding", "ModelStatus", "NextStep", "StripStatus", "status_of"]

ModelStanding = Literal["open", "in work", "accepted", "recomputed", "look"]
SURE = 0.99
"""From this probability on a suspected measurement is to be looked at."""


@dataclass(frozen=True, slots=True)
class ModelStatus:
    """A model.

    Attributes
    ----------
    left, right
        Names of the photos.
    state
        "open": not measured; "in work"; "accepted"; "recomputed": accepted, and changed by what
        was done since in a model before it; "look": accepted, and flagged or suspected.
    sigma0_um, redundancy
        Of its table; None while there is none.
    flagged, off, ties
        How many rows are flagged, how many are switched off, and how many tie points it has.
    why
        Why it has no table although it was measured, or "".
    """

    left: str
    right: str
    state: ModelStanding
    sigma0_um: float | None = None
    redundancy: int | None = None
    flagged: int = 0
    off: int = 0
    ties: int = 0
    why: str = ""

    @property
    def name(self) -> str:
        """'left/right'."""
        return f"{self.left}/{self.right}"


@dataclass(frozen=True, slots=True)
class StripStatus:
    """A strip: its name and its models in order."""

    strip: str
    models: tuple[ModelStatus, ...]


class NextStep(NamedTuple):
    """What is to be done next, where, and by which command; "" where it is not one."""

    do: Literal["measure", "return", "accept", "adjust"]
    command: str
    model: str = ""
    photo: str = ""
    point: str = ""


@dataclass(frozen=True, slots=True)
class BlockStatus:
    """Where a block stands.

    Attributes
    ----------
    strips
        In the order of block.toml.
    recomputed
        Models changed by what was done since in a model before them, and what has changed.
    block
        What the block as one bundle says; None where there is nothing to adjust.
    lateral_ties
        How many points are measured in photos of more than one strip.
    control, control_seen
        How many control and check points there are, and how many are measured in two photos.
    next
        What is to be done next.
    """

    strips: tuple[StripStatus, ...]
    recomputed: tuple[Recomputed, ...]
    block: BlockView | None
    lateral_ties: int
    control: int
    control_seen: int
    next: NextStep


def status_of(
    block: Block, state: SessionState | None, view: BlockView | None, folder: str
) -> BlockStatus:
    """Return where a block stands.

    Parameters
    ----------
    block
        As its files say, with image points and control.
    state
        Where the journal says that the session stands, or None without one.
    view
        What the block as one bundle says, or None.
    folder
        How the command line names the block.
    """
    suspected = _suspected(view)
    recomputed = () if state is None else recomputed_models(state)
    changed = {(one.left, one.right) for one in recomputed}
    strips = tuple(_strip(block, strip, state, suspected, changed) for strip in block.strips)
    photos_of: dict[str, set[str]] = {}
    for row in block.image_points:
        photos_of.setdefault(row.point, set()).add(row.photo)
    return BlockStatus(
        strips=strips,
        recomputed=recomputed,
        block=view,
        lateral_ties=_lateral_ties(block, photos_of),
        control=sum(point.use != "off" for point in block.control),
        control_seen=sum(
            point.use != "off" and len(photos_of.get(point.point, ())) > 1
            for point in block.control
        ),
        next=_next(block, state, strips, view, folder),
    )


def _suspected(view: BlockView | None) -> dict[str, str]:
    """Return the surely wrong point of each model that holds one."""
    out: dict[str, str] = {}
    for point in () if view is None else view.suspects:
        if point.accused.model is not None and point.accused.probability > SURE:
            out.setdefault(point.accused.model, point.point)
    return out


def _strip(
    block: Block,
    strip: Strip,
    state: SessionState | None,
    suspected: Mapping[str, str],
    changed: Set[tuple[str, str]],
) -> StripStatus:
    bridged = bridge_strip(block, strip)
    solved = {(model.left, model.right): model for model in bridged.models}
    rows = rows_by_photo(block.image_points)
    models = []
    for left, right in strip.models():
        current = state.current if state is not None else None
        if state is not None and current is not None and current.photos == (left, right):
            view = outlook(state)
            models.append(_with_table(left, right, "in work", view.solution, current, view.problem))
            continue
        name = f"{left}/{right}"
        in_left, in_right = (points_of(rows.get(p, ()), p, name) for p in (left, right))
        if in_left.keys().isdisjoint(in_right):
            models.append(ModelStatus(left, right, "open"))
            continue
        solution = solved.get((left, right))
        accepted = None if state is None else state.accepted(left, right)
        look = solution is None or bool(solution.flagged) or name in suspected
        why = (bridged.error or "") if solution is None else ""
        anew = (left, right) in changed
        standing: ModelStanding = "look" if look else "recomputed" if anew else "accepted"
        models.append(_with_table(left, right, standing, solution, accepted, why))
    return StripStatus(strip.id, tuple(models))


def _with_table(
    left: str,
    right: str,
    standing: ModelStanding,
    solution: ModelSolution | None,
    measured: ModelState | None,
    why: str,
) -> ModelStatus:
    if solution is None:
        off = 0 if measured is None else len(measured.off)
        return ModelStatus(left, right, standing, off=off, why=why)
    return ModelStatus(
        left,
        right,
        standing,
        solution.sigma0_um,
        solution.redundancy,
        len(solution.flagged),
        len(solution.off_rows),
        len(solution.ties),
    )


def _lateral_ties(block: Block, photos_of: Mapping[str, set[str]]) -> int:
    strips_of: dict[str, set[str]] = {}
    for strip in block.strips:
        for photo in strip.photos:
            strips_of.setdefault(photo, set()).add(strip.id)
    return sum(
        len(set().union(*(strips_of.get(photo, set()) for photo in photos))) > 1
        for photos in photos_of.values()
    )


def _next(
    block: Block,
    state: SessionState | None,
    strips: tuple[StripStatus, ...],
    view: BlockView | None,
    folder: str,
) -> NextStep:
    opening = f"anaplot open {folder}"
    if state is not None and state.current is not None:
        ahead, model = outlook(state), state.current.name
        if ahead.next_point is None and ahead.may_accept:
            return NextStep("accept", opening, model)
        return NextStep("measure", opening, model, point=ahead.next_point or "")
    for suspect in () if view is None else view.suspects:
        accused = suspect.accused
        if accused.model is not None and accused.probability > SURE:
            return NextStep("return", opening, accused.model, accused.photo, suspect.point)
    for strip in strips:
        for one in strip.models:
            if one.state == "open":
                return NextStep("measure", opening, one.name)
    if block.image_points:
        return NextStep("adjust", f"anaplot adjust {folder}")
    return NextStep("measure", opening)
