"""What is to be done now: the sentence with its keys, what Enter does, and the row it is about."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from rich.cells import cell_len

from anaplot.aliases import Axis
from anaplot.console.inwork import in_work
from anaplot.console.keybar import key_in_words
from anaplot.console.rows import ShownRow
from anaplot.photogrammetry.readings import AWAY
from anaplot.session.nextstep import Step, StepKind
from anaplot.station.snapshot import Snapshot

__all__ = ["NOTHING", "Entered", "Now", "leading", "longest_now", "now_of"]

Entered = Literal["drive", "next_model", "accept", "suspend", "add_point", "return_to"]

_ENTERED: Mapping[StepKind, Entered] = {
    "lay": "next_model",
    "measure": "drive",
    "remeasure": "drive",
    "accept": "accept",
    "resume": "suspend",
    "add": "add_point",
    "return": "return_to",
}
_KEY: Mapping[StepKind, str] = {
    "accept": "accept",
    "resume": "suspend",
    "add": "add_point",
    "rename": "rename",
    "switch off": "switch_row",
    "return": "drive",
}
_BY_LINE: frozenset[StepKind] = frozenset({"measure", "remeasure"})


@dataclass(frozen=True, slots=True)
class Now:
    """What is to be done now.

    Attributes
    ----------
    text
        The sentence, with the key of everything that it names.
    action
        What Enter does, as an action of `keys.ACTIONS`.
    point
        Where Enter drives to, when it drives.
    row
        The row that the sentence is about, which the cursor follows; None: the cursor stays.
    """

    text: str
    action: Entered = "drive"
    point: str | None = None
    row: tuple[str, Axis] | None = None


NOTHING = Now("")
"""Nothing in particular: Enter drives to the selected row."""


def now_of(
    snapshot: Snapshot, keys: Mapping[str, tuple[str, ...]], moved: ShownRow | None = None
) -> Now:
    """Return what is to be done now.

    Parameters
    ----------
    snapshot
        What the station says.
    keys
        The keys in force, by action.
    moved
        The row to which the operator moved the cursor by hand; None while it follows.
    """
    lead = _lead(snapshot)
    led = None if lead is None else lead.point
    row = _row(snapshot, led)
    where = None if moved is None else moved.point
    if not snapshot.agenda.steps:
        about = None if row is None else row[0]
        there = snapshot.next_point if snapshot.unreferenced else about
        return Now(snapshot.expected, "drive", where or there, row)
    elsewhere = None if where == led else where
    text = _text(snapshot, keys, lead, elsewhere)
    if elsewhere is not None or lead is None:
        return Now(text, "drive", elsewhere, row)
    action = _ENTERED[lead.kind]
    return Now(text, action, led if action == "drive" else None, row)


def longest_now(
    snapshot: Snapshot, keys: Mapping[str, tuple[str, ...]], points: Iterable[str]
) -> str:
    """Return the longest sentence that there is while the cursor follows, or is on these points.

    Parameters
    ----------
    snapshot, keys
        As `now_of` has them.
    points
        Those of all rows.
    """
    if not snapshot.agenda.steps:
        return snapshot.expected
    lead = _lead(snapshot)
    led = None if lead is None else lead.point
    places = (None, *(point for point in points if point != led))
    return max((_text(snapshot, keys, lead, place) for place in places), key=cell_len)


def leading(snapshot: Snapshot) -> str:
    """Return the action with which the model in work goes on, one of `keys.ACTIONS`."""
    lead = _lead(snapshot)
    if lead is None:
        return "next_point"
    return "next_model" if lead.kind == "lay" else _KEY.get(lead.kind, "next_point")


def _lead(snapshot: Snapshot) -> Step | None:
    """Return the step that Enter does."""
    return next((step for step in snapshot.agenda.steps if _enters(step)), None)


def _text(
    snapshot: Snapshot,
    keys: Mapping[str, tuple[str, ...]],
    lead: Step | None,
    elsewhere: str | None,
) -> str:
    """Return the steps as a sentence; `elsewhere`: a point that is not what the lead is about."""
    steps = snapshot.agenda.steps
    if elsewhere is not None:
        wanted = [] if lead is None else [_wanted(lead, snapshot, keys, entered=False)]
        if elsewhere != snapshot.target:
            to = "to" if snapshot.drives else "choose"
            wanted.insert(0, f"{to} {elsewhere}: {_shown(keys, 'drive')}")
        by_line = [0] if wanted else []
    else:
        wanted = [_wanted(step, snapshot, keys, entered=step is lead) for step in steps]
        by_line = [k for k, step in enumerate(steps) if step.kind in _BY_LINE]
    at = None if snapshot.suspended else snapshot.target
    if at is not None and at not in (step.point for step in steps):
        wanted.insert(0, f"measure {at}, then {_shown(keys, 'record')}")
        by_line = [0]
    if by_line and snapshot.link.state in AWAY:
        first = by_line[0]
        wanted[first] = f"wait for the line (look at cable and power), then {wanted[first]}"
    remark = snapshot.agenda.remark
    return ", or ".join(wanted) + (f" ({remark})" if remark else "")


def _enters(step: Step) -> bool:
    """Return whether Enter can do a step."""
    return step.kind in _ENTERED and (_ENTERED[step.kind] != "drive" or step.point is not None)


def _wanted(
    step: Step, snapshot: Snapshot, keys: Mapping[str, tuple[str, ...]], *, entered: bool
) -> str:
    """Return a step with its key; `entered`: Enter does it."""
    if step.kind == "lay":
        return f"{step.words}, then {_shown(keys, 'next_model')}"
    if step.point is not None and step.kind in ("measure", "remeasure"):
        # without a drive the points come in the order of the plan, until one is chosen
        in_turn = not snapshot.drives and step.kind == "measure" and snapshot.target is None
        if snapshot.target == step.point or in_turn:
            return f"{step.words}, then {_shown(keys, 'record')}"
        if entered:
            return f"{step.words}: {_shown(keys, 'drive')}"
        there = "next_point" if step.point == snapshot.next_point else "next_flag"
        return f"{step.words}: {_shown(keys, there)}"
    action = _KEY.get(step.kind)
    return step.words if action is None else f"{step.words}: {_shown(keys, action)}"


def _shown(keys: Mapping[str, tuple[str, ...]], action: str) -> str:
    return key_in_words(keys[action][0])


def _row(snapshot: Snapshot, point: str | None) -> tuple[str, Axis] | None:
    """Return a point's row, the most doubtful one first; else the worst, else the mark's."""
    work = in_work(snapshot)
    if point is not None:
        own = [key for key in work.keys if key[0] == point]
        doubted = (key for suspect in work.suspects for key in own if key == suspect)
        return next(doubted, own[0] if own else None)
    flagged = (key for worst in work.flagged for key in work.keys if key == worst)
    marked = (key for key in work.keys if key[0] == snapshot.target)
    return next(flagged, next(marked, None))
