"""docs/inner-orientation.md is true: what it shows is run."""

from __future__ import annotations

import re
from math import radians, tan
from pathlib import Path

import pytest

from anaplot.cli import main
from anaplot.exchange.blocktoml import parse_block_toml
from anaplot.exchange.camerafile import parse_camera
from anaplot.photogrammetry.airandearth import HIGHEST, AirAndEarth, refraction_constant
from anaplot.photogrammetry.camera import RadialTable
from anaplot.photogrammetry.radialshift import RadialShift

PAGE = (Path(__file__).parents[2] / "docs" / "inner-orientation.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return [text for of, text in fences if of == language]


def test_the_certificate_is_what_the_camera_file_says():
    printed, camera = blocks("")[0], parse_camera(blocks("toml")[0], Path("rc30.toml"))
    numbers = {
        float(row[0]): [float(one) for one in row[1:]]
        for line in printed.splitlines()
        if len(row := line.split()) == 6 and re.fullmatch(r"\d+\.\d", row[0])
    }
    assert isinstance(camera.radial, RadialTable)
    # an angle is of the ray in the object: measured it lies farther out by the distortion
    radii = [camera.c * tan(radians(angle)) for angle in numbers]
    out = [dr * 1e-3 for dr in camera.radial.dr_um]
    assert camera.radial.radius == pytest.approx([r + dr for r, dr in zip(radii, out, strict=True)])
    assert camera.radial.diagonals_um == tuple(tuple(row[1:]) for row in numbers.values())
    assert camera.radial.dr_um == pytest.approx([row[0] for row in numbers.values()], abs=0.051)
    for word in ("FOCAL LENGTH", "PPA", "PPS"):
        (line,) = (line for line in printed.splitlines() if word in line)
        told = [float(one) for one in re.findall(r"-?\d+\.\d+", line)]
        assert told in ([camera.c], [*camera.principal_point], [*(camera.symmetry_point or ())])
    marks = re.findall(r"(\d)\s+(-?\d+\.\d+)\s+(-?\d+\.\d+)", printed.split("MARKS")[1])
    assert {(m.id, m.x, m.y) for m in camera.fiducials} == {
        (one, float(x), float(y)) for one, x, y in marks
    }


def test_the_commands_make_the_block(tmp_path, monkeypatch, capsys):
    camera, fiducials = blocks("toml")[:2]
    points, made = blocks("csv")
    for name, text in (("rc30.toml", camera), ("scan.toml", fiducials), ("scan.csv", points)):
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    for command in blocks("bash")[0].splitlines():
        words = command.split()
        assert words[0] == "anaplot"
        assert main(words[1:]) == 0
    out = capsys.readouterr().out
    written = (tmp_path / "survey" / "image_points.csv").read_text().splitlines()
    assert written[: len(made.splitlines())] == made.splitlines()
    assert len(written) == len(points.splitlines())
    assert "5 image points of 2 photos in survey/image_points.csv" in out
    assert "half-diagonals, which differ from it by up to 1.9 um (at radius 128.487 mm)" in out
    # the words that the page quotes
    assert main(["inner", "scan.toml"]) == 0
    assert "mirrored: y runs down, or seen from behind" in capsys.readouterr().out
    assert main(["inner", "scan.toml", "--points", "scan.csv", "--apply", "survey"]) == 2
    assert "--replace" in capsys.readouterr().err


def test_refraction_is_as_large_as_the_page_says(tmp_path):
    (tmp_path / "rc30.toml").write_text(blocks("toml")[0])
    text = 'format = 1\nname = "t"\n' + blocks("toml")[2] + '[[camera]]\nfile = "rc30.toml"\n'
    air = parse_block_toml(text, tmp_path / "block.toml").air
    assert air == AirAndEarth(1900.0, 200.0, refraction=True)
    shift = RadialShift.of(AirAndEarth(1900.0, 0.0, refraction=True), 153.0)
    assert [round(1e3 * shift.at(radius)) for radius in (70.0, 140.0)] == [2, 6]
    assert refraction_constant(HIGHEST, 0.0) > 0.0
