"""AICON's files: in, out, distortion taken off, and what is damaged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tableblock import rays_of, table_block, texts

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_block
from anaplot.exchange.formats import aicon
from anaplot.exchange.formats.aiconfiles import Interior
from anaplot.exchange.formats.door import Exporting, ImportOptions
from anaplot.exchange.formats.registry import recognised
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.report.exportresult import adjusted_result

PHC = """\
1 7 1.25 -2.5 0.0005 0.0005 0.0001 0.0002 0 1 17
1 8 -3.0 4.0 0.0003 0.0004 0 0 0 0 17
2 7 1.5 2.5 0.0005 0.0005 0 0 0 1 17
2 8 1.0D+0 0.5 0 0 0 0 0 1 17
"""
IOR = "Ck -28.5\nxh 0.1\nyh -0.05\nA1 -1e-4\nA2 2e-7\nB1 1e-5\nB2 -2e-5\nC1 1e-4\nC2 3e-4\nR0 9.0\n"
EOR = "1 1000.5 2000.25 3000 0.1 -0.2 3.0\n9 0 0 0 0 0 0\n"
OBC = "7 100.5 200.25 300 0.01 0.02 0.03\n8 1 2 3\n"
SCALE = "7 8 1250.125 0.05\n7 99 10 0.05\n"


def project(folder: Path) -> Path:
    texts_ = {"phc": PHC, "ior": IOR, "eor": EOR, "obc": OBC, "scale": SCALE}
    for suffix, text in texts_.items():
        (folder / f"a.{suffix}").write_text(text)
    return folder


def distortion(x: float, y: float) -> tuple[float, float]:
    """What is subtracted from a coordinate about the principal point, written out."""
    r2, r02 = x * x + y * y, 81.0
    radial = -1e-4 * (r2 - r02) + 2e-7 * (r2 * r2 - r02 * r02)
    dx = x * radial + 1e-5 * (r2 + 2 * x * x) + 2 * -2e-5 * x * y + 1e-4 * x + 3e-4 * y
    return dx, y * radial - 2e-5 * (r2 + 2 * y * y) + 2 * 1e-5 * x * y


def test_a_project_is_read(tmp_path: Path) -> None:
    source = project(tmp_path)
    assert recognised(source).kind == "aicon"
    assert recognised(source / "a.phc").kind == "aicon"
    found = aicon.read(source, ImportOptions())
    block, said = found.block, texts(found.notes)
    assert block.cameras[0].c == 28.5
    x, y = 1.25 - 0.1, -2.5 + 0.05
    dx, dy = distortion(x, y)
    assert rays_of(block)["1", "7"] == pytest.approx((x - dx, y - dy), abs=1e-15)
    assert [row.use for row in block.image_points] == ["xy", "off", "xy", "xy"]
    assert [row.sigma_um for row in block.image_points] == pytest.approx(
        [0.5, np.sqrt((0.09 + 0.16) / 2), 0.5, None]
    )
    assert block.precision.image_um == 0.5
    assert block.photos[0].position == (1.0005, 2.00025, 3.0)
    assert block.photos[0].rotation == (0.1, -0.2, 3.0)
    assert block.conditions == (ObjectCondition("distance", ("7", "8"), 1.250125, 5e-5),)
    assert block.control == ()
    for text in (
        "assumed 1 inactive rays: use = off",
        "dropped 2 object points of a.obc: results, not control",
        "dropped 1 scale bars with an end that is in no image",
        "dropped 1 orientations of images without points",
        "rays are ideal coordinates: moved by 0.1, -0.05 mm to the principal point, corrected",
        "the distortion is subtracted",
    ):
        assert text in said
    asked = aicon.read(source, ImportOptions(files={"control": source / "a.obc"})).block
    assert [(row.xyz, row.sigma) for row in asked.control] == [
        ((0.1005, 0.20025, 0.3), (1e-5, 2e-5, 3e-5)),
        ((0.001, 0.002, 0.003), (None, None, None)),
    ]
    added = aicon.read(source, ImportOptions(order="add")).block
    assert rays_of(added)["1", "7"] == pytest.approx((x + dx, y + dy), abs=1e-15)


def test_the_balanced_distortion_is_nothing_at_its_radius() -> None:
    camera = Interior(20.0, (0.2, 0.3), (-1e-4, 3e-7, 1e-10), (0.0, 0.0), (0.0, 0.0), 7.0)
    angle, centre = np.linspace(0.0, 6.0, 13), np.array((0.2, 0.3))
    away = 7.0 * np.column_stack((np.cos(angle), np.sin(angle)))
    assert np.abs(camera.ideal(away + centre) - away).max() < 1e-14
    assert np.abs(camera.ideal(0.5 * away + centre) - 0.5 * away).max() > 1e-3


def test_the_values_of_a_camera_stand_in_a_row_too(tmp_path: Path) -> None:
    source = project(tmp_path)
    first = rays_of(aicon.read(source, ImportOptions()).block)
    row = "-28.5 0.1 -0.05 -1e-4 2e-7 0 1e-5 -2e-5 1e-4 3e-4 9.0"
    for text in (row, f"1 {row}", row.replace(" ", "\n")):
        (source / "a.ior").write_text(text)
        assert rays_of(aicon.read(source, ImportOptions()).block) == first


def test_what_goes_out_comes_in_exactly(tmp_path: Path) -> None:
    block = table_block()
    first, second, *rest = block.image_points
    rays = (replace(first, use="off"), replace(second, sigma_um=7.25), *rest)
    bar = ObjectCondition("distance", ("1000", "1019"), 1250.125, 0.001)
    control = tuple(replace(row, sigma=(0.01, 0.02, 0.0)) for row in block.control)
    block = replace(block, image_points=rays, conditions=(bar,), control=control)
    made = aicon.write(Exporting(block, tmp_path), tmp_path / "out")
    assert "not held 2 strips" in texts(made.notes)
    assert "image_um" not in texts(made.notes)
    assert "control_m" not in texts(made.notes)  # both stand with the coordinates
    back = aicon.read(tmp_path / "out", ImportOptions())
    assert "assumed 5 object points of out-control.obc are control" in texts(back.notes)
    found = back.block
    assert rays_of(found) == rays_of(block)
    assert [row.use for row in found.image_points] == [row.use for row in block.image_points]
    assert [row.sigma_um for row in found.image_points][:3] == [4.0, 7.25, 4.0]
    assert found.conditions == block.conditions
    assert found.control == block.control
    assert found.cameras[0].c == block.cameras[0].c
    assert [(p.position, p.rotation) for p in found.photos] == [
        (p.position, p.rotation) for p in block.photos
    ]


@pytest.mark.slow
def test_it_is_the_same_block_by_this_door(tmp_path: Path) -> None:
    block = table_block(strips=False)
    write_block(tmp_path / "mine", block)
    assert main(["export", "aicon", str(tmp_path / "mine"), "-o", str(tmp_path / "out")]) == 0
    assert main(["import", str(tmp_path / "out"), "-o", str(tmp_path / "b")]) == 0
    first, again = adjusted_result(block), adjusted_result(read_block(tmp_path / "b"))
    assert again.sigma0 == pytest.approx(first.sigma0, rel=1e-9)
    for mine, theirs in zip(first.points, again.points, strict=True):
        assert theirs.redundancy == pytest.approx(mine.redundancy, rel=1e-9)


@pytest.mark.parametrize(
    ("suffix", "old", "new", "message"),
    [
        ("phc", "1.25", "nan", "line 1: x and y must be a finite number"),
        ("phc", "1 7 1.25 -2.5 0.0005", "1 7 1.25 -2.5 -0.0005", "line 1: a standard deviation"),
        ("phc", "1 7 1.25", "1 7 1250", "line 1: 1250, -2.5 mm lies outside what the camera"),
        ("phc", PHC, "1 7 1.25\n", "line 1: 3 fields, where image, point, x and y"),
        ("phc", PHC, "# nothing\n", "no image point"),
        ("phc", PHC, PHC.rstrip()[:-9], "fields, where the rows before it have"),
        ("phc", "2 7", f"2 {'7' * 256}", "line 3: the point name"),
        ("ior", "Ck -28.5", "Ck 0", "no Ck, the camera constant"),
        ("ior", "xh 0.1", "xh 0.1\nxh 0.1", "line 3: xh twice"),
        ("ior", "xh 0.1", "xh 0.1\n3", "values with and without a name"),
        ("ior", "xh 0.1", "xh 99", "the principal point lies further off than Ck"),
        ("ior", IOR, "-28.5 1 2\n", "3 values of one camera, where 11 are known"),
        ("eor", "3.0", "172.0", "line 1: an angle beyond 2 pi"),
        ("eor", "9 0", "1 0", "line 2: image '1' twice"),
        ("eor", "0 0 0 0 0 0", "0 0", "line 2: 3 fields"),
        ("scale", "7 99", "8 7", "line 2: the distance from '8' to '7' twice"),
        ("scale", "1250.125 0.05", "1250.125", "line 1: 3 fields"),
        ("scale", "7 8", "7 7", "line 1: no distance between two points"),
        ("obc", "8 1 2 3", "7 1 2 3", "line 2: point '7' twice"),
        ("obc", "300", "1e999", "line 1: a coordinate must be a finite number"),
    ],
)
def test_damage_is_one_line(tmp_path: Path, suffix: str, old: str, new: str, message: str) -> None:
    source = project(tmp_path)
    file = source / f"a.{suffix}"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        aicon.read(source, ImportOptions())
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_points_twice_and_no_camera(tmp_path: Path) -> None:
    file = tmp_path / "a.phc"
    file.write_text("1 7 1.25 -2.5\n1 7 1.26 -2.5\n")
    with pytest.raises(InputError, match="the camera constant is not known"):
        aicon.read(file, ImportOptions())
    found = aicon.read(file, ImportOptions(c=28.0))
    assert [(r.point, r.use) for r in found.block.image_points] == [("7", "xy"), ("7~2", "off")]
    assert "sigma of image coordinates 5 um" in texts(found.notes)
    with pytest.raises(InputError, match=r"--order: there is no \.ior"):
        aicon.read(file, ImportOptions(c=28.0, order="add"))
    (tmp_path / "b.PHC").write_text(PHC)
    with pytest.raises(InputError, match=r"2 files \.phc"):
        aicon.read(tmp_path, ImportOptions())
