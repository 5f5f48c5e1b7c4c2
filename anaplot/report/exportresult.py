"""A block adjusted for formats that have a place for orientations, points and their precision."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from anaplot.aliases import Progress
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.controlpages import ControlPage, ControlPart, control_pages
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.externalreliability import external_reliability
from anaplot.bundle.solve.problem import Datum
from anaplot.exchange.formats.door import (
    AdjustedResult,
    ControlResult,
    PhotoResult,
    PointResult,
    ResultColumn,
    ResultTable,
)
from anaplot.photogrammetry.block import Block
from anaplot.report.adjusttables import (
    check_table,
    control_table,
    photo_table,
    point_table,
)
from anaplot.report.document import Table, plain_values
from anaplot.report.raytables import image_point_table
from anaplot.station.coverage import is_held

__all__ = ["adjusted_result"]


def adjusted_result(block: Block, progress: Progress | None = None) -> AdjustedResult:
    """Adjust a block as `adjust` does: on what holds it, without any as a free network.

    Parameters
    ----------
    block
        The block.
    progress
        Is told what is being done.

    Raises
    ------
    NotComputableError
        As `adjust_block`.
    """
    datum: Datum = "control" if is_held(block) else "free"
    adjusted = adjust_block(block, datum=datum, progress=progress)
    problem, cofactors = adjusted.problem, adjusted.cofactors
    counts = np.ones((len(problem.photo), 2), dtype=bool)
    if problem.rejected is not None:
        counts &= ~problem.rejected
    r = np.where(counts, cofactors.r, 0.0).sum(axis=1)
    flagged = np.zeros(len(problem.photo), dtype=np.intp)
    where = {int(row): k for k, row in enumerate(problem.source)}
    for ray in adjusted.ray_rows():
        flagged[where[ray.row]] = sum(one.flagged for one in ray.xy)

    def summed(group: np.ndarray, count: int) -> list[tuple[int, float | None, int]]:
        rays = np.bincount(group, counts.any(axis=1), count)
        coordinates = np.bincount(group, counts.sum(axis=1), count)
        numbers = np.bincount(group, r, count)
        look = np.bincount(group, flagged, count)
        return [
            (int(n), float(s / m) if m else None, int(f))
            for n, m, s, f in zip(rays, coordinates, numbers, look, strict=True)
        ]

    sigma = 1.0 if adjusted.sigma is None else adjusted.sigma
    of_photo = dict(zip(problem.photos, summed(problem.photo, len(problem.photos)), strict=True))
    of_point = dict(zip(problem.points, summed(problem.point, len(problem.points)), strict=True))
    covariance = dict(zip(problem.points, cofactors.points * sigma**2, strict=True))
    uses = {row.point: row.use for row in block.control if row.use != "off"}
    return AdjustedResult(
        tuple(
            PhotoResult(
                row.photo,
                row.position,
                row.s_position,
                row.angles,
                row.s_angles,
                *of_photo[row.photo],
            )
            for row in adjusted.photo_rows()
        ),
        tuple(
            PointResult(
                row.point,
                row.xyz,
                tuple(map(tuple, covariance[row.point].tolist())),
                *of_point[row.point],
                uses.get(row.point, "tie"),
            )
            for row in adjusted.point_rows()
        ),
        adjusted.sigma0,
        tuple(map(_control_result, control_pages(adjusted))),
        partial(_tables, adjusted),
    )


def _tables(adjusted: AdjustedBlock) -> tuple[ResultTable, ...]:
    """Return the tables that `adjust --to` writes."""
    external = external_reliability(adjusted)
    tables = (
        photo_table(adjusted),
        point_table(adjusted),
        image_point_table(adjusted, external),
        control_table(adjusted, external),
        check_table(adjusted),
    )
    return tuple(
        ResultTable(table.key, tuple(_columns(table)))
        for table in tables
        if len(table) or table.key in ("photos", "points", "image_points")
    )


def _columns(table: Table) -> Iterator[ResultColumn]:
    units = {column.key: column.unit for column, _ in table.for_programs()}
    units |= {
        f"{column.key}_{part}": column.unit
        for column, _ in table.for_programs()
        for part in column.parts
    }
    for name, values in table.components():
        yield ResultColumn(name, units[name], tuple(plain_values(values)))


def _control_result(page: ControlPage) -> ControlResult:
    def r(part: ControlPart | None) -> float | None:
        return None if part is None else part.r

    use = "check" if page.use == "check" else "control"
    return ControlResult(page.point, use, r(page.plan), r(page.height), page.verdict)
