"""The tables of rays, made of columns, say what single rays say."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from math import hypot
from typing import Any

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.externalreliability import ExternalReliability, external_reliability
from anaplot.photogrammetry.block import ImagePoint
from anaplot.report.ascsv import csv_text
from anaplot.report.asjson import json_text
from anaplot.report.astext import table_lines
from anaplot.report.columns import fitted
from anaplot.report.document import plain_value
from anaplot.report.raytables import image_point_table, ray_table


def effects_of(one, found) -> tuple[Any, ...]:
    return (*((None, None) if found is None else (found.effect_m, found.point)), one.effect)


def image_points(
    block: AdjustedBlock, external: ExternalReliability, rejected: dict[int, list[str]] | None
) -> Iterator[tuple[Any, ...]]:
    """Yield the rows for programs, each from its ray: the definition."""
    rays = {
        row.row: (row, effects)
        for row, effects in zip(block.ray_rows(), external.rays, strict=True)
    }
    off, points = block.off_rays(), block.problem.block.image_points
    for k, one in enumerate(points):
        cells: tuple[Any, ...] = (*off.get(k, (None, None)), *(None,) * 14, False)
        if k in rays:
            row, effects = rays[k]
            x, y = row.xy
            cells = (
                x.residual, y.residual, x.r if x.use else None, y.r if y.use else None, x.w, y.w,
                x.mdb, y.mdb, x.ground, y.ground, *effects_of(x, effects[0]),
                *effects_of(y, effects[1]), row.flagged,
            )  # fmt: skip
        if rejected is not None:
            cells = (*cells, k in rejected, rejected.get(k, []))
        if any(other.use != "xy" for other in points):
            cells = (*cells, one.use)
        yield one.photo, one.point, one.model, *cells


def rays(block: AdjustedBlock, external: ExternalReliability) -> Iterator[tuple[Any, ...]]:
    """Yield the rows for people, each from its coordinate: the definition."""
    found = {
        row.row: (row, effects)
        for row, effects in zip(block.ray_rows(), external.rays, strict=True)
    }
    off = block.off_rays()
    for k, ray in enumerate(block.problem.block.image_points):
        if ray.use == "off":
            for axis, v in zip("xy", off.get(k, (None, None)), strict=True):
                yield (ray.photo, ray.point, axis, v, *(None,) * 7, "off")
        if k not in found:
            continue
        row, effects = found[k]
        for one, effect in zip(row.xy, effects, strict=True):
            verdict = "not testable" if one.mdb is None else ""
            if one.flagged:
                verdict = "<< REMEASURE"
            if not one.use:
                verdict = "rejected" if ray.counts(one.axis) else "off"
            yield (
                row.photo, row.point, one.axis, one.residual, one.r if one.use else None, one.w,
                one.mdb, one.ground, *effects_of(one, effect), verdict,
            )  # fmt: skip


CASES = {
    "clean": {},
    "gross errors": {"wrong": {5: 0.2, 20: -0.3}},
    "switched off": {"uses": {3: "off", 7: "x", 8: "y", 30: "off"}, "wrong": {11: 0.2}},
    "two-ray points": {"dropped": 3},
    "nothing looked for": {"most": 0},
    "odd names": {"odd": True, "uses": {0: "off"}},
}


@cache
def adjusted(case: str) -> tuple[AdjustedBlock, ExternalReliability, dict[int, list[str]] | None]:
    asked: dict[str, Any] = CASES[case]
    block = aerial(2, 3, per_base=2, noise_um=5.0, control_sigma=0.05).block
    points: list[ImagePoint] = list(block.image_points)
    for k, error in asked.get("wrong", {}).items():
        points[k] = replace(points[k], x=points[k].x + error)
    for k, use in asked.get("uses", {}).items():
        points[k] = replace(points[k], use=use)
    if asked.get("dropped"):
        count: dict[str, int] = {}
        given = {one.point for one in block.control}
        kept = []
        for one in points:
            count[one.point] = count.get(one.point, 0) + 1
            if one.point in given or count[one.point] < asked["dropped"]:
                kept.append(one)
        # three coordinates of a point with two rays: nothing checks them
        k = next(k for k, one in enumerate(kept) if one.point not in given)
        points = [*kept[:k], replace(kept[k], use="x"), *kept[k + 1 :]]
    if asked.get("odd"):
        names = {one.point: f'%s"{k}\\ \u202e<b>' for k, one in enumerate(points)}
        points = [replace(one, point=names[one.point]) for one in points]
        block = replace(
            block, control=tuple(replace(one, point=names[one.point]) for one in block.control)
        )
    np.random.default_rng(4).shuffle(points)  # rows in no order at all
    block = replace(block, image_points=tuple(points))
    found, rejected = adjust_block(block), None
    if asked.get("wrong"):
        found = block_gross_errors(found, "search").block
        rejected = {}
        for ray, axis in np.argwhere(found.problem.newly_rejected).tolist():
            rejected.setdefault(int(found.problem.source[ray]), []).append("xy"[axis])
        assert rejected
    most = asked.get("most")
    external = (
        external_reliability(found) if most is None else external_reliability(found, most=most)
    )
    return found, external, rejected


@pytest.mark.parametrize("case", CASES)
def test_columns_for_programs_are_those_of_single_rays(case: str) -> None:
    found = image_point_table(*adjusted(case))
    rows = list(image_points(*adjusted(case)))
    keys = [column.key for column in found.columns]
    expected = [dict(zip(keys, map(plain_value, row), strict=True)) for row in rows]
    assert found.records() == expected
    assert json_text({"t": found}) == json.dumps({"t": expected}, indent=1, allow_nan=False)
    whole = replace(found, source=lambda: tuple(zip(*rows, strict=True)))
    assert csv_text(found) == csv_text(whole)


@pytest.mark.parametrize("case", CASES)
def test_columns_for_people_are_those_of_single_coordinates(case: str) -> None:
    block, external, _ = adjusted(case)
    found, rows = ray_table(block, external), list(rays(block, external))
    keys = [column.key for column in found.columns]
    expected = [dict(zip(keys, map(plain_value, row), strict=True)) for row in rows]
    assert found.records() == expected
    assert found.marked() == [k for k, row in enumerate(rows) if row[-1]]
    # the lengths of vectors are written as single numbers are
    own = [fitted(None if v is None else hypot(*v) * 1e3, 2, 12) for v in (row[7] for row in rows)]
    at = table_lines(found)[0].index("EFFECT [mm]") + len("EFFECT [mm]")
    if case != "odd names":  # nobody has put widths into those
        assert [line[at - 12 : at].strip() for line in table_lines(found)[1:]] == own
    else:
        assert all(line.isprintable() for line in table_lines(found))


def test_every_verdict_was_among_them() -> None:
    words = {row[-1] for case in CASES for row in rays(*adjusted(case)[:2])}
    assert words >= {"", "off", "rejected", "not testable"}
