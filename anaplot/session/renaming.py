"""The part of the fold that is about names: a measurement gets another one, or two exchange theirs.

That the mark was on the right point and the name was wrong costs no measurement: the coordinates
stay, and what they are called is corrected, in both photos or in one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from anaplot.aliases import Axis, Side
from anaplot.session.copied import copied
from anaplot.session.events import PlannedPoint, PointRenamed
from anaplot.session.modelstate import Measured, ModelState
from anaplot.session.refusal import EventRefusedError

__all__ = ["names_after", "renamed"]

Plan = tuple[PlannedPoint, ...]
_BOTH: tuple[Side, ...] = ("left", "right")


def renamed(
    model: ModelState, event: PointRenamed, known: Callable[[], Collection[str]]
) -> ModelState:
    """Return the model after what was measured as one point has the name of another.

    What has that name in the model already gets the name of the first: the two are exchanged. A
    name that is new in the model takes the place of the former one in the plan; a tie stays in the
    plan beside it, for it is still to be measured. What was switched off stays off under its new
    name; where one photo alone is concerned, both points are others, and believed again.

    Parameters
    ----------
    model
        The model in the instrument.
    event
        The two names, and in which photo.
    known
        Returns the points of the preceding model: ties.

    Raises
    ------
    EventRefusedError
        Another model is in the instrument, the point is not measured there, or in one photo alone
        there is nothing to exchange it with.
    """
    point, name = event.point, event.name
    if (event.left, event.right) != model.photos:
        raise EventRefusedError(
            f"point {point} of {event.left}/{event.right}: {model.name} is in the instrument"
        )
    if point == name:
        raise EventRefusedError(f"point {point} has that name")
    sides = _BOTH if event.side is None else (event.side,)
    if all(model.place_of(side, point) is None for side in sides):
        where = "" if event.side is None else f" in photo {model.photo(event.side)}"
        raise EventRefusedError(f"point {point} is not measured{where} in model {model.name}")
    if event.side is not None and not _has(model, name):
        what = "exchanged with another of the model" if model.mono else "exchanged with another"
        raise EventRefusedError(
            f"point {name} is not measured in model {model.name}: in one photo alone a point can "
            f"only be {what}"
        )
    plan = model.plan if model.planned(name) is not None else _plan_with_name(model, event, known())
    if model.mono:
        after = _mono(copied(model, plan=plan), event, sides)
    else:
        after = copied(model, plan=plan, measured=_pair(model, plan, event))
    if not model.off:
        return after
    before = copied(model, plan=plan)
    off = {key for key in before.off if key[0] not in (point, name)}
    if event.side is None:
        off |= _off_as(before, point, after, name) | _off_as(before, name, after, point)
    return copied(after, off=frozenset(off))


def names_after(before: ModelState, after: ModelState) -> dict[str, str]:
    """Return what points have been renamed to between two states of a model.

    A point is where it was measured, in both photos alike.
    """
    if before.photos != after.photos:
        return {}
    was, now = _places(before), _places(after)
    called = {at: name for name, at in now.items()}
    return {point: called[at] for point, at in was.items() if at in called and now.get(point) != at}


def _places(model: ModelState) -> dict[str, tuple[tuple[float, float] | None, ...]]:
    """Return where points were measured in the left and the right photo."""
    if not model.mono:
        return {m.point: ((m.xl, m.yl), (m.xr, m.yr)) for m in model.measured}
    seen = {(s.side, s.point): (s.x, s.y) for s in model.seen}
    places = {p.point: tuple(seen.get((side, p.point)) for side in _BOTH) for p in model.plan}
    return {point: at for point, at in places.items() if any(at)}


def _off_as(before: ModelState, point: str, after: ModelState, name: str) -> set[tuple[str, Axis]]:
    """Return the rows of what was measured as a point that are off when it has another name."""
    if before.measurement(point) is None:
        return set()
    # a point of which nothing counts may get a row more, and one less
    whole = before.is_off(point)
    return {(name, axis) for axis in after.axes(name) if whole or (point, axis) in before.off}


def _has(model: ModelState, name: str) -> bool:
    """Whether a ray in one photo can get a name: both photos need rays of every point measured."""
    if model.mono:
        return model.planned(name) is not None
    return model.measurement(name) is not None


def _plan_with_name(model: ModelState, event: PointRenamed, known: Collection[str]) -> Plan:
    """Return the plan of a model with the name in it."""
    old = model.planned(event.point)
    assert old is not None  # it is measured
    if (event.role == "tie") != (event.name in known):
        raise EventRefusedError(
            f"model {model.name}: point {event.name} is named as {event.role}, but "
            + ("is" if event.name in known else "is not")
            + " a point of the preceding model"
        )
    left, right = (model.place_of(side, event.point) for side in _BOTH)
    new = PlannedPoint(
        event.name, event.role, *(left or (old.xl, old.yl)), *(right or (old.xr, old.yr))
    )
    if old.role == "tie":
        return (*model.plan, new)
    return tuple([new if p is old else p for p in model.plan])


def _pair(model: ModelState, plan: Plan, event: PointRenamed) -> tuple[Measured, ...]:
    """Return what is measured in both photos of a model, in the order of the plan."""
    one = model.measurement(event.point)
    other = model.measurement(event.name)
    assert one is not None
    found = {m.point: m for m in model.measured if m.point != event.point}
    match event.side:
        case "left" if other is not None:
            found[one.point] = copied(one, xl=other.xl, yl=other.yl)
            found[other.point] = copied(other, xl=one.xl, yl=one.yl)
        case "right" if other is not None:
            found[one.point] = copied(one, xr=other.xr, yr=other.yr)
            found[other.point] = copied(other, xr=one.xr, yr=one.yr)
        case _:
            found[event.name] = copied(one, point=event.name)
            if other is not None:
                found[event.point] = copied(other, point=event.point)
    return tuple([m for p in plan if (m := found.get(p.point)) is not None])


def _mono(model: ModelState, event: PointRenamed, sides: tuple[Side, ...]) -> ModelState:
    point, name = event.point, event.name
    other = {point: name, name: point}
    seen = tuple(
        copied(s, point=other.get(s.point, s.point)) if s.side in sides else s for s in model.seen
    )
    return model.with_sightings(seen)
