"""`anaplot adjust --test-set` and `--function`, as one types them."""

from __future__ import annotations

import json
import shutil

import pytest
from test_adjust_errors import make

from anaplot.cli import main
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    block = make(error_mm=0.3)
    folder = tmp_path_factory.mktemp("sets") / "block"
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    (folder / "distances.csv").write_text("from,to,distance,sigma\np6,p12,700,500\n")
    (folder / "sets.csv").write_text(
        "set,photo,point,axis,condition,share\n"
        "both,11,p8,y,,1\nboth,15,p8,y,,-1\n"
        "ground,,p0,X,,\nground,,p0,Y,,\n"
        "known,,,,distances.csv:2,\n"
    )
    return folder


def test_control_and_prior_of_a_point_are_tested_each_by_itself(folder, tmp_path, capsys) -> None:
    block = shutil.copytree(folder, tmp_path / "block")
    control = (block / "control.csv").read_text()
    first = next(line for line in control.splitlines() if line.startswith("p0,"))
    x, y, z = first.split(",")[1:4]
    (block / "control.csv").write_text(control + f"p0,{x},{y},{z},0.5,0.5,0.5,prior\n")
    (block / "sets.csv").write_text(
        "set,point,axis,use\nground,p0,X,\nbefore,p0,X,prior\nall,p0,,prior\n"
    )
    assert main(["adjust", str(block), "--test-set", str(block / "sets.csv"), "--json"]) == 0
    sets = {one["set"]: one for one in json.loads(capsys.readouterr().out)["test_sets"]}
    assert [sets[name]["dimension"] for name in ("ground", "before", "all")] == [1, 1, 3]
    kinds = [{row["kind"] for row in sets[name]["observations"]} for name in ("ground", "before")]
    assert kinds == [{"control"}, {"point prior"}]


def test_sets_and_functions_are_told(folder, capsys) -> None:
    arguments = ["adjust", str(folder), "--test-set", "ray:11:p8", "--test-set", "point:p7"]
    arguments += ["--test-set", "photo:13", "--test-set", str(folder / "sets.csv")]
    arguments += ["--function", "distance p6 p12", "--function", "centre p6 p7 p8"]
    assert main([*arguments, "--json"]) == 0
    got = json.loads(capsys.readouterr().out)
    sets = {one["set"]: one for one in got["test_sets"]}
    assert list(sets) == ["ray:11:p8", "point:p7", "photo:13", "both", "ground", "known"]
    wrong = sets["ray:11:p8"]
    assert wrong["rejected"]
    assert wrong["dimension"] == 2
    estimated = {row["axis"]: row["estimated"] for row in wrong["observations"]}
    assert estimated["y"] == pytest.approx(300.0, abs=30.0)
    assert not sets["photo:13"]["rejected"]
    assert sets["photo:13"]["undetectable"] >= 6
    assert (sets["both"]["dimension"], sets["ground"]["dimension"]) == (1, 2)
    assert sets["known"]["observations"][0]["id"] == "distances.csv:2"
    # several things suspected at once: each is found with less power than alone
    powers = [one["power"] for one in sets.values()]
    assert all(0.0 < power < 0.80 for power in powers)
    distance, *centre = got["functions"]
    assert distance["function"] == "distance p6 p12"
    assert [row["axis"] for row in centre] == ["X", "Y", "Z"]
    assert all(row["s"] > 0.0 and row["effect"] > 0.0 and row["by"] for row in got["functions"])
    assert main(arguments) == 0
    text = capsys.readouterr().out
    lines = [line.split() for line in text.splitlines()]
    row = next(line for line in lines if line[:1] == ["ray:11:p8"])
    assert row[-1] == "REJECTED"
    assert any(line[:3] == ["distance", "p6", "p12"] for line in lines)
    assert "directions of its errors: checked by nothing" in text


def test_axes_separate_the_rows_of_a_condition(folder, tmp_path, capsys) -> None:
    other = tmp_path / "block"
    shutil.copytree(folder, other)
    (other / "conditions.csv").write_text("kind,points,value,sigma\nline,p6 p7 p8,,500\n")
    path = tmp_path / "line.csv"
    path.write_text(
        "set,condition,point,axis\nlevel,conditions.csv:2,,across\none,conditions.csv:2,p7,up\n"
        "known,distances.csv:2,,distance\n"
    )
    assert main(["adjust", str(other), "--test-set", str(path), "--json"]) == 0
    sets = {one["set"]: one for one in json.loads(capsys.readouterr().out)["test_sets"]}
    assert [row["axis"] for row in sets["level"]["observations"]] == ["across"] * 3
    assert len(sets["one"]["observations"]) == len(sets["known"]["observations"]) == 1


@pytest.mark.parametrize(
    ("row", "what"),
    [
        ("a,11,,,distances.csv:2", "photo: not with a condition"),
        ("a,,p6,across,", "across is of a condition, and none is given"),
    ],
)
def test_rows_that_contradict_themselves_are_refused(folder, tmp_path, row, what, capsys) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(f"set,photo,point,axis,condition\n{row}\n")
    assert main(["adjust", str(folder), "--test-set", str(path)]) == 2
    said = capsys.readouterr().err
    assert "bad.csv line 2" in said
    assert what in said


@pytest.mark.parametrize(
    ("option", "value", "what"),
    [
        ("--test-set", "point:p99", "no point 'p99' is adjusted"),
        ("--test-set", "ray:11", "no ray '11' is adjusted"),
        ("--test-set", "nowhere.csv", "nowhere.csv"),
        ("--function", "area p6 p7 p8", "no 'area'"),
        ("--function", "", "no ''"),
        ("--function", "distance p6", "distance of 1 points, 2 are needed"),
        ("--function", "height p6 p6", "a point twice"),
        ("--function", "centre p6 p99", "no adjusted point 'p99'"),
    ],
)
def test_what_is_not_there_is_refused_in_a_line(folder, option, value, what, capsys) -> None:
    assert main(["adjust", str(folder), option, value]) == 2
    said = capsys.readouterr().err
    assert what in said
    assert said.count("\n") == 1
