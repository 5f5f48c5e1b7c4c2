"""COLMAP models in and out: what is held, what is told, what is left as it was."""

from __future__ import annotations

import csv
import json
import struct
from collections import Counter
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.aliases import Array
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_block
from anaplot.exchange.formats import colmap
from anaplot.exchange.formats.colmapbinary import binary_model
from anaplot.exchange.formats.colmapcamera import (
    MODELS,
    ColmapCamera,
    our_lens,
    pinhole_directions,
    pinhole_spread,
)
from anaplot.exchange.formats.door import ImportOptions
from anaplot.exchange.formats.measuredrays import TWICE
from anaplot.exchange.imagepointscsv import format_image_points
from anaplot.exchange.importedfolder import write_imported
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    TestSettings,
    in_pixels,
)
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.measuredimage import measured_rays, pixels_of_mm
from anaplot.photogrammetry.rotation import rotation_matrix
from tests.exchange.formats.colmapsamples import Sample, SampleImage, sample

PLAIN = ImportOptions()


def notes_of(found: object) -> dict[str, int | None]:
    return {f"{note.what}: {note.text}": note.count for note in found.notes}  # type: ignore[attr-defined]


def projected(centre: Array, rotation: Array, c: float, xyz: Array) -> Array:
    """Return (n, 2) ideal image coordinates [mm] of points in one photo."""
    n = len(xyz)
    return project(np.tile(centre, (n, 1)), np.tile(rotation, (n, 1, 1)), np.full(n, c), xyz).xy


def switched_off(folder: Path, rows: set[tuple[str, str]], use: str = "off") -> None:
    """Switch rays of a block off, as a person does with an editor."""
    path = folder / "image_points.csv"
    with path.open(newline="") as file:
        table = list(csv.DictReader(file))
    for row in table:
        if (row["photo"], row["point"]) in rows:
            row["use"], row["reason"] = use, "blurred"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows(table)


def test_text_and_binary_are_the_same_block(tmp_path: Path) -> None:
    made = sample()
    of_binary = colmap.read(made.write(tmp_path / "binary" / "sparse" / "0"), PLAIN)
    of_text = colmap.read(made.write(tmp_path / "text", text=True), PLAIN)
    block = of_binary.block
    assert block.name == "binary"
    assert replace(of_text.block, name="binary") == block
    measured = [row.measured for row in block.image_points]
    assert measured == [row.measured for row in of_text.block.image_points]
    assert measured == [(x, y) for i in made.images for x, y, point in i.features if point]
    assert {photo.id for photo in block.photos} == {image.name for image in made.images}
    assert [row.point for row in block.image_points if row.use == "xy"] == [
        str(point)
        for image in made.images
        for point in dict.fromkeys(p for _, _, p in image.features if p is not None)
    ]
    twice = sum(
        count - 1
        for image in made.images
        for count in Counter(p for _, _, p in image.features if p is not None).values()
    )
    assert twice > 5
    off = [row for row in block.image_points if row.use == "off"]
    assert len(off) == twice
    assert all(row.point.endswith("~2") and row.reason == TWICE for row in off)
    counts = notes_of(of_binary)
    assert twice in counts.values()
    assert block.test.kind == "tau"
    assert block.precision.image_um == 1.0


def test_pixels_sizes_and_sigmas_are_as_they_are_stated(tmp_path: Path) -> None:
    folder = sample().write(tmp_path)
    block = colmap.read(folder, ImportOptions(sigma_px=0.5, pixel_um=4.0)).block
    by_id = {camera.id: camera for camera in block.cameras}
    assert by_id["7"].c == 1490.0 * 4.0 / 1000.0
    assert by_id["7"].lens is not None
    assert by_id["7"].lens.b1 == 1510.0 / 1490.0 - 1.0
    assert by_id["12"].pixels == (1600, 1200)
    assert block.precision.image_um == 2.0


