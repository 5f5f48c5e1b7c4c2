"""`anaplot inner --apply`: from measured plates to the block's image_points.csv, by files alone."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_innercommand import options

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, read_declared
from anaplot.exchange.camerafile import parse_camera
from anaplot.exchange.fiducialfile import read_fiducials
from anaplot.exchange.lockfile import FolderLock
from anaplot.photogrammetry.inner import InnerOrientation, orient_inner
from anaplot.photogrammetry.platetransformation import Placement
from anaplot.photogrammetry.refinement import Refinement
from anaplot.report.innerapply import merged, points_of, write
from anaplot.report.innercommand import run_inner
from anaplot.session.plates import PlateSystem
from anaplot.simulation.laidplates import laid_photographs

CAMERA = """\
format = 1
[camera]
id = "rmk"
c = 152.40
format = [230.0, 230.0]
principal_point = [0.012, -0.004]
[fiducials]
1 = [-106.003, 106.001]
2 = [106.000, 105.998]
3 = [106.002, -106.000]
4 = [-105.998, -106.003]
5 = [-113.000, 0.012]
6 = [0.003, 113.004]
7 = [113.001, -0.004]
8 = [0.000, -112.998]
[distortion]
table = [[40.0, 12.2], [100.0, -8.0], [163.0, 21.0]]
decentring = [1e-8, -2e-8]
"""
CALIBRATION = parse_camera(CAMERA, Path("rmk.toml"))
BLOCK = """\
format = 1
name = "test"
[[camera]]
file = "rmk.toml"
[[strip]]
id = "1"
photos = ["101", "102", "103"]
"""
MM = Placement(120.0, 110.0, 0.01, 1e-4, 0.9995, 1.0003)
SCAN = Placement(4700.0, 4800.0, -0.02, 2e-4, 40.01, 40.02, mirrored=True)
COUNTS = Placement(-1.2e5, 3.3e5, 2.9, 0.0, 3333.3, 3331.1)


class Bench(NamedTuple):
    """A block, the file of fiducials and the file of points; `truth` by (photo, point)."""

    block: Path
    fiducials: Path
    points: Path
    truth: dict[tuple[str, str], tuple[float, float]]

    def run(self, *more: object) -> int:
        given = (self.fiducials, "--points", self.points, "--apply", self.block, *more)
        return run_inner(options(*given))

    def rows(self):
        return {(row.photo, row.point): row for row in read_declared_rows(self.block)}

    def refused(self, *more: object) -> str:
        before = contents(self.block)
        with pytest.raises(InputError) as caught:
            self.run(*more)
        assert contents(self.block) == before
        message = str(caught.value)
        assert "\n" not in message
        assert message.isprintable()
        return message


def read_declared_rows(folder: Path):
    return read_block(folder).image_points


def contents(folder: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in folder.iterdir() if one.is_file()}


def plate(lie: Placement, ideal: np.ndarray) -> np.ndarray:
    """Lay ideal image coordinates on a plate, by the inverse of refinement and placement."""
    return lie.transformation().to_plate(Refinement.of(CALIBRATION).distort(ideal))


def fiducial_text(photos: Iterable[str], lie: Placement, unit: str = "mm", count: int = 8) -> str:
    marks = CALIBRATION.fiducials[:count]
    at = lie.transformation().to_plate(np.array([(m.x, m.y) for m in marks])).tolist()
    lines = ["format = 1", 'camera = "rmk.toml"', f'unit = "{unit}"']
    for photo in photos:
        lines.append(f'[photo."{photo}"]')
        lines += [f"{m.id} = [{x!r}, {y!r}]" for m, (x, y) in zip(marks, at, strict=True)]
    return "\n".join(lines) + "\n"


@pytest.fixture
def make_bench(tmp_path: Path) -> Callable[..., Bench]:
    """Return a function that makes a bench of plates that lie in some way."""

    def make(lie: Placement = MM, unit: str = "mm", toml: str = BLOCK, count: int = 8) -> Bench:
        block = tmp_path / "block"
        block.mkdir()
        (block / "block.toml").write_text(toml)
        for folder in (block, tmp_path):
            (folder / "rmk.toml").write_text(CAMERA)
        fiducials, points = tmp_path / "fid.toml", tmp_path / "points.csv"
        fiducials.write_text(fiducial_text(("101", "102"), lie, unit, count))
        draw = np.random.default_rng(5)
        truth = {
            (photo, str(k)): tuple(draw.uniform(-108.0, 108.0, 2).tolist())
            for photo in ("102", "101")
            for k in range(1, 14)
        }
        at = plate(lie, np.array(list(truth.values()))).tolist()
        rows = [f"{p},{k},{x!r},{y!r}" for (p, k), (x, y) in zip(truth, at, strict=True)]
        points.write_text("photo,point,x,y\n" + "\n".join(rows) + "\n")
        return Bench(block, fiducials, points, truth)

    return make


@pytest.mark.parametrize(
    ("lie", "unit", "count"),
    [(MM, "mm", 8), (MM, "mm", 4), (SCAN, "px", 8), (COUNTS, "count", 8),
     (MM._replace(mirrored=True), "mm", 8),
     (Placement(1e5, 2e4, 1.0, 0.0, 999.0, 1000.5), "um", 8)],
)  # fmt: skip
def test_what_was_laid_on_a_plate_comes_back(make_bench, capsys, lie, unit, count):
    bench = make_bench(lie, unit, count=count)
    assert bench.run("--fail-on-flag") == 0
    assert capsys.readouterr().err == ""
    found = bench.rows()
    assert list(found) == list(bench.truth)
    for key, place in bench.truth.items():
        # as the session writes it, with seven decimals
        assert (found[key].x, found[key].y) == pytest.approx(place, abs=0.52e-7)
        assert found[key].sigma_um is None


@pytest.mark.parametrize("kind", ["affine", "bilinear", "projective"])
def test_by_every_transformation(make_bench, kind):
    bench = make_bench(SCAN, "px")
    assert bench.run("--transformation", kind) == 0
    found = bench.rows()
    for key, place in bench.truth.items():
        assert (found[key].x, found[key].y) == pytest.approx(place, abs=0.52e-7)


def test_the_function_itself_is_exact():
    """Not rounded: what is laid by the inverse comes back to a nanometre's thousandth."""
    for lie in (MM, SCAN, COUNTS):
        ideal = np.random.default_rng(1).uniform(-110.0, 110.0, (50, 2))
        image = lie.transformation().to_image(plate(lie, ideal))
        np.testing.assert_allclose(Refinement.of(CALIBRATION).refine(image), ideal, atol=1e-9)


