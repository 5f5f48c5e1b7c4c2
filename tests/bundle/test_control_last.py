"""Image coordinates cleaned without control, then control brought in."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.errors.controllast import clean_control_last
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.cli import main
from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.planning.blockplan import BlockPlan, plan_block

pytestmark = pytest.mark.slow

WRONG = ("202", "05-05")


def noisy(seed: int = 5, *, control_m: float = 0.02, priors: bool = False) -> Block:
    """A block with noise of its a-priori size."""
    made = plan_block(BlockPlan(3, 4, 0.60, 0.60, 5, twin=True, control_m=control_m))
    rng = np.random.default_rng(seed)
    rows = tuple(
        replace(row, x=row.x + dx, y=row.y + dy)
        for row, (dx, dy) in zip(
            made.block.image_points,
            rng.normal(size=(len(made.block.image_points), 2)) * 0.005,
            strict=True,
        )
    )
    control = tuple(
        replace(c, xyz=tuple(None if v is None else v + rng.normal() * control_m for v in c.xyz))
        for c in made.block.control
    )
    photos = made.block.photos
    if priors:
        photos = tuple(
            replace(
                photo,
                position=tuple((made.stations[photo.id].centre + rng.normal(size=3)).tolist()),
                position_sigma=(1.0, 1.0, 1.0),
            )
            for photo in photos
        )
    return replace(made.block, image_points=rows, control=control, photos=photos)


def spoiled(block: Block, *, image: float = 0.12, control: float = 0.6) -> tuple[Block, str]:
    """The block with one wrong image coordinate and one wrong control coordinate."""
    rows = list(block.image_points)
    at = next(k for k, row in enumerate(rows) if (row.photo, row.point) == WRONG)
    rows[at] = replace(rows[at], x=rows[at].x + image)
    points = list(block.control)
    k = next(k for k, c in enumerate(points) if c.xyz[0] is not None)
    x, y, z = points[k].xyz
    points[k] = replace(points[k], xyz=(x, y + control, z))
    name = points[k].point
    return replace(block, image_points=tuple(rows), control=tuple(points)), name


@pytest.mark.parametrize("strategy", ["baarda", "tau", "search"])
@pytest.mark.parametrize("priors", [False, True])
def test_each_step_finds_its_own(strategy: str, priors: bool) -> None:
    block, point = spoiled(noisy(priors=priors))
    found = clean_control_last(block, strategy)
    assert found.datum == ("priors" if priors else "free")
    assert [r.name[:3] for r in found.images.rejected] == [("image", *WRONG)]
    assert [r.name for r in found.control.rejected] == [("control", point, "Y")]
    (error,) = found.control.rejected
    assert error.error == pytest.approx(0.6, abs=4.0 * error.sigma)
    # what is rejected in the images stays so, and is counted once
    assert found.block.rejected.sum() == 1
    whole = block_gross_errors(block, strategy)
    assert found.block.redundancy == whole.block.redundancy
    assert found.block.sigma0 == pytest.approx(whole.block.sigma0, rel=0.02)


def test_without_errors_both_steps_reject_next_to_nothing() -> None:
    found = clean_control_last(noisy(9), "search")
    assert len(found.images.rejected) + len(found.control.rejected) <= 2


def test_wrong_control_does_not_reach_the_image_coordinates() -> None:
    block = noisy(3)
    spoilt = spoiled(block, image=0.0, control=20.0)[0]
    clean, found = (clean_control_last(b, "baarda").images for b in (block, spoilt))
    assert [r.name for r in found.rejected] == [r.name for r in clean.rejected]
    assert found.block.sigma0 == pytest.approx(clean.block.sigma0, rel=1e-9)


def test_control_free_of_error_cannot_be_brought_in() -> None:
    block = noisy()
    fixed = tuple(replace(c, sigma=(0.0, 0.0, 0.0)) for c in block.control)
    for control in (fixed, (), (ControlPoint("k", (None, None, None), (1.0, 1.0, 1.0)),)):
        with pytest.raises(InputError, match="no control with standard deviations"):
            clean_control_last(replace(block, control=control), "baarda")


def test_the_command(tmp_path: Path, capsys) -> None:
    block, point = spoiled(noisy())
    folder = tmp_path / "block"
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    call = ["adjust", str(folder), "--errors", "search", "--control-last"]
    assert main([*call, "--json", "--fail-on-flag"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert [r["point"] for r in answer["errors_without_control"]["rejected"]] == [WRONG[1]]
    assert answer["errors_without_control"]["datum"] == "free"
    assert [r["point"] for r in answer["errors"]["rejected"]] == [point]
    marked = [row["point"] for row in answer["image_points"] if row["rejected"]]
    assert marked == [WRONG[1]]
    assert main(call) == 0
    out = capsys.readouterr().out
    assert out.index("STEP 1") < out.index("STEP 2") < out.index(f"control point {point}")
    for wrong in ([*call[:2], "--control-last"], [*call, "--datum", "free"]):
        assert main(wrong) == 2
        assert "--control-last" in capsys.readouterr().err


def test_a_prior_rejected_without_control_stays_so(tmp_path: Path, capsys) -> None:
    scene = aerial(2, 4, per_base=2, control_sigma=0.05, noise_um=5.0, priors=True)
    photos = list(scene.block.photos)
    x, y, z = photos[5].position
    photos[5] = replace(photos[5], position=(x + 4.0, y, z))
    block = replace(scene.block, photos=tuple(photos))
    name = ("prior", photos[5].id, "X")
    steps = clean_control_last(block, "search")
    assert steps.datum == "priors"
    assert name in {row.name for row in steps.images.rejected}
    assert name not in {row.name for row in steps.control.rejected}
    assert name[1:] not in {(row.point, row.axis) for row in steps.block.prior_rows()}
    folder = tmp_path / "b"
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    assert main(["adjust", str(folder), "--errors", "search", "--control-last", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["priors"]
    [row] = [row for row in rows if (row["owner"], row["unknown"]) == name[1:]]
    assert row["rejected"] is True


def held(block: Block, names: Collection[str], *, rotation: bool) -> Block:
    """The block with priors for some photos only."""
    return replace(
        block,
        photos=tuple(
            replace(
                photo,
                position_sigma=photo.position_sigma if photo.id in names else None,
                rotation_sigma=photo.rotation_sigma if rotation and photo.id in names else None,
            )
            for photo in block.photos
        ),
    )


@pytest.mark.parametrize(
    ("photos", "rotation", "datum"),
    [
        (("101",), True, "free"),
        (("101", "102"), False, "free"),
        (("101", "102"), True, "priors"),
        (("101", "102", "103", "104"), False, "free"),  # a strip may turn about its axis
        (("101", "104", "202"), False, "priors"),
    ],
)
def test_priors_hold_the_first_step_where_they_determine_a_datum(
    photos: tuple[str, ...], rotation: bool, datum: str
) -> None:
    scene = aerial(2, 4, per_base=2, control_sigma=0.05, noise_um=5.0, priors=True)
    assert clean_control_last(held(scene.block, photos, rotation=rotation), "tau").datum == datum


def test_what_fails_with_priors_is_not_hidden_by_a_free_network() -> None:
    scene = aerial(2, 4, per_base=2, control_sigma=0.05, noise_um=5.0, priors=True)
    # two parts without common points, priors in one of them
    rows = tuple(
        replace(row, point="other " + row.point) if row.photo[0] == "2" else row
        for row in scene.block.image_points
    )
    block = replace(scene.block, image_points=rows)
    block = held(block, ("101", "102", "103", "104"), rotation=True)
    with pytest.raises(NotComputableError, match=r"in the datum of the priors: .*2 disconnected"):
        clean_control_last(block, "tau")


def test_the_odds_of_the_second_step_weigh_what_the_first_has_left(tmp_path: Path, capsys) -> None:
    block, point = spoiled(noisy(), control=1.5)
    rows = list(block.image_points)
    at = next(k for k, r in enumerate(rows) if (r.photo, r.point) == ("302", "06-04"))
    rows[at] = replace(rows[at], y=rows[at].y - 0.15)
    block = replace(block, image_points=tuple(rows))
    found = clean_control_last(block, "search", SearchSettings(pairs=True)).control
    held = sorted(found.names.index(name) for name in found.held)
    assert len(held) == 2
    odds = found.findings.pair_odds
    named = {found.system.names[k] for k in (odds.rows[0], odds.others[0])}
    assert odds.none < 0.01
    assert max(odds.single.sum(), odds.pairs) > 0.5
    assert not set(held) & {*odds.rows.tolist(), *odds.others.tolist()}
    assert odds.single[held].sum() == odds.marginal[held].sum() == 0.0
    assert found.findings.odds.rows[held].sum() == 0.0
    assert ("control", point, "Y") in named
    assert odds.marginal[found.system.names.index(("control", point, "Y"))] > 0.99
    folder = tmp_path / "block"
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    assert main(["adjust", str(folder), "--errors", "search", "--control-last", "--pairs"]) == 0
    first, second = capsys.readouterr().out.split("STEP 2")
    assert "those rejected before" not in first
    assert "with all observations but those rejected before, " in second
    assert second.count("all observations in but those rejected before, by the a-priori s") == 2
