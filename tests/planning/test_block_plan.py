"""Planned aerial blocks: their geometry, their classes, the command."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anaplot.bundle.adjust import adjust_block
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.planning.blockplan import (
    BlockPlan,
    class_table,
    expected_accuracy,
    plan_block,
    weak_photos,
)


@pytest.mark.slow
@settings(max_examples=25)
@given(
    st.integers(1, 4),
    st.integers(2, 6),
    st.sampled_from([0.6, 0.7, 0.8]),
    st.floats(0.15, 0.65),
    st.sampled_from([3, 5]),
    st.floats(0.5, 6.0),
    st.booleans(),
    st.integers(0, 3),
)
def test_any_plan_is_a_block(strips, photos, overlap, sidelap, side, bridging, twin, cross) -> None:
    plan = BlockPlan(
        strips, photos, overlap, sidelap, side, bridging=bridging, twin=twin, cross_strips=cross
    )
    made = plan_block(plan)
    names = [c.point for c in made.block.control]
    assert len(set(names)) == len(names)
    assert set(names) <= set(made.points)
    block = made.evaluated()
    assert set(made.points) >= set(block.problem.points)
    rows = class_table(block)
    assert sum(row.number for row in rows) == 2 * len(block.problem.photo)
    total = sum(row.number * row.r for row in rows)
    assert total == pytest.approx(block.redundancy, abs=1e-6)
    for row in rows:
        assert 0.0 <= row.low <= row.mean + 1e-12
        assert row.mean <= row.high + 1e-12
    weak = weak_photos(block)
    assert np.all(np.diff([p.mean_r for p in weak]) > -1e-8)
    assert {p.photo for p in weak} == set(block.problem.photos)
    np.testing.assert_allclose(block.v, 0.0, atol=1e-6)


def test_standard_points_lie_on_axes_and_in_overlaps() -> None:
    for sidelap, side, per_photo in ((0.2, 3, 9), (0.3, 3, 9), (0.3, 5, 15), (0.6, 5, 25)):
        made = plan_block(BlockPlan(3, 5, 0.6, sidelap, side, control="none"))
        seen = {row.point for row in made.block.image_points if row.photo == "203"}
        rows = 3 if side == 3 else 5
        assert len(seen) == (per_photo if side == 3 else 5 * rows)


@pytest.mark.slow
def test_photos_of_long_strips_keep_their_own_names() -> None:
    made = plan_block(BlockPlan(11, 101, control="corners"))
    names = [photo for strip in made.block.strips for photo in strip.photos]
    assert len(set(names)) == len(names) == len(made.stations) == 11 * 101


def test_twins_stand_nearer_to_the_middle() -> None:
    made = plan_block(BlockPlan(2, 6, bridging=2.0, twin=True))
    middle = np.mean([station.centre[0] for station in made.stations.values()])
    pairs = [(at, made.points[f"{name}t"]) for name, at in made.points.items()
             if f"{name}t" in made.points]  # fmt: skip
    assert len({at[0] for at, _ in pairs}) == 4
    for at, twin in pairs:
        assert abs(twin[0] - middle) < abs(at[0] - middle)


def test_twins_cross_strips_and_denser_control_help() -> None:
    plan = BlockPlan(3, 5, bridging=4)

    def mean_r(plan: BlockPlan) -> float:
        rows = class_table(plan_block(plan).evaluated())
        return float(np.average([r.r for r in rows], weights=[r.number for r in rows]))

    def worst(plan: BlockPlan) -> float:
        accuracy = expected_accuracy(plan_block(plan).evaluated())
        assert accuracy is not None
        return max(accuracy.largest)

    dense, crossed = replace(plan, bridging=1), replace(plan, cross_strips=2)
    assert mean_r(replace(plan, twin=True)) > mean_r(plan)
    assert worst(dense) < worst(plan)
    assert mean_r(crossed) > mean_r(plan)
    assert worst(crossed) < worst(plan)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"photos": 1}, "at least one strip of at least two photos"),
        ({"overlap": 0.4}, "overlap 40 %"),
        ({"sidelap": 0.05}, "side lap 5 %"),
        ({"cross_strips": 9}, "cross strips 9: along 5 photos there is room for 5, one a base"),
        ({"bridging": 0.0}, "bridging distance"),
        ({"bridging": 5e-324}, "bridging distance"),
        ({"strips": 20, "photos": 50, "bridging": 0.06}, "more than 10000 control points"),
        ({"strips": 1000, "photos": 2, "cross_strips": 100}, "more than 2500 photos"),
        ({"strips": 100, "photos": 100}, "more than 2500 photos"),
    ],
)
def test_impossible_plans_are_refused(change, said) -> None:
    with pytest.raises(InputError, match=said):
        plan_block(replace(BlockPlan(3, 5), **change))


@pytest.mark.slow
@pytest.mark.parametrize("control", ["corners", "none"])
def test_strips_that_turn_about_one_line_of_points_are_told_what_holds_them(
    control, capsys
) -> None:
    call = ["plan", "block", "--strips", "2", "--photos", "3", "--control", control]
    # warnings are errors here: a point in the plane of a projection centre gave some
    assert main(call) == 4
    [said] = capsys.readouterr().err.splitlines()
    assert "not determined" in said
    assert "and they turn about it; control perimeter, a cross strip or a side lap" in said
    for held in (["--cross-strips", "1"], ["--sidelap", "50"]):
        assert main([*call, *held]) == 0


@pytest.mark.slow
def test_a_folder_without_control_has_the_unit_of_the_plan(tmp_path: Path, capsys) -> None:
    folder = tmp_path / "block"
    call = ["plan", "block", "--strips", "2", "--photos", "4", "--sidelap", "60"]
    assert main([*call, "--control", "none", "--json", "--to", str(folder)]) == 0
    planned = json.loads(capsys.readouterr().out)["indicators"]
    found = adjust_block(read_block(folder), datum="free").indicators()
    assert (found.ai_x, found.ai_y, found.ai_z) == pytest.approx(
        (planned["ai_x"], planned["ai_y"], planned["ai_z"]), rel=1e-6
    )


@pytest.mark.slow
def test_the_command_and_the_folder(tmp_path: Path, capsys) -> None:
    folder, table = tmp_path / "block", tmp_path / "classes.csv"
    call = ["plan", "block", "--strips", "2", "--photos", "4", "--twin", "--control-m", "0.02"]
    assert main([*call, "--json", "--to", str(folder), "--csv", str(table)]) == 0
    answer = json.loads(capsys.readouterr().out)
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(answer["classes"])
    assert [float(r["mean_root"]) for r in rows] == [c["mean"] for c in answer["classes"]]
    # what is written is what was planned, also when it is adjusted from nothing
    block = adjust_block(read_block(folder))
    assert block.redundancy == answer["redundancy"]
    assert block.indicators().ri == pytest.approx(answer["indicators"]["ri"], abs=1e-9)
    assert {c.sigma for c in block.problem.block.control} == {(0.02,) * 3}
    assert main([*call, "--to", str(folder)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(call) == 0
    out = capsys.readouterr().out
    assert "WEAK PHOTOS" in out
    assert max(len(line) for line in out.splitlines()) <= 80
    # strips that overlap in one line of points may turn about it: said, not hidden
    assert main(["plan", "block", "--control", "none"]) == 4
    assert "leave a movement open" in capsys.readouterr().err
    assert main(["plan", "block", "--control", "none", "--sidelap", "60", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["accuracy_m"]["rms"][0] > 0.0


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (["--control-m", "1e-300"], "--control-m: '1e-300' is neither 0 nor from 1e-09 to 1e+06"),
        (["--control-m", "-1"], "--control-m: '-1' is neither 0 nor"),
        (["--image-um", "1e-150"], "--image-um: '1e-150' is no number from 0.001 to 1e+06"),
        (["--c", "1e-150"], "--c: '1e-150' is no number from 0.001 to 1e+06"),
        (["--format", "inf"], "--format: 'inf' is no number from 0.001 to 1e+06"),
        (["--scale", "nan"], "--scale: 'nan' is no number from 0.001 to 1e+06"),
        (["--sidelap", "0"], "side lap 0 %: strips join from 10 %, and 90 % are plenty"),
        (["--overlap", "0"], "overlap 0 %: models join from 55 %, and 90 % are plenty"),
        (["--twin", "--control", "none"], "--twin goes with control"),
        (["--bridging", "2", "--control", "none"], "--bridging goes with --control perimeter"),
        (["--bridging", "2", "--control", "corners"], "--bridging goes with --control perimeter"),
    ],
)
def test_options_out_of_their_limits_are_refused(capsys, option, said) -> None:
    assert main(["plan", "block", *option]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("zero", ["0", "0.0", "00", "0e0"])
def test_control_free_of_error_is_any_zero(capsys, zero) -> None:
    call = ["plan", "block", "--strips", "2", "--photos", "3", "--json", "--control-m", zero]
    assert main(call) == 0
    assert json.loads(capsys.readouterr().out)["observations"] > 0


@pytest.mark.parametrize(
    "option",
    [
        ["--control-m", "1e-9"],
        ["--image-um", "1e-3"],
        ["--image-um", "1e6"],
        ["--c", "1e-3"],
        ["--scale", "1e-3"],
    ],
)
def test_the_limits_themselves_can_be_planned(option) -> None:
    assert main(["plan", "block", "--strips", "2", "--photos", "3", "--json", *option]) == 0


@pytest.mark.slow
def test_the_report_keeps_to_a_page_and_loses_nothing(capsys) -> None:
    call = ["plan", "block", "--strips", "2", "--photos", "12", "--twin", "--cross-strips", "2"]
    more = ["--scale", "123456.7", "--c", "152.67", "--bridging", "2.5", "--image-um", "1e6"]
    assert main([*call, *more, "--overlap", "67.5", "--sidelap", "33.3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    head = next(k for k, line in enumerate(lines) if line.startswith("  rays"))
    names = lines[head].split()
    assert main(["plan", "block"]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = lines[head + 1 : lines.index("", head)]
    assert (
        "  2     outer  -        x        12  0.00  0.00  0.00  0.000        -         12" in rows
    )
    # two headings are two words
    assert {len(row.split()) for row in rows} == {len(names) - 3, len(names) - 2}


def test_one_strip_and_one_base_are_not_several(capsys) -> None:
    assert main(["plan", "block", "--strips", "1", "--photos", "4", "--bridging", "1"]) == 0
    out = capsys.readouterr().out
    assert "PLANNED BLOCK: 1 strip of 4 photos, " in out
    assert "bridging 1 base\n" in out
