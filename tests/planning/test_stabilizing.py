"""Points that make weak photos stronger: what is predicted is what the block then has."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from anaplot.bundle.adjust import adjust_block
from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.measuredimage import measured_rays
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.blockplan import BlockPlan, plan_block, rays_measured
from anaplot.planning.idealblock import ExposureStation, IdealBlock, photograph
from anaplot.planning.plannedreliability import photo_reliability
from anaplot.planning.stabilizing import (
    SIZES,
    as_recorded,
    extra_points,
    stabilizing_sets,
    weak_ones,
)

PLANS = (
    BlockPlan(2, 4),
    BlockPlan(3, 4, 0.60, 0.60, stereo=False),
    BlockPlan(2, 4, 0.60, 0.60, 5, twin=True),
)


STRONG = BrownLens(k1=-0.12, k2=0.03, p1=2e-3, b1=1e-3)


def through(lens: BrownLens | None, made: IdealBlock) -> IdealBlock:
    """The same rays, of a camera that states a lens."""
    cameras = tuple(replace(camera, lens=lens) for camera in made.block.cameras)
    return replace(made, block=replace(made.block, cameras=cameras))


@pytest.mark.parametrize(("plan", "lens"), [*((plan, None) for plan in PLANS), (PLANS[0], STRONG)])
def test_what_is_predicted_is_what_the_block_with_the_points_has(
    plan: BlockPlan, lens: BrownLens | None
) -> None:
    made = through(lens, plan_block(plan))
    block = made.evaluated()
    weak = weak_ones(block)
    photo = weak[0] if weak else block.problem.photos[0]
    old = {row.point for row in block.ray_rows() if row.photo == photo}
    sets = stabilizing_sets(block, [photo], rays_measured(plan, made))
    assert [len(one.points) for one in sets] == list(SIZES)
    for one in sets:
        extra = {f"s{k}": point.place[:2] for k, point in enumerate(one.points)}
        then = through(lens, plan_block(plan, extra)).evaluated()
        of = next(of for of in photo_reliability(then) if of.name == photo)
        assert of.mean_r == pytest.approx(one.after, abs=1e-9)
        r = [
            coordinate.r
            for row in then.ray_rows()
            if row.photo == photo and row.point in old
            for coordinate in row.xy
        ]
        assert min(r) == pytest.approx(one.low_after, abs=1e-9)
        for k, point in enumerate(one.points):
            seen = {row.photo for row in then.ray_rows() if row.point == f"s{k}"}
            assert seen == set(point.photos)
            # where it lies in the image: what is measured there, not the ideal place
            row = next(
                row
                for row in then.problem.block.image_points
                if (row.photo, row.point) == (photo, f"s{k}")
            )
            at = measured_rays(block.problem.block.camera_of(photo), [(row.x, row.y)])
            assert at[0].tolist() == pytest.approx([point.x, point.y], abs=1e-9)
    assert sets[0].before < sets[0].after < sets[1].after < sets[2].after


@pytest.mark.slow
def test_the_best_point_is_the_best_of_all() -> None:
    plan = PLANS[0]
    made = plan_block(plan)
    block = made.evaluated()
    photo = weak_ones(block)[0]
    best = stabilizing_sets(block, [photo], rays_measured(plan, made))[0]
    centre = made.stations[photo].centre
    for x, y in np.random.default_rng(2).uniform(-0.4, 0.4, (12, 2)) * 2300.0:
        then = plan_block(plan, {"s": (centre[0] + x, centre[1] + y)}).evaluated()
        if len({row.photo for row in then.ray_rows() if row.point == "s"}) > 1:
            of = next(of for of in photo_reliability(then) if of.name == photo)
            assert of.mean_r < best.after + 0.01


@pytest.mark.slow
def test_a_recorded_block_is_measured_in_its_models() -> None:
    plan = PLANS[0]
    made = plan_block(plan)
    block = made.evaluated()
    weak = weak_ones(block)
    planned = stabilizing_sets(block, weak, rays_measured(plan, made))
    assert stabilizing_sets(block, weak, as_recorded(block)) == planned != ()
    assert planned != stabilizing_sets(block, weak)
    assert as_recorded(plan_block(PLANS[1]).evaluated()) is None


def test_weak_photos_are_those_of_the_rows() -> None:
    block = plan_block(PLANS[0]).evaluated()
    photos = photo_reliability(block)
    limit = 0.85 * np.median([one.mean_r for one in photos])
    assert set(weak_ones(block)) == {one.name for one in photos if one.mean_r < limit} != set()


def tilted(extra: dict[str, np.ndarray]):
    """A block of tilted photos over hills, with more points or without."""
    rng = np.random.default_rng(7)
    plan = BlockPlan(2, 4)
    made = plan_block(plan)
    stations = {
        name: ExposureStation(
            one.centre + rng.normal(size=3) * 20.0,
            rotation_matrix(*(rng.normal(size=3) * 0.03)),
            one.camera,
        )
        for name, one in made.stations.items()
    }
    points = {
        name: at + np.array([0.0, 0.0, rng.uniform(-60.0, 60.0)])
        for name, at in made.points.items()
    }
    block = made.block
    return photograph(
        "tilted", block.cameras, stations, {**points, **extra}, control=[
            type(row)(row.point, tuple(None if v is None else float(v + d) for v, d in zip(
                row.xyz, points[row.point] - made.points[row.point], strict=True)), row.sigma)
            for row in block.control
        ],
    )  # fmt: skip


def test_tilted_photos_over_hills_are_met_too() -> None:
    block = tilted({}).evaluated()
    photo = weak_ones(block)[0]
    sets = stabilizing_sets(block, [photo])
    for one in sets:
        extra = {f"s{k}": np.array(point.place) for k, point in enumerate(one.points)}
        of = next(of for of in photo_reliability(tilted(extra).evaluated()) if of.name == photo)
        assert of.mean_r == pytest.approx(one.after, abs=1e-9)


def test_a_photo_that_looks_to_the_side_gets_no_points() -> None:
    block = plan_block(BlockPlan(2, 3)).evaluated()
    level = rotation_matrix(np.pi / 2.0, 0.0, 0.0)
    block.state.rotations[0] = level
    assert stabilizing_sets(block, block.problem.photos[:1]) == ()


@pytest.mark.slow
def test_one_point_serves_two_photos_that_ask_for_it() -> None:
    plan = BlockPlan(3, 4, 0.60, 0.60)
    made = plan_block(plan)
    block = made.evaluated()
    weak = weak_ones(block)
    sets = stabilizing_sets(block, weak, rays_measured(plan, made))
    asked = [point.place[:2] for one in sets if len(one.points) == 4 for point in one.points]
    added = extra_points(sets, 4, 0.05 * plan.base)
    # a photo with fewer candidates gets what there is
    fewer = [one for one in sets if len(one.points) < 4]
    assert extra_points(fewer, 4, 0.0) == extra_points(fewer, 2, 0.0) != ()
    assert 0 < len(added) <= len(asked)
    assert len({one.name for one in added}) == len(added)
    for x, y in asked:
        near = [max(abs(x - one.place[0]), abs(y - one.place[1])) for one in added]
        assert min(near) <= 0.05 * plan.base


@pytest.mark.slow
def test_a_block_is_planned_with_the_points(tmp_path, capsys) -> None:
    said = ["plan", "block", "--strips", "2", "--photos", "4"]
    assert main([*said, "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert plain["added_points"] is None
    assert {one["photo"] for one in plain["stabilizing"]} <= {
        one["photo"] for one in plain["weak_photos"]
    }
    folder = tmp_path / "planned"
    assert main([*said, "--stabilize", "4", "--to", str(folder), "--json"]) == 0
    stronger = json.loads(capsys.readouterr().out)
    assert stronger["weak_photos"][0]["mean_r"] > 1.3 * plain["weak_photos"][0]["mean_r"]
    names = {one["name"] for one in stronger["added_points"]}
    block = read_block(folder)
    assert names <= {row.point for row in block.image_points}
    assert adjust_block(block).redundancy == stronger["redundancy"]
    assert main(said) == 0
    text = capsys.readouterr().out
    assert "what would help most, at (x, y) in the photo [mm]:" in text
    assert max(map(len, text.splitlines())) <= 80
    assert main([*said, "--stabilize", "3"]) == 2


@pytest.mark.slow
def test_mono_measures_every_ray_once(capsys) -> None:
    said = ["plan", "block", "--strips", "2", "--photos", "4", "--json"]
    assert main(said) == 0
    stereo = json.loads(capsys.readouterr().out)
    assert main([*said, "--measured", "mono"]) == 0
    mono = json.loads(capsys.readouterr().out)
    assert mono["observations"] < stereo["observations"]
    assert not any(row["inner"] for row in mono["classes"])
    assert any(row["inner"] for row in stereo["classes"])
    assert mono["unknowns"] == stereo["unknowns"]