def test_it_is_what_the_session_writes(make_bench):
    bench = make_bench(SCAN, "px")
    assert bench.run() == 0
    marks = {m.id: SCAN.transformation().to_plate(np.array([[m.x, m.y]]))[0].tolist()
             for m in CALIBRATION.fiducials}  # fmt: skip
    inner = orient_inner(CALIBRATION, {k: (x, y) for k, (x, y) in marks.items()})
    system = PlateSystem(inner.transformation, CALIBRATION)
    with bench.points.open(newline="") as file:
        for row in csv.DictReader(file):
            written = bench.rows()[row["photo"], row["point"]]
            assert (written.x, written.y) == system.to_image(float(row["x"]), float(row["y"]))


def test_a_mirrored_scan_is_said_to_be_one_and_has_no_shrinkage(make_bench, capsys):
    bench = make_bench(SCAN, "px")
    assert run_inner(options(bench.fiducials)) == 0
    out = capsys.readouterr().out
    assert "mirrored: y runs down, or seen from behind" in out
    assert "scale     x 40.010000  y 40.020000 px/mm: one px is 24.9938 x 24.9875 um" in out
    assert "px on the plate" in out
    assert "shrinkage" not in out
    assert "the scale of the plate" not in out
    assert run_inner(options(bench.fiducials, "--json")) == 0
    photo = json.loads(capsys.readouterr().out)["photos"][0]
    place = photo["placement"]
    assert (place["unit"], place["mirrored"], place["shrinkage_x_ppm"]) == ("px", True, None)
    assert (photo["camera"], place["scale_x"]) == ("rmk", pytest.approx(40.01))


def test_pixels_that_are_not_said_to_be_pixels(make_bench, capsys):
    bench = make_bench(SCAN, "mm")
    assert run_inner(options(bench.fiducials)) == 0
    assert "are the plate coordinates in mm, and is it this camera?" in capsys.readouterr().out


