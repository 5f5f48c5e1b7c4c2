"""`anaplot fit`."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from deskless import write_measured

from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block, write_control
from anaplot.orientation.strip import bridge_strip
from anaplot.photogrammetry.block import ControlPoint


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A strip of three models whose control is its own model coordinates at 1 : 10 000."""
    folder = tmp_path / "b"
    write_measured(folder, models=3, measured=3)
    block = read_block(folder)
    bridged = bridge_strip(block, block.strips[0])
    at = {p.point: np.array([p.X, p.Y, p.Z]) * 10.0 for m in bridged.models for p in m.points}
    rng = np.random.default_rng(1)
    points = [
        ControlPoint(name, tuple((xyz + rng.normal(0.0, 0.02, 3)).round(3).tolist()))
        for name, xyz in at.items()
    ]
    write_control(folder, points[::2])
    return folder


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_strips_without_any_error_fit_their_control(
    degree: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--strips", "3", "--photos", "6", "--sidelap", "20", "--control-m", "0.02")
    folder = tmp_path / "block"
    assert main(["plan", "block", *options, "--to", str(folder)]) == 0
    capsys.readouterr()
    assert main(["fit", str(folder), "--degree", str(degree), "--json"]) == 0
    strips = json.loads(capsys.readouterr().out)["strips"]
    assert len(strips) == 3
    for strip in strips:
        assert 0.0 <= strip["sigma0"] < 1e-4
        assert not any(point["flagged"] for point in strip["points"])


def test_text_json_and_csv(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", str(folder), "--json", "--csv", str(tmp_path / "x.csv")]) == 0
    (strip,) = json.loads(capsys.readouterr().out)["strips"]
    assert strip["strip"] == "1"
    assert strip["degree"] == 1
    assert strip["transformation"]["scale"] == pytest.approx(10.0, rel=1e-3)
    assert len(strip["rms_m"]) == 3
    assert list(strip["points"][0]) == ["point", "used", "dX", "dY", "dZ", "r", "w", "flagged"]
    with (tmp_path / "x.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["point"] for row in rows] == [point["point"] for point in strip["points"]]
    assert rows[0]["strip"] == "1"
    name = strip["points"][0]["point"]
    assert main(["fit", str(folder), "--degree", "2", "--without", name]) == 0
    out = capsys.readouterr().out
    assert "STRIP 1  similarity and polynomials of degree 2" in out
    assert "scale 1 : 10000" in out
    assert "no" in next(line for line in out.splitlines() if line.split()[:1] == [name]).split()


def test_interchanged_control_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second, *others = read_block(folder).control
    exchanged = (replace(first, xyz=second.xyz), replace(second, xyz=first.xyz))
    (folder / "control.csv").unlink()
    write_control(folder, [*exchanged, *others])
    assert main(["fit", str(folder), "--json"]) == 0
    (strip,) = json.loads(capsys.readouterr().out)["strips"]
    (told,) = strip["remarks"]
    assert f"{first.point} and control point {second.point} interchanged?" in told
    assert main(["fit", str(folder)]) == 0
    assert f"  note: {told}" in capsys.readouterr().out


def test_what_cannot_be_fitted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", str(folder), "--without", "nobody"]) == 2
    assert "no control point 'nobody'" in capsys.readouterr().err
    assert main(["fit", str(folder), "--strip", "9"]) == 2
    assert "no strip '9'" in capsys.readouterr().err
    (folder / "control.csv").write_text("point,X,Y,Z\n101-1,1,2,3\n")
    assert main(["fit", str(folder), "--json"]) == 4
    captured = capsys.readouterr()
    assert "3 control coordinates are measured" in captured.err
    assert "error" in json.loads(captured.out)["strips"][0]


def test_a_flagged_point_can_fail(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (folder / "control.csv").read_text().splitlines()
    cells = lines[3].split(",")
    cells[3] = str(float(cells[3]) + 3.0)
    lines[3] = ",".join(cells)
    (folder / "control.csv").write_text("\n".join(lines) + "\n")
    assert main(["fit", str(folder), "--fail-on-flag"]) == 1
    out = capsys.readouterr().out
    assert "< flagged" in next(line for line in out.splitlines() if line.split()[:1] == cells[:1])


def test_names_with_commas_are_put_aside_and_planted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = read_block(folder)
    old = block.control[1].point
    new = 'p,1"3'
    for name in ("image_points.csv", "control.csv"):
        with (folder / name).open(newline="") as file:
            rows = list(csv.reader(file))
        with (folder / name).open("w", newline="") as file:
            csv.writer(file).writerows(
                [[new if cell == old else cell for cell in row] for row in rows]
            )
    given = '"p,1""3"'
    assert (
        main(["fit", str(folder), "--without", f"{given}, {block.control[2].point}", "--json"]) == 0
    )
    (strip,) = json.loads(capsys.readouterr().out)["strips"]
    aside = {point["point"] for point in strip["points"] if not point["used"]}
    assert aside == {new, block.control[2].point}
    photo = next(row.photo for row in read_block(folder).image_points if row.point == new)
    errors = f'"{photo}:p,1""3:y:60"'
    assert main(["bridge", str(folder), "--plant", errors, "--json"]) in (0, 1)
    (planted,) = json.loads(capsys.readouterr().out)["planted"]
    assert planted["where"] == f"{photo}:{new}"
    for text in ('"p,1', '"p"x,1'):
        assert main(["fit", str(folder), "--without", text]) == 2
        assert "no parts with commas between" in capsys.readouterr().err
