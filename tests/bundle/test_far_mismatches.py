"""Rays measured beside any other point of their photo are found, also at points of two rays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grossblocks import mismatched, planned

from anaplot import adjust
from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import BlockFindings, block_gross_errors
from anaplot.cli import main
from anaplot.exchange.blockfolder import (
    read_block,
    write_control,
    write_image_points,
    write_new_block,
)
from anaplot.photogrammetry.block import Block, ControlPoint, PointPrior
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.report.adjusterrors import errors_document
from anaplot.report.astext import page_text

ALPHA = SearchSettings(alpha=0.001)


def far_block(count: int = 4, seed: int = 1) -> tuple[Block, set[tuple[str, str]]]:
    """Three strips; of 4 mismatches of seed 1 one is at a point of two rays."""
    return mismatched(planned(seed, strips=3), count, seed)


def rays_out(found: BlockFindings) -> set[tuple[str, str]]:
    return {(row.name[1], row.name[2]) for row in found.rejected if row.name[0] == "image"}


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["baarda", "search"])
def test_a_point_whose_two_rays_do_not_meet_is_left_out(strategy: str) -> None:
    block, wrong = far_block()
    found = block_gross_errors(block, strategy, ALPHA)
    at = {point for _, point in wrong}
    assert len(found.points) == 1
    assert set(found.points) <= at
    rays = [row for row in block.image_points if row.point == found.points[0]]
    assert len(rays) == 2
    # both coordinates of every other one, and hardly anything else
    others = {ray for ray in wrong if ray[1] not in found.points}
    assert others <= rays_out(found)
    assert len(rays_out(found) - others) <= 1
    assert found.block.sigma0 is not None
    assert 0.85 < found.block.sigma0 < 1.15
    assert set(found.points).isdisjoint(found.block.problem.points)
    reasons = {one.name: one.reason for one in found.block.problem.left_out}
    assert reasons[found.points[0]].startswith("has rays far apart")
    assert found.first is None
    assert found.begun.points == found.points


@pytest.mark.slow
def test_far_mismatches_are_out_from_the_beginning_and_told_with_their_size() -> None:
    block, wrong = far_block(9)
    found = block_gross_errors(block, "search", ALPHA)
    assert found.points == ()
    assert wrong <= rays_out(found)
    assert len(rays_out(found) - wrong) <= 1
    # all but the one at control, which is tested like all else
    assert len(wrong - {name[1:3] for name in found.kept_out}) == 1
    assert {name[1:3] for name in found.kept_out} <= wrong
    assert found.kept_out == found.far
    page = page_text(errors_document(found).page, everything=True)
    assert page.count("more than a twentieth of the principal distance") == len(found.far)
    assert "no solution is found" not in page
    for row in found.rejected:
        if row.name in found.kept_out:
            assert row.order == 0
            assert row.statistic is None
            assert row.error is not None
            assert row.sigma is not None
            assert abs(row.error) > 10.0 * row.sigma


@pytest.mark.slow
def test_what_is_left_out_is_said_and_applied(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    block, _ = far_block()
    folder = tmp_path / "b"
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    found = adjust(folder, errors="baarda")
    (point,) = found.to_dict()["errors"]["points_left_out"]
    assert f"point {point} is left out: it has rays far apart" in found.text()
    assert "left out with all rays" in found.text()
    many = len(found.to_dict()["errors"]["rejected"])
    assert f"{many} observations and 1 point with 2 rays are rejected after" in found.text()
    assert point in {one["name"] for one in found.to_dict()["left_out"]}
    assert main(["adjust", str(folder), "--errors", "baarda", "--apply"]) == 0
    assert "switched off" in capsys.readouterr().out
    rows = read_block(folder).image_points
    rejected = found.to_dict()["errors"]["rejected"]
    for row in rows:
        if row.point == point:
            assert (row.use, row.reason) == ("off", "baarda")
    gone = {tuple(one[key] for key in ("photo", "point", "model")) for one in rejected}
    off = {(row.photo, row.point, row.model) for row in rows if row.use != "xy"}
    assert off == gone | {(row.photo, row.point, row.model) for row in rows if row.point == point}
    # what is left has a solution, and that is the same
    again = adjust(folder).to_dict()
    assert again["sigma0"] == pytest.approx(found.to_dict()["sigma0"], rel=1e-6)
    assert main(["adjust", str(folder), "--apply-undo"]) == 4
    assert read_block(folder).image_points == block.image_points


def known_torn(kind: str, side: int) -> tuple[Block, str]:
    """Two strips; one of two rays lies beside another point, of which something is known."""
    block = planned(2)
    photos: dict[str, list[str]] = {}
    for row in block.image_points:
        photos.setdefault(row.point, []).append(row.photo)
    known = {one.point for one in block.control}
    point = next(n for n, of in photos.items() if of == ["106", "107"] and n not in known)
    rows = {(row.photo, row.point): row for row in block.image_points}
    photo = photos[point][side]
    here = rows[photo, point]
    others = [name for name, of in photos.items() if photo in of and len(of) > 2]
    other = max(others, key=lambda name: abs(rows[photo, name].y - here.y))
    beside = rows[photo, other]
    rows[photo, point] = replace(rows[photo, point], x=beside.x + 0.2, y=beside.y - 0.1)
    place = next(row.xyz for row in adjust_block(block).point_rows() if row.point == point)
    control, priors, conditions = block.control, block.priors, block.conditions
    if kind in ("height", "height free of error"):
        sigma = 0.05 if kind == "height" else 0.0
        control = (*control, ControlPoint(point, (None, None, place[2]), (None, None, sigma)))
    elif kind == "three coordinates":
        control = (*control, ControlPoint(point, place, (0.05,) * 3))
    elif kind == "weak prior":
        far = tuple(value + 300.0 for value in place)
        priors = (*priors, PointPrior(point, far, (1000.0,) * 3))
    else:
        there = next(row.xyz for row in adjust_block(block).point_rows() if row.point == other)
        long = float(np.linalg.norm(np.subtract(place, there)))
        conditions = (ObjectCondition("distance", (point, other), long, 0.05),)
    rows_now = tuple(rows.values())
    block = replace(block, image_points=rows_now, control=control, priors=priors)
    return replace(block, conditions=conditions), point


@pytest.mark.slow
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("kind", ["height", "height free of error", "weak prior", "distance"])
def test_what_does_not_tell_which_of_two_rays_is_wrong_keeps_no_point(kind: str, side: int) -> None:
    block, point = known_torn(kind, side)
    found = block_gross_errors(block, "search", ALPHA)
    assert found.points == (point,)
    assert len(found.rejected) <= 1
    assert found.block.sigma0 is not None
    assert found.block.sigma0 < 1.15
    if kind == "distance":
        reasons = [one.reason for one in found.block.problem.left_out if one.kind == "condition"]
        assert reasons == [f"names point {point}, which is not determined by the images"]


@pytest.mark.slow
def test_control_tells_which_of_two_rays_is_wrong() -> None:
    block, point = known_torn("three coordinates", 0)
    found = block_gross_errors(block, "search", ALPHA)
    assert found.points == ()
    assert ("106", point) in rays_out(found)
    assert ("107", point) not in rays_out(found)
