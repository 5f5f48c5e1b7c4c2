"""BAL problems: in, out without a digit changed, and claims that no file can keep."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tableblock import pixel_table_block, table_block, texts

from anaplot.bundle.adjust import adjust_block
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats import bal
from anaplot.exchange.formats.door import Exporting, ImportOptions
from anaplot.exchange.formats.registry import recognised
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.measuredimage import measured_rays, pixels_of_mm
from anaplot.report.exportresult import adjusted_result

LENSES = ((3100.25, -0.05, 0.02), (3090.5, -0.04, 0.0))


def rodrigues(w: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The rotation of a vector as BAL's page has it."""
    angle = np.linalg.norm(w)
    k = w / angle
    return v * np.cos(angle) + np.cross(k, v) * np.sin(angle) + k * (k @ v) * (1 - np.cos(angle))


def problem() -> str:
    """Six tilted photos of 14 points, two lenses, observed without an error."""
    rng = np.random.default_rng(3)
    points = rng.uniform((-40, -30, -6), (40, 30, 6), (14, 3))
    rays, cameras = [], []
    for k in range(6):
        w = np.array((0.25 - 0.1 * k, 0.2 * (-1) ** k, 3.0 - 0.4 * k))
        centre = np.array((18.0 * (k % 3) - 18.0, 14.0 * (k // 3) - 7.0, 100.0 + k))
        t = -rodrigues(w, centre)
        f, k1, k2 = LENSES[k % 2]
        cameras += [*w, *t, f, k1, k2]
        for j, point in enumerate(points):
            x, y, z = rodrigues(w, point) + t
            p = np.array((-x / z, -y / z))
            u, v = f * (1.0 + k1 * (p @ p) + k2 * (p @ p) ** 2) * p
            rays.append(f"{k} {j}     {u:.9e} {v:.9e}")
    numbers = [f"{value:.16e}" for value in (*cameras, *points.ravel())]
    return "\n".join([f"6 14 {len(rays)}", *rays, *numbers]) + "\n"


PROBLEM = problem()


def test_a_problem_without_errors_adjusts_to_nothing(tmp_path: Path) -> None:
    file = tmp_path / "p.txt"
    file.write_text(PROBLEM)
    assert recognised(file).kind == "bal"
    found = bal.read(file, ImportOptions(sigma_px=0.5))
    block = found.block
    assert [camera.c for camera in block.cameras] == [3.10025, 3.0905]
    assert [camera.lens for camera in block.cameras] == [
        BrownLens(k1=-0.05, k2=0.02),
        BrownLens(k1=-0.04),
    ]
    assert "joined 6 cameras of the same f, k1 and k2: 2 are left" in texts(found.notes)
    assert "pixels, their middle the principal point" in texts(found.notes)
    assert block.precision.image_um == 0.5
    adjusted = adjust_block(block, datum="free")
    assert adjusted.sigma0 < 1e-6  # observations have ten digits
    # from stated orientations, and those are the file's
    for row, photo in zip(adjusted.photo_rows(), block.photos, strict=True):
        assert row.photo == photo.id
    base = np.linalg.norm(np.subtract(block.photos[0].position, block.photos[5].position))
    assert base == pytest.approx(np.linalg.norm((-36.0, -14.0, -5.0)), rel=1e-12)


def test_not_a_digit_is_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = PROBLEM.splitlines()
    lines[0] = "6 14 85"
    lines.insert(85, lines[84].replace("e+0", "e+00", 1))  # a point twice in a photo
    file, block = tmp_path / "p.txt", tmp_path / "b"
    file.write_text("\n".join(lines) + "\n")
    assert main(["import", str(file), "-o", str(block)]) == 0
    assert "doubled: 1 rays" in capsys.readouterr().out
    assert main(["export", "bal", str(block), "-o", str(tmp_path / "out")]) == 0
    assert "dropped: 1 rays that are off or doubled" in capsys.readouterr().out
    assert (tmp_path / "out").read_text() == PROBLEM
    points = block / "image_points.csv"
    rows = points.read_text().splitlines()
    assert "use" in rows[0]
    rows[1] = rows[1].replace(",xy,", ",off,")
    points.write_text("\n".join(rows) + "\n")
    assert read_block(block).image_points[0].use == "off"
    assert main(["export", "bal", str(block), "-o", str(tmp_path / "less")]) == 0
    less = PROBLEM.splitlines()
    assert (tmp_path / "less").read_text().splitlines() == ["6 14 83", *less[2:]]


def test_of_a_doubled_ray_goes_which_is_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = PROBLEM.splitlines()
    lines[0] = "6 14 85"
    lines.insert(2, "0 0 7.5 8.5")
    file, folder = tmp_path / "p.txt", tmp_path / "b"
    file.write_text("\n".join(lines) + "\n")
    assert main(["import", str(file), "-o", str(folder)]) == 0
    read = read_block(folder)
    assert [row.use for row in read.image_points[:2]] == ["xy", "off"]
    turned = [
        replace(row, use="xy" if row.use == "off" else "off") for row in read.image_points[:2]
    ]
    changed = replace(read, image_points=(*turned, *read.image_points[3:]))
    made = bal.write(Exporting(changed, folder), tmp_path / "out")
    # the ray that was taken out of the block is no one's to take out of the problem
    assert "assumed 1 rays that are not in the block stay as they were" in texts(made.notes)
    assert (tmp_path / "out").read_text().splitlines() == ["6 14 84", *lines[2:]]
    # and a source that is damaged is one line
    capsys.readouterr()
    for damaged in ("7 8 9\n", "6 14 85\n0\n", "x y z\n"):
        (folder / "source" / "problem.txt").write_text(damaged)
        assert main(["export", "bal", str(folder), "-o", str(tmp_path / "no")]) == 2
        said = capsys.readouterr().err
        assert "problem.txt line 1: " in said
        assert said.count("\n") == 1


def test_what_import_leaves_out_stays_and_the_ray_that_is_off_goes(tmp_path: Path) -> None:
    lines = PROBLEM.splitlines()
    lines[0] = "6 14 85"
    assert lines[15].startswith("1 0 ")
    lines.insert(15, "01 00 7000 0")  # beyond the lens's fold
    file, block = tmp_path / "p.txt", tmp_path / "b"
    file.write_text("\n".join(lines) + "\n")
    assert main(["import", str(file), "-o", str(block)]) == 0
    read = read_block(block)
    rows = [
        replace(row, use="off") if (row.photo, row.point) == ("1", "0") else row
        for row in read.image_points
    ]
    assert [row.point for row in rows if row.use == "off"] == ["0"]
    switched = replace(read, image_points=tuple(rows))
    bal.write(Exporting(switched, block), tmp_path / "less")
    wanted = ["6 14 84", *lines[1:16], *lines[17:]]
    assert (tmp_path / "less").read_text().splitlines() == wanted


def test_an_adjusted_block_goes_out_anew(tmp_path: Path) -> None:
    block = pixel_table_block()
    control = (*block.control[1:], replace(block.control[0], use="off"))
    block = replace(block, control=control)
    first = adjusted_result(block)
    made = bal.write(Exporting(block, tmp_path, adjusted=first), tmp_path / "out")
    said = texts(made.notes)
    assert "not held 4 control points" in said
    assert "not held None names of photos and points" in said
    found = bal.read(tmp_path / "out", ImportOptions()).block
    for row, photo in zip(first.photos, found.photos, strict=True):
        assert photo.position == pytest.approx(row.position, abs=2e-8)
        assert photo.rotation == pytest.approx(row.rotation, abs=1e-12)
    assert found.cameras[0].c * 1000 == pytest.approx(152400 / 12.5, rel=1e-15)
    mine = {(r.photo, r.point): (r.x / 12.5, r.y / 12.5) for r in block.image_points}
    places = {row.point: str(k) for k, row in enumerate(first.points)}
    photos = {row.photo: str(k) for k, row in enumerate(first.photos)}
    theirs = {(r.photo, r.point): (r.x, r.y) for r in found.image_points}
    assert len(theirs) == len(mine)
    for (photo, point), place in mine.items():
        assert theirs[photos[photo], places[point]] == pytest.approx(place, abs=1e-11)


def test_a_block_in_mm_through_a_lens_is_written_in_pixels(tmp_path: Path) -> None:
    block = pixel_table_block()
    lens = BrownLens(k1=-0.02, k2=0.01)
    camera = replace(block.cameras[0], lens=lens)
    seen = measured_rays(camera, [(row.x, row.y) for row in block.image_points])
    adjusted = adjusted_result(block)
    written = {}
    for pixels in (True, False):
        places = pixels_of_mm(camera, seen) if pixels else seen
        rows = tuple(
            replace(row, measured=(x, y))
            for row, (x, y) in zip(block.image_points, places.tolist(), strict=True)
        )
        same = replace(block, cameras=(camera,), image_points=rows, in_pixels=pixels)
        bal.write(Exporting(same, tmp_path, adjusted=adjusted), tmp_path / str(pixels))
        lines = (tmp_path / str(pixels)).read_text().splitlines()
        written[pixels] = [list(map(float, line.split())) for line in lines[1 : len(rows) + 1]]
    np.testing.assert_allclose(written[False], written[True], atol=1e-9)
    assert np.abs(written[True]).max() > 1000.0  # of 18500 px, 231 mm


def test_what_it_cannot_hold(tmp_path: Path) -> None:
    block = pixel_table_block()
    adjusted = adjusted_result(block)
    lens = replace(block.cameras[0], lens=BrownLens(k1=0.01, p1=0.001))
    for changed, message in (
        (replace(block, cameras=(lens,)), "BAL has k1 and k2 alone"),
        (table_block(), "has no pixels"),
    ):
        with pytest.raises(InputError, match=message):
            bal.write(Exporting(changed, tmp_path, adjusted=adjusted), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("6 14 84", "6 14 1000000000000", "line 1: 6 cameras, 14 points and 1000000000000"),
        ("6 14 84", "999999999999 14 84", "do not fit in"),
        ("6 14 84", "6 14 83", "more numbers than the first line says"),
        ("6 14 84", "6 14 -1", "line 1: the count of observations must lie between 0"),
        ("6 14 84", "6 14", "line 1: three counts are expected"),
        ("6 14 84", "6 13 84", "the point must lie between 0 and 12"),
        ("\n0 0  ", "\n0 0 7 8 ", "line 2: 6 fields"),
        ("\n0 0  ", "\n6 0  ", "line 2: the camera must lie between 0 and 5"),
        ("\n5 13 ", "\n5 13 nan #", "line 85"),
        ("3.1002500000000000e+03", "-3.1002500000000000e+03", "camera 0: f must be greater than 0"),
        ("3.1002500000000000e+03", "inf", "a number of camera 0 must be a finite number"),
    ],
)
def test_damage_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in PROBLEM
    file = tmp_path / "p.txt"
    file.write_text(PROBLEM.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        bal.read(file, ImportOptions())
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("zero", ["1e-99999999999999999999", "-0e99999999999999999999"])
def test_an_exponent_beyond_all_bounds_is_zero(tmp_path: Path, zero: str) -> None:
    at = PROBLEM.index("\n") + 1
    camera, point, _, y = PROBLEM[at:].split("\n")[0].split()
    rest = PROBLEM[at:].split("\n", 1)[1]
    rows = []
    for k, x in enumerate((zero, "0")):
        file = tmp_path / f"{k}.txt"
        file.write_text(f"{PROBLEM[:at]}{camera} {point} {x} {y}\n{rest}")
        rows.append(bal.read(file, ImportOptions()).block.image_points[0])
    assert (rows[0].x, rows[0].y) == (rows[1].x, rows[1].y)


def test_a_cut_file_says_where(tmp_path: Path) -> None:
    file = tmp_path / "p.txt"
    lines = PROBLEM.splitlines()
    # what the first line claims would fit, since the lines are long
    for count, message in (
        (50, "ends among the obs"),
        (100, "ends in camera 1"),
        (170, "ends in p"),
    ):
        file.write_text("\n".join(lines[:count]))
        with pytest.raises(InputError, match=message):
            bal.read(file, ImportOptions())
    file.write_text(PROBLEM + "7\n")
    with pytest.raises(InputError, match="more numbers than the first line says"):
        bal.read(file, ImportOptions())
