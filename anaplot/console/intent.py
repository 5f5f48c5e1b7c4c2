"""What a key means, as a value: a command to the station, a question, a word to the operator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from anaplot.aliases import Side
from anaplot.console.inwork import in_work
from anaplot.console.situation import Situation
from anaplot.console.stationlike import ControlsLike
from anaplot.console.wheels import FIELDS, TURNS
from anaplot.session import commands
from anaplot.session.commands import Command
from anaplot.session.othernames import OtherName
from anaplot.session.reasons import REASONS
from anaplot.station.blockstatus import ModelStatus
from anaplot.station.snapshot import Snapshot

__all__ = [
    "PAGES",
    "Intent",
    "Leave",
    "OtherPointName",
    "PointName",
    "Question",
    "Read",
    "Report",
    "Say",
    "Toggle",
    "Turn",
    "aimed",
    "answer",
    "idle",
    "intended",
]


@dataclass(frozen=True, slots=True)
class Say:
    """Tell the operator why a key does nothing now, which is no fault."""

    text: str


@dataclass(frozen=True, slots=True)
class Leave:
    """End the console; `keep` a block that would be deleted."""

    keep: bool = False


@dataclass(frozen=True, slots=True)
class PointName:
    """Ask for the name of a point to add."""


@dataclass(frozen=True, slots=True)
class OtherPointName:
    """Ask what a measured point is in truth.

    `proposed`: its probable name, or "". `photos`: left and right. `measured`: what the model has.
    `seen`: in which photos the point is measured. `alone`: the points with which it can be
    exchanged in one photo alone.
    """

    proposed: OtherName
    photos: tuple[str, str]
    measured: tuple[str, ...]
    seen: tuple[Side, ...]
    alone: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Read:
    """Open a page."""

    page: str


@dataclass(frozen=True, slots=True)
class Report:
    """Write the report of the block."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn the handwheels of a simulated instrument [mm]."""

    x: float
    y: float
    px: float
    py: float

    def at(self, controls: ControlsLike) -> None:
        """Do it."""
        controls.turn(self.x, self.y, self.px, self.py)


@dataclass(frozen=True, slots=True)
class Toggle:
    """Switch a simulated instrument's hand or operator on, or off when it is on by then."""

    what: Literal["hand", "automatic"]

    def at(self, controls: ControlsLike) -> None:
        """Do it."""
        if self.what == "hand":
            controls.set_hand(not controls.hand)
        else:
            controls.set_automatic(not controls.automatic)


@dataclass(frozen=True, slots=True)
class Question:
    """Ask first, and do it when the answer is yes; the keys of the action `again` say yes, too.

    `other` is a third answer, and what it means.
    """

    text: str
    yes: str
    no: str
    then: Command | Leave | Toggle
    again: str = ""
    other: tuple[str, Leave] | None = None


Intent = (
    Command | Say | Question | Leave | PointName | OtherPointName | Read | Report | Turn | Toggle
)

PAGES = ("orientation", "messages", "block", "ties", "fit", "log", "pointing", "errors", "help")
"""Pages that are there whatever is selected, each opened by the action of its name."""

_ALWAYS: dict[str, Intent] = {
    "record": commands.RecordPoint(),
    "next_model": commands.NextModel(),
    "other_photo": commands.OtherPhoto(),
    "undo": commands.Undo(),
    "stop": commands.Stop(),
    "add_point": PointName(),
    "report": Report(),
    **{f"why_{reason}": commands.GiveReason(reason) for reason in REASONS},
    **{page: Read(page) for page in PAGES},
}
_NEEDS_WHEELS = ("zoom_in", "zoom_out", "coarse")
_OF_A_ROW = ("switch_row", "switch_point", "rename", "details")
_NAMED = 8  # missing points that a question names
_WHEELS_ELSEWHERE = Say("the handwheels are those of a simulated plotter's stereo view (v)")
_HAND_OFF = Question(
    "Take the simulated hand away? After a drive you set the mark yourself then, with the "
    "handwheels of the stereo view (v).",
    yes="take it away",
    no="leave it on",
    then=Toggle("hand"),
    again="hand",
)