def test_our_rays_are_pycolmaps(tmp_path: Path) -> None:
    """The adjusted place of a ray is that of pycolmap's camera to 1e-9 px, photo by photo."""
    pycolmap = pytest.importorskip("pycolmap")
    made = sample()
    block = colmap.read(made.write(tmp_path), PLAIN).block
    theirs = pycolmap.Reconstruction(tmp_path)
    assert len(theirs.images) == len(made.images)
    xyz = np.array(list(made.points.values()))
    for image in theirs.images.values():
        photo = next(photo for photo in block.photos if photo.id == image.name)
        camera = block.camera_of(photo.id)
        assert photo.position is not None
        assert photo.rotation is not None
        rotation = rotation_matrix(*photo.rotation)
        ideal = projected(np.array(photo.position), rotation, camera.c, xyz)
        ours = pixels_of_mm(camera, measured_rays(camera, ideal))
        seen = theirs.cameras[image.camera_id].img_from_cam(image.cam_from_world() * xyz)
        np.testing.assert_allclose(ours, seen, atol=1e-9)


CAMERAS = {
    0: (800.0, 500.0, 380.0),
    1: (800.0, 820.0, 500.0, 380.0),
    2: (800.0, 500.0, 380.0, -0.05),
    3: (800.0, 500.0, 380.0, -0.05, 0.01),
    4: (800.0, 820.0, 500.0, 380.0, -0.05, 0.01, 0.001, -0.002),
    5: (800.0, 820.0, 500.0, 380.0, 0.02, -0.01, 0.003, -0.001),
    6: (800.0, 820.0, 500.0, 380.0, 0.1, -0.05, 0.001, -0.002, 0.01, 0.08, -0.02, 0.001),
    7: (800.0, 820.0, 500.0, 380.0, 0.9),
    8: (800.0, 500.0, 380.0, 0.02),
    9: (800.0, 500.0, 380.0, 0.02, -0.01),
    10: (800.0, 820.0, 500.0, 380.0, 0.02, -0.01, 0.001, -0.002, 0.01, -0.001, 0.002, -0.001),
    12: (800.0, 500.0, 380.0, -0.1),
    13: (800.0, 820.0, 500.0, 380.0, 0.1),
    14: (800.0, 500.0, 380.0),
    15: (800.0, 820.0, 500.0, 380.0),
}


@pytest.mark.parametrize("model", CAMERAS)
@pytest.mark.parametrize("bend", [1.0, 0.01])
def test_every_camera_model_is_pycolmaps(model: int, bend: float) -> None:
    """To 1e-9 px for models that are our lens, undone to 1e-12 for the others; weak bends too."""
    pycolmap = pytest.importorskip("pycolmap")
    front = 4 if MODELS[model].two else 3
    params = (*CAMERAS[model][:front], *(bend * value for value in CAMERAS[model][front:]))
    theirs = pycolmap.Camera(
        model=pycolmap.CameraModelId(model), width=1000, height=760, params=params
    )
    assert theirs.model_name == MODELS[model].name
    rng = np.random.default_rng(model)
    direction = rng.uniform(-0.6, 0.6, (200, 2))
    direction[0] = 0.0
    pixels = theirs.img_from_cam(np.column_stack((direction, np.ones(200))))
    ours = ColmapCamera(1, model, 1000, 760, params)
    lens = our_lens(ours)
    if lens is None:
        found = pinhole_directions(ours, pixels)
        np.testing.assert_allclose(found, direction, atol=1e-12)
        step = 1e-3
        numeric = np.stack(
            [
                (pinhole_directions(ours, pixels + by) - pinhole_directions(ours, pixels - by))
                / (2.0 * step / ours.focal[k])
                for k, by in enumerate(step * np.eye(2))
            ],
            axis=2,
        )
        spread = pinhole_spread(ours, pixels, found)
        np.testing.assert_allclose(spread, numeric, atol=2e-8)
        return
    camera = in_pixels(
        Camera("1", ours.focal[1] / 1000.0, lens=lens), (1000, 760), None, ours.principal
    )
    ideal = direction * (camera.c, -camera.c)
    np.testing.assert_allclose(
        pixels_of_mm(camera, measured_rays(camera, ideal)), pixels, atol=1e-9
    )


