"""Tables of image points: titles, numbers of columns, units, axes, control, and what is wrong."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiltedblock import CX, CY, FX, FY, HEIGHT, K1, K2, P1, P2, WIDTH, tilted_block

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.camerafile import write_camera
from anaplot.exchange.formats import pixels
from anaplot.exchange.formats.door import Exporting, ImportOptions
from anaplot.photogrammetry.camera import BrownLens, CameraCalibration

HEAD = "image,id,u,v\n"
ROWS = "a/1.jpg,p 1,100.5,200\nb.jpg,p 1,300,400.25\n"
PLAIN = ImportOptions(c=3000.0, pixels=(4000, 3000))


def measured(at: Path, text: str, options: ImportOptions = PLAIN) -> list[tuple[float, float]]:
    at.write_bytes(text.encode())
    return [p.measured or (p.x, p.y) for p in pixels.read(at, options).block.image_points]


@pytest.mark.slow
def test_a_table_and_its_control_become_a_block(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tilted_block()
    table = "\ufeffBild;Punkt;u [px];v [px];Bemerkung\r\n" + "".join(
        f'"{scene.names[k]}";{j};{x!r};{y!r};-\r\n'.replace(".", ",").replace(",jpg", ".jpg")
        for k, j, x, y in scene.pixels
    )
    (tmp_path / "points.csv").write_text(table)
    control = [f"{j} {x:.4f} {y:.4f} {z:.4f}" for j, (x, y, z) in enumerate(scene.points[:7])]
    (tmp_path / "gcp.txt").write_text("# id X Y Z\n" + "\n".join(control[:5]))
    (tmp_path / "check.txt").write_text("name,E,N,H\n" + "\n".join(control[5:]).replace(" ", ","))
    calibration = CameraCalibration(
        "fc",
        FY * 2.5e-3,
        lens=BrownLens(K1, K2, 0.0, P1, P2, FX / FY - 1.0),
        pixels=(WIDTH, HEIGHT),
        pixel_um=2.5,
        principal_px=(CX, CY),
    )
    write_camera(tmp_path / "fc.toml", calibration)
    block, out = tmp_path / "block", tmp_path / "out"
    given = [f"control={tmp_path / 'gcp.txt'}", "--with", f"check={tmp_path / 'check.txt'}"]
    command = ["import", "pixels", str(tmp_path / "points.csv"), "-o", str(block), "--with", *given]
    assert main([*command, "--camera", str(tmp_path / "fc.toml"), "--sigma-px", "0.4"]) == 0
    said = capsys.readouterr().out
    assert "photo = 'Bild' (guessed), point = 'Punkt' (guessed), x = 'u [px]' (guessed)" in said
    assert "numbers have a decimal comma" in said
    assert "1 columns that are not read ('Bemerkung')" in said
    k, j, x, y = scene.pixels[0]
    assert f"line 2 is photo '{scene.names[k]}', point '{j}', x {x:.10g}, y {y:.10g}" in said
    read = read_block(block)
    assert read.precision.image_um == pytest.approx(1.0)
    assert [row.measured for row in read.image_points] == [row[2:] for row in scene.pixels]
    assert [row.use for row in read.control] == ["control"] * 5 + ["check"] * 2

    assert main(["adjust", str(block), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert 0.85 < found["sigma0"] < 1.15  # some 250 degrees of freedom: 3.3 sigma
    for point in found["points"]:
        truth = scene.points[int(point["point"])]
        for axis, value in zip("XYZ", truth, strict=True):
            assert abs(point[axis] - value) < 5.0 * point[f"s{axis}"] + 1e-3

    assert main(["export", "pixels", str(block), "-o", str(out)]) == 0
    again = tmp_path / "again"
    command = ["import", str(out / "points.csv"), "-o", str(again), "--sigma-px", "0.4"]
    command += ["--with", f"camera:fc={out / 'camera-1.toml'}"]
    assert main([*command, "--with", f"control={out / 'control.csv'}"]) == 0
    twice = read_block(again)
    for part in ("image_points", "control", "cameras", "photos", "precision"):
        assert getattr(twice, part) == getattr(read, part)


@pytest.mark.parametrize("name", ["d'q/b l", "x" * 70])
def test_the_command_that_is_next_can_be_typed(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text(HEAD + ROWS)
    options = ["--c", "3000", "--pixels", "4000x3000", "-o", name]
    assert main(["import", "pixels", "t.csv", *options]) == 0
    said = capsys.readouterr().out.splitlines()[-1]
    assert said.startswith("next: anaplot ")
    assert main(shlex.split(said)[2:]) == 0


def test_titles_are_stated_by_name_or_by_number(tmp_path: Path) -> None:
    at = tmp_path / "t.csv"
    odd = "a;b;c;d\nx;1;5;6\ny;1;7;8\n"
    columns = {"photo": "a", "point": "b", "x": "c", "y": "D"}
    assert measured(at, odd, ImportOptions(columns=columns, c=1.0, pixels=(10, 10))) == [
        (5.0, 6.0),
        (7.0, 8.0),
    ]
    numbers = {"photo": "4", "point": "3", "x": "1", "y": "2"}
    bare = "5\t6\t1\tx\n7\t8\t1\ty\n"
    block = pixels.read(
        *written(at, bare, ImportOptions(columns=numbers, c=1.0, pixels=(10, 10)))
    ).block
    assert [photo.id for photo in block.photos] == ["x", "y"]
    assert [p.measured for p in block.image_points] == [(5.0, 6.0), (7.0, 8.0)]


def written(at: Path, text: str, options: ImportOptions) -> tuple[Path, ImportOptions]:
    at.write_text(text)
    return at, options


def test_a_bare_table_is_point_photo_x_y_and_says_so(tmp_path: Path) -> None:
    at = tmp_path / "t.txt"
    found = pixels.read(*written(at, "7 a 100 200 0.5 1.5\n7   b 100 200 1 1\n", PLAIN))
    assert [(p.photo, p.point) for p in found.block.image_points] == [("a", "7"), ("b", "7")]
    assert [p.sigma_um for p in found.block.image_points] == [np.sqrt(1.25), 1.0]
    said = [note.text for note in found.notes]
    assert "columns: photo = column 2 (guessed), point = column 1 (guessed)" in said[0]
    assert any("are exchanged" in text for text in said)  # more photos than points
    assert any(note.what == "changed" and note.count == 1 for note in found.notes)


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        (None, (100.5, 200.0)),
        ("up", (100.5, 2800.0)),
        ("pixel-centre", (101.0, 200.5)),
        ("pixel-centre,up", (101.0, 2799.5)),
        ("middle", (2100.5, 1700.0)),
        ("up,middle", (2100.5, 1300.0)),
    ],
)
def test_origin_and_axes(tmp_path: Path, order: str | None, expected: tuple[float, float]) -> None:
    options = ImportOptions(c=3000.0, pixels=(4000, 3000), order=order)
    assert measured(tmp_path / "t.csv", HEAD + ROWS, options)[0] == expected


@pytest.mark.parametrize(
    ("unit", "order", "expected"),
    [
        ("mm", None, (1.25, -2.0)),
        ("um", None, (0.00125, -0.002)),
        ("mm", "down", (1.25, 2.0)),
    ],
)
def test_millimetres(
    tmp_path: Path, unit: str, order: str | None, expected: tuple[float, float]
) -> None:
    at = tmp_path / "t.csv"
    options = ImportOptions(c=50.0, unit=unit, order=order)  # type: ignore[arg-type]
    found = measured(at, "photo,point,x,y,sx\na,1,1.25,-2,2\nb,1,0,0,\n", options)
    np.testing.assert_allclose(found[0], expected, rtol=1e-15)
    block = pixels.read(at, options).block
    assert not block.in_pixels
    assert block.image_points[0].sigma_um == pytest.approx(2000.0 if unit == "mm" else 2.0)


def test_millimetres_through_a_lens_are_pixels_on_the_sensor(tmp_path: Path) -> None:
    write_camera(
        tmp_path / "c.toml",
        CameraCalibration(
            "c",
            8.0,
            lens=BrownLens(k1=-0.1),
            pixels=(4000, 3000),
            pixel_um=2.0,
            principal_px=(1990.0, 1510.0),
        ),
    )
    px = measured(tmp_path / "p.csv", HEAD + ROWS, ImportOptions(camera=tmp_path / "c.toml"))
    mm = [((x - 1990.0) * 0.002, (1510.0 - y) * 0.002) for x, y in px]
    text = "photo,point,x_mm,y_mm\n" + "".join(
        f"{photo},p 1,{x!r},{y!r}\n" for photo, (x, y) in zip(("a/1.jpg", "b.jpg"), mm, strict=True)
    )
    one = pixels.read(tmp_path / "p.csv", ImportOptions(camera=tmp_path / "c.toml")).block
    other = pixels.read(
        *written(tmp_path / "m.csv", text, ImportOptions(camera=tmp_path / "c.toml"))
    )
    assert not other.block.in_pixels
    for a, b in zip(one.image_points, other.block.image_points, strict=True):
        np.testing.assert_allclose((a.x, a.y), (b.x, b.y), atol=1e-12)


def test_several_cameras(tmp_path: Path) -> None:
    rows = "photo,point,x,y\na,1,10,20\nb,1,30,40\nc,1,50,60\n"
    (tmp_path / "cameras.txt").write_text("a left\nb right\nc left\n")
    write_camera(
        tmp_path / "r.toml", CameraCalibration("any", 5.0, pixels=(100, 80), pixel_um=50.0)
    )
    files = {"cameras": tmp_path / "cameras.txt", "camera:right": tmp_path / "r.toml"}
    options = ImportOptions(c=3000.0, pixels=(4000, 3000), files=files)
    block = pixels.read(*written(tmp_path / "t.csv", rows, options)).block
    assert {c.id: c.pixels for c in block.cameras} == {"left": (4000, 3000), "right": (100, 80)}
    assert [photo.camera for photo in block.photos] == ["left", "right", "left"]
    assert [camera.c for camera in block.cameras] == [3.0, 5.0]  # 3000 px of 1 um
    # one pixel of each camera, not of the first one for all
    for stated, um, sigmas in (
        ({}, 1.0, [None, 50.0, None]),
        ({"sigma_px": 0.5}, 0.5, [None, 25.0, None]),
        ({"sigma_um": 3.0}, 3.0, [None, None, None]),
    ):
        block = pixels.read(tmp_path / "t.csv", replace(options, **stated)).block
        assert block.precision.image_um == um
        assert [row.sigma_um for row in block.image_points] == sigmas
    (tmp_path / "cameras.txt").write_text("a left\nb right\n")
    with pytest.raises(InputError, match="photo 'c': no row says"):
        pixels.read(tmp_path / "t.csv", options)


def test_rays_of_cameras_with_different_pixels_keep_their_weights(tmp_path: Path) -> None:
    for name, size in (("left", 5.0), ("right", 50.0)):
        stated = CameraCalibration(name, 5.0, pixels=(100, 80), pixel_um=size)
        write_camera(tmp_path / f"{name}.toml", stated)
    of = {f"camera:{name}": tmp_path / f"{name}.toml" for name in ("left", "right")}
    options = ImportOptions(files=of, sigma_um=3.0)
    rows = "photo,point,x,y,camera\na,1,10,20,left\nb,1,30,40,right\n"
    block = pixels.read(*written(tmp_path / "t.csv", rows, options)).block
    pixels.write(Exporting(block, tmp_path), tmp_path / "out")
    again = pixels.read(tmp_path / "out" / "points.csv", ImportOptions(files=of)).block
    assert [row.sigma_um for row in again.image_points] == [3.0, 3.0]


def test_a_sigma_in_pixels_needs_the_size_of_a_pixel_of_every_camera(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("a left\nb right\n")
    for name, size in (("left", {"pixels": (100, 80), "pixel_um": 50.0}), ("right", {})):
        write_camera(tmp_path / f"{name}.toml", CameraCalibration(name, 5.0, **size))
    files = {"cameras": tmp_path / "cameras.txt"}
    files |= {f"camera:{name}": tmp_path / f"{name}.toml" for name in ("left", "right")}
    options = ImportOptions(files=files, unit="mm", sigma_px=0.5)
    with pytest.raises(InputError, match="--sigma-px: of image coordinates in mm"):
        pixels.read(*written(tmp_path / "t.csv", "photo,point,x,y\na,1,1,2\nb,1,3,4\n", options))


WRONG = [
    ("", "no row"),
    ("# nothing\n", "no row"),
    (HEAD, "no row"),
    ("image,id,u\na,1,2\n", "no column for y among 'image', 'id', 'u'"),
    (HEAD + "a,1,nan,2\n", "line 2: x must be a finite number, not 'nan'"),
    (HEAD + f"a,1,1{'0' * 400},2\n", "x must be a finite number"),
    (HEAD + "a,1,1e999,2\n", "x must be a finite number"),
    (HEAD + "a,1,1_0,2\n", "x must be a finite number"),
    (HEAD + "a,1,2\n", "line 2: 3 fields, the first row has 4"),
    (HEAD + "a,1,2,3,4\n", "line 2: 5 fields, the first row has 4"),
    (HEAD + 'a,"1,2,3\n', "line 2: not a row"),
    (HEAD + ",1,2,3\n", "the photo name '' is empty"),
    (HEAD + "a\x1b[2J,1,2,3\n", "holds a character that cannot be printed"),
    (HEAD + "a," + "n" * 300 + ",2,3\n", "longer than 255"),
    (HEAD + "a,1,9000,3\n", "no ray lies in its image"),
    ("image,id,u,u,v\na,1,2,3,4\n", "column 'u' twice"),
    ("1 2 3\n", "no header, and 3 columns"),
    (",".join(["x"] * 5000) + "\n", "more than 200 are not read"),
    (HEAD + "a," + "n" * 200_000 + "\n", "longer than 100000 characters"),
    (HEAD.strip() + ",use\na,1,2,3,maybe\n", "use must be one of"),
    (HEAD.strip() + ",sigma\na,1,2,3,0\n", "sigma must be greater than 0"),
    (HEAD.strip() + ",sigma\na,1,2,3,1e150\n", "t.csv line 2: sigma 1e+150 is too large"),
    (f"{HEAD.strip()},reason\na,1,2,3,{'n' * 401}\n", "line 2: reason is longer than 400"),
    (HEAD.strip() + ",reason\na,1,2,3,a\x1bb\n", "line 2: reason holds a character"),
    (HEAD.strip() + ",camera\na,1,2,3,k\nb,1,2,3,\n", "photo 'b': no row says which camera"),
    (HEAD.strip() + ",camera\na,1,2,3,k\na,2,2,3,l\n", "photo 'a' has camera 'k' already"),
    ("photo;point;x;y\na;1;1,5,5;2\n", "x must be a finite number"),
]


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_what_is_wrong_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    (tmp_path / "t.csv").write_bytes(text.encode())
    command = ["import", "pixels", str(tmp_path / "t.csv"), "-o", str(tmp_path / "b")]
    assert main([*command, "--c", "3000", "--pixels", "4000x3000"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert "\x1b" not in error
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "the camera constant is not known"),
        (["--c", "3000"], "the size of the images in pixels is not known"),
        (["--c", "3", "--camera", "x"], "beside --camera"),
        (["--c", "3", "--pixels", "0x5"], "--pixels: from 1"),
        (["--c", "3", "--pixels", "40x30", "--sigma-px", "1", "--sigma-um", "1"], "only one"),
        (["--order", "north"], "neither of corner"),
        (["--order", "up,down"], "only one origin"),
        (["--unit", "mm", "--order", "corner"], "count from the principal point"),
        (["--column", "foto=image"], "no such column \\(did you mean 'photo'"),
        (["--column", "photo=imago"], "no column 'imago' \\(did you mean 'image'"),
        (["--column", "photo=9"], "there are 4 columns"),
        (["--column", "photo=u"], "no column for x|is stated"),
        (["--column", "photo=1", "--column", "point=image"], "is stated for photo and for point"),
        (["--with", "cntrl=x"], "--with cntrl"),
        (["--c", "3", "--pixels", "40x30", "--with", "camera:l=x"], "no column camera"),
        (["--c", "3", "--unit", "mm", "--sigma-px", "1"], "needs the size of a pixel"),
        (["--c", "3", "--unit", "mm", "--pixels", "40x30"], "--pixel-um"),
    ],
)
def test_options_that_do_not_fit(tmp_path: Path, options: list[str], message: str) -> None:
    import argparse

    from anaplot.report.doorarguments import add_import_arguments
    from anaplot.report.importcommand import run_import

    (tmp_path / "t.csv").write_text(HEAD + ROWS)
    parser = argparse.ArgumentParser()
    add_import_arguments(parser)
    given = ["pixels", str(tmp_path / "t.csv"), "-o", str(tmp_path / "b"), *options]
    with pytest.raises(InputError, match=message):
        run_import(parser.parse_args(given))


def test_blanks_part_a_bare_table_whose_commas_are_decimal_ones(tmp_path: Path) -> None:
    rows = 'A 1 100,5 200\n"B 2" 1 -3,25 +400,125\nA 2 300 400\n'
    assert measured(tmp_path / "t.txt", rows)[0] == (100.5, 200.0)
    found = pixels.read(tmp_path / "t.txt", PLAIN)
    assert [note.count for note in found.notes if "decimal comma" in note.text] == [3]
    # a comma without blanks about numbers separates
    for text in ("A,1,100.5,200\n", "A ,1 ,100.5 ,200\n", "A 7,1 b,100,200\n", '"A, 1",1,2,3\n'):
        assert measured(tmp_path / "t.txt", text + "B,2,1,2\n")[1] == (1.0, 2.0)


def test_blanks_in_names_part_no_list_of_cameras(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("IMG 1,20 mm\nIMG 2,20 mm\n")
    rows = "point,photo,x,y\nA,IMG 1,100,200\nA,IMG 2,100,200\n"
    (tmp_path / "t.csv").write_text(rows)
    options = replace(PLAIN, files={"cameras": tmp_path / "cameras.txt"})
    (camera,) = pixels.read(tmp_path / "t.csv", options).block.cameras
    assert camera.id == "20 mm"


@pytest.mark.parametrize("head", ["", "point X Y Z\n"])
@pytest.mark.parametrize("mark", [";", "\t", " "])
def test_control_with_decimal_commas(tmp_path: Path, mark: str, head: str) -> None:
    control = head + "A 1000,5 2000,25 100,125\nB 1 2 3,5\n"
    (tmp_path / "control.txt").write_text(control.replace(" ", mark))
    (tmp_path / "t.csv").write_text(HEAD + ROWS)
    options = replace(PLAIN, files={"control": tmp_path / "control.txt"})
    found = pixels.read(tmp_path / "t.csv", options)
    assert [row.xyz for row in found.block.control] == [(1000.5, 2000.25, 100.125), (1, 2, 3.5)]
    assert [note.count for note in found.notes if "decimal comma" in note.text] == [4]


def test_control_that_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(HEAD + ROWS)
    for text, message in (
        ("1 2 3 4\n1 2 3 4\n", "line 2: point '1' twice"),
        ("1 2 3 4 -1\n", "must not be negative"),
        ("1 1e13 3 4\n", "line 1: X must lie between"),
        ("1 2 3 4 1e150\n", "line 1: sigma 1e.150 is too large"),
        ("1 2 3\n", "no header, and 3 columns"),
        ("name,E,N,nix\n1,2,3,4\n", "unknown column 'nix'"),
    ):
        (tmp_path / "g.txt").write_text(text)
        options = ImportOptions(c=3.0, pixels=(4000, 3000), files={"control": tmp_path / "g.txt"})
        with pytest.raises(InputError, match=message):
            pixels.read(tmp_path / "t.csv", options)
