"""Blocks in pixels, and cameras with a lens: what is read, and written again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_block, write_image_points
from anaplot.exchange.camerafile import format_camera, parse_camera
from anaplot.photogrammetry.block import ImagePoint
from anaplot.photogrammetry.camera import BrownLens, CameraCalibration
from anaplot.photogrammetry.lens import through_lens
from anaplot.photogrammetry.refinement import Refinement

TOML = """format = 1
name = "drone"
[[camera]]
id = "fc"
c = 8.6
pixels = [4000, 3000]
pixel_um = 2.5
principal_px = [2010.5, 1490.25]
[camera.lens]
model = "brown"
k1 = -0.12
p2 = 0.001
b1 = 0.0005
"""
POINTS = "photo,point,x_px,y_px\na/1.jpg,p1,0.1,3000\na/1.jpg,p2,2010.5,1490.25\nb.jpg,p1,10.7,20\n"


def folder_of(at: Path, toml: str = TOML, points: str = POINTS) -> Path:
    at.mkdir()
    (at / "block.toml").write_text(toml)
    (at / "image_points.csv").write_text(points)
    return at


def test_pixels_are_ideal_millimetres_inside_and_pixels_in_the_file(tmp_path: Path) -> None:
    block = read_block(folder_of(tmp_path / "b"))
    assert block.in_pixels
    (camera,) = block.cameras
    assert camera.format == (10.0, 7.5)
    first, second, _ = block.image_points
    assert (second.x, second.y) == (0.0, 0.0)
    assert first.measured == (0.1, 3000.0)
    # forwards by the formula: y is up, the principal point is the origin
    seen = through_lens(np.array([[first.x, first.y]]) / 8.6, np.array(camera.lens_parameters)).xy
    np.testing.assert_allclose(seen[0], [(0.1 - 2010.5) * 2.5e-3, (1490.25 - 3000) * 2.5e-3])

    write_block(tmp_path / "again", block)
    assert (tmp_path / "again" / "image_points.csv").read_text().splitlines()[1] == (
        "a/1.jpg,p1,0.1,3000.0,"
    )
    assert read_block(tmp_path / "again") == block


def test_a_new_row_is_written_in_pixels(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "b")
    block = read_block(folder)
    fresh = replace(block.image_points[0], point="new", measured=None)
    write_image_points(folder, (*block.image_points, fresh), block)
    row = read_block(folder).image_points[-1]
    assert row.measured is not None
    np.testing.assert_allclose(row.measured, (0.1, 3000.0), atol=1e-9)
    with pytest.raises(InputError, match="measured in pixels, or through a lens"):
        write_image_points(folder, block.image_points)


def test_millimetres_through_a_lens(tmp_path: Path) -> None:
    toml = TOML.replace("pixels = [4000, 3000]\npixel_um = 2.5\n", "format = [10.0, 7.5]\n")
    toml = toml.replace("principal_px = [2010.5, 1490.25]\n", "")
    folder = folder_of(tmp_path / "b", toml, "photo,point,x,y\n1,p,-4.9,3.7\n1,q,0.0,0.0\n")
    block = read_block(folder)
    row = block.image_points[0]
    assert not block.in_pixels
    assert row.measured == (-4.9, 3.7)
    assert np.hypot(row.x, row.y) > np.hypot(4.9, 3.7)  # k1 < 0 has pulled it inwards
    write_image_points(folder, block.image_points, block)
    assert "1,p,-4.9,3.7\n" in (folder / "image_points.csv").read_text()


@pytest.mark.parametrize(
    ("toml", "points", "message"),
    [
        (TOML, "photo,point,x_px\n", "line 1: no column 'y_px'"),
        (TOML, "photo,point,x_px,y_px,x\n", "column 'x_px': either x,y or x_px,y_px"),
        (TOML, "photo,point\n", "no column 'x'"),
        (TOML, POINTS.replace("10.7", "4000.6"), "line 4: x_px: 4000.6 px lies outside"),
        (TOML, POINTS.replace(",20\n", ",-0.6\n"), "y_px: -0.6 px lies outside"),
        (TOML.replace("-0.12", "-2.0"), POINTS, "x_px: the lens of camera 'fc' images nothing"),
        (TOML.replace("pixels = [4000, 3000]\n", ""), POINTS, "pixel_um without pixels"),
        (TOML.replace("c = 8.6", "c = 8.6\nformat = [1.0, 1.0]"), POINTS, "format: beside pixels"),
        (TOML.replace("4000", "0"), POINTS, "whole number"),
        (TOML.replace("brown", "fisheye"), POINTS, "model"),
        (TOML.replace("k1", "k9"), POINTS, "k9"),
        (TOML.replace("0.0005", "-1"), POINTS, "b1: must be greater than -1"),
        (TOML.replace("[2010.5,", "[1e9,"), POINTS, "principal_px: lies further off the middle"),
        (TOML.split("pixels")[0], POINTS, "line 2: x_px: camera 'fc' states no pixels"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, toml: str, points: str, message: str) -> None:
    folder = folder_of(tmp_path / "b", toml, points)
    with pytest.raises(InputError) as error:
        read_block(folder)
    assert message in str(error.value)


def test_a_camera_file_states_a_lens(tmp_path: Path) -> None:
    calibration = CameraCalibration("rmk", 152.0, (0.01, -0.02), lens=BrownLens(k1=0.02, b2=1e-4))
    text = format_camera(calibration)
    assert parse_camera(text, Path("camera.toml")) == calibration
    with pytest.raises(InputError, match="beside"):
        parse_camera(text + "[distortion]\ndecentring = [0.0, 0.0]\n", Path("camera.toml"))
    with pytest.raises(InputError, match="images nothing"):
        parse_camera(text.replace("0.02\n", "-20.0\n"), Path("camera.toml"))
    (tmp_path / "rmk.toml").write_text(text)
    toml = 'format = 1\nname = "n"\n[[camera]]\nfile = "rmk.toml"\n'
    folder = folder_of(tmp_path / "b", toml, "photo,point,x,y\n1,p,90.0,80.0\n")
    (folder / "rmk.toml").write_text(text)
    block = read_block(folder)
    assert block.cameras[0].lens == calibration.lens
    assert np.hypot(block.image_points[0].x, block.image_points[0].y) < np.hypot(90.0, 80.0)


def test_plates_and_a_lens_undo_each_other() -> None:
    calibration = CameraCalibration("c", 150.0, (0.02, 0.01), lens=BrownLens(k1=-0.03, p1=1e-4))
    refinement = Refinement.of(calibration)
    xy = np.random.default_rng(3).uniform(-110.0, 110.0, (50, 2))
    np.testing.assert_allclose(refinement.refine(refinement.distort(xy)), xy, atol=1e-10)
    step = 1e-4
    for axis in (0, 1):
        ends = [refinement.refine(xy + sign * step * np.eye(2)[axis]) for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * step)
        np.testing.assert_allclose(refinement.jacobian(xy)[:, :, axis], slope, atol=1e-7)


def test_a_row_without_its_block_is_plain_millimetres(tmp_path: Path) -> None:
    write_image_points(tmp_path, [ImagePoint("1", "p", 1.5, -2.5)])
    assert (tmp_path / "image_points.csv").read_text() == "photo,point,x,y,model\n1,p,1.5,-2.5,\n"


FILE = """format = 1
[camera]
id = "fc"
c = 8.6
pixels = [4000, 3000]
pixel_um = 2.5
principal_px = [2010.5, 1490.25]
[lens]
model = "brown"
k1 = -0.12
p2 = 0.001
b1 = 0.0005
"""
BY_FILE = """format = 1
name = "drone"
[[camera]]
file = "fc.toml"
"""


def test_a_camera_file_may_say_everything_of_pixels(tmp_path: Path) -> None:
    block = read_block(folder_of(tmp_path / "b"))
    calibration = parse_camera(FILE, Path("fc.toml"))
    assert parse_camera(format_camera(calibration), Path("fc.toml")) == calibration
    for k, more in enumerate(("", "pixels = [4000, 3000]\nprincipal_px = [2010.5, 1490.25]\n")):
        (tmp_path / f"{k}").mkdir()
        (tmp_path / f"{k}" / "fc.toml").write_text(FILE)
        (tmp_path / f"{k}" / "block.toml").write_text(BY_FILE + more)
        (tmp_path / f"{k}" / "image_points.csv").write_text(POINTS)
        other = read_block(tmp_path / f"{k}")
        assert other.image_points == block.image_points
        (camera,) = other.cameras
        assert (camera.pixels, camera.format) == ((4000, 3000), (10.0, 7.5))
        assert camera.lens == block.cameras[0].lens


@pytest.mark.parametrize(
    ("file", "more", "said"),
    [
        (FILE.replace("pixels = [4000, 3000]\n", ""), "", "pixel_um without pixels"),
        (FILE.replace("c = 8.6", "c = 8.6\nformat = [10.0, 7.5]"), "", "only one of them"),
        (FILE, "pixel_um = 3.0\n", "'fc.toml' says 2.5"),
        (FILE, "pixels = [3000, 4000]\n", "says"),
        (FILE.replace("4000, 3000", "4000, 1e12"), "", "pixels"),
    ],
)
def test_a_camera_file_and_its_block_agree_on_pixels(
    tmp_path: Path, file: str, more: str, said: str
) -> None:
    (tmp_path / "fc.toml").write_text(file)
    (tmp_path / "block.toml").write_text(BY_FILE + more)
    (tmp_path / "image_points.csv").write_text(POINTS)
    with pytest.raises(InputError, match=said):
        read_block(tmp_path)


FIDUCIALS = "[fiducials]\n1 = [-10.0, -7.0]\n2 = [10.0, 7.0]\n3 = [-10.0, 7.0]\n4 = [10.0, -7.0]\n"


def test_a_lens_in_pixels_with_fiducials_is_asked_as_far_as_the_image_reaches() -> None:
    long = (
        'format = 1\n[camera]\nid = "far"\nc = 100.0\npixels = [6000, 4000]\npixel_um = 4.0\n'
        f'{FIDUCIALS}[lens]\nmodel = "brown"\nk1 = -2.5\n'
    )
    # a corner lies 14.4 mm off, the lens folds the image at 24.3 mm, and c is 100
    made = parse_camera(long, Path("far.toml"))
    assert made.lens == BrownLens(k1=-2.5)
    # nor does a file without any size refuse it
    bare = long.replace("pixels = [6000, 4000]\npixel_um = 4.0\n", "").replace(FIDUCIALS, "")
    assert parse_camera(bare, Path("far.toml")).lens == made.lens
    # with the principal point aside a corner is 28.3 mm off; 1.5 folds at 31.4
    aside = long.replace("pixel_um", "principal_px = [100.0, 3900.0]\npixel_um")
    parse_camera(aside.replace("-2.5", "-1.5"), Path("far.toml"))
    with pytest.raises(InputError, match=r"images nothing at radius 24\.\d+ mm"):
        parse_camera(aside, Path("far.toml"))
    with pytest.raises(InputError, match=r"line 6: \[camera\] principal_px: lies further off"):
        parse_camera(aside.replace("[100.0", "[-2e5"), Path("far.toml"))


@pytest.mark.parametrize(
    "more", ["pixels = [4000, 3000]\npixel_um = 2.5\n", "format = [10, 7.5]\n", ""]
)
@pytest.mark.parametrize("k1", [-2.0, -20.0])
def test_a_lens_is_judged_alike_in_a_block_and_in_a_camera_file(
    tmp_path: Path, more: str, k1: float
) -> None:
    camera = f'id = "fc"\nc = 8.6\n{more}'
    lens = f'lens]\nmodel = "brown"\nk1 = {k1}\n'
    inside = f'format = 1\nname = "n"\n[[camera]]\n{camera}[camera.{lens}'
    points = "photo,point,x,y\n1,a,0.1,0.2\n1,b,3.0,2.5\n"
    own = folder_of(tmp_path / "own", inside, points)
    beside = folder_of(tmp_path / "file", BY_FILE, points)
    (beside / "fc.toml").write_text(f"format = 1\n[camera]\n{camera}[{lens}")
    said = []
    for folder in (own, beside):
        with pytest.raises(InputError, match="images nothing") as error:
            read_block(folder)
        said.append(str(error.value))
    whole = k1 == -20.0 and not more
    assert ["radius" in text for text in said] == [whole, whole]
    assert whole or ["image_points.csv line 3: x: " in text for text in said] == [True, True]
    # without the row beyond the fold
    for folder in (own, beside):
        (folder / "image_points.csv").write_text(points.replace("1,b,3.0,2.5\n", ""))
    if not whole:
        assert read_block(own).image_points == read_block(beside).image_points