def test_what_is_said(make_bench, capsys):
    bench = make_bench()
    assert bench.run("--json") == 0
    answer = json.loads(capsys.readouterr().out)
    applied = answer["applied"]
    assert (applied["points"], applied["replaced"], applied["without_points"]) == (26, 0, [])
    assert [(p["photo"], p["points"], p["fiducials"]) for p in applied["photos"]] == [
        ("102", 13, 8),
        ("101", 13, 8),
    ]
    assert [p["photo"] for p in answer["photos"]] == ["101", "102"]
    assert bench.run("--replace") == 0
    out = capsys.readouterr().out
    assert "26 image points of 2 photos in " in out
    assert "26 rows are replaced" in out
    assert "INNER is common to a photo's points" in out
    assert "101, 102: nothing is flagged" in out


def test_how_precisely_a_point_is_carried():
    """By the derivatives of the whole fit, numerically, for every transformation."""
    at = SCAN.transformation().to_plate(np.array([(m.x, m.y) for m in CALIBRATION.fiducials]))
    at = at + np.random.default_rng(3).normal(size=at.shape) * 0.2
    names = [m.id for m in CALIBRATION.fiducials]
    points = SCAN.transformation().to_plate(np.array([[0.0, 0.0], [90.0, -70.0], [-100.0, 5.0]]))

    def oriented(places: np.ndarray, kind) -> InnerOrientation:
        named = dict(zip(names, map(tuple, places.tolist()), strict=True))
        return orient_inner(CALIBRATION, named, transformation=kind, apriori_um=5.0)

    for kind in ("helmert", "affine", "bilinear", "projective"):
        columns = []
        step = 1e-3
        for k in range(at.size):
            moved = np.zeros(at.size)
            moved[k] = step
            two = [
                oriented(at + sign * moved.reshape(at.shape), kind).transformation.to_image(points)
                for sign in (1.0, -1.0)
            ]
            columns.append((two[0] - two[1]) / (2.0 * step))
        by_plate = np.array(columns)
        inner = oriented(at, kind)
        # a coordinate's sigma is 5 um in the image, that many pixels on the plate
        scale = np.hypot(*np.linalg.svd(inner.transformation.jacobian(points[:1])[0])[1]) / 2**0.5
        expected = 5.0 / scale * np.sqrt(np.sum(by_plate**2, axis=0))
        told = inner.carried_um(points)
        assert told is not None
        np.testing.assert_allclose(told, expected, rtol=2e-3)


def test_sigmas_in_either_unit(make_bench):
    bench = make_bench(SCAN, "px")
    lines = bench.points.read_text().splitlines()
    head = lines[0] + ",sigma,sigma_um"
    bench.points.write_text(
        "\n".join([head, lines[1] + ",.2,", lines[2] + ",,3.5", lines[3] + ",,"])
    )
    assert bench.run() == 0
    first, second, third = bench.rows().values()
    assert first.sigma_um == pytest.approx(0.2 * 1e3 / (40.01 * 40.02) ** 0.5, rel=1e-5)
    assert (second.sigma_um, third.sigma_um) == (3.5, None)
    bench.points.write_text("\n".join([lines[0] + ",sigma,sigma_um", lines[1] + ",0.2,3"]))
    assert "points.csv line 2: sigma: sigma beside sigma_um" in bench.refused("--replace")


def test_models_uses_and_reasons_are_carried_along(make_bench):
    bench = make_bench()
    lines = bench.points.read_text().splitlines()
    bench.points.write_text(
        f"{lines[0]},model,use,reason\n{lines[1]},101/102,x,\n{lines[1]},102/103,off,blurred\n"
    )
    assert bench.run() == 0
    first, second = read_declared_rows(bench.block)
    assert (first.model, first.use, first.reason) == ("101/102", "x", None)
    assert (second.model, second.use, second.reason) == ("102/103", "off", "blurred")
    bench.points.write_text(f"{lines[0]},model\n{lines[1]},101/103\n")
    assert "points.csv line 2: model: " in bench.refused("--replace")


