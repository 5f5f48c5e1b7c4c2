"""Control that is the mirror image of what the photos show is told, and nothing else is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import startkinds
from bundleblocks import aerial, make_scene

from anaplot.bundle import adjust
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.start.givenfamilies import CLEARLY, misfit
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block, ControlPoint

TOLD = "mirror image"


def block(relief: float = 120.0) -> Block:
    made = aerial(relief=relief, control_sigma=0.02, noise_um=5.0)
    return replace(made.block, conditions=())


def said(of: Block) -> str:
    try:
        return " ".join(adjust_block(of).warnings)
    except NotComputableError as error:
        return str(error)


def measured(change: Callable[[float, float], tuple[float, float]]) -> Block:
    made = block()
    rows = []
    for row in made.image_points:
        x, y = change(row.x, row.y)
        rows.append(replace(row, x=x, y=y))
    return replace(made, image_points=tuple(rows))


def moved(made: Block, change: Callable[[ControlPoint], list[float | None]]) -> Block:
    control = tuple(replace(row, xyz=tuple(change(row))) for row in made.control)
    return replace(made, control=control)


IMAGES = {"y": lambda x, y: (x, -y), "x": lambda x, y: (-x, y), "both": lambda x, y: (y, x)}
GROUND = {"X and Y": lambda x, y, z: [y, x, z], "Z": lambda x, y, z: [x, y, -z]}


@pytest.mark.slow
@pytest.mark.parametrize("which", IMAGES)
def test_mirrored_images_are_told(which: str) -> None:
    assert TOLD in said(measured(IMAGES[which]))


@pytest.mark.slow
@pytest.mark.parametrize("which", GROUND)
def test_left_handed_control_is_told(which: str) -> None:
    assert TOLD in said(moved(block(), lambda row: GROUND[which](*row.xyz)))


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["baarda", "search", "danish"])
def test_a_search_that_leaves_out_what_tells_the_mirror_image_says_it(strategy: str) -> None:
    found = block_gross_errors(measured(IMAGES["y"]), strategy)
    # what is left in fits
    assert found.rejected
    assert found.block.warnings == ()
    assert sum(TOLD in remark for remark in found.remarks) == 1
    assert not any(TOLD in remark for remark in block_gross_errors(block(), strategy).remarks)


@pytest.mark.slow
def test_images_turned_by_180_degrees_and_wild_control_are_not_mirrored() -> None:
    assert said(measured(lambda x, y: (-x, -y))) == ""
    rng = np.random.default_rng(4)
    wild = moved(block(), lambda row: [float(v or 0.0) + 80.0 * rng.normal() for v in row.xyz])
    assert "gross errors" in (told := said(wild)) or "no solution" in told
    assert TOLD not in told


@pytest.mark.slow
def test_one_control_point_that_is_wrong_does_not_hide_the_mirror_image() -> None:
    made = measured(lambda x, y: (x, -y))
    first, *others = made.control
    wrong = replace(first, xyz=(5000.0, *first.xyz[1:]))
    assert TOLD in said(replace(made, control=(wrong, *others)))


@pytest.mark.slow
def test_control_in_a_plane_tells_no_mirror_image() -> None:
    flat = block(relief=0.0)
    assert said(flat) == ""
    crooked = moved(flat, lambda row: [1.5 * (row.xyz[0] or 0.0), *row.xyz[1:]])
    assert TOLD not in said(crooked)


def flat(kind: str, control: int) -> Block:
    """Return a block whose mirror image is bent a little where it is adjusted."""
    rng = np.random.default_rng(0)
    layout = getattr(startkinds, kind)(rng, 1)
    return startkinds.measured(replace(layout, control=(control, layout.control[1])), rng).block


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "least"), [("block", 10.0), ("oblique", 5.0)])
def test_a_mirror_image_that_tears_a_block_a_little_is_told(kind: str, least: float) -> None:
    made = moved(flat(kind, 6), lambda row: GROUND["Z"](*row.xyz))
    adjusted = adjust_block(made)
    assert adjusted.sigma0 is not None
    assert least < adjusted.sigma0 < 50.0
    assert TOLD in " ".join(adjusted.warnings)
    # rejecting control until the rest fits is no way out
    cleaned = block_gross_errors(made, "search")
    assert cleaned.block.sigma0 < 1.2
    assert TOLD in " ".join(cleaned.remarks)


@pytest.mark.slow
def test_a_search_in_a_large_block_asks_for_the_mirror_image_at_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(adjust, "_FEW_RAYS", 10)
    made = moved(flat("block", 6), lambda row: GROUND["Z"](*row.xyz))
    assert TOLD not in " ".join(adjust_block(made).warnings)
    cleaned = block_gross_errors(made, "baarda")
    assert TOLD in " ".join(cleaned.remarks)


@pytest.mark.slow
def test_control_that_contradicts_itself_is_no_mirror_image() -> None:
    made = flat("block", 6)
    control = list(made.control)
    for k in (1, 4):
        control[k] = replace(control[k], xyz=(*control[k].xyz[:2], control[k].xyz[2] + 30.0))
    made = replace(made, control=tuple(control))
    assert TOLD not in said(made)
    assert TOLD not in " ".join(block_gross_errors(made, "search").remarks)


def test_where_most_control_lies_in_one_plane_all_of_it_tells() -> None:
    # four corners of a facade fit either way, and the fifth point was taken for the wrong one
    rng = np.random.default_rng(2)
    corners = np.array([(0, 0, 0), (20, 0, 0), (0, 0, 12), (20, 0, 12), (9, 1.5, 6)], dtype=float)
    network = corners - corners.mean(axis=0)
    ground = network * (1.0, -1.0, 1.0) + rng.normal(0.0, 0.004, network.shape)
    most = [misfit(side * network, ground) for side in (1.0, -1.0)]
    assert max(most) < CLEARLY * min(most)
    whole = [misfit(side * network, ground, 1.0) for side in (1.0, -1.0)]
    assert whole[1] * CLEARLY < whole[0]


def test_the_mirror_image_of_control_that_lies_in_a_plane_but_for_one_point_is_told() -> None:
    laid = aerial(relief=0.0, control_sigma=0.02)
    seen = {(row.photo, row.point) for row in laid.block.image_points}
    top = (600.0, 0.0, 150.0)
    corners = [row for row in laid.block.control if row.xyz[0] in (0.0, 1800.0)]
    made = make_scene(
        {name: (laid.centres[name], laid.rotations[name]) for name in laid.centres},
        {**laid.points, "p6": np.array(top)},
        control=[*corners, ControlPoint("p6", top, (0.02,) * 3)],
        sees=lambda photo, point, _: (photo, point) in seen,
        noise_um=5.0,
    ).block
    assert len(made.control) == 5
    assert said(made) == ""
    assert TOLD in said(moved(made, lambda row: GROUND["Z"](*row.xyz)))
