"""`anaplot adjust` with distances.csv and conditions.csv, as files and on the screen."""

from __future__ import annotations

import json
import re
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


def test_what_is_free_of_error_has_no_redundancy_number(folder, capsys) -> None:
    path = folder / "distances.csv"
    path.write_text(path.read_text().replace(",0.02,control", ",0,control"))
    got = answer_of(capsys, "adjust", str(folder))
    row = got["conditions"][1]
    assert row["r"] is None
    assert row["flagged"]
    assert abs(row["w"]) > got["test"]["critical"]
    assert row["mdb"] > 0.0
    assert row["standardized_effect"] is None
    given = ("control", "priors", "point_priors", "conditions")
    tested = [one["w"] for key in given for one in got[key] or ()]
    tested += [one[w] for one in got["image_points"] for w in ("wx", "wy")]
    count = sum(w is not None for w in tested) - 1  # what is compared has a w, too
    assert got["test"]["flagged_by_chance"] == pytest.approx(got["test"]["alpha"] * count)
    main(["adjust", str(folder)])
    page = capsys.readouterr().out
    (line,) = [line for line in page.splitlines() if line.startswith("  distances.csv:3")]
    assert line.split()[7] == "-"


def test_the_summary_says_what_is_flagged_beside_image_coordinates(folder, capsys) -> None:
    assert main(["adjust", str(folder)]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "other obs" in line]
    assert line.startswith(
        "  1 other observation is flagged: distance of p7 p13 in distances.csv:3"
    )
    path = folder / "distances.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:2]) + "\n")
    assert main(["adjust", str(folder)]) == 0
    assert "other observation" not in capsys.readouterr().out


def test_check_distances_are_tested_together_and_one_by_one(adjusted, folder, capsys) -> None:
    _, points = adjusted
    path = folder / "distances.csv"
    length = float(np.linalg.norm(points["p8"] - points["p14"]))
    path.write_text(
        path.read_text().replace("p7,p13", "p8,p14", 1).replace(",control", ",off")
        + f"p8,p14,{length + 5.0:.4f},0.02,check\n"
    )
    got = answer_of(capsys, "adjust", str(folder))
    found = got["hypotheses"]["conditions"]
    assert (found["distances"], found["all"]["rejected"]) == (2, True)
    good, wrong = found["rows"]
    shown = [row for row in got["conditions"] if row["use"] == "check"]
    for row, other in zip((good, wrong), shown, strict=True):
        assert (row["id"], row["what"], row["unit"]) == (other["id"], other["what"], "m")
        assert row["difference"] == pytest.approx(other["v"])
        assert row["s"] * got["sigma0"] == pytest.approx(other["s"])
        assert row["s_given"] == pytest.approx(0.02)
    assert not good["verdict"]["rejected"]
    assert wrong["verdict"]["rejected"]
    assert wrong["detectable"] < 5.0
    assert found["rms"] == pytest.approx(
        ((good["difference"] ** 2 + wrong["difference"] ** 2) / 2.0) ** 0.5
    )
    assert main(["adjust", str(folder)]) == 0
    page = capsys.readouterr().out
    assert page.count("CHECK DISTANCES") == 1
    assert "  1 of 2 checks rejected" in page
    (line,) = [line for line in page.splitlines() if line.startswith("  distance p8 p14")]
    assert line.endswith("<< REJECTED")
    # every row has its own unit: no line of units, and no empty one in its place
    assert re.search(r"\n  CHECK +difference .*\n  distance p8 p14", page)
    path.unlink()
    assert answer_of(capsys, "adjust", str(folder))["hypotheses"]["conditions"] is None


def test_a_free_network_says_how_well_distances_give_its_scale(folder, capsys) -> None:
    got = answer_of(capsys, "adjust", str(folder), "--datum", "free")
    assert got["datum"]["scale"] == "distances"
    assert 0.0 < got["datum"]["scale_s"] < 1.0
    assert main(["adjust", str(folder), "--datum", "free"]) == 0
    page = capsys.readouterr().out
    assert "standard deviation of the scale by distances: " in page
    (line,) = [line for line in page.splitlines() if line.startswith("  accuracy ")]
    assert len(line.split()[3].split(".")[1]) == 4


def test_a_network_of_micrometres_is_shown_in_micrometres(adjusted, tmp_path, capsys) -> None:
    block, points = adjusted
    near = tmp_path / "near"
    write_new_block(near, block)
    write_image_points(near, block.image_points)
    length = float(np.linalg.norm(points["p6"] - points["p12"])) / 2000.0
    (near / "distances.csv").write_text(f"from,to,distance,sigma\np6,p12,{length:.7f},0.00001\n")
    got = answer_of(capsys, "adjust", str(near), "--datum", "free")
    assert 0.0 < got["indicators"]["AI"] < 5e-4
    assert main(["adjust", str(near), "--datum", "free"]) == 0
    page = capsys.readouterr().out.splitlines()
    (line,) = [line for line in page if line.startswith("  accuracy ")]
    assert float(line.split()[3]) == pytest.approx(got["indicators"]["AI_X"], abs=1e-6)
    first = got["points"][0]
    (shown,) = [line.split() for line in page if line.startswith(f"  {first['point']} ")]
    assert [float(one) for one in shown[1:4]] == pytest.approx(
        [first["X"], first["Y"], first["Z"]], abs=1e-6
    )


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
    assert "conditions.csv line 3: unknown point 'q8'" in said
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


def test_a_free_network_says_that_nothing_tells_its_scale(folder, capsys) -> None:
    """Of two places one coordinate is enough to lay it onto something; of one nothing is."""
    (folder / "distances.csv").unlink()
    control = (folder / "control.csv").read_text().splitlines()
    for kept, scale in ((3, None), (2, "open")):
        (folder / "control.csv").write_text("\n".join(control[:kept]) + "\n")
        got = answer_of(capsys, "adjust", str(folder), "--datum", "free")
        assert got["datum"].get("scale") == scale
        assert main(["adjust", str(folder), "--datum", "free"]) == 0
        said = "the scale by nothing stated" in " ".join(capsys.readouterr().out.split())
        assert said == (scale == "open")