@pytest.mark.slow
def test_rows_that_a_session_has_accepted_stay(tmp_path, capsys):
    """They came back beside the new ones when the block was opened."""
    session = Path(__file__).parents[1] / "sessions" / "changes.jsonl"
    folder = tmp_path / "b"
    assert main(["replay", str(session), "--to", str(folder)]) == 0
    (folder / "sessions").mkdir()
    (folder / "sessions" / "0001.jsonl").write_bytes(session.read_bytes())
    (camera,) = read_block(folder).cameras
    corners = {
        "1": (-110.0, -110.0),
        "2": (110.0, 110.0),
        "3": (-110.0, 110.0),
        "4": (110.0, -110.0),
    }
    marks = "".join(f"{name} = [{x}, {y}]\n" for name, (x, y) in corners.items())
    head = f'format = 1\n[camera]\nid = "{camera.id}"\nc = {camera.c}\n[fiducials]\n'
    (tmp_path / "camera.toml").write_text(head + marks)
    bench = Bench(folder, tmp_path / "scan.toml", tmp_path / "points.csv", {})
    bench.fiducials.write_text(f'format = 1\ncamera = "camera.toml"\n[photo.102]\n{marks}')
    bench.points.write_text("photo,point,x,y\n102,new,10.0,20.0\n")
    capsys.readouterr()
    for words in ([], ["--replace"]):
        message = bench.refused(*words)
        assert "photo '102' was measured in the console (model 101/102), which brings" in message
        assert "--replace" not in message


def test_rows_of_other_photos_stay_and_of_the_same_only_go_when_asked(make_bench, capsys):
    bench = make_bench()
    old = "photo,point,x,y,use,reason\n103,7,1.5,2.5,xy,\n102,99,3.0,4.0,off,mine\n"
    (bench.block / "image_points.csv").write_text(old)
    message = bench.refused()
    assert "image_points.csv: photo '102' has 1 row already; --replace" in message
    assert bench.run("--replace") == 0
    out = capsys.readouterr().out
    assert "1 row is replaced, 1 of them had coordinates switched off" in out
    found = bench.rows()
    assert found["103", "7"].x == 1.5
    assert ("102", "99") not in found
    assert len(found) == 27


def test_several_files_of_both_kinds(make_bench, tmp_path, capsys):
    bench = make_bench()
    second, more = tmp_path / "scan.toml", tmp_path / "more.csv"
    second.write_text(fiducial_text(("103",), SCAN, "px"))
    ((x, y),) = plate(SCAN, np.array([[10.0, -20.0]])).tolist()
    more.write_text(f"photo,point,x,y\n103,1,{x!r},{y!r}\n")
    given = (bench.fiducials, second, "--points", bench.points, "--points", more)
    assert run_inner(options(*given, "--apply", bench.block)) == 0
    capsys.readouterr()
    assert len(bench.rows()) == 27
    assert bench.rows()["103", "1"].x == pytest.approx(10.0, abs=1e-7)
    # without --apply both are shown
    assert run_inner(options(bench.fiducials, second, "--json")) == 0
    photos = json.loads(capsys.readouterr().out)["photos"]
    assert [p["placement"]["unit"] for p in photos] == ["mm", "mm", "px"]
    # the same photo, or the same point, in two files
    second.write_text(fiducial_text(("102",), SCAN, "px"))
    with pytest.raises(InputError, match=r"scan\.toml line 4: .*'102' stands in .*fid\.toml too"):
        run_inner(options(bench.fiducials, second))
    more.write_text("photo,point,x,y\n102,1,5,5\n")
    assert "more.csv line 2: point '1' of photo '102' stands in " in bench.refused(
        "--points", more, "--replace"
    )


def as_table(bench: Bench) -> Path:
    """Bring the bench's fiducials into a table of their own."""
    head, _, photos = bench.fiducials.read_text().partition("[photo")
    rows = ["photo,fiducial,x,y"]
    for line in ("[photo" + photos).splitlines():
        if line.startswith("["):
            photo = line.split('"')[1]
        else:
            name, _, place = line.partition(" = ")
            rows.append(f"{photo},{name},{place.strip('[]')}")
    table = bench.fiducials.with_name("fid.csv")
    table.write_text("\n".join(rows) + "\n")
    bench.fiducials.write_text(head + 'measured = "fid.csv"\n')
    return table


