"""Points whose rays do not meet at an angle are left out: the sky, what one place alone saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import Scene
from startkinds import Layout, facade, looking_at, measured

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.remade import among_points, laid_out_again, without_points
from anaplot.bundle.solve.selection import NO_ANGLE
from anaplot.bundle.start.parallelrays import parallel, with_meeting
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block, ImagePoint

SIGMA = 0.005  # mm


def facade_below(far: np.ndarray, seed: int, noise: float = SIGMA) -> tuple[Layout, Scene]:
    """A facade, and (n, 3) far points above it that all photos have seen."""
    rng = np.random.default_rng(seed)
    layout = facade(rng, 2)
    scene = measured(layout, rng, noise / SIGMA)
    rows = list(scene.block.image_points)
    camera = layout.cameras[0]
    for k, (centre, rotation) in enumerate(
        zip(layout.centres, layout.rotations, strict=True), start=1
    ):
        seen = (far - centre) @ rotation
        xy = -camera.c * seen[:, :2] / seen[:, 2:] + rng.normal(0.0, noise, (len(far), 2))
        rows += [
            ImagePoint(f"f{k}", f"far{n}", *place)
            for n, place in enumerate(xy.tolist())
            if seen[n, 2] < 0.0
        ]
    return layout, replace(scene, block=replace(scene.block, image_points=tuple(rows)))


def room_with_panorama(seed: int) -> tuple[Block, set[str]]:
    """A room of which six points are seen by a panorama alone, eight photos of one place."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (400, 3)) * (6.0, 5.0, 2.0)
    wall = rng.integers(0, 3, 400)
    points[np.arange(400), wall] = rng.choice([-1.0, 1.0], 400) * np.array([6.0, 5.0, 2.0])[wall]
    turn = 2.0 * np.pi * np.arange(8) / 8
    here = np.tile([0.5, 0.3, 0.0], (8, 1))
    aims = here + np.column_stack((np.cos(turn), np.sin(turn), np.full(8, 0.1)))
    others = rng.normal(0.0, 1.2, (12, 3)) * (1.0, 1.0, 0.3)
    turn = 2.0 * np.pi * np.arange(12) / 12
    toward = others + np.column_stack((np.cos(turn), np.sin(turn), np.zeros(12)))
    centres = np.vstack((here, others))
    rotations = looking_at(centres, np.vstack((aims, toward)))
    scene = measured(Layout(centres, rotations, points, half=0.8, control=(6, 0.002)), rng)
    names = [control.point for control in scene.block.control]
    seen: dict[str, int] = {}
    for row in scene.block.image_points:
        seen[row.point] = seen.get(row.point, 0) + (int(row.photo[1:]) <= 8)
    alone = [name for name, count in seen.items() if count > 1 and name not in names][:6]
    rows = tuple(
        row for row in scene.block.image_points if row.point not in alone or int(row.photo[1:]) <= 8
    )
    elsewhere = {row.point for row in rows if int(row.photo[1:]) > 8}
    here = {row.point for row in rows} - elsewhere
    assert here >= set(alone)
    return replace(scene.block, image_points=rows), here


def without(block: Block, names: set[str]) -> Block:
    rows = tuple(row for row in block.image_points if row.point not in names)
    return replace(block, image_points=rows)


def out_of(block: AdjustedBlock) -> set[str]:
    return {one.name for one in block.problem.left_out if one.reason == NO_ANGLE}


def same_figures(one: AdjustedBlock, other: AdjustedBlock) -> None:
    assert one.redundancy == other.redundancy
    assert one.vtpv == pytest.approx(other.vtpv, rel=1e-9)
    assert one.problem.points == other.problem.points
    mine, its = (block.state.points + block.state.origin for block in (one, other))
    assert mine == pytest.approx(its, abs=1e-7)
    assert one.cofactors.r == pytest.approx(other.cofactors.r, abs=1e-7)


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_the_moon_is_left_out(seed: int) -> None:
    # noise lets some rays part and some meet far away; one whose rays part leaves all of them out
    far = np.array([[k * 3e7, 2e8, -4e8] for k in range(6)])
    _, scene = facade_below(far, seed)
    block = adjust_block(scene.block)
    assert out_of(block) == {f"far{k}" for k in range(6)}
    assert block.sigma0 == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * block.redundancy))
    same_figures(block, adjust_block(without(scene.block, out_of(block))))