def intended(action: str, now: Situation) -> Intent:
    """Return what a key means in a situation.

    Parameters
    ----------
    action
        An action of `keys.ACTIONS` that works with the instrument or the session, not with what is
        seen of it.
    now
        What the key meets.
    """
    snapshot = now.snapshot
    if action in _ALWAYS:
        return _ALWAYS[action]
    if action in TURNS:
        if not now.at_wheels:
            return _WHEELS_ELSEWHERE
        return Turn(*now.choices.wheels.turned(action))
    if action == "drive" and now.aim is not None:
        return _gone_to(now.aim, snapshot)
    if action in _OF_A_ROW:
        return _with_row(action, now)
    match action:
        case "drive":
            return _entered(now)
        case "next_point" if snapshot.next_point is not None:
            return commands.Drive(snapshot.next_point)
        case "next_point":
            return Say("no point is expected next")
        case "accept":
            return _accept(snapshot)
        case "reference":
            return commands.Reference(now.chosen)
        case "keep_counters":
            return _keep_counters(snapshot)
        case "suspend":
            return commands.Resume() if snapshot.suspended else commands.Suspend()
        case "automatic" if now.controls is None:
            return Say("only a simulated plotter has a simulated operator")
        case "hand" if now.controls is None and snapshot.link.state == "replay":
            return Say("this is a replay: one can only look on")
        case "hand" if now.controls is None:
            return Say("only a simulated plotter is worked from here")
        case "hand" if now.hand and not now.at_wheels:
            return _HAND_OFF
        case "hand" | "automatic":
            return Toggle(action)
        case "leave":
            return _leave(snapshot, temporary=now.temporary)
        case _:
            raise ValueError(f"no meaning of {action!r}")


def _entered(now: Situation) -> Intent:
    """Return what Enter means: what the line NOW says, or a drive to the selected row's point."""
    back = now.snapshot.returning
    if now.now.action == "return_to" and back is not None:
        return commands.ReturnTo(back.left, back.right, back.point, back.photo)
    if now.now.action not in ("drive", "return_to"):
        return intended(now.now.action, now)
    if now.now.point is not None:
        return commands.Drive(now.now.point)
    if now.selected is not None:
        return commands.Drive(now.selected.point)
    return Say("no row is selected")


def idle(action: str, now: Situation) -> str:
    """Return why an action that only changes what is seen changes nothing now, or ""."""
    if action in _NEEDS_WHEELS:
        if not now.at_wheels:
            return _WHEELS_ELSEWHERE.text
        zoom = now.choices.wheels.zoom
        if action == "zoom_in" and zoom == len(FIELDS) - 1:
            return "this is the smallest field"
        if action == "zoom_out" and zoom == 0:
            return "this is the widest field"
    diagnosis = now.snapshot.diagnosis
    if action == "transfers" and (diagnosis is None or not diagnosis.transfers):
        return "no critical transfers"
    return ""


def answer(command: Command, snapshot: Snapshot) -> str:
    """Return what is told at once of a command of which nothing else is heard at once, or ""."""
    match command:
        case commands.Drive(point) if snapshot.drives:
            return f"to {point}"
        case commands.Drive(point):
            return f"{point} is next: set the mark on it, then record"
        case commands.Stop():
            return "stop" if snapshot.drives else "nothing to stop: this plotter has no drive"
        case _:
            return ""


def aimed(now: Situation, key: str) -> str:
    """Return what a key does on the overview's model, or "" when it goes to none that is done."""
    model = now.aim
    advised = now.snapshot.returning
    if model is None:
        return ""
    if advised is not None and (advised.left, advised.right) == (model.left, model.right):
        return ""  # NOW says so anyway
    if model.state == "in work":
        return f"to the table of model {model.name}: {key}"
    match _gone_to(model, now.snapshot):
        case commands.ReturnTo():
            return f"return to model {model.name}: {key}"
        case _:
            return ""


def _gone_to(model: ModelStatus, snapshot: Snapshot) -> Intent:
    """Go to a model of the overview."""
    if model.state == "in work":
        return Say(f"model {model.name} is in work")
    if (model.left, model.right) in snapshot.accepted:
        return _returned_to(model, snapshot)
    if snapshot.left and not snapshot.finished:
        work = f"{snapshot.left}/{snapshot.right}"
        say = f"model {model.name} comes after model {work}, which is in work: "
        return Say(say + "accept that first, or take its points back")
    models = () if snapshot.status is None else snapshot.status.models
    following = next((m for m in models if (m.left, m.right) not in snapshot.accepted), None)
    if following is None or following.name == model.name:
        return commands.NextModel()
    return Say(f"model {model.name} comes after model {following.name}, which is next")


def _returned_to(model: ModelStatus, snapshot: Snapshot) -> Intent:
    """Return to an accepted model; where the block holds a point of it for wrong, for that one."""
    step = None if snapshot.status is None else snapshot.status.next
    if step is not None and step.do == "return" and step.model == model.name:
        return commands.ReturnTo(model.left, model.right, step.point, step.photo)
    return commands.ReturnTo(model.left, model.right)


