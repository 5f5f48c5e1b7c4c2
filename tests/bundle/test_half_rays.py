"""Points of which half rays count: those that are not determined are left out, and nothing else."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import Scene, aerial, make_scene
from grossblocks import mismatched, planned

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.controllast import clean_control_last
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.live import LiveBlock
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Datum, make_problem
from anaplot.bundle.start.halfrays import half_seen, met_planes
from anaplot.photogrammetry.block import Block, ControlPoint, ControlUse, Use
from anaplot.photogrammetry.objectconditions import ObjectCondition

REASON = "has rays of which x or y is off, and the rest does not meet before its photos"
HALVES: tuple[Use, Use] = ("x", "y")
CACHED: dict[str, Scene] = {}


def scene() -> Scene:
    if not CACHED:
        CACHED["aerial"] = aerial(
            2, 4, per_base=2, tilt=0.0, noise_um=5.0, control_sigma=0.05, seed=3
        )
    return CACHED["aerial"]


def of_two_photos(block: Block) -> list[tuple[str, list[int]]]:
    """Return points that two photos of one strip see, and their rows; none is control."""
    rows = defaultdict(list)
    for k, row in enumerate(block.image_points):
        rows[row.point].append(k)
    control = {row.point for row in block.control}
    return [
        (name, its)
        for name, its in rows.items()
        if len(its) == 2
        and name not in control
        and len({block.image_points[k].photo[0] for k in its}) == 1
    ]


def halved(block: Block, along: int, across: int = 0) -> tuple[Block, set[str], set[str]]:
    """Return the block with x off in `along` points' second rays and y in `across` others'."""
    rows = list(block.image_points)
    two = of_two_photos(block)
    assert len(two) >= along + across
    names: list[set[str]] = [set(), set()]
    for k, (name, its) in enumerate(two[: along + across]):
        use = "y" if k < along else "x"
        names[k >= along].add(name)
        rows[its[1]] = replace(rows[its[1]], use=use)  # type: ignore[arg-type]
    return replace(block, image_points=tuple(rows)), *names


def left(adjusted: AdjustedBlock) -> set[str]:
    return {one.name for one in adjusted.problem.left_out if one.reason == REASON}


def without(block: Block, names: set[str]) -> Block:
    return replace(block, image_points=tuple(r for r in block.image_points if r.point not in names))


def assert_same(one: AdjustedBlock, other: AdjustedBlock) -> None:
    assert one.problem.photos == other.problem.photos
    there = {row.point: row for row in other.point_rows()}
    ours = {row.point: row for row in one.point_rows()}
    assert set(there) <= set(ours)
    for name, row in there.items():
        assert ours[name].xyz == pytest.approx(row.xyz, abs=1e-6)
    np.testing.assert_allclose(
        one.state.centres + one.state.origin, other.state.centres + other.state.origin, atol=1e-6
    )
    assert one.redundancy == other.redundancy
    assert one.vtpv == pytest.approx(other.vtpv, rel=1e-8)


def test_what_is_off_along_the_base_leaves_a_point_undetermined() -> None:
    block, along, across = halved(scene().block, 3, 2)
    adjusted = adjust_block(block)
    assert left(adjusted) == along
    assert_same(adjusted, adjust_block(without(block, along | across)))
    # three planes meet in a point, and check nothing
    for row in adjusted.point_rows():
        if row.point in across:
            assert row.xyz == pytest.approx(scene().points[row.point], abs=1.0)
    mine = np.isin(np.array(adjusted.problem.points)[adjusted.problem.point], list(across))
    mine = mine[:, None] & ~adjusted.rejected
    assert mine.sum() == 3 * len(across)
    assert np.abs(adjusted.cofactors.r[mine]).max() < 1e-6


@pytest.mark.parametrize("how", ["free", "additional"])
def test_in_every_datum_and_with_additional_parameters(how: str) -> None:
    block, along, across = halved(scene().block, 2, 1)
    chosen = None if how == "free" else additional_parameters("ebner", sigma_um=3.0)
    datum = "free" if how == "free" else "control"
    adjusted = adjust_block(block, datum=datum, additional=chosen)
    assert left(adjusted) == along
    alone = adjust_block(without(block, along | across), datum=datum, additional=chosen)
    assert adjusted.redundancy == alone.redundancy
    assert adjusted.vtpv == pytest.approx(alone.vtpv, rel=1e-7)


def test_what_tilted_photos_determine_stays() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=0.05, tilt=0.2, seed=4)
    block, along, across = halved(scene.block, 2, 2)
    problem = make_problem(block)
    assert {problem.points[k] for k in np.flatnonzero(half_seen(problem))} == along | across
    adjusted = adjust_block(block)
    assert not left(adjusted)
    assert along | across <= {row.point for row in adjusted.point_rows()}
    assert adjusted.problem.undetermined == {}


def test_points_that_something_else_holds_are_not_in_doubt() -> None:
    block = scene().block
    name, its = of_two_photos(block)[0]
    rows = list(block.image_points)
    rows[its[1]] = replace(rows[its[1]], use="y")
    block = replace(block, image_points=tuple(rows))
    assert half_seen(make_problem(block)).sum() == 1
    height = replace(block.control[0], point=name, xyz=(None, None, scene().points[name][2]))
    held = replace(block, control=(*block.control, height))
    assert not half_seen(make_problem(held)).any()
    assert not left(adjust_block(held))


@pytest.mark.parametrize(("use", "holds"), [("control", True), ("check", False), ("off", False)])
def test_what_is_only_compared_holds_no_point(use: ControlUse, holds: bool) -> None:
    block, (name,), _ = halved(scene().block, 1)
    others = [row.point for row in block.control[:2]]
    along = ObjectCondition("line", (others[0], name, others[1]), None, 0.2, use)
    problem = make_problem(replace(block, conditions=(along,)))
    assert half_seen(problem).any() == (not holds)
    x, y, z = scene().points[name].tolist()
    full = ControlPoint(name, (x, y, z), (0.05,) * 3, use)
    problem = make_problem(replace(block, control=(*block.control, full)))
    assert half_seen(problem).any() == (not holds)


@pytest.mark.slow
def test_a_gross_error_is_found_beside_them() -> None:
    block, along, _ = halved(scene().block, 2, 1)
    rows = list(block.image_points)
    count = defaultdict(int)
    for row in rows:
        count[row.point] += 1
    at = next(k for k, row in enumerate(rows) if count[row.point] > 4)
    rows[at] = replace(rows[at], y=rows[at].y + 0.3)
    block = replace(block, image_points=tuple(rows))
    gross = ("image", rows[at].photo, rows[at].point, rows[at].model, "y")
    found = block_gross_errors(block, "baarda")
    assert [one.name for one in found.rejected] == [gross]
    assert left(found.block) == along
    last = clean_control_last(block, "baarda")
    assert gross in [one.name for one in last.images.rejected]
    assert left(last.control.block) == along


def test_a_live_block_leaves_out_the_same() -> None:
    block, along, _ = halved(scene().block, 2, 1)
    live = LiveBlock(replace(block, image_points=()))
    whole = live.update(scene().block)
    assert not left(whole.adjusted)
    answer = live.update(block)
    assert left(answer.adjusted) == along
    fresh = adjust_block(block)
    assert answer.adjusted.redundancy == fresh.redundancy
    assert answer.adjusted.vtpv == pytest.approx(fresh.vtpv, rel=1e-8)
    # measured again, they are there again
    again = live.update(scene().block)
    assert not left(again.adjusted)


def convergent(seed: int, photos: int) -> Scene:
    """Return photos on a ring about 30 points; control is weighted."""
    rng = np.random.default_rng(seed)
    taken = {}
    for k in range(photos):
        angle = 2 * np.pi * k / max(photos, 5) + 0.1 * rng.normal()
        centre = np.array([10 * np.cos(angle), 10 * np.sin(angle), 1.0 + k % 2])
        z = centre / np.linalg.norm(centre)
        x = np.cross([0.0, 0.0, 1.0], z)
        x /= np.linalg.norm(x)
        taken[f"r{k}"] = centre, np.column_stack((x, np.cross(z, x), z))
    points = {f"q{k}": rng.uniform(-3.0, 3.0, 3) for k in range(30)}
    control = [
        ControlPoint(f"q{k}", tuple(points[f"q{k}"].tolist()), (0.001,) * 3) for k in range(5)
    ]
    return make_scene(taken, points, c=30.0, control=control, noise_um=2.0, sigma_um=2.0, seed=seed)


def certainty(scene: Scene, block: Block, name: str) -> float:
    """Return the standard deviation of a point's rays over its distance, at its true place."""
    normal, reach = np.zeros((3, 3)), 0.0
    c = block.cameras[0].c
    for row in block.image_points:
        if row.point != name:
            continue
        turn = scene.rotations[row.photo].T
        d = turn @ (scene.points[name] - scene.centres[row.photo])
        reach = max(reach, float(np.linalg.norm(d)))
        for axis in (0, 1):
            if row.counts("xy"[axis]):
                rate = -c / d[2] * (turn[axis] - d[axis] / d[2] * turn[2])
                normal += np.outer(rate, rate)
    weakest = max(float(np.linalg.eigvalsh(normal)[0]), 1e-30)
    return 1e-3 * block.precision.image_um / weakest**0.5 / reach


