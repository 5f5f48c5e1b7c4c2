"""What follows from counters that have lost their reference, until they have it again."""

from __future__ import annotations

from dataclasses import replace

from anaplot.aliases import Side
from anaplot.errors import InputError
from anaplot.photogrammetry.readings import UNREFERENCED, Position
from anaplot.session.draft import Draft
from anaplot.session.referencing import (
    KnownPlace,
    Referencing,
    in_words,
)
from anaplot.session.requests import ReadAnew, Refer, SetMark
from anaplot.session.tolerances import tolerance_of_offsets_mm

__all__ = ["aim_at_reference", "keep_counters", "lose_reference", "refer"]


def aim_at_reference(draft: Draft, referencing: Referencing, point: str) -> None:
    """Choose what the counters are referred to; the instrument may set the mark on it."""
    # who sets the mark by himself does it anew, wherever it stands
    own = bool(draft.seen.own_operator)
    chosen = replace(referencing, chosen=point, moved=referencing.moved or own)
    at = chosen.proposed(*draft.desk.references)
    if at is None or at.name != point:
        raise InputError(f"{UNREFERENCED}; {point} is not measured or helps no further")
    draft.change(referencing=chosen)
    draft.tell("info", f"reference: {at.title}")
    if draft.seen.own_operator:
        draft.redirect(setting=draft.seen.own_operator, settles_after=None)
        draft.ask(SetMark(at.places, at.side))


def refer(draft: Draft, point: str | None) -> None:
    """Take it that the mark is set on a measured point, or on the one proposed (None)."""
    desk, seen, referencing = draft.desk, draft.seen, draft.desk.referencing
    if desk.abilities is None or referencing is None:
        raise InputError("the counters have their reference")
    if seen.line != "live":
        raise InputError(f"the plotter's line is {seen.line}")
    if seen.counters is None or not (desk.standing and seen.read):
        raise InputError("the counters have not been read since: try again")
    stands = referencing.last is not None and not referencing.is_away(seen.counters)
    if stands and not referencing.moved:
        raise InputError(
            "the mark has not been moved since it was pointed at: move it away and set it anew, or "
            "on something else"
        )
    if point is not None:
        referencing = replace(referencing, chosen=point)
    needed, known = desk.references
    at = referencing.proposed(needed, known)
    if not needed:
        _referenced(draft, "nothing measured depends on the counters: they count on", None)
        return
    if at is None or (point is not None and at.name != point):
        raise InputError(
            "nothing measured is there to refer the counters to: set them by hand and keep "
            "them as they are"
            if at is None
            else f"{point} is no reference: it is not measured"
        )
    _pointed(draft, referencing, at, seen.counters, needed)


def _pointed(
    draft: Draft,
    referencing: Referencing,
    at: KnownPlace,
    here: Position,
    needed: tuple[Side, ...],
) -> None:
    """Take it that the mark is set on a reference where the counters stand."""
    tolerance = tolerance_of_offsets_mm(draft.desk.state.block.precision.image_um)
    note = {"reference": at.title, "counters": [here.xl, here.yl, here.xr, here.yr]}
    try:
        referencing = referencing.pointed(at, here, tolerance)
    except InputError as error:
        draft.change(referencing=referencing.forgotten(at))
        draft.note("reference-refused", {**note, "reason": str(error)})
        draft.refused = error
        return
    draft.note("reference-pointed", note)
    draft.change(referencing=replace(referencing, chosen=None))
    draft.ask(ReadAnew())
    if referencing.open_sides(needed):
        draft.tell("info", f"{at.title} pointed at: once more, there or elsewhere")
        return
    mono = draft.desk.mono
    shift = referencing.shift(draft.seen.shift, tolerance, mono=mono)
    if shift is None:
        _referenced(draft, "the counters kept their origin", None)
    else:
        _referenced(draft, f"the counters are moved by {in_words(shift, mono=mono)}", shift)


def _referenced(draft: Draft, words: str, shift: Position | None) -> None:
    """End re-measuring: readings count again, moved by an offset or as before (None)."""
    payload = {} if shift is None else {"shift": [shift.xl, shift.yl, shift.xr, shift.yr]}
    draft.note("referenced", {"text": words, **payload})
    draft.ask(Refer(shift))
    # two pointings on what is on record agree: that is the check of photos laid in anew, too
    draft.change(referencing=None, checks=())
    draft.tell("info", words)
    draft.go_nowhere()
    if not draft.desk.state.suspended:
        draft.advance()


def keep_counters(draft: Draft) -> None:
    """Take the counters as they are."""
    desk = draft.desk
    if desk.abilities is None or (desk.referencing is None and not desk.checks):
        raise InputError("the counters have their reference")
    _referenced(draft, "the counters are taken as they are", None)


def lose_reference(draft: Draft) -> None:
    """Begin to re-measure the reference."""
    if draft.desk.referencing is not None:
        return
    draft.change(referencing=Referencing())
    draft.ask(ReadAnew())
    draft.go_nowhere()
    draft.note("unreferenced", {"reason": UNREFERENCED})
    draft.tell("error", UNREFERENCED)
