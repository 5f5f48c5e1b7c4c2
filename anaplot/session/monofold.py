"""The part of the fold that is about mono comparators: one photo lies in the instrument."""

from __future__ import annotations

from anaplot.aliases import Side
from anaplot.photogrammetry.block import Block
from anaplot.session.copied import copied
from anaplot.session.events import MonoMeasured, PhotoLaid
from anaplot.session.modelstate import ModelState, Sighting
from anaplot.session.pointcheck import check_place
from anaplot.session.refusal import EventRefusedError

__all__ = ["followed", "laid_in", "measured_in_photo", "taken_over"]


def laid_in(model: ModelState, event: PhotoLaid, laying: int) -> ModelState:
    """Return the model after one of its photos was laid into the comparator.

    Raises
    ------
    EventRefusedError
        It is no mono model, or the photo is none of its photos.
    """
    if not model.mono:
        raise EventRefusedError(
            f"model {model.name} was begun in an instrument that holds both photos"
        )
    if event.photo not in model.photos:
        raise EventRefusedError(f"photo {event.photo} is not in model {model.name}")
    side: Side = "left" if event.photo == model.left else "right"
    return copied(model, laid=side, laying=laying)


def measured_in_photo(block: Block, model: ModelState, event: MonoMeasured) -> ModelState:
    """Return the model after a point was measured in the photo in the comparator.

    Raises
    ------
    EventRefusedError
        Another model or photo lies there, no such point, or no place in the photo.
    """
    if (event.left, event.right) != model.photos:
        raise EventRefusedError(
            f"point {event.point} of {event.left}/{event.right}: {model.name} is in work"
        )
    photo = model.photo(event.side)
    if not model.mono:
        raise EventRefusedError(
            f"model {model.name} was begun in an instrument that holds both photos"
        )
    if model.laid != event.side:
        raise EventRefusedError(f"photo {photo} does not lie in the comparator: lay it in first")
    if model.planned(event.point) is None:
        raise EventRefusedError(f"point {event.point} is not in the plan of model {model.name}")
    check_place(block, photo, event.point, event.x, event.y)
    old = model.sighting(event.side, event.point)
    times = 1 if old is None else old.times + 1
    return model.with_sighting(Sighting(event.point, event.side, event.x, event.y, times))


def taken_over(model: ModelState, preceding: ModelState, *, lies: bool) -> ModelState:
    """Return a mono model with what the preceding one says of the photo they share.

    Its points count as measured in the left photo; they are ties. Where the photo still lies in
    the comparator (`lies`), so does its inner orientation.
    """
    for planned in model.plan:
        known = next((m for m in preceding.used if m.point == planned.point), None)
        if known is not None and model.sighting("left", planned.point) is None:
            model = model.with_sighting(Sighting(known.point, "left", known.xr, known.yr, 1))
    if not (lies and preceding.laid == "right"):
        return model
    before = preceding.inner_of("right")
    inner = tuple(
        copied(before, side="left") if before is not None and i.side == "left" else i
        for i in model.inner
    )
    return copied(model, laid="left", laying=preceding.laying, inner=inner)


def followed(model: ModelState, old: ModelState, new: ModelState) -> ModelState:
    """Return a mono model after the preceding one, with which it shares a photo, was accepted anew.

    What was measured once serves both models: where the later one has the coordinates of the
    former version, it takes those of the new one, and what is only now known it takes over. What
    was measured in the later model itself stays.
    """
    before = {m.point: (m.xr, m.yr) for m in old.measured}
    now = {m.point: (m.xr, m.yr) for m in new.measured}
    for sighting in model.seen:
        was = before.get(sighting.point)
        if sighting.side != "left" or (sighting.x, sighting.y) != was:
            continue
        is_now = now.get(sighting.point, was)
        if is_now != was:
            model = model.with_sighting(Sighting(sighting.point, "left", *is_now, sighting.times))
    return taken_over(model, new, lies=False)
