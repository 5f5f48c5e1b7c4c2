"""What follows from something heard: readings, and what else the station tells the desk."""

from __future__ import annotations

from dataclasses import replace

from anaplot.adjustment.tested import Observation
from anaplot.errors import AnaplotError, InputError
from anaplot.orientation.results import Row
from anaplot.photogrammetry.readings import (
    AWAY,
    KEY,
    UNREFERENCED,
    Fault,
    InPosition,
    Position,
    Record,
    Refused,
)
from anaplot.session.accidents import Accident
from anaplot.session.arrival import is_at
from anaplot.session.counters import lose_reference
from anaplot.session.desk import Desk
from anaplot.session.draft import Decision, Draft
from anaplot.session.heard import (
    DriveBegun,
    DriveFailed,
    Heard,
    KeyFailed,
    LinkChanged,
    MarkSet,
    ReferenceLost,
    Seen,
)
from anaplot.session.layinganew import check_recorded
from anaplot.session.repeating import Repeating, repetition
from anaplot.session.requests import ReadAnew
from anaplot.session.workflow import Outlook

__all__ = ["hear"]

_REFUSALS_TOLD = 1.0  # s between two notices about bytes that are no readings


def hear(desk: Desk, heard: Heard, seen: Seen) -> Decision:
    """Return what follows from something heard; what cannot be done is told, never raised."""
    draft = Draft(desk, seen)
    match heard:
        case Position():
            _passed(draft, heard)
            _read(draft, heard)
        case InPosition(None):
            _replied(draft)
        case InPosition(Position() as position):
            _passed(draft, position)
            replies, target = draft.desk.replies.answered(position)
            draft.change(replies=replies)
            if target is not None and target == draft.desk.drive_target:
                _arrived(draft)
        case DriveBegun(before):
            draft.change(settles_after=before)
        case DriveFailed(errand):
            if errand == desk.errand:
                draft.interrupt()
        case KeyFailed(errand):
            if errand == desk.pressed:
                draft.change(pressed=None)
        case MarkSet(drive, remark):
            if desk.settles_after is not None and drive > desk.settles_after:
                draft.change(setting="")
                draft.ask(ReadAnew())
            if remark:
                draft.tell("warning", remark)
        case Record():
            _recorded(draft, heard)
        case Fault(code, text):
            draft.interrupt()
            draft.tell("error", f"plotter fault {code}: {text}")
            draft.note("fault", {"code": code, "text": text})
        case Refused(_, reason):
            _refused(draft, reason)
        case LinkChanged(line, detail):
            if line in AWAY:
                draft.interrupt()
                draft.change(pressed=None)
            if line == "lost":
                draft.tell("error", f"link lost: {detail}" if detail else "link lost")
        case ReferenceLost():
            lose_reference(draft)
    return draft.decision()


def _passed(draft: Draft, position: Position) -> None:
    """Take it that the plates were at a position: what was pointed at may lie elsewhere."""
    repeating = draft.desk.repeating
    if repeating is not None and not repeating.moved and repeating.is_away(position):
        draft.change(repeating=replace(repeating, moved=True))
    referencing = draft.desk.referencing
    if referencing is not None and not referencing.moved:
        by = draft.seen.shift
        counters = Position(
            position.xl - by.xl, position.yl - by.yl, position.xr - by.xr, position.yr - by.yr
        )
        if referencing.is_away(counters):
            draft.change(referencing=replace(referencing, moved=True))


def _read(draft: Draft, position: Position) -> None:
    """Take a read-out: it may say that the plates have arrived."""
    target, replies = draft.desk.drive_target, draft.desk.replies
    if target is None:
        return
    abilities = draft.desk.abilities
    still = 0.0 if abilities is None else abilities.still
    if is_at(position, target) or replies.stands(position, target, still):
        _arrived(draft)
    elif replies.bare:
        draft.change(replies=replace(replies, read=position))


def _replied(draft: Draft) -> None:
    """Take a reply that does not say where the plates are: the next read-outs tell whose it is."""
    desk = draft.desk
    if desk.abilities is not None and not desk.abilities.reads:
        _arrived(draft)  # nothing else tells of this instrument that the plates have arrived
    elif desk.drive_target is not None and not desk.replies.bare:
        draft.change(replies=replace(desk.replies, bare=True))


def _arrived(draft: Draft) -> None:
    if draft.desk.drive_target is not None:
        repeating = draft.desk.repeating
        draft.change(
            drive_target=None,
            repeating=None if repeating is None else replace(repeating, moved=True),
        )


def _recorded(draft: Draft, record: Record) -> None:
    """Turn a record of the plotter into a measurement, or say why not."""
    before = {row.key for row in _flagged(draft.desk.outlook)}
    told = set(map(_about, draft.desk.accidents))
    pressed = draft.desk.pressed if record.switch == KEY else None
    try:
        if record.switch == KEY:
            draft.change(pressed=None)
        if pressed is not None and pressed != draft.desk.errand:
            raise InputError("the plates were to go elsewhere since the key was pressed")
        mode, name = draft.recordable()
        if draft.desk.check is not None:
            check_recorded(draft, name, record.position)
            return
        measured = mode.measurement(name, record.position, record.switch)
        again = draft.desk.repeating
        if again is not None:
            draft.happen(repetition(mode.model, measured, moved=again.moved))
            _repeated(draft, again.after(record.position))
            return
        draft.happen(*mode.additions(name), measured)
    except AnaplotError as error:
        draft.tell("error", f"not recorded: {error}")
        draft.note("record-refused", {"reason": str(error)})
        return
    draft.redirect(target=None, last_measured=name)
    what = name if mode.unit == "point" else f"{mode.unit} {name}"
    draft.tell("record", f"{what} recorded")
    fresh = [row.key for row in _flagged(draft.desk.outlook) if row.key not in before]
    if fresh:
        draft.tell("warning", "flagged: " + ", ".join(f"{one} {axis}" for one, axis in fresh))
    for accident in draft.desk.accidents:
        if _about(accident) not in told:
            draft.tell("warning", accident.text)
    draft.advance()


def _about(accident: Accident) -> str:
    """Return what an accident is about: a point, or a photograph as it says itself."""
    return accident.point or accident.text


def _repeated(draft: Draft, again: Repeating) -> None:
    """Go on to the next pointing at the same point, or to what comes after the last one."""
    remark = "" if again.moved else ": the mark was not seen to move away, it does not count"
    draft.tell("record", f"{again.name} pointed at again, {again.done} of {again.times}{remark}")
    if again.done < again.times:
        draft.point_away(replace(again, moved=False))
        return
    draft.redirect(target=None)
    draft.advance()


def _refused(draft: Draft, reason: str) -> None:
    if reason == UNREFERENCED:
        return  # every reading, until the reference is measured: told once, and on the screen
    if reason.startswith(f"{KEY} was not recorded"):
        draft.change(pressed=None)
    draft.note("refused", {"reason": reason})
    if draft.seen.time - draft.desk.refusal_told >= _REFUSALS_TOLD:
        draft.change(refusal_told=draft.seen.time)
        draft.tell("warning", f"line: {reason}")


def _flagged(view: Outlook) -> tuple[Observation[Row], ...]:
    solution = view.solution if view.inner is None else view.inner.solution
    return () if solution is None else solution.flagged
