"""docs/inner-orientation.md is true: what it shows is run."""

from __future__ import annotations

import re
from math import radians, tan
from pathlib import Path

import pytest

from anaplot.exchange.camerafile import parse_camera
from anaplot.photogrammetry.camera import RadialTable

PAGE = (Path(__file__).parents[2] / "docs" / "inner-orientation.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_the_certificate_is_what_the_camera_file_says():
    printed, camera = blocks("")[0], parse_camera(blocks("toml")[0], Path("rc30.toml"))
    numbers = {
        float(row[0]): [float(one) for one in row[1:]]
        for line in printed.splitlines()
        if len(row := line.split()) == 6 and re.fullmatch(r"\d+\.\d", row[0])
    }
    assert isinstance(camera.radial, RadialTable)
    assert camera.radial.radius == tuple(camera.c * tan(radians(angle)) for angle in numbers)
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
