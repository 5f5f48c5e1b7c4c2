"""The tables of an adjusted block's rays, declared once for JSON, CSV and text.

A block has them by the million: programs read whole columns, people see few rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.externalreliability import ExternalReliability
from anaplot.photogrammetry.imagepoint import use_counts
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.report.adjusttables import EFFECT, XYZ, vector
from anaplot.report.document import (
    Later,
    Table,
    Values,
    for_programs,
    is_array,
    name,
    number,
    vectors,
)

__all__ = ["image_point_table", "ray_table"]


_IMAGE_POINTS = (
    *for_programs("photo", "point", "model"),
    *for_programs("vx_um", "vy_um", unit="um"),
    *for_programs("rx", "ry", "wx", "wy"),
    *for_programs("mdb_x_um", "mdb_y_um", unit="um"),
    *for_programs("effect_x", "effect_y", unit="m", parts=XYZ),
    *for_programs("largest_effect_x", unit="m", parts=XYZ),
    *for_programs("largest_effect_at_x", "standardized_effect_x"),
    *for_programs("largest_effect_y", unit="m", parts=XYZ),
    *for_programs("largest_effect_at_y", "standardized_effect_y", "flagged"),
)


def image_point_table(
    block: AdjustedBlock,
    external: ExternalReliability,
    rejected: dict[int, list[str]] | None = None,
) -> Table:
    """Return the image points of the file, for programs; one that takes no part has no numbers.

    Where some are switched off, every one says which of its coordinates count.

    Parameters
    ----------
    block, external
        The block, and what its undetected errors do.
    rejected
        Axes that are rejected, by row of the file; None: none are looked for.
    """
    columns = _IMAGE_POINTS
    if rejected is not None:
        columns = (*columns, *for_programs("rejected", "rejected_axes"))
    if _any_off(block):
        columns = (*columns, *for_programs("use"))
    return Table("image_points", columns, lambda: _image_points(block, external, rejected))


def _any_off(block: AdjustedBlock) -> bool:
    return any(use != "xy" for use in columns_of(block.problem.block.image_points).use.values)


def _image_points(
    block: AdjustedBlock, external: ExternalReliability, rejected: dict[int, list[str]] | None
) -> tuple[Values, ...]:
    """Return the columns of `_IMAGE_POINTS` and what follows them, a row for each of the file."""
    points = columns_of(block.problem.block.image_points)
    n = len(points)
    order = np.argsort(block.problem.source)
    found, rays = _of_rays(block, external, order), block.problem.source[order]
    residual = np.full((n, 2), np.nan)
    off = block.off_rays()
    residual[list(off)] = np.array(list(off.values())).reshape(-1, 2)
    residual[rays] = found.residual

    def spread(values: Array) -> Array:
        whole = np.full((n, *values.shape[1:]), np.nan)
        whole[rays] = values
        return whole

    def placed(values: list[Any]) -> list[Any]:
        whole: list[Any] = [None] * n
        for k, value in zip(rays.tolist(), values, strict=True):
            whole[k] = value
        return whole

    flagged = np.zeros(n, dtype=bool)
    flagged[rays] = found.flagged.any(axis=1)
    columns: list[Values] = [
        points.photo.listed(),
        points.point.listed(),
        points.model.listed(),
        *residual.T,
        *spread(found.r).T,
        *spread(found.w).T,
        *spread(found.mdb).T,
        *(spread(found.ground[:, axis]) for axis in range(2)),
    ]
    for axis in range(2):
        columns += [
            placed(found.moved[axis]),
            placed(found.at[axis]),
            spread(found.effect[:, axis]),
        ]
    columns.append(flagged)
    if rejected is not None:
        columns.append([k in rejected for k in range(n)])
        columns.append([rejected.get(k, []) for k in range(n)])
    if _any_off(block):
        columns.append(points.use.listed())
    return tuple(columns)


class _OfRays(NamedTuple):
    """What is known of m rays that take part, in the order of the file.

    Attributes
    ----------
    residual, r, w, mdb, effect
        (m, 2) of x and y; NaN where it does not exist, r also where the coordinate does not count.
    ground
        (m, 2, 3) what an undetected error does to the ray's point [m].
    flagged, use
        (m, 2) which coordinates are flagged, and which count.
    moved, at
        Of x and of y: largest effects on a point [m], and which points these are; None where there
        is none.
    """

    residual: Array
    r: Array
    w: Array
    mdb: Array
    effect: Array
    ground: Array
    flagged: Bools
    use: Bools
    moved: tuple[list[Any], list[Any]]
    at: tuple[list[Any], list[Any]]


def _of_rays(
    block: AdjustedBlock,
    external: ExternalReliability,
    order: Index,
    at: Sequence[int] | None = None,
) -> _OfRays:
    """Return what is known of some rays.

    `order`, `at`: which rays of the bundle they are, and of those in the order of the file; None:
    all of them.
    """
    tested, count = block.tested, 2 * len(block.problem.source)

    def of(values: NDArray[Any]) -> NDArray[Any]:
        taken: NDArray[Any] = values[:count].reshape(-1, 2, *values.shape[1:])[order]
        return taken

    def known(values: Array) -> Array:
        taken = of(values)
        return np.where(np.isfinite(taken), taken, np.nan)

    use = of(tested.use)
    ground = np.full((count, 3), np.nan) if tested.ground is None else tested.ground
    x: list[Any] = [None] * len(order)
    y = at_x = at_y = x
    if external.looked:
        pairs = external.rays if at is None else external.rays_at(at)
        effects = [[pair[axis] for pair in pairs] for axis in range(2)]
        x, y = ([None if one is None else one.effect_m for one in each] for each in effects)
        at_x, at_y = ([None if one is None else one.point for one in each] for each in effects)
    return _OfRays(
        of(tested.residual),
        np.where(use, of(tested.r), np.nan),
        known(tested.w),
        known(tested.mdb),
        known(tested.effect),
        of(ground),
        of(tested.flagged),
        use,
        (x, y),
        (at_x, at_y),
    )


_RAYS = (
    name("photo", "PHOTO", 5),
    name("point", "POINT", 5, gap=1),
    name("axis"),
    number("v_um", "v [um]", 1, 9, unit="um"),
    number("r", "RED-N", 3, 8),
    number("w", "w", 2, 8),
    number("mdb_um", "MDB [um]", 1, 10, unit="um"),
    vector("effect", "EFFECT [mm]", 13),
    *EFFECT,
    name("verdict", look=bool),
)


def ray_table(block: AdjustedBlock, external: ExternalReliability) -> Table:
    """Return the image coordinates that take part or are switched off, for people: a row each."""
    return Table("rays", _RAYS, lambda: _rays(block, external))


_WORDS = np.array(("", "not testable", "<< REMEASURE", "rejected", "off"), dtype=object)
_NOT_TESTABLE, _REMEASURE, _REJECTED_WORD, _OFF_WORD = range(1, 5)


def _rays(block: AdjustedBlock, external: ExternalReliability) -> tuple[Values, ...]:
    """Return the columns of `_RAYS`, two rows for each ray that takes part or is switched off.

    They are made where they are read, all at once, as people see few of them; but for the last one,
    which says of which rows.
    """
    points, source = columns_of(block.problem.block.image_points), block.problem.source
    ray = np.full(len(points), -1)
    ray[source] = np.arange(len(source))
    takes_part = ray >= 0
    number = np.cumsum(takes_part) - 1
    takes_part[points.with_use("off")] = True
    rows = np.flatnonzero(takes_part)
    residuals = block.off_rays()

    @lru_cache(1)
    def columns(pairs: tuple[int, ...]) -> tuple[Values, ...]:
        some = rows[list(pairs)]
        mine = some[ray[some] >= 0]
        found = _of_rays(block, external, ray[mine], number[mine].tolist())
        return _some_rays(block, found, some, ray[some] >= 0, residuals)

    def column(k: int) -> Later[Any]:
        def values(chosen: Sequence[int]) -> list[Any]:
            at = np.asarray(chosen, dtype=np.intp)
            pairs, place = np.unique(at // 2, return_inverse=True)
            each, mine = columns(tuple(pairs.tolist()))[k], 2 * place + at % 2
            if not is_array(each):
                return [each[j] for j in mine.tolist()]
            return vectors(each[mine]) if each.ndim > 1 else each[mine].tolist()

        return Later(2 * len(rows), values)

    return (*map(column, range(len(_RAYS) - 1)), _verdicts(block, rows, ray[rows]))


def _some_rays(
    block: AdjustedBlock,
    found: _OfRays,
    rows: Index,
    takes_part: Bools,
    residuals: dict[int, tuple[float, float]],
) -> tuple[Values, ...]:
    """Return the columns of `_RAYS` but the last, of some rows of the file.

    Parameters
    ----------
    block
        The block.
    found
        What is known of those that take part.
    rows, takes_part
        (k,) which rows, and whether they do.
    residuals
        Of what is switched off, by its row [um].
    """
    points = columns_of(block.problem.block.image_points)
    off = rows[~takes_part].tolist()
    nothing = (math.nan, math.nan)
    aside = np.array([residuals.get(k, nothing) for k in off]).reshape(-1, 2)

    def woven(values: Array, others: Array | None = None) -> Array:
        """Return (2 k, ...) values of x and y, ray by ray."""
        whole = np.full((len(rows), *values.shape[1:]), np.nan)
        whole[takes_part] = values
        if others is not None:
            whole[~takes_part] = others
        return whole.reshape(-1, *values.shape[2:])

    def placed(xy: Sequence[Sequence[Any]]) -> list[Any]:
        pairs = iter(zip(*xy, strict=True))
        every = (next(pairs) if part else (None, None) for part in takes_part.tolist())
        return list(chain.from_iterable(every))

    def doubled(names: list[str]) -> list[str]:
        return list(chain.from_iterable(zip(names, names, strict=True)))

    return (
        doubled(points.photo.listed(rows)),
        doubled(points.point.listed(rows)),
        ["x", "y"] * len(rows),
        woven(found.residual, aside),
        woven(found.r),
        woven(found.w),
        woven(found.mdb),
        woven(found.ground),
        placed(found.moved),
        placed(found.at),
        woven(found.effect),
    )


def _verdicts(block: AdjustedBlock, rows: Index, ray: Index) -> list[str]:
    """Return what is said of x and y of some rows of the file.

    `ray`: (k,) which of the bundle's rays they are; -1: switched off.
    """
    points, tested = columns_of(block.problem.block.image_points), block.tested
    there, count = ray >= 0, 2 * len(block.problem.source)

    def of(values: Bools) -> Bools:
        taken: Bools = values[:count].reshape(-1, 2)[ray[there]]
        return taken

    uses = np.array([[use_counts(use, axis) for axis in "xy"] for use in points.use.values])
    counts = uses[points.use.index[rows[there]]]
    code = np.full((len(rows), 2), _OFF_WORD)
    code[there] = np.select(
        (
            ~of(tested.use) & counts,
            ~of(tested.use),
            of(tested.flagged),
            ~of(np.isfinite(tested.mdb)),
        ),
        (_REJECTED_WORD, _OFF_WORD, _REMEASURE, _NOT_TESTABLE),
    )
    words: list[str] = _WORDS[code.ravel()].tolist()
    return words
