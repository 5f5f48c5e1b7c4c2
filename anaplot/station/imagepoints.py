"""The rows of image_points.csv that a session's accepted models amount to."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace

from anaplot.exchange.rejectedrows import STRATEGIES, rejecting_reason, rejects
from anaplot.photogrammetry.block import ImagePoint, Use
from anaplot.photogrammetry.measuredimage import computed_place
from anaplot.session.events import Event, ModelAccepted
from anaplot.session.reasons import REASONS, RowReason, reason_of
from anaplot.session.state import ModelState
from anaplot.station.rejectedelsewhere import agreeing

__all__ = ["Key", "accepted_ever", "measured_here", "measured_once", "merged_rows", "rows_of"]

Key = tuple[str, str, float, float]
"""Photo and point, x and y [mm]."""


def rows_of(
    models: Iterable[ModelState], reasons: Collection[RowReason] = ()
) -> tuple[ImagePoint, ...]:
    """Return the rows of accepted models: left photo, then right.

    Which of a point's rows count is the use of its right ray, and beside it stands why, of
    `reasons`; the left one serves as it is. What a model in a mono comparator took over from the
    one before it was measured once: one row serves both models, and names none, unless the point
    is switched off altogether in the one before it.
    """
    models = tuple(models)
    # written with the later model: the order of its points is that of the left photo's rows
    once = measured_once(models)
    said: dict[tuple[str, str], list[RowReason]] = {}
    for reason in reasons:
        said.setdefault((reason.model, reason.point), []).append(reason)
    uses: dict[Key, tuple[Use, str | None]] = {}
    out: list[ImagePoint] = []
    for model in models:
        if not once and not model.off:
            # as most are: every coordinate counts, so that there is no reason to be told
            lefts = [(model.left, m.point, m.xl, m.yl) for m in model.measured]
            rights = [(model.right, m.point, m.xr, m.yr) for m in model.measured]
            out += [ImagePoint(*place, model=model.name) for place in lefts + rights]
            continue
        for photo, side in ((model.left, "left"), (model.right, "right")):
            for m in model.measured:
                x, y = (m.xl, m.yl) if side == "left" else (m.xr, m.yr)
                key = (photo, m.point, x, y)
                use: Use
                use, why = uses.get(key, ("xy", None))
                if side == "right":
                    use = _use(model, m.point)
                    why = _why(said.get((model.name, m.point), ()), model, m.point)
                shared = key in once
                if shared and side == "right":
                    uses[key] = use, why
                else:
                    of = None if shared else model.name
                    out.append(ImagePoint(photo, m.point, x, y, model=of, use=use, reason=why))
    return tuple(out)


def _use(model: ModelState, point: str) -> Use:
    """Return which coordinates of a point's right ray count: x without a row of its own does."""
    x, y = ((point, axis) not in model.off for axis in ("x", "y"))
    if x and y:
        return "xy"
    return "off" if model.is_off(point) else "x" if x else "y"


def _why(mine: Collection[RowReason], model: ModelState, point: str) -> str | None:
    """Return why rows of a point are off: what an operator said of them, then the strategies."""
    if not mine:
        return None
    rejected = [r for r in mine if r.reason in STRATEGIES and (point, r.axis) in model.off]
    why = reason_of([r for r in mine if r not in rejected], model, point)
    for strategy in STRATEGIES:
        gone = {(point, r.axis) for r in rejected if r.reason == strategy}
        if gone:
            before = replace(model, off=model.off - {(point, r.axis) for r in rejected})
            why = rejecting_reason(strategy, _use(before, point), why)
            rejected = [r for r in rejected if r.reason != strategy]
    return why


def measured_once(models: Collection[ModelState]) -> set[Key]:
    """Return the measurements that two models share, and that count in the first.

    Each has one row, which names no model.
    """
    if not any(model.mono for model in models):
        return set()
    right = {
        (model.strip, model.right): {(model.right, m.point, m.xr, m.yr) for m in model.used}
        for model in models
    }
    out: set[Key] = set()
    for model in models:
        if model.mono:
            left = {(model.left, m.point, m.xl, m.yl) for m in model.measured}
            out |= left & right.get((model.strip, model.left), set())
    return out


def measured_here(models: Iterable[ModelState]) -> set[Key]:
    """Return (photo, point, x, y) of everything measured in models."""
    return {
        key
        for model in models
        for m in model.measured
        for key in ((model.left, m.point, m.xl, m.yl), (model.right, m.point, m.xr, m.yr))
    }


def accepted_ever(events: Iterable[Event]) -> set[str]:
    """Return the names "left/right" of models that were accepted once, undone or not."""
    return {f"{event.left}/{event.right}" for event in events if isinstance(event, ModelAccepted)}


def merged_rows(
    existing: Iterable[ImagePoint],
    models: Iterable[ModelState],
    of_session: Collection[str],
    reasons: Collection[RowReason] = (),
    once: Collection[Key] = (),
) -> tuple[ImagePoint, ...]:
    """Return rows from elsewhere as they are, followed by the session's own.

    Parameters
    ----------
    existing
        Rows found in the file.
    models
        Accepted models.
    of_session
        Names "left/right" of every model that the session has ever accepted: their rows in the
        file are the session's own and are replaced. One with a reason of its own words was
        switched by a person outside the session: what he decided stays as long as the measurement
        does; so does what a strategy rejected, as long as the session says the same.
    reasons
        Why rows are switched off.
    once
        Measurements that two models of the session shared at any time: their rows, which name no
        model, are its own as well.
    """
    existing = tuple(existing)
    models = tuple(models)
    own = measured_here(models).union(once)
    kept = tuple(
        row
        for row in existing
        if (row.model is None or row.model not in of_session)
        and (row.model is not None or (row.photo, row.point, *computed_place(row)) not in own)
    )
    agreed = agreeing(existing, models)
    decided = {
        _key(row): row
        for row in existing
        if (row.photo, row.point, row.model) in agreed
        or not (_of_session(row.reason) or rejects(row))
    }
    return kept + tuple(
        replace(row, use=said.use, reason=said.reason) if (said := decided.get(_key(row))) else row
        for row in rows_of(models, reasons)
    )


def _of_session(reason: str | None) -> bool:
    """Whether a reason is one that a session gives, or none."""
    return reason is None or set(reason.split(", ")) <= set(REASONS)


def _key(row: ImagePoint) -> tuple[str, str, str | None, float, float]:
    return row.photo, row.point, row.model, *computed_place(row)