@pytest.mark.parametrize("datum", ["control", "minimal"])
@pytest.mark.parametrize("seed", range(4, 9))
def test_what_its_planes_determine_is_not_left_out(seed: int, datum: Datum) -> None:
    # of most points one whole ray, and halves of the others
    rng = np.random.default_rng(seed)
    scene = convergent(seed, 3 + 3 * (seed % 2))
    rows, seen = [], set()
    names = sorted(scene.points)
    whole = {names[k] for k in rng.choice(len(names), 4, replace=False)}
    for row in scene.block.image_points:
        use: Use = (
            "xy" if row.point in whole | (scene.points.keys() - seen) else HALVES[rng.integers(2)]
        )
        seen.add(row.point)
        rows.append(replace(row, use=use))
    block = replace(scene.block, image_points=tuple(rows))
    adjusted = adjust_block(block, datum=datum)
    assert adjusted.sigma0 < 2.0
    assert not [name for name in left(adjusted) if certainty(scene, block, name) < 0.01]


def test_a_point_a_thousand_flying_heights_away_is_none() -> None:
    # one of its two rays is meant for another point, and of the other one only x counts
    made = planned(1, strips=3)
    state = adjust_block(made).state
    block, wrong = mismatched(made, 4, 1)
    assert ("306", "06-07") in wrong
    rows = [
        replace(row, use="x") if (row.photo, row.point) == ("307", "06-07") else row
        for row in block.image_points
    ]
    problem = make_problem(replace(block, image_points=tuple(rows)))
    at = np.array([problem.points.index("06-07")])
    assert half_seen(problem)[at].all()
    _, certain = met_planes(problem, state, at)
    assert not certain.any()
