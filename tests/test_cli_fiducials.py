"""`anaplot demo --auto --fiducials`: inner orientations from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from clibench import anaplot

from anaplot.exchange.blockfolder import read_block

pytestmark = pytest.mark.slow


@pytest.mark.long
def test_the_demo_with_fiducials_tells_its_story(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    result = anaplot("demo", "--auto", "--fiducials", "--models", "2", "--keep", folder)
    assert (result.returncode, result.stderr) == (0, "")
    for words in (
        "photo 101 (left)",
        "photo 103 (right): the bilinear transformation accepted",
        "RESID",
        "wrong fiducial of photo",
        "missed although detectable: none",
    ):
        assert words in result.stdout
    block = read_block(folder)
    calibration = block.cameras[0].calibration
    assert calibration is not None
    assert len(calibration.fiducials) == 8
    assert {row.model for row in block.image_points} == {"101/102", "102/103"}
    # what was recorded comes out the same
    check = anaplot("replay", folder, "--check")
    assert (check.returncode, check.stderr) == (0, "")
    assert "came out the same" in check.stdout
    # and is a block like any other
    assert anaplot("bridge", folder).returncode == 0
    assert anaplot("replay", folder, "--to", tmp_path / "again").returncode == 0
    assert read_block(tmp_path / "again") == block


def test_json_has_the_inner_orientations() -> None:
    result = anaplot("demo", "--auto", "--json", "--fiducials", "--models", "1", "--seed", "5")
    assert result.returncode == 0
    answer = json.loads(result.stdout)
    (wrong,) = [p for p in answer["planted"] if p["kind"] == "wrong fiducial"]
    assert wrong in answer["found"]
    assert wrong in answer["repaired"]
    (model,) = answer["models"]
    assert [i["photo"] for i in model["inner"]] == ["101", "102"]
    plain = json.loads(anaplot("demo", "--auto", "--json", "--models", "1", "--seed", "5").stdout)
    assert "inner" not in plain["models"][0]
    assert [p for p in answer["planted"] if p != wrong] == plain["planted"]