def test_so_it_is_without_any_noise() -> None:
    _, scene = facade_below(np.array([[10.0, 2e12, -4e12]]), 5, noise=0.0)
    block = adjust_block(scene.block)
    assert out_of(block) == {"far0"}
    same_figures(block, adjust_block(without(scene.block, {"far0"})))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_what_one_place_alone_has_seen_is_left_out(seed: int) -> None:
    whole, alone = room_with_panorama(seed)
    block = adjust_block(whole)
    assert out_of(block) == alone
    assert block.sigma0 == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * block.redundancy))
    same = adjust_block(without(whole, alone))
    same_figures(block, same)
    # a search goes on without them
    found = block_gross_errors(block, "search")
    assert out_of(found.block) == alone
    assert found.out == block_gross_errors(same, "search").out


@pytest.mark.slow
def test_they_stay_out_when_other_rows_change() -> None:
    whole, alone = room_with_panorama(0)
    block = adjust_block(whole)
    rows = [row for row in whole.image_points if row.point not in alone]
    changed = replace(
        whole, image_points=tuple(row for row in whole.image_points if row != rows[3])
    )
    assert not alone & set(laid_out_again(block.problem, changed).points)
    one = min(alone)
    mine = [row for row in whole.image_points if row.point == one]
    changed = replace(
        whole, image_points=tuple(row for row in whole.image_points if row != mine[0])
    )
    if len(mine) > 2:
        assert alone & set(laid_out_again(block.problem, changed).points) == {one}


def test_rays_that_meet_bring_their_points_back() -> None:
    """Where the photos were not where they are, rays may have looked parallel."""
    _, scene = facade_below(np.array([[10.0, 2e8, -4e8]]), 1)
    whole = make_problem(scene.block)
    wrongly = sorted(set(whole.points) - {control.point for control in scene.block.control})[:4]
    block = adjust_block(without(scene.block, {*wrongly, "far0"}))
    smaller = without_points(whole, [*wrongly, "far0"], NO_ANGLE)
    assert smaller.points == block.problem.points
    more = with_meeting(whole, smaller, block.state)
    assert more is not None
    problem, start = more
    assert set(whole.points) - set(problem.points) == {"far0"}
    truth = adjust_block(without(scene.block, {"far0"}))
    order = [truth.problem.points.index(name) for name in problem.points]
    assert start.points + start.origin == pytest.approx(
        (truth.state.points + truth.state.origin)[order], abs=0.2
    )
    assert with_meeting(problem, problem, start) is None


@pytest.mark.slow
def test_photos_that_hang_on_them_are_named() -> None:
    layout, scene = facade_below(np.array([[k * 1e8, 2e8, -4e8] for k in range(-3, 4)]), 2)
    # of the last photo nothing is left but the sky
    last = f"f{len(layout.centres)}"
    rows = tuple(
        row for row in scene.block.image_points if row.photo != last or row.point.startswith("far")
    )
    with pytest.raises(NotComputableError):
        adjust_block(replace(scene.block, image_points=rows))


def test_how_parallel_rays_must_be() -> None:
    """Two rays are off their common direction by half their angle each."""
    layout, scene = facade_below(np.array([[10.0, 2e8, -4e8]]), 3)
    problem = make_problem(scene.block)
    assert np.flatnonzero(parallel(problem, layout.rotations)).tolist() == [
        problem.points.index("far0")
    ]
    # known to half of its distance by nobody: what is given holds a point
    block = adjust_block(without(scene.block, {"far0"}))
    turned = np.tile(np.eye(3), (len(layout.centres), 1, 1))
    state = among_points(block.problem, block.problem, block.state)
    assert not parallel(block.problem, state.rotations).any()
    assert parallel(problem, turned).sum() <= 1 + len(problem.points) // 100
