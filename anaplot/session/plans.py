"""Which points a station has measured in a model, and where the plates go for them."""

from __future__ import annotations

from anaplot.orientation.patterns import Pattern
from anaplot.photogrammetry.readings import Position
from anaplot.planning.modelplan import Candidates, plan_positions, predicted_right
from anaplot.session.events import PlannedPoint, Role
from anaplot.session.modelstate import ModelState
from anaplot.session.plates import ReadOut, plate_of, plates_of
from anaplot.session.state import SessionState

__all__ = ["added_point", "plan_of", "point_target"]

_ENOUGH = 5  # known points common to both photos that make a plan


def plan_of(
    state: SessionState,
    pattern: Pattern,
    candidates: Candidates | None,
    strip: str,
    left: str,
    right: str,
) -> tuple[PlannedPoint, ...]:
    """Return the points to measure in a model: ties first, then new ones.

    Parameters
    ----------
    state
        Before the model is chosen.
    pattern
        The point pattern.
    candidates
        Approximate image coordinates of known points by photo, or None.
    strip, left, right
        Names.
    """
    before = state.preceding(strip, left)
    measured = () if before is None else before.used
    nominal = next(s for s in state.block.strips if s.id == strip).base
    if measured:
        parallax = sorted(m.xl - m.xr for m in measured)
        nominal = parallax[len(parallax) // 2]
    if candidates is not None:
        common = candidates.get(left, {}).keys() & candidates.get(right, {}).keys()
        candidates = candidates if len(common) >= _ENOUGH else None
    positions = plan_positions(
        state.block,
        (left, right),
        pattern,
        nominal_base=nominal,
        preceding={m.point: (m.xr, m.yr) for m in measured},
        candidates=candidates,
        avoid={p.point for m in state.models for p in m.plan},
    )
    ties = {m.point for m in measured}
    return tuple(
        PlannedPoint(p.point, "tie" if p.point in ties else "new", *p[1:]) for p in positions
    )


def point_target(state: SessionState, planned: PlannedPoint, *, known: bool) -> Position:
    """Return where the plates go for a point of the current model [mm].

    Parameters
    ----------
    state
        The session's state.
    planned
        The point.
    known
        Whether its place in the right photo is known; else it is predicted from those measured.
    """
    xr, yr = planned.xr, planned.yr
    model = state.current
    if not known and model is not None:
        seen = [(m.xl, m.yl, m.xr, m.yr) for m in model.used if m.point != planned.point]
        xr, yr = predicted_right(seen, planned.xl, planned.yl) or (xr, yr)
    place = (planned.xl, planned.yl, xr, yr)
    if model is not None and model.mono:
        one = place[2:] if model.laid == "right" else place[:2]
        place = (*one, *one)
    return plate_of(*place, plates_of(state))


def added_point(state: SessionState, model: ModelState, name: str, here: ReadOut) -> PlannedPoint:
    """Return a point beyond the plan, where the plates stand.

    In a mono comparator its place in the other photo follows from the points measured in both.
    """
    before = state.preceding(model.strip, model.left)
    known = before is not None and any(m.point == name for m in before.used)
    role: Role = "tie" if known else "new"
    if not model.mono:
        return PlannedPoint(name, role, here.xl, here.yl, here.xr, here.yr)
    right = model.laid == "right"
    both = [(m.xl, m.yl, m.xr, m.yr) for m in model.used]
    pairs = [(m[2], m[3], m[0], m[1]) if right else m for m in both]
    other = predicted_right(pairs, here.xl, here.yl)
    if other is None:
        parallax = sorted(p.xl - p.xr for p in model.plan)
        base = parallax[len(parallax) // 2] if parallax else 0.0
        other = (here.xl + base if right else here.xl - base, here.yl)
    if right:
        return PlannedPoint(name, role, *other, here.xl, here.yl)
    return PlannedPoint(name, role, here.xl, here.yl, *other)