def test_fiducials_in_a_table(make_bench):
    bench = make_bench(SCAN, "px")
    before = read_fiducials(bench.fiducials)
    table = as_table(bench)
    assert read_fiducials(bench.fiducials) == before
    assert bench.run() == 0
    assert bench.rows()["101", "3"].x == pytest.approx(bench.truth["101", "3"][0], abs=1e-7)
    good, toml = table.read_text(), bench.fiducials.read_text()
    for old, new, words in [
        ("101,1,", "101,9,", "fid.csv line 2: fiducial: unknown fiducial of camera 'rmk': '9'"),
        ("101,2,", "101,1,", "fid.csv line 3: fiducial '1' twice in photo '101'"),
        ("101,2,", "101,2,1e10,5\n101,2,", "fid.csv line 3: x: must lie between"),
        (good, "photo,fiducial,x,y\n", "fid.csv: no photo"),
        ("fiducial,", "mark,", "unknown column 'mark'"),
    ]:
        table.write_text(good.replace(old, new, 1))
        assert words in bench.refused("--replace"), words
    wrong = next(line for line in good.splitlines() if line.startswith("101,7,"))
    x, y = map(float, wrong.split(",")[2:])
    table.write_text(good.replace(wrong, f"101,7,{x + 9.0},{y}"))
    assert "fid.csv line 2: photo '101': its test flags 7" in bench.refused("--replace")
    table.write_text(good)
    assert "it is read" in bench.refused("--replace", "--csv", table)
    bench.fiducials.write_text(toml + "[photo.101]\n1 = [2, 3]\n")
    assert "[photo] beside measured" in bench.refused("--replace")
    bench.fiducials.write_text(toml.replace("fid.csv", "../fid.csv"))
    assert "leads out of the folder" in bench.refused("--replace")


def test_sides_that_do_not_agree(make_bench, tmp_path, capsys):
    bench = make_bench(SCAN, "px")
    upright = SCAN._replace(mirrored=False)
    other = fiducial_text(("103",), upright, "px").partition("[photo")[2]
    bench.fiducials.write_text(bench.fiducials.read_text() + "[photo" + other)
    assert run_inner(options(bench.fiducials)) == 0
    out = capsys.readouterr().out
    assert "mirrored: 101, 102; not mirrored: 103: were fiducials measured in another order?" in out
    assert out.count("y of these pixels runs up, or the photograph is seen from behind") == 1


def test_a_mirrored_photo_among_others_is_not_applied_unless_it_is_asked_for(make_bench):
    """As when all fiducials of one photo were measured in the order of the other side."""
    bench = make_bench()
    lines = bench.fiducials.read_text().splitlines()
    at = lines.index('[photo."102"]') + 1
    twin = {"1": "2", "2": "1", "3": "4", "4": "3", "5": "7", "7": "5", "6": "6", "8": "8"}
    parts = (line.partition(" =") for line in lines[at:])
    lines[at:] = [f"{twin[name]} ={rest}" for name, _, rest in parts]
    bench.fiducials.write_text("\n".join(lines) + "\n")
    message = bench.refused("--transformation", "affine")
    assert f"fid.toml line {at}: [photo.102]: is mirrored and '101' of the same file is" in message
    assert bench.run("--transformation", "affine", "--as-given") == 0
    assert len(bench.rows()) == 26


def test_plates_of_another_unit_are_not_applied_unless_it_is_asked_for(make_bench):
    bench = make_bench(SCAN._replace(mirrored=False))
    message = bench.refused()
    assert "[photo.102]: the scale of the plate is 40.0100 along x" in message
    assert "is it this camera? --as-given applies" in message
    assert bench.run("--as-given") == 0


def test_a_new_block_is_named_where_there_is_none(make_bench, tmp_path):
    bench = make_bench()
    none = bench._replace(block=tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"nowhere: no block; anaplot new .* --strip "):
        none.run()
    assert not (tmp_path / "nowhere").exists()


def test_a_block_without_strips_takes_any_photo(make_bench):
    toml = 'format = 1\nname = "t"\n[[camera]]\nfile = "rmk.toml"\n'
    bench = make_bench(toml=toml)
    assert bench.run() == 0
    assert [photo.id for photo in read_block(bench.block).photos] == ["102", "101"]


def test_a_block_that_states_its_camera_itself(make_bench):
    stated = BLOCK.replace('file = "rmk.toml"', 'id = "rmk"\nc = 152.4')
    assert make_bench(toml=stated).run() == 0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('file = "rmk.toml"', 'id = "rmk"\nc = 152.5', "is not the camera 'rmk', c = 152.5 mm"),
        ('file = "rmk.toml"', 'id = "k"\nc = 152.4', "is not the camera 'k'"),
        (
            'file = "rmk.toml"',
            'id = "rmk"\nc = 152.4\n[camera.lens]\nmodel = "brown"\nk1 = 1e-3',
            "with its lens",
        ),
    ],
)
def test_fiducials_of_another_camera(make_bench, old, new, words):
    assert words in make_bench(toml=BLOCK.replace(old, new)).refused()


