"""Blocks with errors so large that there is no minimum: they are adjusted, and the errors found."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bundleblocks import aerial
from grossblocks import interchanged, moved, planned

from anaplot import adjust
from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.controllast import clean_control_last
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.misfits import adjust_without_misfits
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.gaussnewton import NoConvergenceError
from anaplot.bundle.solve.problem import make_problem
from anaplot.cli import main
from anaplot.errors import NotComputableError
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block

pytestmark = pytest.mark.slow

ALPHA = SearchSettings(alpha=0.001)


def rejected(found) -> set[tuple[str | None, ...]]:
    """Photo, point, axis of image coordinates, point and axis of control."""
    return {
        (row.name[1], row.name[2], row.name[4]) if row.name[0] == "image" else row.name[1:]
        for row in found.rejected
    }


def both(photo: str, *points: str) -> set[tuple[str, str, str]]:
    return {(photo, point, axis) for point in points for axis in "xy"}


@pytest.mark.parametrize("strategy", ["baarda", "search"])
def test_interchanged_points_are_found_by_name(strategy: str) -> None:
    block = interchanged(planned(1), "104", "02-03", "03-05")
    found = block_gross_errors(block, strategy, ALPHA)
    assert re.search(r"0\d-0\d in photo 104 disagrees", found.begun.reason)
    assert found.first is None
    assert {name[1:3] for name in found.begun.left_out} == {("104", "02-03"), ("104", "03-05")}
    assert both("104", "02-03", "03-05") <= rejected(found)
    assert len(found.rejected) <= 6
    assert found.block.sigma0 < 1.2
    assert found.block.redundancy == make_problem(block).redundancy - len(found.rejected)


def test_control_a_kilometre_off_is_found() -> None:
    block = moved(planned(2), "01-01", 0, 1000.0)
    with pytest.raises(NoConvergenceError, match="control point 01-01") as refused:
        adjust_block(block)
    found = block_gross_errors(block, "search", ALPHA)
    assert f"{found.begun.reason}; {refused.value.advice}" == str(refused.value)
    assert refused.value.advice.endswith("or let --errors search begin without it")
    # what there was no solution with is looked at like all else: Y and Z have come back
    assert {name[1] for name in found.begun.left_out} == {"01-01"}
    assert ("01-01", "X") in rejected(found)
    assert {("01-01", "Y"), ("01-01", "Z")}.isdisjoint(rejected(found))
    row = next(row for row in found.rejected if row.name == ("control", "01-01", "X"))
    assert row.error == pytest.approx(1000.0, abs=4.0 * row.sigma)


def test_control_free_of_error_cannot_be_left_out() -> None:
    block = moved(planned(2, sigma=0.0), "01-01", 0, 1000.0)
    with pytest.raises(NoConvergenceError, match="control point 01-01 disagrees"):
        adjust_without_misfits(make_problem(block))


def test_additional_parameters_wait_for_what_fits() -> None:
    block = interchanged(planned(3, strips=3), "204", "04-03", "03-05")
    chosen = additional_parameters("ebner:block", 5.0)
    found = block_gross_errors(make_problem(block, additional=chosen), "search", ALPHA)
    assert found.begun.left_out
    assert found.begun.block.problem.additional is chosen
    assert found.begun.block.sigma0 < 1.2
    assert both("204", "04-03", "03-05") <= rejected(found)
    assert found.block.problem.additional is chosen


def test_what_has_a_minimum_is_adjusted_with_everything() -> None:
    block = planned(4)
    fitting = adjust_without_misfits(make_problem(block))
    assert fitting.left_out == ()
    assert fitting.reason == ""
    assert fitting.block.vtpv == adjust_block(block).vtpv


def test_where_nothing_settles_the_wild_ones_stay_out() -> None:
    # photo 101 has six points: two of them interchanged, its others hardly check each other
    block = planned(1, strips=3)
    block = interchanged(block, "101", "03-02", "01-01")
    block = interchanged(block, "104", "01-05", "03-04")
    block = interchanged(block, "103", "02-02", "02-04")
    block = moved(block, "03-05", 2, 50.0)
    found = block_gross_errors(block, "search", ALPHA)
    wild = both("104", "01-05", "03-04") | {("103", "02-04", "x"), ("03-05", "Z")}
    assert wild <= rejected(found)
    assert found.block.sigma0 < 1.2
    for row in found.rejected:
        if row.order == 0:
            assert row.statistic is None
            assert row.w == pytest.approx(row.error / row.sigma)
    if found.kept_out:
        assert found.kept_out.isdisjoint(found.names[k] for k in found.findings.rows)
        assert found.kept_out.isdisjoint(found.untestable)
        assert found.kept_out.isdisjoint(found.came_back)


def test_the_command_says_how_it_began(tmp_path: Path, capsys) -> None:
    block = interchanged(planned(1), "104", "02-03", "03-05")
    folder = tmp_path / "b"
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    assert main(["adjust", str(folder)]) == 4
    assert "disagrees" in capsys.readouterr().err
    found = adjust(folder, errors="search")
    text = found.text()
    assert "the search began without" in text
    assert "no solution found" in text
    answer = found.to_dict()["errors"]
    assert answer["sigma0_before"] is None
    assert answer["redundancy_before"] is None
    assert {(row["photo"], row["point"]) for row in answer["begun_without"]} == {
        ("104", "02-03"),
        ("104", "03-05"),
    }
    assert "disagrees" in answer["no_solution"]


def test_a_wild_prior_is_named_and_rejected_alone() -> None:
    scene = aerial(3, 4, per_base=2, noise_um=5.0, control_sigma=0.05, priors=True, seed=3)
    photos = list(scene.block.photos)
    x, y, z = photos[4].position
    photos[4] = replace(photos[4], position=(x + 20_000.0, y, z))
    block = replace(scene.block, photos=tuple(photos))
    found = block_gross_errors(block, "search", ALPHA)
    assert "the stated position of photo 201 disagrees" in found.begun.reason
    assert {name[:2] for name in found.begun.left_out} == {("prior", "201")}
    assert ("prior", "201", "X") in {row.name for row in found.rejected}
    assert not {("prior", "201", axis) for axis in "YZ"} & {row.name for row in found.rejected}
    assert found.block.sigma0 < 1.2


def test_step_by_step_begins_without_what_fits_nowhere() -> None:
    # without control, strips that share a line of points only would turn about it
    block = interchanged(planned(1, strips=3, sidelap=0.60), "104", "03-03", "01-05")
    block = moved(block, "02-05", 2, 30.0)
    steps = clean_control_last(block, "search", ALPHA)
    assert steps.images.first is None
    assert both("104", "03-03", "01-05") <= rejected(steps.images)
    assert ("02-05", "Z") in rejected(steps.control)
    assert steps.block.sigma0 < 1.2


def test_a_ray_to_control_free_of_error_is_blamed_not_the_control() -> None:
    block = interchanged(planned(3, strips=1, photos=4, sigma=0.0), "101", "01-01", "01-02")
    assert any(c.point == "01-01" and None not in c.xyz for c in block.control)
    fitting = adjust_without_misfits(make_problem(block))
    assert fitting.reason
    assert {name[1:3] for name in fitting.left_out} == {("101", "01-01"), ("101", "01-02")}
    assert fitting.block.sigma0 < 1.3


def test_what_was_rejected_before_stays_out_beside_what_fits_nowhere() -> None:
    problem = make_problem(interchanged(planned(1), "104", "02-03", "03-05"))
    at = {(problem.photos[p], problem.points[q]): k
          for k, (p, q) in enumerate(zip(problem.photo, problem.point, strict=True))}  # fmt: skip
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    # of a point of which nothing is far off, and of one of the points that are interchanged
    before = [at["103", "01-04"], at["103", "02-03"]]
    rejected[before] = True
    fitting = adjust_without_misfits(replace(problem, rejected=rejected))
    assert {name[1:3] for name in fitting.left_out} == {("104", "02-03"), ("104", "03-05")}
    left = fitting.block.problem.rejected
    assert left[before].all()
    assert left.sum() == 4 + len(fitting.left_out)


def test_strips_that_turn_about_a_line_are_no_free_network() -> None:
    told = (
        "without control, as a free network: block .* not determined: photos 201, .* movement open"
    )
    with pytest.raises(NotComputableError, match=told):
        clean_control_last(planned(1), "search", ALPHA)