def test_a_full_opencv_without_a_denominator_is_our_lens_with_its_k3() -> None:
    params = (800.0, 810.0, 5.0, 4.0, 0.1, -0.2, 0.01, 0.02, 0.3, 0.0, 0.0, 0.0)
    lens = our_lens(ColmapCamera(1, 6, 10, 8, params))
    assert lens == BrownLens(0.1, -0.2, 0.3, 0.01, 0.02, 800.0 / 810.0 - 1.0)


def test_a_fisheye_becomes_a_pinhole_and_what_it_sees_beside_is_told(tmp_path: Path) -> None:
    made = sample(photos=2)
    made.cameras = dict.fromkeys(made.cameras, (14, 2000, 1500, (900.0, 1000.0, 750.0)))
    for image in made.images:
        # 30, 75 and 85 degrees off the axis
        image.features = [
            (1000.0 + 900.0 * np.radians(angle), 750.0, number)
            for angle, number in zip((30.0, 75.0, 85.0), made.points, strict=False)
        ]
    found = colmap.read(made.write(tmp_path), PLAIN)
    camera = found.block.cameras[0]
    assert camera.pixels is not None
    assert camera.pixels[0] == np.ceil(1000.0 + 900.0 * np.tan(np.radians(75.0)))
    np.testing.assert_allclose(
        [row.x / camera.c for row in found.block.image_points[:2]],
        np.tan(np.radians([30.0, 75.0])),
    )
    told = notes_of(found)
    assert sum(count or 0 for text, count in told.items() if "80 degrees" in text) == 2
    assert any("corrected to pixels of a pinhole" in text for text in told)


def test_a_fisheye_that_sees_nothing_within_reach_leaves_no_sigmas(tmp_path: Path) -> None:
    made = sample(photos=3)
    wide = made.images[0]
    made.cameras[99] = (14, 1000, 800, (200.0, 500.0, 400.0))
    wide.camera, wide.features = 99, [(10.0, 10.0, number) for _, _, number in wide.features]
    found = colmap.read(made.write(tmp_path), PLAIN)
    lost = [count for text, count in notes_of(found).items() if "80 degrees" in text]
    assert lost == [sum(number is not None for _, _, number in wide.features)]
    assert wide.name not in {row.photo for row in found.block.image_points}
    assert "sigma_um" not in format_image_points(found.block.image_points, found.block)


def wide_fisheye(rng: np.random.Generator) -> Sample:
    """Return vertical fisheye photos with errors of 1 px, up to 75 degrees off the axis."""
    xyz = np.column_stack((rng.uniform(-40.0, 40.0, (80, 2)), rng.uniform(0.0, 4.0, 80)))
    made = Sample({1: (14, 1100, 1100, (330.0, 550.0, 550.0))}, [], {})
    for k, centre in enumerate(np.array([(x, y, 15.0) for x in (-12, 0, 12) for y in (-9, 9)])):
        away = (xyz - centre) * (1.0, -1.0, -1.0)
        angle = np.arctan2(np.hypot(away[:, 0], away[:, 1]), away[:, 2])
        scale = 330.0 * angle / np.hypot(away[:, 0], away[:, 1])
        seen = 550.0 + away[:, :2] * scale[:, None] + rng.normal(0.0, 1.0, (80, 2))
        shift = tuple((-centre * (1.0, -1.0, -1.0)).tolist())
        image = SampleImage(k + 1, 1, f"{k}.jpg", (0.0, 1.0, 0.0, 0.0, *shift))
        image.features = [
            (x, y, number)
            for number, (x, y), off in zip(range(1, 81), seen.tolist(), angle, strict=True)
            if off < np.radians(75.0)
        ]
        made.images.append(image)
    times = Counter(number for image in made.images for _, _, number in image.features)
    for image in made.images:
        image.features = [one for one in image.features if times[one[2] or 0] > 2]
    made.points = {k + 1: tuple(p) for k, p in enumerate(xyz.tolist()) if times[k + 1] > 2}
    return made


