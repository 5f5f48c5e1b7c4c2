"""One point under two names, two points under one, and what is neither."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from test_misnamed import measured

from anaplot import adjust
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors import doublenames
from anaplot.bundle.errors.doublenames import DoubleName, double_names
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.cli import main
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.photogrammetry.block import Block, ImagePoint, PointPrior


def rows(block: Block, *changed: ImagePoint) -> Block:
    return replace(block, image_points=changed)


def second_name(block: Block, point: str, other: str) -> Block:
    """The block with another name for a point in the second strip."""
    return rows(
        block,
        *(
            replace(r, point=other) if r.point == point and r.photo[0] == "2" else r
            for r in block.image_points
        ),
    )


def other_place(block: Block, point: str, by: float) -> Block:
    """The block with another point under the same name in the second strip [mm]."""
    return rows(
        block,
        *(
            replace(r, x=r.x + by, y=r.y - by / 2) if r.point == point and r.photo[0] == "2" else r
            for r in block.image_points
        ),
    )


@pytest.mark.parametrize("far", [0.0, 1e7])
def test_no_two_names_are_passed_over_unseen(far: float) -> None:
    rng, met = np.random.default_rng(4), 0
    for _ in range(400):
        at = far + rng.normal(size=(int(rng.integers(3, 60)), 3)) * rng.choice([1.0, 1e3], size=3)
        if rng.random() < 0.5:
            at[-1] = at[0] + rng.normal(size=3) * 10.0 ** rng.uniform(-6.0, 0.0)
        reach = 10.0 ** rng.uniform(-5.0, 1.0, size=len(at))
        certain = reach < 0.25 * np.median(cKDTree(at).query(at, k=3)[0][:, 2])
        if certain.sum() < 2:
            continue
        near = cKDTree(at[certain]).query_pairs(2.0**0.5 * reach[certain].max())
        assert doublenames._may_meet(at, reach) or not near
        met += bool(near)
    assert met > 50
    apart = far + np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
    assert not doublenames._may_meet(apart, np.full(len(apart), 0.1))


def test_a_block_without_such_accidents_has_none() -> None:
    assert double_names(adjust_block(measured(1))) == ()


@pytest.mark.slow
def test_every_point_under_two_names_is_named() -> None:
    block = measured(1)
    lateral = [
        p
        for p in dict.fromkeys(r.point for r in block.image_points)
        if len({r.photo[0] for r in block.image_points if r.point == p}) == 2
    ]
    assert len(lateral) == 10
    clean = adjust_block(block)
    for point in lateral:
        adjusted = adjust_block(second_name(block, point, "new"))
        (one,) = double_names(adjusted)
        assert (set(one.points), one.rays) == ({point, "new"}, ())
        # what it grows by is what the block with one name has more
        assert one.statistic == pytest.approx(clean.vtpv - adjusted.vtpv, abs=1e-3)
        assert one.statistic < one.critical == pytest.approx(16.266, abs=1e-3)
        assert one.sigma0 == pytest.approx(clean.sigma0)


def test_points_that_stand_in_twos_keep_no_double_name_from_being_named() -> None:
    """The nearest neighbour of each is its twin, hardly farther than their accuracy tells apart."""
    block, rng = second_name(measured(1), "02-02", "new"), np.random.default_rng(5)
    twins = [
        replace(row, point=f"{row.point}t", x=row.x + 0.07 + dx, y=row.y + dy)
        for row, (dx, dy) in zip(
            block.image_points, rng.normal(0.0, 0.005, (len(block.image_points), 2)), strict=True
        )
    ]
    # the twin of a point under two names has one
    twins = [replace(row, point="02-02t") if row.point == "newt" else row for row in twins]
    adjusted = adjust_block(rows(block, *block.image_points, *twins))
    (one,) = double_names(adjusted)
    assert (set(one.points), one.rays) == ({"02-02", "new"}, ())


def test_two_names_in_one_photo_at_different_places_are_two_points() -> None:
    block = second_name(measured(1), "02-02", "new")
    beside = next(r for r in block.image_points if (r.photo, r.point) == ("202", "new"))
    both = rows(block, *block.image_points, replace(beside, point="02-02", x=beside.x + 0.5))
    assert [one for one in double_names(adjust_block(both)) if not one.rays] == []


@pytest.mark.slow
@pytest.mark.parametrize("errors", [False, True])
def test_two_points_under_one_name_are_named(errors: bool) -> None:
    block = other_place(measured(1), "03-02", 0.3)
    adjusted = block_gross_errors(block, "search").block if errors else adjust_block(block)
    (one,) = double_names(adjusted)
    assert one.points == ("03-02",)
    assert one.rays in (("101", "102", "103"), ("201", "202", "203"))
    assert one.statistic is not None
    assert one.statistic > 1000.0 > one.critical
    assert one.sigma0 == pytest.approx(adjust_block(measured(1)).sigma0, rel=0.05)


@pytest.mark.slow
def test_a_name_on_both_sides_of_the_block_is_two_points() -> None:
    block = measured(1)
    far = rows(
        block,
        *(replace(r, point="01-02") if r.point == "04-02" else r for r in block.image_points),
    )
    (one,) = double_names(block_gross_errors(far, "search").block)
    assert one.points == ("01-02",)
    assert one.statistic is None
    assert one.text.endswith("meet elsewhere; with two names there is a solution")


@pytest.mark.slow
def test_one_gross_error_is_no_second_point() -> None:
    block = measured(1)
    wrong = rows(
        block,
        *(
            replace(r, x=r.x + 0.3) if (r.photo, r.point) == ("102", "02-02") else r
            for r in block.image_points
        ),
    )
    assert double_names(adjust_block(wrong)) == ()
    assert double_names(block_gross_errors(wrong, "search").block) == ()


@pytest.mark.slow
@pytest.mark.parametrize("image", [1.0, 8.0])
def test_accidents_are_named_with_the_weights_that_were_estimated(image: float) -> None:
    block = measured(1)
    wild = replace(
        block,
        precision=replace(block.precision, image_um=block.precision.image_um / image),
        control=tuple(replace(row, sigma=(0.1,) * 3) for row in block.control),
    )
    found = adjust(second_name(wild, "02-02", "new"), prior="separate")
    (one,) = double_names(found.result.block)
    assert (set(one.points), one.rays) == ({"02-02", "new"}, ())
    assert one.statistic is not None
    assert one.statistic < one.critical
    assert [set(row["points"]) for row in found.to_dict()["double_names"]] == [{"02-02", "new"}]
    if image == 1.0:  # else a search rejects noise, too
        parted = adjust(other_place(wild, "03-02", 0.3), errors="search", prior="separate")
        (two,) = double_names(parted.result.block)
        assert two.points == ("03-02",)
        assert len(two.rays) == 3


def test_what_is_said() -> None:
    one = DoubleName(("7", "107"), (), 3.02, 16.27, 1.0)
    assert one.text.startswith("7 and 107 are one point under two names? With one name v'Pv grows")
    two = DoubleName(("7",), ("201",), 812.0, 16.27, 1.0)
    assert "Its rays of photo 201 meet elsewhere; with two names v'Pv falls by 812.0" in two.text


@pytest.mark.slow
def test_the_command_names_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "b"
    block = second_name(measured(1), "02-02", "new")
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    for options in ([], ["--errors", "search"]):
        assert main(["adjust", str(folder), *options]) == 0
        assert "02-02 and new are one point under two names?" in capsys.readouterr().out
        assert main(["adjust", str(folder), *options, "--json"]) == 0
        (one,) = json.loads(capsys.readouterr().out)["double_names"]
        assert (one["points"], one["rays"]) == (["02-02", "new"], [])


def two_places(halves: int, apart: float, *, same_photo: bool = False) -> SimpleNamespace:
    """An adjusted block of one point, in vertical photos of which some see another place [m]."""
    n = 2 * halves
    rng = np.random.default_rng(5)
    centres = np.column_stack([rng.uniform(-600.0, 600.0, (n, 2)), rng.uniform(900.0, 1100.0, n)])
    if same_photo:
        centres[1] = centres[0]
    seen = np.where(np.arange(n) < (2 if same_photo else halves), apart, 0.0)[:, None]
    away = np.array([1.0, -0.5, 0.2]) * seen - centres
    xy = -150.0 * away[:, :2] / away[:, 2:] + rng.normal(0.0, 0.005, (n, 2))
    photos = {
        "photo": np.arange(n),
        "ideal": xy,
        "c": np.full(n, 150.0),
        "sigma_xy": np.full((n, 2), 0.005),
    }
    state = SimpleNamespace(rotations=np.tile(np.eye(3), (n, 1, 1)), centres=centres)
    return SimpleNamespace(problem=SimpleNamespace(**photos), state=state)


def test_which_of_two_equal_halves_is_named_does_not_hang_on_rounding() -> None:
    block = two_places(4, 5.0)
    first = doublenames._parts(block, list(range(8)))
    assert first in (frozenset(range(4)), frozenset(range(4, 8)))
    for turn in np.random.default_rng(0).normal(0.0, 1e-15, (20, 8, 2)):
        block.problem.ideal = block.problem.ideal * (1.0 + turn)
        assert doublenames._parts(block, list(range(8))) == first
    # what is not in two places has no parts, and two rays of one photo are one
    assert doublenames._parts(two_places(4, 0.0), list(range(8))) is None
    inner = two_places(4, 5.0, same_photo=True)
    assert doublenames._parts(inner, list(range(8))) == frozenset({0, 1})


@pytest.mark.slow
def test_a_ray_halfway_goes_to_the_same_side_whatever_rounding_prefers() -> None:
    # seven rays see a place left, seven mirrored ones a place right, one the middle of both
    rng = np.random.default_rng(7)
    left = np.column_stack([rng.uniform(-600.0, 600.0, (7, 2)), rng.uniform(900.0, 1100.0, 7)])
    mirrored = left * (-1.0, 1.0, 1.0)
    centres = np.concatenate((left, mirrored, [[0.0, 80.0, 1000.0]]))
    seen = np.repeat([[-3.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 0.0]], (7, 7, 1), axis=0)
    block = two_places(1, 0.0)
    away = seen - centres
    block.problem.photo, block.problem.c = np.arange(15), np.full(15, 150.0)
    block.state.rotations, block.state.centres = np.tile(np.eye(3), (15, 1, 1)), centres
    xy = -150.0 * away[:, :2] / away[:, 2:]
    for turn in rng.normal(0.0, 1e-15, (20, 15, 2)):
        block.problem.ideal = xy * (1.0 + turn)
        # either side with the ray in the middle misses by as much: the first is named
        assert doublenames._parts(block, list(range(15))) == frozenset(range(7))


def test_what_is_known_of_one_name_stays_known() -> None:
    block = measured(1)
    at = adjust_block(block)
    x, y, z = (at.state.points[at.problem.points.index("02-02")] + at.state.origin).tolist()
    known = PointPrior("02-02", (x, y, z + 1.0), (0.5,) * 3)
    clean = adjust_block(replace(block, priors=(known,)))
    two = second_name(block, "02-02", "new")
    for owner in ("02-02", "new"):
        adjusted = adjust_block(replace(two, priors=(replace(known, point=owner),)))
        (one,) = double_names(adjusted)
        assert one.statistic == pytest.approx(clean.vtpv - adjusted.vtpv, abs=1e-3)
