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
from anaplot.bundle.errors import misfits
from anaplot.bundle.errors.grosserrors import BlockFindings, block_gross_errors
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.remade import laid_out_again
from anaplot.bundle.solve.selection import FAR_APART
from anaplot.bundle.start.pointknowledge import equations_knowing
from anaplot.bundle.start.robust import FarOff
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
def test_points_that_are_left_out_stay_out_in_a_block_with_other_rows() -> None:
    # rows were compared one by one: of a block with fewer of them that was a traceback
    block = planned(1, strips=3)
    first, *_, last = dict.fromkeys(row.point for row in block.image_points)
    problem = make_problem(block, undetermined={first: FAR_APART, last: FAR_APART})
    fewer = [row for k, row in enumerate(block.image_points) if row.point in (first, last) or k % 9]
    assert len(fewer) < len(block.image_points)
    anew = laid_out_again(problem, replace(block, image_points=tuple(fewer)))
    assert {first, last}.isdisjoint(anew.points)
    # of one a row has changed: it is looked at again
    at = next(k for k, row in enumerate(fewer) if row.point == last)
    fewer[at] = replace(fewer[at], x=fewer[at].x + 0.01)
    anew = laid_out_again(problem, replace(block, image_points=tuple(fewer)))
    assert first not in anew.points
    assert last in anew.points


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


def known_torn(kind: str, side: int, seen: tuple[str, str] = ("106", "107")) -> tuple[Block, str]:
    """Two strips; one of two rays lies beside another point, of which something is known."""
    block = planned(2)
    photos: dict[str, list[str]] = {}
    for row in block.image_points:
        photos.setdefault(row.point, []).append(row.photo)
    known = {one.point for one in block.control}
    point = next(n for n, of in photos.items() if tuple(of) == seen and n not in known)
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
    elif kind == "prior":
        far = tuple(value + 10.0 for value in place)
        priors = (*priors, PointPrior(point, far, (20.0,) * 3))
    elif kind == "plan":
        control = (*control, ControlPoint(point, (*place[:2], None), (0.05, 0.05, None)))
    else:
        sigma = 1e4 if kind == "weak distances" else 0.05
        there = {row.point: row.xyz for row in adjust_block(block).point_rows()}
        ends = [name for name in there if len(photos[name]) > 2][:2]
        for name in [other] if kind == "distance" else ends:
            long = float(np.linalg.norm(np.subtract(place, there[name])))
            conditions += (ObjectCondition("distance", (point, name), long, sigma),)
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
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("kind", ["prior", "plan", "distances", "weak distances"])
def test_a_torn_point_of_which_too_little_is_known_is_left_out(kind: str, side: int) -> None:
    block, point = known_torn(kind, side, ("201", "202"))
    found = block_gross_errors(block, "search", ALPHA)
    assert found.points == (point,)
    assert found.rejected == ()
    assert found.block.sigma0 is not None
    assert found.block.sigma0 < 1.15


def test_knowledge_is_as_sharp_as_the_rays_are_long() -> None:
    """At a point; a ray of another point misses by a twentieth of them."""
    block = planned(2)
    found = adjust_block(block)
    problem, state = found.problem, found.state
    known = {one.point for one in block.control}
    at = next(k for k, name in enumerate(problem.points) if name not in known)
    point, mine = problem.points[at], problem.photo[problem.point == at]
    long = float(np.linalg.norm(state.points[at] - state.centres[mine], axis=1).mean())

    def knows(sigma: float, kind: str = "", nearer: float = 1.0) -> int:
        centre = state.centres[mine].mean(axis=0)
        points = state.points.copy()
        points[at] = centre + nearer * (points[at] - centre)
        if not kind:
            place = tuple(points[at] + state.origin)
            changed = replace(block, priors=(*block.priors, PointPrior(point, place, (sigma,) * 3)))
        else:
            others = [name for name in problem.points if name in known][:2]
            names = (point, *others[: 1 + (kind == "angle")])
            value = 1.0 if kind == "angle" else long
            one = ObjectCondition(kind, names, value, sigma)  # type: ignore[arg-type]
            changed = replace(block, conditions=(one,))
        made = make_problem(changed)
        assert made.points == problem.points
        return int(equations_knowing(made, replace(state, points=points))[at])

    assert knows(0.004 * long) == 3
    assert knows(0.006 * long) == 0
    assert knows(0.004 * long, nearer=0.3) == 0
    assert knows(0.05, "distance") == 1
    assert knows(0.006 * long, "distance") == 0
    assert knows(1e-5, "angle") == 1
    assert knows(0.5, "angle") == 0


@pytest.mark.slow
def test_one_ray_to_control_free_of_error_is_wrong_and_not_the_control() -> None:
    block = planned(2)
    point = block.control[0].point
    firm = ControlPoint(point, block.control[0].xyz, (0.0,) * 3)
    photo = next(row.photo for row in block.image_points if row.point == point)
    rows = [row for row in block.image_points if row.point != point or row.photo == photo]
    rows = [replace(row, x=row.x + 30.0) if row.point == point else row for row in rows]
    changed = replace(block, image_points=tuple(rows), control=(firm, *block.control[1:]))
    found = block_gross_errors(changed, "search", ALPHA)
    assert found.points == ()
    assert {name[1:3] for name in (row.name for row in found.rejected)} == {(photo, point)}
    assert found.block.sigma0 is not None
    assert found.block.sigma0 < 1.2
    # and where the block has no minimum with it
    problem = make_problem(changed)
    state = adjust_block(block).state
    assert problem.points == adjust_block(block).problem.points
    count = len(problem.points)
    rays = np.zeros(len(problem.photo), dtype=bool)
    off = FarOff(
        state,
        rays,
        problem.fixed.all(axis=1),
        np.zeros((len(problem.photos), 2), dtype=bool),
        np.zeros(count, dtype=bool),
        1.0,
    )
    believed = misfits._control_believed(problem, off)
    assert believed is not None
    assert not believed.control.any()
    assert np.flatnonzero(believed.rays).tolist() == [
        int(np.flatnonzero(problem.point == problem.points.index(point))[0])
    ]
    smaller = misfits._without(problem, believed)
    assert not misfits._far_apart(smaller, believed).any()


@pytest.mark.slow
def test_control_tells_which_of_two_rays_is_wrong() -> None:
    block, point = known_torn("three coordinates", 0)
    found = block_gross_errors(block, "search", ALPHA)
    assert found.points == ()
    assert ("106", point) in rays_out(found)
    assert ("107", point) not in rays_out(found)
