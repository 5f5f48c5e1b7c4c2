"""What follows from a command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from anaplot.aliases import Axis, Side
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.platetransformation import TITLES
from anaplot.photogrammetry.readings import AWAY, UNREFERENCED
from anaplot.session import commands
from anaplot.session.checkpoints import check_points, points_due
from anaplot.session.commands import Command
from anaplot.session.counters import aim_at_reference, keep_counters, refer
from anaplot.session.desk import NO_ERRAND, Desk
from anaplot.session.draft import Decision, Draft
from anaplot.session.events import (
    ModelAccepted,
    ModelChosen,
    PhotoLaid,
    PointAdded,
    Reason,
    ReasonGiven,
    Resumed,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.heard import Seen
from anaplot.session.innerwork import InnerOutlook, acceptance
from anaplot.session.layinganew import laid_anew, return_to
from anaplot.session.modelstate import ModelState
from anaplot.session.modes import Fiducials, Pairs, Singles
from anaplot.session.othernames import still_called, where_elsewhere
from anaplot.session.plans import plan_of
from anaplot.session.plates import image_of, plates_of
from anaplot.session.renaming import names_after
from anaplot.session.repeating import begin_repeating
from anaplot.session.requests import StopDrive, TakeRecord, WarmUp, WritePoints
from anaplot.session.state import SessionState
from anaplot.session.undone import undone

__all__ = ["decide"]

_LONGEST_NAME = 100  # characters of a point's name
_SIDES: tuple[Side, ...] = ("left", "right")


def decide(desk: Desk, command: Command, seen: Seen) -> Decision:
    """Return what follows from a command.

    Raises
    ------
    InputError
        It cannot be carried out now; says why, and nothing follows.
    NotComputableError
        What is to be accepted is not determined.
    """
    draft = Draft(desk, seen)
    match command:
        case commands.Drive(point):
            _drive(draft, point)
        case commands.Stop():
            _stop(draft)
        case commands.RecordPoint():
            _record(draft)
        case commands.PointAgain(point, times):
            _point_again(draft, point, times)
        case commands.Switch(point, axis, on):
            _switch(draft, point, axis, on=on)
        case commands.Rename(point, name, side):
            _rename(draft, point, name, side)
        case commands.Undo():
            _undo(draft)
        case commands.GiveReason(reason):
            _give_reason(draft, reason)
        case commands.Accept():
            _accept(draft)
        case commands.NextModel():
            _next_model(draft)
        case commands.ReturnTo(left, right, point, photo):
            return_to(draft, left, right, point, photo)
        case commands.OtherPhoto():
            model = draft.model()
            draft.check_kind(model)
            _lay_photo(draft, model.photo("right" if model.laid == "left" else "left"))
        case commands.Reference(point):
            refer(draft, point)
        case commands.KeepCounters():
            keep_counters(draft)
        case commands.AddPoint(name):
            _add_point(draft, name)
        case commands.Suspend():
            draft.happen(Suspended())
        case commands.Resume():
            draft.happen(Resumed())
        case commands.TurnWheels():
            if desk.drive_target is not None:
                raise InputError("the plates are still under way")
            draft.change(setting="")
        case commands.TakeOver():
            draft.change(setting="")
    return draft.decision()


def _drive(draft: Draft, point: str) -> None:
    if draft.desk.referencing is not None:
        aim_at_reference(draft, draft.desk.referencing, point)
        return
    mode = draft.mode()
    if not mode.has(point):
        raise InputError(mode.missing(point))
    repeating = draft.desk.repeating
    if repeating is not None and repeating.name == point:
        draft.point_away(replace(repeating, moved=False))  # it goes on with what it is at
        return
    draft.aim(mode, point)


def _stop(draft: Draft) -> None:
    desk = draft.desk
    begins = bool(desk.setting) and desk.settles_after is None  # the instrument was not asked yet
    if desk.drive_target is not None or begins or desk.repeating is not None:
        # the plates stop anywhere, or run on: what is recorded there is not what they went to
        draft.go_nowhere()
    else:
        draft.redirect(setting="")
    if desk.abilities is not None and desk.abilities.drives:
        draft.ask(StopDrive())


def _record(draft: Draft) -> None:
    if draft.desk.abilities is None:
        raise InputError("no plotter is connected: nothing to record")
    if draft.seen.line in AWAY:
        raise InputError(f"the plotter's line is {draft.seen.line}: nothing is recorded over it")
    if draft.desk.referencing is not None:
        raise InputError(UNREFERENCED)
    draft.recordable()
    errand, before = draft.desk.errand, draft.desk.pressed
    # a press elsewhere still waits: whose record comes next is not known
    draft.change(pressed=errand if before in (None, errand) else NO_ERRAND)
    draft.ask(TakeRecord())


def _point_again(draft: Draft, name: str | None, times: int) -> None:
    desk = draft.desk
    if desk.abilities is None:
        raise InputError("no plotter is connected: nothing to point at")
    if desk.referencing is not None:
        raise InputError(UNREFERENCED)
    if desk.check is not None:
        raise InputError(f"record point {desk.check} first: how the photos lie is not checked yet")
    if times < 1:
        raise InputError("point again at least once")
    mode = draft.mode()
    if name is None:
        standing = desk.target is not None and mode.stands(desk.target, desk.abilities.middle)
        name = desk.target if standing else desk.last_measured
    if name is None:
        raise InputError(f"drive to a {mode.unit} first")
    draft.point_away(begin_repeating(mode, name, times, desk.abilities.middle))


def _rename(draft: Draft, point: str, name: str, side: Side | None) -> None:
    mode = _pointing_mode(draft)
    _check_name(name)
    before = draft.model()
    exchanged = any(before.place_of(s, name) is not None for s in _SIDES if side in (None, s))
    known = draft.desk.transfer.places
    draft.happen(mode.renamed(point, name, side))
    where = "" if side is None else f" in photo {before.photo(side)}"
    what = f"{point} and {name} exchanged" if exchanged else f"{point} is {name} now"
    draft.tell("info", f"{what}{where}")
    believed = sorted(before.off - draft.model().off) if side is not None else []
    if believed:
        draft.tell("info", f"on again: {', '.join(' '.join(row) for row in believed)}")
    names = names_after(before, draft.model())
    for words in still_called(draft.desk.state, before, names):
        draft.tell("warning", words)
    for one in (name, point):
        elsewhere = where_elsewhere(draft.desk.state, known, one)
        if elsewhere is not None:
            draft.tell("info" if elsewhere.agrees else "warning", elsewhere.text)
    if side is None and draft.desk.last_measured == name and not exchanged:
        draft.change(last_measured=None)
    _called(draft, names)
    if draft.desk.target in (point, name):
        draft.go_nowhere()
        draft.advance()


def _called(draft: Draft, names: Mapping[str, str]) -> None:
    """Let what the desk remembers of points be known by their names of now."""
    desk = draft.desk
    last = desk.last_measured
    draft.change(
        last_measured=None if last is None else names.get(last, last),
        checks=tuple(names.get(name, name) for name in desk.checks),
    )


def _undo(draft: Draft) -> None:
    before = draft.desk.state
    draft.happen(Undone(before.undo_lays_anew))
    after = draft.desk.state
    if before.current is not None and after.current is not None:
        names = names_after(before.current, after.current)
        _called(draft, names)
        if draft.desk.target in {*names, *names.values()}:
            draft.go_nowhere()
    if before.models != after.models:
        draft.ask(WritePoints())
    if _photos(before) != _photos(after):
        draft.go_nowhere()
        draft.begin_checks(points_due(after))
        draft.lay()
    elif _lies(before) != _lies(after) or draft.desk.repeating is not None:
        draft.go_nowhere()
        draft.begin_checks(())
    elif draft.desk.target is not None:
        mode = draft.desk.mode
        if mode is None or not mode.has(draft.desk.target):
            draft.go_nowhere()
    if any(not _on_record(draft.model(), name) for name in draft.desk.checks):
        draft.begin_checks(check_points(draft.desk.state))
    draft.tell("info", f"undone: {undone(before, after)}")


def _on_record(model: ModelState, point: str) -> bool:
    """Whether it is known where a point was in a photo that lies there."""
    return any(model.place_of(side, point) is not None for side in model.carriages)


def _give_reason(draft: Draft, reason: Reason) -> None:
    if draft.desk.state.last_change is None:
        raise InputError("nothing was changed yet: there is nothing to give a reason for")
    before = draft.desk.state.reasons
    draft.happen(ReasonGiven(reason))
    changed = draft.desk.state.last_change
    assert changed is not None
    row = f"{changed.point} {changed.axis or ''}".strip()
    what = {"remeasured": "measured again", "undone": "taken back"}.get(changed.what, changed.what)
    draft.tell("info", f"{row or changed.model} {what}: {reason}")
    if draft.desk.state.reasons != before:
        draft.ask(WritePoints())


def _switch(draft: Draft, point: str, axis: Axis | None, *, on: bool) -> None:
    mode = draft.desk.mode
    if mode is None:
        draft.happen(RowSwitched(point, axis, on))
        return
    added = () if on else mode.additions(point)
    left_out = bool(added) or (not on and point in mode.pending)
    draft.happen(*added, mode.switch(point, axis, on))
    if left_out and point in (draft.desk.target, draft.desk.drive_target):
        # what is left out is not recorded by the next press
        draft.go_nowhere()
        draft.advance()


def _accept(draft: Draft) -> None:
    model, view = draft.model(), draft.desk.outlook
    if view.inner is not None and not view.leaves:
        _accept_inner(draft, view.inner)
        return
    if view.solution is None and not view.leaves:
        raise NotComputableError(
            f"model {model.name} is not determined yet"
            + (f": {view.problem}" if view.problem else "")
        )
    returned = draft.desk.state.returned is not None
    draft.happen(ModelAccepted(model.left, model.right))
    draft.go_nowhere()
    draft.begin_checks(())
    draft.tell("info", f"model {model.name} accepted" + (" again" if returned else ""))
    draft.ask(WritePoints())
    if returned:
        _go_on(draft)


def _go_on(draft: Draft) -> None:
    """Say what a return has changed, and go on where the operator was."""
    changed = [one.name for one in draft.desk.recomputed]
    if changed:
        draft.tell("info", f"computed anew, and changed: {', '.join(changed)}")
    parked = draft.desk.state.current
    if parked is not None:
        draft.tell("info", f"model {parked.name} is in work again: lay its photos in anew")
        laid_anew(draft)


def _accept_inner(draft: Draft, view: InnerOutlook) -> None:
    inner = view.state
    if view.solution is None:
        raise NotComputableError(
            f"the inner orientation of {inner.name} is not determined yet"
            + (f": {view.problem}" if view.problem else "")
        )
    draft.happen(acceptance(inner, view.solution))
    draft.go_nowhere()
    title = TITLES[view.solution.kind]
    draft.tell("info", f"inner orientation of {inner.name} accepted: {title}")
    draft.advance()


def _next_model(draft: Draft) -> None:
    desk = draft.desk
    model, next_photo = desk.state.current, desk.outlook.next_photo
    if model is not None and next_photo is not None:
        _lay_photo(draft, model.photo(next_photo))
        return
    if model is not None:
        raise InputError(f"accept model {model.name} first")
    following = desk.outlook.next_model
    if following is None:
        raise InputError("every model of the block is accepted")
    strip, left, right = following
    draft.ask(WritePoints())
    plan = plan_of(desk.state, desk.pattern, desk.candidates, strip, left, right)
    draft.happen(ModelChosen(strip, left, right, plan, mono=desk.mono))
    draft.ask(WarmUp())
    draft.tell("info", f"photos {left} and {right}: {len(plan)} points to measure")
    if desk.mono and draft.model().laid is None:
        _lay_photo(draft, left)
        return
    draft.lay()
    draft.advance()


def _lay_photo(draft: Draft, photo: str) -> None:
    draft.happen(PhotoLaid(photo))
    draft.go_nowhere()
    draft.lay()
    draft.tell("info", f"photo {photo} lies in the comparator")
    draft.begin_checks(check_points(draft.desk.state))
    draft.advance()


def _add_point(draft: Draft, name: str) -> None:
    model, mode, here = draft.model(), _pointing_mode(draft), draft.seen.position
    _check_name(name)
    if here is None:
        raise InputError("there is no read-out: drive the plates to the new point first")
    draft.check_instrument(model)
    if draft.desk.drive_target is not None:
        raise InputError("the plates are still under way")
    draft.happen(PointAdded(mode.added(name, image_of(here, plates_of(draft.desk.state)))))
    draft.redirect(target=name)


def _pointing_mode(draft: Draft) -> Pairs | Singles:
    """Return how points are measured in the model; refused before its photos are oriented."""
    model, mode = draft.model(), draft.desk.mode
    if mode is None or isinstance(mode, Fiducials):
        assert model.open_inner is not None
        raise InputError(f"{model.open_inner.name}: inner orientation comes first")
    return mode


def _check_name(name: str) -> None:
    if not name.strip() or not name.isprintable() or len(name) > _LONGEST_NAME:
        raise InputError(f"a point needs a printable name of at most {_LONGEST_NAME} characters")
    if name != name.strip():
        raise InputError("a point's name begins and ends without a blank")


def _photos(state: SessionState) -> tuple[str, str] | None:
    return None if state.current is None else state.current.photos


def _lies(state: SessionState) -> tuple[Side | None, str, Side] | Side | None:
    """Return what lies in a mono comparator, and the inner orientation in work."""
    model = state.current
    if model is None or model.open_inner is None:
        return None if model is None else model.laid
    return model.laid, model.open_inner.photo, model.open_inner.side
