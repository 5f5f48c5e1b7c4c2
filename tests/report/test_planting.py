"""An error put in for a trial: what `bridge` and `adjust` make of it, and what stays."""

import json

import numpy as np
import pytest
from clibench import contents, make_block

import anaplot
from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_block(tmp_path_factory.mktemp("planting") / "block")


def test_a_model_changes_as_its_matrix_says(folder):
    block = read_block(folder)
    calm = anaplot.bridge(block, matrix=True).result.strips[0].models
    um = 10.0
    found = anaplot.bridge(block, plant=[f"103:102-2:y:{um}"])
    planted = found.result.strips[0].models
    # the first model holds another photo
    assert planted[0].table == calm[0].table
    keys = calm[1].tested.keys
    expected = um * calm[1].tested.influence[:, keys.index(("102-2", "y"))]
    change = np.array([b.residual - a.residual
                       for a, b in zip(calm[1].table, planted[1].table, strict=True)])  # fmt: skip
    # an error of y'' is one of its row where photos of equal constants are level; they nearly are
    assert change == pytest.approx(expected, abs=0.01 * um)
    own = keys.index(("102-2", "y"))
    assert abs(change[own]) == pytest.approx(um * calm[1].table[own].r, rel=0.1)
    answer = found.document.to_dict()
    assert answer["planted"] == [{"where": "103:102-2", "axis": "y", "um": um}]


def test_a_ray_of_the_block_changes_by_its_redundancy_number(folder):
    block = read_block(folder)
    um = 10.0
    calm, planted = (
        anaplot.adjust(block, datum="minimal", plant=plant).document.to_dict()["image_points"]
        for plant in (None, f"103:102-2:y:{um}")
    )
    for before, after in zip(calm, planted, strict=True):
        if (before["photo"], before["point"]) == ("103", "102-2"):
            assert before["vy_um"] - after["vy_um"] == pytest.approx(um * before["ry"], rel=0.02)
            break
    else:
        raise AssertionError("the ray is not listed")


def test_the_files_stay_as_they_are(folder, capsys):
    before = contents(folder)
    call = ["bridge", str(folder), "--plant", "103:102-2:y:100,102:102-2:x:-5"]
    assert main(call) == 0
    assert capsys.readouterr().out.startswith(
        "PLANTED 103:102-2 y +100 um\nPLANTED 102:102-2 x -5 um\nfor a trial: "
    )
    assert main([*call, "--matrix", "--json"]) == 0
    (strip,) = json.loads(capsys.readouterr().out)["strips"]
    for model in strip["models"]:
        size = len(model["table"])
        assert np.shape(model["matrix"]["values"]) == (size, size)
        assert np.trace(model["matrix"]["values"]) == pytest.approx(model["redundancy"])
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("plant", "what"),
    [("103:102-99:y:100", "no image point '103:102-99'"), ("103:y:100", "no image point '103'")],
)
def test_an_error_in_no_image_point_is_one_line(folder, capsys, plant, what):
    for command in ("bridge", "adjust"):
        assert main([command, str(folder), "--plant", plant]) == 2
        out, error = capsys.readouterr()
        assert out == ""
        assert what in error
        assert error.count("\n") == 1
