"""Two of the control points at the corners of a block interchanged: where symmetry deceives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import Scene, aerial, known_in, off_by

from anaplot.bundle.adjust import adjust_block, adjust_problem
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.upright import look_up
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import ControlPoint
from anaplot.photogrammetry.exchangedpoints import exchanged_pairs
from anaplot.photogrammetry.rotation import rotation_matrix

pytestmark = pytest.mark.slow

CORNERS = ("p1", "p6", "p25", "p30")  # left and right below, left and right above
MIDDLE = "p15"
SIGMA = 0.05


def scene_with(
    exchanged: tuple[str, str] | None = None,
    *points: str,
    relief: float = 5.0,
    sigma: float = SIGMA,
    length: int = 6,
) -> Scene:
    """Return three strips over nearly level ground, with control at some points."""
    scene = aerial(3, length, relief=relief, noise_um=5.0, seed=1)
    rng = np.random.default_rng(5)
    noise = min(sigma, SIGMA)
    at = {
        name: tuple((scene.points[name] + noise * rng.normal(size=3)).tolist())
        for name in points or CORNERS
    }
    if exchanged is not None:
        first, second = exchanged
        at[first], at[second] = at[second], at[first]
    control = tuple(ControlPoint(name, xyz, (sigma,) * 3) for name, xyz in at.items())
    scene.block = replace(scene.block, control=control)
    return scene


ALONG, ACROSS, DIAGONAL = ("p1", "p6"), ("p1", "p25"), ("p6", "p25")


@pytest.mark.parametrize(
    ("pair", "relief"),
    [
        (ALONG, 5.0),
        (("p25", "p30"), 5.0),
        (ACROSS, 5.0),
        (ALONG, 150.0),
    ],
)
def test_two_of_four_corners_are_named(pair: tuple[str, str], relief: float) -> None:
    # others were blamed, or the block lay upside down kilometres off with sigma0 1
    block = scene_with(pair, relief=relief).block
    named = (
        rf"control point {pair[0]} and control point {pair[1]} interchanged\? With .* all 4 agree"
    )
    try:
        adjusted = adjust_block(block)
    except NotComputableError as error:
        said = [str(error)]
    else:
        said = list(adjusted.warnings)
    with pytest.raises(NotComputableError, match=named):
        block_gross_errors(block, "search")
    assert any(f"{pair[0]} and control point {pair[1]} interchanged?" in one for one in said), said


def test_of_a_rectangle_either_diagonal_is_named() -> None:
    with pytest.raises(NotComputableError, match="interchanged") as refused:
        block_gross_errors(scene_with(DIAGONAL).block, "search")
    said = str(refused.value).split(" interchanged?")[0]
    assert "p6 and control point p25" in said
    assert "p1 and control point p30" in said


def test_what_leaves_too_few_is_refused_and_else_searched() -> None:
    with pytest.raises(NotComputableError, match="without them the others do not hold the block"):
        block_gross_errors(scene_with(ALONG).block, "baarda")
    scene = scene_with(ALONG)
    photos = tuple(
        replace(
            photo, position=tuple(scene.centres[photo.id].tolist()), position_sigma=(0.1, 0.1, 0.1)
        )
        for photo in scene.block.photos
    )
    scene.block = replace(scene.block, photos=photos)
    cleaned = block_gross_errors(scene.block, "search")
    assert {one.name[1] for one in cleaned.rejected if one.name[0] == "control"} == set(ALONG)
    assert off_by(scene, cleaned) < 1.0


def test_one_wrong_corner_is_no_interchange() -> None:
    scene = scene_with()
    wrong, *right = scene.block.control
    x, y, z = wrong.xyz
    scene.block = replace(scene.block, control=(replace(wrong, xyz=(x + 300.0, y, z)), *right))
    cleaned = block_gross_errors(scene.block, "search")
    assert {one.name for one in cleaned.rejected} == {("control", "p1", "X")}
    assert not any("interchanged" in one for one in cleaned.remarks + cleaned.begun.block.warnings)


def test_a_height_that_bends_the_whole_block_is_no_wrong_sigma() -> None:
    # "image_um = 5 right? With 150 um nothing is flagged": and no search without --as-given
    scene = scene_with(None, *CORNERS, MIDDLE)
    wrong, *right = scene.block.control
    x, y, z = wrong.xyz
    scene.block = replace(scene.block, control=(replace(wrong, xyz=(x, y, z + 40.0)), *right))
    (told,) = adjust_block(scene.block).warnings
    assert told.startswith("nearly all residuals in the images are ")
    assert told.endswith("is a control point wrong, or the camera?")
    for strategy in ("search", "baarda"):
        cleaned = block_gross_errors(scene.block, strategy)
        assert {one.name for one in cleaned.rejected} == {("control", "p1", "Z")}
        assert off_by(scene, cleaned) < 1.0


def test_fixed_control_is_named_and_not_searched() -> None:
    scene = scene_with(ACROSS, *CORNERS, MIDDLE, sigma=0.0)
    with pytest.raises(NotComputableError, match=r"p1 and control point p25 interchanged\?"):
        block_gross_errors(scene.block, "search")


@pytest.mark.parametrize(
    ("pair", "relief"),
    [
        # the other two corners fit the block upside down, 3.6 km off: sigma0 was 1
        (ALONG, 5.0),
        (("p25", "p30"), 5.0),
        (ACROSS, 5.0),
        (ACROSS, 30.0),
        (("p1", MIDDLE), 5.0),
    ],
)
def test_two_of_five_are_out_and_the_block_is_upright(pair: tuple[str, str], relief: float) -> None:
    scene = scene_with(pair, *CORNERS, MIDDLE, relief=relief)
    cleaned = block_gross_errors(scene.block, "search")
    assert {one.name[1] for one in cleaned.rejected if one.name[0] == "control"} == set(pair)
    assert off_by(scene, cleaned) < 2.0
    (remark,) = (one for one in cleaned.remarks if "interchanged?" in one)
    assert set(remark.split()[2:5:2]) == set(pair)
    assert "explains as much" not in remark


def plan_and_heights(control: tuple[ControlPoint, ...], plan: int) -> tuple[ControlPoint, ...]:
    """Return control of which the first points are known in plan only, the others in height."""
    return tuple(known_in(row, "XY" if k < plan else "Z") for k, row in enumerate(control))


@pytest.mark.parametrize("strategy", ["search", "baarda"])
def test_two_of_four_points_known_in_plan_are_named(strategy: str) -> None:
    # the two others hold a block, 3.5 km off: nothing checked it
    scene = scene_with(("p8", "p22"), "p8", "p22", "p11", "p29", "p3", "p14", "p27", relief=40.0)
    control = plan_and_heights(scene.block.control, 4)
    named = r"control point p8 and control point p22 interchanged\? With .* all 4 agree"
    with pytest.raises(NotComputableError, match=named):
        block_gross_errors(replace(scene.block, control=control), strategy)


def test_two_of_more_points_known_in_plan_are_out_and_named() -> None:
    plan, heights = ("p8", "p22", "p11", "p29", "p18"), ("p3", "p14", "p27")
    scene = scene_with(("p8", "p22"), *plan, *heights, relief=40.0)
    block = replace(scene.block, control=plan_and_heights(scene.block.control, len(plan)))
    cleaned = block_gross_errors(block, "search")
    assert {one.name[1] for one in cleaned.rejected if one.name[0] == "control"} == {"p8", "p22"}
    assert off_by(scene, cleaned) < 1.0
    (remark,) = (one for one in cleaned.remarks if "interchanged?" in one)
    assert set(remark.split()[2:5:2]) == {"p8", "p22"}


def test_of_what_a_half_turn_explains_as_well_both_are_told() -> None:
    corners, centre = ("p1", "p7", "p29", "p35"), "p18"
    scene = scene_with(("p7", "p29"), *corners, centre, relief=30.0, length=7)
    cleaned = block_gross_errors(scene.block, "search")
    (remark,) = (one for one in cleaned.remarks if "interchanged?" in one)
    assert "p7 and p29" in remark
    assert "p1 and p35" in remark
    assert remark.endswith("are explains as much")
    # on one line the others hold no block
    level = scene_with(("p7", "p29"), *corners, centre, relief=0.0, length=7)
    with pytest.raises(NotComputableError, match=r"p7 and control point p29, or .*p1 and"):
        block_gross_errors(level.block, "search")
    # a point beside the axes tells which
    scene = scene_with(("p7", "p29"), *corners, centre, "p10", relief=30.0, length=7)
    cleaned = block_gross_errors(scene.block, "search")
    assert {one.name[1] for one in cleaned.rejected if one.name[0] == "control"} == {"p7", "p29"}
    assert "p1" not in " ".join(cleaned.remarks).split()
    assert off_by(scene, cleaned) < 2.0


def test_what_fits_upside_down_is_told() -> None:
    # X and Y exchanged of level control, or two corners of a square: sigma0 was 1, and nothing said
    right = scene_with(relief=0.0).block
    exchanged = tuple(
        replace(row, xyz=(row.xyz[1], row.xyz[0], row.xyz[2])) for row in right.control
    )
    square = scene_with(("p5", "p21"), "p1", "p5", "p21", "p25", "p13", relief=0.0, length=5)
    for block in (replace(right, control=exchanged), square.block):
        adjusted = adjust_block(block)
        assert abs(adjusted.sigma0 - 1.0) < 4.0 / np.sqrt(2 * adjusted.redundancy)
        assert adjusted.remarks[-1].startswith("most photos look up at their points: ")
    assert adjust_block(right).remarks == ()
    free = make_problem(replace(right, control=exchanged), datum="free")
    assert not any("look up" in one for one in adjust_problem(free).remarks)


def test_of_a_level_rectangle_the_other_corners_are_a_likeness() -> None:
    at = np.array([[0.0, 0, 0], [3, 0, 0], [0, 2, 0], [3, 2, 0]])
    for exchanged, likeness in (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2))):
        target = at.copy()
        target[list(exchanged)] = at[list(exchanged[::-1])]
        found, _ = exchanged_pairs(at, target)
        assert {(one.first, one.second) for one in found} == {exchanged, likeness}
        upright = {(one.first, one.second): one.fitted.rotation[2, 2] for one in found}
        assert upright[exchanged] == pytest.approx(1.0)
        assert upright[likeness] == pytest.approx(1.0 if exchanged == (0, 3) else -1.0)


def test_photos_look_up_unless_they_are_said_to() -> None:
    scene = scene_with()
    problem = make_problem(scene.block)
    down = np.array([scene.rotations[name] for name in problem.photos])
    up = rotation_matrix(np.pi, 0.0, 0.0) @ down
    level = rotation_matrix(np.pi / 2, 0.0, 0.0) @ down
    assert [look_up(problem, turned) for turned in (down, up, level)] == [False, True, False]
    said = replace(
        scene.block,
        photos=tuple(replace(photo, rotation=(np.pi, 0.0, 0.0)) for photo in scene.block.photos),
    )
    assert not look_up(make_problem(said), up)
