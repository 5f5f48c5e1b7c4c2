"""What persons have switched off in a block's files, and why, as a table."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.report.document import Table, name, number, table

__all__ = ["switched_off_table"]

_COLUMNS = (
    name("kind", "WHAT", 8),
    name("photo", "PHOTO", 5, none=""),
    name("point", "POINT", 5),
    name("model", "MODEL", 5, none=""),
    name("off", "OFF", 3),
    number("vx_um", "vx [um]", 1, 9, unit="um"),
    number("vy_um", "vy [um]", 1, 9, unit="um"),
    name("reason", "REASON", 6, none=""),
)
_AXES = "xy"


def switched_off_table(block: AdjustedBlock) -> Table:
    """Return the rows that are switched off: where they stand, which coordinates, and why.

    Of image points also the residuals that they would have [um], adjusted minus observed. What a
    strategy rejects stands here only where `--apply` has written it.
    """
    return table("off", _COLUMNS, lambda: _rows(block))


def _rows(block: AdjustedBlock) -> Iterator[tuple[Any, ...]]:
    stated = block.problem.block
    yield from _image_points(block)
    for row in stated.control:
        if row.use == "off":
            given = zip("XYZ", row.xyz, strict=True)
            axes = "".join(axis for axis, value in given if value is not None)
            yield "control", None, row.point, None, axes, None, None, None
    for one in stated.conditions:
        if one.use == "off":
            yield one.kind, None, " ".join(one.points), None, "", None, None, None


def _image_points(block: AdjustedBlock) -> Iterator[tuple[Any, ...]]:
    points = block.problem.block.image_points
    off = [(k, points[k]) for k in columns_of(points).with_use("x", "y", "off").tolist()]
    if not off:
        return
    aside = block.off_rays()
    at = {source: ray for ray, source in enumerate(block.problem.source.tolist())}
    for k, row in off:
        axes = "".join(axis for axis in _AXES if not row.counts(axis))
        v: tuple[float | None, float | None] = aside.get(k, (None, None))
        if k in at:
            found = block.tested.rows(np.array([2 * at[k], 2 * at[k] + 1]))
            x, y = (one.residual if one.axis in axes else None for one in found)
            v = x, y
        yield "image", row.photo, row.point, row.model, axes, *v, row.reason
