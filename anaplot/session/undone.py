"""What an undo has taken back, in words."""

from __future__ import annotations

from anaplot.session.innerstate import InnerState
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState

__all__ = ["undone"]

_FEW = 6  # rows are named, and models; more are counted


def undone(before: SessionState, after: SessionState) -> str:
    """Return what an undo has taken back: what holds again now.

    Parameters
    ----------
    before, after
        The session before and after the undo.
    """
    was, now = before.current, after.current
    switched = _elsewhere(before, after)
    if switched:
        return switched
    if was is None or now is None or was.photos != now.photos or before.models != after.models:
        if now is not None and was is None:
            return f"model {now.name} is in work again"
        if was is not None and now is not None:
            return f"model {now.name} is in work again instead of {was.name}"
        return "nothing" if was is None else f"model {was.name} is not in work any more"
    if was.laid != now.laid:
        return "the photo in the comparator is not known any more"
    # of photos that are to be laid in anew no fiducial is as it was
    inner = "" if now.laying > before.layings else _inner(was, now)
    if inner:
        return inner
    names = _names(was, now)
    if names:
        return names
    planned = [p.point for p in was.plan if p not in now.plan]
    if planned:
        return f"{_listed(planned)} is not in the plan any more"
    switched = _rows(was.off, now.off, "")
    return _measured(was, now) or switched or f"model {now.name} is as it was before"


def _elsewhere(before: SessionState, after: SessionState) -> str:
    """Return what was taken over of rows of accepted models; "" where it was something else."""
    if [m.photos for m in before.models] != [m.photos for m in after.models]:
        return ""
    if (before.returned is None) != (after.returned is None):
        return ""
    changed = [
        (now.name, rows, state)
        for was, now in zip(before.models, after.models, strict=True)
        for rows, state in ((was.off - now.off, "on"), (now.off - was.off, "off"))
        if rows
    ]
    if len(changed) > _FEW:
        many = sum(len(rows) for _, rows, _ in changed)
        models = len({name for name, _, _ in changed})
        states = " or ".join(sorted({state for _, _, state in changed}, reverse=True))
        return f"{many} rows of {models} models {states} again"
    few = sum(len(rows) for _, rows, _ in changed) <= _FEW
    return "; ".join(
        f"{name}: {_named(rows) if few or len(rows) == 1 else f'{len(rows)} rows'} {state} again"
        for name, rows, state in changed
    )


def _inner(was: ModelState, now: ModelState) -> str:
    for old, new in zip(was.inner, now.inner, strict=False):
        if (old.photo, old.side) != (new.photo, new.side) or old == new:
            continue
        if old.accepted is not None and new.accepted is None:
            return f"the inner orientation of {new.name} is in work again"
        return _fiducial(old, new)
    return ""


def _fiducial(old: InnerState, new: InnerState) -> str:
    for name in old.fiducials:
        then, back = old.measurement(name), new.measurement(name)
        if then != back:
            gone = "is not measured any more" if back is None else "is as measured before"
            return f"fiducial {name} of {new.name} {gone}"
    return _rows(old.off, new.off, "fiducial ")


def _measured(was: ModelState, now: ModelState) -> str:
    then = {m.point: (m.xl, m.yl, m.xr, m.yr, m.times) for m in was.measured}
    back = {m.point: (m.xl, m.yl, m.xr, m.yr, m.times) for m in now.measured}
    for sighting in sorted(set(was.seen) ^ set(now.seen), key=lambda s: (s.point, s.side)):
        photo, point = was.photo(sighting.side), sighting.point
        there = any((s.point, s.side) == (point, sighting.side) for s in now.seen)
        left = "is as measured before" if there else "is not measured any more"
        return f"{point} {left} in photo {photo}"
    for point in then:
        if point not in back:
            return f"{point} is not measured any more"
        if then[point] != back[point]:
            return f"{point} is as measured before"
    return ""


def _names(was: ModelState, now: ModelState) -> str:
    """Return what has its former name again; "" where no measurement changed its name."""
    then, back = _by_place(was), _by_place(now)
    if then.keys() != back.keys():
        return ""
    changed = sorted({(back[place], then[place]) for place in then if then[place] != back[place]})
    if not changed:
        return ""
    return ", ".join(f"{other} is {name} again" for name, other in changed)


def _by_place(model: ModelState) -> dict[tuple[str, float, float], str]:
    """Return the names of what was measured, by photo and coordinates."""
    if model.mono:
        return {(s.side, s.x, s.y): s.point for s in model.seen}
    return {
        place: m.point
        for m in model.measured
        for place in (("left", m.xl, m.yl), ("right", m.xr, m.yr))
    }


def _rows(was: frozenset[tuple[str, str]], now: frozenset[tuple[str, str]], kind: str) -> str:
    """Return which rows are on or off again."""
    for rows, state in ((was - now, "on"), (now - was, "off")):
        if rows:
            return f"{kind}{_named(rows)} {state} again"
    return ""


def _named(rows: frozenset[tuple[str, str]]) -> str:
    return _listed([f"{point} {axis}" for point, axis in sorted(rows)])


def _listed(names: list[str]) -> str:
    return ", ".join(names)