def test_the_camera_file_of_the_block_says_something_else(make_bench):
    bench = make_bench()
    (bench.block / "rmk.toml").write_text(CAMERA.replace("12.2", "12.3"))
    assert "rmk.toml: says something else than the camera file 'rmk.toml' of " in bench.refused()


def test_a_camera_with_a_lens(make_bench):
    """What is written went through the lens, what is read is free of it."""
    bench = make_bench()
    text = CAMERA.partition("[distortion]")[0] + '[lens]\nmodel = "brown"\nk1 = -2e-3\np1 = 1e-4\n'
    for folder in (bench.block, bench.block.parent):
        (folder / "rmk.toml").write_text(text)
    refinement = Refinement.of(parse_camera(text, Path("rmk.toml")))
    at = MM.transformation().to_plate(refinement.distort(np.array(list(bench.truth.values()))))
    rows = [f"{p},{k},{x!r},{y!r}" for (p, k), (x, y) in zip(bench.truth, at.tolist(), strict=True)]
    bench.points.write_text("photo,point,x,y\n" + "\n".join(rows) + "\n")
    assert bench.run() == 0
    found = bench.rows()
    for key, place in bench.truth.items():
        assert (found[key].x, found[key].y) == pytest.approx(place, abs=1e-7)
        assert found[key].measured != (found[key].x, found[key].y)


AIR = """\
[refinement]
refraction = true
earth_curvature = true
flying_height = 1900.0
ground_height = 200.0
"""


def test_refraction_and_curvature_are_taken_off(make_bench, capsys):
    """Plates laid by the inverse of all of it, as the simulated plotter lays them."""
    bench = make_bench(toml=BLOCK.replace("[[camera]]", AIR + "[[camera]]"))
    block = read_declared(bench.block)
    by_photo = {
        photo: {point: place for (of, point), place in bench.truth.items() if of == photo}
        for photo in ("102", "101")
    }
    lie = MM.transformation()
    left, _ = laid_photographs(block, by_photo, {("101", "left"): lie, ("102", "left"): lie})
    rows = [
        f"{photo},{point},{left[photo][point][0]!r},{left[photo][point][1]!r}"
        for photo, point in bench.truth
    ]
    bench.points.write_text("photo,point,x,y\n" + "\n".join(rows) + "\n")
    assert bench.run("--json") == 0
    answer = json.loads(capsys.readouterr().out)["applied"]
    assert answer["refinement"]["flying_height"] == 1900.0
    for key, place in bench.truth.items():
        assert (bench.rows()[key].x, bench.rows()[key].y) == pytest.approx(place, abs=0.52e-7)
    # without the table the same plates are up to some micrometres off
    (bench.block / "block.toml").write_text(BLOCK)
    assert bench.run("--replace") == 0
    assert "taken off" not in capsys.readouterr().out
    rows = bench.rows()
    off = [np.hypot(rows[k].x - x, rows[k].y - y) for k, (x, y) in bench.truth.items()]
    assert 2e-3 < max(off) < 15e-3
    (bench.block / "block.toml").write_text(BLOCK.replace("[[camera]]", AIR + "[[camera]]"))
    assert bench.run("--replace") == 0
    out = capsys.readouterr().out
    assert "refraction is taken off: 7.1 um outwards at 162.6 mm from the principal point" in out
    assert "earth curvature is taken off: 24.7 um inwards at 162.6 mm" in out


def test_pixels_have_no_fiducials(make_bench):
    bench = make_bench()
    toml = bench.block / "block.toml"
    other = '[[camera]]\nid = "d"\nc = 20.0\npixels = [10, 10]\n[[strip]]'
    photos = "".join(
        f'[[photo]]\nid = "{p}"\ncamera = "{c}"\n'
        for p, c in (("101", "rmk"), ("102", "rmk"), ("103", "d"))
    )
    toml.write_text(BLOCK.replace("[[strip]]", other) + photos)
    (bench.block / "image_points.csv").write_text("photo,point,x_px,y_px\n103,1,2.0,3.0\n")
    assert "image_points.csv: is in pixels: its cameras have no fiducials" in bench.refused()