@pytest.mark.slow
def test_sigma0_of_a_wide_fisheye_is_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sigmas have what the correction magnifies: 15 times along the radius at 75 degrees."""
    made = wide_fisheye(np.random.default_rng(4))
    source = made.write(tmp_path / "in")
    block = tmp_path / "b"
    assert main(["import", "colmap", str(source), "-o", str(block)]) == 0
    said = capsys.readouterr().out
    assert "along the radius" in said
    assert main(["adjust", str(block), "--datum", "free", "--json"]) in (0, 1)
    found = json.loads(capsys.readouterr().out)
    redundancy = found["redundancy"]
    assert redundancy > 200
    # unequal weights along and across the radius widen the chi-square bound
    assert abs(found["sigma0"] - 1.0) < 5.0 / np.sqrt(2.0 * redundancy)


def test_the_second_ray_of_a_track_counts_where_the_first_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Import and export number rays alike: the ray that is switched off goes, no other."""
    made = wide_fisheye(np.random.default_rng(5))
    image = made.images[0]
    first, second, third = (image.features[k] for k in (0, 4, 8))
    beyond = (550.0 + 330.0 * np.radians(85.0), 550.0, first[2])
    outside = (5000.0, 550.0, third[2])
    image.features[:0] = [beyond, (second[0] + 3.0, second[1], second[2]), outside]
    source = made.write(tmp_path / "in")
    block = tmp_path / "b"
    assert main(["import", "colmap", str(source), "-o", str(block)]) == 0
    rows = {row.point: row for row in read_block(block).image_points if row.photo == image.name}
    assert rows[str(first[2])].use == rows[str(second[2])].use == "xy"
    assert rows[f"{second[2]}~2"].reason == TWICE
    assert f"{first[2]}~2" not in rows
    switched_off(block, {(image.name, str(one[2])) for one in (first, third)})
    capsys.readouterr()
    assert main(["export", "colmap", str(block), "-o", str(tmp_path / "out")]) == 0
    out = binary_model(tmp_path / "out").images[0]
    left = {(*xy, point) for xy, point in zip(out.xy.tolist(), out.point.tolist(), strict=True)}
    assert beyond in left
    assert not left & {first, second, third}
    assert (second[0] + 3.0, *second[1:]) in left
    # nothing is said of what is as it was; of what was measured anew, or taken out, it is
    said = capsys.readouterr().out
    assert "measured anew" not in said
    before = said.partition(" rays that are not in the block")[0].split()[-1]
    head, *lines = (block / "image_points.csv").read_text().splitlines()
    assert head.startswith("photo,point,x_px,")
    counts = [k for k, line in enumerate(lines) if ",off" not in line]
    fields = lines[counts[0]].split(",")
    fields[2] = repr(float(fields[2]) + 0.125)
    lines[counts[0]] = ",".join(fields)
    del lines[counts[-1]]
    (block / "image_points.csv").write_text("\n".join([head, *lines]) + "\n")
    assert main(["export", "colmap", str(block), "-o", str(tmp_path / "anew")]) == 0
    said = capsys.readouterr().out
    assert "not held: 1 rays measured anew: the model keeps the features' places" in said
    assert f"assumed: {int(before) + 1} rays that are not in the block stay" in said


@pytest.mark.parametrize("text", [False, True])
def test_a_model_without_images_is_one_line(tmp_path: Path, text: bool) -> None:
    source = Sample({}, [], {}).write(tmp_path, text=text)
    with pytest.raises(InputError, match="no image with a pose sees a point"):
        colmap.read(source, PLAIN)


@pytest.mark.parametrize("text", [False, True])
def test_a_block_that_is_not_cleaned_goes_out_as_it_came(tmp_path: Path, text: bool) -> None:
    source = sample().write(tmp_path / "in", text=text)
    if not text:
        (source / "rigs.bin").write_bytes(b"rigs")
        (source / "frames.bin").write_bytes(b"frames")
    assert main(["import", str(source), "-o", str(tmp_path / "b")]) == 0
    assert main(["export", "colmap", str(tmp_path / "b"), "-o", str(tmp_path / "out")]) == 0
    files = {file.name: file.read_bytes() for file in source.iterdir()}
    assert {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()} == files


