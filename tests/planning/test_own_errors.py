"""Errors planted in geometries of one's own."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anaplot.adjustment.strategies import STRATEGIES
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.planning.modelscenarios import model_rows
from anaplot.planning.montecarlo import simulate
from anaplot.planning.ownerrors import OwnErrors
from anaplot.report import output
from anaplot.report.owngeometry import ModelOptions, own_scenario
from anaplot.report.ownplaces import RowName, rows_in
from anaplot.shares.local import LocalProcesses

pytestmark = pytest.mark.slow

# a table's header may have blanks
NETWORK = """
format = 1
name = "pier"
[[camera]]
id = "cam"
c = 50.0
[[ station ]]
id = "s1"
camera = "cam"
position = [10.0, 0.0, 0.0]
look_at = [0.0, 0.0, 0.0]
[[ station ]]
id = "s2"
camera = "cam"
position = [8.0, 6.0, 0.0]
look_at = [0.0, 0.0, 0.0]
[[ station ]]
id = "s3"
camera = "cam"
position = [8.0, -6.0, 2.0]
look_at = [0.0, 0.0, 0.0]
""" + "".join(
    f'[[point]]\nid = "p{k}"\nposition = [{k % 3 - 1.0}, {k // 3 - 1.0}, {k % 2 + 0.3 * k}]\n'
    for k in range(9)
)

QUICK = ["--runs", "40", "--processes", "1", "--json"]


def simulated(capsys, *call: str) -> dict[tuple[str, str, str], float]:
    assert main(["plan", "simulate", *call, *QUICK]) == 0
    found = json.loads(capsys.readouterr().out)["figures"]
    return {(f["case"], f["method"], f["quantity"]): f["mean"] for f in found}


def test_every_strategy_finds_one_large_error_in_a_good_pattern(capsys) -> None:
    quick = [method for method in STRATEGIES if method != "odds"]
    found = simulated(
        capsys, "13/5", "--errors", "0,1", "--size", "20", "--strategy", ",".join(quick)
    )
    for method in quick:
        assert found["no error", method, "wrong"] < 0.3
        assert found["1 of 20 sigma", method, "right"] > 0.95
        key = ("1 of 20 sigma", method)
        assert found[(*key, "right")] + found[(*key, "missed")] == pytest.approx(1.0)


def test_places_keep_the_errors_where_they_are_wanted(capsys) -> None:
    # in the cube A nothing checks the x coordinates of new points
    blind = simulated(
        capsys,
        "cube:A",
        "--size",
        "30",
        "--place",
        "point:2",
        "--place",
        "x",
        "--strategy",
        "search",
    )
    assert blind["1 of 30 sigma", "search", "right"] == 0.0
    seen = simulated(capsys, "cube:E", "--size", "30", "--place", "point:2", "--strategy", "search")
    assert seen["1 of 30 sigma", "search", "right"] > 0.9


def test_places_of_one_kind_add_up_and_kinds_narrow_down(capsys) -> None:
    names = [RowName(f, p, a) for f in ("1", "2") for p in ("2", "3") for a in "xy"]
    names.append(RowName(None, "3", "X"))

    def chosen(*places: str) -> list[tuple[str | None, ...]]:
        return [tuple(names[k]) for k in np.flatnonzero(rows_in(names, places))]

    assert len(chosen()) == len(names)
    assert chosen("1", "3", "x") == [("1", "3", "x")]
    assert chosen("3", "X") == [(None, "3", "X")]
    assert len(chosen("1", "photo:2")) == 8
    assert chosen("photo:2", "axis:y") == [("2", "2", "y"), ("2", "3", "y")]
    with pytest.raises(InputError, match="'2' is a photo and a point"):
        rows_in(names, ["2"])


def test_a_block_a_pattern_file_and_a_network_file(tmp_path: Path, capsys) -> None:
    block = tmp_path / "block"
    assert main(["plan", "block", "--strips", "2", "--photos", "3", "--to", str(block)]) == 0
    capsys.readouterr()
    points = tmp_path / "points.csv"
    points.write_text("label,x,y\n" + "".join(
        f"p{k},{x},{y}\n" for k, (x, y) in enumerate((x, y) for x in (0, 45, 90)
                                                     for y in (-90, -30, 30, 90))))  # fmt: skip
    for source in (str(block), str(points)):
        found = simulated(capsys, source, "--size", "25", "--strategy", "baarda,search")
        assert {method for _, method, _ in found} == {"baarda", "search"}
        assert found["1 of 25 sigma", "search", "right"] > 0.3


@pytest.mark.long
def test_the_search_is_better_than_stepwise_rejection_with_many_errors() -> None:
    rows = model_rows("15/5")
    own = OwnErrors(
        "own",
        "",
        rows.matrix,
        tuple(range(len(rows.matrix))),
        np.sqrt(rows.matrix.diagonal()),
        (4,),
        (12.0,),
        rows.testable,
        methods=("baarda", "search"),
    )
    tally = simulate(own, runs=150, seed=5)
    case = "4 of 12 sigma"
    for quantity in ("right", "exactly the errors"):
        assert tally[case, "search", quantity].total >= tally[case, "baarda", quantity].total
    # the same in processes of their own, to which the geometry is sent
    small = replace(own, chunk=10, methods=("baarda",))
    assert simulate(small, runs=30, seed=5, place=LocalProcesses(2)) == simulate(
        small, runs=30, seed=5
    )


def test_what_belongs_to_another_geometry_is_not_taken(tmp_path: Path, capsys) -> None:
    kept = tmp_path / "kept.jsonl"
    call = ["plan", "simulate", "13/5", *QUICK, "--strategy", "baarda", "--to", str(kept)]
    assert main(call) == 0
    assert main(call) == 0
    assert main([*call, "--size", "7"]) == 2
    assert "belongs to another simulation: sizes is" in capsys.readouterr().err


def test_chunks_of_large_geometries_are_small() -> None:
    def chunk(source: str) -> int:
        return own_scenario(
            source,
            numbers=(1,),
            sizes=(6.0,),
            places=(),
            alpha=0.001,
            known=(),
            model=ModelOptions(),
        ).chunk

    assert chunk("13/5") == 50
    assert chunk("cube:E") == 5_000 // 216


def test_what_a_pattern_leaves_open_is_given_and_said(tmp_path: Path, capsys) -> None:
    kept = tmp_path / "kept.jsonl"
    call = ["plan", "simulate", "9/3", "--strategy", "baarda", "--to", str(kept), *QUICK]
    assert main(call) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["settings"] == {
        "base_mm": 90.0, "d_mm": 100.0, "c_mm": 152.0, "tie_variance": "exact"
    }  # fmt: skip
    assert main([*call, "--base", "90", "--d", "100", "--tie-variance", "exact"]) == 0
    capsys.readouterr()
    assert main([*call, "--base", "70"]) == 2
    assert "base_mm is 90.0, asked is 70.0" in capsys.readouterr().err
    quick = ["--runs", "2", "--processes", "1", "--strategy", "baarda"]
    assert main(["plan", "simulate", "9/3", "--c", "88", "--tie-variance", "paper", *quick]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "base 90 mm, d 100 mm, c 88 mm, tie variance paper" in said


def test_the_redundancy_numbers_are_those_of_plan_pattern(capsys) -> None:
    options = ["--base", "80", "--d", "95", "--c", "120"]
    assert main(["plan", "pattern", "9/3", *options, "--tie-variance", "propagated", "--json"]) == 0
    planned = [row["redn"] for row in json.loads(capsys.readouterr().out)["rows"]]
    own = own_scenario(
        "9/3",
        numbers=(1,),
        sizes=(6.0,),
        places=(),
        alpha=0.001,
        known=(),
        model=ModelOptions(80.0, 95.0, 120.0, "propagated"),
    )
    assert np.diag(own.matrix) == pytest.approx(planned)


def test_the_spelling_of_a_path_does_not_matter(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "block", "--strips", "2", "--photos", "3", "--to", "b1"]) == 0
    for source in ("b1", "b1/", "./b1", str(tmp_path / "b1")):
        capsys.readouterr()
        call = ["plan", "simulate", source, "--strategy", "baarda", "--to", "kept.jsonl", *QUICK]
        assert main(call) == 0, capsys.readouterr().err
        assert json.loads(capsys.readouterr().out)["scenario"] == "b1"


def test_what_plan_makes_and_reads_is_taken(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    free = ["--strips", "2", "--photos", "3", "--sidelap", "60", "--control", "none"]
    assert main(["plan", "block", *free, "--to", "b3"]) == 0
    Path("net.toml").write_text(NETWORK, encoding="utf-8")
    capsys.readouterr()
    for source, datum in (("b3", "free"), ("net.toml", "free"), ("cube", "control")):
        call = ["plan", "simulate", source, "--strategy", "baarda,modified", *QUICK]
        assert main(call) == 0, capsys.readouterr().err
        answer = json.loads(capsys.readouterr().out)
        assert answer["settings"] == {"datum": datum}
        assert {f["method"] for f in answer["figures"]} == {"baarda", "modified"}
        assert ("no control and no priors, free datum" in answer["about"]) == (datum == "free")
    assert answer["scenario"] == "cube:A"


def test_on_a_pattern_modified_decides_as_baarda_does(capsys) -> None:
    found = simulated(capsys, "13/5", "--size", "12", "--strategy", "baarda,modified")
    kinds = {(case, quantity) for case, _, quantity in found}
    assert kinds
    for case, quantity in kinds:
        assert found[case, "modified", quantity] == found[case, "baarda", quantity]
    assert found["1 of 12 sigma", "modified", "right"] > 0.3


def test_a_table_that_cannot_be_written_is_refused_beforehand(tmp_path: Path, capsys) -> None:
    points = tmp_path / "points.csv"
    points.write_text("label,x,y\n" + "".join(
        f"p{k},{45 * (k % 3)},{60 * (k // 3) - 90}\n" for k in range(12)))  # fmt: skip
    before = points.read_bytes()
    kept = tmp_path / "kept.jsonl"
    call = ["plan", "simulate", str(points), "--strategy", "baarda", *QUICK, "--to", str(kept)]
    for target, said in (
        (tmp_path / "none" / "t.csv", "there is no folder"),
        (points / "t.csv", "there is no folder"),
        (tmp_path, "it is a folder"),
        (tmp_path / "x" / ".." / "points.csv", "is read"),
        (kept, "keeps the runs"),
    ):
        assert main([*call, "--csv", str(target)]) == 2
        out, error = capsys.readouterr()
        assert not out
        assert said in error
        assert len(error.splitlines()) == 1
        assert not kept.exists()
    assert points.read_bytes() == before


def test_the_report_is_not_lost_with_the_table(tmp_path: Path, capsys, monkeypatch) -> None:
    def full(path: Path, data: bytes) -> None:
        raise InputError(f"{path}: cannot be written: no space left")

    monkeypatch.setattr(output, "replace_whole", full)
    table = tmp_path / "t.csv"
    call = ["plan", "simulate", "13/5", "--strategy", "baarda", *QUICK, "--csv", str(table)]
    assert main(call) == 2
    out, error = capsys.readouterr()
    assert json.loads(out)["figures"]
    assert error == f"anaplot: {table}: cannot be written: no space left\n"


def test_one_run_and_one_row_are_not_several(capsys) -> None:
    call = ["plan", "simulate", "13/5", "--place", "1", "--place", "y", "--strategy", "baarda"]
    assert main([*call, "--runs", "1", "--errors", "1"]) == 0
    out = capsys.readouterr().out
    assert "\n1 run, seed 0\n" in out
    assert ", 1 row in which errors are planted\n" in out
    assert main([*call, "--errors", "2"]) == 2
    assert "2 errors, but only 1 row to put them in" in capsys.readouterr().err


def test_refusals(tmp_path: Path, capsys) -> None:
    points = tmp_path / "points.csv"
    points.write_text("label,x,y\n1,0,0\n", encoding="utf-8")
    for call, said in (
        (["13/6"], "'13/6' is no scenario"),
        (["cube:Z"], "no cube 'Z'"),
        (["13/5", "--place", "nowhere"], "no row lies in 'nowhere': name a point or axis"),
        (["13/5", "--place", "photo:1"], "no row lies in photo '1'"),
        (["cube:C", "--place", "3"], "'3' is a photo and a point: write 'photo:3' or 'point:3'"),
        (["13/5", "--place", "x", "--place", "9"], "no row lies in 'x' and '9' together"),
        (["13/5", "--errors", "19"], "19 errors, but only 18 rows"),
        (["size-models", "--size", "3"], "--size goes with a pattern"),
        (["size-models", "--base", "80"], "--base goes with a pattern of your own"),
        (["cube:A", "--tie-variance", "paper"], "--tie-variance goes with a pattern"),
        ([str(points), "--d", "90"], "--d goes with a named pattern"),
        (["13/5", "--strategy", "modest"], "13/5 has no method 'modest'"),
        ([str(tmp_path / "none.toml")], "none.toml"),
        ([str(tmp_path)], "block.toml"),
    ):
        assert main(["plan", "simulate", *call]) == 2
        assert said in capsys.readouterr().err


def test_noise_of_correlated_rows_has_the_size_that_the_strategies_expect() -> None:
    """Tied rows of "exact": e has the covariance R, v'Pv the mean f, alpha is kept."""
    own = own_scenario(
        "6/3",
        numbers=(0,),
        sizes=(6.0,),
        places=(),
        alpha=0.01,
        known=(),
        model=ModelOptions(),
    )
    runs = 20_000
    rng = np.random.default_rng(7)
    errors = rng.standard_normal((runs, len(own.matrix))) @ own.correlated.factor.T
    e = errors @ own.matrix
    scale = np.sqrt(np.outer(np.diag(own.matrix), np.diag(own.matrix)))
    assert np.abs(e.T @ e / runs - own.matrix).max() < 5.0 * np.abs(scale).max() * runs**-0.5
    f = own.correlated.redundancy
    mean = float(np.einsum("mn,mn->m", e, errors).mean())
    assert mean == pytest.approx(f, abs=4.0 * (2.0 * f / runs) ** 0.5)
    w = np.abs(e) / np.sqrt(np.diag(own.matrix))
    share = (w > 2.5758).mean()
    assert share == pytest.approx(0.01, abs=4.0 * (0.01 / (runs * f)) ** 0.5)