def test_what_is_wrong_with_a_row_is_named_with_its_line(make_bench):
    bench = make_bench()
    good = bench.points.read_text()
    for old, new, words in [
        ("102,1,", "109,1,", "points.csv line 2: photo: unknown photo '109' (did you mean"),
        ("102,1,", "103,1,", "points.csv line 2: photo: no fiducials of photo '103' are given"),
        ("102,1,", "102,2,", "twice in photo '102' (lines 2 and 3)"),
        ("102,1,", "102,1,1e12,5\n102,1,", "line 2: x: must lie between"),
        ("102,1,", "102,1,nan,5\n102,1,", "line 2: x: must be a finite number"),
        ("102,1,", "102,77,700,5\n102,1,", "line 2: x: 57"),
        ("102,1,", "102,77,120,500\n102,1,", "line 2: y: 38"),
        ("photo,", "foto,", "unknown column 'foto'"),
        (good, "photo,point,x,y\n", "points.csv: no point"),
        (good, "", "no header"),
    ]:  # fmt: skip
        bench.points.write_text(good.replace(old, new, 1))
        assert words in bench.refused(), words
    assert "outside the format of camera 'rmk'" in _outside(bench, good)


def _outside(bench: Bench, good: str) -> str:
    bench.points.write_text(good.replace("102,1,", "102,77,700,5\n102,1,", 1))
    return bench.refused()


def test_nothing_is_written_where_a_photo_cannot_be_oriented(make_bench, capsys):
    bench = make_bench()
    lines = bench.fiducials.read_text().splitlines()
    bench.fiducials.write_text("\n".join(lines[:-6]) + "\n")  # photo 102 keeps two
    before = contents(bench.block)
    assert bench.run() == 4
    out, err = capsys.readouterr()
    assert out == ""
    assert "photo 102: inner orientation needs 3 fiducials, 2 measured (1, 2)" in err
    assert err.endswith("anaplot: nothing is written\n")
    assert contents(bench.block) == before
    # of a photo without points nobody asks
    bench.points.write_text("".join(
        line for line in bench.points.read_text().splitlines(keepends=True) if line[:3] != "102"
    ))  # fmt: skip
    assert bench.run() == 0
    assert "fiducials, but no points: 102" in capsys.readouterr().out


def test_a_flagged_fiducial_is_not_applied_unless_it_is_asked_for(make_bench, capsys):
    bench = make_bench()
    lines = bench.fiducials.read_text().splitlines()
    wrong = lines.index('[photo."101"]') + 7
    name, _, place = lines[wrong].partition(" = ")
    x, y = json.loads(place)
    lines[wrong] = f"{name} = [{x}, {y + 0.2}]"
    bench.fiducials.write_text("\n".join(lines) + "\n")
    message = bench.refused()
    at = lines.index('[photo."101"]') + 1
    assert f"fid.toml line {at}: [photo.101]: its test flags 7" in message
    assert "--as-given applies it as it is" in message
    assert bench.run("--as-given", "--fail-on-flag") == 1
    out = capsys.readouterr().out
    assert "remeasure 7 (y)" in out
    assert [line.split()[0] for line in out.splitlines() if "< flagged" in line] == ["101"]
    assert len(bench.rows()) == 26


def test_flagged_photos_are_counted(make_bench):
    """One by its fiducial, one by its sigma0 alone."""
    bench = make_bench()
    lines = bench.fiducials.read_text().splitlines()
    four = lines.index('[photo."102"]') + 5
    del lines[four:]  # of four fiducials none can be flagged
    for k in (7, len(lines) - 1):
        name, _, place = lines[k].partition(" = ")
        x, y = json.loads(place)
        lines[k] = f"{name} = [{x}, {y + 0.2}]"
    bench.fiducials.write_text("\n".join(lines) + "\n")
    assert "[photo.102]: sigma0 " in bench.refused()
    assert " (and 1 more photo): measure again" in bench.refused()


def test_a_sigma0_beyond_its_limit_is_not_applied_either(make_bench):
    bench = make_bench(count=4)  # four fiducials: no row can be flagged
    text = bench.fiducials.read_text().splitlines()
    x, y = json.loads(text[-1].partition(" = ")[2])
    text[-1] = f"4 = [{x}, {y + 0.2}]"
    bench.fiducials.write_text("\n".join(text) + "\n")
    assert "[photo.102]: sigma0 " in bench.refused()