@pytest.mark.parametrize("text", [False, True])
def test_what_is_switched_off_is_in_no_track(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: bool
) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    made = sample()
    source = made.write(tmp_path / "in", text=text)
    block, out = tmp_path / "b", tmp_path / "out"
    assert main(["import", "colmap", str(source), "-o", str(block)]) == 0
    rows = read_block(block).image_points
    first = next(row for row in rows if row.use == "xy")
    # a point of which one ray is left, and one ray of another point
    lost = [row for row in rows if row.point == first.point and row.use == "xy"][1:]
    some = next(row for row in rows if row.photo != first.photo and row.point != first.point)
    keys = {(row.photo, row.point) for row in (*lost, some)}
    switched_off(block, keys)
    capsys.readouterr()
    assert main(["export", "colmap", str(block), "-o", str(out), "--json"]) == 0
    told = {note["text"]: note["count"] for note in json.loads(capsys.readouterr().out)["notes"]}
    assert told["rays that do not count are in no track any more"] == len(keys)
    assert told["points that keep fewer than two rays"] == 1
    # what should be there now, by its own way
    gone = int(first.point)
    wanted: Counter[tuple[str, int]] = Counter()
    for image in made.images:
        for point in dict.fromkeys(p for _, _, p in image.features if p is not None):
            if point != gone and (image.name, str(point)) not in keys:
                wanted[image.name, point] += 1
    theirs = pycolmap.Reconstruction(out)
    assert set(theirs.points3D) == set(made.points) - {gone}
    seen: Counter[tuple[str, int]] = Counter()
    for number, point in theirs.points3D.items():
        for element in point.track.elements:
            image = theirs.images[element.image_id]
            assert image.points2D[element.point2D_idx].point3D_id == number
            seen[image.name, number] += 1
    assert seen == wanted
    before = pycolmap.Reconstruction(source)
    for number, image in before.images.items():
        after = theirs.images[number]
        assert after.num_points2D() == image.num_points2D()
        assert after.cam_from_world() == image.cam_from_world() or np.array_equal(
            after.cam_from_world().matrix(), image.cam_from_world().matrix()
        )
        assert [p.xy.tolist() for p in after.points2D] == [p.xy.tolist() for p in image.points2D]
    name = f"cameras.{'txt' if text else 'bin'}"
    assert (out / name).read_bytes() == (source / name).read_bytes()


@pytest.mark.parametrize("lost", ["cameras.txt", "images.txt", "points3D.txt"])
def test_a_source_that_has_lost_a_file_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lost: str
) -> None:
    block = tmp_path / "b"
    assert main(["import", str(sample().write(tmp_path / "in", text=True)), "-o", str(block)]) == 0
    (block / "source" / lost).unlink()
    assert main(["export", "colmap", str(block), "-o", str(tmp_path / "out")]) == 2
    assert f"has lost {lost};" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_ray_of_one_coordinate_goes_and_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = sample().write(tmp_path / "in")
    block = tmp_path / "b"
    main(["import", str(source), "-o", str(block)])
    row = next(row for row in read_block(block).image_points if row.use == "xy")
    switched_off(block, {(row.photo, row.point)}, "y")
    capsys.readouterr()
    assert main(["export", "colmap", str(block), "-o", str(tmp_path / "out")]) == 0
    assert "not held: 1 of them count in one coordinate" in capsys.readouterr().out
    cleaned = colmap.read(tmp_path / "out", PLAIN).block
    assert (row.photo, row.point) not in {(r.photo, r.point) for r in cleaned.image_points}


def test_what_has_no_pose_or_sees_nothing_is_left_out_and_counted(tmp_path: Path) -> None:
    made = sample()
    made.images[1].pose = (np.nan,) * 7
    made.images[2].pose = (0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0)
    made.images[4].features = []
    for text in (False, True):
        found = colmap.read(made.write(tmp_path / str(text), text=text), PLAIN)
        assert [p.id for p in found.block.photos] == [made.images[k].name for k in (0, 3, 5)]
        told = notes_of(found)
        assert told["dropped: images without a pose"] == 2
        assert told["dropped: images that see no point"] == 1


