"""Coordinates that a person switched off are no observations, and show what they are off."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bundleblocks import Scene, aerial

from anaplot.adjustment.strategies import STRATEGIES
from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.live import LiveBlock
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.block import Block, Use
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.report.adjustdocument import adjust_document


def used(block: Block, uses: dict[int, Use]) -> Block:
    rows = (replace(row, use=uses.get(k, "xy")) for k, row in enumerate(block.image_points))
    return replace(block, image_points=tuple(rows))


def points(adjusted: AdjustedBlock) -> dict[str, tuple[float, float, float]]:
    return {row.point: row.xyz for row in adjusted.point_rows()}


def assert_same(one: AdjustedBlock, other: AdjustedBlock, within: float) -> None:
    there = points(other)
    assert set(there) == set(points(one))
    for name, xyz in points(one).items():
        assert xyz == pytest.approx(there[name], abs=within)


def well_seen(block: Block) -> list[int]:
    """Return the rows of points with four rays and more that are no control."""
    count = Counter(row.point for row in block.image_points)
    control = {row.point for row in block.control}
    rows = enumerate(block.image_points)
    return [k for k, row in rows if count[row.point] > 3 and row.point not in control]


@cache
def scene() -> Scene:
    return aerial(2, 3, per_base=2, noise_um=5.0, control_sigma=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_x_off_is_x_of_no_weight(seed: int) -> None:
    block = scene().block
    rng = np.random.default_rng(seed)
    rows = rng.choice(len(block.image_points), 5, replace=False).tolist()
    axes = rng.integers(0, 2, 5).tolist()
    off = adjust_block(used(block, {k: "yx"[a] for k, a in zip(rows, axes, strict=True)}))  # type: ignore[misc]
    problem = make_problem(block)
    factor = np.ones((len(problem.photo), 2))
    for k, a in zip(rows, axes, strict=True):
        factor[np.flatnonzero(problem.source == k), a] = 1e9 / 5.0
    weak = adjust_bundle(replace(problem, axis_factor=factor), adjust_block(block).state)
    there = points(weak)
    for name, xyz in points(off).items():
        assert xyz == pytest.approx(there[name], abs=1e-6)
    assert off.redundancy == weak.redundancy - 5
    assert off.vtpv == pytest.approx(weak.vtpv, rel=1e-6)
    # what is left out is off by the same
    ours = {row.row: row for row in off.ray_rows()}
    # what is known to a tenth of its distance (1000 m) only is left out
    vague = {row.point for row in weak.point_rows() if max(row.s_xyz) > 100.0}
    assert vague == {one.name for one in off.problem.left_out}
    for row in weak.ray_rows():
        if row.point in vague:
            continue
        for mine, its in zip(ours[row.row].xy, row.xy, strict=True):
            assert mine.residual == pytest.approx(its.residual, abs=1e-3)


def test_the_mean_redundancy_number_is_that_of_all_coordinates_that_count() -> None:
    # means of x and of y have unequal weights where rays count with one coordinate
    found = adjust_block(used(scene().block, dict.fromkeys(range(0, 40, 3), "x")))
    r, counts = found.cofactors.r, ~found.rejected
    ri = found.indicators()
    assert counts[:, 0].sum() > counts[:, 1].sum()
    assert (ri.ri_x, ri.ri_y) == pytest.approx([r[counts[:, k], k].mean() for k in (0, 1)])
    assert ri.ri == pytest.approx(r[counts].mean())
    assert ri.ri != pytest.approx((ri.ri_x + ri.ri_y) / 2.0, rel=1e-6)


@pytest.mark.parametrize("parameters", [None, "gruen", "physical"])
def test_a_ray_off_is_a_ray_that_is_not_there(parameters: str | None) -> None:
    block = scene().block
    additional = None if parameters is None else additional_parameters(parameters, 10.0)
    gone = {7, 30}
    off = adjust_block(used(block, dict.fromkeys(gone, "off")), additional=additional)
    rows = tuple(row for k, row in enumerate(block.image_points) if k not in gone)
    less = adjust_block(replace(block, image_points=rows), additional=additional)
    assert_same(off, less, 1e-9)
    assert (off.redundancy, off.sigma0) == (less.redundancy, pytest.approx(less.sigma0, rel=1e-12))
    assert off.indicators() == pytest.approx(less.indicators(), rel=1e-9)
    assert [row.rays for row in off.point_rows()] == [row.rays for row in less.point_rows()]
    found = off.off_rays()
    assert set(found) == gone
    # back with next to no weight: the residual that it has, adjusted minus observed
    weak = tuple(
        replace(row, sigma_um=1e6) if k in gone else row for k, row in enumerate(block.image_points)
    )
    again = adjust_block(replace(block, image_points=weak), additional=additional)
    for row in again.ray_rows():
        if row.row in gone:
            assert found[row.row] == pytest.approx([xy.residual for xy in row.xy], abs=1e-2)


def test_a_point_that_the_others_do_not_determine_has_no_residual() -> None:
    block = scene().block
    name = next(
        point
        for point in {row.point for row in block.image_points}
        if not any(c.point == point for c in block.control)
    )
    rays = [k for k, row in enumerate(block.image_points) if row.point == name]
    off = adjust_block(used(block, dict.fromkeys(rays[1:], "off")))
    assert off.off_rays() == {}
    assert name not in points(off)
    assert any(o.name == name and o.reason == "has one ray only" for o in off.problem.left_out)
    halves: dict[int, Use] = dict.fromkeys(rays, "off") | dict.fromkeys(rays[:2], "x")  # type: ignore[assignment]
    off = adjust_block(used(block, halves))
    assert any(
        o.name == name and o.reason == "has two coordinates only" for o in off.problem.left_out
    )
    three: dict[int, Use] = halves | {rays[0]: "xy"}
    assert name in points(adjust_block(used(block, three)))


def test_gross_errors_that_are_off_do_no_harm() -> None:
    block = scene().block
    rows = list(block.image_points)
    a, b, c = well_seen(block)[3::5][:3]
    for k, axis in ((a, "x"), (b, "y"), (c, "x")):
        rows[k] = replace(rows[k], **{axis: getattr(rows[k], axis) + 8.0})
    wild = replace(block, image_points=tuple(rows))
    uses: dict[int, Use] = {a: "y", b: "x", c: "off"}
    off = adjust_block(used(wild, uses))
    right = adjust_block(used(block, uses))
    assert_same(off, right, 1e-6)
    assert off.sigma0 == pytest.approx(right.sigma0, rel=1e-6)
    ours = {row.row: row for row in off.ray_rows()}
    assert ours[a].xy[0].residual == pytest.approx(-8000.0, abs=100.0)
    assert ours[b].xy[1].residual == pytest.approx(-8000.0, abs=100.0)
    assert off.off_rays()[c][0] == pytest.approx(-8000.0, abs=100.0)


@pytest.mark.slow
def test_a_search_for_gross_errors_never_looks_at_what_is_off() -> None:
    block = scene().block
    rows = list(block.image_points)
    a, b = well_seen(block)[2], well_seen(block)[-3]
    for k in (a, b):
        rows[k] = replace(rows[k], x=rows[k].x + 0.5)
    wrong = replace(block, image_points=tuple(rows))
    found = block_gross_errors(wrong, "search")
    assert {row.name[1:3] for row in found.rejected} == {
        (rows[k].photo, rows[k].point) for k in (a, b)
    }
    for strategy in STRATEGIES:
        half = block_gross_errors(used(wrong, {a: "y"}), strategy)
        gone = [row.name for row in half.rejected]
        assert gone[0] == ("image", rows[b].photo, rows[b].point, rows[b].model, "x")
        off = ("image", rows[a].photo, rows[a].point, rows[a].model, "x")
        assert off not in gone
        assert off not in half.untestable
        if len(gone) == 1:
            assert half.block.redundancy == found.block.redundancy
            assert_same(half.block, found.block, 1e-6)


def test_the_live_block_leaves_it_out_too() -> None:
    block = scene().block
    live = LiveBlock(block)
    live.update(block)
    off = used(block, {3: "y", 12: "off"})
    answer = live.update(off)
    assert_same(answer.adjusted, adjust_block(off), 1e-6)


def test_the_tables_say_so() -> None:
    block = scene().block
    control = tuple(
        replace(c, use="off", xyz=(c.xyz[0] + 1.0 if c.xyz[0] is not None else None, *c.xyz[1:]))
        if k == 0
        else c
        for k, c in enumerate(block.control)
    )
    block = replace(block, control=control)
    one, other = well_seen(block)[2], well_seen(block)[-3]
    adjusted = adjust_block(used(block, {one: "y", other: "off"}))
    answer = adjust_document(adjusted).to_dict()
    rows = answer["image_points"]
    assert [row["use"] for row in rows].count("xy") == len(rows) - 2
    half, whole = rows[one], rows[other]
    assert half["use"] == "y"
    assert (half["rx"], half["wx"], half["mdb_x_um"]) == (None, None, None)
    assert None not in (half["vx_um"], half["ry"], half["wy"], half["mdb_y_um"])
    assert whole["use"] == "off"
    assert None not in (whole["vx_um"], whole["vy_um"])
    keys = ("rx", "ry", "wx", "wy", "mdb_x_um", "mdb_y_um")
    assert [whole[key] for key in keys] == [None] * 6
    assert (half["flagged"], whole["flagged"]) == (False, False)
    r = [row[key] for row in rows for key in ("rx", "ry") if row[key] is not None]
    assert len(r) == 2 * len(rows) - 3
    assert answer["indicators"]["RI_x"] == pytest.approx(
        np.mean([row["rx"] for row in rows if row["rx"] is not None])
    )
    off = [row for row in answer["control"] if row["off"]]
    name = block.control[0].point
    assert [(row["point"], row["axis"]) for row in off] == [(name, axis) for axis in "XYZ"]
    assert off[0]["v"] == pytest.approx(-1.0, abs=0.3)
    assert [off[0][key] for key in ("r", "w", "mdb")] == [None, None, None]
    assert not any(row["flagged"] for row in off)
    # without anything off nobody is told of it
    plain = adjust_document(adjust_block(scene().block)).to_dict()
    assert "use" not in plain["image_points"][0]
    assert "off" not in plain["control"][0]


def test_what_is_off_stands_in_one_table_with_its_reason_and_the_residual_it_would_have() -> None:
    rows = list(scene().block.image_points)
    well = well_seen(scene().block)
    rows[well[0]] = replace(rows[well[0]], use="x", reason="identification")
    rows[well[1]] = replace(rows[well[1]], use="off", reason="<b>bird</b>", model="101/102")
    control = list(scene().block.control)
    control[1] = replace(control[1], use="off", xyz=(*control[1].xyz[:2], None))
    ends = tuple(row.point for row in control[2:4])
    bar = ObjectCondition("distance", ends, 600.0, 0.01, "off", "distances.csv:2")
    block = replace(
        scene().block, image_points=tuple(rows), control=tuple(control), conditions=(bar,)
    )
    answer = adjust_document(adjust_block(block)).to_dict()
    one, other, given, condition = answer["off"]
    told = answer["image_points"]
    assert (one["photo"], one["point"]) == (rows[well[0]].photo, rows[well[0]].point)
    assert (one["off"], one["reason"]) == ("y", "identification")
    assert (one["vx_um"], one["vy_um"]) == (None, told[well[0]]["vy_um"])
    assert (other["off"], other["reason"], other["model"]) == ("xy", "<b>bird</b>", "101/102")
    assert (other["vx_um"], other["vy_um"]) == (told[well[1]]["vx_um"], told[well[1]]["vy_um"])
    assert None not in (one["vy_um"], other["vx_um"], other["vy_um"])
    assert (given["kind"], given["point"], given["off"]) == ("control", control[1].point, "XY")
    assert (condition["kind"], condition["point"]) == ("distance", " ".join(ends))
    nothing = adjust_document(adjust_block(scene().block))
    assert nothing.to_dict()["off"] == []
    assert "off" not in [table.key for table in nothing.tables]
