"""The rows of image_points.csv that a session's accepted models amount to."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from anaplot.photogrammetry.block import ImagePoint
from anaplot.session.state import ModelState

__all__ = ["merged_rows", "rows_of"]


def rows_of(models: Iterable[ModelState]) -> tuple[ImagePoint, ...]:
    """Return the rows of accepted models: left photo, then right; points switched off left out.

    A point of which only one row is switched off stays: the format knows points, not rows.
    """
    out: list[ImagePoint] = []
    for model in models:
        used = model.used
        out += [ImagePoint(model.left, m.point, m.xl, m.yl, model=model.name) for m in used]
        out += [ImagePoint(model.right, m.point, m.xr, m.yr, model=model.name) for m in used]
    return tuple(out)


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
    kept = tuple(row for row in existing if row.model is None or row.model not in of_session)
    return kept + rows_of(models)