def test_tracks_that_tell_something_else_are_counted(tmp_path: Path) -> None:
    made = sample()
    files = made.text()
    lines = files["points3D.txt"].decode().splitlines()
    lines[1] = " ".join(lines[1].split()[:-2])
    files["points3D.txt"] = "\n".join(lines).encode()
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    told = notes_of(colmap.read(tmp_path, PLAIN))
    assert told["assumed: rays that tracks and images tell differently: the images count"] == 1


def test_a_block_from_elsewhere_becomes_a_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Convergent photos in mm over control: pycolmap sees every ray where it was measured."""
    pycolmap = pytest.importorskip("pycolmap")
    rng = np.random.default_rng(2)
    xyz = np.array((5e5, 5.4e6, 100.0)) + rng.uniform(-50.0, 50.0, (30, 3))
    names = ["7", "a b", *(f"p{k}" for k in range(28))]
    camera = Camera("rmk", 152.4, (230.0, 230.0))
    photos, rows = [], []
    for k in range(4):
        centre = np.array([5e5 - 60.0 + 40.0 * k, 5.4e6 + 15.0 * (-1) ** k, 350.0])
        angles = (0.05 * k, 0.2 - 0.1 * k, 1.1 * k)
        seen = projected(centre, rotation_matrix(*angles), camera.c, xyz)
        photos.append(Photo(f"{101 + k}", "rmk", tuple(centre.tolist()), angles))  # type: ignore[arg-type]
        rows += [
            ImagePoint(f"{101 + k}", name, x, y)
            for name, (x, y) in zip(names, seen.tolist(), strict=True)
        ]
    rows.append(ImagePoint("101", "alone", 10.0, 10.0, use="off"))
    control = tuple(
        ControlPoint(name, tuple(place), (0.01,) * 3)  # type: ignore[arg-type]
        for name, place in zip(names[:5], xyz.tolist(), strict=False)
    )
    block = Block(
        "mm",
        Precision(),
        TestSettings("baarda"),
        (camera,),
        tuple(photos),
        (),
        tuple(rows),
        control,
    )
    write_block(tmp_path / "b", block)
    assert main(["export", "colmap", str(tmp_path / "b"), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "10 um as the pixels" in said
    assert "29 points whose name is no number" in said
    assert "not held: image_um = 5 um" in said
    assert "not held: the settings of the test: baarda, alpha = 0.001, power = 0.8" in said
    theirs = pycolmap.Reconstruction(tmp_path / "out")
    assert {image.name for image in theirs.images.values()} == {"101", "102", "103", "104"}
    assert len(theirs.points3D) == 30
    np.testing.assert_allclose(theirs.points3D[7].xyz, xyz[0], atol=1e-5)
    for image in theirs.images.values():
        for feature in image.points2D:
            there = theirs.points3D[feature.point3D_id].xyz
            np.testing.assert_allclose(image.project_point(there), feature.xy, atol=1e-2)
    assert theirs.compute_mean_reprojection_error() < 1e-2


HOSTILE = [
    ("images", b"5 1 0 0", "an image is IMAGE_ID"),
    ("cameras", b"9 RADIAAL 5 5 1", "no camera model 'RADIAAL' (did you mean 'RADIAL'?)"),
    ("cameras", b"9 RADIAL 5 5 1 2 3", "RADIAL has 5 parameters, not 3"),
    ("cameras", b"3 PINHOLE 5 5 1 1 3 3", "two cameras have the number 3"),
    ("cameras", b"9 PINHOLE 0 5 1 1 3 3", "images of 0 x 5 px"),
    ("cameras", b"9 PINHOLE 5 5 0 1 3 3", "a focal length that is not greater than 0"),
    ("cameras", b"9 PINHOLE 5 5 nan 1 3 3", "must be a finite number, not 'nan'"),
    ("cameras", b"9 EQUIRECTANGULAR 5 5 5 5", "the model EQUIRECTANGULAR is not read"),
    ("cameras", b"9 EUCM 5 5 1 1 3 3 .5 1", "the model EUCM is not read"),
    ("images", b"99 1 0 0 0 0 0 0 8 x.jpg\n", "there is no camera 8"),
    ("images", b"5 1 0 0 0 0 0 0 3 x.jpg\n", "two images have the number '5'"),
    ("images", b"99 1 0 0 0 0 0 0 3 day-1/IMG_000.jpg\n", "two images have the name"),
    ("images", b"99 1 0 0 0 0 0 0 3 a\x1b[2Jb\n", r"'a\x1b[2Jb' holds a character"),
    ("images", b"99 1 0 0 0 0 0 0 3 " + b"x" * 300 + b"\n", "longer than 255"),
    ("images", b"99 1 0 0 0 0 0 0 3 x.jpg\n1 2", "features are X Y POINT3D_ID"),
    ("images", b"99 1 0 0 0 0 0 0 3 x.jpg\n1 nan 4", "a coordinate that is no finite number"),
    ("images", b"99 1 0 0 0 0 0 0 3 x.jpg\n1 1_0 4", "must be a finite number, not '1_0'"),
    ("images", b"99 1 0 0 0 0 0 0 3 x.jpg\n1 2 123456", "is of point 123456, which there is none"),
    ("images", b"99 1 x 0 0 0 0 0 3 x.jpg\n", "a number of the pose must be"),
    ("images", b"99 1 0 0 0 0 0 0 3 \xff.jpg\n", "not UTF-8 text"),
    ("images", b"-1 1 0 0 0 0 0 0 3 x.jpg\n", "must lie between 0 and"),
    ("points3D", b"1 2 3", "a point is POINT3D_ID X Y Z"),
    ("points3D", b"77777 0 0 0 1 1 1 .5 5 -3", "a number of the track must lie"),
]


@pytest.mark.parametrize(("part", "line", "message"), HOSTILE)
def test_text_that_is_wrong_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], part: str, line: bytes, message: str
) -> None:
    source = sample().write(tmp_path / "in", text=True)
    with (source / f"{part}.txt").open("ab") as file:
        file.write(line)
    assert main(["import", "colmap", str(source), "-o", str(tmp_path / "b")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert f"{part}.txt" in error
    assert error.count("\n") == 1
    assert "\x1b" not in error
    assert not (tmp_path / "b").exists()


def test_a_panorama_alone_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = sample().write(tmp_path / "in", text=False)
    camera = struct.pack("<QIiQQ2d", 1, 3, 17, 1024, 512, 1024.0, 512.0)  # width and height again
    (source / "cameras.bin").write_bytes(camera)
    assert main(["import", "colmap", str(source), "-o", str(tmp_path / "b")]) == 2
    assert "camera 3: the model EQUIRECTANGULAR is not read" in capsys.readouterr().err


def damaged(made: Sample, part: str, at: int, data: bytes) -> bytes:
    """Return a binary file with other bytes in it."""
    whole = made.binary()[f"{part}.bin"]
    return whole[:at] + data + whole[at + len(data) :]


MANY = (10**12).to_bytes(8, "little")
NAN = np.array([np.nan]).tobytes()
BINARY = [
    ("cameras", 0, MANY, "says it holds 1000000000000 cameras"),
    ("images", 0, MANY, "says it holds 1000000000000 images"),
    ("points3D", 0, MANY, "says it holds 1000000000000 points"),
    ("images", 72 + 18, MANY, "says it holds 1000000000000 features of image 1"),
    ("points3D", 8 + 43, MANY, "says it holds 1000000000000 images of point 1"),
    ("cameras", 8 + 4, (18).to_bytes(4, "little"), "no camera model has the number 18"),
    ("cameras", 8 + 4, (17).to_bytes(4, "little"), "EQUIRECTANGULAR is not read"),
    ("cameras", 8 + 8, MANY, "images of 1000000000000 x 1500 px"),
    ("cameras", 8 + 24, NAN, "a parameter that is no finite number"),
    ("images", 72, b"\xff", "its name is not UTF-8"),
    ("images", 72, b"\x07", r"'\x07ay-1/IMG_000.jpg' holds a character"),
    ("images", 72, b"\x00", "the name '' is empty"),
    ("images", 68, (99).to_bytes(4, "little"), "there is no camera 99"),
    ("images", 72 + 26 + 48, NAN, "a coordinate that is no finite number"),
    ("points3D", 8, (2**64 - 1).to_bytes(8, "little"), "its number is beyond"),
]


@pytest.mark.parametrize(("part", "at", "data", "message"), BINARY)
def test_binary_that_is_wrong_is_named(
    tmp_path: Path, part: str, at: int, data: bytes, message: str
) -> None:
    made = sample()
    source = made.write(tmp_path)
    (source / f"{part}.bin").write_bytes(damaged(made, part, at, data))
    with pytest.raises(InputError) as caught:
        colmap.read(source, PLAIN)
    said = str(caught.value)
    if part == "images" and data == b"\x00":
        # the rest of the name is read as a count
        assert "says it holds" in said
    else:
        assert message in said
    assert f"{part}.bin" in said


@pytest.mark.slow
@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_a_file_cut_anywhere_is_no_model(tmp_path: Path, part: str) -> None:
    made = sample(photos=2, points=6)
    source = made.write(tmp_path)
    whole = made.binary()[f"{part}.bin"]
    for length in range(len(whole)):
        (source / f"{part}.bin").write_bytes(whole[:length])
        with pytest.raises(InputError, match=rf"{part}\.bin: "):
            colmap.read(source, PLAIN)
    (source / f"{part}.bin").write_bytes(whole + b"\0")
    with pytest.raises(InputError, match="1 bytes behind its end"):
        colmap.read(source, PLAIN)


def test_what_is_no_model_is_said(tmp_path: Path) -> None:
    assert not colmap.recognises(tmp_path)
    assert not colmap.recognises(tmp_path / "a\0b")
    with pytest.raises(InputError, match=r"no COLMAP model: cameras\.bin"):
        colmap.read(tmp_path, PLAIN)
    made = sample()
    for image in made.images:
        image.features = []
    with pytest.raises(InputError, match="no image with a pose sees a point"):
        colmap.read(made.write(tmp_path), PLAIN)


def test_names_have_blanks(tmp_path: Path) -> None:
    made = sample()
    made.images[0].name = "first day/a  b.jpg"
    for text in (False, True):
        block = colmap.read(made.write(tmp_path / str(text), text=text), PLAIN).block
        assert block.photos[0].id == "first day/a  b.jpg"


def test_a_text_line_beyond_all_measure_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("anaplot.exchange.formats.sourcelines._MAX_LINE", 1000)
    source = sample().write(tmp_path, text=True)
    with pytest.raises(InputError, match=r"images\.txt line 4: longer than 1000 bytes"):
        colmap.read(source, PLAIN)


@pytest.mark.slow
@given(
    st.sampled_from(["cameras", "images", "points3D"]),
    st.integers(0, 3000),
    st.binary(min_size=1, max_size=9),
    st.booleans(),
)
def test_damage_gives_a_block_or_one_line(part: str, at: int, data: bytes, text: bool) -> None:
    made = sample(photos=2, points=6)
    files = made.text() if text else made.binary()
    name = f"{part}.{'txt' if text else 'bin'}"
    at %= len(files[name])
    files[name] = files[name][:at] + data + files[name][at + len(data) :]
    with TemporaryDirectory() as folder:
        for one, content in files.items():
            Path(folder, one).write_bytes(content)
        said, found = "", None
        try:
            found = colmap.read(Path(folder), PLAIN)
            write_imported(Path(folder, "b"), found, Path(folder))
        except InputError as error:
            said = str(error)
        assert said.isprintable()
        if not said:
            assert found is not None
            kept = read_block(Path(folder, "b")).image_points
            assert [(row.point, row.use, row.measured) for row in kept] == [
                (row.point, row.use, row.measured) for row in found.block.image_points
            ]
