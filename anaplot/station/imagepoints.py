"""The rows of image_points.csv that a session's accepted models amount to."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from anaplot.photogrammetry.block import ImagePoint
from anaplot.session.state import ModelState

__all__ = ["measured_here", "merged_rows", "rows_of"]

Key = tuple[str, str, float, float]


def rows_of(models: Iterable[ModelState]) -> tuple[ImagePoint, ...]:
    """Return the rows of accepted models: left photo, then right; points switched off left out.

    A point of which only one row is switched off stays: the format knows points, not rows. What
    a model in a mono comparator took over from the one before it was measured once: one row
    serves both models, and names none.
    """
    models = tuple(models)
    once = _measured_once(models)
    written: set[Key] = set()
    out: list[ImagePoint] = []
    for model in models:
        for photo, side in ((model.left, "left"), (model.right, "right")):
            for m in model.used:
                x, y = (m.xl, m.yl) if side == "left" else (m.xr, m.yr)
                key = (photo, m.point, x, y)
                if key in written:
                    continue
                shared = key in once
                if shared:
                    written.add(key)
                out.append(ImagePoint(photo, m.point, x, y, model=None if shared else model.name))
    return tuple(out)


def _measured_once(models: tuple[ModelState, ...]) -> set[Key]:
    """Return the measurements that two models share."""
    right = {
        (model.strip, model.right): {(model.right, m.point, m.xr, m.yr) for m in model.used}
        for model in models
    }
    out: set[Key] = set()
    for model in models:
        if model.mono:
            left = {(model.left, m.point, m.xl, m.yl) for m in model.used}
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


def merged_rows(
    existing: Iterable[ImagePoint], models: Iterable[ModelState], of_session: Collection[str]
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
        file are the session's own and are replaced.
    """
    models = tuple(models)
    own = measured_here(models)
    kept = tuple(
        row
        for row in existing
        if (row.model is None or row.model not in of_session)
        and (row.model is not None or (row.photo, row.point, row.x, row.y) not in own)
    )
    return kept + rows_of(models)
