"""`anaplot adjust` with distances.csv and conditions.csv, as files and on the screen."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from test_adjust_errors import make

from anaplot.cli import main
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.report.adjustcommand import adjust


@pytest.fixture(scope="module")
def adjusted():
    block = make(error_mm=0.0)
    points = {row.point: np.array(row.xyz) for row in adjust(block).result.block.point_rows()}
    return block, points


@pytest.fixture
def folder(adjusted, tmp_path):
    """A block with a good distance, a wrong one, one to compare, and a plane that is none."""
    block, points = adjusted
    folder = tmp_path / "block"
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)

    def length(one: str, other: str) -> float:
        return float(np.linalg.norm(points[one] - points[other]))

    (folder / "distances.csv").write_text(
        "from,to,distance,sigma,use\n"
        f"p6,p12,{length('p6', 'p12'):.4f},0.02,\n"
        f"p7,p13,{length('p7', 'p13') + 2.0:.4f},0.02,control\n"
        f"p6,p22,{length('p6', 'p22'):.4f},0.02,check\n"
    )
    (folder / "conditions.csv").write_text(
        "kind,points,value,sigma,use\nplane,p6 p11 p16 p21,,0,off\n"
    )
    return folder


def answer_of(capsys, *arguments: str) -> dict:
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_every_row_is_told_like_any_observation(folder, capsys) -> None:
    got = answer_of(capsys, "adjust", str(folder))
    rows = got["conditions"]
    assert [(row["id"], row["use"]) for row in rows] == [
        ("distances.csv:2", "control"),
        ("distances.csv:3", "control"),
        ("distances.csv:4", "check"),
        *[("conditions.csv:2", "off")] * 4,
    ]
    good, wrong, check, *off = rows
    assert wrong["flagged"]
    assert not good["flagged"]
    assert wrong["w"] == pytest.approx(wrong["v"] / (0.02 * wrong["r"] ** 0.5 * got["sigma0"]))
    assert wrong["mdb"] == pytest.approx(4.132 * 0.02 / wrong["r"] ** 0.5, rel=1e-3)
    assert wrong["largest_effect_at"] in ("p7", "p13")
    assert check["r"] is None
    assert check["w"] == pytest.approx(check["v"] / check["s"])
    assert all(row["r"] is row["w"] is row["mdb"] is None for row in off)
    counted = [row["r"] for row in rows[:2]] + [row["r"] for row in got["control"]]
    counted += [row[r] for row in got["image_points"] for r in ("rx", "ry") if row[r] is not None]
    assert sum(counted) == pytest.approx(got["redundancy"], abs=1e-6)
    assert main(["adjust", str(folder), "--fail-on-flag"]) == 1
    text = capsys.readouterr().out
    line = next(line for line in text.splitlines() if line.startswith("  distances.csv:3"))
    assert line.endswith("<< CHECK")
    assert "p7 p13" in line


def test_a_strategy_names_the_wrong_row(folder, capsys) -> None:
    got = answer_of(capsys, "adjust", str(folder), "--errors", "baarda")
    (gone,) = got["errors"]["rejected"]
    assert (gone["kind"], gone["id"], gone["what"], gone["axis"]) == (
        *("condition", "distances.csv:3", "p7 p13", "distance"),
    )
    assert gone["error"] == pytest.approx(2.0, abs=0.3)
    row = next(row for row in got["conditions"] if row["id"] == "distances.csv:3")
    assert row["use"] == "rejected"
    assert row["r"] is row["w"] is row["mdb"] is None
    assert row["v"] == pytest.approx(-2.0, abs=0.3)
    last = answer_of(capsys, "adjust", str(folder), "--errors", "baarda", "--control-last")
    assert [row["id"] for row in last["errors"]["rejected"]] == ["distances.csv:3"]


def test_who_does_not_take_them_says_so(folder, capsys) -> None:
    got = answer_of(capsys, "compare", str(folder), str(folder))
    assert got["without_conditions"] == [1, 2]
    assert main(["adjust", str(folder), "--prior", "common"]) == 2
    assert "knows of no conditions" in capsys.readouterr().err


@pytest.mark.parametrize("row", ["line,p6 p7 q8,,0.1,", "equal,p6 p7 p7 q8,,0.1,off"])
def test_an_unknown_point_is_refused_with_file_and_line(folder, row, capsys) -> None:
    path = folder / "conditions.csv"
    path.write_text(f"{path.read_text()}{row}\n")
    assert main(["adjust", str(folder)]) == 2
    said = capsys.readouterr().err
    assert "conditions.csv:3: unknown point 'q8'" in said
    assert said.count("\n") == 1


def test_degenerate_conditions_are_not_computable(folder, capsys) -> None:
    path = folder / "distances.csv"
    path.write_text("from,to,distance,sigma\np6,p12,300,0\np12,p6,301,0\n")
    assert main(["adjust", str(folder)]) == 4
    said = capsys.readouterr().err
    assert "distances.csv:2, distances.csv:3" in said
    assert said.count("\n") == 1


def test_a_degenerate_condition_that_is_off_stops_nothing(adjusted, folder, capsys) -> None:
    block, _ = adjusted
    twins = [replace(row, point="q6") for row in block.image_points if row.point == "p6"]
    write_image_points(folder, (*block.image_points, *twins))
    path = folder / "distances.csv"
    path.write_text("from,to,distance,sigma,use\np6,q6,3,0.1,control\n")
    assert main(["adjust", str(folder)]) == 4
    assert "distances.csv:2: points p6 and q6 coincide" in capsys.readouterr().err
    for use in ("off", "check"):
        path.write_text(f"from,to,distance,sigma,use\np6,q6,3,0.1,{use}\n")
        row = answer_of(capsys, "adjust", str(folder))["conditions"][0]
        assert row["use"] == use
        assert row["v"] is row["w"] is row["s"] is None
        assert main(["adjust", str(folder)]) == 0
        assert "p6 q6" in capsys.readouterr().out


def test_a_block_without_them_has_an_empty_list(adjusted) -> None:
    block, _ = adjusted
    assert adjust(replace(block, image_points=block.image_points)).to_dict()["conditions"] == []
