"""Which points are measured in a model."""

from __future__ import annotations

from anaplot.orientation.ownpattern import PointPattern
from anaplot.planning.modelplan import Candidates, plan_positions
from anaplot.session.events import PlannedPoint
from anaplot.session.state import SessionState

__all__ = ["plan_of"]

_ENOUGH = 5  # known points common to both photos that make a plan


def plan_of(
    state: SessionState,
    pattern: PointPattern,
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
