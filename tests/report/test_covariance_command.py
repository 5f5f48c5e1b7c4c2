"""`anaplot adjust --covariance`, as one types it, and the call of the library."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import anaplot
from anaplot.cli import main
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.planning.blockplan import BlockPlan, plan_block
from anaplot.report import adjustcommand
from anaplot.report import covariance as part


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = plan_block(BlockPlan(2, 4, 0.60, 0.60, 5, control_m=0.05)).block
    rng = np.random.default_rng(3)
    rows = [
        replace(row, x=row.x + rng.normal() * 0.006, y=row.y + rng.normal() * 0.006)
        for row in made.image_points
    ]
    folder = tmp_path_factory.mktemp("covariance") / "block"
    block = replace(made, name="block", test=replace(made.test, kind="tau"))
    write_new_block(folder, block)
    write_image_points(folder, rows)
    write_control(folder, made.control)
    return folder


@pytest.fixture(scope="module")
def names(folder):
    return list(dict.fromkeys(row.point for row in anaplot.read_block(folder).image_points))


def answer(arguments, capsys):
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_points_and_a_photo_with_each_other(folder, names, capsys, tmp_path) -> None:
    a, b = names[3], names[9]
    words = ["adjust", folder, "--covariance", f"points:{a},{b}", "photos:101"]
    whole = answer(words, capsys)
    got = whole["covariance"]
    assert got["names"][:4] == [f"point:{a}:X", f"point:{a}:Y", f"point:{a}:Z", f"point:{b}:X"]
    assert got["names"][-1] == "photo:101:kappa"
    assert got["units"] == ["m"] * 9 + ["rad"] * 3
    assert (got["sigma0"], got["factor"], got["datum"]) == ("estimated", whole["sigma0"], "control")
    matrix = np.array(got["matrix"])
    assert matrix.shape == (12, 12)
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_allclose(np.sqrt(np.diag(matrix)), got["s"], rtol=1e-12)
    (row,) = [row for row in whole["points"] if row["point"] == b]
    assert got["s"][3:6] == pytest.approx([row["sX"], row["sY"], row["sZ"]], rel=1e-7)
    assert got["values"][3:6] == [row["X"], row["Y"], row["Z"]]
    assert [one["name"] for one in got["places"]] == [a, b, "101"]
    assert len(got["pairs"]) == 3
    step = np.array(got["values"][3:6]) - got["values"][:3]
    assert got["pairs"][0]["distance"] == pytest.approx(float(np.linalg.norm(step)))
    # what a person reads: angles in degrees, correlations, ellipses
    assert main([*map(str, words)]) == 0
    text = capsys.readouterr().out
    text = text[text.index("COVARIANCE of 12 unknowns") :]
    assert "with the estimated sigma0: factor" in text
    lines = [line.split() for line in text.splitlines()]
    (kappa,) = [line for line in lines if line[1:4] == ["photo", "101", "kappa"]]
    assert float(kappa[4]) == pytest.approx(np.degrees(got["values"][-1]), abs=1e-6)
    assert float(kappa[5]) == pytest.approx(np.degrees(got["s"][-1]), rel=1e-3)
    assert kappa[6] == "deg"
    assert "  correlations" in text
    assert [line for line in lines if line[:4] == ["point", a, "point", b]]
    # tables
    out = tmp_path / "out"
    assert main([*map(str, words), "--to", str(out)]) == 0
    capsys.readouterr()
    with (out / "covariance_matrix.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12 * 13 // 2
    cell = next(r for r in rows if (r["first"], r["second"]) == (got["names"][1], got["names"][10]))
    assert float(cell["covariance"]) == matrix[1, 10]
    assert float(cell["correlation"]) == pytest.approx(
        matrix[1, 10] / np.sqrt(matrix[1, 1] * matrix[10, 10])
    )
    assert len((out / "covariance_pairs.csv").read_text().splitlines()) == 4
    assert len((out / "covariance.csv").read_text().splitlines()) == 13


def test_the_library_says_the_same(folder, names, capsys) -> None:
    found = anaplot.adjust(
        folder, additional="physical:k1", additional_sigma_um=20.0, datum="free"
    ).result
    own = found.covariance(points=[names[3], f"{names[5]}:Z"], photos="101,102", parameters=True)
    words = ["adjust", folder, "--additional", "physical:k1", "--additional-sigma-um", 20]
    words += ["--datum", "free", "--covariance", f"points:{names[3]},{names[5]}:Z"]
    words += ["photos:101,102", "parameters:k1"]
    got = answer(words, capsys)["covariance"]
    assert [one.text for one in own.names] == got["names"]
    assert got["names"][-1] == "parameter:block:k1"
    assert got["units"][-1] == ""
    np.testing.assert_allclose(own.matrix, got["matrix"], rtol=1e-12)
    assert got["datum"] == own.datum == "free"
    assert len(found.covariance(points=True).names) == 3 * len(found.block.problem.points)
    assert main([*map(str, words)]) == 0
    assert "in the datum of inner constraints" in capsys.readouterr().out
    for wrong, said in (
        ({}, "nothing is named"),
        ({"points": ["nowhere"]}, "no point 'nowhere'"),
        ({"photos": False}, "nothing is named"),
    ):
        with pytest.raises(anaplot.InputError, match=said):
            found.covariance(**wrong)


def test_more_than_is_shown_goes_into_a_file(folder, names, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(part, "MOST_SHOWN", 20)
    words = ["adjust", str(folder), "--covariance", "points"]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "unknowns with each other: at most 20; --covariance-to FILE.npz takes 6000" in error
    file = tmp_path / "all.npz"
    got = answer([*words, "--covariance-to", file], capsys)["covariance"]
    assert got["matrix"] is got["pairs"] is None
    assert got["file"] == str(file)
    whole = anaplot.adjust(folder).result.covariance(points=True)
    with np.load(file) as kept:
        assert kept["names"].tolist() == [one.text for one in whole.names] == got["names"]
        np.testing.assert_array_equal(kept["covariance"], whole.matrix)
        np.testing.assert_array_equal(kept["x"], whole.values)
        assert float(kept["factor"]) == whole.sigma
        assert set(kept["units"].tolist()) == {"m"}
    # it is another file than that of --posterior, whose C has the a-priori sigma0
    assert main(["adjust", str(folder), "--given", str(file)]) == 2
    assert "'C' is missing" in capsys.readouterr().err
    monkeypatch.setattr(part, "MOST_COORDINATES", 30)
    assert main([*words, "--covariance-to", str(file)]) == 2
    assert "at most 30\n" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--covariance-to", "x.npz"], "--covariance-to goes with --covariance"),
        (["--covariance", "photos", "--covariance-to", "x.csv"], "ends in .npz"),
        (["--covariance", "photos", "--covariance-to", "x.npz", "--posterior", "x.npz"],
         "--posterior and --covariance-to name one file"),
        (["--covariance", "points:nowhere"], "no point 'nowhere' in the adjusted block"),
        (["--covariance", "photos:1O1"], "no photo '1O1' in the adjusted block (did you mean"),
        (["--covariance", "parameters"], "without additional parameters"),
        (["--covariance", "points:,"], "nothing is named"),
        (["--covariance", 'points:"7,8'], """--covariance: "7,8: no parts with commas between"""),
    ],
)  # fmt: skip
def test_what_goes_wrong_is_one_line(folder, capsys, words, said) -> None:
    assert main(["adjust", str(folder), *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_what_is_asked_is_known_before_anything_is_adjusted(folder, monkeypatch, capsys) -> None:
    def never(*args, **keywords):
        raise AssertionError

    monkeypatch.setattr(adjustcommand, "adjust_block", never)
    assert main(["adjust", str(folder), "--covariance", "points:nowhere"]) == 2
    assert "no point 'nowhere'" in capsys.readouterr().err


def test_what_a_cleaning_leaves_nothing_of_is_said(folder, names) -> None:
    """As if a point had gone: its name is told, the others have their covariance."""
    adjusted = anaplot.adjust(folder).result.block
    question = part.CovarianceQuestion.of([f"points:{names[3]},{names[4]}"], None, None)
    asked = question.checked(adjusted.problem)
    renamed = tuple("gone" if one == names[4] else one for one in adjusted.problem.points)
    later = replace(adjusted, problem=replace(adjusted.problem, points=renamed))
    found = asked.answered(later)
    assert [one.owner for one in found.gone] == [names[4]] * 3
    document = part.covariance_document(found)
    assert document.to_dict()["left_out"] == [f"point:{names[4]}:{axis}" for axis in "XYZ"]
    assert len(document.to_dict()["matrix"]) == 3


@pytest.mark.slow
def test_with_parameters_that_are_chosen_and_after_a_cleaning(folder, names, capsys) -> None:
    # what is chosen is known only afterwards
    words = ["adjust", folder, "--additional", "auto:ebner", "--covariance", f"points:{names[3]}"]
    assert len(answer(words, capsys)["covariance"]["names"]) == 3
    words = ["adjust", folder, "--errors", "tau", "--covariance", f"points:{names[3]}", "photos"]
    got = answer(words, capsys)
    assert got["covariance"]["factor"] == got["sigma0"]
    assert got["covariance"]["left_out"] == []
