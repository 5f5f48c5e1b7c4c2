"""The models of a block as its image points have them, as a session would have accepted them."""

from __future__ import annotations

from collections.abc import Mapping

from anaplot.aliases import Axis
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.selection import (
    measured_once,
    model_name,
    points_of,
    rows_by_photo,
    rows_off,
)
from anaplot.session.events import PlannedPoint
from anaplot.session.modelstate import Measured, ModelState

__all__ = ["filed_models"]


def filed_models(block: Block) -> tuple[ModelState, ...]:
    """Return the models that have points common to both photos, strip by strip.

    Parameters
    ----------
    block
        With its image points; those of a model are chosen as the bridge chooses them.
    """
    rows = rows_by_photo(block.image_points if block.strips else ())
    out: list[ModelState] = []
    for strip in block.strips:
        before: ModelState | None = None
        shared: Mapping[str, ImagePoint] = {}
        for photos in strip.models():
            left, right = (points_of(rows.get(p, ()), p, model_name(*photos)) for p in photos)
            model = _model(strip.id, photos, left, right, before, measured_once(shared, left))
            before, shared = model, right
            if model is not None:
                out.append(model)
    return tuple(out)


def _model(
    strip: str,
    photos: tuple[str, str],
    left: Mapping[str, ImagePoint],
    right: Mapping[str, ImagePoint],
    before: ModelState | None,
    once: frozenset[str],
) -> ModelState | None:
    ties = set() if before is None else {m.point for m in before.used}
    measured = tuple(
        Measured(name, one.x, one.y, right[name].x, right[name].y, 1)
        for name, one in left.items()
        if name in right
    )
    if not measured:
        return None
    plan = tuple(
        PlannedPoint(m.point, "tie" if m.point in ties else "new", m.xl, m.yl, m.xr, m.yr)
        for m in measured
    )
    switched = rows_off(left, right)
    axes: tuple[Axis, ...] = ("y", "x")
    off = frozenset(
        (p.point, axis)
        for p in plan
        for axis in axes[: 1 + (p.role == "tie")]
        if (p.point, axis) in switched
    )
    return ModelState(strip, *photos, plan, measured, off, mono=bool(once))