def _with_row(action: str, now: Situation) -> Intent:
    shown = now.selected
    if shown is None:
        return Say("no row is selected")
    if action == "switch_row" and now.measured:
        return commands.Switch(shown.point, shown.axis, now.row_off)
    if action == "details":
        return Read(action)
    if action == "rename":
        return _renamed(shown.point, now)
    return commands.Switch(shown.point, None, now.point_off)


def _renamed(point: str, now: Situation) -> Intent:
    snapshot = now.snapshot
    if snapshot.inner is not None:
        return Say("fiducials keep their names: the inner orientation comes first")
    measured = {view.point: view for view in snapshot.points if view.times or view.seen}
    if point not in measured:
        return Say(f"{point} is not measured yet")
    seen: tuple[Side, ...] = ("left", "right")
    alone = tuple(measured)
    if snapshot.mono:
        # what is planned has a place in each photo, measured there or not
        seen = measured[point].seen
        alone = tuple(view.point for view in snapshot.points if not view.offered)
    proposed = now.other_name or OtherName(point, "")
    photos = (snapshot.left, snapshot.right)
    return OtherPointName(proposed, photos, tuple(measured), seen, alone)


def _accept(snapshot: Snapshot) -> Intent:
    """Accept inner orientation or model when that may be done; what is doubtful asks first."""
    if not snapshot.may_accept:
        reason = snapshot.problem or snapshot.expected
        what = "the model" if snapshot.inner is None else "the inner orientation"
        return Say(f"{what} cannot be accepted now: {reason}")
    work = in_work(snapshot)
    where = f"model {snapshot.left} / {snapshot.right}"
    if snapshot.inner is not None:
        where = f"the inner orientation of photo {snapshot.inner.photo}"
    doubts = []
    missing = [view.point for view in work.needed if view.status == "pending"]
    if missing:
        names = ", ".join(missing[:_NAMED]) + (", ..." if len(missing) > _NAMED else "")
        what = "points" if snapshot.inner is None else "fiducials"
        count = f"{len(missing)} of {len(work.needed)} {what}"
        doubts.append(f"{where[0].upper()}{where[1:]} is incomplete, {count} to go: {names}.")
    flagged = len(work.flagged)
    if flagged:
        rows = "1 row is" if flagged == 1 else f"{flagged} rows are"
        doubts.append(f"{rows} still flagged in {where}.")
    elif snapshot.inner is None and snapshot.solution is not None and snapshot.solution.unexplained:
        doubts.append(f"Nothing is flagged in {where}, but {snapshot.solution.unexplained}.")
    if not doubts:
        return commands.Accept()
    return Question(
        f"{' '.join(doubts)} Accept it?",
        yes="accept as it is",
        no="go on measuring",
        then=commands.Accept(),
        again="accept",
    )


def _keep_counters(snapshot: Snapshot) -> Intent:
    if not snapshot.unreferenced and not snapshot.checks:
        return Say("the counters have their reference")
    return Question(
        "Did the counters keep their origin, or were they set to it by hand? Everything "
        "measured from now on depends on that.",
        yes="keep them as they are",
        no="measure a reference",
        then=commands.KeepCounters(),
    )


def _leave(snapshot: Snapshot, *, temporary: bool) -> Intent:
    """Leave; with a model in progress, or a block that would be deleted, ask first."""
    in_progress = (
        snapshot.left
        and not snapshot.finished
        and (snapshot.reopened or (snapshot.left, snapshot.right) not in snapshot.accepted)
        and _measured(snapshot)
    )
    worth = bool(in_progress or (temporary and snapshot.accepted))
    if not worth:
        return Leave()
    words = []
    model = f"{snapshot.left} / {snapshot.right}"
    if snapshot.reopened:
        words.append(
            f"You returned to model {model}: it stays open, and image_points.csv keeps it as it "
            "was until you accept it again."
        )
    elif in_progress:
        words.append(f"Model {model} is not accepted yet.")
    if temporary:
        words.append("The block of this demonstration is deleted when you leave. Leave?")
        return Question(
            " ".join(words),
            yes="leave, delete it",
            no="stay",
            then=Leave(),
            other=("keep it, and leave", Leave(keep=True)),
        )
    words.append("Everything recorded is on disk, and the work goes on here next time. Leave?")
    return Question(" ".join(words), yes="leave", no="stay", then=Leave())


def _measured(snapshot: Snapshot) -> bool:
    """Return whether anything was measured in the current model."""
    fiducials = any(view.times for inner in snapshot.inners for view in inner.fiducials)
    return fiducials or any(view.times or view.seen for view in snapshot.points)