def test_a_block_that_is_open_is_left_alone(make_bench):
    bench = make_bench()
    (bench.block / "sessions").mkdir()
    lock = FolderLock(bench.block / "sessions" / "lock")
    try:
        with pytest.raises(InputError, match="is open in another anaplot"):
            bench.run()
    finally:
        lock.release()
    assert not (bench.block / "image_points.csv").exists()


def test_a_file_that_changes_meanwhile_is_not_overwritten(make_bench):
    bench = make_bench()
    measured = points_of(bench.block, [bench.points], bench.fiducials)
    other = "photo,point,x,y\n103,1,1.0,2.0\n"
    (bench.block / "image_points.csv").write_text(other)
    with pytest.raises(InputError, match="has changed meanwhile, nothing is written"):
        write(measured, merged(measured, ()))
    assert (bench.block / "image_points.csv").read_text() == other


def test_options_that_go_together(make_bench):
    bench = make_bench()
    for one in (("--apply", bench.block), ("--points", bench.points)):
        with pytest.raises(InputError, match="--apply BLOCK goes with --points FILE"):
            run_inner(options(bench.fiducials, *one))
    for alone in ("--replace", "--as-given"):
        with pytest.raises(InputError, match="go with --apply"):
            run_inner(options(bench.fiducials, alone))
    for read in (bench.points, bench.block / "image_points.csv", bench.block / "block.toml"):
        assert "it is read" in bench.refused("--csv", read)


def test_units_of_any_length_in_a_net_of_distances():
    """A plate in metres, in counts: fiducials that are a thousandth apart are no gross error."""
    net = replace(
        CALIBRATION,
        fiducials=(),
        distances=parse_camera(
            'format = 1\n[camera]\nid = "o"\nc = 210.0\n[distances]\n'
            'mm = [["1", "3", 226.0], ["4", "2", 226.0]]\n',
            Path("o.toml"),
        ).distances,
    )
    square = {"1": (7.0, 120.0), "2": (120.0, 233.0), "3": (233.0, 120.0), "4": (120.0, 7.0)}
    for scale in (1e-3, 1.0, 3333.0):
        inner = orient_inner(net, {k: (scale * x, scale * y) for k, (x, y) in square.items()})
        assert inner.placement.scale_x == pytest.approx(scale)
        assert inner.carried_um(np.zeros((1, 2))) is None


@pytest.mark.slow
@settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
@given(st.data())
def test_damage_is_one_line_or_a_block(make_bench, tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("damage")
    (folder / "block").mkdir()
    (folder / "block" / "block.toml").write_text(BLOCK)
    for at in (folder, folder / "block"):
        (at / "rmk.toml").write_text(CAMERA)
    points = "photo,point,x,y,sigma\n101,7,120.5,110.25,0.004\n102,8,100,90,\n"
    texts = {"fid.toml": fiducial_text(("101", "102"), MM), "points.csv": points}
    name = data.draw(st.sampled_from(sorted(texts)))
    at = data.draw(st.integers(0, len(texts[name])))
    length, put = data.draw(st.integers(0, 8)), data.draw(st.text(max_size=6))
    texts[name] = texts[name][:at] + put + texts[name][at + length :]
    for one, text in texts.items():
        (folder / one).write_text(text, encoding="utf-8", errors="surrogatepass")
    bench = Bench(folder / "block", folder / "fid.toml", folder / "points.csv", {})
    code, message = outcome(bench)
    assert message.isprintable()
    written = (bench.block / "image_points.csv").exists()
    assert written == (code == 0)
    if written:
        assert all(abs(row.x) <= 115.0 for row in read_declared_rows(bench.block))
    assert read_declared(bench.block).name == "test"


def outcome(bench: Bench) -> tuple[int, str]:
    try:
        return bench.run("--as-given"), ""
    except InputError as error:
        return error.exit_code, str(error)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_what_is_done_is_told_also_where_the_answer_cannot_be_written(make_bench) -> None:
    bench = make_bench(MM)
    with pytest.raises(InputError, match=r"/dev/full.*the points are written into .* all the same"):
        bench.run("--csv", "/dev/full")
    assert bench.rows()
