"""Points by which photographs that were laid in anew are checked: where they were is on record."""

from __future__ import annotations

from itertools import combinations
from math import dist

from anaplot.aliases import Side
from anaplot.session.models import solved_or_none
from anaplot.session.modelstate import ModelState
from anaplot.session.plates import ReadOut
from anaplot.session.state import SessionState

__all__ = ["check_points", "gaps", "points_due"]

_COUNT = 2


def _unoriented(model: ModelState) -> tuple[Side, ...]:
    """Return the photos that lie there and have no fiducials: nothing says how they lie."""
    return tuple(side for side in model.carriages if model.inner_of(side) is None)


def points_due(state: SessionState) -> tuple[str, ...]:
    """Return the `check_points` of a model whose photos lie anew, or are to: else none.

    In a mono comparator every photo that is laid in is checked then.
    """
    model = state.current
    return () if model is None or model.laying <= state.layings else check_points(state)


def check_points(state: SessionState) -> tuple[str, ...]:
    """Return the points by which the photos of the current model are checked, at most two.

    Well determined ones, far apart: measured, in no model of the strip flagged or switched off,
    not the one that is to be measured again; of these the half with the larger sums of redundancy
    numbers. None where every photo that lies there has fiducials, or nothing is measured.
    """
    model = state.current
    if model is None or not (sides := _unoriented(model)):
        return ()
    again = None if state.returned is None else state.returned.point
    known = {m.point for m in model.used}
    if model.mono:
        known = {s.point for s in model.seen if s.side in sides and not model.is_off(s.point)}
    known -= {again}
    doubted, checked = _standing(state, model)
    sound = known - doubted
    if len(sound) < _COUNT:
        sound = known
    order = sorted(sound, key=lambda point: (-checked.get(point, 0.0), point))
    best = order[: max(len(order) // 2, _COUNT)]
    if len(best) <= _COUNT:
        return tuple(best)
    places = {point: model.place_of(sides[0], point) or (0.0, 0.0) for point in best}
    return max(combinations(best, _COUNT), key=lambda pair: dist(*(places[p] for p in pair)))


def _standing(state: SessionState, model: ModelState) -> tuple[set[str], dict[str, float]]:
    """Return the points of which a row is flagged or off, and sums of redundancy numbers."""
    parked = None if state.returned is None else state.returned.parked
    shown = {m.photos: m for m in (*state.models, *((parked,) if parked else ()), model)}
    doubted: set[str] = set()
    checked: dict[str, float] = {}
    for one in shown.values():
        if one.strip != model.strip or not set(one.photos) & set(model.photos):
            continue
        doubted |= {point for point, _ in one.off}
        solution = solved_or_none(state, one)
        for row in () if solution is None else solution.table:
            checked[row.point] = checked.get(row.point, 0.0) + (row.r or 0.0)
            if row.flagged:
                doubted.add(row.point)
    return doubted, checked


def gaps(model: ModelState, point: str, here: ReadOut) -> dict[Side, float]:
    """Return how far a point was found from where it is on record [mm], by photo.

    On the axis where it is most; only of photos that lie there and have no fiducials.
    """
    out: dict[Side, float] = {}
    read: dict[Side, tuple[float, float]] = {
        "left": (here.xl, here.yl),
        "right": (here.xr, here.yr),
    }
    for side in _unoriented(model):
        was = model.place_of(side, point)
        if was is not None:
            out[side] = max(abs(a - b) for a, b in zip(read[side], was, strict=True))
    return out
