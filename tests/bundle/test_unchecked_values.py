"""Given lengths that next to nothing checks are named, and no others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import startkinds
from bundleblocks import Scene, known_in

from anaplot.adjustment.reliability import SPUR
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.uncheckedvalues import unchecked_values


def scene_with(axes: tuple[str, ...], sigma: float = 0.05) -> Scene:
    """Return a block whose control points are known in these axes."""
    rng = np.random.default_rng(0)
    layout = startkinds.block(rng, 1)
    scene = startkinds.measured(replace(layout, control=(len(axes), layout.control[1])), rng)
    control = [replace(point, sigma=(sigma,) * 3) for point in scene.block.control]
    np.random.default_rng(1000).shuffle(control)
    known = map(known_in, control, axes)
    scene.block = replace(scene.block, control=tuple(known))
    return scene


def named(block: AdjustedBlock) -> set[tuple[str, ...]]:
    return {one.key for one in unchecked_values(block)}


def moved(scene: Scene, axis: str, metres: float) -> Scene:
    """Let the first control point lie elsewhere."""
    first, *others = scene.block.control
    xyz = list(first.xyz)
    xyz["XYZ".index(axis)] += metres
    control = (replace(first, xyz=tuple(xyz)), *others)
    return replace(scene, block=replace(scene.block, control=control))


def test_control_in_which_metres_hide_is_named() -> None:
    scene = scene_with(("XYZ", "XYZ", "Z", "Z", "Z"))
    block = adjust_block(scene.block)
    two = [point.point for point in scene.block.control[:2]]
    assert named(block) == {("control", point, axis) for point in two for axis in "XY"}
    # a tenth of what shows moves the ground by metres, and hardly any test value
    away = min(one.mdb for one in unchecked_values(block)) / 10.0
    after = adjust_block(moved(scene, "X", away).block)
    before, ground = (one.state.points + one.state.origin for one in (block, after))
    assert away > 1.0
    assert np.abs(ground - before).max() > 0.5 * away
    assert np.abs(after.tested.w - block.tested.w).max() < 1.0


def test_control_that_only_holds_the_block_is_named() -> None:
    found = unchecked_values(adjust_block(scene_with(("XYZ", "XYZ", "Z")).block))
    assert [one.mdb for one in found] == [None] * 7
    assert {one.key[0] for one in found} == {"control"}


def test_control_that_is_sharper_than_the_photographs_is_checked_all_the_same() -> None:
    scene = scene_with(("XYZ",) * 4, sigma=1e-5)
    block = adjust_block(scene.block)
    assert max(one.r for one in block.control_rows()) < SPUR
    assert not unchecked_values(block)
    # an error of some deviations of the points shows
    away = 20.0 * float(np.median(block.cofactors.point_deviations))
    assert adjust_block(moved(scene, "X", away).block).tested.flagged.any()
